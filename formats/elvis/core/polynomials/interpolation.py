"""Matrices from the nodes of a curved edge or face to Modified modes (format notes 1.5, 2.4), by family and order."""

from __future__ import annotations

from math import isqrt

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import FormatError
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.expansion import mode_indices, values
from elvis.core.polynomials.points import PointsType, nodes, triangle_nodes
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape

#: nodes along an edge beyond which interpolation in 64 bits has no digits left
MAX_NODES = 64

_BASES = {
    Shape.SEGMENT: (Basis.MODIFIED_A,),
    Shape.TRIANGLE: (Basis.MODIFIED_A, Basis.MODIFIED_B),
    Shape.QUADRILATERAL: (Basis.MODIFIED_A,) * 2,
    Shape.TETRAHEDRON: (Basis.MODIFIED_A, Basis.MODIFIED_B, Basis.MODIFIED_C),
    Shape.PYRAMID: (Basis.MODIFIED_A, Basis.MODIFIED_A, Basis.MODIFIED_PYR_C),
    Shape.PRISM: (Basis.MODIFIED_A, Basis.MODIFIED_A, Basis.MODIFIED_B),
    Shape.HEXAHEDRON: (Basis.MODIFIED_A,) * 3,
}


def modified(shape: Shape, modes: tuple[int, ...]) -> Expansion:
    """The Modified expansion of a shape, in which geometry is stored."""
    return Expansion(shape, _BASES[shape], modes)


def nodes_along(shape: Shape, family: PointsType, count: int) -> int:
    """Nodes along an edge of a curve of ``count`` nodes on a segment, triangle or quadrilateral.

    Raises FormatError if no such curve exists: n(n+1)/2 nodes of a triangular family, n^2 on other faces, 2 <= n <= 64.
    """
    if shape is Shape.SEGMENT:
        n, expected = count, count
    elif shape is Shape.TRIANGLE and family.is_triangular:
        n = (isqrt(8 * count + 1) - 1) // 2
        expected = n * (n + 1) // 2
    else:
        n = isqrt(count)
        expected = n * n
    if count != expected or not 2 <= n <= MAX_NODES:
        wanted = (
            f"a number of {family.label} nodes that fits a curved {shape.label.lower()} of order up to {MAX_NODES - 1}"
        )
        raise FormatError(f"expected {wanted}, found {count}")
    return n


@bounded_cache
def interpolation(shape: Shape, family: PointsType, n: int) -> Floats:
    """(nodes, n^d) matrix from the values at the nodes of a curve to Modified modes.

    shape  segment (d = 1), triangle or quadrilateral (d = 2); ``n`` nodes along an edge
    Mode (p, q) is column p * n + q; the columns of modes that a triangle hasn't are zero.
    """
    line = None if family.is_triangular else _line(family, n)
    if shape is Shape.SEGMENT and line is not None:
        return frozen_floats(line)
    if shape is Shape.QUADRILATERAL and line is not None:
        return frozen_floats(np.einsum("ip,jq->jipq", line, line).reshape(n * n, n * n))
    if shape is not Shape.TRIANGLE:
        raise FormatError(f"expected nodes for a {shape.label.lower()}, found {family.label}")

    # the modes of a triangle have places in the square
    inner = _nodal(family, n) if line is None else _collapse(line, n)
    p, q = mode_indices(modified(shape, (n, n))).T
    matrix = np.zeros((len(inner), n * n))
    matrix[:, p * n + q] = inner
    return frozen_floats(matrix)


def _inverse(matrix: Floats) -> Floats:
    return np.asarray(np.linalg.inv(matrix), np.float64)


def _line(family: PointsType, n: int) -> Floats:
    """(n, n) interpolation through nodes on the line, exact for degree n - 1."""
    return _inverse(values(modified(Shape.SEGMENT, (n,)), nodes(family, n)[:, None])).T


def _nodal(family: PointsType, n: int) -> Floats:
    """(nodes, m) interpolation through nodes on the triangle, exact for total degree n - 1."""
    return _inverse(values(modified(Shape.TRIANGLE, (n, n)), triangle_nodes(family, n))).T


def _collapse(line: Floats, n: int) -> Floats:
    """(n^2, m) projection of the interpolant on a lattice over the collapsed square.

    That interpolant has degree n - 1 in each collapsed coordinate; where it isn't in the space of the triangle, its
    best approximation in the mean is taken, with the weight (1 - eta2)/2 of the collapse.
    """
    (z1, w1), (z2, w2) = gauss(n), gauss(n, 1, 0)
    points = np.stack(np.meshgrid(z1, z2), axis=-1).reshape(-1, 2)
    weights = np.outer(w2, w1).reshape(-1)
    modes = values(modified(Shape.TRIANGLE, (n, n)), uncollapse(Shape.TRIANGLE, points))

    # lattice values -> quadrature points -> modes
    first, second = (values(modified(Shape.SEGMENT, (n,)), z[:, None]) @ line.T for z in (z1, z2))
    samples = np.einsum("ai,bj->jiba", first, second).reshape(n * n, n * n)
    weighted = modes * weights[:, None]
    return np.asarray(np.linalg.solve(modes.T @ weighted, weighted.T @ samples.T).T)


def lagrange_values(nodes: Floats, points: Floats) -> Floats:
    """(n, k) values at points (n,) of the Lagrange polynomials of nodes (k,)."""
    found = np.ones((len(points), len(nodes)))
    for i, node in enumerate(nodes):
        for other in np.delete(nodes, i):
            found[:, i] *= (points - other) / (node - other)
    return found
