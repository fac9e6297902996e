"""Sides of elements on which a polynomial g is zero throughout: there the surface g = 0 is the side itself.

Levels are moved up slightly, so that such a surface lies in the adjacent element with g < 0.  If there is none, as on
an outer boundary or with g > 0 on both sides, the level is moved down in one of the elements.  If the zero has a higher
order, this moves the surface too far: it is in doubt.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.integrals.reference_cells import Piece, box_rule, side_corners, side_numbers, side_shape
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.tangents import determinants
from elvis.core.quantities.elements.points import Lattice

#: distance from a side, relative to the distance to the centre of the element, at which the sign of g is evaluated
_INWARDS = 2.0**-8

#: by how much g grows at least where the distance is doubled, if it has no simple zero
_NOT_SIMPLE = 3.0

#: values (n, q) of g at reference points (q, d) of rows (n,) of a patch
Values = Callable[[Patch, Ints, Floats], Floats]
#: tolerance (n,) within which g counts as zero in rows (n,) of a patch
Within = Callable[[Patch, Ints], Floats]


@dataclass(frozen=True, eq=False)
class Sides:
    """The sides of all elements.

    members    for each patch (n, sides) numbers of the sides of its elements
    is_joined  (m,) whether elements beyond a side have another side there
    """

    members: tuple[Ints, ...]
    is_joined: Bools


@dataclass(frozen=True, eq=False)
class Turned:
    """Elements of a patch in which the level is moved down.

    is_turned  (n,)
    doubt      (n,) area of sides on which the surface may be lost, or counted twice
    """

    is_turned: Bools
    doubt: Floats


@dataclass(frozen=True, eq=False)
class _ZeroSide:
    """A side of some elements of a patch on which g is zero.

    sign   (n,) of g next to it, 0 if it has both
    is_simple  (n,) whether the zero is of first order
    areas  (n,) at most
    """

    patch: int
    rows: Ints
    number: int
    side: Ints
    sign: Ints
    is_simple: Bools
    areas: Floats


def turned(
    patches: Sequence[Patch],
    sides: Sides,
    degrees: Sequence[int | None],
    values: Values,
    far: float,
    within: Within,
) -> tuple[Turned, ...]:
    """The elements of each patch in which the level is moved down.

    degrees  degrees of g in each patch, None if it is not a polynomial there
    far      a value that is certainly not zero
    """
    found = tuple(Turned(np.zeros(len(patch), bool), np.zeros(len(patch))) for patch in patches)
    zero = [
        own
        for number, (patch, degree) in enumerate(zip(patches, degrees, strict=True))
        if degree is not None
        for own in _zero_sides(number, patch, sides.members[number], degree, values, far, within)
    ]
    if zero:
        holders = _held(zero, sides, found)
        _doubt(zero, sides, holders, found)
    return found


def _held(zero: Sequence[_ZeroSide], sides: Sides, found: Sequence[Turned]) -> Ints:
    """(m, 2) patch and row of the element that is turned for a side, -1 for none."""
    is_held = sides.is_joined.copy()
    for own in zero:
        is_held[own.side[own.sign < 0]] = True
    holders = np.full((len(is_held), 2), -1)
    for own in zero:
        # the first element at each side that has no element yet
        side, first = np.unique(own.side, return_index=True)
        first = first[~is_held[side] & (own.sign[first] > 0)]
        is_held[own.side[first]] = True
        is_simple, rows = own.is_simple[first], own.rows[first]
        found[own.patch].is_turned[rows[is_simple]] = True
        np.add.at(found[own.patch].doubt, rows[~is_simple], own.areas[first[~is_simple]])
        holders[own.side[first], 0], holders[own.side[first], 1] = own.patch, rows
    return holders


def _doubt(zero: Sequence[_ZeroSide], sides: Sides, holders: Ints, found: Sequence[Turned]) -> None:
    """Add the areas of outer sides next to which g has both signs, and of other sides of turned elements."""
    every = np.concatenate([members.reshape(-1) for members in sides.members])
    count = np.bincount(every, minlength=len(sides.is_joined))
    for own in zero:
        is_other = (holders[own.side, 0] != own.patch) | (holders[own.side, 1] != own.rows)
        is_halved = (own.sign == 0) & (count[own.side] == 1) & ~sides.is_joined[own.side]
        is_doubtful = is_halved | (found[own.patch].is_turned[own.rows] & is_other)
        np.add.at(found[own.patch].doubt, own.rows[is_doubtful], own.areas[is_doubtful])


def _zero_sides(
    number: int, patch: Patch, members: Ints, degree: int, values: Values, far: float, within: Within
) -> Iterator[_ZeroSide]:
    """The sides of elements of a patch on which g is zero; it is so at the corners of an element first."""
    shape = patch.shape
    corners = values(patch, np.arange(len(patch)), shape.vertices)
    is_small = ~(np.abs(corners) > far)
    middle = shape.centre
    for own in side_numbers(shape):
        rows = np.flatnonzero(is_small[:, list(side_corners(shape, own))].all(axis=1))
        if not len(rows):
            continue
        side = Piece(patch, rows, side_shape(shape, own), own)
        points = side.points(box_rule((degree + 1,) * side.shape.dimension)[0])
        bound = within(patch, rows)
        is_zero = (np.abs(values(patch, rows, points)) <= bound[:, None]).all(axis=1)
        rows, bound = rows[is_zero], bound[is_zero]
        inside, farther = (values(patch, rows, points + part * (middle - points)) for part in (_INWARDS, 2 * _INWARDS))
        is_simple = (np.abs(farther) < _NOT_SIMPLE * np.abs(inside)).all(axis=1)
        sign = (inside > bound[:, None]).all(axis=1).astype(int) - (inside < -bound[:, None]).all(axis=1)
        if len(rows):
            yield _ZeroSide(number, rows, own, members[rows, own], sign, is_simple, _areas(side.part(is_zero), points))


def _areas(side: Piece, points: Floats) -> Floats:
    """(n,) areas of sides if they were everywhere as at the worst of some points (m, d)."""
    jacobians = Lattice(side.patch, side.rows, points).jacobians
    measures = np.abs(determinants(side.along(jacobians))).reshape(len(side), -1).max(axis=1)
    return np.asarray(measures * 2.0**side.shape.dimension)
