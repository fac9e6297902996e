"""From hit buffers to colours: the colour map of each sheet, its range and its lines, and how all of them add up."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.errors import ElvisError
from elvis.renderer.compositing import Coats
from elvis.renderer.hit_buffer import HitBuffer
from elvis.renderer.painting import Brush, Look
from elvis.renderer.passes.lines.contour_proof import ContourProof
from elvis.renderer.passes.lines.lines import levels
from elvis.renderer.passes.volume.volume_rendering import Medium
from elvis.renderer.pixels import NOBODY
from elvis.renderer.stages import Sheet, Stages
from elvis.scene import Implicit, Scene, Style, Vector, VolumeRendering
from elvis.scene.conditioning import uncertainties
from elvis.scene.frame import Legend, Status
from elvis.scene.palette import Palette, automatic_range
from elvis.scene.view import View

#: part of a depth within which it is asked whether either of two hits may be the nearer one
NEAR = 2e-8
#: what tells colour maps apart: the quantity, the name of the map, the range that was asked for
Key: TypeAlias = tuple[str, str, object]
Drawn: TypeAlias = list[tuple[Sheet, HitBuffer]]


def record_of(drawn: Drawn, view: View, *, whole: bool = True) -> HitBuffer:
    """The surface that counts at each pixel: of the most opaque ones the nearest; a failed search anywhere is told.

    whole  whether reference coordinates, normals and uncertainties are wanted too
    What another one may have overlooked, or has so near that either may be the nearer one, makes pixels ambiguous.
    """
    if len(drawn) == 1:
        return drawn[0][1]
    best, opacity = HitBuffer.empty(view.count), np.zeros(view.count)
    best.uncertainty = np.full(view.count, np.nan)
    failed, source = np.zeros(view.count, bool), np.full(view.count, -1)
    for number, (sheet, hits) in enumerate(drawn):
        failed |= hits.status == Status.FAILED
        nearer = (sheet.style.opacity == opacity) & (hits.depth < best.depth)
        better = np.flatnonzero((hits.owner != NOBODY) & (nearer | (sheet.style.opacity > opacity)))
        opacity[better], source[better] = sheet.style.opacity, number
        for name in ("owner", "field", "depth", "status", *(("reference", "normal") if whole else ())):
            getattr(best, name)[better] = getattr(hits, name)[better]
        best.uncertainty[better] = np.nan if hits.uncertainty is None else hits.uncertainty[better]
    for sheet, hits in drawn:
        counts = sheet.style.opacity >= opacity
        best.status[_overlooked(hits, best, counts, sheet.style.opacity > opacity)] = Status.AMBIGUOUS
        pixel = np.flatnonzero(_beside(hits, best) & counts)
        around = _uncertain(hits, view, pixel)
        for other in np.unique(source[pixel]):
            here = source[pixel] == other
            around[here] += _uncertain(drawn[other][1], view, pixel[here])
        close = np.abs(hits.depth[pixel] - best.depth[pixel]) <= around
        best.status[pixel[close]] = Status.AMBIGUOUS
    best.status[failed] = Status.FAILED
    return best


def _overlooked(hits: HitBuffer, best: HitBuffer, counts: Bools, more: Bools) -> Bools:
    """(n,) where a hit buffer may have overlooked what should be there in place of the best hits.

    counts, more  (n,) where it is as opaque as these at least, and where it is more so
    """
    missing = (hits.status == Status.AMBIGUOUS) & (hits.owner == NOBODY)
    doubt = np.where(missing, 0.0, np.inf) if hits.doubt is None else hits.doubt
    before = (best.owner == NOBODY) | more | counts & (doubt <= best.depth)
    return np.asarray(np.isfinite(doubt) & before)


def _beside(hits: HitBuffer, best: HitBuffer) -> Bools:
    """(n,) where a hit buffer's hit may be nearer than the best one; at the same depth the first object's counts."""
    with np.errstate(invalid="ignore"):
        apart = np.abs(hits.depth - best.depth)
    return np.asarray((apart > 0.0) & (apart <= NEAR * best.depth) & (hits.owner != NOBODY))


def _uncertain(hits: HitBuffer, view: View, pixel: Ints) -> Floats:
    """(k,) the uncertainties of hits in pixels (k,), those of surfaces in closed form by their normals.

    Where they are infinite there is a doubt, too, which begins before the hit.
    """
    depth = hits.depth[pixel]
    origins, directions = view.rays(pixel % view.width, pixel // view.width)
    reach = float(np.abs(origins + depth[:, None] * directions).max(initial=0.0))
    known = np.full(len(pixel), np.nan) if hits.uncertainty is None else hits.uncertainty[pixel]
    rounded = uncertainties(view, pixel, depth, hits.normal[pixel], reach)
    return np.where(np.isnan(known), rounded, np.nan_to_num(known, posinf=0.0))


class Painter:
    """The colours of one scene."""

    def __init__(self, scene: Scene, stages: Stages) -> None:
        self.scene, self.stages = scene, stages
        self._brush = Brush(stages.loaded.device)
        self._shown: set[int] = set()
        self.glow: NDArray[np.uint8] = np.zeros(0, np.uint8)  # what is known of volumes in the last painting
        self.gathered: Counter[str] = Counter()  # segments of rays in volumes, and what is wrong with some
        self._seen: dict[str, tuple[float, float]] = {}
        self._palettes: dict[Key, Palette] = {}

    def note(self, drawn: Drawn, cropped: Callable[[NDArray[Any]], NDArray[Any]]) -> None:
        """Let the ranges of what is seen hold the values of some hit buffers.

        cropped  leaves of an array of all pixels those of the picture
        """
        for sheet, hits in drawn:
            self._note(sheet.quantity, cropped(hits.field))
            self._shown |= {id(sheet)} if (cropped(hits.owner) != NOBODY).any() else set()
            contours = sheet.style.contours
            if contours and contours.count and self._of_contours(sheet) != sheet.quantity:
                quantity = self._of_contours(sheet)
                self._note(quantity, cropped(self.stages.resampled(hits, "", quantity).field))

    def _note(self, quantity: str | None, values: Floats) -> None:
        """Of all finite values the least and the greatest are kept."""
        least = np.fmin.reduce(values, axis=None, initial=np.inf)
        most = np.fmax.reduce(values, axis=None, initial=-np.inf)
        if np.isinf(least) or np.isinf(most):
            finite = values[np.isfinite(values)]
            least, most = finite.min(initial=np.inf), finite.max(initial=-np.inf)
        if least <= most:
            low, high = self._seen.get(quantity or "", (np.inf, -np.inf))
            self._seen[quantity or ""] = min(low, float(least)), max(high, float(most))

    def _of_contours(self, sheet: Sheet) -> str | None:
        contours = sheet.style.contours
        if contours is None or contours.quantity is None:
            return sheet.quantity
        return self.stages.named(contours.quantity, self.scene)

    def range_of(self, quantity: str | None, asked: object) -> tuple[float, float]:
        """The ends of a colour map."""
        if isinstance(asked, tuple):
            return asked
        if asked == "all":
            return automatic_range(np.array(self.stages.bounds(quantity or self.scene.field)))
        return automatic_range(np.array(self._seen.get(quantity or "", ())))

    def paint(self, drawn: Drawn, view: View, *, whole: bool = False) -> Floats | NDArray[np.uint8]:
        """(n, 3) colours of all hits of a view over the background; numbers of 8 bits are welcome where ``whole``."""
        volumes = [item for item in self.scene.every_object if isinstance(item, VolumeRendering)]
        self.glow = np.zeros(view.count, np.uint8)
        if len(drawn) == 1 and not volumes:
            look = self._look(view, *drawn[0])
            painted: Floats = self._brush.over(view, drawn[0][1], look, self.scene.background, whole=whole)
            return painted
        coats = Coats(self.stages.loaded.device, view.count, len(drawn), self.scene.background, whole=whole)
        for number, (sheet, hits) in enumerate(drawn):
            self._brush.coat(view, hits, self._look(view, sheet, hits), coats, number)
        coats.compose()
        if volumes:
            self._fog(view, volumes, coats)
        return coats.colors()

    def _fog(self, view: View, volumes: Sequence[VolumeRendering], coats: Coats) -> None:
        """Draw volumes before, between and behind coats."""
        clips = [(clip.surface, clip.away) for clip in self.scene.clip]
        media = [self._medium(item) for item in volumes]
        for surface, away in clips:
            if isinstance(surface, Implicit):
                media.append(Medium.clip(self.stages.named(surface.expression, self.scene), away))
        error = min(item.error for item in volumes)
        light = self.stages.volumes.draw(view, media, coats, error, self.scene.clip)
        self.glow = light.status()
        self.gathered.update(light.counts())

    def _medium(self, item: VolumeRendering) -> Medium:
        """A volume with its colours."""
        transfer, quantity = item.transfer, self.stages.named(item.quantity, self.scene)
        if not transfer.colors:
            values = np.asarray(transfer.values, dtype=np.float64)
            self._seen.setdefault(quantity or "", (values[0], values[-1]))
            colors = self._palette(quantity, Style()).colors(values)
            transfer = replace(transfer, colors=tuple(map(tuple, colors.tolist())))
        return Medium(transfer, quantity)

    def _look(self, view: View, sheet: Sheet, hits: HitBuffer) -> Look:
        """How a hit buffer of a sheet is to look, with its lines."""
        style, scene = sheet.style, self.scene
        colors = style.color if style.color is not None else self._palette(sheet.quantity, style)
        light = (tuple(scene.lights), scene.ambient) if sheet.lit else ((), 1.0)
        mesh, contours = style.mesh_lines, style.contours
        edges = None if mesh is None else (self.stages.lines.mesh(view, hits, mesh.width), mesh.color)
        levels = None
        if contours is not None:
            quantity = self._of_contours(sheet)
            of = self.stages.resampled(hits, sheet.quantity, quantity)
            marks = self.stages.lines.contours(view, of, self.values(sheet), contours.width, quantity)
            levels = marks, contours.color
        return Look(colors, style.opacity, *light, edges, levels)

    def contour_status(self, drawn: Drawn, view: View) -> NDArray[np.uint8]:
        """(n,) what is proved of the contours in each pixel's square, of all surfaces together (see contour_proof)."""
        status = np.zeros(view.count, np.uint8)
        for sheet, hits in drawn:
            if sheet.style.contours is not None:
                quantity, lines = self._of_contours(sheet), self.stages.lines
                proof = ContourProof(self.stages.loaded, lines, view, hits, self.values(sheet), quantity)
                status = np.maximum(status, proof.status)
        return status

    def _palette(self, quantity: str | None, style: Style) -> Palette:
        """A colour map, made when it is first used."""
        key = quantity or "", style.palette or self.scene.palette, self._asked(quantity, style)
        if key not in self._palettes:
            self._palettes[key] = Palette.named(key[1], *self.range_of(quantity, key[2]))
        return self._palettes[key]

    def _asked(self, quantity: str | None, style: Style) -> object:
        """The range of a colour map as the scene has it: two values are meant for the scene's own field."""
        general = self.scene.range if quantity is None or isinstance(self.scene.range, str) else None
        return style.range or general or "seen"

    def values(self, sheet: Sheet) -> Floats:
        """(k,) ascending values of a sheet's contours."""
        contours = sheet.style.contours
        assert contours is not None
        if contours.count is None:
            return np.unique(np.asarray(contours.values, dtype=np.float64))
        quantity = self._of_contours(sheet)
        asked = self._asked(quantity, sheet.style) if quantity == sheet.quantity else "seen"
        return levels(*self.range_of(quantity, asked), contours.count)

    def legends(self, sheets: Sequence[Sheet]) -> tuple[Legend, ...]:
        """What the colours and contours of all sheets mean, each said once."""
        marks: dict[str | None, dict[tuple[float, Vector], None]] = {}
        for sheet in sheets:
            contours = sheet.style.contours
            if contours is not None:
                own = marks.setdefault(self._of_contours(sheet), {})
                own.update(dict.fromkeys((float(value), contours.color) for value in self.values(sheet)))
        found = []
        for key, palette in self._palettes.items():
            found.append(Legend(key[0] or self.scene.field, palette, tuple(marks.pop(key[0] or None, ()))))
        for item in self.scene.every_object:
            if isinstance(item, VolumeRendering) and len(set(item.transfer.colors)) > 1:
                found.append(Legend(f"{item.quantity or self.scene.field}, volume", Palette.of_transfer(item.transfer)))
        return (*found, *(Legend(name or self.scene.field, None, tuple(own)) for name, own in marks.items()))

    @property
    def reach(self) -> int:
        """Pixels around one that its lines depend on, in each direction."""
        styles = [item.style for item in self.scene.every_object if not isinstance(item, VolumeRendering)]
        lines = [line for style in styles for line in (style.contours, style.mesh_lines) if line]
        return max((int(np.ceil(0.5 * line.width)) + 2 for line in lines), default=0)

    def remarks(self, sheets: Sequence[Sheet]) -> list[str]:
        """What a user should know: objects that aren't there, contours of values that the data don't take."""
        found = list(self.stages.remarks(self.scene, self.gathered))
        for sheet in sheets:
            if id(sheet) not in self._shown:
                found.append(f"{sheet.name} shows nothing")
            contours = sheet.style.contours
            if contours is not None:
                quantity = self._of_contours(sheet)
                low, high = self._seen.get(quantity or "", (np.inf, -np.inf))
                beyond = [value for value in contours.values if not low <= value <= high]
                if beyond and (reason := self._outside(quantity, beyond)):
                    found.append(f"{sheet.name} has no contour{reason}")
        return list(dict.fromkeys(found))

    def _outside(self, quantity: str | None, values: Sequence[float]) -> str:
        """The end of a sentence where some values lie outside the certified range of a quantity, if that is known."""
        name = quantity or self.scene.field
        try:
            low, high = self.stages.bounds(name)
        except ElvisError:
            return ""
        beyond = ", ".join(f"{value:g}" for value in values if not low <= value <= high)
        return f" at {beyond}: {name} lies between {low:g} and {high:g}" if beyond else ""

    def settled(self, sheets: Sequence[Sheet]) -> bool:
        """Whether nothing depends on the range of what is seen."""
        return all(
            (sheet.style.color is not None or self._asked(sheet.quantity, sheet.style) != "seen")
            and (sheet.style.contours is None or sheet.style.contours.count is None)
            for sheet in sheets
        )
