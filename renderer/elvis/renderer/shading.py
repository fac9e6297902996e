"""From layers to colours: the colour map of each sheet, its range and its lines, and how all of them add up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from elvis.formats.arrays import Bools, Floats
from elvis.formats.errors import ElvisError
from elvis.renderer.compositing import Coat, composite, lit
from elvis.renderer.frame import Legend, Status
from elvis.renderer.layer import Layer
from elvis.renderer.lines import levels
from elvis.renderer.palette import Palette, automatic_range
from elvis.renderer.pixels import NOBODY
from elvis.renderer.scene import Scene, Style, Vector, VolumeRendering
from elvis.renderer.stages import FAINT, Sheet, Stages
from elvis.renderer.view import View

#: what tells colour maps apart: the quantity, the name of the map, the range that was asked for
Key: TypeAlias = tuple[str, str, object]
Drawn: TypeAlias = list[tuple[Sheet, Layer]]


def record_of(drawn: Drawn, view: View) -> Layer:
    """The surface that counts at each pixel: of the most opaque ones the nearest; a failed search anywhere is told."""
    if len(drawn) == 1:
        return drawn[0][1]
    best, opacity = Layer.empty(view.count), np.zeros(view.count)
    failed, doubt = np.zeros((2, view.count), bool)
    for sheet, layer in drawn:
        failed |= layer.status == Status.FAILED
        doubt |= layer.status == Status.AMBIGUOUS
        nearer = (sheet.style.opacity == opacity) & (layer.depth < best.depth)
        better = np.flatnonzero((layer.owner != NOBODY) & (nearer | (sheet.style.opacity > opacity)))
        opacity[better] = sheet.style.opacity
        for name, values in vars(best).items():
            values[better] = getattr(layer, name)[better]
    best.status[doubt & (best.owner == NOBODY)] = Status.AMBIGUOUS
    best.status[failed] = Status.FAILED
    return best


class Painter:
    """The colours of one scene."""

    def __init__(self, scene: Scene, stages: Stages) -> None:
        self.scene, self.stages = scene, stages
        self._shown: set[int] = set()
        self.glow: Bools = np.zeros(0, bool)  # pixels of the last painting in which a volume is
        self._seen: dict[str, tuple[float, float]] = {}
        self._palettes: dict[Key, Palette] = {}

    def note(self, drawn: Drawn) -> None:
        """Let the ranges of what is seen hold the values of some layers."""
        for sheet, layer in drawn:
            self._note(sheet.quantity, layer.field)
            self._shown |= {id(sheet)} if (layer.owner != NOBODY).any() else set()
            contours = sheet.style.contours
            if contours and contours.count and self._of_contours(sheet) != sheet.quantity:
                other = replace(layer)
                self._note(self._of_contours(sheet), self.stages.resampled(other, "", self._of_contours(sheet)).field)

    def _note(self, quantity: str | None, values: Floats) -> None:
        """Of all finite values the least and the greatest are kept."""
        values = values[np.isfinite(values)]
        if len(values):
            low, high = self._seen.get(quantity or "", (np.inf, -np.inf))
            self._seen[quantity or ""] = min(low, float(values.min())), max(high, float(values.max()))

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

    def paint(self, drawn: Drawn, view: View) -> Floats:
        """(n, 3) colours of all layers of a view over the background."""
        coats = [self._coat(view, sheet, layer) for sheet, layer in drawn]
        volumes = [item for item in self.scene.every_object if isinstance(item, VolumeRendering)]
        between = list(_between(coats, view.count)) if volumes else []
        self.glow = np.zeros(view.count, bool)
        fog = [self._fog(item, view, *limits) for item in volumes for limits in between]
        if not fog + coats:
            return np.tile(np.asarray(self.scene.background, dtype=np.float64), (view.count, 1))
        return composite(fog + coats, self.scene.background)

    def _fog(self, item: VolumeRendering, view: View, start: Floats, end: Floats) -> Coat:
        """What a volume adds between depths (n,), as a coat just before the surface at ``end``."""
        transfer, quantity = item.transfer, self.stages.named(item.quantity, self.scene)
        if not transfer.colors:
            values = np.asarray(transfer.values, dtype=np.float64)
            self._seen.setdefault(quantity or "", (values[0], values[-1]))
            colors = self._palette(quantity, Style()).colors(values)
            transfer = replace(transfer, colors=tuple(map(tuple, colors.tolist())))
        light = self.stages.volumes.draw(view, transfer, quantity, item.error, start, end)
        self.glow |= light.alpha > 0.0
        return Coat(np.minimum(end, np.finfo(np.float64).max), light.color, light.alpha)

    def _coat(self, view: View, sheet: Sheet, layer: Layer) -> Coat:
        style, hit = sheet.style, layer.owner != NOBODY
        colors = np.zeros((view.count, 3))
        if style.color is None:
            colors[hit] = self._palette(sheet.quantity, style).colors(layer.field[hit])
        else:
            colors[hit] = style.color
        if sheet.lit:
            colors = lit(view, layer, colors, self.scene.lights, self.scene.ambient)
        return Coat.of(layer, colors, style.opacity, list(self._lines(view, sheet, layer)))

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

    def _lines(self, view: View, sheet: Sheet, layer: Layer) -> Iterator[tuple[Floats, tuple[float, float, float]]]:
        """Coverages (n,) and colours of the lines on a layer, in the order in which they are drawn."""
        mesh, contours = sheet.style.mesh_lines, sheet.style.contours
        if mesh is not None:
            yield self.stages.lines.mesh(view, layer, mesh.width), mesh.color
        if contours is not None:
            quantity = self._of_contours(sheet)
            of = self.stages.resampled(replace(layer), sheet.quantity, quantity)
            values = self.values(sheet)
            yield self.stages.lines.contours(view, of, values, contours.width, quantity).coverage, contours.color

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
        return (*found, *(Legend(name or self.scene.field, None, tuple(own)) for name, own in marks.items()))

    @property
    def reach(self) -> int:
        """Rows around a pixel that its lines depend on."""
        styles = [item.style for item in self.scene.every_object if not isinstance(item, VolumeRendering)]
        lines = [line for style in styles for line in (style.contours, style.mesh_lines) if line]
        return max((int(np.ceil(0.5 * line.width)) + 2 for line in lines), default=0)

    def remarks(self, sheets: Sequence[Sheet]) -> list[str]:
        """What a user should know: objects that aren't there, contours of values that the data don't take."""
        found = []
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


def _between(coats: Sequence[Coat], count: int) -> Iterator[tuple[Floats, Floats]]:
    """Depths (n,) before and behind each stretch of free sight: to the nearest coat, from it to the next, and so on.

    Stretches behind what hides them have no length.
    """
    start, through = np.zeros(count), np.ones(count)
    depths = np.stack([*(coat.depth for coat in coats), np.full(count, np.inf)])
    alphas = np.stack([*(coat.alpha for coat in coats), np.ones(count)])
    order = np.argsort(depths, axis=0, kind="stable")
    for rank in range(len(depths)):
        own = order[rank : rank + 1]
        end = np.take_along_axis(depths, own, axis=0)[0]
        open_ = through > FAINT
        if not open_.any():
            return
        yield np.where(open_, start, 0.0), np.where(open_, end, 0.0)
        through = through * (1.0 - np.take_along_axis(alphas, own, axis=0)[0])
        through[np.isinf(end)] = 0.0
        start = end
