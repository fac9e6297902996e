"""Nodal data: values at nodes of an element, evaluated anywhere.

For converters whose files hold nodal values: ``values @ NodalBasis(shape, order, nodes).at(points).T``.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from elvis.core.arrays import Floats, frozen_floats
from elvis.core.dataset import Expansion
from elvis.core.errors import ElvisError
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.collapse import collapse
from elvis.core.polynomials.expansion import mode_count, values
from elvis.core.polynomials.jacobi import jacobi
from elvis.core.shapes import Shape
from elvis.plugins.conversion import PyramidSpace

#: interpolation that loses more digits than this is refused
_WORST_CONDITION = 1e10

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


class NodalBasis:
    """The functions of a complete polynomial space that are 1 at one node and 0 at the others.

    nodes  (n, d) reference coordinates, as many as the space has functions; ElvisError where they don't determine them
    """

    def __init__(
        self, shape: Shape, order: int, nodes: Floats, pyramid: PyramidSpace = PyramidSpace.POLYNOMIAL
    ) -> None:
        self.shape, self.order, self.pyramid = shape, order, pyramid
        vandermonde = space_values(shape, order, np.asarray(nodes, np.float64), pyramid)
        if vandermonde.shape[0] != vandermonde.shape[1]:
            expected = f"{vandermonde.shape[1]} nodes for a {shape.label.lower()} of order {order}"
            raise ElvisError(f"expected {expected}, found {len(vandermonde)}")
        if not np.linalg.cond(vandermonde) < _WORST_CONDITION:
            raise ElvisError(f"expected nodes that determine a {shape.label.lower()} of order {order}")
        self._inverse = frozen_floats(np.linalg.inv(vandermonde))
        self._last: tuple[Floats, Floats] | None = None

    def at(self, points: Floats) -> Floats:
        """(n, n_nodes) values at reference points (n, d), so that ``nodal_values @ at(points).T`` are those there."""
        if self._last is None or self._last[0] is not points:
            table = space_values(self.shape, self.order, points, self.pyramid) @ self._inverse
            self._last = (points, frozen_floats(table))
        return self._last[1]


@lru_cache(maxsize=64)
def tensor_nodes(shape: Shape, nodes: tuple[float, ...]) -> Floats:
    """(n^d, d) the product of nodes on the line, first coordinate fastest; for segments, quadrilaterals, hexahedra."""
    axes = np.meshgrid(*(nodes,) * shape.dimension, indexing="ij")
    return frozen_floats(np.stack([axis.reshape(-1) for axis in axes[::-1]], axis=1))


def native_points(shape: Shape, frame: Floats, points: Floats) -> Floats:
    """Reference points (n, d) of a source in the coordinates of ``shape``.

    frame  (n_vertices, d) the source's reference coordinates of the vertices, in the local order of ``shape``
    """
    from elvis.plugins.projection.frames import affine_between

    matrix, offset = affine_between(np.asarray(frame, np.float64), shape.vertices)
    return np.asarray(points, np.float64) @ matrix.T + offset
