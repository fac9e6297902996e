"""Cells of VTK: shapes, orders, where nodes lie and the functions that go with them.

The library knows rare kinds, such as quadratic pyramids; all others need none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from elvis.converters.shared.unit import SIMPLEX_AXES, UNIT
from elvis.converters.vtk.functions import LagrangeFunctions, check_family, fixed_functions
from elvis.converters.vtk.lattices import fixed_nodes, lagrange_nodes
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.base.needing import is_there
from elvis.core.polynomials.collapse import collapse
from elvis.core.polynomials.kronecker import Lattice
from elvis.core.shapes import TENSOR, Shape
from elvis.plugins.conversion.discovery import installing
from elvis.plugins.conversion.nodal import ShapeFunctions, bernstein, nearest_nodes, order_of_space, space_size
from elvis.plugins.conversion.plugin import PyramidSpace

#: cells with a fixed number of nodes: shape, order, number of nodes (vtkCellType.h)
FIXED: dict[int, tuple[Shape, int, int]] = {
    3: (Shape.SEGMENT, 1, 2),
    5: (Shape.TRIANGLE, 1, 3),
    8: (Shape.QUADRILATERAL, 1, 4),
    9: (Shape.QUADRILATERAL, 1, 4),
    10: (Shape.TETRAHEDRON, 1, 4),
    11: (Shape.HEXAHEDRON, 1, 8),
    12: (Shape.HEXAHEDRON, 1, 8),
    13: (Shape.PRISM, 1, 6),
    14: (Shape.PYRAMID, 1, 5),
    21: (Shape.SEGMENT, 2, 3),
    22: (Shape.TRIANGLE, 2, 6),
    23: (Shape.QUADRILATERAL, 2, 8),
    24: (Shape.TETRAHEDRON, 2, 10),
    25: (Shape.HEXAHEDRON, 2, 20),
    26: (Shape.PRISM, 2, 15),
    27: (Shape.PYRAMID, 2, 13),
    28: (Shape.QUADRILATERAL, 2, 9),
    29: (Shape.HEXAHEDRON, 2, 27),
    30: (Shape.QUADRILATERAL, 2, 6),
    31: (Shape.PRISM, 2, 12),
    32: (Shape.PRISM, 2, 18),
    33: (Shape.HEXAHEDRON, 2, 24),
    34: (Shape.TRIANGLE, 3, 7),
    35: (Shape.SEGMENT, 3, 4),
    37: (Shape.PYRAMID, 3, 19),
}

_SHAPES = (Shape.SEGMENT, Shape.TRIANGLE, Shape.QUADRILATERAL, Shape.TETRAHEDRON, Shape.HEXAHEDRON, Shape.PRISM)
LAGRANGE: dict[int, Shape] = dict(zip(range(68, 74), _SHAPES, strict=True))
BEZIER: dict[int, Shape] = dict(zip(range(75, 81), _SHAPES, strict=True))

#: cells that are not elements: points, lines of many pieces
POINTS = (0, 1, 2)

#: kinds that readers may meet and that cannot be evaluated
_REFUSED = {4: "polylines", 6: "triangle strips", 7: "polygons", 42: "polyhedra", 74: "Lagrange pyramids",
            81: "Bezier pyramids"}  # fmt: skip

#: order of the complete space, for numbers of nodes with bubbles added to the quadratic ones
_BUBBLES = {(Shape.TRIANGLE, 7): 3, (Shape.TETRAHEDRON, 15): 4, (Shape.PRISM, 21): 3}

#: cells that may have different degrees in different directions
_GRADED = (70, 72, 73, 77, 79, 80)

_CENTRED_PYRAMID, _HIGHEST = 37, 30


def shape_of(kind: int, file: str) -> Shape | None:
    """The shape of a type of cells; None for single points; raises FormatError for unsupported types."""
    if kind in POINTS:
        return None
    if kind in FIXED:
        return FIXED[kind][0]
    found = LAGRANGE.get(kind) or BEZIER.get(kind)
    if found is None:
        name = _REFUSED.get(kind, "cells of another kind")
        expected = "linear, quadratic, Lagrange or Bezier cells"
        raise FormatError(f"expected {expected}, found {name} (type {kind})", file=file)
    return found


@dataclass(frozen=True)
class Kind:
    """Common data of cells: type, number of nodes, and degrees (i, j, k), zeros if the number determines them."""

    type: int
    nodes: int
    degrees: tuple[int, int, int] = (0, 0, 0)


class Cell(ShapeFunctions):
    """The reference cell of a kind.

    order     of the smallest complete space that holds its functions
    nodes     (n, 3) parametric coordinates of the nodes
    frame     (n_vertices, d) parametric coordinates of our vertices; None if points come in our coordinates
    Raises FormatError if the number of nodes fits no order; raises ElvisError for rare kinds without the library
    """

    def __init__(self, kind: Kind, file: str) -> None:
        shape = shape_of(kind.type, file)
        assert shape is not None
        self.kind, self.shape = kind, shape
        self.order = _order(kind, shape, file)
        self.degrees = kind.degrees if any(kind.degrees) and kind.type in _GRADED else (self.order,) * 3
        own = self._own_nodes()
        self._cell = _instance(kind) if own is None else None
        parametric = self._cell.GetParametricCoords() if self._cell is not None else own
        self.nodes: Floats = np.array(parametric, np.float64).reshape(-1, 3)
        self.pyramid = PyramidSpace.RATIONAL if kind.type == 14 else PyramidSpace.TENSOR
        self.frame = self._frame()
        self._functions = None if own is None else self._own_functions()

    def _own_nodes(self) -> Floats | None:
        """The nodes; None for rare kinds, which only the library knows."""
        if self.kind.type in FIXED:
            return fixed_nodes(self.kind.type, self.shape)
        is_complete = (self.shape, self.kind.nodes) not in _BUBBLES or self._is_space
        return lagrange_nodes(self.shape, self.degrees) if is_complete else None

    @property
    def lattice(self) -> Lattice | None:
        """See `ShapeFunctions`."""
        return Lattice.of(self.nodes[:, : self.shape.dimension]) if self.shape in TENSOR else None

    @property
    def _is_space(self) -> bool:
        """Whether there are as many nodes as the space of the order has functions."""
        return self.kind.nodes == space_size(self.shape, self.order)

    def _own_functions(self) -> ShapeFunctions | None:
        """The functions at points in the coordinates of the frame; None for Bezier cells."""
        if self.kind.type in BEZIER:
            return None
        if self.kind.type in LAGRANGE:
            return LagrangeFunctions(self.shape, self.degrees, self.nodes)
        return fixed_functions(self.kind.type, self.shape, self.order, self.nodes)

    def _frame(self) -> Floats | None:
        if self.kind.type == _CENTRED_PYRAMID:
            return self.nodes[:5]
        return None if self.shape is Shape.PYRAMID else UNIT[self.shape].frame

    def vertex_nodes(self) -> Ints:
        """The node at each of our vertices."""
        places = self.nodes[:5] if self.frame is None else self.frame
        return nearest_nodes(self.nodes[:, : places.shape[1]], places)

    def edge_nodes(self) -> Ints:
        """(edges, order + 1) nodes along each of our edges; Lagrange cells of one degree only."""
        corners, steps = self.nodes[self.vertex_nodes()], np.linspace(0, 1, self.order + 1)[:, None]
        lines = [corners[a] + steps * (corners[b] - corners[a]) for a, b in self.shape.edges]
        return nearest_nodes(self.nodes, np.concatenate(lines)).reshape(len(lines), -1)

    @property
    def is_even(self) -> bool:
        """Whether this is a Lagrange cell of one degree with as many nodes as its space has functions."""
        return self.kind.type in LAGRANGE and self._is_space

    def place_nodes(self, family: str) -> None:
        """Place the nodes at the points of a family, ``equispaced``, ``gll`` or ``gauss``, from now on.

        Raises ElvisError for Gauss points in shapes that are not products of lines.
        """
        if family == "equispaced":
            return
        check_family(self.shape, family)
        self._functions = LagrangeFunctions(self.shape, self.degrees, self.nodes, family)
        self._maps.clear()

    def tabulate(self, points: Floats) -> Floats:
        """(n, nodes) values of the functions of the nodes at points (n, d), in the coordinates of the frame."""
        if self._functions is not None:
            return self._functions.at(points)
        if self.frame is None:  # the parametric coordinates of these pyramids are collapsed ones
            points = (collapse(self.shape, points) + 1) / 2
        if self.kind.type in BEZIER:
            return self._bernstein(points)
        return self._by_library(points)

    def _by_library(self, points: Floats) -> Floats:
        """(n, nodes) values as the library finds them, point by point."""
        assert self._cell is not None
        padded = np.zeros((len(points), 3))
        padded[:, : points.shape[1]] = points
        weights, result = [0.0] * self.kind.nodes, np.empty((len(points), self.kind.nodes))
        for i, point in enumerate(padded.tolist()):
            self._cell.InterpolateFunctions(point, weights)
            result[i] = weights
        return result

    def _bernstein(self, points: Floats) -> Floats:
        """(n, nodes) Bernstein polynomials, which the library finds point by point, on tetrahedra by recursion."""
        axes = SIMPLEX_AXES.get(self.shape, 0)
        degrees = self.kind.degrees if any(self.kind.degrees) else (self.order,) * 3
        indices = np.rint(self.nodes * degrees).astype(np.int64)
        result = np.ones((len(points), self.kind.nodes))
        if axes:
            last = 1 - points[:, :axes].sum(axis=1)
            powers = indices[:, :axes]
            powers = np.column_stack([powers, degrees[0] - powers.sum(axis=1)])
            result *= bernstein(np.column_stack([points[:, :axes], last]), powers)
        for axis in range(axes, self.shape.dimension):
            along, powers = points[:, axis], indices[:, axis]
            both = np.column_stack([powers, degrees[axis] - powers])
            result *= bernstein(np.column_stack([along, 1 - along]), both)
        return result


def _order(kind: Kind, shape: Shape, file: str) -> int:
    if kind.type in FIXED:
        _, order, nodes = FIXED[kind.type]
        if nodes != kind.nodes:
            raise FormatError(f"expected {nodes} nodes in cells of type {kind.type}, found {kind.nodes}", file=file)
        return order
    if any(kind.degrees):
        if _full(shape, kind.degrees) == kind.nodes and max(kind.degrees) <= _HIGHEST:
            return max(kind.degrees[: shape.dimension])
        expected = f"nodes of a {shape.label.lower()} of degrees {kind.degrees}"
        raise FormatError(f"expected {expected}, found {kind.nodes}", file=file)
    complete = order_of_space(shape, kind.nodes, _HIGHEST)
    if complete:
        return complete
    if (shape, kind.nodes) in _BUBBLES and kind.type in LAGRANGE:
        return _BUBBLES[shape, kind.nodes]
    expected = f"as many nodes as a {shape.label.lower()} of some order up to {_HIGHEST} has"
    raise FormatError(f"expected {expected}, found {kind.nodes}", file=file)


def _full(shape: Shape, degrees: tuple[int, int, int]) -> int:
    """Nodes of a cell of these degrees; for simplices the degrees are equal."""
    i, j, k = degrees
    if shape in (Shape.QUADRILATERAL, Shape.SEGMENT, Shape.HEXAHEDRON):
        return int(np.prod([n + 1 for n in degrees[: shape.dimension]]))
    if shape is Shape.PRISM:
        return (i + 1) * (i + 2) // 2 * (k + 1) if i == j else 0
    return (i + 1) * (i + 2) // 2 if shape is Shape.TRIANGLE else (i + 1) * (i + 2) * (i + 3) // 6


def _instance(kind: Kind) -> Any:
    """A cell of the library with room for its nodes, of the right degrees; raises ElvisError without the library."""
    if not is_there("vtkmodules"):
        raise ElvisError(
            f"cells of type {kind.type} need the library vtk, which is not installed; {installing('vtk')} installs it"
        )
    from vtkmodules.vtkCommonDataModel import vtkGenericCell

    cell = vtkGenericCell.InstantiateCell(kind.type)
    cell.GetPoints().SetNumberOfPoints(kind.nodes)
    cell.GetPointIds().SetNumberOfIds(kind.nodes)
    if any(kind.degrees) and kind.type in _GRADED:
        wedge = (kind.nodes,) if kind.type in (73, 80) else ()
        cell.SetOrder(*kind.degrees[: cell.GetCellDimension()], *wedge)
    elif hasattr(cell, "SetUniformOrderFromNumPoints"):
        cell.SetUniformOrderFromNumPoints(kind.nodes)
    if hasattr(cell, "Initialize"):
        cell.Initialize()
    return cell
