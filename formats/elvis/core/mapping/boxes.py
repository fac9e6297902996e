"""A bounding volume hierarchy over conservative boxes of elements, for the host and, as plain arrays, for devices.

Layout, which device code may rely on.  The tree is complete and binary, in heap order: node 0 is the root, the children
of node i are 2 i + 1 and 2 i + 2.  With L leaves (a power of two), the leaves are the last L of 2 L - 1 nodes.  Leaf j,
node L - 1 + j, holds the elements ``order[j * leaf : (j + 1) * leaf]``, fewer or none at the end.  A box is six 32-bit
floats, lower corner then upper corner, rounded outwards; an empty one has its lower corner at +inf, its upper corner at
-inf.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import EPS, Bools, Floats, Ints, corners_of
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import bernstein_coefficients, bernstein_space

Boxes = NDArray[np.float32]
#: whether boxes, some rows (k,) of them, meet things of these numbers (k,)
Meets = Callable[[Boxes, Ints, Ints], Bools]

#: part of their diagonal by which boxes are enlarged, so that points within tolerance of an element are in its box
MARGIN = 1e-9
#: unit roundings that a world coordinate of a point or of an element may be off by
ROUNDINGS = 16

_EMPTY = np.array([np.inf] * 3 + [-np.inf] * 3, np.float32)
#: numbers in an intermediate array
_BATCH = 1 << 21
#: and where several of them should stay in a processor's cache
_SMALL_BATCH = 1 << 17
#: boxes that are placed in a tree together
_BOXES_AT_ONCE = 1 << 16


def element_boxes(patch: Patch, margin: float = MARGIN) -> Boxes:
    """(n, 6) boxes that hold each element of a patch: the range of the Bernstein coefficients of its mapping.

    margin  relative enlargement of a box on each side, as part of its diagonal
    A box spans one period along homogeneous axes, from 0 to the length.
    """
    result = np.empty((len(patch), 6), np.float32)
    count = 3 * bernstein_space(patch.geometry).count
    for part in chunks(len(patch), max(1, _SMALL_BATCH // count)):
        low, high = _extents(patch, part)
        for axis, length in patch.periods:
            low[:, axis], high[:, axis] = 0.0, length
        result[part] = outward(low, high, margin)
    return result


def _extents(patch: Patch, part: slice) -> tuple[Floats, Floats]:
    """(n, 3) the smallest and the largest Bernstein coefficients of the maps of some elements of a patch."""
    if patch.corners is None:
        with np.errstate(invalid="ignore", over="ignore"):
            net = bernstein_coefficients(patch.geometry, patch.geometry_coefficients[part])
        return net.min(axis=2), net.max(axis=2)

    # straight elements have their vertices as coefficients
    first, *others = (patch.corners.vertices[rows] for rows in patch.corners.rows[part].T)
    low, high = first.copy(), first
    for points in others:
        np.minimum(low, points, out=low)
        np.maximum(high, points, out=high)
    return low, high


def outward(low: Floats, high: Floats, margin: float) -> Boxes:
    """Boxes slightly larger than the corners (n, 3), for any rounding; empty beyond the range of 32-bit floats.

    margin  part of the diagonal by which they are larger; rounding of the coordinates adds to it
    """
    with np.errstate(over="ignore", invalid="ignore"):
        greatest = np.maximum(np.abs(low), np.abs(high)).max(axis=1, keepdims=True)
        rounding = ROUNDINGS * EPS * greatest
        extra = margin * np.sqrt(3) * (high - low).max(axis=1, keepdims=True) + rounding
        inner = np.concatenate([low - extra, high + extra], axis=1)
        box = inner.astype(np.float32)
    box[:, :3] = np.where(box[:, :3] > inner[:, :3], np.nextafter(box[:, :3], np.float32(-np.inf)), box[:, :3])
    box[:, 3:] = np.where(box[:, 3:] < inner[:, 3:], np.nextafter(box[:, 3:], np.float32(np.inf)), box[:, 3:])
    box[~np.isfinite(box).all(axis=1)] = _EMPTY
    return box


@dataclass(frozen=True, eq=False)
class BoxTree:
    """The hierarchy; see the layout at the head of this module.

    boxes  (n, 6)        float32, of the elements
    order  (n,)          uint32, elements in the order of the leaves
    nodes  (2 L - 1, 6)  float32
    leaf                 elements of a leaf
    """

    boxes: Boxes
    order: NDArray[np.uint32]
    nodes: Boxes
    leaf: int

    @staticmethod
    def build(boxes: Boxes, leaf: int = 4) -> BoxTree:
        """The tree over ``boxes`` (n, 6), elements sorted along a space-filling curve of their centres."""
        leaves = 1 << max(0, -(-len(boxes) // leaf) - 1).bit_length()
        order = np.argsort(_morton(boxes), kind="stable").astype(np.uint32)
        nodes = np.empty((2 * leaves - 1, 6), np.float32)

        # leaves first, then every level over the one below
        for part in chunks(leaves, _BOXES_AT_ONCE):
            held = order[leaf * part.start : leaf * part.stop]
            padded = np.tile(_EMPTY, (leaf * (part.stop - part.start), 1))
            padded[: len(held)] = boxes[held]
            _enclose(padded.reshape(-1, leaf, 6), nodes[leaves - 1 + part.start : leaves - 1 + part.stop])
        count = leaves // 2
        while count:
            _enclose(nodes[2 * count - 1 : 4 * count - 1].reshape(-1, 2, 6), nodes[count - 1 : 2 * count - 1])
            count //= 2
        return BoxTree(boxes, order, nodes, leaf)

    @staticmethod
    def over(patches: Sequence[Patch], leaf: int = 4, margin: float = MARGIN) -> BoxTree:
        """The tree over all elements of some patches, numbered patch after patch."""
        boxes = [element_boxes(patch, margin) for patch in patches]
        return BoxTree.build(np.concatenate([np.empty((0, 6), np.float32), *boxes]), leaf)

    @property
    def leaves(self) -> int:
        """L, a power of two."""
        return (len(self.nodes) + 1) // 2

    def candidates(self, points: Floats) -> tuple[Ints, Ints]:
        """All pairs of a point (n, 3) and an element whose box holds it: point numbers and elements, (k,) each.

        Sorted by point, then by element.
        """
        return _sorted_pairs(self.candidate_batches(points))

    def overlaps(self, low: Floats, high: Floats) -> tuple[Ints, Ints]:
        """All pairs of a box with corners (n, 3) and an element whose box it meets, as `candidates` of points."""
        ends = np.ascontiguousarray(low), np.ascontiguousarray(high)
        return _sorted_pairs(self.batches(len(low), partial(meet, *ends)))

    def candidate_batches(self, points: Floats, size: int = 1 << 18) -> Iterator[tuple[Ints, Ints]]:
        """The pairs of `candidates` in no order; at most ``size`` pairs of points and nodes are examined together."""
        places = np.ascontiguousarray(points)
        return self.batches(len(points), partial(meet, places, places), size)

    def ray_batches(self, points: Floats, way: Floats, size: int = 1 << 18) -> Iterator[tuple[Ints, Ints]]:
        """The pairs of a ray from a point (n, 3), all of one direction (3,), and an element whose box it meets, in no
        order."""
        return self.batches(len(points), partial(_ray_meets, points, way), size)

    def batches(
        self, count: int, meets: Meets, size: int = 1 << 18, by_node: bool = False
    ) -> Iterator[tuple[Ints, Ints]]:
        """The pairs of one of ``count`` things and an element whose box it meets: of each thing in the tree's order.

        by_node  whether a batch has many things and few elements, so that ``meets`` can stop things that met enough
        """
        depth = self.leaves.bit_length() - 1
        stack = _split(0, np.arange(count), np.zeros(count, np.int64), size)
        while stack:
            level, point, node = stack.pop()
            held = meets(self.nodes, node, point)
            point, node = point[held], node[held]
            if level == depth:
                yield self._in_leaves(meets, point, node)
            elif len(point):
                children = 2 * node + np.array([[1], [2]])
                points = np.tile(point, (2, 1))
                if not by_node:
                    points, children = points.T, children.T
                stack += _split(level + 1, points.reshape(-1), children.reshape(-1), size)

    def _in_leaves(self, meets: Meets, point: Ints, node: Ints) -> tuple[Ints, Ints]:
        slots = (node[:, None] - (self.leaves - 1)) * self.leaf + np.arange(self.leaf)
        point, slots = np.repeat(point, self.leaf), slots.reshape(-1)
        inside = slots < len(self.order)
        point, element = point[inside], self.order[slots[inside]].astype(np.int64)
        held = meets(self.boxes, element, point)
        return point[held], element[held]


def _sorted_pairs(batches: Iterator[tuple[Ints, Ints]]) -> tuple[Ints, Ints]:
    """All pairs, by the first, then by the second."""
    none = np.empty(0, np.int64)
    point, element = map(np.concatenate, zip((none, none), *batches, strict=True))
    order = np.lexsort((element, point))
    return point[order], element[order]


def _enclose(boxes: Boxes, found: Boxes) -> None:
    """Fill ``found`` (n, 6) with boxes around several each (n, k, 6)."""
    found[:, :3], found[:, 3:] = boxes[:, :, :3].min(axis=1), boxes[:, :, 3:].max(axis=1)


def _split(level: int, point: Ints, node: Ints, size: int) -> list[tuple[int, Ints, Ints]]:
    """Pieces of pairs, the first one last, so that it is the next to be taken."""
    return [(level, point[part], node[part]) for part in chunks(len(point), size)][::-1]


def meet(low: Floats, high: Floats, boxes: Boxes, rows: Ints, which: Ints) -> Bools:
    """(k,) whether box ``rows`` (k,) meets that number ``which`` (k,) of those with corners (n, 3).

    All arrays are contiguous: then ``take`` is several times as quick as an index.
    """
    box, least = boxes.take(rows, axis=0), low.take(which, axis=0)
    greatest = least if high is low else high.take(which, axis=0)
    held = (box[:, :3] <= greatest) & (least <= box[:, 3:])
    return np.asarray(held[:, 0] & held[:, 1] & held[:, 2])


def _ray_meets(points: Floats, way: Floats, boxes: Boxes, rows: Ints, which: Ints) -> Bools:
    """(k,) whether box ``rows`` (k,) meets the ray number ``which`` (k,) of those from points (n, 3)."""
    box, start = boxes.take(rows, axis=0).T, points[which].T
    entry: Floats = np.zeros(len(rows))
    leaving: Floats = np.full(len(rows), np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for axis in range(3):
            # rays come in at this one of two sides; into empty boxes at infinity
            near, far = (axis, axis + 3) if way[axis] >= 0 else (axis + 3, axis)
            entry = np.maximum(entry, (box[near] - start[axis]) / way[axis])
            leaving = np.minimum(leaving, (box[far] - start[axis]) / way[axis])
    return np.asarray(entry <= leaving)


def _morton(boxes: Boxes) -> NDArray[np.uint64]:
    """(n,) 63-bit places of the centres along a Z-shaped curve through all of them."""

    def centres(part: slice) -> Floats:
        finite = np.isfinite(boxes[part]).all(axis=1, keepdims=True)
        corners = np.where(finite, boxes[part], 0).astype(np.float64)
        return np.asarray((corners[:, :3] + corners[:, 3:]) / 2)

    return _places_on_curve(len(boxes), centres)


def places_on_curve(points: Floats) -> NDArray[np.uint64]:
    """(n,) 63-bit places of points (n, 3) along a Z-shaped curve through all of them."""
    return _places_on_curve(len(points), lambda part: points[part])


def _places_on_curve(count: int, points_of: Callable[[slice], Floats]) -> NDArray[np.uint64]:
    """(count,) places of points, which are computed part by part, so that no table holds all of them."""
    if not count:
        return np.empty(0, np.uint64)
    parts = list(chunks(count, _BOXES_AT_ONCE))
    low, high = corners_of(*(corners_of(points_of(part)) for part in parts))
    width = np.where(high > low, high - low, 1.0)
    places = np.empty(count, np.uint64)
    for part in parts:
        cells = ((points_of(part) - low) / width * (2**21 - 1)).astype(np.uint64)
        x, y, z = (_spread(cells[:, axis]) << np.uint64(axis) for axis in range(3))
        places[part] = x | y | z
    return places


def _spread(bits: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """The 21 low bits with two zeros after each."""
    for shift, mask in _SPREAD:
        bits = np.bitwise_and(np.bitwise_or(bits, np.left_shift(bits, np.uint64(shift))), np.uint64(mask))
    return bits


_SPREAD = (
    (32, 0x001F00000000FFFF),
    (16, 0x001F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
