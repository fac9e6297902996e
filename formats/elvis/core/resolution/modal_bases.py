"""Graded orthonormal bases of every expansion, and the transforms of coefficients into them.

An expansion is a product of factors.  A factor is one direction of a tensor shape, the triangle or the line of a prism,
or a whole simplex or pyramid.  The spaces V_0 ⊂ V_1 ⊂ … ⊂ V_p of a factor are those of its own bases with fewer modes:
V_k has k + 1 modes in every direction, at most those of the factor, and V_0 holds the constants.  The functions of
level k are an orthonormal basis of the part of V_k that is orthogonal to V_(k-1), in the inner product of the reference
shape.  On a line these are the Legendre polynomials, on a triangle those of degree k that are orthogonal to all lower
ones (Dubiner 1991, Spectral methods on triangles and other domains).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, frozen_ints, grid_points
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.cubature import COLLAPSE
from elvis.core.polynomials.expansion import FOURIER, product_plan, values
from elvis.core.polynomials.quadrature import gauss
from elvis.core.polynomials.row_products import row_products
from elvis.core.shapes import TENSOR, Shape

#: singular value, relative to the largest, from which a direction is new to a level
_NEW = 1e-9


@dataclass(frozen=True, eq=False)
class ModalFactor:
    """One factor of an expansion in its graded orthonormal basis.

    directions  of the shape that the factor covers
    to_modal    (m, m) from coefficients to the orthonormal basis: rows @ to_modal
    truncation  (m, m) from coefficients to those of the projection onto the level below the highest
    levels      (m,) level of each orthonormal function
    """

    directions: tuple[int, ...]
    to_modal: Floats
    truncation: Floats
    levels: Ints

    @property
    def highest(self) -> int:
        """The highest level."""
        return int(self.levels.max())


@dataclass(frozen=True, eq=False)
class ModalBasis:
    """The graded orthonormal basis of an expansion: products of those of its factors.

    order  (m,) coefficients in the order of the factors, the last factor fastest
    """

    factors: tuple[ModalFactor, ...]
    order: Ints

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of functions of each factor."""
        return tuple(len(factor.levels) for factor in self.factors)

    def modal(self, coefficients: Floats) -> Floats:
        """(n, m1, …) coefficients in the orthonormal basis, from coefficients (n, m)."""
        return self._applied(coefficients, [factor.to_modal for factor in self.factors])

    def truncated(self, coefficients: Floats) -> Floats:
        """(n, m) coefficients of the L2 projection onto functions without the highest level of any factor.

        A factor of level 0 keeps its functions: nothing is below them.
        """
        found = self._applied(coefficients, [factor.truncation for factor in self.factors])
        result = np.empty_like(coefficients, dtype=np.float64)
        result[:, self.order] = found.reshape(len(coefficients), -1)
        return result

    def is_top(self) -> Floats:
        """(m1 …,) 1 for functions that `truncated` removes, 0 for others."""
        kept = np.ones(self.sizes, bool)
        for axis, factor in enumerate(self.factors):
            own = (factor.levels < factor.highest) | (factor.highest == 0)
            kept &= own.reshape(-1, *(1,) * (len(self.factors) - 1 - axis))
        return (~kept).astype(np.float64).reshape(-1)

    def top_norms(self, coefficients: Floats) -> Floats:
        """(n,) norms, on the reference element, of what `truncated` removes."""
        modal = self.modal(coefficients).reshape(len(coefficients), -1)
        return np.asarray(np.sqrt(modal**2 @ self.is_top()))

    def _applied(self, coefficients: Floats, matrices: list[Floats]) -> Floats:
        """The coefficients as an array with an axis for each factor, each multiplied by its matrix."""
        net = np.asarray(coefficients, np.float64)[:, self.order].reshape(-1, *self.sizes)
        for axis, matrix in enumerate(matrices, 1):
            net = np.moveaxis(row_products(np.moveaxis(net, axis, -1), matrix), -1, axis)
        return net


@bounded_cache
def modal_basis(expansion: Expansion) -> ModalBasis:
    """The graded orthonormal basis of an expansion; ElvisError for Fourier directions."""
    if expansion.homogeneous is not None or any(basis in FOURIER for basis in expansion.bases):
        raise ElvisError("expected a polynomial field, found Fourier directions")
    if expansion.shape in TENSOR:
        directions = range(expansion.shape.dimension)
        # the first direction is fastest
        factors = tuple(_line(expansion, direction) for direction in reversed(directions))
        return ModalBasis(factors, frozen_ints(np.arange(np.prod(expansion.modes))))
    if expansion.shape is Shape.PRISM:
        return _prism(expansion)
    factor = _graded(expansion, tuple(range(expansion.shape.dimension)))
    return ModalBasis((factor,), frozen_ints(np.arange(len(factor.levels))))


def _prism(expansion: Expansion) -> ModalBasis:
    """A prism: the triangle of directions 0 and 2 times the line of direction 1."""
    bases, modes = expansion.bases, expansion.modes
    triangle = Expansion(Shape.TRIANGLE, (bases[0], bases[2]), (modes[0], modes[2]))
    index = product_plan(expansion).modes
    flat = {pair: place for place, pair in enumerate(map(tuple, product_plan(triangle).modes.tolist()))}
    place = np.array([flat[p, r] for p, _, r in index.tolist()])
    order = np.lexsort((index[:, 1], place))
    return ModalBasis((_graded(triangle, (0, 2)), _line(expansion, 1)), frozen_ints(order))


def _line(expansion: Expansion, direction: int) -> ModalFactor:
    """One direction of a tensor shape or a prism."""
    basis, count = expansion.bases[direction], expansion.modes[direction]
    return _graded(Expansion(Shape.SEGMENT, (basis,), (count,)), (direction,))


@bounded_cache
def _graded(expansion: Expansion, directions: tuple[int, ...]) -> ModalFactor:
    """A factor, orthonormalised level by level.

    The columns of ``found`` are values at quadrature points, weighted so that their scalar product is the inner
    product.  The new functions of a level are the left singular vectors of its values without the parts that lie in
    the levels below (Golub and Van Loan, Matrix Computations, 5.5), taken off twice against rounding.
    """
    points, weights = exact_rule(expansion)
    roots = np.sqrt(weights)[:, None]
    own = roots * values(expansion, points)
    found, levels = np.empty((len(points), 0)), []
    for level in range(max(expansion.modes)):
        space = roots * _space(expansion, level, points)
        for _ in range(2):
            space = space - found @ (found.T @ space)
        vectors, sizes, _ = np.linalg.svd(space, full_matrices=False)
        new = sizes > _NEW * max(1.0, float(np.linalg.norm(own)) / own.shape[1])
        found = np.hstack([found, vectors[:, new]])
        levels += [level] * int(new.sum())
    if len(levels) != own.shape[1]:
        raise ElvisError(f"expected {own.shape[1]} independent modes on a {expansion.shape.label}, found {len(levels)}")

    to_modal = own.T @ found
    below = np.array(levels) < max(levels) if max(levels) else np.ones(len(levels), bool)
    truncation = np.linalg.solve(to_modal.T, (to_modal * below).T).T
    return ModalFactor(directions, frozen_floats(to_modal), frozen_floats(truncation), frozen_ints(levels))


def _space(expansion: Expansion, level: int, points: Floats) -> Floats:
    """(n, k) values at points (n, d) of functions that span the space of a level."""
    if level == 0 and max(expansion.modes) > 1:
        return np.ones((len(points), 1))
    if expansion.shape is Shape.SEGMENT:
        # nodal families have no fewer modes; a polynomial of the level is the same in every family
        return values(Expansion(Shape.SEGMENT, (Basis.ORTHO_A,), (level + 1,)), points)
    modes = tuple(min(level + 1, count) for count in expansion.modes)
    return values(Expansion(expansion.shape, expansion.bases, modes), points)


def exact_rule(expansion: Expansion) -> tuple[Floats, Floats]:
    """Points (n, d) and weights (n,) of a Gauss rule that is exact for products of two functions of an expansion."""
    degrees = box_degrees(bernstein_space(expansion))
    powers = COLLAPSE[expansion.shape]
    lines = [gauss(degree + 1, power) for degree, power in zip(degrees, powers, strict=True)]
    scaled = [weights / 2**power for (_, weights), power in zip(lines, powers, strict=True)]
    eta = grid_points(*(nodes for nodes, _ in lines))
    grid = grid_points(*scaled)
    return uncollapse(expansion.shape, eta), grid.prod(axis=1)
