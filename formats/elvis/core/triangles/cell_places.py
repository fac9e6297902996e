"""Places in cells of elements: where they are, what expressions are there, and which of them elements share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.integrals.subcells import subcell_map
from elvis.core.mapping.orientation import chunks
from elvis.core.quantities.element_points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.triangles.level_cells import CellBoxes
from elvis.core.wall_curves.chains import places_by_number

#: corners of a box, each with its place by bits, and its middle, in halves of the box
OFFSETS = np.array([[2 * (k >> axis & 1) for axis in range(3)] for k in range(8)] + [[1, 1, 1]])
#: points that are evaluated at a time
_AT_ONCE = 1 << 15
#: tolerance for values in elements that share a corner to count as one, relative to the largest
_SAME_VALUE = 1e-9


@dataclass(frozen=True, eq=False)
class CellPlaces:
    """Places (n, 3) in [0, 1]^3 of cells: numbers (n,) of groups of boxes, and rows (n,) of their patches."""

    group: Ints
    row: Ints
    place: Floats

    def __len__(self) -> int:
        return len(self.group)

    def take(self, chosen: Ints | Bools) -> CellPlaces:
        """Some of them."""
        return CellPlaces(self.group[chosen], self.row[chosen], self.place[chosen])


@dataclass(frozen=True, eq=False)
class Cells:
    """Boxes of cells, grouped by cell, and the evaluator of expressions there."""

    evaluator: Evaluator
    boxes: Sequence[CellBoxes]

    def corners(self) -> tuple[CellPlaces, Ints]:
        """The corners and middles of all boxes, once in each cell, and their numbers (boxes, 9)."""
        found, numbers, start = [], [], 0
        for group, own in enumerate(self.boxes):
            counts = 2 * own.counts
            lattice = 2 * own.index[:, None, :] + OFFSETS
            rows = np.repeat(own.rows, len(OFFSETS))
            flat = np.column_stack([rows, lattice.reshape(-1, 3)])
            key = np.ravel_multi_index(tuple(flat.T), (int(rows.max()) + 1, *(counts + 1)))
            _, first, which = np.unique(key, return_index=True, return_inverse=True)
            found.append(CellPlaces(np.full(len(first), group), flat[first, 0], flat[first, 1:] / counts))
            numbers.append(start + which.reshape(-1, len(OFFSETS)))
            start += len(first)
        arrays = [np.concatenate(own) for own in zip(*((p.group, p.row, p.place) for p in found), strict=True)]
        return CellPlaces(*arrays), np.concatenate(numbers)

    def points(self, places: CellPlaces) -> Iterator[tuple[Ints, ElementPoints, Floats]]:
        """Which of the places, as points of elements, with the derivatives (k, 3, 3) of cells' maps to elements."""
        for group in np.unique(places.group).tolist():
            here = np.flatnonzero(places.group == group)
            block = self.boxes[group]
            patch = self.evaluator.patches[block.patch]
            for some in chunks(len(here), _AT_ONCE):
                own = here[some]
                cell = np.full(len(own), block.cell)
                reference, columns = subcell_map(block.shape, cell, places.place[own])
                yield own, ElementPoints(patch, places.row[own], reference), columns

    def positions(self, places: CellPlaces) -> Floats:
        """(n, 3) world coordinates."""
        found = np.empty((len(places), 3))
        for here, points, _ in self.points(places):
            found[here] = points.positions
        return found

    def values(self, places: CellPlaces, expressions: Sequence[Expression]) -> Floats:
        """(k, n) values of expressions."""
        found = np.empty((len(expressions), len(places)))
        for here, points, _ in self.points(places):
            for column, own in enumerate(self.evaluator.values_at(expressions, points)):
                found[column, here] = own
        return found

    def orientations(self, places: CellPlaces) -> Floats:
        """(n,) determinants of the map from the cell to the world."""
        found = np.empty(len(places))
        for here, points, columns in self.points(places):
            found[here] = np.linalg.det(points.jacobians @ columns)
        return found


def shared_numbers(points: Floats, values: Floats, scale: float) -> Ints:
    """(n,) numbers of places with values: of elements that share a place, one unless their values differ there."""
    places = places_by_number(points)
    order = np.lexsort([values, places])
    is_new = np.ones(len(order), bool)
    same_place = np.diff(places[order]) == 0
    is_new[1:] = ~same_place | (np.diff(values[order]) > _SAME_VALUE * scale)
    found = np.empty(len(order), np.int64)
    found[order] = np.cumsum(is_new) - 1
    return found
