"""Pictures of scenes with any objects, for the device ``reference``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product, zip_longest
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats
from elvis.core.base.errors import ElvisError
from elvis.reference.clipping import is_clipped, unsure
from elvis.reference.composing import Fragments, SurfaceHits, colored, is_lit, record
from elvis.reference.copied import CopiedQuantities
from elvis.reference.hits import Hits
from elvis.reference.locating import Locator
from elvis.reference.pixel_lines import contour_values, lines, next_to_unseen
from elvis.reference.quantities import Quantities, names_of
from elvis.reference.scenes.contour_lines import plane_contours
from elvis.reference.scenes.crossings import Crossings
from elvis.reference.scenes.cuts import cut_crossings
from elvis.reference.scenes.faces import face_crossings
from elvis.reference.scenes.glyphs import glyph_crossings, solid_crossings
from elvis.reference.scenes.isosurfaces import iso_crossings
from elvis.reference.scenes.ribbons import ribbon_crossings
from elvis.reference.scenes.segments import beginnings, segments_through, without_overlaps
from elvis.reference.scenes.streaks import inner, margin, padded, rest, streaks
from elvis.reference.scenes.tubes import tube_crossings
from elvis.reference.scenes.volumes import VolumeRays
from elvis.reference.sources import Source
from elvis.scene import (
    CutSurface,
    Faces,
    Glyphs,
    Implicit,
    Isosurface,
    Plane,
    Scene,
    SceneObject,
    Streamlines,
    Style,
    VolumeRendering,
)
from elvis.scene.cameras.fitting import automatic, empty_picture_remark, surrounding
from elvis.scene.cameras.view import View, space_view
from elvis.scene.flow.flow import heads_in
from elvis.scene.flow.frusta import keys_of
from elvis.scene.model.errors import SceneError
from elvis.scene.record.frame import Drawing, Frame, Legend, Status, constant_of
from elvis.scene.record.palette import Palette, automatic_range

#: ends of the colour range of each quantity
Ranges = dict[tuple[str, str], tuple[float, float]]

#: maximum number of surfaces of one object along a ray, and share of the light below which it is not followed
_DEEPEST, _FAINT = 64, 1e-3


def render(source: Source, scene: Scene) -> Frame:
    """A picture of data of either kind.

    Raises ElvisError or SceneError if nothing is visible or something can't be drawn.
    """
    start, names = perf_counter(), names_of(scene)
    copies = None if scene.copies is None else scene.copies.isometries()
    quantities = source.quantities(names) if copies is None else source.copied(names, copies)
    boxes = quantities.boxes
    tracer = Scenery(quantities, surrounding(boxes) if sum(map(len, boxes)) else np.zeros((2, 3)))

    def glance(small: Scene) -> Bools:
        view = space_view(small)
        seen = np.zeros(view.count, bool)
        for shown in small.every_object:
            seen[tracer.crossings(shown, small, view).pixel] = True
        return seen.reshape(view.height, view.width)

    scene = automatic(scene, boxes, glance)
    frame = quantities.outward(tracer.frame(scene, space_view(scene)))
    if not frame.status.any():
        raise SceneError(empty_picture_remark(scene.only_plane, surrounding(boxes)))
    frame.stats.update(
        device={"name": "reference", "label": "NumPy"},
        elements=sum(map(len, quantities.patches)),
        pixels=frame.counts(),
        seconds={"frame": perf_counter() - start},
    )
    return frame


@dataclass(eq=False)
class Scenery:
    """Elements with quantities, whose surfaces rays are sent against.

    box  (2, 3) around all elements
    """

    quantities: Quantities
    box: Floats

    @property
    def size(self) -> float:
        """Diagonal of the box."""
        return float(np.linalg.norm(self.box[1] - self.box[0]))

    def _greatest(self, view: View) -> float:
        """The largest coordinate of the elements and of the eye, in magnitude."""
        return float(np.abs([*self.box, view.camera.eye]).max())

    @cached_property
    def locator(self) -> Locator:
        """Points among the elements."""
        return Locator(self.quantities.patches)

    def crossings(self, shown: SceneObject, scene: Scene, view: View) -> Crossings:
        """All hits of rays with an object that no clip takes away."""
        match shown:
            case CutSurface(surface=Implicit(expression=expression)):
                found = self._levels(expression, (0.0,), view)
            case CutSurface(surface=surface):
                found = cut_crossings(self.locator, surface, view)
            case Isosurface(values=values, quantity=quantity):
                found = self._levels(quantity or scene.field, values, view)
            case Faces(select=select):
                found = self._faces(select, view)
            case Streamlines():
                found = self._in_copies(lambda made, sight: self._lines(made, shown, sight), view)
            case Glyphs():
                found = self._in_copies(lambda made, sight: glyph_crossings(made, shown, sight), view)
            case _:
                return Crossings.none()
        found = found.weighed(view, self._greatest(view))
        if scene.clip:
            asked = self._places(found, view), lambda name: found.values(name, self.quantities), self.size
            found.status[unsure(scene.clip, *asked) & (found.status == Status.CERTAIN)] = Status.AMBIGUOUS
            found = found.part(~is_clipped(scene.clip, *asked))
        return found.once(self.quantities.patches, self.size)

    def _lines(self, made: Quantities, shown: Streamlines, view: View) -> Crossings:
        """Streamlines, and arrow heads along them."""
        meet = tube_crossings if shown.ribbon is None else ribbon_crossings
        found = [meet(made, shown, view)]
        if shown.arrows is not None:
            found.append(solid_crossings(made, heads_in(made.flow, shown), view))
        return Crossings.concatenate(found)

    def _in_copies(self, meet: Callable[[Quantities, View], Crossings], view: View) -> Crossings:
        """Hits with solids along lines of the data, in all copies."""
        made = self.quantities
        if not isinstance(made, CopiedQuantities):
            return meet(made, view)
        found = []
        for number, isometry in enumerate(made.isometries):
            own = meet(made.uncopied, view.before(isometry))
            patch = own.patch + number * len(made.originals)
            found.append(replace(own, patch=patch, normal=isometry.directions(own.normal)))
        return Crossings.concatenate(found)

    def _levels(self, name: str, values: Sequence[float], view: View) -> Crossings:
        """Isosurfaces of a quantity."""
        self._check_solid("isosurfaces")
        made, size = self.quantities, self.size
        begun, pairs = beginnings(lambda: self.locator, view, self.box), product(values, enumerate(made.patches))
        return Crossings.concatenate(
            [iso_crossings(k, patch, made, name, value, view, size, begun) for value, (k, patch) in pairs]
        )

    def _faces(self, select: Sequence[str], view: View) -> Crossings:
        """Element faces."""
        found = []
        for number, patch in enumerate(self.quantities.patches):
            chosen = self.quantities.selected_faces(number, select)
            found.append(face_crossings(number, patch, chosen, view, self.size))
        return Crossings.concatenate(found)

    def _check_solid(self, what: str) -> None:
        if any(patch.dimension != 3 for patch in self.quantities.patches):
            raise ElvisError(f"the reference draws {what} of volumes only, found elements of two dimensions")

    def _places(self, found: Crossings, view: View) -> Floats:
        """(k, 3) world points of hits."""
        origins, directions = view.rays_of(found.pixel)
        return np.asarray(origins + found.depth[:, None] * directions)

    def frame(self, scene: Scene, view: View) -> Frame:
        """The picture."""
        surfaces = [shown for shown in scene.every_object if not isinstance(shown, VolumeRendering)]
        drawn = [(shown, self.crossings(shown, scene, view)) for shown in surfaces]
        failed, doubt = np.zeros(view.count, bool), np.zeros(view.count, bool)
        for _, found in drawn:
            failed[found.pixel[found.status == Status.FAILED]] = True
            doubt[found.pixel[found.status == Status.AMBIGUOUS]] = True
        stacks = [(shown, self._hits(found, _style(shown), scene, view)) for shown, found in drawn]
        ranges = self._ranges(stacks, scene)
        lines, line_status = self._contours(stacks, scene, view, ranges)
        seen = []
        for (shown, hits), own in zip(stacks, lines, strict=True):
            streaks = self._streaks(shown, scene, view)
            seen += self._surfaces(shown, hits, scene, view, ranges, own, streaks)
        cuts = [surface.hits.depth for surface in seen]
        fragments, unknown = self._volume_fragments(scene, view, cuts, ranges)
        ends = ranges.get((scene.field, scene.palette)) or _ends(scene)
        made = record(seen, scene, view, ends, fragments)
        status = made.status.astype(np.uint8)
        status[doubt.reshape(status.shape) & (made.element < 0)] = Status.AMBIGUOUS
        for part in fragments:
            covered = part.pixel[part.alpha > 0]
            status.ravel()[covered[status.ravel()[covered] == Status.MISS]] = Status.CERTAIN
        status[unknown.reshape(status.shape) & (status <= Status.CERTAIN)] = Status.AMBIGUOUS
        status[failed.reshape(status.shape)] = Status.FAILED
        palette = Palette.of_name(scene.palette, *ends).over_range(scene.bar)
        legend = Legend(scene.field, palette, bar=scene.bar, constant=constant_of(scene, made.field))
        legends = (legend, *keys_of(self.quantities.flow, scene, view))
        drawing = Drawing(made.depth, made.normal, made.color, legends, made.uncertainty, line_status)
        stats = {} if line_status is None else {"contours": contour_counts(line_status)}
        return Frame(scene, view, made.field, made.element, made.reference, status, stats, drawing)

    def _volume_fragments(
        self, scene: Scene, view: View, cuts: Sequence[Floats], ranges: Ranges
    ) -> tuple[list[Fragments], Bools]:
        """Fragments of volumes between the depths (n,) of surfaces.

        And pixels (n,) whose accuracy misses the request.
        """
        shown = [item for item in scene.every_object if isinstance(item, VolumeRendering)]
        if not shown:
            return [], np.zeros(view.count, bool)
        self._check_solid("volumes")
        names = [item.quantity or scene.field for item in shown]
        media = [
            (name, colored(item.transfer, scene, ranges.get((name, scene.palette))))
            for name, item in zip(names, shown, strict=True)
        ]
        begun, patches = beginnings(lambda: self.locator, view, self.box), self.quantities.patches
        every = [segments_through(number, patch, view, self.size, begun) for number, patch in enumerate(patches)]
        found, errors, unbounded = [], np.zeros(view.count), np.zeros(view.count, bool)
        for patch, own in zip(patches, without_overlaps(every, self.size), strict=True):
            rays = VolumeRays(patch, self.quantities, view, self.size, self._greatest(view))
            fragments, error = rays.fragments(own.between(cuts), scene.clip, media)
            errors += np.bincount(fragments.pixel, error, view.count)
            found.append(fragments)
            # samples prove nothing about the function between them if a quantity is not a polynomial on the element
            if any(self.quantities.expansion(name, patch) is None for name in names):
                unbounded[own.pixel] = True
        return found, unbounded | (errors > min(item.error for item in shown))

    def _hits(self, found: Crossings, style: Style, scene: Scene, view: View) -> list[Hits]:
        """The visible surfaces of one object, nearest first."""
        own = style.quantity or scene.field
        names = {own, (style.contours.quantity if style.contours else None) or own}
        return list(found.in_order(view, self.quantities, sorted(names), _most(style)))

    def _ranges(self, stacks: Sequence[tuple[SceneObject, list[Hits]]], scene: Scene) -> Ranges:
        """Ends of the range of each quantity and map: two values of the scene for its field, else the visible ones."""
        seen: dict[str, list[Floats]] = {}
        for _, stack in stacks:
            for hits in stack:
                for name, values in hits.values.items():
                    seen.setdefault(name, []).append(values)
        palettes = {scene.palette, *(_style(shown).palette or scene.palette for shown, _ in stacks)}
        ranges = {
            (name, palette): automatic_range(np.concatenate(values), palette)
            for name, values in seen.items()
            for palette in palettes
        }
        if isinstance(scene.range, tuple):
            ranges |= {(scene.field, palette): scene.range for palette in palettes}
        return ranges

    def _contours(
        self, stacks: Sequence[tuple[SceneObject, list[Hits]]], scene: Scene, view: View, ranges: Ranges
    ) -> tuple[list[Floats | None], NDArray[np.uint8] | None]:
        """For each object, the coverage of pixels (n,) by its contours, if bounds prove it.

        And the status (h, w) of all.

        Bounds exist on a plane; elsewhere, and if clips end next to a line, a pixel with contours is ambiguous.
        """
        found: list[Floats | None] = []
        status = np.zeros(view.count, np.uint8)
        for shown, stack in stacks:
            style, coverage, certain = _style(shown), None, np.zeros(view.count, bool)
            if style.contours and isinstance(shown, CutSurface) and isinstance(shown.surface, Plane):
                name = style.contours.quantity or style.quantity or scene.field
                asked = replace(style, range=style.range or ranges.get(_coloured(style, scene)))
                values = contour_values(asked, (0.0, 1.0))
                known = plane_contours(self.quantities, name, values, style.contours.width, shown.surface, view)
                coverage, certain = known or (coverage, certain)
            found.append(coverage)
            for hits in stack if style.contours else ():
                doubt = next_to_unseen(hits, style, view) if scene.clip else np.zeros(view.count, bool)
                own = np.where(certain & ~doubt, Status.CERTAIN, Status.AMBIGUOUS)
                status = np.maximum(status, np.where(hits.seen, own, Status.MISS)).astype(np.uint8)
        drawn = any(_style(shown).contours for shown, _ in stacks)
        return found, status.reshape(view.height, view.width) if drawn else None

    def _streaks(self, shown: SceneObject, scene: Scene, view: View) -> list[Floats]:
        """(n,) tones of streaks of each set of an object's hits; none if it has no streaks."""
        lic = _style(shown).lic
        if lic is None:
            return []
        around = margin(lic)
        wide = padded(view, around)
        found = self.crossings(shown, scene, wide)
        stack = found.in_order(wide, self.quantities, sorted(lic.components), _most(_style(shown)))
        least = rest(self.quantities.dataset, lic)
        return [inner(streaks(hits, lic, wide, least), view, around) for hits in stack]

    def _surfaces(
        self,
        shown: SceneObject,
        stack: list[Hits],
        scene: Scene,
        view: View,
        ranges: Ranges,
        contours: Floats | None,
        streaks: Sequence[Floats],
    ) -> list[SurfaceHits]:
        """The hits of an object with all data for its colours.

        contours, streaks  results of `_contours` and `_streaks`
        """
        style = _style(shown)
        quantity = style.quantity or scene.field
        is_line = isinstance(shown, Streamlines) and shown.width is not None
        lit = is_lit(style, not (is_line or isinstance(shown, CutSurface)))
        style = replace(style, range=style.range or ranges.get(_coloured(style, scene)))
        ends = ranges.get(_coloured(style, scene), (0.0, 1.0))
        return [
            SurfaceHits(hits, style, quantity, lit, lines(hits, style, quantity, view, ends, contours), tones)
            for hits, tones in zip_longest(stack, streaks)
            if hits is not None
        ]


def _coloured(style: Style, scene: Scene) -> tuple[str, str]:
    """The quantity that colours an object, and its colour map."""
    return style.quantity or scene.field, style.palette or scene.palette


def _ends(scene: Scene) -> tuple[float, float]:
    """The ends of the colour range if no surface shows the scene's field: the ends of a volume's transfer function."""
    transfers = [shown.transfer for shown in scene.every_object if isinstance(shown, VolumeRendering)]
    return (transfers[0].values[0], transfers[0].values[-1]) if transfers else (0.0, 1.0)


def contour_counts(status: NDArray[np.uint8]) -> dict[str, int]:
    """Pixels with contours whose coverage is proved, and the others."""
    return {word.name.lower(): int((status == word).sum()) for word in (Status.CERTAIN, Status.AMBIGUOUS)}


def _most(style: Style) -> int:
    """Surfaces of one object that a ray is followed through at most."""
    return 1 if style.opacity == 1.0 else min(_DEEPEST, int(np.ceil(np.log(_FAINT) / np.log(1 - style.opacity))))


def _style(shown: SceneObject) -> Style:
    assert not isinstance(shown, VolumeRendering)
    return shown.style
