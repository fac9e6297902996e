"""Which elements of a part of the data a picture depends on: what is drawn of these alone is what is drawn of all.

Each stage looks at elements of which it isn't certain that nothing of them is there: those whose boxes a surface
meets, those whose certified bounds hold a value, those that have chosen faces.  Of what a picture depends on
altogether, such as its view or ranges over all data, those elements count that decide it.  More than these do no harm.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.core.mapping.boxes import Boxes, BoxTree
from elvis.core.mapping.orientation import chunks
from elvis.core.patch import patches
from elvis.core.picturing import Kind
from elvis.core.quantities import Expression
from elvis.core.quantities.bounding import deciding_elements
from elvis.core.quantities.element_sides import SIDES
from elvis.plugins.faces import faces_of
from elvis.plugins.native.buffers import by_affinity
from elvis.plugins.serving import volume_of
from elvis.plugins.volume import Part, Quantity, Volume
from elvis.renderer.passes.solids.hits import triangles
from elvis.renderer.traversal import ROUNDING
from elvis.scene import (
    Camera,
    Cone,
    CutSurface,
    Cylinder,
    Faces,
    Glyphs,
    Implicit,
    Isosurface,
    Plane,
    Scene,
    Sphere,
    Streamlines,
    TriangleMesh,
    VolumeRendering,
    unit,
)
from elvis.scene.fitting import faced_plane
from elvis.scene.quantities import quantities
from elvis.scene.view import named_camera

#: attributes that an element has by itself
_OWN = ("element", "shape", "order", "jacobian", "scaled_jacobian", "quality", *SIDES)
#: part of the greatest coordinate by which surfaces may be off
_SLACK = 1e-9
#: elements that are looked at together where there are many
_AT_ONCE = 1 << 16


class Relevance:
    """A part of the data, and the scene that is drawn of all; its objects and velocities are named."""

    def __init__(self, dataset: Dataset, scene: Scene) -> None:
        self.dataset, self.scene = dataset, scene
        self.texts = quantities(scene)

    @property
    def is_local(self) -> bool:
        """Whether less than all may do: no light or line goes through all elements, no expression looks beyond one."""
        scene = self.scene
        goes_through = any(isinstance(item, VolumeRendering | Streamlines | Glyphs) for item in scene.every_object)
        cones = any(isinstance(item, CutSurface) and isinstance(item.surface, Cone) for item in scene.every_object)
        expressions = [Expression.of(self.dataset, text) for text in self.texts]
        beyond = any(name not in _OWN for each in expressions for name in each.attributes)
        is_line = Kind.of(self.dataset) is Kind.LINE
        return not (goes_through or cones or beyond or is_line or self.dataset.others)

    def ids(self) -> Ints:
        """(n,) ids of the elements that the picture depends on."""
        # what needs no volume comes before there is one
        found = [np.empty(0, np.int64), *self._first_ones(), *self._ends()]
        volume = volume_of(self.dataset, self.texts)
        masks = [np.zeros(len(part), bool) for part in volume.parts]
        for mask, part in zip(masks, volume.parts, strict=True):
            mask |= self._outermost(part)
            for item in self.scene.every_object:
                mask |= self._seen(item, part)
        for mask, chosen in zip(masks, self._of_faces(volume), strict=True):
            mask |= chosen
        found += [part.element_ids[mask] for part, mask in zip(volume.parts, masks, strict=True)]
        return np.unique(np.concatenate(found))

    def _first_ones(self) -> Iterator[Ints]:
        """The first element of each kind: kinds make the parts of a volume, and their order."""
        expressions = [Expression.of(self.dataset, text) for text in self.texts]
        names = tuple(dict.fromkeys(name for each in expressions for name in each.fields))
        every = patches(self.dataset, names)
        yield from (patch.element_ids[:1] for patch in every)
        if any(expression.order for expression in expressions):
            yield from (patch.element_ids[:1] for sort in by_affinity(every) for patch in sort)

    def _ends(self) -> Iterator[Ints]:
        """Elements that decide certified ranges over all data."""
        scene, names = self.scene, list[str]()
        if scene.range == "all":
            names += [scene.field, *(item.style.quantity or scene.field for item in _surfaces(scene))]
        names += [item.quantity or scene.field for item in scene.every_object if isinstance(item, Isosurface)]
        for item in _surfaces(scene):
            style = item.style
            if style.contours is not None and style.contours.count is None:
                names.append(style.contours.quantity or style.quantity or scene.field)
            if style.contours is not None and scene.range == "all":
                names.append(style.contours.quantity or scene.field)
            names += style.lic.components if style.lic else ()
        names += "xyz" if scene.box or scene.axes else ""
        for name in dict.fromkeys(names):
            with suppress(ElvisError):
                yield deciding_elements(self.dataset, Expression.of(self.dataset, name))

    def _outermost(self, part: Part) -> Bools:
        """(n,) elements at the ends of the domain, along the axes and as the camera sees it."""
        mask = np.zeros(len(part), bool)
        every = [some.start + self._ends_of(part.boxes[some]) for some in chunks(len(part), _AT_ONCE)]
        # the ends of all are ends of those that are looked at together
        rows = np.concatenate([np.empty(0, np.int64), *every])
        mask[rows[self._ends_of(part.boxes[rows])]] = True
        return mask

    def _ends_of(self, boxes: Boxes) -> Ints:
        """(m,) rows of the outermost of boxes (n, 6), the first ones where several are, ascending."""
        finite = np.flatnonzero(np.isfinite(boxes).all(axis=1))
        if not len(finite):
            return finite
        boxes = boxes[finite].astype(np.float64)
        rows = [row for column in boxes.T for row in (column.argmin(), column.argmax(), np.abs(column).argmax())]
        camera = self.scene.camera
        if isinstance(camera, str):
            camera = named_camera(camera, faced_plane(self.scene))
        if self.scene.only_plane is None and isinstance(camera, Camera):
            # as pictures are fitted: of elements that reach as far any will do
            axes = np.array(camera.basis()[:2]).T
            for corner in range(8):
                places = boxes[:, [3 * (corner >> axis & 1) + axis for axis in range(3)]] @ axes
                rows += [*places.argmin(axis=0), *places.argmax(axis=0)]
        return np.asarray(finite[np.unique(rows)])

    def _seen(self, item: object, part: Part) -> Bools:
        """(n,) elements of a part that an object other than faces may show something of."""
        if isinstance(item, Isosurface):
            every = [self._level(part, item.quantity or self.scene.field, value) for value in item.values]
            return np.asarray(np.any(every, axis=0))
        if isinstance(item, CutSurface) and isinstance(item.surface, Implicit):
            return self._level(part, item.surface.expression, 0.0)
        if isinstance(item, CutSurface):
            return meets(item.surface, part.boxes)
        return np.zeros(len(part), bool)

    def _level(self, part: Part, name: str, value: float) -> Bools:
        """(n,) elements that may have a value, or don't know it: their own bounds, and what is drawn in their place."""
        own: Part | Quantity = part if name == self.scene.field else part.quantities[name]
        mask = _may_have(own, len(part), value)
        stand_in = own.level(value) if own.level is not None else None
        return mask if stand_in is None else mask | _may_have(stand_in[0], len(part), stand_in[1])

    def _of_faces(self, volume: Volume) -> list[Bools]:
        """For each part (n,) elements that have faces which are drawn."""
        masks = [np.zeros(len(part), bool) for part in volume.parts]
        chosen = [word for item in self.scene.every_object if isinstance(item, Faces) for word in item.select]
        if not chosen or not sum(map(len, masks)):
            return masks
        faces = faces_of(self.dataset, volume)
        for word in chosen:
            # what no part has is missed where all are together
            with suppress(ElvisError):
                for block, rows in zip(faces.blocks, faces.select((word,)), strict=True):
                    masks[block.part][block.element[rows]] = True
        return masks


def _surfaces(scene: Scene) -> list[CutSurface | Faces | Isosurface]:
    """The objects of a scene that are surfaces."""
    return [item for item in scene.every_object if isinstance(item, CutSurface | Faces | Isosurface)]


def _may_have(own: Part | Quantity, count: int, value: float) -> Bools:
    """(n,) elements whose bounds don't leave a value out, by far more than rounding, or aren't numbers."""
    if own.bounds is None:
        return np.ones(count, bool)
    low, high = own.bounds()
    greatest = np.nan_to_num(np.maximum(np.abs(low), np.abs(high)), posinf=abs(value))
    rounding = ROUNDING * greatest if own.rounding is None else own.rounding()
    mask = ~(low - 8.0 * rounding > value) & ~(high + 8.0 * rounding < value)
    # what is beyond all by less than rounding is drawn nonetheless
    if count:
        mask[np.nan_to_num(rounding).argmax()] = True
    return np.asarray(mask)


def meets(surface: object, boxes: Boxes) -> Bools:
    """(n,) whether a plane, a sphere, a cylinder or triangles may meet each of the boxes (n, 6)."""
    slack = _SLACK * max((_greatest(boxes[some]) for some in chunks(len(boxes), _AT_ONCE)), default=0.0)
    if isinstance(surface, TriangleMesh):
        return _meets_triangles(surface, boxes, slack)
    mask = np.empty(len(boxes), bool)
    for some in chunks(len(boxes), _AT_ONCE):
        mask[some] = _may_meet(surface, boxes[some].astype(np.float64), slack)
    return mask


def _greatest(boxes: Boxes) -> float:
    """The greatest coordinate of boxes that are finite, but for its sign."""
    return float(np.abs(boxes[np.isfinite(boxes).all(axis=1)]).max(initial=0.0))


def _may_meet(surface: object, corners: Floats, slack: float) -> Bools:
    """(n,) whether a plane, a sphere or a cylinder may meet boxes with these corners (n, 6).

    Distances from them change by no more than one moves: from the middle of a box by half its diagonal, along a
    plane's normal by half its sides together.
    """
    middle, half = 0.5 * (corners[:, :3] + corners[:, 3:]), 0.5 * (corners[:, 3:] - corners[:, :3])
    reach = np.linalg.norm(half, axis=1)
    with np.errstate(invalid="ignore"):
        if isinstance(surface, Plane):
            normal = surface.basis()[2]
            slack += _SLACK * float(np.abs(surface.point).max())
            distance, reach = (middle - surface.point) @ normal, half @ np.abs(normal)
        elif isinstance(surface, Sphere):
            distance = np.linalg.norm(middle - surface.center, axis=1) - surface.radius
        else:
            assert isinstance(surface, Cylinder)
            distance = _from_axis(surface, middle) - surface.radius
        return np.asarray(~(np.abs(distance) > reach + slack))


def _from_axis(surface: Cylinder, points: Floats) -> Floats:
    """(n,) distances of points (n, 3) from the axis of a cylinder."""
    axis, away = unit(surface.axis, "axis"), points - np.asarray(surface.point)
    return np.asarray(np.linalg.norm(away - np.outer(away @ axis, axis), axis=1))


def _meets_triangles(surface: TriangleMesh, boxes: Boxes, slack: float) -> Bools:
    """(n,) whether the box of a triangle meets each of the boxes."""
    mask = np.zeros(len(boxes), bool)
    corners = triangles(surface.file)
    _, element = BoxTree.build(boxes).overlaps(corners.min(axis=1) - slack, corners.max(axis=1) + slack)
    mask[element] = True
    return mask
