"""Vertices of a source's elements, identified by the source's numbers and by position."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import combinations, product

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, distinct_bits, groups, pair_numbers
from elvis.core.mapping.orientation import chunks

#: corners closer than this share of the nearest pair of corners of an element may be one vertex
_SHARE = 1e-3
#: corners that are compared together
_CORNERS_AT_ONCE = 1 << 16


def merge_vertices(numbers: Ints, corners: Floats, tolerance: float) -> tuple[Ints, Floats]:
    """The vertex (n,) of each corner and the position (m, 3) of each vertex.

    numbers  (n,) the source's number of each corner, -1 for corners without
    corners  (n, 3) positions of the corners; corners of one number at different positions are separate vertices
             (periodic meshes), corners without a number are one vertex if they coincide
    Vertices are numbered in the order of the source's numbers, then of the first corner.
    """
    if (numbers < 0).all():
        vertex = clusters(corners, tolerance)
        return vertex, corners[groups(vertex)[0]]
    first, which = groups(numbers)
    apart = np.zeros(len(numbers), np.bool_)
    for part in chunks(len(numbers), _CORNERS_AT_ONCE):
        distance = np.abs(corners[part] - corners[first[which[part]]])
        apart[part] = (distance > tolerance).any(axis=1)
    unsure = (numbers < 0) | np.isin(which, which[apart])
    if not unsure.any():
        return which, corners[first]

    # corners of one number fall into clusters; a vertex is a pair of number and cluster
    cluster = np.zeros(len(numbers), np.int64)
    rows = np.flatnonzero(unsure)
    cluster[rows] = clusters(corners[rows], tolerance)
    first, vertex = groups(pair_numbers(which, cluster, 1 + int(cluster.max())))
    return vertex, corners[first]


def clusters(points: Floats, tolerance: float) -> Ints:
    """(n,) number of the cluster of each point (n, 3): points within ``tolerance`` of one another are together.

    Clusters are numbered by their first point.
    """
    first, which = distinct_bits(points + 0.0)
    distinct, labels = points[first] + 0.0, first
    cell = max(4 * tolerance, np.finfo(float).tiny)
    for shift in product((0.0, 0.5), repeat=3):
        labels = _join(distinct, labels, np.floor(distinct / cell + np.array(shift)), tolerance)
    return np.asarray(groups(labels)[1][which])


def _join(points: Floats, labels: Ints, cells: Floats, tolerance: float) -> Ints:
    """The labels once points of a cell that lie together are joined: with its first, or else neighbours in order."""
    first, which = distinct_bits(cells)
    if len(first) == len(cells):
        return labels
    near = np.abs(points - points[first[which]]).max(axis=1, initial=0) <= tolerance
    far = np.zeros(len(first), bool)
    far[which[~near]] = True
    rows = np.flatnonzero(~far[which])
    labels = connected_labels(labels, rows, first[which[rows]])

    # in cells with several clusters, neighbours in the order of coordinates
    mixed = np.flatnonzero(far[which])
    order = mixed[np.lexsort((*points[mixed].T, which[mixed]))]
    same = which[order[1:]] == which[order[:-1]]
    near = np.abs(points[order[1:]] - points[order[:-1]]).max(axis=1, initial=0) <= tolerance
    pairs = np.flatnonzero(same & near)
    return connected_labels(labels, order[pairs], order[pairs + 1])


def connected_labels(labels: Ints, first: Ints, second: Ints) -> Ints:
    """The smallest label of each connected set, where item ``first[k]`` is connected to ``second[k]``.

    Equal labels also count as connected; a label must be the number of an item that bears it, or of none.
    """
    if not len(first):
        return labels
    parents = np.arange(max(int(labels.max(initial=0)) + 1, len(labels)))
    a, b = labels[first], labels[second]
    while True:
        low, high = np.minimum(parents[a], parents[b]), np.maximum(parents[a], parents[b])
        if (low == high).all():
            return parents[labels]
        np.minimum.at(parents, high, low)
        parents = _compress(parents)


def _compress(parents: Ints) -> Ints:
    """Parents replaced by the root that they lead to."""
    while True:
        grand: Ints = parents[parents]
        if np.array_equal(grand, parents):
            return parents
        parents = grand


def every_pair(count: int) -> Iterable[tuple[int, int]]:
    """All pairs of ``count`` corners."""
    return combinations(range(count), 2)


def neighbours(count: int) -> Iterable[tuple[int, int]]:
    """Pairs of each of ``count`` corners with the one before it, the first with the last."""
    return ((i, i - 1) for i in range(count))


def merging_tolerance(
    corners: Sequence[Floats], precision: float, pairs: Callable[[int], Iterable[tuple[int, int]]] = every_pair
) -> float:
    """Distance up to which corners (n, v, 3) of elements are one vertex: rounding, but never a real edge.

    corners  one array per kind of elements
    pairs    of the corners of an element with a number of corners, between which edges are expected
    """
    corners = [own for own in corners if own.size]
    if not corners:
        return 0.0
    lows, highs = zip(*((own.min(axis=(0, 1)), own.max(axis=(0, 1))) for own in corners), strict=True)
    low, high = np.min(lows, axis=0), np.max(highs, axis=0)
    rounding = 64 * precision * float(np.maximum(np.abs(low), np.abs(high)).max())
    box = (high - low).max()
    least = min(_shortest(own, pairs(own.shape[1])) for own in corners)
    return float(min(max(rounding, 1e-10 * box), _SHARE * least if np.isfinite(least) else rounding))


def _shortest(corners: Floats, pairs: Iterable[tuple[int, int]]) -> float:
    """The smallest distance between corners (n, v, 3) of a pair that lie apart; infinite without any."""
    least = np.inf
    for i, j in pairs:
        for rows in chunks(len(corners), _CORNERS_AT_ONCE):
            x, y, z = np.abs(corners[rows, i] - corners[rows, j]).T
            distances = np.maximum(np.maximum(x, y), z)
            apart: Bools = distances > 0
            least = min(least, float(distances[apart].min(initial=np.inf)))
    return least
