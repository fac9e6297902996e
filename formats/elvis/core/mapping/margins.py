"""Margins: distances of a point inside a reference shape from its boundary."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.shapes import Shape

#: points whose margin isn't below minus this belong to the element
TOLERANCE = 1e-10


@bounded_cache
def facets(shape: Shape) -> tuple[Floats, Floats]:
    """Normals (k, d) and offsets (k,) so that facet i of the shape lies where normal_i . xi + offset_i = 0.

    Each is 0 on its facet and 1 at the far end: on simplices these are the barycentric coordinates.
    """
    vertices, normals = shape.vertices, []
    for candidate in _candidates(shape.dimension):
        heights = vertices @ candidate[:-1] + candidate[-1]
        if heights.min() == 0 and (heights == 0).sum() >= shape.dimension:
            normals.append(candidate)
    table = np.array(normals)
    return frozen_floats(table[:, :-1]), frozen_floats(table[:, -1])


def _candidates(dimension: int) -> list[Floats]:
    """Planes that bound some shape: xi_i = -1, xi_i = 1, and sums of two or more xi_i equal to 2 less their number."""
    rows = [np.append(0.5 * axis, 0.5) for axis in np.eye(dimension)]
    for bits in range(1, 2**dimension):
        chosen = np.array([bits >> i & 1 for i in range(dimension)], np.float64)
        rows.append(np.append(-0.5 * chosen, (2 - chosen.sum()) / 2))
    return rows


def heights(shape: Shape, points: Floats) -> Floats:
    """(…, k) distances of reference points (…, d) from the facets, in the unit of `facets`."""
    normals, offsets = facets(shape)
    return np.asarray(points @ normals.T + offsets)


def margins(shape: Shape, points: Floats) -> Floats:
    """(n,) the smallest height of reference points (n, d): positive inside, 0 on the boundary, negative outside."""
    return np.asarray(heights(shape, points).min(axis=1))


def drawn_in(shape: Shape, points: Floats, slack: float) -> Floats:
    """(n, d) the points, those with a margin below -``slack`` moved towards the centre until theirs is."""
    centre = shape.centre
    inner = heights(shape, centre[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = (inner + slack) / (inner - heights(shape, points))
    part = np.where((parts > 0) & (parts < 1), parts, 1.0).min(axis=1, keepdims=True)
    return np.asarray(centre + part * (points - centre))
