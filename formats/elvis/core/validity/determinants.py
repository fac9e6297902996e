"""The Jacobian determinant of maps in Bernstein form, with a bound of the rounding of its coefficients.

The determinant of a polynomial map is a polynomial: of degree 3 (p - 1) on a tetrahedron of degree p, and of degrees 3
p - 1 in every direction of a hexahedron.  On a pyramid, both derivatives that leave its apex fixed are polynomials in
eta times c = (1 - eta3)/2, the factor by which eta shrinks towards the apex, so that

    det dx/dxi = det(dx/deta1 / c, dx/deta2 / c, dx/deta3)

is a polynomial in eta.  If space has more dimensions than the elements, the square of length or area is computed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.bernstein import (
    BernsteinSpace,
    bernstein_coefficients,
    bernstein_space,
    difference,
    differentiate,
    to_bernstein,
)
from elvis.core.polynomials.rounding import UNIT, coefficient_roundings, gamma
from elvis.core.polynomials.row_products import row_products
from elvis.core.polynomials.weights import weights
from elvis.core.shapes import TENSOR, Shape

#: coefficients of products that are summed together: they stay in the processor's cache
_CACHED = 1 << 18


@dataclass(frozen=True, eq=False)
class Polynomials:
    """One polynomial on each of n elements.

    net    (count, n)  Bernstein coefficients: an element a column
    error  (n,)        how far the true coefficients may be from these, through rounding
    """

    space: BernsteinSpace
    net: Floats
    error: Floats

    @property
    def magnitude(self) -> Floats:
        """(n,) bound of the true coefficients."""
        return np.asarray(np.abs(self.net).max(axis=0)) + self.error

    def __sub__(self, other: Polynomials) -> Polynomials:
        return self._sum(other, self.net - other.net)

    def __add__(self, other: Polynomials) -> Polynomials:
        return self._sum(other, self.net + other.net)

    def _sum(self, other: Polynomials, net: Floats) -> Polynomials:
        error = self.error + other.error + UNIT * np.abs(net).max(axis=0)
        return Polynomials(self.space, net, error)

    def __mul__(self, other: Polynomials) -> Polynomials:
        """The product: coefficients are means of products of coefficients, with weights that sum to 1."""
        degrees = tuple(a + b for a, b in zip(self.space.degrees, other.space.degrees, strict=True))
        space = BernsteinSpace(self.space.shape, degrees)
        long, short = sorted((self, other), key=lambda each: -each.space.count)
        scaled, factors = (each.net * weights(each.space)[:, None] for each in (long, short))
        sums = _lattice_sums if self.space.shape in TENSOR else _sums
        net = sums(space, (long.space, scaled), (short.space, factors))
        net /= weights(space)[:, None]

        # each coefficient sums at most as many products as the shorter factor has coefficients
        a, b = self.magnitude, other.magnitude
        error = a * other.error + b * self.error + (short.space.count + 8) * UNIT * a * b
        return Polynomials(space, net, error)


def _sums(space: BernsteinSpace, long: tuple[BernsteinSpace, Floats], short: tuple[BernsteinSpace, Floats]) -> Floats:
    """(count, n) for each function of the space the sum of all products of rows whose powers add up to its own."""
    net = np.zeros((space.count, long[1].shape[1]))
    for powers, factor in zip(short[0].powers, short[1], strict=True):
        net[space.positions[tuple((long[0].powers + powers).T)]] += long[1] * factor
    return net


def _lattice_sums(
    space: BernsteinSpace, long: tuple[BernsteinSpace, Floats], short: tuple[BernsteinSpace, Floats]
) -> Floats:
    """`_sums` on tensor shapes, where rows of all powers are a lattice, and rows of a product a box in it."""
    counts, longs, shorts = (tuple(degree + 1 for degree in own.degrees[::-1]) for own in (space, long[0], short[0]))
    net = np.zeros((space.count, long[1].shape[1]))
    step = max(1, _CACHED // space.count)
    for first in range(0, net.shape[1], step):
        some = slice(first, first + step)
        factors = np.ascontiguousarray(long[1][:, some]).reshape(*longs, -1)
        found, product = np.zeros((*counts, factors.shape[-1])), np.empty_like(factors)
        for place, factor in zip(np.ndindex(shorts), short[1][:, some], strict=True):
            np.multiply(factors, factor, out=product)
            found[tuple(slice(start, start + count) for start, count in zip(place, longs, strict=True))] += product
        net[:, some] = found.reshape(space.count, -1)
    return net


def determinant(expansion: Expansion, coefficients: Floats, space: int) -> Polynomials:
    """The Jacobian determinant of n maps with ``coefficients`` (n, 3, m) of the world coordinates.

    space  number of world coordinates; where it exceeds the shape's dimension, the square of length or area is made
    Raises FormatError for maps that aren't polynomials.
    """
    return determinant_of(tangents(expansion, coefficients), space)


def determinant_of(columns: Sequence[list[Polynomials]], space: int) -> Polynomials:
    """The determinant of a matrix of polynomials, by its columns, or the square of length or area as `determinant`."""
    if len(columns) == 1:
        return columns[0][0] if space == 1 else _square(columns[0][:space])
    if len(columns) == 2:
        return (
            _cross(columns[0], columns[1], 2)
            if space == 2
            else _square([_cross(columns[0], columns[1], axis) for axis in range(3)])
        )
    terms = [_cross(columns[0], columns[1], axis) * columns[2][axis] for axis in range(3)]
    return terms[0] + terms[1] + terms[2]


def _cross(a: list[Polynomials], b: list[Polynomials], axis: int) -> Polynomials:
    """One coordinate of the cross product of two tangents."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    return a[i] * b[j] - a[j] * b[i]


def _square(vector: list[Polynomials]) -> Polynomials:
    first, *others = (each * each for each in vector)
    for other in others:
        first = first + other
    return first


def tangents(expansion: Expansion, coefficients: Floats) -> list[list[Polynomials]]:
    """For each direction of xi the derivatives of the three world coordinates; on pyramids as this module says."""
    space = bernstein_space(expansion)
    nets = bernstein_coefficients(expansion, coefficients)
    greatest = np.abs(to_bernstein(expansion, space)).max(axis=1)
    sizes = row_products(np.abs(coefficients), greatest[:, None])[..., 0]
    errors = gamma(coefficient_roundings(expansion, coefficients.shape[-1]), UNIT) * sizes
    return [_derivatives(space, nets, errors, direction) for direction in range(expansion.shape.dimension)]


def _derivatives(space: BernsteinSpace, nets: Floats, errors: Floats, direction: int) -> list[Polynomials]:
    """The derivatives in one direction of nets (n, 3, count) with ``errors`` (n, 3)."""
    lower, derivatives = differentiate(space, nets, direction)
    # both coefficients of a difference are off; the difference and its product with the scale are rounded
    errors = 2 * difference(space, direction).scale * errors + 2 * UNIT * np.abs(derivatives).max(axis=2)
    if space.shape is Shape.PYRAMID and direction < 2:
        lower, derivatives, errors = _divide(lower, derivatives, errors)
    return [Polynomials(lower, np.ascontiguousarray(derivatives[:, i].T), errors[:, i]) for i in range(3)]


def _divide(space: BernsteinSpace, nets: Floats, errors: Floats) -> tuple[BernsteinSpace, Floats, Floats]:
    """Polynomials on a pyramid over c: b_k^r = c r/(r - k) b_k^(r-1) for k < r.

    The coefficients b_r^r contain only rounding, for at the apex the format's functions don't depend on eta1 and eta2.
    """
    p, q, r = space.degrees
    layers = nets.reshape(*nets.shape[:2], r + 1, -1)
    scale = r / (r - np.arange(r))
    divided = (layers[:, :, :r] * scale[:, None]).reshape(*nets.shape[:2], -1)
    return BernsteinSpace(space.shape, (p, q, r - 1)), divided, r * errors
