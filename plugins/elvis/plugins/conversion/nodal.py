"""Nodal data: values at nodes of elements, evaluated anywhere.

For converters whose files hold nodal values.  Such a converter derives from `NodalConverter`; its constructor makes a
block of `Elements` with a `NodalBlock` as key, and `add_field` takes in what the nodes carry.  `NodalBasis` are the
functions of nodes that determine a complete space.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from math import factorial
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.collapse import collapse
from elvis.core.polynomials.expansion import mode_count, values
from elvis.core.polynomials.jacobi import jacobi
from elvis.core.polynomials.kronecker import Lattice, RowMap, lagrange_factors, product_points
from elvis.core.shapes import TENSOR, Shape
from elvis.plugins.conversion.plugin import Converter, Elements, PyramidSpace, SourceField
from elvis.plugins.projection.frames import affine_between

#: letters of the components of vectors and tensors
_XYZ = "xyz"

#: interpolation that loses more digits than this is rejected
_WORST_CONDITION = 1e10

#: values of functions that are retained, all points together
_MOST_KEPT = 1 << 21

_LEGENDRE = Basis.ORTHO_A
_ORTHONORMAL = {
    Shape.SEGMENT: (_LEGENDRE,),
    Shape.TRIANGLE: (_LEGENDRE, Basis.ORTHO_B),
    Shape.QUADRILATERAL: (_LEGENDRE,) * 2,
    Shape.TETRAHEDRON: (_LEGENDRE, Basis.ORTHO_B, Basis.ORTHO_C),
    Shape.PYRAMID: (_LEGENDRE, _LEGENDRE, Basis.ORTHO_PYR_C),
    Shape.PRISM: (_LEGENDRE, _LEGENDRE, Basis.ORTHO_B),
    Shape.HEXAHEDRON: (_LEGENDRE,) * 3,
}


def orthonormal(shape: Shape, order: int) -> Expansion:
    """The Ortho expansion of degree ``order`` in every direction; on pyramids the polynomial one."""
    return Expansion(shape, _ORTHONORMAL[shape], (order + 1,) * shape.dimension)


def space_size(shape: Shape, order: int, pyramid: PyramidSpace = PyramidSpace.POLYNOMIAL) -> int:
    """Number of functions of the complete space of an order: of nodes that determine them."""
    if shape is Shape.PYRAMID and pyramid is PyramidSpace.TENSOR:
        return (order + 1) ** 3
    return mode_count(orthonormal(shape, order))


def space_values(shape: Shape, order: int, points: Floats, pyramid: PyramidSpace = PyramidSpace.POLYNOMIAL) -> Floats:
    """(n, m) values of a well-conditioned basis of the complete space of an order at reference points (n, d)."""
    if shape is Shape.PYRAMID and pyramid is PyramidSpace.TENSOR:
        return values(orthonormal(Shape.HEXAHEDRON, order), collapse(shape, points))
    if shape is Shape.PYRAMID and pyramid is PyramidSpace.RATIONAL:
        return _bergot(order, collapse(shape, points))
    return values(orthonormal(shape, order), points)


def _bergot(order: int, eta: Floats) -> Floats:
    """(n, m) P_i(e1) P_j(e2) c^k P_l^{2k+2,0}(e3), k = max(i, j), c = (1 - e3)/2, l <= order - k.

    Bergot, Cohen, Durufle, Higher-order finite elements for hybrid meshes using new nodal pyramidal elements, 2010.
    """
    first, second = (jacobi(order, 0, 0, eta[:, i]) for i in range(2))
    c, columns = (1 - eta[:, 2]) / 2, []
    for i, j in np.ndindex(order + 1, order + 1):
        k = max(i, j)
        vertical = jacobi(order - k, 2 * k + 2, 0, eta[:, 2]) * c**k
        columns += [first[i] * second[j] * vertical[low] for low in range(order - k + 1)]
    return np.stack(columns, axis=1)


def order_of_space(
    shape: Shape, count: int, highest: int, pyramid: PyramidSpace = PyramidSpace.POLYNOMIAL
) -> int | None:
    """The order, up to ``highest``, of the complete space of this many functions; None where there is none."""
    for order in range(highest + 1):
        if space_size(shape, order, pyramid) == count:
            return order
    return None


class ShapeFunctions(ABC):
    """Functions on a reference element, one for each of its nodes.

    order  of the smallest complete space that holds them
    """

    order: int

    def at(self, points: Floats) -> Floats:
        """(n, n_nodes) values at reference points (n, d), so that ``nodal_values @ at(points).T`` are those there.

        A few tables are retained, for the steps of a solver have the same points.
        """
        return self.to_points(points).matrix.T

    def to_points(self, points: Floats) -> RowMap:
        """The map from values (..., n_nodes) at the nodes to those (..., n) at reference points (n, d)."""
        own = np.asarray(points, np.float64)
        key = own.tobytes()
        if key not in self._maps:
            table = frozen_floats(self.tabulate(own))
            room = _MOST_KEPT - table.size
            while self._maps and sum(kept.matrix.size for kept in self._maps.values()) > room:
                del self._maps[next(iter(self._maps))]
            nodes = self.lattice
            self._maps[key] = RowMap(table.T, nodes, nodes and Lattice.of(own), lagrange_factors)
        return self._maps[key]

    @cached_property
    def _maps(self) -> dict[bytes, RowMap]:
        """Maps to points, by these."""
        return {}

    @property
    def lattice(self) -> Lattice | None:
        """The lattice that the nodes form, if the functions are products of Lagrange functions of lines; None else."""
        return None

    @abstractmethod
    def tabulate(self, points: Floats) -> Floats:
        """(n, n_nodes) values at reference points (n, d)."""


class NodalBasis(ShapeFunctions):
    """The functions of a complete polynomial space that are 1 at one node and 0 at the others.

    nodes  (n, d) reference coordinates, as many as the space has functions; ElvisError where they don't determine them
    """

    def __init__(
        self, shape: Shape, order: int, nodes: Floats, pyramid: PyramidSpace = PyramidSpace.POLYNOMIAL
    ) -> None:
        self.shape, self.order, self.pyramid = shape, order, pyramid
        vandermonde = self.space(np.asarray(nodes, np.float64))
        if vandermonde.shape[0] != vandermonde.shape[1]:
            expected = f"{vandermonde.shape[1]} nodes for a {shape.label.lower()} of order {order}"
            raise ElvisError(f"expected {expected}, found {len(vandermonde)}")
        if not np.linalg.cond(vandermonde) < _WORST_CONDITION:
            raise ElvisError(f"expected nodes that determine a {shape.label.lower()} of order {order}")
        self._inverse = frozen_floats(np.linalg.inv(vandermonde))
        self._nodes = nodes

    @property
    def lattice(self) -> Lattice | None:
        """See `ShapeFunctions`."""
        return Lattice.of(self._nodes) if self.shape in TENSOR else None

    def space(self, points: Floats) -> Floats:
        """(n, m) values of a basis of the space at reference points (n, d)."""
        return space_values(self.shape, self.order, points, self.pyramid)

    def tabulate(self, points: Floats) -> Floats:
        """The basis of the space, combined to be 1 at one node and 0 at the others."""
        return np.asarray(self.space(points) @ self._inverse)


class TensorBasis(ShapeFunctions):
    """The functions of a product of nodes on lines, one set per direction; the first is the fastest.

    lines  (m,) nodes on [-1, 1] of each direction of a segment, quadrilateral or hexahedron
    """

    def __init__(self, shape: Shape, lines: Sequence[Floats]) -> None:
        assert len(lines) == shape.dimension
        self.order = max(len(line) for line in lines) - 1
        self._lines = [NodalBasis(Shape.SEGMENT, len(line) - 1, line[:, None]) for line in lines]
        self._nodes = product_points(lines)

    @property
    def lattice(self) -> Lattice | None:
        """See `ShapeFunctions`."""
        return Lattice.of(self._nodes)

    def tabulate(self, points: Floats) -> Floats:
        """The products of the functions of the lines."""
        result = np.ones((len(points), 1))
        for axis, line in enumerate(self._lines):
            own = line.at(points[:, axis : axis + 1])
            result = (own[:, :, None] * result[:, None, :]).reshape(len(points), -1)
        return result


@dataclass(frozen=True, eq=False)
class NodalValues:
    """Values of c components at the nodes of m elements.

    values     (n, c) at nodes that elements share; or (m, k, c) where each has its own, (m, 1, c) where it is constant
    functions  of the k nodes; None where values are constant on each element
    nodes      (m, k) rows of shared values; None where each element has its own
    weights    (n,) of shared nodes whose functions are rational; None elsewhere
    """

    values: Floats
    functions: ShapeFunctions | None
    nodes: Ints | None = None
    weights: Floats | None = None

    @property
    def order(self) -> int:
        """Degree of the functions, 0 for constants."""
        return 0 if self.functions is None else self.functions.order

    @property
    def is_linear(self) -> bool:
        """Whether values are linear in those of `at_nodes`, which weights and overridden methods prevent."""
        kind = type(self)
        is_plain = (kind.component, kind.at) == (NodalValues.component, NodalValues.at)
        return is_plain and self.weights is None

    def component(self, number: int, rows: slice | Ints, points: Floats) -> Floats:
        """(r, n) values of a component at reference points (n, d) of elements ``rows``."""
        own = self.at_nodes(number, rows)
        if self.functions is None:
            return np.repeat(own, len(points), axis=1)
        to_points = self.functions.to_points(points)
        if self.weights is None:
            return to_points(own)
        weights = self._of(self.weights, rows)
        return np.asarray(to_points(own * weights) / to_points(weights))

    def at_nodes(self, number: int, rows: slice | Ints) -> Floats:
        """(r, k) values of a component at the nodes of elements ``rows``."""
        return self._of(self.values[..., number], rows)

    def at(self, rows: slice | Ints, points: Floats) -> Floats:
        """(r, n, c) values at reference points (n, d) of elements ``rows``."""
        first = self.component(0, rows, points)
        found = np.empty((*first.shape, self.values.shape[-1]))
        found[:, :, 0] = first
        del first
        for number in range(1, self.values.shape[-1]):
            found[:, :, number] = self.component(number, rows, points)
        return found

    def _of(self, values: Floats, rows: slice | Ints) -> Floats:
        """Values (r, k) of the elements ``rows``."""
        chosen = rows if self.nodes is None else self.nodes[rows]
        return np.ascontiguousarray(values[chosen], np.float64)


@dataclass(frozen=True, eq=False)
class NodalBlock:
    """Data of a `NodalConverter` for a block of elements: the positions of their nodes, and fields by name."""

    geometry: NodalValues
    fields: dict[Any, NodalValues] = field(default_factory=dict)


class NodalConverter(Converter):
    """A converter whose blocks have a `NodalBlock` as key, and whose fields were taken in by `add_field`."""

    def positions(self, block: Elements, points: Floats) -> Floats:
        """The places of the nodes, combined by their functions."""
        return self.nodal(block).geometry.at(block.rows, points)

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """The values at the nodes, combined by their functions."""
        name, component = field.key
        return self.nodal(block).fields[name].component(component, block.rows, points)

    def at_nodes(self, block: Elements, field: SourceField | None) -> tuple[Floats, Callable[[Floats], RowMap]] | None:
        """The values at the nodes, unless a subclass changes what follows from these."""
        kind = type(self)
        if (kind.positions if field is None else kind.sample) not in (NodalConverter.positions, NodalConverter.sample):
            return None
        if field is None:
            own = self.nodal(block).geometry
        else:
            name, component = field.key
            own = self.nodal(block).fields[name]
        if own.functions is None or not own.is_linear:
            return None
        if field is not None:
            return own.at_nodes(component, block.rows), own.functions.to_points
        columns = [own.at_nodes(number, block.rows) for number in range(own.values.shape[-1])]
        missing = [np.zeros_like(columns[0])] * (3 - len(columns))
        return np.stack([*columns, *missing], axis=1), own.functions.to_points

    @staticmethod
    def nodal(block: Elements) -> NodalBlock:
        """The nodal data of a block."""
        found: NodalBlock = block.key
        return found

    def clear_fields(self) -> None:
        """Forget all fields, so that others can be taken in on the same elements."""
        self.fields = []
        for block in self.blocks:
            self.nodal(block).fields.clear()

    def add_field(
        self,
        key: Any,
        labels: Sequence[str],
        values: Sequence[NodalValues | None],
        is_continuous: bool = False,
        is_polynomial: bool = True,
        orders: Sequence[int | None] | None = None,
    ) -> None:
        """Add a field for each of the components that ``labels`` name.

        key     of the values, unique for each call
        values  on each block, None for blocks without
        orders  on each block, if they differ from the values'
        """
        for block, own in zip(self.blocks, values, strict=True):
            if own is not None:
                self.nodal(block).fields[key] = own
        if orders is None:
            orders = [None if own is None else own.order for own in values]
        added = [
            SourceField(label, orders, is_continuous, is_polynomial, key=(key, i)) for i, label in enumerate(labels)
        ]
        self.fields = [*self.fields, *added]


def component_names(name: str, count: int) -> list[str]:
    """Names of the components of an array: letters for vectors and tensors, numbers for anything else."""
    if count == 1:
        return [name]
    if count in (2, 3):
        return [f"{name}_{axis}" for axis in _XYZ[:count]]
    if count in (4, 9):
        axes = _XYZ[: 2 if count == 4 else 3]
        return [f"{name}_{a}{b}" for a in axes for b in axes]
    return [f"{name}_{i}" for i in range(count)]


def bernstein(places: Floats, powers: Ints) -> Floats:
    """(n, m) Bernstein polynomials at barycentric coordinates (n, k): n! / prod a_i! times prod u_i^a_i.

    powers  (m, k) the a_i of each, whose sum is the order
    """
    orders = powers.sum(axis=1)
    factorials = np.array([factorial(n) for n in range(int(orders.max()) + 1)], np.float64)
    result = factorials[orders] / factorials[powers].prod(axis=1)
    for i in range(places.shape[1]):
        result = result * places[:, i : i + 1] ** powers[:, i]
    return np.asarray(result)


@bounded_cache
def tensor_nodes(shape: Shape, nodes: tuple[float, ...]) -> Floats:
    """(n^d, d) the product of nodes on the line, first coordinate fastest; for segments, quadrilaterals, hexahedra."""
    axes = np.meshgrid(*(nodes,) * shape.dimension, indexing="ij")
    return frozen_floats(np.stack([axis.reshape(-1) for axis in axes[::-1]], axis=1))


def nearest_nodes(nodes: Floats | Ints, places: Floats) -> Ints:
    """(m,) the node, of those at reference points (n, d), that is nearest to each of the points (m, d)."""
    distance = np.abs(nodes - places[:, None]).max(axis=2)
    return np.asarray(distance.argmin(axis=1), np.int64)


def affine_image(points: Floats, source: Floats, target: Floats) -> Floats:
    """Points (n, d) moved as the affine map does that takes the vertices ``source`` to ``target``, both (v, d)."""
    matrix, offset = affine_between(np.asarray(source, np.float64), np.asarray(target, np.float64))
    return np.asarray(np.asarray(points, np.float64) @ matrix.T + offset)


def native_points(shape: Shape, frame: Floats, points: Floats) -> Floats:
    """Reference points (n, d) of a source in the coordinates of ``shape``.

    frame  (n_vertices, d) the source's reference coordinates of the vertices, in the local order of ``shape``
    """
    return affine_image(points, frame, shape.vertices)
