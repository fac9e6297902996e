"""Colours of hit buffers: the colour map of each draw call, its range and its lines, and their sum."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats
from elvis.core.base.errors import ElvisError
from elvis.renderer.device.drafts import traces_lines
from elvis.renderer.frame.draw_calls import DrawCall
from elvis.renderer.frame.painting import FragmentShader, Material
from elvis.renderer.frame.stages import Stages
from elvis.renderer.frame.undeformed import STYLES
from elvis.renderer.frame.visible_hits import Drawn
from elvis.renderer.passes.lines.contours.proof import ContourProof
from elvis.renderer.passes.lines.lines import Lines
from elvis.renderer.passes.volume.media import Medium
from elvis.renderer.raster.compositing import FragmentLists
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.raster.pixels import NOBODY
from elvis.scene import ColorBar, Implicit, Scene, Style, Transfer, Vector, VolumeRendering
from elvis.scene.cameras.view import View
from elvis.scene.record.frame import Legend
from elvis.scene.record.palette import Palette, automatic_range, is_constant, levels, text_color_on

#: key of a colour map: the quantity, the name of the map, the requested range, the scale of colours
Key: TypeAlias = tuple[str, str, object, ColorBar | None]


def radius_of_lines(scene: Scene, is_far: bool) -> int:
    """Pixels around one that its lines and streaks depend on, in each direction; see DeviceVolume.is_far."""
    styles = [item.style for item in scene.every_object if not isinstance(item, VolumeRendering)]
    styles += [STYLES[scene.undeformed]] if scene.undeformed else []
    lines = [line for style in styles for line in (style.contours, style.mesh_lines) if line]
    reach = max((0.5 * style.lic.length for style in styles if style.lic), default=-1.0)
    # far from the origin pixels next to visible ones are in doubt (see `passes.plane.cut`)
    least = max(4 if traces_lines(scene) else 0, int(np.ceil(reach)) + 1, int(is_far))
    return max([least, *(int(np.ceil(0.5 * line.width)) + 2 for line in lines)])


@lru_cache(maxsize=16)
def _with_colors(transfer: Transfer, colors: tuple[Vector, ...]) -> Transfer:
    """A transfer function with colours; frame after frame has the same, whose checks take their time."""
    return replace(transfer, colors=colors)


class Painter:
    """The colours of one scene."""

    def __init__(self, scene: Scene, stages: Stages) -> None:
        self.scene, self.stages = scene, stages
        self._shader = FragmentShader(stages.loaded.device)
        self._shown: set[int] = set()
        self.volume_status: NDArray[np.uint8] = np.zeros(0, np.uint8)  # status of volumes in the last painting
        self.volume_counts: Counter[str] = Counter()  # segments of rays in volumes, and faults of some
        self._seen: dict[str, tuple[float, float]] = {}
        self._palettes: dict[Key, Palette] = {}

    def note(self, drawn: Drawn, cropped: Callable[[NDArray[Any]], NDArray[Any]]) -> None:
        """Include the values of some hit buffers in the ranges of visible values.

        cropped  reduces an array of all pixels to the picture
        """
        nearest = _nearest_of_copies(drawn)
        for draw_call, hits in drawn:
            is_shown = bool((cropped(hits.owner) != NOBODY).any())
            level = np.array([draw_call.level] if is_shown else [], np.float64)
            self._shown |= {id(draw_call)} if is_shown else set()
            if draw_call.ghost is not None:
                continue
            depth = nearest.get(draw_call.name)
            field = hits.field if depth is None else np.where(hits.depth > depth, np.nan, hits.field)
            self._note(draw_call.quantity, cropped(field) if draw_call.level is None else level)
            contours = draw_call.style.contours
            if contours and contours.count and self.of_contours(draw_call) != draw_call.quantity:
                quantity = self.of_contours(draw_call)
                there = self.stages.resampled(hits, "", draw_call.on_device(quantity)).field
                self._note(quantity, cropped(there if depth is None else np.where(hits.depth > depth, np.nan, there)))

    def noted(self, draw_calls: Sequence[DrawCall]) -> tuple[dict[str, tuple[float, float]], Bools]:
        """The recorded ranges of quantities, and (n,) which draw calls are visible."""
        return dict(self._seen), np.array([id(draw_call) in self._shown for draw_call in draw_calls], bool)

    def note_of_others(
        self, draw_calls: Sequence[DrawCall], noted: Sequence[tuple[dict[str, tuple[float, float]], Bools]]
    ) -> None:
        """Note what those have who draw other rows of the picture."""
        for seen, shown in noted:
            for quantity, ends in seen.items():
                self._note(quantity, np.array(ends))
            self._shown |= {id(draw_call) for draw_call, is_shown in zip(draw_calls, shown, strict=True) if is_shown}

    def _note(self, quantity: str | None, values: Floats) -> None:
        """Record the minimum and maximum of all finite values."""
        least = np.fmin.reduce(values, axis=None, initial=np.inf)
        most = np.fmax.reduce(values, axis=None, initial=-np.inf)
        if np.isinf(least) or np.isinf(most):
            finite = values[np.isfinite(values)]
            least, most = finite.min(initial=np.inf), finite.max(initial=-np.inf)
        if least <= most:
            low, high = self._seen.get(quantity or "", (np.inf, -np.inf))
            self._seen[quantity or ""] = min(low, float(least)), max(high, float(most))

    def of_contours(self, draw_call: DrawCall) -> str | None:
        """The quantity whose contours a draw call has."""
        contours = draw_call.style.contours
        if contours is None or contours.quantity is None:
            return draw_call.quantity
        return self.stages.parts_quantity(contours.quantity, self.scene)

    def range_of(self, quantity: str | None, asked: object, palette: str | None) -> tuple[float, float]:
        """The ends of a colour map, or of the values of contours if ``palette`` is None."""
        if isinstance(asked, tuple):
            return asked
        if asked == "all":
            return automatic_range(self.stages.bounds_on_copies(quantity or self.scene.field), palette)
        return automatic_range(self._seen.get(quantity or "", ()), palette)

    def paint(
        self, drawn: Drawn, view: View, *, whole: bool = False, behind: Vector | None = None
    ) -> Floats | NDArray[np.uint8]:
        """Colours (n, 3) of all hits of a view over the background; 8-bit integers are allowed if ``whole``.

        behind  another colour instead of the background
        """
        behind = self.scene.backdrop if behind is None else behind
        volumes = [item for item in self.scene.every_object if isinstance(item, VolumeRendering)]
        self.volume_status = np.zeros(view.count, np.uint8)
        if len(drawn) == 1 and not volumes:
            material = self._material(view, *drawn[0])
            sight = drawn[0][0].view_of(view)
            painted: Floats = self._shader.over(sight, drawn[0][1], material, behind, whole=whole)
            return painted
        fragments = FragmentLists(self.stages.loaded.device, view.count, len(drawn), behind, whole=whole)
        for number, (draw_call, hits) in enumerate(drawn):
            material = self._material(view, draw_call, hits)
            placed = hits.set_back(draw_call.set_back * self.stages.loaded.extent) if draw_call.set_back else hits
            self._shader.add(draw_call.view_of(view), placed, material, fragments, number)
        fragments.compose()
        if volumes:
            self._draw_volumes(view, volumes, fragments)
        return fragments.colors()

    def _draw_volumes(self, view: View, volumes: Sequence[VolumeRendering], fragments: FragmentLists) -> None:
        """Draw volumes before, between and behind fragments."""
        clips = [(clip.surface, clip.away) for clip in self.scene.clip]
        media = [self._medium(item) for item in volumes]
        for surface, away in clips:
            if isinstance(surface, Implicit):
                media.append(Medium.clip(self.stages.parts_quantity(surface.expression, self.scene), away))
        error = min(item.error for item in volumes)
        copies = self.stages.copied.copies
        light = self.stages.volumes.draw(view, media, fragments, error, self.scene.clip, copies)
        self.volume_status = light.status()
        self.volume_counts.update(light.counts())

    def _medium(self, item: VolumeRendering) -> Medium:
        """A volume with its colours."""
        transfer, quantity = item.transfer, self.stages.parts_quantity(item.quantity, self.scene)
        if not transfer.colors:
            values = np.asarray(transfer.values, dtype=np.float64)
            self._seen.setdefault(quantity or "", (values[0], values[-1]))
            colors = self._palette(quantity, Style()).colors(values)
            transfer = _with_colors(transfer, tuple(map(tuple, colors.tolist())))
        return Medium(transfer, quantity)

    def _material(self, view: View, draw_call: DrawCall, hits: HitBuffer) -> Material:
        """How a hit buffer of a draw_call is to material, with its lines."""
        style, scene = draw_call.style, self.scene
        colors = style.color if style.color is not None else self._palette(draw_call.quantity, style)
        view = draw_call.view_of(view)
        lights = scene.lights if draw_call.copy is None else draw_call.copy.lights(scene.lights)
        light = (tuple(lights), scene.ambient_on(style)) if draw_call.lit else ((), 1.0)
        mesh, contours, lic = style.mesh_lines, style.contours, style.lic
        streaks = None if lic is None else (self.stages.streaks(view, hits, lic, scene), lic.contrast)
        if traces_lines(scene):
            return Material(colors, draw_call.opacity, *light, streaks=streaks)
        edges = None if mesh is None else (self.lines_of(draw_call).mesh(view, hits, mesh.width), mesh.color)
        levels = None
        if contours is not None:
            quantity = draw_call.on_device(self.of_contours(draw_call))
            of = self.stages.resampled(hits, draw_call.on_device(draw_call.quantity), quantity)
            marks = self.stages.lines.contours(view, of, self.values(draw_call), contours.width, quantity)
            levels = marks, contours.color
        return Material(colors, draw_call.opacity, *light, edges, levels, streaks)

    def lines_of(self, draw_call: DrawCall) -> Lines:
        """Lines on the volume that a surface belongs to."""
        return (draw_call.ghost or self.stages).lines

    def still(self, drawn: Drawn, view: View) -> Bools:
        """(n,) pixels in which a surface that has streaks elsewhere has none."""
        found = np.zeros(view.count, bool)
        for draw_call, hits in drawn:
            if draw_call.style.lic is not None:
                found |= self.stages.still(draw_call.view_of(view), hits, draw_call.style.lic, self.scene)
        return found

    def contour_status(self, drawn: Drawn, view: View) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        """Proved status (n,) of all contours in each pixel's square, and (n,) of their coverage."""
        status, coverage = np.zeros((2, view.count), np.uint8)
        for draw_call, hits in drawn:
            contours = draw_call.style.contours
            if contours is not None:
                quantity, lines = draw_call.on_device(self.of_contours(draw_call)), self.stages.lines
                sight, values = draw_call.view_of(view), self.values(draw_call)
                proof = ContourProof(self.stages.loaded, lines, sight, hits, values, quantity)
                status = np.maximum(status, proof.status)
                coverage = np.maximum(coverage, proof.coverage(contours.width))
        return status, coverage

    def _palette(self, quantity: str | None, style: Style) -> Palette:
        """A colour map, made when it is first used."""
        key = (
            quantity or "",
            style.palette or self.scene.palette,
            self._scene_range(quantity, style),
            self._bar(quantity, style),
        )
        if key not in self._palettes:
            self._palettes[key] = Palette.of_name(key[1], *self.range_of(quantity, key[2], key[1])).over_range(key[3])
        return self._palettes[key]

    def _bar(self, quantity: str | None, style: Style) -> ColorBar | None:
        """Settings of a colour map's bar; the scene's bar belongs to the scene's own field."""
        return style.bar or (self.scene.bar if quantity is None else None)

    def _scene_range(self, quantity: str | None, style: Style) -> object:
        """The range of a colour map as the scene has it: two values are meant for the scene's own field."""
        general = self.scene.range if quantity is None or isinstance(self.scene.range, str) else None
        return style.range or general or "visible"

    def values(self, draw_call: DrawCall) -> Floats:
        """(k,) ascending values of a draw call's contours."""
        contours = draw_call.style.contours
        assert contours is not None
        if contours.count is None:
            return np.unique(np.asarray(contours.values, dtype=np.float64))
        quantity = self.of_contours(draw_call)
        is_coloured = quantity == draw_call.quantity
        asked = self._scene_range(quantity, draw_call.style) if is_coloured else "visible"
        palette = (draw_call.style.palette or self.scene.palette) if is_coloured else None
        return levels(*self.range_of(quantity, asked, palette), contours.count, is_round=contours.round)

    def legends(self, draw_calls: Sequence[DrawCall]) -> tuple[Legend, ...]:
        """Legends of the colours and contours of all draw calls, each once."""
        marks: dict[str | None, dict[tuple[float, Vector], None]] = {}
        for draw_call in draw_calls:
            contours = draw_call.style.contours
            if contours is not None:
                own = marks.setdefault(self.of_contours(draw_call), {})
                own.update(dict.fromkeys((float(value), contours.color) for value in self.values(draw_call)))
        found = []
        for key, palette in self._palettes.items():
            title, own_marks = key[0] or self.scene.field, tuple(marks.pop(key[0] or None, ()))
            found.append(Legend(title, palette, own_marks, key[3], self._constant(key)))
        for item in self.scene.every_object:
            if isinstance(item, VolumeRendering) and len(set(item.transfer.colors)) > 1:
                found.append(Legend(f"{item.quantity or self.scene.field}, volume", Palette.of_transfer(item.transfer)))
        return (*found, *(Legend(name or self.scene.field, None, tuple(own)) for name, own in marks.items()))

    def _constant(self, key: Key) -> float | None:
        """The only visible value of a colour map's quantity, if its range is automatic."""
        low, high = self._seen.get(key[0], (-np.inf, np.inf))
        return low if key[2] == "visible" and is_constant(low, high) else None

    @property
    def text_color(self) -> Vector:
        """A colour that can be read on the background."""
        return text_color_on(self.scene.backdrop)

    @property
    def radius(self) -> int:
        """See `radius_of_lines`."""
        return radius_of_lines(self.scene, self.stages.loaded.is_far)

    def remarks(self, draw_calls: Sequence[DrawCall]) -> list[str]:
        """Remarks for the user: invisible objects, contours at values outside the data."""
        found = list(self.stages.remarks(self.scene, self.volume_counts))
        shown = {draw_call.name for draw_call in draw_calls if id(draw_call) in self._shown}
        for draw_call in draw_calls:
            if draw_call.name not in shown:
                found.append(f"{draw_call.name} is not visible")
            contours = draw_call.style.contours
            if contours is not None:
                quantity = self.of_contours(draw_call)
                low, high = self._seen.get(quantity or "", (np.inf, -np.inf))
                beyond = [value for value in contours.values if not low <= value <= high]
                if beyond and (reason := self._outside(quantity, beyond)):
                    found.append(f"{draw_call.name} has no contour{reason}")
        return list(dict.fromkeys(found))

    def _outside(self, quantity: str | None, values: Sequence[float]) -> str:
        """The end of a sentence on values outside the certified range of a quantity, if that is known."""
        name = quantity or self.scene.field
        try:
            low, high = self.stages.bounds_on_copies(name)
        except ElvisError:
            return ""
        beyond = ", ".join(f"{value:g}" for value in values if not low <= value <= high)
        return f" at {beyond}: {name} lies between {low:g} and {high:g}" if beyond else ""

    def is_complete(self, draw_calls: Sequence[DrawCall]) -> bool:
        """Whether no colour depends on the range of the visible values."""
        volumes = [item for item in self.scene.every_object if isinstance(item, VolumeRendering)]
        if draw_calls and not all(item.transfer.colors for item in volumes):
            return False
        return all(
            (draw_call.style.color is not None or self._scene_range(draw_call.quantity, draw_call.style) != "visible")
            and (draw_call.style.contours is None or draw_call.style.contours.count is None)
            for draw_call in draw_calls
        )


def _nearest_of_copies(drawn: Drawn) -> dict[str, Floats]:
    """Depths (n,) of the nearest hits on opaque surfaces of which there are copies, by name.

    As on a surface of elements that are no copies, values that another part of it hides are not visible.
    """
    found: dict[str, Floats] = {}
    for draw_call, hits in drawn:
        if draw_call.copy is not None and draw_call.opacity == 1.0:
            found[draw_call.name] = np.minimum(found.get(draw_call.name, np.inf), hits.depth)
    return found
