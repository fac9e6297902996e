"""Segments with common ends as chains."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints

#: maximum distance of equal ends, relative to the size of all segments
SAME_PLACE = 1e-8


def without_doubles(points: Floats) -> Ints:
    """(k,) rows of segments, without segments that another one covers.

    Points (n, 3, 3) are start, middle, end of each.
    """
    ends = places_by_number(points[:, [0, 2]].reshape(-1, 3)).reshape(-1, 2)
    middle = places_by_number(points[:, 1])
    key = np.column_stack([np.sort(ends, axis=1), middle])
    first = np.unique(key, axis=0, return_index=True)[1]
    return np.sort(first[ends[first, 0] != ends[first, 1]])


def places_by_number(points: Floats) -> Ints:
    """(n,) numbers of places: points (n, 3) that are close to each other have the same one."""
    if not len(points):
        return np.empty(0, np.int64)
    size = float(np.ptp(points, axis=0).max()) or 1.0
    numbers, steps = np.arange(len(points)), (points - points.min(axis=0)) / (4 * SAME_PLACE * size)
    # points on either side of a border between cells of this lattice share a cell of a lattice moved by half a cell
    for shift in np.stack(np.meshgrid(*[[0.0, 0.5]] * 3), axis=-1).reshape(-1, 3):
        cells = np.floor(steps + shift)
        numbers = _united(numbers, np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1))
    return numbers


def _united(numbers: Ints, groups: Ints) -> Ints:
    """(n,) the smallest number among points of one group or one number."""
    for _ in range(len(numbers)):
        least = np.full(groups.max() + 1, len(numbers))
        np.minimum.at(least, groups, numbers)
        after = least[groups]
        smallest = np.full(len(numbers), len(numbers))
        np.minimum.at(smallest, numbers, after)
        after = smallest[numbers]
        if np.array_equal(after, numbers):
            break
        numbers = after
    return numbers


def chains(ends: Ints) -> list[tuple[Ints, Bools, bool]]:
    """Segments as chains: (k,) rows in order, whether each is passed from its end to its start, whether it is closed.

    ends  (n, 2) numbers of the places at the start and the end of each segment
    Chains end where one or more than two segments meet.
    """
    at_place = defaultdict(list)
    for row, pair in enumerate(ends.tolist()):
        for side, place in enumerate(pair):
            at_place[place].append((row, side))
    is_left = np.ones(len(ends), bool)
    found = []
    forks = [place for place, own in at_place.items() if len(own) != 2]
    starts = [entry for place in forks for entry in at_place[place]]
    for row, side in [*starts, *((row, 0) for row in range(len(ends)))]:
        if is_left[row]:
            found.append(_chain(row, side, ends, at_place, is_left))
    return found


def _chain(
    row: int, side: int, ends: Ints, at_place: dict[int, list[tuple[int, int]]], is_left: Bools
) -> tuple[Ints, Bools, bool]:
    """The chain that begins with one end of a segment; its segments are removed from ``is_left``."""
    start, rows, reversed_ones = int(ends[row, side]), [], []
    while True:
        rows.append(row)
        reversed_ones.append(side == 1)
        is_left[row] = False
        place = int(ends[row, 1 - side])
        ahead = [entry for entry in at_place[place] if is_left[entry[0]]]
        if len(at_place[place]) != 2 or not ahead:
            return np.array(rows), np.array(reversed_ones), place == start and len(at_place[place]) == 2
        row, side = ahead[0]
