"""Cells of one kind in grids of VTK; cells that several grids hold."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from elvis.converters.vtk.cells import BEZIER, LAGRANGE, Cell, Kind, shape_of
from elvis.converters.vtk.files import Grid
from elvis.core.base.arrays import Bools, Floats, Ints, distinct_bits, starts_of
from elvis.plugins.conversion.nodal import NodalValues

#: vertices of cells coincide if they are as near as this, as a share of the extent of the cells
_SAME_PLACE = 1e-6


@dataclass(eq=False)
class Part:
    """Cells of one kind of a grid: ``rows`` (n,) of the grid with their ``nodes`` (n, k), numbered from ``first``.

    companions  the same cells in other grids, with other fields
    """

    grid: Grid
    cell: Cell
    nodes: Ints
    rows: Ints
    first: int
    companions: list[Part] = field(default_factory=list)

    @property
    def is_rational(self) -> bool:
        """Whether the functions of the cells are quotients."""
        if self.cell.kind.type not in BEZIER or self.grid.weights is None:
            return False
        return bool(np.ptp(self.grid.weights[self.nodes]) > 0)

    def arrays(self, on_points: bool) -> dict[str, Floats]:
        """Arrays of the grid by name."""
        return self.grid.point_data if on_points else self.grid.cell_data

    def holder(self, name: str, on_points: bool) -> Part | None:
        """The part that has an array: this one or a companion."""
        return next((each for each in (self, *self.companions) if name in each.arrays(on_points)), None)

    def join(self, other: Part) -> Part:
        """Both, the one of higher order with the other as a companion."""
        high, low = (self, other) if self.cell.order >= other.cell.order else (other, self)
        high.companions, high.first = [*high.companions, low, *low.companions], min(high.first, low.first)
        low.companions = []
        return high

    def keep(self, mask: Bools) -> None:
        """Keep some of the cells, in all grids that have them."""
        if not mask.all():
            for each in (self, *self.companions):
                each.nodes, each.rows = each.nodes[mask], each.rows[mask]

    def places(self, nodes: Ints) -> Floats:
        """(..., 3) of nodes."""
        return np.asarray(self.grid.points[nodes], np.float64)

    def nodal(self, array: Floats) -> NodalValues:
        """An array (n, k) of the grid's points, on the cells."""
        weights = self.grid.weights if self.is_rational else None
        return NodalValues(array, self.cell, self.nodes, weights)

    def field(self, name: str, on_points: bool) -> NodalValues:
        """An array that this part has."""
        array = self.arrays(on_points)[name]
        return self.nodal(array) if on_points else NodalValues(array[self.rows][:, None], None)


def parts_of(grid: Grid, dimension: int, first: int) -> tuple[list[Part], int]:
    """The cells of each kind of a grid, without other dimensions, and the number of cells omitted."""
    counts, result, others = np.diff(grid.offsets), [], 0
    degrees = np.zeros((len(counts), 3), np.int64) if grid.degrees is None else grid.degrees
    keys = np.column_stack([grid.types, counts, degrees])
    keys[~np.isin(grid.types, [*LAGRANGE, *BEZIER]), 2:] = 0
    first_rows, which = distinct_bits(keys)
    kinds = keys[first_rows]
    for number in np.lexsort(kinds.T[::-1]).tolist():
        kind, count, *own = kinds[number].tolist()
        rows = np.flatnonzero((which == number) & (grid.ghosts == 0))
        shape = shape_of(kind, grid.file)
        if shape is None or shape.dimension != dimension:
            others += len(rows)
        elif len(rows):
            cell = Cell(Kind(kind, count, (own[0], own[1], own[2])), grid.file)
            nodes = grid.nodes[grid.offsets[rows][:, None] + np.arange(count)]
            result.append(Part(grid, cell, nodes, rows, first))
    return result, others


def drop_copies(parts: Sequence[Part]) -> int:
    """Drop the cells whose nodes coincide exactly with the nodes of an earlier cell; return their number.

    Parts of a mesh that overlap hold such copies, if the writer doesn't mark them as ghosts.
    """
    places = np.concatenate([np.zeros((0, 3)), *(part.places(part.nodes).reshape(-1, 3) for part in parts)])
    numbers = distinct_bits(places + 0.0)[1]  # 0.0 takes the sign of zeros
    starts = np.cumsum([0, *(part.nodes.size for part in parts)])
    by_width: dict[tuple[int, int], list[int]] = {}
    for i, part in enumerate(parts):
        by_width.setdefault((part.cell.kind.type, part.nodes.shape[1]), []).append(i)
    dropped = 0
    for alike in by_width.values():
        tables = [np.sort(numbers[starts[i] : starts[i + 1]].reshape(parts[i].nodes.shape), axis=1) for i in alike]
        is_first = np.zeros(sum(map(len, tables)), bool)
        is_first[distinct_bits(np.concatenate(tables))[0]] = True
        for i, kept in zip(alike, np.split(is_first, starts_of(tables)[1:-1]), strict=True):
            parts[i].keep(kept)
        dropped += int((~is_first).sum())
    return dropped


class PartsByPlace:
    """Lists of parts by the cell of a coarse lattice in which the marks of their first vertices lie.

    Means alone are equal for grids around one point, whose boxes differ.
    """

    def __init__(self, grids: Sequence[Grid]) -> None:
        ends = [end for grid in grids if len(grid.points) for end in (grid.points.min(axis=0), grid.points.max(axis=0))]
        # marks of parts that coincide differ by less
        self._margin = 2 * _SAME_PLACE * float(np.ptp(ends, axis=0).max()) if ends else 0.0
        self._width = 100 * self._margin or 1.0
        self._found: dict[tuple[float, ...], list[list[Part]]] = {}

    def add(self, parts: list[Part]) -> None:
        """Append a list."""
        cell = tuple(np.floor(_marks(parts) / self._width).tolist())
        self._found.setdefault(cell, []).append(parts)

    def coincident(self, parts: Sequence[Part]) -> list[Part] | None:
        """A list with the same cells as these parts."""
        return next((each for each in self._near(parts) if _coincide(each, parts)), None)

    def _near(self, parts: Sequence[Part]) -> Iterator[list[Part]]:
        """The lists whose marks are so near to the marks of these parts that the cells may coincide."""
        marks = _marks(parts)
        low, high = (np.floor((marks + shift) / self._width).tolist() for shift in (-self._margin, self._margin))
        cells = product(*(dict.fromkeys(ends) for ends in zip(low, high, strict=True)))
        return (each for cell in cells for each in self._found.get(cell, ()))


def _coincide(parts: Sequence[Part], others: Sequence[Part]) -> bool:
    """Whether two lists hold the same cells in the same order: shapes, numbers, and places of the vertices."""
    if len(parts) != len(others):
        return False
    for part, other in zip(parts, others, strict=True):
        if part.cell.shape is not other.cell.shape or not np.array_equal(part.rows, other.rows):
            return False
        own, place = (each.places(each.nodes[:, each.cell.vertex_nodes()]) for each in (part, other))
        if not np.allclose(own, place, rtol=0, atol=_SAME_PLACE * float(np.ptp(own, axis=(0, 1)).max())):
            return False
    return True


def _marks(parts: Sequence[Part]) -> Floats:
    """(9,) mean, least and greatest coordinates of the first vertices of all cells; 0 without cells."""
    first = [part.places(part.nodes[:, part.cell.vertex_nodes()[0]]) for part in parts]
    if not first:
        return np.zeros(9)
    every = np.concatenate(first)
    return np.concatenate([every.mean(axis=0), every.min(axis=0), every.max(axis=0)])
