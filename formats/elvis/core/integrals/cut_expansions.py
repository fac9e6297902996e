"""Truncated Taylor expansions on discs, with bounds of the truncation error.

A polynomial of degree 7 along each axis has 3,872 coefficients in the coordinates s, t and u of a curved surface, where
k = u + P(s, t).  On a small box almost all of them are negligible.  Only the terms up to a total degree are computed.
The others are bounded by majorants: let c+ and P+ be c and P with the magnitudes of their coefficients.  Each
coefficient of c(s, t, u + P) is at most the one of c+(s, t, u + P+).  The truncation error of the former
is therefore at most the truncation error of the latter at the radii of the discs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.integrals.taylor import (
    BENDS,
    ROUNDING,
    constant_and_rest,
    majorants,
    multiplied,
    powers_of,
    slope,
    straightened,
)
from elvis.core.quantities.discs import Disc

#: total degree up to which terms are kept, and the number of terms of curved surfaces that are all kept
_DEGREE, _ALL = 5, 512


@dataclass(frozen=True, eq=False)
class Expansion:
    """A polynomial of s, t and u around the centres of n boxes.

    coefficients  (n, A, B, C)
    omitted       (3, n, columns, D) for each power of u, bounds of the magnitudes of omitted terms on discs of s and t,
                  and of their derivatives in s and t; None if there are none
    """

    coefficients: Floats
    omitted: Floats | None = None

    @staticmethod
    def curved(coefficients: Floats, bends: Floats, radii: tuple[Floats, Floats]) -> Expansion:
        """The expansion of a polynomial (n, A, B, C) whose third coordinate is u + P(s, t), with P of ``bends``.

        radii  (n, columns) of the discs of s and t
        """
        _, a, b, c = coefficients.shape
        count = (a + 2 * (c - 1)) * (b + 2 * (c - 1)) * c
        if a == 1 or count <= _ALL:
            return Expansion(straightened(coefficients, bends))
        sizes = np.abs(coefficients)
        whole = _majorants_of_curved(sizes, np.abs(bends), radii)
        kept = _majorants_with_slopes(_kept_terms(sizes, np.abs(bends)), radii)
        omitted = (1 + ROUNDING) * whole
        omitted[..., : kept.shape[3]] -= kept[..., :c]
        return Expansion(_kept_terms(coefficients, bends), np.maximum(omitted, 0.0) + ROUNDING * whole)

    @staticmethod
    def combined(factors: Floats, several: Sequence[Expansion]) -> Expansion:
        """The sum of expansions, all of the same size, with factors (n, number of expansions)."""
        columns = list(zip(factors.T, several, strict=True))
        total = sum(factor[:, None, None, None] * each.coefficients for factor, each in columns)
        parts = [(factor, each.omitted) for factor, each in columns if each.omitted is not None]
        omitted = sum(np.abs(factor)[:, None, None] * part for factor, part in parts)
        return Expansion(np.asarray(total), np.asarray(omitted) if parts else None)

    def multiplied(self, slopes: Floats, radii: tuple[Floats, Floats]) -> Expansion:
        """The product with 1 + p s + q t, with slopes (n, 2) p and q; p is 0 without a first direction."""
        found = multiplied(self.coefficients, slopes)
        if self.omitted is None:
            return Expansion(found)
        p, q = np.abs(slopes).T[:, :, None]
        most = (1 + p * radii[0] + q * radii[1])[..., None]
        value, in_s, in_t = self.omitted
        omitted = np.stack([value * most, in_s * most + value * p[..., None], in_t * most + value * q[..., None]])
        return Expansion(found, omitted)

    @property
    def steepness(self) -> Floats:
        """(n,) derivatives in u at the centres."""
        return self.coefficients[:, 0, 0, 1]

    def by_power(self, first: Floats, second: Floats) -> Floats:
        """(n, columns, C) bounds, for each power of u, of its coefficient on discs of s and t."""
        found = majorants(self.coefficients, first, second)
        return found if self.omitted is None else _padded_sum(found, self.omitted[0])

    def disc(self, radii: tuple[Floats, Floats, Floats]) -> Disc:
        """The disc around the constant (n, 1) of all values on discs with radii (n, columns) around the centre."""
        return constant_and_rest(self.coefficients, self.by_power(radii[0], radii[1]), radii[2])

    def slope(self, axis: int, radii: tuple[Floats, Floats, Floats]) -> Disc:
        """The disc of the derivative in a direction, 0 to 2."""
        own = slope(self.coefficients, axis)
        if self.omitted is None:
            return Expansion(own).disc(radii)
        in_u = self.omitted[0][..., 1:] * np.arange(1, self.omitted.shape[3])
        omitted = in_u if axis == 2 else self.omitted[1 + axis]
        by_power = _padded_sum(majorants(own, radii[0], radii[1]), omitted)
        return constant_and_rest(own, by_power, radii[2])

    def slope_at_centre(self, axis: int) -> Floats:
        """(n,) derivatives in a direction at the centres."""
        index = [0, 0, 0]
        index[axis] = 1
        if self.coefficients.shape[1 + axis] == 1:
            return np.zeros(len(self.coefficients))
        return np.asarray(self.coefficients[:, index[0], index[1], index[2]])


def _padded_sum(one: Floats, other: Floats) -> Floats:
    """The sum of arrays (n, columns, C) with different numbers of powers."""
    longer, shorter = (one, other) if one.shape[2] >= other.shape[2] else (other, one)
    found = longer.copy()
    found[..., : shorter.shape[2]] += shorter
    return found


def _kept_terms(coefficients: Floats, bends: Floats) -> Floats:
    """(n, D, D, D) coefficients of c(s, t, u + P(s, t)) of a total degree up to D - 1, and some further parts.

    Horner's method in the third coordinate.  Each of the following steps raises the total degree, so that a step before
    m others only needs the degrees up to D - 1 - m.
    """
    n, a, b, c = coefficients.shape
    found = np.zeros((n, 0, 0, 0))
    for power in range(_DEGREE, -1, -1):
        size = _DEGREE - power + 1
        product = _raised(found, bends, size)
        if power < c:
            own = coefficients[:, :size, :size, power]
            product[:, : min(a, size), : min(b, size), 0] += own
        found = product
    return found


def _raised(found: Floats, bends: Floats, size: int) -> Floats:
    """The product (n, size, size, size) of a polynomial with u + P, without higher powers."""
    product = np.zeros((len(found), size, size, size))
    old = size - 1
    product[:, :old, :old, 1:] = found
    for (i, j), factor in zip(BENDS, bends.T, strict=True):
        if max(i, j) < size:
            rows, columns = min(old, size - i), min(old, size - j)
            part = found[:, :rows, :columns]
            product[:, i : i + rows, j : j + columns, :old] += factor[:, None, None, None] * part
    return product


def _majorants_with_slopes(coefficients: Floats, radii: tuple[Floats, Floats]) -> Floats:
    """(3, n, columns, C) majorants on discs of s and t by power of u, and the majorants of slopes in s and t."""
    _, a, b, _ = coefficients.shape
    first, second = (_powers_and_slopes(radius, size) for radius, size in zip(radii, (a, b), strict=True))
    along_s = [_contracted(powers, coefficients) for powers in first]
    value = _last_contracted(second[0], along_s[0])
    in_s = _last_contracted(second[0], along_s[1])
    in_t = _last_contracted(second[1], along_s[0])
    return np.stack([value, in_s, in_t])


def _contracted(powers: Floats, coefficients: Floats) -> Floats:
    """(n, columns, B, C) sums over the first axis of coefficients (n, A, B, C) times powers (n, columns, A)."""
    n, a, b, c = coefficients.shape
    return (powers @ coefficients.reshape(n, a, b * c)).reshape(n, powers.shape[1], b, c)


def _last_contracted(powers: Floats, coefficients: Floats) -> Floats:
    """(n, columns, C) sums over B of coefficients (n, columns, B, C) times powers (n, columns, B)."""
    return np.asarray((powers[:, :, None, :] @ coefficients)[:, :, 0])


def _powers_and_slopes(radii: Floats, count: int) -> tuple[Floats, Floats]:
    """(n, columns, count) powers r^i of radii, and their derivatives i r^(i-1)."""
    powers = powers_of(radii, count)
    slopes = np.zeros_like(powers)
    slopes[..., 1:] = powers[..., :-1] * np.arange(1, count)
    return powers, slopes


def _majorants_of_curved(sizes: Floats, bends: Floats, radii: tuple[Floats, Floats]) -> Floats:
    """(3, n, columns, C) the same of c+(s, t, u + P+), from the magnitudes of c and P.

    With c+ = sum C_m (u + h)^m, the coefficient of u^k is G_k = sum binom(m, k) h^(m-k) C_m, and dG_k/dh is
    (k + 1) G_(k+1).
    """
    value, in_s, in_t = _majorants_with_slopes(sizes, radii)
    height, *height_slopes = _height_with_slopes(bends, radii)
    count = value.shape[2]
    shift = powers_of(height, count)[..., _exponents(count)] * _binomials(count)
    found, *slopes = (_last_contracted_by(shift, each) for each in (value, in_s, in_t))
    along_h = np.zeros_like(found)
    along_h[..., :-1] = found[..., 1:] * np.arange(1, count)
    sloped = [own + along_h * rise[..., None] for own, rise in zip(slopes, height_slopes, strict=True)]
    return np.stack([found, *sloped])


def _last_contracted_by(matrices: Floats, values: Floats) -> Floats:
    """(n, columns, C) products of matrices (n, columns, C, C) and vectors (n, columns, C)."""
    return np.asarray((matrices @ values[..., None])[..., 0])


@bounded_cache
def _binomials(count: int) -> Floats:
    """(count, count) binomial coefficients of m (column) over k (row)."""
    return frozen_floats(np.array([[float(comb(m, k)) for m in range(count)] for k in range(count)]))


def _exponents(count: int) -> Ints:
    """(count, count) m - k for column m and row k; 0 where that is negative."""
    order = np.arange(count)
    return np.asarray(np.maximum(order[None, :] - order[:, None], 0))


def _height_with_slopes(bends: Floats, radii: tuple[Floats, Floats]) -> tuple[Floats, Floats, Floats]:
    """(n, columns) P+ at radii of s and t, and its derivatives in s and t."""
    first, second = radii
    p, q, along_s, mixed, along_t = bends.T[:, :, None]
    height = (p + along_s * first + mixed * second) * first + (q + along_t * second) * second
    return height, p + 2 * along_s * first + mixed * second, q + 2 * along_t * second + mixed * first
