"""Functions of VTK's cells: 1 at one node and 0 at the others, without VTK's library."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.converters.shared.incomplete import incomplete_functions
from elvis.converters.shared.unit import SIMPLEX_AXES, UNIT
from elvis.core.base.arrays import Floats, distinct_bits
from elvis.core.base.errors import ElvisError
from elvis.core.polynomials.quadrature import gauss, lobatto
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import NodalBasis, ShapeFunctions, native_points
from elvis.plugins.conversion.plugin import PyramidSpace

#: cells with a fixed number of nodes, only on edges
_SERENDIPITY = (23, 25, 26)


def family_line(family: str, order: int) -> Floats:
    """(order + 1,) the nodes of a family on [-1, 1]."""
    if family == "equispaced":
        return np.linspace(-1, 1, order + 1)
    return (lobatto if family == "gll" else gauss)(order + 1)[0]


class LagrangeFunctions(ShapeFunctions):
    """Lagrange functions, as products of functions of a triangle or tetrahedron and of lines.

    degrees  along the axes; equal for the axes of a triangle or tetrahedron
    nodes    (n, 3) evenly spaced in [0, 1]^3, in the order of the functions
    family   their positions: ``equispaced``, ``gll`` or ``gauss``
    """

    def __init__(self, shape: Shape, degrees: Sequence[int], nodes: Floats, family: str = "equispaced") -> None:
        self.order = max(degrees[: shape.dimension])
        simplex = SIMPLEX_AXES.get(shape, 0)
        self._factors: list[_Simplex | _Line] = []
        if simplex:
            self._factors.append(_Simplex(simplex, degrees[0], nodes, family))
        self._factors += [_Line(axis, degrees[axis], nodes, family) for axis in range(simplex, shape.dimension)]

    def tabulate(self, points: Floats) -> Floats:
        """The products, at points in the coordinates of the nodes."""
        tables = [factor.basis.at(2 * points[:, factor.axes] - 1)[:, factor.which] for factor in self._factors]
        return np.asarray(np.prod(tables, axis=0))


class _Simplex:
    """The functions of the triangle or tetrahedron whose axes are the first; ``which`` (n,) belongs to each node."""

    def __init__(self, axes: int, order: int, nodes: Floats, family: str) -> None:
        self.axes = slice(axes)
        lattice = np.rint(nodes[:, :axes] * order).astype(np.int64)
        rows, self.which = distinct_bits(lattice)
        shape = Shape.TRIANGLE if axes == Shape.TRIANGLE.dimension else Shape.TETRAHEDRON
        places = moved(shape, order, lattice[rows] / order, family)
        self.basis = NodalBasis(shape, order, 2 * places - 1)


class _Line:
    """The functions of the nodes on an axis, as in `_Simplex`."""

    def __init__(self, axis: int, order: int, nodes: Floats, family: str) -> None:
        self.axes = slice(axis, axis + 1)
        self.which = np.rint(nodes[:, axis] * order).astype(np.int64)
        self.basis = NodalBasis(Shape.SEGMENT, order, family_line(family, order)[:, None])


def fixed_functions(kind: int, shape: Shape, order: int, nodes: Floats) -> ShapeFunctions:
    """The functions of a type of cells of order 1 or 2 with a fixed number of nodes (n, 3); for pyramids of order 1."""
    if shape is Shape.PYRAMID:
        return NodalBasis(shape, order, shape.vertices, PyramidSpace.RATIONAL)
    if kind not in _SERENDIPITY:
        return LagrangeFunctions(shape, (order,) * 3, nodes)
    own = native_points(shape, UNIT[shape].frame, nodes[:, : shape.dimension])
    return _InUnit(shape, incomplete_functions(shape, order, False, own))


class _InUnit(ShapeFunctions):
    """Functions in reference coordinates, at points of the unit element."""

    def __init__(self, shape: Shape, functions: ShapeFunctions) -> None:
        self.order, self._shape, self._functions = functions.order, shape, functions

    def tabulate(self, points: Floats) -> Floats:
        """The functions."""
        return self._functions.at(native_points(self._shape, UNIT[self._shape].frame, points))


def is_tensor(shape: Shape) -> bool:
    """Whether a shape is a product of lines."""
    return bool(len(shape.vertices) == 2**shape.dimension)


def check_family(shape: Shape, family: str) -> None:
    """Raise ElvisError for Gauss points in shapes that are not products of lines."""
    if family == "gauss" and not is_tensor(shape):
        raise ElvisError(f"expected cells that are products of lines for the option nodes=gauss, found {shape.label}")


def moved(shape: Shape, order: int, nodes: Floats, family: str) -> Floats:
    """(n, 3) positions in a family of the equidistant nodes (n, 3) of a cell in [0, 1]^3.

    On simplices, every barycentric coordinate a moves by the sum over the others b of a b w(a - b), where w gives the
    edges Gauss-Lobatto nodes: Basix calls this lattice GLL warped.  Raises ElvisError for Gauss points there.
    """
    check_family(shape, family)
    line = (family_line(family, order) + 1) / 2
    result = line[np.rint(nodes * order).astype(np.int64)]
    simplex = SIMPLEX_AXES.get(shape, 0)
    if not simplex:
        return result
    a = np.concatenate([nodes[:, :simplex], 1 - nodes[:, :simplex].sum(axis=1, keepdims=True)], axis=1)
    shift = [sum(a[:, j] * _pull(order, line, a[:, i] - a[:, j]) for j in range(simplex + 1) if j != i)
             for i in range(simplex)]  # fmt: skip
    result[:, :simplex] = a[:, :simplex] * (1 + np.stack([np.asarray(s) for s in shift], axis=1))
    return result


def _pull(order: int, line: Floats, difference: Floats) -> Floats:
    """w of `warped`: the displacement of the nodes of an edge, interpolated, over r (1 - r), r = (1 + difference)/2."""
    even = np.linspace(-1, 1, order + 1)[:, None]
    basis = NodalBasis(Shape.SEGMENT, order, even)
    moved = basis.at(difference[:, None]) @ (line - (even[:, 0] + 1) / 2)
    bubble = (1 - difference**2) / 4
    return np.where(bubble > 1e-12, moved / np.maximum(bubble, 1e-12), 0.0)
