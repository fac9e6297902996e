"""Boxes of several sizes as tetrahedra that meet face to face, in 2D as triangles.

A box is the union of tetrahedra between its middle and triangles of its faces.  A face that is divided on its other
side is divided here too, and an edge wherever a box at it is.  A face with undivided edges is cut by the diagonal from
its corner with the lowest number; one with divided edges is a fan around its middle.  Elements that share the nodes of
a face have the same numbers for them, and so cut it alike.  A box in 2D is the union of triangles between its middle
and the parts of its edges.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from elvis.core.base.arrays import Bools, Ints, joined_columns
from elvis.core.triangles.box_nodes import BoxNodes, Split

#: corners around each face of a box, counter-clockwise from outside
_FACES = np.array([[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]])

#: corners around a box in 2D
_SQUARE = np.array([0, 1, 3, 2])


class Quads(NamedTuple):
    """Parts of faces of boxes: rows (n,) of the boxes, and keys (n, 4) of the corners around each."""

    box: Ints
    corners: Ints

    def take(self, chosen: Bools) -> Quads:
        """Some of them."""
        return Quads(self.box[chosen], self.corners[chosen])


class _Middles:
    """Numbers of the middles of divided edges or faces, by the numbers of the corners of these."""

    def __init__(self, nodes: BoxNodes, split: Split) -> None:
        self._count = nodes.count
        corners = np.sort(nodes.number(split.corners), axis=1)
        pairs = [corners[:, k] * self._count + corners[:, k + 1] for k in range(0, corners.shape[1], 2)]
        self._pairs = [np.unique(own) for own in pairs]
        ids = [np.searchsorted(known, own) for known, own in zip(self._pairs, pairs, strict=True)]
        key = ids[0] if len(ids) == 1 else ids[0] * len(self._pairs[1]) + ids[1]
        self._known, first = np.unique(key, return_index=True)
        self._middles = nodes.number(split.middles)[first]

    def of(self, numbers: Ints) -> Ints:
        """(n,) numbers of the middles between corners with numbers (n, 2) or (n, 4); -1 where nothing is divided."""
        found = np.full(len(numbers), -1)
        if not len(self._known):
            return found
        corners = np.sort(numbers, axis=1)
        key, is_known = np.zeros(len(numbers), np.int64), np.ones(len(numbers), bool)
        for k, known in enumerate(self._pairs):
            pair = corners[:, 2 * k] * self._count + corners[:, 2 * k + 1]
            row = np.searchsorted(known, pair).clip(max=len(known) - 1)
            is_known &= known[row] == pair
            key = key * len(known) + row
        row = np.searchsorted(self._known, key).clip(max=len(self._known) - 1)
        is_known &= self._known[row] == key
        found[is_known] = self._middles[row[is_known]]
        return found


def conforming_simplices(nodes: BoxNodes) -> tuple[Ints, Ints]:
    """Rows (n,) of boxes, and the nodes (n, d + 1) of right-handed simplices with values of either sign.

    The first node is the middle of the box.
    """
    edges = _Middles(nodes, nodes.edges())
    sides = _triangles(nodes, edges) if nodes.dimension == 3 else _lines(nodes, edges)
    middles = (nodes.leaves[:, 0] + nodes.leaves[:, -1]) // 2
    nodes.add(middles, is_shared=False)
    found = nodes.index(np.column_stack([middles[sides.box], sides.corners]))
    is_high = nodes.values[nodes.numbers[found]] >= 0
    is_mixed = is_high.any(axis=1) & ~is_high.all(axis=1)
    return sides.box[is_mixed], found[is_mixed]


def _lines(nodes: BoxNodes, edges: _Middles) -> Quads:
    """Lines (n, 2) around boxes in 2D."""
    squares = Quads(np.arange(len(nodes.leaves)), nodes.leaves[:, _SQUARE])
    segments, _ = _segments(nodes, squares, edges)
    return Quads(*segments)


def _triangles(nodes: BoxNodes, edges: _Middles) -> Quads:
    """Triangles (n, 3) of the faces of boxes."""
    faces = _Middles(nodes, nodes.faces())
    box = np.repeat(np.arange(len(nodes.leaves)), len(_FACES))
    quads = Quads(box, nodes.leaves[:, _FACES].reshape(-1, 4))
    quads = _divided(nodes, quads, edges, faces)
    segments, is_fan = _segments(nodes, quads, edges)
    fans = quads.take(is_fan)
    nodes.add((fans.corners[:, 0] + fans.corners[:, 2]) // 2, is_shared=True)
    plain, fan = _halves(nodes, quads.take(~is_fan)), _fans(quads, segments, is_fan)
    return Quads(np.concatenate([plain.box, fan.box]), np.concatenate([plain.corners, fan.corners]))


def _divided(nodes: BoxNodes, quads: Quads, edges: _Middles, faces: _Middles) -> Quads:
    """Faces in the parts that boxes on their other sides have."""
    found = []
    while len(quads.box):
        corners = quads.corners
        numbers = nodes.number(corners)
        middle = faces.of(numbers)
        chosen = np.flatnonzero(middle >= 0)
        after = np.roll(corners[chosen], -1, axis=1)
        keys = np.column_stack([(corners[chosen] + after) // 2, (corners[chosen, 0] + corners[chosen, 2]) // 2])
        pairs = np.stack([numbers[chosen], np.roll(numbers[chosen], -1, axis=1)], axis=2)
        wanted = np.column_stack([_middles_of(edges, pairs), middle[chosen]])
        is_same = nodes.match(keys.ravel(), wanted.ravel()).reshape(-1, 5).all(axis=1)

        is_split = np.zeros(len(corners), bool)
        is_split[chosen[is_same]] = True
        found.append(quads.take(~is_split))
        quads = _quarters(quads.take(is_split), keys[is_same])
    return Quads(np.concatenate([own.box for own in found]), np.concatenate([own.corners for own in found]))


def _middles_of(edges: _Middles, pairs: Ints) -> Ints:
    """(n, k) numbers of the middles of edges (n, k, 2); an edge of no length has its end as the middle."""
    found = edges.of(pairs.reshape(-1, 2)).reshape(pairs.shape[:2])
    return np.where(pairs[..., 0] == pairs[..., 1], pairs[..., 0], found)


def _quarters(quads: Quads, keys: Ints) -> Quads:
    """The quarters of quads with middles of edges and of themselves (n, 5), each with its corner first."""
    parts = [
        np.column_stack([quads.corners[:, k], keys[:, k], keys[:, 4], keys[:, k - 1 if k else 3]]) for k in range(4)
    ]
    return Quads(np.tile(quads.box, 4), np.concatenate(parts))


class _Segments(NamedTuple):
    """Parts of edges of quads: rows (n,) of these, and keys (n, 2) of the ends in their order around."""

    quad: Ints
    ends: Ints


def _segments(nodes: BoxNodes, quads: Quads, edges: _Middles) -> tuple[_Segments, Bools]:
    """The edges of quads in the parts that boxes at them have, and which quads have divided edges."""
    is_fan = np.zeros(len(quads.box), bool)
    quad = np.repeat(np.arange(len(quads.box)), 4)
    ends = np.stack([quads.corners, np.roll(quads.corners, -1, axis=1)], axis=2).reshape(-1, 2)
    found = []
    while len(quad):
        numbers = nodes.number(ends)
        middle = np.where(numbers[:, 0] == numbers[:, 1], -1, edges.of(numbers))
        keys = ends.sum(axis=1) // 2
        is_split = middle >= 0
        is_split[is_split] = nodes.match(keys[is_split], middle[is_split])
        found.append(_Segments(quad[~is_split], ends[~is_split]))
        quad, ends, keys = quad[is_split], ends[is_split], keys[is_split]
        is_fan[quad] = True
        ends = np.concatenate([np.column_stack([ends[:, 0], keys]), np.column_stack([keys, ends[:, 1]])])
        quad = np.tile(quad, 2)
    return _Segments(*joined_columns(found)), is_fan


def _halves(nodes: BoxNodes, quads: Quads) -> Quads:
    """Triangles (n, 3) of quads, cut by the diagonal from the corner with the lowest number."""
    first = nodes.number(quads.corners).argmin(axis=1)
    around = np.take_along_axis(quads.corners, (first[:, None] + np.arange(4)) % 4, axis=1)
    return Quads(np.tile(quads.box, 2), np.concatenate([around[:, [0, 1, 2]], around[:, [0, 2, 3]]]))


def _fans(quads: Quads, segments: _Segments, is_fan: Bools) -> Quads:
    """Triangles (n, 3) between the middles of quads and the parts of their edges."""
    chosen = is_fan[segments.quad]
    quad = segments.quad[chosen]
    middles = (quads.corners[quad, 0] + quads.corners[quad, 2]) // 2
    return Quads(quads.box[quad], np.column_stack([middles, segments.ends[chosen]]))
