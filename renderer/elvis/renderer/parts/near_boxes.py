"""Boxes of the elements of a mesh: exact ones near given surfaces and at the ends of the domain, wider ones elsewhere.

`meets` finds the boxes that a surface may intersect.  Wide boxes follow from vertices, edges and faces.  They exclude
most elements, whose maps are then not needed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats, frozen_ints
from elvis.core.mapping.boxes import MARGIN, Boxes, BoxTree, element_boxes, outward
from elvis.core.mapping.geometry import Assembly, GeometryBlock, Part
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.wide_boxes import vertex_boxes, wide_boxes
from elvis.core.shapes import Shape
from elvis.renderer.passes.solids.hits import triangles
from elvis.scene import Cone, Cylinder, Plane, Sphere, TriangleMesh, Vector, unit

#: elements whose maps are put together at once
_MAPS_AT_ONCE = 1 << 12
#: boxes that are compared at once
_AT_ONCE = 1 << 16
#: part of the largest coordinate by which surfaces may be off
_SLACK = 1e-9


def without_maps(part: Part) -> GeometryBlock:
    """The elements of a part of the map, without coefficients."""
    return GeometryBlock(part.expansion, part.element_ids, frozen_floats(np.empty((len(part), 3, 0))))


def near_boxes(part: Part, rows: Ints, axes: Floats, may_meet: Callable[[Boxes], Bools]) -> Boxes:
    """(n, 6) boxes that hold elements ``rows`` (n,) of a part of the map.

    axes      (3, k) directions along which the ends of the domain are sought
    may_meet  which of boxes (n, 6) a surface may meet

    Boxes that a surface may intersect are exact, and so are those that may end the domain along an axis.
    """
    if not isinstance(part, Assembly):
        return _exact(part, rows)
    inner = vertex_boxes(part, rows)
    if part.is_straight:
        return outward(inner[:, :3], inner[:, 3:], MARGIN)
    if part.expansion.shape is not Shape.HEXAHEDRON:
        return _exact(part, rows)
    outer = wide_boxes(part, rows, inner)
    boxes = outward(outer[:, :3], outer[:, 3:], MARGIN)
    matters = may_meet(boxes) | _may_be_outermost(inner, boxes.astype(np.float64), axes)
    boxes[matters] = _exact(part, rows[matters])
    return boxes


def _exact(part: Part, rows: Ints) -> Boxes:
    """(n, 6) the boxes of the maps of elements."""
    ids, found = part.element_ids, np.empty((len(rows), 6), np.float32)
    for some in chunks(len(rows), _MAPS_AT_ONCE):
        coefficients = frozen_floats(part.take(rows[some]))
        patch = Patch(part.expansion.shape, frozen_ints(ids[rows[some]]), part.expansion, coefficients, (), ())
        found[some] = element_boxes(patch)
    return found


def _may_be_outermost(inner: Floats, outer: Floats, axes: Floats) -> Bools:
    """(n,) which of boxes may reach farthest in some direction, if each is between ``inner`` and ``outer`` (n, 6).

    Corners of boxes are compared along the axes.
    """
    finite = np.isfinite(inner).all(axis=1) & np.isfinite(outer).all(axis=1)
    mask = ~finite
    inner, outer = inner[finite], outer[finite]
    if not len(inner):
        return np.asarray(mask)
    # the lower ends of a box lie between these, the higher ones between those
    ends = np.stack([[outer[:, :3], inner[:, :3]], [inner[:, 3:], outer[:, 3:]]])
    for corner in range(8):
        which = [corner >> axis & 1 for axis in range(3)]
        least, most = (np.stack([ends[which[axis], end, :, axis] for axis in range(3)], axis=1) for end in range(2))
        low = least @ np.maximum(axes, 0) + most @ np.minimum(axes, 0)
        high = most @ np.maximum(axes, 0) + least @ np.minimum(axes, 0)
        mask[finite] |= (low <= high.min(axis=0)).any(axis=1) | (high >= low.max(axis=0)).any(axis=1)
    return mask


def meets(surface: object, boxes: Boxes) -> Bools:
    """(n,) whether a plane, a sphere, a cylinder, a cone or triangles may meet each of the boxes (n, 6)."""
    slack = _SLACK * max((_greatest(boxes[some]) for some in chunks(len(boxes), _AT_ONCE)), default=0.0)
    if isinstance(surface, TriangleMesh):
        return _meets_triangles(surface, boxes, slack)
    mask = np.empty(len(boxes), bool)
    for some in chunks(len(boxes), _AT_ONCE):
        mask[some] = _may_meet(surface, boxes[some].astype(np.float64), slack)
    return mask


def _greatest(boxes: Boxes) -> float:
    """The largest coordinate of boxes that are finite, but for its sign."""
    return float(np.abs(boxes[np.isfinite(boxes).all(axis=1)]).max(initial=0.0))


def _may_meet(surface: object, corners: Floats, slack: float) -> Bools:
    """Flags (n,) whether a plane, a sphere, a cylinder or a cone may meet boxes with these corners (n, 6).

    Distances from them change by at most the displacement: from the middle of a box by half its diagonal, along a
    plane's normal by half its sides together.
    """
    with np.errstate(invalid="ignore"):
        middle, half = 0.5 * (corners[:, :3] + corners[:, 3:]), 0.5 * (corners[:, 3:] - corners[:, :3])
        reach = np.linalg.norm(half, axis=1)
        if isinstance(surface, Plane):
            normal = surface.basis()[2]
            slack += _SLACK * float(np.abs(surface.point).max())
            distance, reach = (middle - surface.point) @ normal, half @ np.abs(normal)
        elif isinstance(surface, Sphere):
            distance = np.linalg.norm(middle - surface.center, axis=1) - surface.radius
        elif isinstance(surface, Cylinder):
            distance = _along_axis(surface.point, surface.axis, middle)[1] - surface.radius
        else:
            assert isinstance(surface, Cone)
            # that to a line in the plane through the axis, which the cone's side is a part of
            along, away = _along_axis(surface.apex, surface.axis, middle)
            angle = np.radians(surface.angle)
            distance = away * np.cos(angle) - along * np.sin(angle)
        return np.asarray(~(np.abs(distance) > reach + slack))


def _along_axis(start: Vector, direction: Vector, points: Floats) -> tuple[Floats, Floats]:
    """(n,) where points (n, 3) lie along an axis, and (n,) their distances from it."""
    axis, away = unit(direction, "axis"), points - np.asarray(start)
    along = away @ axis
    return along, np.linalg.norm(away - np.outer(along, axis), axis=1)


def _meets_triangles(surface: TriangleMesh, boxes: Boxes, slack: float) -> Bools:
    """(n,) whether the box of a triangle meets each of the boxes."""
    mask = np.zeros(len(boxes), bool)
    corners = triangles(surface.file)
    _, element = BoxTree.build(boxes).overlaps(corners.min(axis=1) - slack, corners.max(axis=1) + slack)
    mask[element] = True
    return mask
