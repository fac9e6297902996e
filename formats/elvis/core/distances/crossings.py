"""Winding numbers of closed surfaces around points, from crossings of rays, found by a tree of boxes.

Triangles may meet the sides of other triangles with gaps, as curved patches do if one side is cut more finely.  They
form a closed surface together with thin fillings of the gaps.  If a ray passes no gap, the winding number at its start
is the number of triangles crossed in one direction minus the number in the other direction; the fillings of the gaps do
not matter.
"""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import EPS, Bools, Floats, Ints
from elvis.core.base.needing import require_module
from elvis.core.mapping.boxes import BoxTree, outward

#: parts of the largest coordinate within which sides of neighbours are the same
EQUAL = 1e-12
#: and within which points lie on a triangle
_ON = 16 * EPS
#: directions that are tried
_WAYS = 24


def windings(corners: Floats, gaps: Floats, places: Floats) -> tuple[Ints, Ints]:
    """Winding number of a closed surface around points (n, 3).

    The results are the numbers (n,), and the points (k,) for which no ray decides.

    corners  (m, 3, 3) of triangles, counterclockwise as seen from outside the volume with winding number 1
    gaps     (m, 3) maximum distance of the filling of the gap from each side; side k runs from corner k to the next one
    If orientations of neighbouring triangles differ, the parity of the numbers is still correct.  Points for which no
    ray decides are on a triangle or in a gap; their number is 0.
    """
    scale = np.abs(corners).max()
    wide = gaps + EQUAL * scale
    margin = wide.max(axis=1, keepdims=True)
    tree = BoxTree.build(outward(corners.min(axis=1) - margin, corners.max(axis=1) + margin, 0.0))

    # one direction for all, then others for those whose rays pass gaps
    found = np.zeros(len(places), np.int64)
    rest = np.arange(len(places))
    random = np.random.default_rng(0)
    for _ in range(_WAYS):
        axes = np.linalg.qr(random.normal(size=(3, 3)))[0]
        axes[:, 2] *= np.linalg.det(axes)
        counts, is_sure = _along(axes, corners, wide, tree, places[rest])
        found[rest[is_sure]] = counts[is_sure]
        rest = rest[~is_sure]
        if not len(rest):
            break
    return found, rest


def _along(axes: Floats, corners: Floats, gaps: Floats, tree: BoxTree, places: Floats) -> tuple[Ints, Bools]:
    """Crossings of rays from points (n, 3).

    The results are (n,) the number from behind minus the number from before, and (n,) whether it is certain.

    axes  (3, 3) in columns, right-handed: the third one is the rays' direction
    """
    counts = np.zeros(len(places), np.int64)
    is_sure = np.ones(len(places), bool)
    rounding = _ON * np.abs(corners).max()
    for place, row in tree.ray_batches(places, axes[:, 2]):
        # view along the ray, which is at the origin
        seen = (corners[row] - places[place][:, None]) @ axes
        flat, depth = seen[:, :, :2], seen[:, :, 2]
        way = np.roll(flat, -1, axis=1) - flat
        past = np.einsum("nkx,nkx->nk", -flat, way)
        length = np.einsum("nkx,nkx->nk", way, way)
        part = np.clip(past / np.where(length > 0, length, 1.0), 0.0, 1.0)
        to_sides = np.linalg.norm(flat + part[:, :, None] * way, axis=2)
        is_near = (to_sides <= gaps[row]).any(axis=1)

        # it crosses triangles all of whose sides run around it in one way
        around = flat[:, :, 0] * way[:, :, 1] - flat[:, :, 1] * way[:, :, 0]
        is_crossed = (around > 0).all(axis=1) | (around < 0).all(axis=1)

        # the volume between the point and a triangle shows whether the triangle is ahead, or holds the point
        volume = np.einsum("nk,nk->n", around, np.roll(depth, 1, axis=1))
        edges = seen[:, 1:] - seen[:, :1]
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        is_on = is_crossed & (np.abs(volume) <= rounding * area)
        turn = np.sign(around[:, 0]).astype(np.int64)
        is_ahead = is_crossed & (volume * turn > 0)
        np.add.at(counts, place[is_ahead], turn[is_ahead])
        is_sure[place[is_near | is_on]] = False
    return counts, is_sure


def by_solid_angle(corners: Floats, places: Floats) -> Ints:
    """(n,) how often triangles (m, 3, 3) wind around points (n, 3), by the solid angle of each, rounded.

    Jacobson, Kavan and Sorkine-Hornung 2013.
    """
    igl = require_module("igl", "the distance to a surface", "distances")

    triangles = np.arange(3 * len(corners)).reshape(-1, 3)
    angles = igl.winding_number(np.ascontiguousarray(corners.reshape(-1, 3)), triangles, places)
    return np.rint(np.asarray(angles)).astype(np.int64)


def crossings_in_plane(ends: Floats, places: Floats) -> Ints:
    """(n,) how many of the lines (m, 2, 3) in the plane a ray from points (n, 3) along x crosses."""
    tree = BoxTree.build(outward(ends.min(axis=1), ends.max(axis=1), EQUAL))
    found = np.zeros(len(places), np.int64)
    for place, row in tree.ray_batches(places, np.array([1.0, 0.0, 0.0])):
        x, y = places[place, :2].T
        x0, y0 = ends[row, 0, :2].T
        x1, y1 = ends[row, 1, :2].T

        # lines from one side of the ray's line to the other, that meet it beyond the point
        across = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            meeting = x0 + (y - y0) / (y1 - y0) * (x1 - x0)
        np.add.at(found, place[across & (meeting > x)], 1)
    return found
