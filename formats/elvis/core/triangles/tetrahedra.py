"""Boxes as tetrahedra, and the triangles in these between corners of either sign.

Each face of a box is cut by the diagonal from its corner with the lowest number, and each half is a tetrahedron with
the middle of the box.  (Marching tetrahedra: Doi and Koide 1991, An efficient method of triangulating equi-valued
surfaces by using tetrahedral cells.)
"""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.triangles.cell_places import OFFSETS

#: corners around each face of a box
_FACES = np.array([[0, 2, 6, 4], [1, 3, 7, 5], [0, 1, 5, 4], [2, 3, 7, 6], [0, 1, 3, 2], [4, 5, 7, 6]])
_MIDDLE = 8


def tetrahedra(numbers: Ints) -> Ints:
    """(n, 12, 4) corners, 0 to 8, of the tetrahedra of boxes whose corners and middles have numbers (n, 9)."""
    count = len(numbers)
    faces = numbers[:, _FACES]
    first = faces.argmin(axis=2)
    around = (first[:, :, None] + np.arange(4)) % 4
    turned = np.take_along_axis(np.broadcast_to(_FACES, (count, 6, 4)), around, axis=2)
    halves = np.concatenate([turned[:, :, [0, 1, 2]], turned[:, :, [0, 2, 3]]], axis=1)
    return np.concatenate([halves, np.full((count, 12, 1), _MIDDLE)], axis=2)


def triangles_between(corners: Ints, is_high: Bools) -> tuple[Ints, Ints]:
    """Tetrahedra (m,) and triangles (m, 3, 2) between corners of tetrahedra (n, 4) that are high and the other corners.

    A triangle has its corners on edges, each given by the two corners of the box that it joins; it goes
    counter-clockwise seen from the high corners, in the coordinates of the box.
    """
    count = is_high.sum(axis=1)
    rows, made = [], []
    for single in (True, False):
        here = np.flatnonzero(count == (1 if single else 3))
        tip = (is_high[here] == single).argmax(axis=1)
        own = corners[here]
        others = np.stack([own[np.arange(len(here)), (tip + k) % 4] for k in (1, 2, 3)], axis=1)
        tips = np.broadcast_to(own[np.arange(len(here)), tip][:, None], others.shape)
        rows.append(here)
        made.append(np.stack([tips, others], axis=2))
    here = np.flatnonzero(count == 2)
    order = np.argsort(~is_high[here], axis=1, kind="stable")
    a, b, c, d = np.take_along_axis(corners[here], order, axis=1).T
    quad = np.stack([np.stack(pair, axis=1) for pair in ((a, c), (a, d), (b, d), (b, c))], axis=1)
    rows += [here, here]
    made += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    row, triangles = np.concatenate(rows), np.concatenate(made)
    return row, _turned(triangles, corners[row], is_high[row])


def _turned(triangles: Ints, corners: Ints, is_high: Bools) -> Ints:
    """Triangles counter-clockwise seen from high corners; middles of edges stand for their corners."""
    middle = OFFSETS[triangles].sum(axis=2)
    normal = np.cross(middle[:, 1] - middle[:, 0], middle[:, 2] - middle[:, 0])
    places = OFFSETS[corners]
    high = is_high[:, :, None]
    way = _mean(places, high) - _mean(places, ~high)
    is_wrong = np.einsum("ni,ni->n", normal, way) < 0
    triangles = triangles.copy()
    triangles[is_wrong] = triangles[is_wrong][:, ::-1]
    return triangles


def _mean(places: Ints, chosen: Bools) -> Floats:
    return np.asarray((places * chosen).sum(axis=1) / chosen.sum(axis=1))
