"""Export to VTK: one Lagrange cell an element, each with points of its own, so that jumps stay."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from elvis.converters.shared.exporting import Cell, Export, Piece, Target, exporter_of
from elvis.converters.vtk.cells import LAGRANGE, Kind
from elvis.converters.vtk.cells import Cell as VtkCell
from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.files.output import write_text
from elvis.core.shapes import Shape
from elvis.plugins.conversion.exporting import require
from elvis.plugins.conversion.nodal import affine_image, space_size

_TYPES = {shape: number for number, shape in LAGRANGE.items()}


class VtkTarget(Target):
    """Lagrange cells with evenly spaced nodes.

    Its pyramids cannot be evaluated at any order, so they are written as hexahedra.
    """

    highest, highest_pyramid, highest_prism = 10, 0, 10

    def __init__(self) -> None:
        self._known: dict[tuple[Shape, int], VtkCell] = {}

    def cell(self, shape: Shape, order: int) -> Cell:
        """The library's own nodes."""
        own = self._own(shape, order)
        assert own.frame is not None
        nodes = affine_image(own.nodes[:, : shape.dimension], own.frame, shape.vertices)
        return Cell(shape, order, own.kind.type, nodes)

    def table(self, cell: Cell, points: Floats) -> Floats:
        """The functions as the library evaluates them."""
        own = self._own(cell.shape, cell.order)
        assert own.frame is not None
        return own.at(affine_image(points, cell.shape.vertices, own.frame))

    def _own(self, shape: Shape, order: int) -> VtkCell:
        if (shape, order) not in self._known:
            self._known[shape, order] = VtkCell(Kind(_TYPES[shape], space_size(shape, order)), "export")
        return self._known[shape, order]


def write_vtu(path: Path, export: Export, time: float | None) -> None:
    """A .vtu file, binary and compressed; elements without a field have no number there."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    # the library writes to memory: it reports a full disk in its own way, and does not accept every name
    writer = vtkXMLUnstructuredGridWriter()
    writer.WriteToOutputStringOn()
    grid = grid_of(export, time)
    for number in range(len(export.names)):
        array = grid.GetPointData().GetAbstractArray(number)
        array.SetName(escape(array.GetName(), {'"': "&quot;"}))  # the library writes names without escaping
    writer.SetInputData(grid)
    writer.SetHeaderTypeToUInt64()
    if not writer.Write():
        raise ElvisError(f"{path}: cannot be written: VTK fails to create the file")
    write_text(path, writer.GetOutputString())


def _target() -> VtkTarget:
    """The cells; ElvisError without the library."""
    require("vtkmodules", "vtk")
    return VtkTarget()


#: the exporter of .vtu files
export_vtu = exporter_of(_target, lambda path, export, dataset: write_vtu(path, export, dataset.time))


def grid_of(export: Export, time: float | None) -> Any:
    """The library's grid, with fields at points, ids of elements at cells, and the time."""
    from vtkmodules.util.numpy_support import numpy_to_vtk

    grid = _grid(export)
    for number, name in enumerate(export.names):
        array = numpy_to_vtk(np.concatenate([_values(piece, number) for piece in export.pieces]), deep=True)
        array.SetName(name)
        grid.GetPointData().AddArray(array)
    ids = numpy_to_vtk(np.concatenate([piece.patch.element_ids for piece in export.pieces]), deep=True)
    ids.SetName("element")
    grid.GetCellData().AddArray(ids)
    if time is not None:
        stamp = numpy_to_vtk(np.array([time]), deep=True)
        stamp.SetName("TimeValue")
        grid.GetFieldData().AddArray(stamp)
    return grid


def _grid(export: Export) -> Any:
    """Points, cells and their types."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkUnstructuredGrid

    points = vtkPoints()
    points.SetData(numpy_to_vtk(np.concatenate([piece.places.reshape(-1, 3) for piece in export.pieces]), deep=True))
    counts = np.concatenate([np.full(len(piece.patch), len(piece.cell.nodes)) for piece in export.pieces])
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    cells = vtkCellArray()
    connectivity = np.arange(offsets[-1], dtype=np.int64)
    cells.SetData(numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(connectivity, deep=True))
    types = np.concatenate([np.full(len(piece.patch), piece.cell.number, np.uint8) for piece in export.pieces])
    grid = vtkUnstructuredGrid()
    grid.SetPoints(points)
    grid.SetCells(numpy_to_vtk(types, deep=True), cells)
    return grid


def _values(piece: Piece, number: int) -> Floats:
    """(n,) values of a field at the points of a piece."""
    values = piece.values[number]
    return np.full(piece.places.shape[:2], np.nan).reshape(-1) if values is None else values.reshape(-1)
