"""Places in cells of elements: where they are, what expressions are there, and which of them elements share."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.integrals.subcells import subcell_map, subcell_points
from elvis.core.mapping.orientation import chunks
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.triangles.cell_boxes import CellBoxes
from elvis.core.wall_curves.chains import places_by_number

#: points that are evaluated at a time
_AT_ONCE = 1 << 15
#: tolerance for values in elements that share a corner to count as one, relative to the largest
SAME_VALUE = 1e-9
#: Newton steps to a place in a small box
_NEWTON = 4


@dataclass(frozen=True, eq=False)
class CellPlaces(Rows):
    """Places (n, d) in [0, 1]^d of cells: numbers (n,) of groups of boxes, and rows (n,) of their patches."""

    group: Ints
    row: Ints
    place: Floats


@dataclass(frozen=True, eq=False)
class Cells:
    """Boxes of cells, grouped by cell, and the evaluator of expressions there.

    noise  magnitude of q up to which it counts as zero
    """

    evaluator: Evaluator
    boxes: Sequence[CellBoxes]
    noise: float = 0.0

    def points(self, places: CellPlaces) -> Iterator[tuple[Ints, ElementPoints, Floats]]:
        """Which of the places, as points of elements, with the derivatives (k, 3, 3) of cells' maps to elements."""
        for block, own in self._chunks(places):
            cell = np.full(len(own), block.cell)
            reference, columns = subcell_map(block.shape, cell, places.place[own])
            yield own, ElementPoints(self.evaluator.patches[block.patch], places.row[own], reference), columns

    def _chunks(self, places: CellPlaces) -> Iterator[tuple[CellBoxes, Ints]]:
        """Rows of places in the cells of each group."""
        order = np.argsort(places.group, kind="stable")
        ends = np.searchsorted(places.group[order], np.arange(len(self.boxes) + 1))
        for block, (start, stop) in zip(self.boxes, pairwise(ends.tolist()), strict=True):
            here = order[start:stop]
            yield from ((block, here[some]) for some in chunks(len(here), _AT_ONCE))

    def _plain_points(self, places: CellPlaces) -> Iterator[tuple[Ints, ElementPoints]]:
        """Which of the places, as points of elements."""
        for block, own in self._chunks(places):
            reference = subcell_points(block.shape, block.cell, places.place[own])
            yield own, ElementPoints(self.evaluator.patches[block.patch], places.row[own], reference)

    def positions(self, places: CellPlaces) -> Floats:
        """(n, 3) world coordinates."""
        found = np.empty((len(places), 3))
        for here, points in self._plain_points(places):
            found[here] = points.positions
        return found

    def values(self, places: CellPlaces, expressions: Sequence[Expression]) -> Floats:
        """(k, n) values of expressions."""
        found = np.empty((len(expressions), len(places)))
        for here, points in self._plain_points(places):
            for column, own in enumerate(self.evaluator.values_at(expressions, points)):
                found[column, here] = own
        return found

    def located(self, near: CellPlaces, goals: Floats) -> CellPlaces:
        """Places of positions (n, 3) in the cells of nearby places, by Newton's method; they may lie outside."""
        found = near
        for _ in range(_NEWTON):
            step = np.empty((len(near), 3))
            for here, points, columns in self.points(found):
                away = goals[here] - points.positions
                step[here] = np.linalg.solve(points.jacobians @ columns, away[..., None])[..., 0]
            found = replace(found, place=found.place + step)
        return found

    def orientations(self, places: CellPlaces) -> Floats:
        """(n,) determinants of the map from the cell to the world."""
        found = np.empty(len(places))
        for here, points, columns in self.points(places):
            found[here] = np.linalg.det(points.jacobians[:, : columns.shape[1]] @ columns)
        return found


@dataclass(frozen=True, eq=False)
class Marched:
    """Triangles in boxes, with their corners on the surface.

    nodes      (n,) corners of triangles, each in one of the cells that hold it
    triangles  (m, 3) rows of these; lines (m, 2) in 2D
    group      (m,) groups of boxes that hold the triangles
    row        (m,) rows of their patches
    places     (m, d, d) corners of triangles in their own cells
    """

    nodes: CellPlaces
    triangles: Ints
    group: Ints
    row: Ints
    places: Floats


def shared_numbers(points: Floats, values: Floats, scale: float) -> Ints:
    """(n,) numbers of places with values: of elements that share a place, one unless their values differ there."""
    places = places_by_number(points)
    order = np.lexsort([values, places])
    is_new = np.ones(len(order), bool)
    same_place = np.diff(places[order]) == 0
    is_new[1:] = ~same_place | (np.diff(values[order]) > SAME_VALUE * scale)
    found = np.empty(len(order), np.int64)
    found[order] = np.cumsum(is_new) - 1
    return found
