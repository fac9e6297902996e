"""An order of vertices, and of each element's own, in which every shared triangle collapses at one vertex.

Format notes 2.3.  A triangle collapses at the vertex of highest rank.  Ranks are such that prisms can follow: vertices
joined by the edges between a prism's triangles rank together; and so that an apex ranks above the base of its pyramid.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Ints, distinct_sides, index_type
from elvis.core.mapping.orientation import chunks
from elvis.core.shapes import Shape
from elvis.plugins.projection.frames import orders
from elvis.plugins.projection.vertices import connected_labels

#: edges between the two triangles of a prism
_UPRIGHT = ((0, 3), (1, 2), (4, 5))

#: elements whose orders are chosen together
_ELEMENTS_AT_ONCE = 1 << 16
#: rounds after which pyramids stacked in circles remain unchanged
_ROUNDS = 64

#: local faces that are triangles, each collapsed at its last vertex
TRIANGLES: Mapping[Shape, tuple[tuple[int, ...], ...]] = {
    shape: tuple(face for face in shape.faces if len(face) == 3) for shape in Shape.of_dimension(3)
}


@dataclass(frozen=True, eq=False)
class Corners:
    """The vertices (n, n_vertices) of a block of native elements, numbered over the whole mesh, and its mirroring."""

    shape: Shape
    vertices: Ints
    is_mirrored: bool = False


def ranks(blocks: Sequence[Corners], count: int) -> Ints:
    """Rank (count,) of each vertex in the order, which equals the numbering unless a rule forbids it."""
    lines = np.arange(count)
    for block in blocks:
        if block.shape is Shape.PRISM:
            ends = np.concatenate([block.vertices[:, pair] for pair in _UPRIGHT])
            lines = connected_labels(lines, ends[:, 0], ends[:, 1])
    heights = _heights(blocks, lines)
    result = np.empty(count, index_type(count))
    result[np.lexsort((np.arange(count), lines, heights[lines]))] = np.arange(count)
    return result


def _heights(blocks: Sequence[Corners], lines: Ints) -> Ints:
    """Height of each line: at least one more than the heights of every base below an apex on it."""
    heights = np.zeros(len(lines), np.int64)
    pyramids = [lines[block.vertices] for block in blocks if block.shape is Shape.PYRAMID and len(block.vertices)]
    if not pyramids:
        return heights
    corners = np.concatenate(pyramids)
    for _ in range(_ROUNDS):
        wanted = heights[corners[:, :4]].max(axis=1) + 1
        if (heights[corners[:, 4]] >= wanted).all():
            break
        np.maximum.at(heights, corners[:, 4], wanted)
    return heights


def chosen_orders(block: Corners, rank: Ints) -> Ints:
    """(n,) which of the `orders` of its shape each element takes."""
    table = np.array(orders(block.shape, block.is_mirrored))
    chosen: NDArray[Any] = np.zeros(len(block.vertices), np.int8)
    if len(table) > 1:
        choose = _ascending if block.shape is Shape.TETRAHEDRON else _by_highest
        for part in chunks(len(chosen), _ELEMENTS_AT_ONCE):
            chosen[part] = choose(rank[block.vertices[part]], table)
    return chosen


def _by_highest(own: Ints, table: Ints) -> Ints:
    """The orders of prisms with ranks ``own`` (n, 6) of their vertices."""
    # the upright edge with the highest vertex becomes the collapsed one
    upright = np.stack([own[:, list(pair)].max(axis=1) for pair in _UPRIGHT], axis=1)
    highest = upright.argmax(axis=1)
    places = np.array([[set(pair) for pair in _UPRIGHT].index({order[4], order[5]}) for order in table])
    chosen: Ints = np.argsort(places)[highest]
    return chosen


def _ascending(own: Ints, table: Ints) -> Ints:
    """The order that puts the highest vertex last and the second highest before it, without changing the hand."""
    last_two = np.argsort(own, axis=1)[:, 2:]
    lookup = np.zeros(16, np.int64)
    lookup[table[:, 2] * 4 + table[:, 3]] = np.arange(len(table))
    chosen: Ints = lookup[last_two[:, 0] * 4 + last_two[:, 1]]
    return chosen


def conflicting_elements(blocks: Sequence[Corners], rank: Ints) -> list[Bools]:
    """Elements (n,) of each block in their chosen order that share a triangle collapsed differently by another.

    If two elements disagree, only the one that doesn't collapse the triangle at its highest vertex is listed.
    """
    marks = [np.zeros(len(block.vertices), bool) for block in blocks]
    views = [(i, rows) for i, b in enumerate(blocks) if b.shape.dimension == 3 for rows in TRIANGLES[b.shape]]
    ranked = [rank[block.vertices] for block in blocks]
    is_low = [_is_below_highest(ranked[i], face) for i, face in views]
    if not any(own.any() for own in is_low):
        return marks
    first, triangle = distinct_sides([(ranked[i], face) for i, face in views])

    # a triangle is disputed where the vertices at which it is collapsed are not all one
    collapsed = np.concatenate([ranked[i][:, face[2]] for i, face in views])
    lowest = np.full(len(first), np.iinfo(collapsed.dtype).max, collapsed.dtype)
    highest = np.full(len(first), -1, collapsed.dtype)
    np.minimum.at(lowest, triangle, collapsed)
    np.maximum.at(highest, triangle, collapsed)
    is_disputed = lowest < highest
    is_wrong = is_disputed[triangle] & np.concatenate(is_low)

    ends = np.cumsum([len(own) for own in is_low])[:-1]
    for (i, _), part in zip(views, np.split(is_wrong, ends), strict=True):
        marks[i] |= part
    return marks


def _is_below_highest(ranked: Ints, face: tuple[int, ...]) -> Bools:
    """(n,) whether a triangle is collapsed at another vertex than that of the highest rank.

    ranked  (n, n_vertices) ranks of the vertices of elements
    """
    first, second, collapsed = (ranked[:, vertex] for vertex in face)
    return np.asarray((collapsed < first) | (collapsed < second))
