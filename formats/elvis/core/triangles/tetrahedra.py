"""Triangles in tetrahedra between corners with values of either sign, and lines in triangles.

Marching tetrahedra: Doi and Koide 1991, An efficient method of triangulating equi-valued surfaces by using tetrahedral
cells.
"""

from __future__ import annotations

from functools import cache
from itertools import product

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_ints


def parts_between(is_high: Bools) -> tuple[Ints, Ints]:
    """Rows (m,) and triangles (m, 3, 2) of right-handed tetrahedra with corners (n, 4) that are high or not.

    Of triangles with corners (n, 3): lines (m, 2, 2).  Each corner lies on the edge between two of the corners 0 to 3.
    Triangles are counter-clockwise seen from high corners; lines have these on their left.
    """
    case = is_high @ (1 << np.arange(is_high.shape[1]))
    rows, parts = [], []
    for own in np.moveaxis(_table(is_high.shape[1] - 1), 1, 0):
        here = np.flatnonzero(own[case, 0, 0] >= 0)
        rows.append(here)
        parts.append(own[case[here]])
    return np.concatenate(rows), np.concatenate(parts)


@cache
def _table(dimension: int) -> Ints:
    """(2^(d + 1), d - 1, d, 2) parts of each case, numbered by the bits of high corners; -1 where there are none."""
    found = np.full((2 << dimension, dimension - 1, dimension, 2), -1)
    for bits in product((False, True), repeat=dimension + 1):
        is_high = np.array(bits)
        case = int(is_high @ (1 << np.arange(dimension + 1)))
        for number, part in enumerate(_of_case(np.flatnonzero(is_high), np.flatnonzero(~is_high))):
            found[case, number] = _turned(part, is_high)
    return frozen_ints(found)


def _of_case(high: Ints, low: Ints) -> list[Ints]:
    """The triangles (3, 2) or lines (2, 2) between corners, in some order."""
    if len(high) == len(low):
        (a, b), (c, d) = high, low
        around = np.array([(a, c), (a, d), (b, d), (b, c)])
        return [around[[0, 1, 2]], around[[0, 2, 3]]]
    edges = np.array(list(product(high, low)))
    return [edges] if len(edges) else []


def _turned(part: Ints, is_high: Bools) -> Ints:
    """A triangle counter-clockwise seen from high corners, or a line with these on its left."""
    d = len(is_high) - 1
    corners: Floats = np.concatenate([np.zeros((1, d)), np.eye(d)])
    middles = corners[part].mean(axis=1)
    way = corners[is_high].mean(axis=0) - corners[~is_high].mean(axis=0)
    is_right = np.linalg.det(np.vstack([middles[1:] - middles[0], way])) > 0
    return part if is_right else part[::-1]
