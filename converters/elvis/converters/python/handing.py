"""Datasets handed to other libraries of Python: PyVista and meshio, with the error that their cells make."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from elvis.converters.shared.exporting import exported
from elvis.converters.shared.linear import LinearCells, linear_cells
from elvis.converters.shared.unit import UNIT
from elvis.converters.vtk.export import VtkTarget, grid_of
from elvis.core.base.arrays import Ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.needing import require_module
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.plugins.conversion.exporting import Loss

#: numbers of VTK's linear cells (vtkCellType.h), and their names in meshio
_TYPES = {
    Shape.SEGMENT: (3, "line"),
    Shape.TRIANGLE: (5, "triangle"),
    Shape.QUADRILATERAL: (9, "quad"),
    Shape.TETRAHEDRON: (10, "tetra"),
    Shape.PYRAMID: (14, "pyramid"),
    Shape.PRISM: (13, "wedge"),
    Shape.HEXAHEDRON: (12, "hexahedron"),
}


def to_pyvista(
    dataset: Dataset,
    quantities: str | Sequence[str] | None = None,
    refinement: int | None = 2,
    max_error: float | None = None,
) -> Any:
    """A pyvista.UnstructuredGrid of the dataset.

    quantities  values at its points, as in `sample`; None for all fields
    refinement  every element is cut into linear cells, 2^refinement along an edge; None: every element becomes one
                Lagrange cell of its own order, which PyVista draws by linear pieces
    max_error   the largest permitted error, as a share of a quantity's range

    Cell data ``element`` are the ids of elements; each point belongs to one element, so jumps are preserved.  Field
    data ``error of NAME`` are the largest difference from the exact values, measured between the points, and its share
    of the range; ``error of coordinates`` measures the cells' shape.  Raises ElvisError if an error is larger than
    allowed, for Lagrange cells along Fourier directions, and without PyVista.

    >>> ds = elvis.read("wing.xml", "wing.fld")
    >>> elvis.to_pyvista(ds, "p", refinement=0).n_cells
    480
    """
    pyvista = require_module("pyvista", "to_pyvista", "notebook")
    losses: Sequence[Loss]
    if refinement is None:
        names = None if quantities is None else _fields(dataset, quantities)
        export = exported(dataset, names, None, VtkTarget())
        grid, losses = pyvista.wrap(grid_of(export, dataset.time)), export.losses
    else:
        linear = linear_cells(dataset, quantities, refinement)
        cells = {_TYPES[shape][0]: _in_order(shape, rows) for shape, rows in linear.cells.items()}
        grid, losses = pyvista.UnstructuredGrid(cells, linear.points), linear.losses
        grid.point_data.update(linear.values)
        grid.cell_data["element"] = np.concatenate([linear.element[shape] for shape in linear.cells])
        if dataset.time is not None:
            grid.field_data["TimeValue"] = np.array([dataset.time])
    _check(losses, max_error)
    for loss in losses:
        grid.field_data[f"error of {loss.name}"] = np.array([loss.error, loss.relative])
    return grid


def to_meshio(
    dataset: Dataset,
    quantities: str | Sequence[str] | None = None,
    refinement: int = 2,
    max_error: float | None = None,
) -> Any:
    """A meshio.Mesh of linear cells; arguments as for `to_pyvista`.

    Its ``info["errors"]`` has for the coordinates and each quantity ``error``, ``relative`` and the worst ``element``.
    Raises ElvisError as `to_pyvista`, and without meshio.

    >>> ds = elvis.read("wing.xml", "wing.fld")
    >>> elvis.to_meshio(ds, "p", refinement=0)
    <meshio mesh object>...
    """
    meshio = require_module("meshio", "to_meshio", "notebook")
    linear = linear_cells(dataset, quantities, refinement)
    _check(linear.losses, max_error)
    errors = {
        loss.name: {"error": loss.error, "relative": loss.relative, "element": loss.element} for loss in linear.losses
    }
    return meshio.Mesh(
        linear.points,
        [(_TYPES[shape][1], _meshio_order(shape, rows)) for shape, rows in linear.cells.items()],
        point_data=dict(linear.values),
        cell_data={"element": _elements(linear)},
        info={"errors": errors},
    )


def _elements(linear: LinearCells) -> list[Ints]:
    return [linear.element[shape] for shape in linear.cells]


def _in_order(shape: Shape, rows: Ints) -> Ints:
    """Cells (m, v) with their corners in VTK's order, which unit elements also use."""
    return np.asarray(rows[:, np.argsort(UNIT[shape].corners)])


def _meshio_order(shape: Shape, rows: Ints) -> Ints:
    """`_in_order` in the order of meshio, whose prisms are Gmsh's: both triangles have the other orientation."""
    own = _in_order(shape, rows)
    return own[:, [0, 2, 1, 3, 5, 4]] if shape is Shape.PRISM else own


def _fields(dataset: Dataset, quantities: str | Sequence[str]) -> list[str]:
    """The names of fields; raises ElvisError for other quantities."""
    names = [quantities] if isinstance(quantities, str) else list(quantities)
    for name in names:
        if name not in dataset:
            raise ElvisError(f"{name} is not a field: give a refinement, as cells of high order only contain fields")
    return names


def _check(losses: Iterable[Loss], bound: float | None) -> None:
    """Raise ElvisError if an error is beyond the bound."""
    for loss in losses:
        if bound is not None and not loss.is_within(bound):
            raise ElvisError(
                f"expected errors up to {bound:g} of the range, found {loss.relative:.3g} in {loss.name}: "
                "take a higher refinement"
            )
