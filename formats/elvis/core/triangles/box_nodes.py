"""Corners and middles of boxes of several sizes, and which of them elements share.

Nodes of a cell lie on a lattice of half the smallest boxes.  The key of a node is linear in its place on this lattice:
the key of the middle between two nodes of a cell is the mean of their keys.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_ints
from elvis.core.base.errors import ElvisError
from elvis.core.quantities.expression import Expression
from elvis.core.triangles.cell_boxes import Boxes, CellBoxes
from elvis.core.triangles.cell_places import SAME_VALUE, CellPlaces, Cells, shared_numbers
from elvis.core.wall_curves.chains import SAME_PLACE


@cache
def _lattice(dimension: int) -> Ints:
    """(3^d, d) nodes of a divided box, in halves of the box; coordinates of middles are odd."""
    return frozen_ints(np.array(list(product(range(3), repeat=dimension))))


@cache
def _corners(dimension: int) -> Ints:
    """(2^d, d) corners of a box, each with its place by bits."""
    return frozen_ints(np.arange(1 << dimension)[:, None] >> np.arange(dimension) & 1)


class Split(NamedTuple):
    """Keys of edges (n, 2) or of faces (n, 4) of boxes that are divided, and of their middles (n,)."""

    corners: Ints
    middles: Ints


def _offsets(boxes: Sequence[CellBoxes]) -> Ints:
    """(groups + 1,) number of the first element of each group in the list of all elements."""
    counts = [max(int(own.leaves.rows.max()), int(own.divided.rows.max(initial=0))) + 1 for own in boxes]
    return np.concatenate([[0], np.cumsum(counts)])


class BoxNodes:
    """The nodes of the boxes of cells, in the order of their keys.

    keys     (n,)
    numbers  (n,) the same for nodes of several elements at one place where q is continuous
    values   of q by number, zero where it is rounding
    count    of numbers
    """

    def __init__(self, cells: Cells, level: Expression) -> None:
        self.cells, self.level = cells, level
        self.dimension = d = len(cells.boxes[0].splits)
        self._deepest = max(int(own.leaves.halvings.max()) for own in cells.boxes)
        self._counts = np.array([2 << (np.array(own.splits) + self._deepest) for own in cells.boxes])
        self._length = int(self._counts.max()) + 1
        self._offsets = _offsets(cells.boxes)
        if int(self._offsets[-1]) * self._length**d >= 1 << 63:
            raise ElvisError("expected a tolerance that some millions of triangles reach, found a smaller one")

        leaves = [self._keys(group, own.leaves, 2 * _corners(d)) for group, own in enumerate(cells.boxes)]
        self.leaves: Ints = np.concatenate(leaves)
        least = min(int(own.leaves.halvings.min()) for own in cells.boxes)
        divided = [own.divided.part(own.divided.halvings >= least) for own in cells.boxes]
        self._divided = np.concatenate([self._keys(group, own, _lattice(d)) for group, own in enumerate(divided)])
        is_outer = (_lattice(d) != 1).any(axis=1)
        self.keys: Ints = np.unique(np.concatenate([self.leaves.ravel(), self._divided[:, is_outer].ravel()]))
        self._number_all()

    def _keys(self, group: int, boxes: Boxes, lattice: Ints) -> Ints:
        """(n, k) keys of places (k, 3) of boxes, in halves of a box."""
        half = 1 << (self._deepest - boxes.halvings)
        places = half[:, None, None] * (2 * boxes.index[:, None, :] + lattice)
        powers = self._length ** np.arange(self.dimension - 1, -1, -1)
        start = (self._offsets[group] + boxes.rows) * self._length**self.dimension
        return np.asarray(start[:, None] + places @ powers)

    def places(self, keys: Ints) -> CellPlaces:
        """The places of nodes."""
        slot, rest = np.divmod(keys, self._length**self.dimension)
        lattice = np.stack(np.unravel_index(rest, (self._length,) * self.dimension), axis=1)
        group = np.searchsorted(self._offsets, slot, side="right") - 1
        return CellPlaces(group, slot - self._offsets[group], lattice / self._counts[group])

    def _number_all(self) -> None:
        """Number the nodes; only those on faces of cells may have one in common."""
        places = self.places(self.keys)
        found = self.cells.values(places, [self.level])[0]
        self._scale = float(np.abs(found).max(initial=0.0)) or 1.0
        found = self._rounded(found)
        is_outer = ((places.place == 0) | (places.place == 1)).any(axis=1)
        positions = self.cells.positions(places.part(is_outer))
        self._near = SAME_PLACE * float(np.abs(positions).max(initial=0.0))
        outer = shared_numbers(positions, found[is_outer], self._scale)
        shared = int(outer.max(initial=-1)) + 1
        self.count = shared + int((~is_outer).sum())
        self.numbers = np.empty(len(self.keys), np.int64)
        self.numbers[is_outer] = outer
        self.numbers[~is_outer] = np.arange(shared, self.count)
        first = np.unique(self.numbers, return_index=True)[1]
        self.values: Floats = found[first]
        # positions by number, unknown inside cells
        self._positions = np.full((self.count, 3), np.nan)
        self._positions[outer] = positions

    def _rounded(self, values: Floats) -> Floats:
        return np.where(np.abs(values) <= self.cells.noise, 0.0, values)

    def index(self, keys: Ints) -> Ints:
        """The rows of known keys, of any shape."""
        return np.searchsorted(self.keys, keys)

    def number(self, keys: Ints) -> Ints:
        """The numbers of known keys, of any shape."""
        return np.asarray(self.numbers[self.index(keys)])

    def edges(self) -> Split:
        """The edges of divided boxes."""
        lattice = _lattice(self.dimension)
        middle = np.flatnonzero((lattice == 1).sum(axis=1) == 1)
        step = self._steps()[(lattice[middle] == 1).argmax(axis=1)]
        ends = self._divided[:, np.stack([middle - step, middle + step], axis=1)]
        return Split(ends.reshape(-1, 2), self._divided[:, middle].ravel())

    def faces(self) -> Split:
        """The faces of divided boxes, in three dimensions."""
        found = []
        for middle in np.flatnonzero((_lattice(3) == 1).sum(axis=1) == 2):
            a, b = self._steps()[_lattice(3)[middle] == 1]
            found.append([middle - a - b, middle + a - b, middle + a + b, middle - a + b, middle])
        where = np.array(found)
        return Split(self._divided[:, where[:, :4]].reshape(-1, 4), self._divided[:, where[:, 4]].ravel())

    def _steps(self) -> Ints:
        """(d,) by how much the number of a node in its box rises along each axis."""
        return 3 ** np.arange(self.dimension - 1, -1, -1)

    def match(self, keys: Ints, numbers: Ints) -> Bools:
        """(n,) whether nodes (n,) have these numbers; new ones get them if their places and values are the same."""
        rows = self.index(keys).clip(max=len(self.keys) - 1)
        is_known = self.keys[rows] == keys
        found: Bools = is_known & (self.numbers[rows] == numbers)
        new = np.flatnonzero(~is_known & (numbers >= 0))
        keys, first, which = np.unique(keys[new], return_index=True, return_inverse=True)
        wanted = numbers[new][first]
        places = self.places(keys)
        away = np.abs(self.cells.positions(places) - self._positions[wanted]).max(axis=1, initial=0.0)
        change = np.abs(self._rounded(self.cells.values(places, [self.level])[0]) - self.values[wanted])
        is_same = (away <= self._near) & (change <= SAME_VALUE * self._scale)
        self._insert(keys[is_same], wanted[is_same])
        found[new] = is_same[which] & (wanted[which] == numbers[new])
        return found

    def add(self, keys: Ints, is_shared: bool) -> None:
        """Add nodes with new numbers; if shared, nodes of several elements at one place get the same number."""
        keys = np.setdiff1d(keys, self.keys)
        places = self.places(keys)
        values = self._rounded(self.cells.values(places, [self.level])[0])
        numbers = np.arange(len(keys))
        if is_shared:
            numbers = shared_numbers(self.cells.positions(places), values, self._scale)
        first = np.unique(numbers, return_index=True)[1]
        self._insert(keys, self.count + numbers)
        self.values = np.concatenate([self.values, values[first]])
        self.count += len(first)

    def _insert(self, keys: Ints, numbers: Ints) -> None:
        """Put nodes into their places by key."""
        where = np.searchsorted(self.keys, keys)
        self.keys = np.insert(self.keys, where, keys)
        self.numbers = np.insert(self.numbers, where, numbers)
