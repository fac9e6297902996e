"""Arithmetic of Chebyshev models.

A model of a quantity f over a box consists of values at a lattice of Chebyshev nodes, which define a polynomial P, and
bounds of the remainder f - P and of its derivatives.  Sums, products and reciprocals of models are models:

    product     P_f P_g has terms that the lattice takes for others.  The coefficients of degrees i and j make terms of
                degree i + j at most, so that those beyond the lattice sum to what the shells of both say; each counts
                twice, once where it is missing and once where it is aliased.
    reciprocal  p interpolates 1 / P_g, so 1 - P_g p vanishes at the nodes and is bounded like what a product lacks.
                e = 1/g - p satisfies g e = 1 - g p, which bounds e and, differentiated, its derivatives.

Brisebarre and Joldes 2010, Chebyshev interpolation polynomial-based tools for rigorous computing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.chebyshev_models.series import (
    ORDERS,
    amplification,
    coefficients_of,
    growth,
    shells_of,
    sizes_of,
    steepness,
    transform_rounding,
)
from elvis.core.polynomials.rounding import UNIT


@dataclass(frozen=True, eq=False)
class ChebyshevModel:
    """Polynomials that approximate a quantity on n boxes.

    values     (n, count, count, count) at the nodes, those along x last
    remainder  (ORDERS, n) bounds of the error, and of its derivatives in x
    error      (n,) maximum error of values computed from the values of leaves
    known      shells, if already known
    bounds     (n,) bounds of the magnitudes of the values, if already known
    """

    values: Floats
    remainder: Floats
    error: Floats
    known: Floats | None = None
    bounds: Floats | None = None

    @cached_property
    def coefficients(self) -> Floats:
        """(n, count, count, count) Chebyshev coefficients."""
        return coefficients_of(self.values)

    @cached_property
    def shells(self) -> Floats:
        """(n, count) sums of magnitudes of coefficients, by their highest degree."""
        if self.known is not None:
            return self.known
        if self.values.shape[-1] == 1:
            return np.abs(self.values.reshape(-1, 1))
        return shells_of(self.coefficients)

    @cached_property
    def sizes(self) -> Floats:
        """(ORDERS, n) bounds of the polynomials and of their derivatives."""
        return sizes_of(self.shells)

    @cached_property
    def greatest(self) -> Floats:
        """(n,) bounds of the magnitudes of the values at the nodes."""
        if self.bounds is not None:
            return self.bounds
        flat = self.values.reshape(len(self.values), self.values.shape[-1] ** 3)
        return np.asarray(np.maximum(flat.max(axis=1, initial=0.0), -flat.min(axis=1, initial=0.0)))

    @property
    def size(self) -> Floats:
        """(n,) bounds of the quantity."""
        return np.asarray(self.sizes[0] + self.remainder[0] + self.error)

    @property
    def series_remainder(self) -> Floats:
        """(ORDERS, n) the remainder for the computed coefficients: values at the nodes are rounded, and the transform.

        The difference is a polynomial of their degree.
        """
        count = self.values.shape[-1]
        off = amplification(count) * self.error + transform_rounding(count) * self.sizes[0]
        return self.remainder + np.outer([steepness(count, order) for order in range(ORDERS)], off)

    def __add__(self, other: ChebyshevModel) -> ChebyshevModel:
        """The sum."""
        values, remainder = self.values + other.values, self.remainder + other.remainder
        return _rounded(values, remainder, self.error + other.error, self.greatest + other.greatest)

    def __sub__(self, other: ChebyshevModel) -> ChebyshevModel:
        """The difference."""
        return self + other.times(-1.0)

    def times(self, factor: float) -> ChebyshevModel:
        """The quantity times an exact number."""
        size = abs(factor)
        return _rounded(factor * self.values, size * self.remainder, size * self.error, size * self.greatest)

    def plus(self, number: float) -> ChebyshevModel:
        """The quantity and an exact number."""
        return _rounded(self.values + number, self.remainder, self.error, self.greatest + abs(number))

    def __mul__(self, other: ChebyshevModel) -> ChebyshevModel:
        """The product."""
        # f g - P_f P_g = P_f (g - P_g) + (f - P_f) g
        lost = leibniz(self.sizes, other.remainder) + leibniz(self.remainder, other.sizes + other.remainder)
        lost += _aliased(self.shells, other.shells)
        error = self.size * other.error + self.error * other.size
        return _rounded(self.values * other.values, lost, error, self.greatest * other.greatest)

    def reciprocal(self) -> ChebyshevModel:
        """One over the quantity; remainders are infinite if it may be zero."""
        with np.errstate(all="ignore"):
            values = 1.0 / self.values
            none = np.zeros_like(self.remainder)
            inverse = ChebyshevModel(values, none, none[0])
            aliased = _aliased(self.shells, inverse.shells)
            defect = aliased + leibniz(self.remainder, inverse.sizes)
            least = (1.0 - aliased[0]) / inverse.sizes[0] - self.remainder[0] - self.error
            steep = self.sizes + self.remainder
            value = defect[0] / least
            first = (defect[1] + steep[1] * value) / least
            second = (defect[2] + 2.0 * steep[1] * first + steep[2] * value) / least
            remainder = np.stack([value, first, second])
            remainder[:, ~((least > 0.0) & np.isfinite(second))] = np.inf
            error = np.where(least > 0.0, self.error / least**2, np.inf)
            return _rounded(values, remainder, error, inverse.greatest + remainder[0])

    def power(self, exponent: int) -> ChebyshevModel:
        """A whole power, 1 at least, by repeated products."""
        found = self
        for _ in range(exponent - 1):
            found = found * self
        return found


def leibniz(first: Floats, second: Floats) -> Floats:
    """(ORDERS, n) bounds of a product and of its derivatives, from the bounds of its factors."""
    (a, da, dda), (b, db, ddb) = first, second
    return np.stack([a * b, da * b + a * db, dda * b + 2.0 * da * db + a * ddb])


def _aliased(first: Floats, second: Floats) -> Floats:
    """(ORDERS, n) bounds of what a lattice makes wrong of products of series with these shells (n, count)."""
    count = first.shape[1]
    if count == 1:
        return np.zeros((ORDERS, len(first)))
    # sums of first[k] second[count + m - k] for m = 0, 1 ...: the terms whose degrees sum to count + m
    others = second.copy()
    others[:, 0] = 0.0
    beyond = np.matmul(others[:, _partners(count)], first[:, 1:, None])[..., 0]
    # a missing term has its own degree, an aliased term at most the degree of the lattice
    bounds = growth(2 * count - 1)[:, count:] + growth(count)[:, -1:]
    return np.asarray(bounds @ beyond.T)


@bounded_cache
def _partners(count: int) -> Ints:
    """(count - 1, count - 1) degrees count + m - k for m = 0, 1 ... and k = 1, 2 ...; 0 beyond the lattice."""
    m = np.arange(count - 1)
    degrees = count + m[:, None] - (m + 1)
    return frozen_ints(np.where(degrees < count, degrees, 0))


def _rounded(values: Floats, remainder: Floats, error: Floats, greatest: Floats) -> ChebyshevModel:
    """A model after one more operation, whose rounding counts for the largest value at the nodes, four times.

    Rounding of the bounds of values is less than the factor allows for.
    """
    with np.errstate(invalid="ignore", over="ignore"):
        return ChebyshevModel(values, remainder, error + 4.0 * UNIT * greatest, None, greatest)


def constant(like: ChebyshevModel, number: float) -> ChebyshevModel:
    """A number, as a model over the boxes of another."""
    return ChebyshevModel(
        np.full_like(like.values, number), np.zeros((ORDERS, len(like.error))), np.zeros(len(like.error))
    )
