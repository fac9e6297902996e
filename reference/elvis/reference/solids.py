"""Elements for rays: with three reference coordinates and faces for any shape.

Plane elements of quasi-3D data are extruded along zeta in [-1, 1], one period.  Elements of surfaces in space are
surfaces: a third coordinate leads away from them, and is zero on their only face, which is all of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.cutting import Template, drawn_out, template
from elvis.core.mapping.margins import facets
from elvis.core.mapping.orientation import face_shape
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.pointwise import positions_and_jacobians
from elvis.core.polynomials.evaluation import evaluate, evaluate_at_with_gradients
from elvis.core.shapes import Shape
from elvis.plugins.runtime.host.patch import HostPatch
from elvis.scene.model.time_limit import check_time

#: heights of zeta = -1 and zeta = 1, as `margins.facets` has them: normal and offset
_LIDS = np.array([[0.0, 0.0, 0.5, 0.5], [0.0, 0.0, -0.5, 0.5]])


@dataclass(frozen=True, eq=False)
class Face:
    """A face of a solid.

    kind    triangle or quadrilateral
    frame   (3, 3)  rows f0, f1, f2: the point (s, t) of the face lies at f0 + s f1 + t f2 in reference coordinates
    height  (4,)    normal and offset: the face lies where normal . xi + offset = 0
    others  (k, 4) normals and offsets of the planes that bound the face
    """

    kind: Shape
    frame: Floats
    height: Floats
    others: Floats


def heights(planes: Floats, points: Floats) -> Floats:
    """(n, k) heights of reference points (n, 3) above planes (k, 4) of normals and offsets."""
    return np.asarray(points @ planes[:, :3].T + planes[:, 3])


@cache
def faces(shape: Shape, extruded: bool) -> tuple[Face, ...]:
    """The faces of a solid; for an extruded one, walls over its edges, then the lids at zeta = -1 and zeta = 1."""
    planes = bounds(shape, extruded)
    if shape.dimension == 3:
        frames = [(face_shape(face), _frame(shape.vertices[list(face)])) for face in shape.faces]
    elif extruded:
        ends = np.pad(shape.vertices, ((0, 0), (0, 1)))[[*shape.edges]]
        walls = [np.stack([end.mean(axis=0), (end[1] - end[0]) / 2, [0, 0, 1]]) for end in ends]
        lids = [_frame(np.pad(shape.vertices, ((0, 0), (0, 1)), constant_values=zeta)) for zeta in (-1.0, 1.0)]
        frames = [*((Shape.QUADRILATERAL, wall) for wall in walls), *((shape, lid) for lid in lids)]
    else:
        frame = _frame(np.pad(shape.vertices, ((0, 0), (0, 1))))
        return (Face(shape, frame, np.array([0.0, 0.0, 1.0, 0.0]), planes),)
    found = []
    for kind, frame in frames:
        which = int(np.abs(frame[:, :3] @ planes[:, :3].T + [[1], [0], [0]] * planes[:, 3]).sum(axis=0).argmin())
        found.append(Face(kind, frame, planes[which], np.delete(planes, which, axis=0)))
    return tuple(found)


def _frame(corners: Floats) -> Floats:
    """The frame of a face with these corners (3 or 4, 3)."""
    first, along, across = corners[0], corners[1], corners[-1]
    return np.array([(along + across) / 2, (along - first) / 2, (across - first) / 2])


@cache
def bounds(shape: Shape, extruded: bool) -> Floats:
    """(k, 4) normals and offsets of the planes that bound a solid; for a surface, the planes that bound it sideways."""
    normals, offsets = facets(shape)
    planes = np.column_stack([np.pad(normals, ((0, 0), (0, 3 - shape.dimension))), offsets])
    return np.concatenate([planes, _LIDS]) if extruded else planes


def faces_of(patch: Patch) -> tuple[Face, ...]:
    """The faces of a patch's elements."""
    return faces(patch.shape, bool(patch.periods))


def margins_of(patch: Patch, points: Floats) -> Floats:
    """(n,) how far inside an element reference points (n, 3) lie, as `elvis.core.mapping.margins` has it."""
    return np.asarray(heights(bounds(patch.shape, bool(patch.periods)), points).min(axis=1))


def cells_of(patch: Patch, level: int) -> Template:
    """The elements of a patch cut ``level`` times.

    Elements of quasi-3D data have a layer for each plane between their lids, which is cut as often.
    """
    cut = template(patch.shape, level)
    if patch.homogeneous is None:
        return cut
    return drawn_out(cut, max(2, len(patch.homogeneous.z_ids)) << level)


def map_lattice(patch: Patch, rows: Ints, points: Floats) -> Floats:
    """(e, k, 3) world coordinates of the same reference points (k, 2 or 3) in some elements."""
    check_time()
    own = points[:, : patch.shape.dimension]
    if isinstance(patch, HostPatch):
        return patch.map_lattice(rows, own)
    world = evaluate(patch.geometry, patch.geometry_coefficients[rows], own).transpose(0, 2, 1).copy()
    for number, (axis, length) in enumerate(patch.periods):
        world[:, :, axis] = length * (1 + points[:, patch.shape.dimension + number]) / 2
    return np.asarray(world)


def map_points(patch: Patch, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
    """World coordinates (n, 3) and their derivatives (n, 3, 3) at reference points (n, 3) of elements (n,).

    The third coordinate of a surface leads away at right angles; derivatives are right where it is zero.
    """
    check_time()
    if isinstance(patch, HostPatch):
        return patch.map_points(rows, points)
    if patch.shape.dimension == 3:
        return evaluate_at_with_gradients(patch.geometry, patch.geometry_coefficients, rows, points)
    world, jacobians = positions_and_jacobians(patch, rows, points)
    if patch.periods:
        return world, jacobians
    away = np.cross(jacobians[:, :, 0], jacobians[:, :, 1])
    with np.errstate(invalid="ignore", divide="ignore"):
        away /= np.sqrt(np.linalg.norm(away, axis=1, keepdims=True))
    return world + points[:, 2:] * away, np.dstack([jacobians, away])
