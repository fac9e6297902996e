"""Relevant elements of a part of the data for a picture: drawing only these gives the same picture as drawing all.

Each stage processes elements that are not proved to be irrelevant: elements whose boxes a surface meets, whose
certified bounds contain a value, or which have chosen faces.  For global dependencies of a picture, such as its view or
ranges over all data, the elements that decide them count.  Additional elements do no harm.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, joined_ints, rows_of
from elvis.core.base.errors import ElvisError
from elvis.core.bounds.bounding import deciding_elements
from elvis.core.data.dataset import Dataset
from elvis.core.distances.boundaries import ALL
from elvis.core.mapping import geometry
from elvis.core.mapping.boxes import Boxes, element_boxes
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch, patches
from elvis.core.quantities import Expression
from elvis.core.summary.picturing import Kind
from elvis.core.validity.validity import ValidityStatus, validity
from elvis.plugins.faces import faces_of
from elvis.plugins.native.buffers import by_affinity, placed
from elvis.plugins.runtime.serving import volume_of
from elvis.plugins.runtime.volume import Part, Quantity, Volume
from elvis.renderer.parts.near_boxes import meets, near_boxes, without_maps
from elvis.renderer.volume.traversal import ROUNDING
from elvis.scene import (
    CutSurface,
    Faces,
    Glyphs,
    Implicit,
    Isosurface,
    Scene,
    Streamlines,
    VolumeRendering,
)
from elvis.scene.cameras.fitting import faced_plane, is_given
from elvis.scene.cameras.view import named_camera
from elvis.scene.model.quantities import quantities

#: number of elements that are processed together if there are many
_AT_ONCE = 1 << 16
#: times the rounding of a Jacobian up to which it may be none at all
_FLAT = 1e3


@dataclass(frozen=True, eq=False)
class Looked:
    """Facts about n elements that determine which of them are visible.

    ids     (n,)
    boxes   (n, 6)
    ends    by quantity (n, 2): an element shows no value outside; infinite if unknown
    chosen  by word (n,) which have faces that it chooses
    """

    ids: Ints
    boxes: Boxes
    ends: Mapping[str, Floats]
    chosen: Mapping[str, Bools]


class Relevance:
    """A part of the data, and the scene that is drawn of all; its objects and velocities are named."""

    def __init__(self, dataset: Dataset, scene: Scene) -> None:
        self.dataset, self.scene = dataset, scene
        self.texts = quantities(scene)

    @property
    def is_local(self) -> bool:
        """Whether less than all may do: no line goes through all elements, no expression looks beyond one, but for what
        parts borrow."""
        scene = self.scene
        goes_through = any(isinstance(item, Streamlines | Glyphs) for item in scene.every_object)
        expressions = [Expression.of(self.dataset, text) for text in self.texts]
        beyond = not all(each.is_borrowed for each in expressions)
        is_line = Kind.of(self.dataset) is Kind.LINE
        # elements of others that aren't in the dataset may be anywhere
        apart = self.dataset.others.keys() != self.dataset.shared.keys()
        return not (goes_through or beyond or is_line or apart)

    @property
    def borrows(self) -> bool:
        """Whether an expression looks beyond an element."""
        return not all(Expression.of(self.dataset, text).is_local for text in self.texts)

    @property
    def is_by_boxes(self) -> bool:
        """Whether boxes and sides of elements decide everything: only faces and cuts by given surfaces are drawn.

        Boxes don't give ranges over all data, and the sides of extruded elements are not sides of the mesh.
        """
        if self._names_of_ends or not self.scene.every_object:
            return False
        for item in self.scene.every_object:
            is_cut = isinstance(item, CutSurface) and not isinstance(item.surface, Implicit)
            if not (is_cut or isinstance(item, Faces)):
                return False
        return not any(patch.periods for patch in self._patches)

    @cached_property
    def _volume(self) -> Volume:
        if self.is_by_boxes:
            boxes_of = element_boxes if self._has_derivatives else self._near_boxes
            return placed(self.dataset, self._patches, Expression.of(self.dataset, self.texts[0]), boxes_of)
        return volume_of(self.dataset, self.texts)

    def ids(self) -> Ints:
        """(n,) ids of the elements that the picture depends on."""
        return np.union1d(self.deciding(), self.shown()[0])

    def shown(self) -> tuple[Ints, Boxes]:
        """Ids (n,) of the elements that may be visible, and their boxes (n, 6).

        A pixel depends only on elements whose boxes are near it in the picture, and on deciding ones.
        """
        masks = [np.zeros(len(part), bool) for part in self._volume.parts]
        for mask, part in zip(masks, self._volume.parts, strict=True):
            for item in self.scene.every_object:
                mask |= self._seen(item, part)
        for chosen in self._of_faces.values():
            for mask, own in zip(masks, chosen, strict=True):
                mask |= own
        return self._ids_of(masks), np.concatenate([np.empty((0, 6), np.float32), *self.boxes(masks)])

    def boxes(self, masks: Sequence[Bools] | None = None) -> list[Boxes]:
        """For each part of the volume (n, 6) boxes of all its elements, or of those in masks."""
        parts = self._volume.parts
        return [part.boxes if masks is None else part.boxes[masks[number]] for number, part in enumerate(parts)]

    def deciding(self) -> Ints:
        """Ids (n,) of the elements that decide global properties of the picture, or that are counted."""
        # what needs no volume comes before there is one
        found = [*self._first_ones(), *self._ends(), self._inverted()]
        masks = [self._outermost(part) | self._counted(part) for part in self._volume.parts]
        for chosen in self._of_faces.values():
            # existence check: a word without a match is an error
            for mask, own in zip(masks, chosen, strict=True):
                mask[np.flatnonzero(own)[:1]] = True
        if self.scene.shows_domain:
            # silhouettes depend on all of the boundary
            for mask, own in zip(masks, self._chosen((ALL,))[ALL], strict=True):
                mask |= own
        return np.unique(np.concatenate([*found, self._ids_of(masks)]))

    @property
    def decided_by(self) -> Hashable:
        """Dependencies of `deciding` apart from the elements and from values on surfaces, whose elements are shown."""
        every = self.scene.every_object
        counted = [item.quantity for item in every if isinstance(item, Isosurface | VolumeRendering)]
        axes = None if self._axes is None else self._axes.tobytes()
        return self.texts, self._names_of_ends, axes, tuple(counted), self.words, self.scene.shows_domain

    @property
    def shown_by(self) -> Hashable:
        """Dependencies of `shown` apart from the elements."""
        surfaces = [item.surface for item in self.scene.every_object if isinstance(item, CutSurface)]
        return self.texts, tuple(self.levels()), tuple(surfaces), self.words, has_volumes(self.scene)

    def looked_at(self) -> Iterator[Looked]:
        """Facts that determine the visible elements, for each part of the volume."""
        for number, part in enumerate(self._volume.parts):
            ends = {name: _values_held(self._quantity(part, name), len(part)) for name, _ in self.levels()}
            chosen = {word: masks[number] for word, masks in self._of_faces.items()}
            yield Looked(part.element_ids, part.boxes, ends, chosen)

    def _ids_of(self, masks: Sequence[Bools]) -> Ints:
        """(n,) ids of elements in masks of the volume's parts."""
        own = [part.element_ids[mask] for part, mask in zip(self._volume.parts, masks, strict=True)]
        return joined_ints(own)

    def _first_ones(self) -> Iterator[Ints]:
        """The first element of each kind: kinds make the parts of a volume, and their order."""
        yield from (patch.element_ids[:1] for patch in self._patches)
        if self._has_derivatives:
            yield from (patch.element_ids[:1] for sort in by_affinity(self._patches) for patch in sort)

    @property
    def _has_derivatives(self) -> bool:
        """Whether a quantity has derivatives: then affine maps make kinds of elements of their own."""
        return any(Expression.of(self.dataset, text).order for text in self.texts)

    @cached_property
    def _patches(self) -> tuple[Patch, ...]:
        """The elements with the fields of all quantities; the fields of the first quantity come first.

        They have no maps unless these count.
        """
        every = (name for text in self.texts for name in Expression.of(self.dataset, text).fields)
        blocks = None if self._has_derivatives else [without_maps(part) for part in self._parts]
        return patches(self.dataset, tuple(dict.fromkeys(every)), blocks)

    @cached_property
    def _parts(self) -> tuple[geometry.Part, ...]:
        """The maps of elements, which are put together on demand."""
        return geometry.parts(self.dataset)

    def _near_boxes(self, patch: Patch) -> Boxes:
        """(n, 6) boxes of a patch's elements: those of `near_boxes` for the cuts and axes of the scene."""
        axes = np.eye(3) if self._axes is None else np.concatenate([np.eye(3), self._axes], axis=1)
        boxes = np.empty((len(patch), 6), np.float32)
        for part in self._parts:
            rows = np.flatnonzero(np.isin(part.element_ids, patch.element_ids))
            places = rows_of(patch.element_ids, part.element_ids[rows])
            boxes[places] = near_boxes(part, rows, axes, self._may_be_cut)
        return boxes

    def _may_be_cut(self, boxes: Boxes) -> Bools:
        """(n,) which of boxes (n, 6) a cut by a given surface may meet."""
        cuts = [item.surface for item in self.scene.every_object if isinstance(item, CutSurface)]
        return np.any([np.zeros(len(boxes), bool), *(meets(surface, boxes) for surface in cuts)], axis=0)

    def _ends(self) -> Iterator[Ints]:
        """Elements that decide certified ranges over all data."""
        for name in self._names_of_ends:
            with suppress(ElvisError):
                yield deciding_elements(self.dataset, Expression.of(self.dataset, name))

    @cached_property
    def _names_of_ends(self) -> tuple[str, ...]:
        """The quantities whose certified ranges over all data a picture depends on."""
        scene, names = self.scene, list[str]()
        if scene.range == "all":
            names += [scene.field, *(item.style.quantity or scene.field for item in _surfaces(scene))]
            names += [item.quantity or scene.field for item in _volumes(scene)]
        names += [item.quantity or scene.field for item in scene.every_object if isinstance(item, Isosurface)]
        for item in _surfaces(scene):
            style = item.style
            if style.contours is not None and style.contours.count is None:
                names.append(style.contours.quantity or style.quantity or scene.field)
            if style.contours is not None and scene.range == "all":
                names.append(style.contours.quantity or scene.field)
            names += style.lic.components if style.lic else ()
        names += "xyz" if scene.box or scene.axes else ""
        return tuple(dict.fromkeys(names))

    def _outermost(self, part: Part) -> Bools:
        """(n,) elements at the ends of the domain, along the axes and as the camera sees it."""
        mask = np.zeros(len(part), bool)
        every = [some.start + self._ends_of(part.boxes[some]) for some in chunks(len(part), _AT_ONCE)]
        # the ends of all are among the ends of groups
        rows = joined_ints(every)
        mask[rows[self._ends_of(part.boxes[rows])]] = True
        return mask

    def _ends_of(self, boxes: Boxes) -> Ints:
        """(m,) rows of the outermost of boxes (n, 6), the first ones where several are, ascending."""
        finite = np.flatnonzero(np.isfinite(boxes).all(axis=1))
        if not len(finite):
            return finite
        boxes = boxes[finite].astype(np.float64)
        rows = [row for column in boxes.T for row in (column.argmin(), column.argmax(), np.abs(column).argmax())]
        if self._axes is not None:
            # of elements that reach as far any will do
            for corner in range(8):
                places = boxes[:, [3 * (corner >> axis & 1) + axis for axis in range(3)]] @ self._axes
                rows += [*places.argmin(axis=0), *places.argmax(axis=0)]
        return np.asarray(finite[np.unique(rows)])

    @cached_property
    def _axes(self) -> Floats | None:
        """(3, 2) axes along which the view is fitted to all elements; None where it isn't."""
        camera = self.scene.camera
        if self.scene.only_plane is not None or is_given(camera):
            return None
        if isinstance(camera, str):
            camera = named_camera(camera, faced_plane(self.scene))
        return np.array(camera.basis()[:2]).T

    def _counted(self, part: Part) -> Bools:
        """Elements (n,) that are counted although they aren't drawn.

        Their quantity is not a number, or equals an isosurface's value everywhere in them; or their rounding is
        compared with isosurfaces' values; or their isosurfaces are subdivided beyond the limit, whose count must not
        depend on the rank.
        """
        mask = np.zeros(len(part), bool)
        for item in self.scene.every_object:
            if not isinstance(item, Isosurface | VolumeRendering):
                continue
            own = self._quantity(part, item.quantity or self.scene.field)
            if own.bounds is None or not len(part):
                continue
            (low, high), rounding = own.bounds(), _rounding(own, 0.0)
            mask |= np.isnan(low) | np.isnan(high)
            for value in item.values if isinstance(item, Isosurface) else ():
                mask |= np.maximum(np.abs(high - value), np.abs(value - low)) <= 8.0 * rounding
                for some in (0.0, value):
                    mask[np.nan_to_num(_rounding(own, some)).argmax()] = True
        for name, value in self.levels():
            own = self._quantity(part, name)
            stand_in = own.level(value) if own.level is not None else None
            if not (own if stand_in is None else stand_in[0]).degree:
                mask |= self._level(part, name, value)
        return mask

    def levels(self) -> Iterator[tuple[str, float]]:
        """Quantities and their values on surfaces that are found by these."""
        for item in self.scene.every_object:
            if isinstance(item, Isosurface):
                yield from ((item.quantity or self.scene.field, value) for value in item.values)
            if isinstance(item, CutSurface) and isinstance(item.surface, Implicit):
                yield item.surface.expression, 0.0

    def _inverted(self) -> Ints:
        """(n,) ids of elements whose Jacobian isn't certainly positive, which are counted where there are volumes."""
        if not _volumes(self.scene):
            return np.empty(0, np.int64)
        found = validity(self.dataset)
        # the Jacobian of a straight tetrahedron may be computed in another way, with other rounding
        is_doubtful = (found.status != ValidityStatus.POSITIVE) | (found.minimum <= _FLAT * found.error)
        return np.asarray(found.element_ids[is_doubtful])

    def _quantity(self, part: Part, name: str) -> Part | Quantity:
        return part if name == self.scene.field else part.quantities[name]

    def _seen(self, item: object, part: Part) -> Bools:
        """(n,) elements of a part that an object other than faces may show something of."""
        if isinstance(item, VolumeRendering):
            return np.ones(len(part), bool)
        if isinstance(item, Isosurface):
            every = [self._level(part, item.quantity or self.scene.field, value) for value in item.values]
            return np.asarray(np.any(every, axis=0))
        if isinstance(item, CutSurface) and isinstance(item.surface, Implicit):
            return self._level(part, item.surface.expression, 0.0)
        if isinstance(item, CutSurface):
            return meets(item.surface, part.boxes)
        return np.zeros(len(part), bool)

    def _level(self, part: Part, name: str, value: float) -> Bools:
        """Elements (n,) that may have a value, or are unknown: by their own bounds and their replacements'."""
        own = self._quantity(part, name)
        mask = _may_have(own, len(part), value)
        stand_in = own.level(value) if own.level is not None else None
        return mask if stand_in is None else mask | _may_have(stand_in[0], len(part), stand_in[1])

    @cached_property
    def words(self) -> tuple[str, ...]:
        """All that choose faces, each once."""
        items = [item for item in self.scene.every_object if isinstance(item, Faces)]
        return tuple(dict.fromkeys(word for item in items for word in item.select))

    @cached_property
    def _of_faces(self) -> dict[str, list[Bools]]:
        """For each word that chooses faces, and each part, (n,) elements that have such faces."""
        return self._chosen(self.words) if self.words and sum(map(len, self._volume.parts)) else {}

    def _chosen(self, words: Sequence[str]) -> dict[str, list[Bools]]:
        """For each word and each part, (n,) elements with faces that the word chooses."""
        parts = self._volume.parts
        chosen = {word: [np.zeros(len(part), bool) for part in parts] for word in words}
        if not sum(map(len, parts)):
            return chosen
        faces = faces_of(self.dataset, self._volume)
        for word, masks in chosen.items():
            # words that no part has are errors only for the complete data
            with suppress(ElvisError):
                for block, rows in zip(faces.blocks, faces.select((word,)), strict=True):
                    masks[block.part][block.element[rows]] = True
        return chosen


def has_volumes(scene: Scene) -> bool:
    """Whether a scene has volumes, which show all elements."""
    return bool(_volumes(scene))


def _volumes(scene: Scene) -> list[VolumeRendering]:
    """The objects of a scene that are volumes."""
    return [item for item in scene.every_object if isinstance(item, VolumeRendering)]


def _surfaces(scene: Scene) -> list[CutSurface | Faces | Isosurface]:
    """The objects of a scene that are surfaces."""
    return [item for item in scene.every_object if isinstance(item, CutSurface | Faces | Isosurface)]


def _rounding(own: Part | Quantity, value: float) -> Floats:
    """(n,) how far computed values may be from the true ones."""
    assert own.bounds is not None
    low, high = own.bounds()
    greatest = np.nan_to_num(np.maximum(np.abs(low), np.abs(high)), posinf=abs(value))
    return ROUNDING * greatest if own.rounding is None else own.rounding()


def _values_held(own: Part | Quantity, count: int) -> Floats:
    """(n, 2) ends between which `_may_have` finds all values; infinite if one is not known, or another stands in."""
    if own.bounds is None or own.level is not None:
        return np.tile([-np.inf, np.inf], (count, 1))
    low, high = own.bounds()
    # the rounding next to an infinite end depends on the requested value
    is_known, rounding = np.isfinite(low) & np.isfinite(high), 8.0 * _rounding(own, 0.0)
    return np.stack([np.where(is_known, low - rounding, -np.inf), np.where(is_known, high + rounding, np.inf)], axis=1)


def _may_have(own: Part | Quantity, count: int, value: float) -> Bools:
    """(n,) elements whose bounds don't leave a value out, by far more than rounding, or aren't numbers."""
    if own.bounds is None:
        return np.ones(count, bool)
    low, high = own.bounds()
    rounding = _rounding(own, value)
    return np.asarray(~(low - 8.0 * rounding > value) & ~(high + 8.0 * rounding < value))
