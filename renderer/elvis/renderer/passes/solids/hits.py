"""Intersections of rays with surfaces in space, and points inside of these.  Needs no device."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.base.needing import require_module
from elvis.core.distances.sides import is_closed
from elvis.core.distances.triangle_files import corners_of, triangles_of
from elvis.scene import Cone, Cylinder, Plane, Sphere, TriangleMesh, unit
from elvis.scene.cameras.view import View
from elvis.scene.model.surfaces import Solid

#: number of pairs of a triangle and a pixel that are processed together
_AT_ONCE = 1 << 20
#: rounding in the discriminants of quadrics, relative to their terms
_ROUNDING = 4e-15
#: part of a triangle by which it is larger all round, so that no ray passes between two; hits of both are one
_SEAM = 1e-12


@dataclass(frozen=True, eq=False)
class Hits:
    """Hits of rays with a surface, sorted by pixel, then by depth.

    pixel   (n,)    row by row from the top
    depth   (n,)    as in HitBuffer, greater than 0
    normal  (n, 3)  unit normals, towards either side
    uncertainty  (n,) the true depths are within this; None: the surface is given analytically
    doubt   (m,)    for each pixel of the view the depth from which on something may have been overlooked, infinite
                    where nothing was; None: nowhere
    """

    pixel: Ints
    depth: Floats
    normal: Floats
    uncertainty: Floats | None = None
    doubt: Floats | None = None

    @staticmethod
    def none() -> Hits:
        """No hits."""
        return Hits(np.empty(0, np.int64), np.empty(0), np.empty((0, 3)))


def hits(surface: Solid, view: View) -> Hits:
    """All hits of the view's rays with a surface in front of the eye."""
    doubt = None
    if isinstance(surface, TriangleMesh):
        pixel, depth, normal = _triangle_hits(triangles(surface.file), view)
    else:
        pixel = np.arange(view.count)
        origins, directions = view.rays_of(pixel)
        depths = ray_depths(surface, origins, directions)
        which, pixel = np.nonzero((depths > 0.0) & np.isfinite(depths))
        depth = depths[which, pixel]
        normal = _gradient(surface, origins[pixel] + depth[:, None] * directions[pixel])
        doubt = _touched(surface, origins, directions)
    order = np.lexsort([depth, pixel])
    return Hits(pixel[order], depth[order], normal[order], doubt=doubt)


def outside(surface: Solid, points: Floats) -> Floats:
    """(n,) distances of points (n, 3) from a surface near it, exact for planes; negative inside.

    Inside is behind a plane, within a sphere, cylinder or cone, or where closed triangles wind around.  Raises
    FormatError for triangles that are not closed.
    """
    if isinstance(surface, TriangleMesh):
        igl = require_module("igl", "the inside of a triangle file", "distances")

        corners = _closed_triangles(surface.file).reshape(-1, 3)
        faces = np.arange(len(corners)).reshape(-1, 3)
        return np.asarray(0.5 - igl.fast_winding_number(corners, faces, np.ascontiguousarray(points)))
    if isinstance(surface, Plane):
        return np.asarray((points - np.asarray(surface.point)) @ unit(surface.normal, "the normal of the plane"))
    matrix, center, level = _quadric(surface)
    away = points - center
    gradient = away @ matrix
    value = np.einsum("ni,ni->n", gradient, away) - level
    distance = value / np.maximum(2.0 * np.linalg.norm(gradient, axis=1), 1e-300)
    return np.where(away @ np.asarray(surface.axis) > 0.0, distance, np.inf) if isinstance(surface, Cone) else distance


@cache
def triangles(file: str) -> Floats:
    """(m, 3, 3) corners of the triangles of an STL, PLY, OBJ or GLB file; FormatError where there are none."""
    corners = corners_of(file)
    corners.setflags(write=False)
    return corners


@cache
def _closed_triangles(file: str) -> Floats:
    """As `triangles`; FormatError for a surface with open edges, which has no inside."""
    if not is_closed([triangles_of(file)[1]]):
        raise FormatError("expected a closed surface, found open edges, so it has no inside", file=file)
    return triangles(file)


def _quadric(surface: Sphere | Cylinder | Cone) -> tuple[Floats, Floats, float]:
    """Matrix A (3, 3), center c and level k of the quadric (x - c)ᵀ A (x - c) = k."""
    if isinstance(surface, Sphere):
        return np.eye(3), np.asarray(surface.center, dtype=np.float64), surface.radius**2
    axis = unit(surface.axis, "axis")
    along = np.outer(axis, axis)
    if isinstance(surface, Cylinder):
        return np.eye(3) - along, np.asarray(surface.point, dtype=np.float64), surface.radius**2
    return np.cos(np.deg2rad(surface.angle)) ** 2 * np.eye(3) - along, np.asarray(surface.apex, dtype=np.float64), 0.0


def ray_depths(surface: Plane | Sphere | Cylinder | Cone, origins: Floats, directions: Floats) -> Floats:
    """(1 or 2, n) depths of all hits of rays, NaN or infinite where there is none."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        if isinstance(surface, Plane):
            normal = unit(surface.normal, "the normal of the plane")
            return np.asarray(((np.asarray(surface.point) - origins) @ normal) / (directions @ normal))[None]
        a, b, c, _, start, shift = _along(surface, origins, directions)
        q = -(b + np.copysign(np.sqrt(b * b - a * c), b))
        depths = [q / a, c / q]
    if isinstance(surface, Cone):
        axis = unit(surface.axis, "axis")
        for depth in depths:
            depth[~((start + depth[:, None] * directions) @ axis >= 0.0)] = np.nan
    return np.asarray(np.stack(depths) + shift)


def _along(surface: Sphere | Cylinder | Cone, origins: Floats, directions: Floats) -> tuple[Floats, ...]:
    """The quadric along rays, a t^2 + 2 b t + c, and the magnitudes of the terms of c, all (n,).

    Then its start (n, 3), from the centre, and that point's depth: it is the ray's nearest point to the centre, so that
    a distant eye costs no digits.
    """
    matrix, center, level = _quadric(surface)
    shift = np.einsum("ni,ni->n", center - origins, directions) / np.einsum("ni,ni->n", directions, directions)
    start = origins - center + shift[:, None] * directions
    pairs = ((directions, directions), (start, directions), (start, start))
    a, b, c = (np.einsum("ni,ij,nj->n", one, matrix, other) for one, other in pairs)
    size = np.einsum("ni,ij,nj->n", np.abs(start), np.abs(matrix), np.abs(start)) + abs(level)
    return a, b, c - level, size, start, shift


def _touched(surface: Plane | Sphere | Cylinder | Cone, origins: Floats, directions: Floats) -> Floats:
    """Depths (n,) beyond which rays may touch the surface or miss it, due to rounding; infinite for all others.

    Roots of a quadratic are equal if its discriminant is at most the rounding of its terms.
    """
    if isinstance(surface, Plane):
        return np.full(len(origins), np.inf)
    a, b, c, size, _, shift = _along(surface, origins, directions)
    center = _quadric(surface)[1]
    far = np.abs(origins).max(axis=1) + np.abs(center).max()
    error = _ROUNDING * (b * b + np.abs(a) * (size + np.sqrt(size) * far))
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = shift - (b + np.sqrt(error)) / a
    touches = (np.abs(b * b - a * c) <= error) & np.isfinite(depth) & (depth > 0.0)
    return np.where(touches, depth, np.inf)


def _gradient(surface: Plane | Sphere | Cylinder | Cone, points: Floats) -> Floats:
    """(n, 3) unit normals at points of the surface."""
    if isinstance(surface, Plane):
        return np.tile(unit(surface.normal, "the normal of the plane"), (len(points), 1))
    matrix, center, _ = _quadric(surface)
    gradient = (points - center) @ matrix
    return np.asarray(gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-300))


def _triangle_hits(corners: Floats, view: View) -> tuple[Ints, Floats, Floats]:
    """Pixels, depths and normals of all hits with triangles (m, 3, 3), in object order; one hit where two join."""
    found = []
    for triangle, column, row in _pairs(corners, view):
        depth = _triangle_depths(corners[triangle], *view.rays(column, row))
        met = np.flatnonzero(depth > 0.0)
        found.append((view.numbers(column[met], row[met]), depth[met], triangle[met]))
    pixel, depth, triangle = (np.concatenate(parts) for parts in zip(_NONE, *found, strict=True))
    order = np.lexsort([depth, pixel])
    pixel, depth, triangle = pixel[order], depth[order], triangle[order]
    again = (np.diff(pixel) == 0) & (np.diff(depth) <= 1e-9 * np.abs(depth[1:]))
    kept = np.flatnonzero(np.append(True, ~again)[: len(pixel)])
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    return pixel[kept], depth[kept], normal[triangle[kept]]


def _pairs(corners: Floats, view: View) -> Iterator[tuple[Ints, Ints, Ints]]:
    """Triangles, columns and rows: for every triangle the pixels within its bounds, some at a time."""
    placed = view.projected(corners)
    front = placed[..., 2] > 0.0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        seen = placed[..., :2] / placed[..., 2:]
    least, most = np.nan_to_num(seen.min(axis=1)), np.nan_to_num(seen.max(axis=1))

    # what crosses the plane of the eye may be anywhere
    least[~front.all(axis=1)], most[~front.all(axis=1)] = view.first, view.last
    first = np.ceil(np.clip(least - 1e-6, view.first, view.last + 1)).astype(np.int64)
    sides = np.maximum(np.floor(np.clip(most + 1e-6, view.first - 1, view.last)).astype(np.int64) - first + 1, 0)
    counts = sides.prod(axis=1) * front.any(axis=1)
    ends = np.cumsum(counts)
    for start in range(0, int(ends[-1]), _AT_ONCE):
        pair = np.arange(start, min(start + _AT_ONCE, int(ends[-1])))
        triangle = np.searchsorted(ends, pair, side="right")
        place = pair - (ends - counts)[triangle]
        across = sides[triangle, 0]
        yield triangle, first[triangle, 0] + place % across, first[triangle, 1] + place // across


_NONE = (np.empty(0, np.int64), np.empty(0), np.empty(0, np.int64))


def _triangle_depths(corners: Floats, origins: Floats, directions: Floats) -> Floats:
    """(n,) depth at which each ray meets its triangle, NaN where it doesn't (Möller and Trumbore 1997)."""
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(directions, two)
    away = origins - corners[:, 0]
    turned = np.cross(away, one)
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = 1.0 / np.einsum("ni,ni->n", one, across)
        u = factor * np.einsum("ni,ni->n", away, across)
        v = factor * np.einsum("ni,ni->n", directions, turned)
        met = (u >= -_SEAM) & (v >= -_SEAM) & (u + v <= 1.0 + _SEAM)
        return np.where(met, factor * np.einsum("ni,ni->n", two, turned), np.nan)
