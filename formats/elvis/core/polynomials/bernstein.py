"""Bernstein-Bezier form of expansions: coefficients that bound a polynomial on its whole element.

With t_i = (1 + xi_i)/2 and b_i^p(t) = C(p, i) t^i (1 - t)^(p - i), the spaces, their degrees and the order of their
coefficients are

    shape           degrees    functions                                          order, slowest to fastest
    segment         (p,)       b_i^p(t1)                                          i
    quadrilateral   (p, q)     b_i^p(t1) b_j^q(t2)                                j, i
    hexahedron      (p, q, r)  b_i^p(t1) b_j^q(t2) b_k^r(t3)                      k, j, i
    triangle        (p,)       p!/(a! i! j!) l0^a l1^i l2^j, l = (1-t1-t2, t1, t2)      j, i
    tetrahedron     (p,)       p!/(a! i! j! k!) l0^a l1^i l2^j l3^k                     k, j, i
    prism           (p, q)     triangle of degree p in (t1, t3), b_j^q(t2)        j, k, i
    pyramid         (p, q, r)  as the hexahedron, in the collapsed coordinates eta

All functions are non-negative and sum to 1, so a polynomial lies between its smallest and its largest coefficient.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb, prod

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, frozen_ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.collapse import collapse
from elvis.core.polynomials.expansion import product_plan
from elvis.core.polynomials.forms import elevations, form_degrees
from elvis.core.polynomials.kronecker import along_directions
from elvis.core.polynomials.powers import powers_of
from elvis.core.polynomials.row_products import row_products
from elvis.core.shapes import TENSOR, Shape

_SIMPLEX = (Shape.TRIANGLE, Shape.TETRAHEDRON)


@dataclass(frozen=True)
class BernsteinSpace:
    """Polynomials of the given degrees on a shape; see the table of this module."""

    shape: Shape
    degrees: tuple[int, ...]

    def __post_init__(self) -> None:
        expected = 1 if self.shape in _SIMPLEX else 2 if self.shape is Shape.PRISM else self.shape.dimension
        if len(self.degrees) != expected or min(self.degrees) < 0:
            raise ElvisError(f"expected {expected} degrees of a {self.shape.label} space, found {self.degrees}")

    @property
    def count(self) -> int:
        """Number of coefficients."""
        return len(self.powers)

    @cached_property
    def powers(self) -> Ints:
        """(count, d) powers (i, j, k) of each function in coefficient order; column l belongs to direction l."""
        p = self.degrees[0]
        if self.shape in _SIMPLEX:
            index = np.indices((p + 1,) * self.shape.dimension).reshape(self.shape.dimension, -1)[::-1]
            return frozen_ints(index[:, index.sum(axis=0) <= p].T)
        if self.shape is Shape.PRISM:
            j, k, i = np.indices((self.degrees[1] + 1, p + 1, p + 1)).reshape(3, -1)
            return frozen_ints(np.stack([i, j, k], axis=1)[i + k <= p])
        return frozen_ints(np.indices([d + 1 for d in self.degrees[::-1]]).reshape(len(self.degrees), -1)[::-1].T)

    @cached_property
    def positions(self) -> Ints:
        """Position of the function with given powers: a d-dimensional array, -1 for missing functions."""
        table = np.full(tuple(self.powers.max(axis=0) + 1), -1, np.int64)
        table[tuple(self.powers.T)] = np.arange(len(self.powers))
        return frozen_ints(table)

    def contains(self, other: BernsteinSpace) -> bool:
        """Whether every function of ``other`` is one of this space."""
        return self.shape is other.shape and all(a >= b for a, b in zip(self.degrees, other.degrees, strict=True))


def bernstein_space(expansion: Expansion) -> BernsteinSpace:
    """The smallest space that contains the expansion.

    Raises FormatError if it is not polynomial (Fourier directions).
    """
    if expansion.homogeneous is not None:
        raise FormatError("expected a polynomial expansion, found one with homogeneous (Fourier) directions")
    degrees = [int(form_degrees(part).max()) for part in product_plan(expansion).factors]
    if expansion.shape in _SIMPLEX:
        return BernsteinSpace(expansion.shape, (degrees[-1],))
    if expansion.shape is Shape.PRISM:
        return BernsteinSpace(expansion.shape, (degrees[2], degrees[1]))
    return BernsteinSpace(expansion.shape, tuple(degrees))


@bounded_cache
def to_bernstein(expansion: Expansion, space: BernsteinSpace | None = None) -> Floats:
    """(m, count) Bernstein coefficients of every mode; ``coefficients @ matrix`` gives an element's.

    ``space`` may be any that contains the expansion.  Entries are products of correctly rounded one-dimensional
    coefficients, so each is accurate to a few units in the last place.
    """
    plan, target = product_plan(expansion), _target(expansion, space)
    w, heights = target.powers, _heights(target)
    matrix = np.ones((len(plan.modes), target.count))
    for direction, index in enumerate(plan.index):
        nets = _nets(expansion, direction, _top(target, direction))
        matrix *= nets[heights[:, direction], index[:, None], w[:, direction]]
    return frozen_floats(matrix)


def _target(expansion: Expansion, space: BernsteinSpace | None) -> BernsteinSpace:
    least = bernstein_space(expansion)
    if space is None or space == least:
        return least
    if not space.contains(least):
        raise ElvisError(f"expected a Bernstein space that contains {least}, found {space}")
    return space


@bounded_cache
def _nets(expansion: Expansion, direction: int, degree: int) -> Floats:
    return frozen_floats(elevations(product_plan(expansion).factors[direction], degree))


def _top(space: BernsteinSpace, direction: int) -> int:
    """Degree of the space in one direction."""
    if space.shape in _SIMPLEX:
        return space.degrees[0]
    if space.shape is Shape.PRISM:
        return space.degrees[direction % 2]
    return space.degrees[direction]


def _heights(space: BernsteinSpace) -> Ints:
    """(count, d) degree that each direction's univariate function has inside each function of the space.

    On a triangle B_{ij} = b_j^p(t2) b_i^{p-j}(s) with s the collapsed first coordinate: the later powers lower it.
    """
    w, tops = space.powers, np.array([_top(space, i) for i in range(space.shape.dimension)])
    heights = np.broadcast_to(tops, w.shape).copy()
    if space.shape in _SIMPLEX:
        heights -= np.cumsum(w[:, ::-1], axis=1)[:, ::-1] - w
    elif space.shape is Shape.PRISM:
        heights[:, 0] -= w[:, 2]
    return heights


def bernstein_coefficients(
    expansion: Expansion, coefficients: Floats, space: BernsteinSpace | None = None, *, magnitudes: bool = False
) -> Floats:
    """(..., count) Bernstein coefficients of elements with modal ``coefficients`` (..., m).

    Equals ``coefficients @ to_bernstein(expansion, space)``, computed one direction at a time on tensor shapes.  With
    ``magnitudes`` each is the sum of its terms' magnitudes, in proportion to which it is rounded.
    """

    def maybe_absolute(numbers: Floats) -> Floats:
        return np.abs(numbers) if magnitudes else numbers

    if expansion.shape not in TENSOR:
        return row_products(maybe_absolute(coefficients), maybe_absolute(to_bernstein(expansion, space)))
    plan, target = product_plan(expansion), _target(expansion, space)
    factors = []
    for direction, count in enumerate(expansion.modes):
        index = np.empty(count, np.int64)
        index[plan.modes[:, direction]] = plan.index[direction]
        factors.append(maybe_absolute(_nets(expansion, direction, target.degrees[direction])[-1][index]))
    net = along_directions(maybe_absolute(coefficients).reshape(-1, coefficients.shape[-1]), factors)
    return net.reshape(*coefficients.shape[:-1], target.count)


def bernstein_values(space: BernsteinSpace, points: Floats) -> Floats:
    """(n, count) values of all functions of the space at the reference points xi (n, d)."""
    w, shape = space.powers, space.shape
    t = (1 + collapse(shape, points) if shape is Shape.PYRAMID else 1 + np.asarray(points, np.float64)) / 2
    if shape in _SIMPLEX:
        return _simplex_values(space.degrees[0], t, w)
    if shape is Shape.PRISM:
        return _simplex_values(space.degrees[0], t[:, ::2], w[:, ::2]) * _line_values(
            space.degrees[1], t[:, 1], w[:, 1]
        )
    values = _line_values(space.degrees[0], t[:, 0], w[:, 0])
    for i in range(1, shape.dimension):
        values = values * _line_values(space.degrees[i], t[:, i], w[:, i])
    return values


def _line_values(degree: int, t: Floats, powers: Ints) -> Floats:
    """(n, count) values of b_i^degree(t) for the powers i (count,)."""
    return np.take(line_tables(degree, t)[0], powers, axis=1)


def line_tables(degree: int, t: Floats, orders: int = 0) -> Floats:
    """(1 + orders, n, degree + 1) Bernstein polynomials at t (n,) in [0, 1], then their derivatives."""
    result = np.zeros((1 + orders, degree + 1, len(t)))
    powers, opposite = powers_of(t, degree + 1), powers_of(1 - t, degree + 1)
    for order in range(min(degree, orders) + 1):
        count = degree - order + 1
        rows = _binomials(degree - order)[:, None] * powers[:count] * opposite[:count][::-1]

        # b_k' = degree (b_{k-1} - b_k) of one degree less
        for k in range(order):
            lower = (count + k) * rows
            rows = np.zeros((count + k + 1, len(t)))
            rows[1:] = lower
            rows[:-1] -= lower
        result[order] = rows
    return result.transpose(0, 2, 1)


@bounded_cache
def _binomials(degree: int) -> Floats:
    return frozen_floats([float(comb(degree, k)) for k in range(degree + 1)])


def _simplex_values(degree: int, t: Floats, powers: Ints) -> Floats:
    """(n, count) values on a simplex with barycentric coordinates t (n, d) and one more, for the powers (count, d)."""
    barycentric = np.column_stack([t, 1 - t.sum(axis=1)])
    exponents = np.column_stack([powers, degree - powers.sum(axis=1)])
    values = np.broadcast_to(_multinomials(exponents), (len(t), len(powers)))
    for i in range(barycentric.shape[1]):
        table = barycentric[:, i, None] ** np.arange(degree + 1)
        values = values * np.take(table, exponents[:, i], axis=1)
    return values


def _multinomials(exponents: Ints) -> Floats:
    """(count,) multinomial coefficients of the rows of ``exponents``."""
    totals = np.cumsum(exponents, axis=1)
    factors = [[comb(int(n), int(k)) for n, k in zip(*row, strict=True)] for row in zip(totals, exponents, strict=True)]
    return np.array([float(np.prod([float(c) for c in row])) for row in factors])


@dataclass(frozen=True, eq=False)
class Difference:
    """A derivative in Bernstein form: coefficients of ``space`` are scale (b[plus] - b[minus])."""

    space: BernsteinSpace
    plus: Ints
    minus: Ints
    scale: float


def difference(space: BernsteinSpace, direction: int) -> Difference:
    """The derivative in xi_direction (in eta_direction on a pyramid), as a difference of coefficients."""
    top = _top(space, direction)
    reduced = list(space.degrees)
    reduced[0 if space.shape in _SIMPLEX else direction % 2 if space.shape is Shape.PRISM else direction] = max(
        top - 1, 0
    )
    lower = BernsteinSpace(space.shape, tuple(reduced))
    step = np.zeros(space.shape.dimension, np.int64)
    step[direction] = min(top, 1)
    plus, minus = space.positions[tuple((lower.powers + step).T)], space.positions[tuple(lower.powers.T)]
    return Difference(lower, frozen_ints(plus), frozen_ints(minus), top / 2)


def differentiate(space: BernsteinSpace, coefficients: Floats, direction: int) -> tuple[BernsteinSpace, Floats]:
    """The space and coefficients (..., count) of the derivative in xi_direction (in eta_direction on a pyramid)."""
    d = difference(space, direction)
    if space.shape in TENSOR and space.degrees[direction] and coefficients.size:
        # neighbours along an axis, which slices find faster than lists of their places
        sizes = [degree + 1 for degree in space.degrees]
        net = coefficients.reshape(-1, prod(sizes[direction + 1 :]), sizes[direction], prod(sizes[:direction]))
        slopes = net[:, :, 1:] - net[:, :, :-1]
        slopes *= d.scale
        return d.space, slopes.reshape(*coefficients.shape[:-1], d.space.count)
    return d.space, d.scale * (coefficients[..., d.plus] - coefficients[..., d.minus])


def gradient_nets(space: BernsteinSpace) -> tuple[tuple[BernsteinSpace, Floats], ...]:
    """For each direction the space of the derivative and the matrix (count, count') to its coefficients.

    Directions are the directions of xi, on a pyramid of eta.
    """
    directions = range(space.shape.dimension)
    return tuple(differentiate(space, np.eye(space.count), direction) for direction in directions)


def bounds(space: BernsteinSpace, coefficients: Floats) -> tuple[Floats, Floats]:
    """Lower and upper bound (...,) on the element of polynomials with Bernstein ``coefficients`` (..., count)."""
    if coefficients.shape[-1] != space.count:
        raise ElvisError(f"expected {space.count} Bernstein coefficients, found {coefficients.shape[-1]}")
    return coefficients.min(axis=-1), coefficients.max(axis=-1)
