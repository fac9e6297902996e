"""Matrices of complex discs that are near the identity: determinants, cofactors, solutions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.quantities import discs
from elvis.core.quantities.discs import Disc
from elvis.core.quantities.intervals import largest_solution

#: steps in which the enclosure of a solution is made smaller
_STEPS = 2

Matrix = Sequence[Sequence[Disc]]


def minor(a: Disc, b: Disc, c: Disc, d: Disc) -> Disc:
    """a d - b c."""
    return discs.minus(discs.times(a, d), discs.times(b, c))


def determinant(t: Matrix) -> Disc:
    """The determinant of a matrix with 2 or 3 rows, along its first row."""
    return reduce(discs.plus, map(discs.times, t[0], cofactors(t, 0)))


def cofactors(t: Matrix, row: int) -> list[Disc]:
    """A row of the matrix of cofactors: det(t) times the inverse, transposed."""
    d = len(t)
    if d == 2:
        zero, (one, two) = discs.number(0.0), t[1 - row % d]
        return [two, discs.minus(zero, one)] if row % d == 0 else [discs.minus(zero, two), one]
    below, above = t[(row + 1) % d], t[(row + 2) % d]
    return [minor(below[a], below[b], above[a], above[b]) for a, b in ((1, 2), (2, 0), (0, 1))]


def solution(t: Matrix, first: Sequence[Disc]) -> list[Disc]:
    """The solution g of t g = first, with t = 1 + R: g = first - R g; if it is bounded, t is regular on all discs."""
    one = discs.number(1.0)
    rest = [[discs.minus(own, one) if i == k else own for k, own in enumerate(row)] for i, row in enumerate(t)]
    return enclosed(rest, first)


def enclosed(rest: Matrix, first: Sequence[Disc]) -> list[Disc]:
    """The solution g of g = first - R g."""
    norm = _greatest([sum(np.abs(entry[0]) + entry[1] for entry in row) for row in rest])
    size = _greatest([np.abs(entry[0]) + entry[1] for entry in first])
    radius = largest_solution(size, norm)
    found: list[Disc] = [(0.0 * entry[0], radius) for entry in first]
    for _ in range(_STEPS):
        found = [_less(own, row, found) for own, row in zip(first, rest, strict=True)]
    return found


def _greatest(arrays: Sequence[Floats]) -> Floats:
    return reduce(np.maximum, arrays)


def _less(first: Disc, row: Sequence[Disc], found: Sequence[Disc]) -> Disc:
    """An entry of first - R g."""
    return reduce(discs.minus, (discs.times(*pair) for pair in zip(row, found, strict=True)), first)
