"""How far triangles of a surface q = 0 may be from it, and their outlines from its curves on outer faces."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.polynomials.boxnets import difference
from elvis.core.triangles.level_cells import CellBlock, has_one_sign

#: second derivatives that count as rounding, relative to their terms
_FLAT = 1e-12


def distance_bounds(block: CellBlock) -> tuple[Floats, Bools]:
    """(n,) maximum distance from the surface of triangles whose corners are zeros on edges in each box.

    On outlines also that of the triangles' sides from the curve in which the surface meets the face of the box.  Where
    the whole face is nearer to the surface than that, the distance of the two counts instead: they do not cross.

    Also whether slopes have bounds in boxes, so that distances fall with their size.
    """
    size = _diagonals(block.maps)
    known = _bounds(block.levels, block.maps, block.slack, _parts_of_boxes(block.maps.shape[1]))
    found = np.fmin(known.bound, size)
    for axis, end in zip(*np.nonzero(block.outlines.any(axis=0)), strict=True):
        here, levels, maps = _crossed_faces(block, int(axis), int(end))
        if len(here):
            found[here] = np.maximum(found[here], _at_faces(levels, maps, block.slack[here], known.least[here]))
    return found, np.isfinite(known.bound)


def _crossed_faces(block: CellBlock, axis: int, end: int) -> tuple[Ints, Floats, Floats]:
    """Rows (k,) of boxes with an outline on one of their faces that q = 0 may cross, and the nets of q and the map."""
    here = np.flatnonzero(block.outlines[:, axis, end])
    levels = np.take(block.levels[here], -end, axis=1 + axis)
    maps = np.take(block.maps[here], -end, axis=2 + axis)
    chosen = ~has_one_sign(levels, block.slack[here], block.noise)
    return here[chosen], levels[chosen], maps[chosen]


def _at_faces(levels: Floats, maps: Floats, slack: Floats, least: Floats) -> Floats:
    """(n,) maximum distance of chords from the curve on a face, or of the face from the surface if that is smaller.

    least  (n,) slope of q along its gradient
    """
    with np.errstate(all="ignore"):
        sheet = np.where(least > 0, (_largest(levels) + slack) / least, np.inf)
    return np.fmin(np.fmin(_outline_bounds(levels, maps, slack), _diagonals(maps)), sheet)


@dataclass(frozen=True, eq=False)
class _Bounds:
    """Bounds in boxes (n,) of a function q with linear interpolation between its zeros.

    bound  distance of the zero; infinite if the slope along the gradient may vanish
    least  slope of q along its gradient in the middle
    shift  (n, d) distance in each coordinate of the box between a point between zeros and the place of its weights
    step   (n, d) change of coordinates for each unit of length along the gradient
    """

    bound: Floats
    least: Floats
    shift: Floats
    step: Floats


def _bounds(levels: Floats, maps: Floats, slack: Floats, parts: Floats) -> _Bounds:
    """Bounds for nets of q (n, D, …) and of maps (n, d, M, …) of d-dimensional boxes to a space of d dimensions.

    slack  (n,) how far q is from its polynomial at most: at the corners of triangles, and where q changes its sign
    parts  (k, d) extents of the parts of boxes in which interpolation is linear

    With the gradient G at the centre of the box, q = G . x + r, and the gradient of r vanishes there.  A flat triangle,
    whose corners are zeros, satisfies q(X) = r(X) - sum l_k r_k at a point X = sum l_k x_k.  Second derivatives bound
    that: on a simplex of extents e, sum_k l_k |v_k - p|_i |v_k - p|_j <= e_i e_j / 4.  X itself differs from the place
    of these weights by the curvature of the map.  The increase of q along G is at least |G|, minus the effect of r.
    """
    inverse, map_bends = _upright(maps)
    gradient = np.einsum("nic,ni->nc", inverse, middle_gradient(levels))
    linear = np.einsum("nc,nc...->n...", gradient, maps)
    bends = second_derivatives(difference(levels, linear))
    bends[bends <= _FLAT * (_largest(linear) + _largest(levels))[:, None, None]] = 0.0

    # the Jacobian of the upright map differs from the unit matrix by at most `turn`, its inverse by turn / (1 - turn),
    # in the row sum norm
    turn = map_bends.sum(axis=(2, 3)).max(axis=1) / 2
    products = parts[:, :, None] * parts[:, None, :] / 8
    with np.errstate(all="ignore"):
        more = np.where(turn < 1, turn / (1 - turn), np.inf)
        slope = np.linalg.norm(gradient, axis=1)
        steepness = bends.sum(axis=2) / 2
        step = grown(np.abs(np.einsum("nic,nc->ni", inverse, gradient)) / slope[:, None], more)
        least = np.where(turn < 1, slope - (steepness * step).sum(axis=1), -np.inf)
        shift = grown(np.einsum("ncij,kij->knc", map_bends, products).max(axis=0), more)
        error = np.einsum("nij,kij->kn", bends, products).max(axis=0) + (steepness * shift).sum(axis=1)
        bound = np.where(least > 0, (error + 2 * slack) / least, np.inf)
    is_flat = ~bends.any(axis=(1, 2)) & (slack == 0)
    return _Bounds(np.where(is_flat, 0.0, bound), np.where(is_flat, slope, least), shift, step)


def _upright(maps: Floats) -> tuple[Floats, Floats]:
    """Inverse Jacobians (n, d, d) in the middle of boxes, and second derivatives (n, d, d, d) of the upright map.

    That is the map times the inverse Jacobian.
    """
    axes = range(maps.shape[1])
    jacobian = np.stack([middle_gradient(maps[:, axis]) for axis in axes], axis=1)
    with np.errstate(all="ignore"):
        inverse = np.nan_to_num(_inverses(jacobian), posinf=0, neginf=0)
    upright = np.einsum("ndc,nc...->nd...", inverse, maps)
    return inverse, np.stack([second_derivatives(upright[:, axis]) for axis in axes], axis=1)


def _outline_bounds(levels: Floats, maps: Floats, slack: Floats) -> Floats:
    """(n,) maximum distance of chords, whose ends are zeros of q on faces, from the curve q = 0 on these.

    levels, maps  nets (n, D, D) of q and (n, 3, M, M) of the map on faces of boxes

    The face is a graph over the plane through the tangents in its middle.  In that plane `_bounds` hold, for q on the
    face; across the plane the graph differs from a chord by its second derivatives over the plane, and changes again on
    the way along the gradient to the zero.
    """
    tangents = np.stack([middle_gradient(maps[:, axis]) for axis in range(3)], axis=1)
    with np.errstate(all="ignore"):
        first = tangents[:, :, 0] / np.linalg.norm(tangents[:, :, 0], axis=1, keepdims=True)
        normal = np.cross(tangents[:, :, 0], tangents[:, :, 1])
        normal = np.nan_to_num(normal / np.linalg.norm(normal, axis=1, keepdims=True))
    frame = np.stack([np.nan_to_num(first), np.cross(normal, np.nan_to_num(first))], axis=1)
    plane = _bounds(levels, np.einsum("nic,ncuv->niuv", frame, maps), slack, np.ones((1, 2)))

    bends = second_derivatives(np.einsum("nc,ncuv->nuv", normal, maps))
    bends[bends <= _FLAT * _largest(maps)[:, None, None]] = 0.0
    steepness = bends.sum(axis=2) / 2
    with np.errstate(all="ignore"):
        height = steepness.sum(axis=1) / 4 + _products(steepness, plane.shift)
        rise = _products(steepness, plane.step)
        return np.where(plane.bound > 0, plane.bound * (1 + rise), 0.0) + height


def _products(steepness: Floats, steps: Floats) -> Floats:
    """(n,) sums over coordinates of products (n, d); nothing where the steepness is zero."""
    return np.asarray(np.where(steepness > 0, steepness * steps, 0.0).sum(axis=1))


def _diagonals(maps: Floats) -> Floats:
    """(n,) lengths of diagonals of boxes around nets (n, d, …)."""
    flat = maps.reshape(*maps.shape[:2], -1)
    return np.asarray(np.linalg.norm(np.ptp(flat, axis=2), axis=1))


@cache
def _parts_of_boxes(dimension: int) -> Floats:
    """(d, d) extents of tetrahedra in a box: those of the box but for one, which is half of it."""
    return frozen_floats(1 - np.eye(dimension) / 2)


def _largest(nets: Floats) -> Floats:
    """(n,) largest magnitudes in nets (n, …)."""
    return np.asarray(np.abs(nets).reshape(len(nets), -1).max(axis=1))


def grown(vectors: Floats, more: Floats) -> Floats:
    """Magnitudes (n, d) that a matrix enlarges by a share ``more`` (n,) of the largest."""
    return np.asarray(vectors + (more * vectors.max(axis=1))[:, None])


def _inverses(matrices: Floats) -> Floats:
    """(n, d, d) inverses by cofactors, of two or three dimensions; not finite where there are none."""
    if matrices.shape[1] == 2:
        (a, b), (c, d) = matrices.transpose(1, 2, 0)
        cofactors = np.stack([np.stack([d, -b]), np.stack([-c, a])])
        return np.asarray((cofactors / (a * d - b * c)).transpose(2, 0, 1))
    a, b, c = matrices[:, :, 0], matrices[:, :, 1], matrices[:, :, 2]
    rows = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    return np.asarray(rows / np.einsum("ni,ni->n", a, rows[:, 0])[:, None, None])


def middle_gradient(nets: Floats) -> Floats:
    """(n, d) derivatives of nets (n, D1, …, Dd) in the middle of their boxes."""
    d = nets.ndim - 1
    tables = [line_tables(size - 1, np.array([0.5]), 1)[:, 0] for size in nets.shape[1:]]
    found = np.empty((len(nets), d))
    for axis in range(d):
        own = nets
        for other in range(d):
            own = np.einsum("ni...,i->n...", own, tables[other][int(other == axis)])
        found[:, axis] = own
    return found


def second_derivatives(nets: Floats) -> Floats:
    """(n, d, d) bounds of the second derivatives of nets (n, D1, …, Dd) on their boxes."""
    d = nets.ndim - 1
    found = np.zeros((len(nets), d, d))
    for i in range(d):
        once = nets.shape[1 + i] - 1
        slopes = np.diff(nets, axis=1 + i)
        for j in range(i, d):
            again = slopes.shape[1 + j] - 1
            if once and again > 0:
                twice = np.diff(slopes, axis=1 + j).reshape(len(nets), -1)
                largest = np.maximum(twice.max(axis=1), -twice.min(axis=1))
                found[:, i, j] = found[:, j, i] = once * again * largest
    return found
