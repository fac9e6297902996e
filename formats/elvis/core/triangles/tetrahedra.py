"""Triangles in tetrahedra between corners with values of either sign.

Marching tetrahedra: Doi and Koide 1991, An efficient method of triangulating equi-valued surfaces by using tetrahedral
cells.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints, frozen_ints

#: corners of a tetrahedron whose edges from the first corner are right-handed
_CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def triangles_between(is_high: Bools) -> tuple[Ints, Ints]:
    """Rows (m,) and triangles (m, 3, 2) of right-handed tetrahedra with corners (n, 4) that are high or not.

    Each corner of a triangle lies on the edge between two of the corners 0 to 3.  Triangles are counter-clockwise seen
    from high corners.
    """
    case = is_high @ (1 << np.arange(4))
    rows, triangles = [], []
    for own in _TRIANGLES.transpose(1, 0, 2, 3):
        here = np.flatnonzero(own[case, 0, 0] >= 0)
        rows.append(here)
        triangles.append(own[case[here]])
    return np.concatenate(rows), np.concatenate(triangles)


def _table() -> Ints:
    """(16, 2, 3, 2) triangles of each case, numbered by the bits of high corners; -1 where there are none."""
    found = np.full((16, 2, 3, 2), -1)
    for bits in product((False, True), repeat=4):
        is_high = np.array(bits)
        case = int(is_high @ (1 << np.arange(4)))
        for number, triangle in enumerate(_of_case(np.flatnonzero(is_high), np.flatnonzero(~is_high))):
            found[case, number] = _turned(triangle, is_high)
    return frozen_ints(found)


def _of_case(high: Ints, low: Ints) -> list[Ints]:
    """The triangles (3, 2) between corners, in some order."""
    if len(high) == 2:
        (a, b), (c, d) = high, low
        around = np.array([(a, c), (a, d), (b, d), (b, c)])
        return [around[[0, 1, 2]], around[[0, 2, 3]]]
    edges = np.array(list(product(high, low)))
    return [edges] if len(edges) else []


def _turned(triangle: Ints, is_high: Bools) -> Ints:
    """A triangle counter-clockwise seen from high corners."""
    middles: Floats = _CORNERS[triangle].mean(axis=1)
    normal = np.cross(middles[1] - middles[0], middles[2] - middles[0])
    way = _CORNERS[is_high].mean(axis=0) - _CORNERS[~is_high].mean(axis=0)
    return triangle if normal @ way > 0 else triangle[::-1]


_TRIANGLES = _table()
