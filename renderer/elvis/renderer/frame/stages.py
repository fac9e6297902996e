"""Which stage draws which object of a scene: objects become draw_calls, and draw_calls hit buffers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, cached_property, partial

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.bounds.bounding import is_between_values, quantity_range
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.geometry import GeometryBlock, geometry
from elvis.core.quantities import Expression
from elvis.core.shapes import Shape
from elvis.core.streamlines.course import REST
from elvis.core.validity.validity import ValidityStatus, statuses
from elvis.plugins.faces import faces_of
from elvis.plugins.runtime.volume import Volume
from elvis.renderer.device.memory import Buffer
from elvis.renderer.flow.stage import FlowStage, Made
from elvis.renderer.frame.copied import CopiedData, is_in_view, level_names, surrounding_copies
from elvis.renderer.frame.draw_calls import DrawCall
from elvis.renderer.frame.other_data import OtherData
from elvis.renderer.frame.undeformed import with_ghosts
from elvis.renderer.passes.faces.faces import FaceDrawer, FacesInView
from elvis.renderer.passes.isosurface.distance import DistanceDrawer
from elvis.renderer.passes.isosurface.isosurface import IsosurfaceDrawer
from elvis.renderer.passes.lic.convolver import Convolver
from elvis.renderer.passes.lines.lines import Lines
from elvis.renderer.passes.plane.cut import Cutter
from elvis.renderer.passes.solids.hits import outside
from elvis.renderer.passes.solids.solids import SolidDrawer, values_at_hits
from elvis.renderer.passes.volume.rendering import VolumeRenderer
from elvis.renderer.raster.compositing import FAINT
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.renderer.volume.probing import Finder
from elvis.scene import (
    Clip,
    CutSurface,
    Faces,
    Glyphs,
    Implicit,
    Isosurface,
    Lic,
    Plane,
    Scene,
    Streamlines,
    VolumeRendering,
)
from elvis.scene.cameras.fitting import surrounding
from elvis.scene.cameras.view import PlaneView, View
from elvis.scene.model.errors import AbsentError, SceneError
from elvis.scene.model.surfaces import Placed, placed
from elvis.scene.record.frame import Status

#: part of coordinates and depths within which two hits are one
SAME = 2e-11
#: part of the greatest coordinate within which a point is on the surface of a clip, and stays
CLOSE = 1e-11


def is_straight(block: GeometryBlock) -> bool:
    """Whether elements are straight tetrahedra."""
    return block.expansion.shape is Shape.TETRAHEDRON and max(block.expansion.modes) == 2


class Stages:
    """The stages over a loaded volume, each made when it is first needed.

    made_of  source of the volume, if known
    dataset  the same; None if a runtime plugin has made it
    others   requests of quantities to data on other meshes
    ghosts   stages over geometries that are drawn next to this one, by name
    copied   the copies of the data that pictures show
    """

    def __init__(self, loaded: DeviceVolume, volume: Volume, made_of: Made, others: OtherData | None = None) -> None:
        self.loaded, self.volume, self.others = loaded, volume, others or OtherData()
        self._ranges: dict[str, tuple[float, float]] = {}
        self._left_out: dict[str | None, Ints] = {}
        self.made_of = made_of
        self.dataset = made_of if isinstance(made_of, Dataset) else None
        self.ghosts: Mapping[str, Stages] = {}
        self.copied = CopiedData()
        self.cutter, self.lines = Cutter(loaded), Lines(loaded)

    @property
    def elements(self) -> int:
        """How many there are, also where only a part of the data is here."""
        excerpt = self.dataset.mesh.excerpt if self.dataset else None
        return self.dataset.mesh.count if self.dataset and excerpt else len(self.loaded.ids) - 1

    @cached_property
    def finder(self) -> Finder:
        """Points in the volume."""
        return Finder(self.loaded)

    @cached_property
    def solids(self) -> SolidDrawer:
        """Cuts by surfaces that aren't plane."""
        return SolidDrawer(self.loaded, self.finder)

    @cached_property
    def flow(self) -> FlowStage:
        """Streamlines and glyphs."""
        return FlowStage(self.loaded, self.made_of)

    @cached_property
    def _convolver(self) -> Convolver:
        """Line integral convolution."""
        return Convolver(self.loaded)

    def streaks(self, view: View, hits: HitBuffer, lic: Lic, scene: Scene) -> Buffer:
        """(n,) tones of streaks on hits, which keep them."""
        names = lic.components
        own = [self.parts_quantity(name, scene) for name in names]
        return self._convolver.tones(view, hits, lic, own, REST * self._greatest(names))

    def still(self, view: View, hits: HitBuffer, lic: Lic, scene: Scene) -> Bools:
        """(n,) hits without streaks, as nothing moves along the surface."""
        self.streaks(view, hits, lic, scene)
        return self._convolver.still(hits)

    def _greatest(self, names: Sequence[str]) -> float:
        """Upper bound of all components of a vector; zero if unknown."""
        try:
            return float(np.abs([self.bounds(name) for name in names]).max())
        except ElvisError:
            return 0.0

    @cached_property
    def distances(self) -> DistanceDrawer:
        """Isosurfaces of distances."""
        return DistanceDrawer(self.loaded, self.solids)

    @cached_property
    def _faces_when_needed(self) -> Callable[[], FaceDrawer]:
        """Makes the drawer of faces when it is first asked for; it doesn't refer to the stages, which refer to it."""
        return cache(partial(_drawer_of_faces, self.loaded, self.dataset, self.volume))

    @property
    def faces(self) -> FaceDrawer:
        """Element faces."""
        return self._faces_when_needed()

    @cached_property
    def isosurfaces(self) -> IsosurfaceDrawer:
        """Isosurfaces."""
        return IsosurfaceDrawer(self.loaded)

    @cached_property
    def volumes(self) -> VolumeRenderer:
        """Volumes."""
        return VolumeRenderer(self.loaded, self._faces_when_needed)

    @cached_property
    def inverted_elements(self) -> int:
        """Elements whose Jacobian is certainly not positive all over: the straight tetrahedra, and all of a dataset."""
        return self.loaded.once("inverted", self._count_inverted)

    def _count_inverted(self) -> int:
        corners = [self.volumes.traversal.corners(n) for n, part in enumerate(self.loaded.parts) if part.affine]
        sides = [some[:, 1:] - some[:, :1] for some in corners]
        count = sum(int(np.count_nonzero(np.linalg.det(some) <= 0.0)) for some in sides)
        if self.dataset is not None and not all(part.affine for part in self.loaded.parts):
            curved = [block for block in geometry(self.dataset) if not is_straight(block)]
            found = [statuses(block, self.dataset.mesh.space) for block in curved]
            count += sum(int(np.count_nonzero(own == ValidityStatus.NOT_POSITIVE)) for own in found)
        return count

    def remarks(self, scene: Scene, counts: Mapping[str, int]) -> Iterator[str]:
        """Remarks for the user on volumes, on elements along rays in them, and on skipped parts of isosurfaces."""
        volumes = [item for item in scene.every_object if isinstance(item, VolumeRendering)]
        if volumes and self.inverted_elements:
            yield f"inverted elements, wholly or in part, which are still drawn: {self.inverted_elements}"
        for name in dict.fromkeys(item.quantity or scene.field for item in volumes):
            if left := len(self._undefined(self.parts_quantity(name, scene))):
                yield f"elements excluded from a volume because their {name} is not a number: {left}"
        levels = [item for item in scene.every_object if isinstance(item, Isosurface)]
        for name in dict.fromkeys(item.quantity or scene.field for item in levels):
            if left := len(self._undefined(self.parts_quantity(name, scene))):
                yield f"elements excluded from an isosurface because their {name} is not a number: {left}"
        for name, value in dict.fromkeys((item.quantity or scene.field, v) for item in levels for v in item.values):
            if flat := self._flat(self.parts_quantity(name, scene), value):
                yield f"elements excluded from an isosurface because their {name} is {value:g} everywhere: {flat}"
        yield from self.flow.remarks(scene)
        if counts["lost"]:
            yield f"points along rays in a volume that could not be located: {counts['lost']}"

    def _flat(self, own: str | None, value: float) -> int:
        """Elements whose quantity is a value all over them, to rounding."""
        traversal = self.volumes.traversal
        return sum(int(traversal.flat(n, own, value).sum()) for n in range(len(self.loaded.parts)))

    def _undefined(self, own: str | None) -> Ints:
        """Ids of the elements on which a quantity is not a number; found once."""
        if own not in self._left_out:
            lows = [self.loaded.bounds(number, own)[0] for number in range(len(self.loaded.parts))]
            ids = [part.element_ids[np.isnan(low)] for part, low in zip(self.loaded.parts, lows, strict=True)]
            self._left_out[own] = np.concatenate(ids)
        return self._left_out[own]

    def bounds(self, name: str) -> tuple[float, float]:
        """Certified least and greatest value of a quantity over the whole volume; SceneError where none are known."""
        if name not in self._ranges:
            data = self.dataset
            known = quantity_range(data, self._expression(data, name)) if data else None
            self._ranges[name] = (known.lower, known.upper) if known else self._of_parts(name)
        if not np.isfinite(self._ranges[name]).all():
            raise SceneError(f"no bounds of {name!r} over all data are known: use two values for the range, or visible")
        return self._ranges[name]

    def _expression(self, data: Dataset, name: str) -> Expression:
        """A quantity of the data, or one that only copies show."""
        own = {each.text: each for each in self.copied.expressions}
        return own[name] if name in own else Expression.of(data, name)

    def bounds_on_copies(self, name: str) -> tuple[float, float]:
        """Certified least and greatest value of a quantity of the scene over all copies; raises as `bounds`."""
        names = {copy.on_device(name) or name for copy in self.copied.copies} or {name}
        ends = np.array([self.bounds(own) for own in names])
        return float(ends[:, 0].min()), float(ends[:, 1].max())

    def _of_parts(self, name: str) -> tuple[float, float]:
        """The range that the parts' own bounds give; not finite where one has none."""
        parts = enumerate(self.loaded.parts)
        every = np.concatenate([self.loaded.ends(n, name if name in part.quantities else None) for n, part in parts])
        every = every[~np.isnan(every).any(axis=1)]
        return float(every[:, 0].min(initial=np.inf)), float(every[:, 1].max(initial=-np.inf))

    @cached_property
    def box(self) -> Floats:
        """(2, 3) corners of the box around the boxes of all elements."""
        return surrounding([part.boxes for part in self.loaded.parts])

    def domain(self) -> Floats:
        """(2, 3) corners of the box around the domain and its copies: certified bounds, where these are known."""
        box = self.box.copy()
        for axis, name in enumerate("xyz"[: self.loaded.dimension]):
            with suppress(ElvisError):
                box[:, axis] = self.bounds(name)
        return surrounding_copies(box, self.copied.copies)

    def parts_quantity(self, name: str | None, scene: Scene) -> str | None:
        """The parts' quantity that a name in a scene means; None is the parts' own field, the scene's."""
        return None if name in (None, scene.field) else name

    def draw_calls(self, scene: Scene) -> list[DrawCall]:
        """All surfaces of a scene, in its order; SceneError for unsupported uses of data on other meshes."""
        self.others.check(scene)
        draw = partial(self._draw_calls, first=-1 if scene.plane else 0)
        return self.copied.draw_calls(scene, draw) if self.copied.copies else draw(scene)

    def _draw_calls(self, scene: Scene, leaves_absent: bool = False, *, first: int) -> list[DrawCall]:
        """All surfaces of the data.

        leaves_absent  whether isosurfaces at values that the data don't have are left out
        first          number of the first object, -1 for the shortcut ``plane``
        """
        found: list[DrawCall] = []
        for number, item in enumerate(scene.every_object, start=first):
            if isinstance(item, VolumeRendering):
                continue
            name = "plane" if number < 0 else f"objects[{number}]"
            own = self.parts_quantity(item.style.quantity, scene)
            match item:
                case CutSurface():
                    found.append(self._cut_call(name, item, own))
                case Faces():
                    found.append(self._faces(name, item, own))
                case Isosurface():
                    found += self._levels(level_names(number, item), item, scene, leaves_absent)
                case Streamlines():
                    found += [replace(call, is_inside=False) for call in self.flow.lines(name, item, own)]
                case Glyphs():
                    found.append(replace(self.flow.glyphs(name, item, own), is_inside=False))
        return with_ghosts(found, self.ghosts, scene)

    def _cut_call(self, name: str, item: CutSurface, own: str | None) -> DrawCall:
        """A cut by a surface."""
        once = isinstance(item.surface, Plane)
        draw = partial(self.cut, placed(item.surface), own)
        return DrawCall(name, item.style, own, draw, bool(item.style.lit), once, item.surface)

    def _levels(self, names: Sequence[str], item: Isosurface, scene: Scene, leaves_absent: bool) -> Iterator[DrawCall]:
        """The values of an isosurface."""
        for name, value in zip(names, item.values, strict=True):
            try:
                yield self._level(name, item, value, scene)
            except AbsentError:
                if not leaves_absent:
                    raise

    def _faces(self, name: str, item: Faces, own: str | None) -> DrawCall:
        """Element faces."""

        def draw(view: View, beyond: Floats | None) -> HitBuffer:
            hits = self.faces.draw(view, item.select, beyond, None if is_compound else own)
            return self.resampled(hits, None, own, view) if is_compound else hits

        is_compound = self.others.text_of(own) is not None
        return DrawCall(name, item.style, own, draw, item.style.lit is not False)

    def _level(self, name: str, item: Isosurface, value: float, scene: Scene) -> DrawCall:
        """One value of an isosurface; the quantity of its style, by default the scene's field, colours it."""
        of = self.parts_quantity(item.quantity, scene)
        asked = item.quantity or scene.field
        # bounds of a distance take longer than its picture, so only an empty one asks for them
        is_distance = self.distances.knows(of)
        if not is_distance:
            self._in_range(asked, of, value)
        own = self.parts_quantity(item.style.quantity, scene)

        def draw(view: View, beyond: Floats | None) -> HitBuffer:
            hits = self._at_level(view, of, value, beyond)
            if is_distance and beyond is None and not np.any(hits.owner != NOBODY):
                self._in_range(asked, of, value)
            return self.resampled(hits, of, own, view)

        level = value if own == of else None
        return DrawCall(name, item.style, own, draw, item.style.lit is not False, level=level)

    def _at_level(self, view: View, quantity: str | None, value: float, beyond: Floats | None) -> HitBuffer:
        """The isosurface of a quantity."""
        if self.distances.knows(quantity):
            return self.distances.draw(view, quantity, value, beyond)
        hits, left = self.isosurfaces.draw(view, quantity, value, beyond), self._undefined(quantity)
        return self._mark(hits, view, left, beyond) if len(left) and self.dataset is not None else hits

    def _mark(self, hits: HitBuffer, view: View, left: Ints, beyond: Floats | None) -> HitBuffer:
        """The hit buffer, ambiguous where skipped elements may hide it."""
        faces = replace(self.faces.faces, regions={"left": left})
        before = FaceDrawer(self.loaded, faces).draw(view, ("region:left",), beyond).depth < hits.depth
        status = np.where(before, np.uint8(Status.AMBIGUOUS), hits.status)
        return replace(hits, status=status)

    def _in_range(self, asked: str, own: str | None, value: float) -> None:
        """AbsentError where a quantity, by its certified bounds, has the value nowhere."""
        data = self.dataset
        if asked not in self._ranges and data and is_between_values(data, self._expression(data, asked), value):
            return
        try:
            low, high = self.bounds(asked)
        except SceneError:
            return
        if low <= value <= high:
            return
        # the bounds hold up to rounding: values within rounding of them are drawn, and proved pixel by pixel
        if not low - self._rounding(own, low) <= value <= high + self._rounding(own, high):
            raise AbsentError(f"values of an isosurface: {asked!r} lies between {low:g} and {high:g}, found {value:g}")

    def _rounding(self, own: str | None, value: float) -> float:
        """How far the certified bounds of a quantity may be from the true ones, near a value."""
        traversal = self.volumes.traversal
        every = [traversal.rounding(n, own, value).max(initial=0.0) for n in range(len(self.loaded.parts))]
        return float(max(every, default=0.0))

    def cut(self, surface: Placed, quantity: str | None, view: View, beyond: Floats | None) -> HitBuffer:
        """The intersection of a surface with the volume."""
        if isinstance(surface, Implicit):
            hits = self._at_level(view, surface.expression, 0.0, beyond)
            return self.resampled(hits, surface.expression, quantity, view)
        if not isinstance(surface, Plane):
            return self.resampled(self.solids.draw(view, surface, beyond), None, quantity, view)
        sight = PlaneView.on(view, surface)
        if sight.edge_on:
            return HitBuffer.empty(view.count)
        hits = self.resampled(self.cutter.draw(sight), None, quantity, view, surface)
        return hits if beyond is None else hits.without(~(hits.depth > beyond))

    def plain_cut(self, scene: Scene, view: PlaneView, references: bool) -> HitBuffer:
        """The picture of the only plane of a scene, with the scene's field."""
        self.others.check(scene)
        found = self.cutter.draw(view, references=references or self.others.needs_references)
        return self.resampled(found, None, self.others.field, view, view.plane)

    def resampled(
        self,
        hits: HitBuffer,
        known: str | None,
        wanted: str | None,
        view: View | None = None,
        plane: Plane | None = None,
    ) -> HitBuffer:
        """The hit buffer with another quantity as its field.

        view, plane  of the hits, for quantities that name data on other meshes; the plane that all lie on, where one is
        """
        text = self.others.text_of(wanted)
        if text is not None and view is not None:
            own = self._valued(hits, known, None)
            return self.others.shown(self.loaded, own, text, view, plane)
        return self._valued(hits, known, wanted)

    def _valued(self, hits: HitBuffer, known: str | None, wanted: str | None) -> HitBuffer:
        """The hit buffer with another quantity of the volume as its field."""
        return hits if known == wanted else hits.showing(values_at_hits(self.loaded, hits, wanted))

    def hit_buffers(self, draw_call: DrawCall, view: View, clips: Sequence[Clip]) -> Iterator[HitBuffer]:
        """Visible hits of a draw call, near to far: hits that no clip removes, while the surface is translucent."""
        if draw_call.ghost is not None and draw_call.ghost is not self:
            yield from draw_call.ghost.hit_buffers(draw_call, view, clips)
            return
        if draw_call.copy is not None:
            view, clips = draw_call.copy.view(view), draw_call.copy.clips(clips)
            if draw_call.is_inside and not is_in_view(view, self.box):
                return
        others = [clip for clip in clips if clip.surface != draw_call.surface]
        opacity = draw_call.opacity
        beyond, through = None, 1.0
        while through > FAINT:
            hits = draw_call.draw(view, beyond)
            shown, gone = self._clipped(hits, view, others)
            yield shown
            through *= 1.0 - opacity if not gone.any() else 1.0
            further = hits.owner != NOBODY if opacity < 1.0 else gone
            if draw_call.once or not further.any():
                return
            beyond = np.where(further, hits.depth + SAME * (self.loaded.extent + np.abs(hits.depth)), np.inf)

    def _clipped(self, hits: HitBuffer, view: View, clips: Sequence[Clip]) -> tuple[HitBuffer, Bools]:
        """Hits that clips leave, and (n,) the hits that they remove; without clips nothing is read."""
        if not clips:
            return hits, np.zeros(view.count, bool)
        gone, unsure, clear = self.hidden_by(hits, view, clips)
        return hits.clip(gone, unsure, clear) if np.isfinite(clear).any() else hits, gone

    def hidden_by(self, hits: HitBuffer, view: View, clips: Sequence[Clip]) -> tuple[Bools, Bools, Floats]:
        """Hits (n,) that clips hide, uncertain ones among them (n,), and the distance (n,) to hidden parts.

        The distance is zero if unknown and infinite without clips.
        """
        gone, unsure = np.zeros((2, view.count), bool)
        clear = np.full(view.count, np.inf)
        hit = np.flatnonzero(hits.owner != NOBODY)
        if not clips or not len(hit):
            return gone, unsure, clear
        origins, directions = view.rays_of(hit)
        points = origins + hits.depth[hit, None] * directions
        room = CLOSE * self.loaded.extent
        around = np.zeros(len(hit)) if hits.uncertainty is None else hits.uncertainty[hit]
        for clip in clips:
            surface = placed(clip.surface)
            if isinstance(surface, Implicit):
                distance, close = self._height(hits, surface.expression, hit)
                near = np.abs(distance) <= 2.0 * close
            else:
                # points on the surface remain, and so do points within rounding of it
                distance, close = outside(surface, points), np.full(len(hit), room)
                away = -distance if clip.away == "inside" else distance
                near = (away > 0.01 * room) & (away <= 2.0 * room) | (np.abs(distance) <= around) & (around > room)
            beyond = -distance if clip.away == "inside" else distance
            gone[hit] |= beyond > close
            unsure[hit] |= near
            # only distances of planes are true distances
            room_left = np.maximum(-beyond, 0.0) if isinstance(surface, Plane) else 0.0
            clear[hit] = np.minimum(clear[hit], room_left)
        return gone, unsure, clear

    def _height(self, hits: HitBuffer, expression: str, hit: Ints) -> tuple[Floats, Floats]:
        """Values (k,) of an expression at hits (k,), and their uncertainty.

        This includes rounding, and changes within the distance in which surfaces are treated as one.
        """
        values, close = values_at_hits(self.loaded, hits, expression)[hit], np.zeros(len(hit))
        part = np.searchsorted(self.loaded.first, hits.owner[hit], side="right") - 1
        traversal, room = self.volumes.traversal, 2.0 * CLOSE * self.loaded.extent
        for number in np.unique(part):
            here, own = part == number, self.loaded.parts[number]
            element = hits.owner[hit[here]] - self.loaded.first[number]
            if traversal.degree(number, expression) == 0:
                low, high = (np.abs(end[element]) for end in self.loaded.bounds(number, expression))
                greatest = np.where(np.isfinite(low + high), np.maximum(low, high), np.abs(values[here]))
                close[here] = CLOSE * np.nan_to_num(greatest)
                continue
            boxes = own.boxes[element].astype(np.float64)
            steepest = traversal.steepest(number, expression, 0.0)[element] / (boxes[:, 3:] - boxes[:, :3]).min(axis=1)
            close[here] = 4.0 * traversal.rounding(number, expression, 0.0)[element] + room * steepest
        return values, close


def _drawer_of_faces(loaded: DeviceVolume, dataset: Dataset | None, volume: Volume) -> FaceDrawer:
    faces = loaded.once("faces", lambda: faces_of(dataset, volume))
    return FaceDrawer(loaded, faces, loaded.once("faces in view", FacesInView))
