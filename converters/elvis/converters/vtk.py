"""VTK files: unstructured grids of linear, quadratic, Lagrange and Bezier cells.

The library reads, renumbers and evaluates the functions of its cells at points of the reference cell, which it does to
rounding; its search for a point in a curved cell is not used, for it follows linear pieces.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from elvis.converters.names import components
from elvis.converters.vtk_cells import BEZIER, LAGRANGE, Cell, Kind, shape_of
from elvis.converters.vtk_files import Grid, kind_of, read
from elvis.formats.arrays import Floats, Ints
from elvis.formats.errors import ElvisError, FormatError
from elvis.formats.quadrature import lobatto
from elvis.formats.shapes import Shape
from elvis.plugins.conversion import DOUBLE, SINGLE, Converter, Elements, Option, SourceField

#: cells whose edges tell where the nodes lie, and the share of an edge that a node may be off
_ENOUGH, _OFF = 2000, 1e-5


class Vtk(Converter):
    """Grids of one step, as one mesh."""

    format = "VTK unstructured grids (.vtu, .pvtu, .vtk, .vtm, .pvd)"
    keeps = "linear, quadratic, Lagrange and Bezier cells, point and cell data, blocks by name, time"
    loses = "cells of lower dimension, text arrays, slits between cells whose points coincide"
    needs = ("vtk",)
    options = (
        Option("nodes", "Where the nodes of Lagrange cells lie.", ("auto", "equispaced", "gll"), "auto"),
        Option("hexahedra", "How edges of Lagrange hexahedra are numbered.", ("as-read", "exchanged"), "as-read"),
        Option("step", "Which step of a series, counted from 0; the last by default."),
    )

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether all are unstructured grids or lists of them."""
        return bool(paths) and all(kind_of(path) for path in paths)

    def __init__(
        self, paths: Sequence[Path], nodes: str = "auto", hexahedra: str = "as-read", step: str | None = None
    ) -> None:
        if step is not None and not step.lstrip("-").isdigit():
            raise ElvisError(f"expected a number for --step, found {step!r}")
        self._grids = read(paths, -1 if step is None else int(step))
        self._cells: list[tuple[Grid, Cell, Ints, Ints]] = []
        self.blocks, self.notes = [], []
        self._collect(_dimension(self._grids, paths))
        self._check_edges(hexahedra)
        self._place_nodes(nodes)
        self.fields = [*self._fields(True), *self._fields(False)]
        self.time = self._grids[0].time
        self.precision = self._precision()

    def positions(self, block: Elements, points: Floats) -> Floats:
        """The points of the cells, combined by the functions of the nodes."""
        return self._combined(block, points, lambda grid: grid.points)

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """Values at the points of the cells combined likewise; cell data as they are."""
        is_on_points, name, component = field.key
        if is_on_points:
            return self._combined(block, points, lambda grid: grid.point_data[name][:, component : component + 1])[
                ..., 0
            ]
        grid, _, _, rows = self._cells[block.key]
        values = np.asarray(grid.cell_data[name][rows[block.rows], component], np.float64)
        return np.repeat(values[:, None], len(points), axis=1)

    def _combined(self, block: Elements, points: Floats, array: object) -> Floats:
        """(elements, points, k) values of an array (n, k) of the grid."""
        assert callable(array)
        grid, cell, nodes, _ = self._cells[block.key]
        own, table = nodes[block.rows], cell.table(points)
        values = np.asarray(array(grid)[own], np.float64)
        if grid.weights is None or cell.kind.type not in BEZIER:
            return np.asarray(np.matmul(table, values))
        weights = grid.weights[own][..., None]
        return np.asarray(np.matmul(table, values * weights) / np.matmul(table, weights))

    def _collect(self, dimension: int) -> None:
        """One block for the cells of one kind of each grid."""
        first, others = 0, 0
        for grid in self._grids:
            counts = np.diff(grid.offsets)
            degrees = np.zeros((len(counts), 3), np.int64) if grid.degrees is None else grid.degrees
            keys = np.column_stack([grid.types, counts, degrees])
            keys[~np.isin(grid.types, [*LAGRANGE, *BEZIER]), 2:] = 0
            kinds, which = np.unique(keys, axis=0, return_inverse=True)
            for number, (kind, count, *own) in enumerate(kinds.tolist()):
                rows = np.flatnonzero((which.reshape(-1) == number) & (grid.ghosts == 0))
                shape = shape_of(kind, grid.file)
                if shape is None or shape.dimension != dimension:
                    others += len(rows)
                elif len(rows):
                    self._add(grid, Cell(Kind(kind, count, (own[0], own[1], own[2])), grid.file), rows, first)
            first += len(counts)
        if others:
            self.notes = [f"{others} cells of lower dimension were left out"]

    def _add(self, grid: Grid, cell: Cell, rows: Ints, first: int) -> None:
        nodes = grid.nodes[grid.offsets[rows][:, None] + np.arange(cell.kind.nodes)]
        is_rational = cell.kind.type in BEZIER and grid.weights is not None and bool(np.ptp(grid.weights[nodes]) > 0)
        block = Elements(
            cell.shape,
            len(rows),
            cell.order,
            frame=cell.frame,
            ids=first + rows,
            region=grid.name,
            pyramid=cell.pyramid,
            is_polynomial=not is_rational,
            key=len(self._cells),
        )
        self.blocks = [*self.blocks, block]
        self._cells.append((grid, cell, nodes, rows))

    def _check_edges(self, hexahedra: str) -> None:
        """Exchange the nodes of two edges of Lagrange hexahedra where asked; FormatError where they look exchanged."""
        for i, (grid, cell, nodes, rows) in enumerate(self._cells):
            if cell.kind.type not in LAGRANGE or cell.shape is not Shape.HEXAHEDRON:
                continue
            pair = _upright(cell)
            if hexahedra == "exchanged":
                nodes = nodes.copy()
                nodes[:, np.concatenate(pair)] = nodes[:, np.concatenate(pair[::-1])]
                self._cells[i] = (grid, cell, nodes, rows)
            wrong = _exchanged(np.asarray(grid.points[nodes], np.float64), cell, pair)
            if wrong > len(nodes) / 2:
                raise FormatError(
                    f"expected nodes of edges near their edges, found those of two edges exchanged in {wrong} "
                    "hexahedra, as by a wrong version of the file; see --hexahedra",
                    file=grid.file,
                )

    def _place_nodes(self, nodes: str) -> None:
        """Move the nodes of Lagrange cells to Gauss-Lobatto places where asked, or where edges show them."""
        known = [(grid, cell, own) for grid, cell, own, _ in self._cells if cell.is_even and cell.order > 2]
        even, warped = np.sum([_votes(*each) for each in known], axis=0) if known else (0, 0)
        if nodes == "gll" or (nodes == "auto" and warped > even):
            for _, cell, _ in known:
                cell.warp()
            if nodes == "auto" and known:
                self.notes = [
                    *self.notes,
                    "nodes lie at Gauss-Lobatto places, which VTK doesn't expect, and were taken there (--nodes)",
                ]
        elif nodes == "auto" and known and not even:
            self.notes = [*self.notes, "all edges are curved; nodes were taken to be evenly spaced (--nodes)"]
        elif nodes == "equispaced" and warped > even:
            self.notes = [*self.notes, f"nodes of {warped} edges seem to lie at Gauss-Lobatto places (--nodes)"]

    def _fields(self, on_points: bool) -> list[SourceField]:
        """Point data, continuous where they agree; or cell data, constant."""
        arrays = [grid.point_data if on_points else grid.cell_data for grid, *_ in self._cells]
        taken = {name for grid in self._grids for name in grid.point_data} if not on_points else set()
        result = []
        for name in dict.fromkeys(name for each in arrays for name in each):
            widths = {each[name].shape[1] for each in arrays if name in each}
            if len(widths) > 1:
                found = " and ".join(map(str, sorted(widths)))
                raise FormatError(f"expected as many components everywhere, found {found}", place=f"array {name}")
            degrees = [
                None if name not in each else cell.order if on_points else 0
                for each, (_, cell, _, _) in zip(arrays, self._cells, strict=True)
            ]
            is_polynomial = all(block.is_polynomial for block in self.blocks) or not on_points
            label = f"{name}_cell" if name in taken else name
            result += [
                SourceField(each, degrees, on_points, is_polynomial, key=(on_points, name, i))
                for i, each in enumerate(components(label, widths.pop()))
            ]
        return result

    def _precision(self) -> float:
        arrays = [a for grid, *_ in self._cells for a in (grid.points, *grid.point_data.values())]
        return SINGLE if any(a.dtype == np.float32 for a in arrays) else DOUBLE


def _dimension(grids: Sequence[Grid], paths: Sequence[Path]) -> int:
    """The highest dimension of a cell; FormatError where there is none."""
    shapes = [shape_of(kind, grid.file) for grid in grids for kind in np.unique(grid.types[grid.ghosts == 0]).tolist()]
    dimension = max((shape.dimension for shape in shapes if shape is not None), default=0)
    if not dimension:
        raise FormatError("expected cells, found none", file=paths[0])
    return dimension


def _upright(cell: Cell) -> tuple[Ints, Ints]:
    """The nodes inside the edges over the corners (1, 1) and (0, 1), which two versions of files number differently."""
    inside = (cell.nodes[:, 2] > 0) & (cell.nodes[:, 2] < 1) & (cell.nodes[:, 1] == 1)
    return np.flatnonzero(inside & (cell.nodes[:, 0] == 1)), np.flatnonzero(inside & (cell.nodes[:, 0] == 0))


def _exchanged(places: Floats, cell: Cell, pair: tuple[Ints, Ints]) -> int:
    """In how many cells, nodes at (n, nodes, 3), both edges' nodes lie nearer the other edge's ends than their own."""
    if not len(pair[0]):
        return 0
    corners = places[:, cell.vertex_nodes()]
    middles = [(corners[:, low] + corners[:, high]) / 2 for low, high in ((2, 6), (3, 7))]
    found = [places[:, own].mean(axis=1) for own in pair]
    own, other = (
        sum(np.linalg.norm(found[i] - middles[j], axis=1) for i, j in pairs)
        for pairs in (((0, 0), (1, 1)), ((0, 1), (1, 0)))
    )
    return int(np.sum(other < own))


def _votes(grid: Grid, cell: Cell, nodes: Ints) -> tuple[int, int]:
    """How many edges are simple, with their nodes evenly spaced and with them at Gauss-Lobatto places.

    Simple is an edge that is a polynomial two degrees below the cell's order: nodes taken to lie elsewhere never are.
    """
    places = np.asarray(grid.points[nodes[:_ENOUGH][:, cell.edge_nodes()]], np.float64)
    length = np.linalg.norm(places[:, :, -1] - places[:, :, 0], axis=2)
    counts = []
    for line in (np.linspace(-1, 1, cell.order + 1), lobatto(cell.order + 1)[0]):
        powers = np.linalg.qr(np.vander(line, cell.order - 1))[0]
        rest = np.eye(cell.order + 1) - powers @ powers.T
        off = np.linalg.norm(np.matmul(rest, places), axis=3).max(axis=2)
        counts.append(int(np.sum((off < _OFF * length) & (length > 0))))
    return counts[0], counts[1]
