"""One-dimensional factor functions of the bases (format notes 4), tabulated at points of [-1, 1].

Every function of the Modified and Ortho families, collapsed directions included, has one form,

    f(z) = scale c^power u^exponent P_degree^{alpha,beta}(z),    c = (1 - z)/2,  u = (1 + z)/2,

so a list of factors is a table of integers, and f/c, which the chain rule of collapsed coordinates asks for, is known
without a division.  The families of tensor shapes that are not of this form are `LineFactors`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.jacobi import jacobi, jacobi_with_derivative
from elvis.core.polynomials.powers import powers_of
from elvis.core.polynomials.quadrature import gauss, lobatto


class Tables(NamedTuple):
    """Values, derivatives and values divided by c = (1 - z)/2, each (k, n), of k factors at n points.

    ``divided`` is 0 for factors that c does not divide: the factors that multiply them there have no derivative.
    """

    values: Floats
    derivatives: Floats
    divided: Floats


class Factors(Protocol):
    """A list of distinct factor functions."""

    def tables(self, points: Floats) -> Tables:
        """Tabulate all factors at ``points`` (n,)."""
        ...

    def values(self, points: Floats) -> Floats:
        """(k, n) only the values."""
        ...


@dataclass(frozen=True, eq=False)
class JacobiFactors:
    """Factors scale c^power u^exponent P_degree^{alpha,beta}.

    rows  (k, 6) ints: power, exponent (0 or 1), alpha, beta, degree, twice the square of scale
    """

    rows: Ints

    @property
    def degrees(self) -> Ints:
        """(k,) polynomial degrees."""
        degrees: Ints = self.rows[:, 0] + self.rows[:, 1] + self.rows[:, 4]
        return degrees

    @cached_property
    def scales(self) -> Floats:
        """(k,) scale factors."""
        return np.sqrt(self.rows[:, 5] / 2)

    def tables(self, points: Floats) -> Tables:
        """Values, derivatives and values over c; exact also at z = 1."""
        power = self.rows[:, 0]
        falling = powers_of((1 - points) / 2, power.max(initial=0) + 1)
        g, dg = self._without_falling(points)

        # f = c^power g; then f' = c^power g' - power/2 c^(power - 1) g
        divided = np.zeros_like(g)
        falls = self._falling
        divided[falls] = falling[power[falls] - 1] * g[falls]
        factor = falling[power]
        g *= factor
        dg *= factor
        dg[falls] -= (power[falls] / 2)[:, None] * divided[falls]
        return Tables(g, dg, divided)

    def values(self, points: Floats) -> Floats:
        """Only the values, in half the time."""
        power, exponent = self.rows[:, 0], self.rows[:, 1]
        c, u = (1 - points) / 2, (1 + points) / 2
        falling = powers_of(c, power.max(initial=0) + 1)
        result = np.empty((len(self.rows), len(points)))
        for alpha, beta, chosen, degrees in self._families:
            jacobis = jacobi(int(degrees.max()), alpha, beta, points)
            for row, degree in zip(chosen, degrees, strict=True):
                rising = u * jacobis[degree] if exponent[row] else jacobis[degree]
                result[row] = falling[power[row]] * (self.scales[row] * rising)
        return result

    def _without_falling(self, points: Floats) -> tuple[Floats, Floats]:
        """(k, n) values and derivatives of g = scale u^exponent P; one recurrence for each pair (alpha, beta)."""
        values, derivatives = np.empty((2, len(self.rows), len(points)))
        for alpha, beta, chosen, degrees in self._families:
            table = jacobi_with_derivative(int(degrees.max()), alpha, beta, points)
            values[chosen], derivatives[chosen] = table[0][degrees], table[1][degrees]
        rises = self._rising
        u = (1 + points) / 2
        derivatives[rises] = u * derivatives[rises] + values[rises] / 2
        values[rises] *= u
        scales = self.scales[:, None]
        values *= scales
        derivatives *= scales
        return values, derivatives

    @cached_property
    def _rising(self) -> Ints:
        """The factors with u."""
        return np.flatnonzero(self.rows[:, 1])

    @cached_property
    def _falling(self) -> Ints:
        """The factors with c."""
        return np.flatnonzero(self.rows[:, 0])

    @cached_property
    def _families(self) -> list[tuple[float, float, Ints, Ints]]:
        """Each pair (alpha, beta), the numbers of its factors and their degrees."""
        pairs, own = np.unique(self.rows[:, 2:4], axis=0, return_inverse=True)
        chosen = [np.flatnonzero(own.reshape(-1) == number) for number in range(len(pairs))]
        return [(float(a), float(b), each, self.rows[each, 4]) for (a, b), each in zip(pairs, chosen, strict=True)]


def constant(count: int) -> Ints:
    """(count, 6) rows of the factor 1."""
    return _rows(np.zeros(count, np.int64))


def modified_a(p: Ints) -> Ints:
    """(m, 6) rows of Modified_A factors."""
    return modified_b(np.zeros_like(p), p)


def modified_b(p: Ints, q: Ints) -> Ints:
    """(m, 6) rows of Modified_B factors; p = 0 is Modified_A_q, whose bubbles equal the factors of p = 1, q - 1."""
    bubble = (p == 0) & (q >= 2)
    p, q = np.where(bubble, 1, p), np.where(bubble, q - 1, q)
    exponent = (q >= 1).astype(np.int64)
    power = np.where((p == 0) & (q == 0), 1, p)
    inner = (exponent == 1) & (p >= 1)
    return _rows(power, exponent, np.where(inner, 2 * p - 1, 0), np.where(inner, 1, 0), np.where(inner, q - 1, 0))


def modified_c(p: Ints, q: Ints, r: Ints) -> Ints:
    """(m, 6) rows of Modified_C factors."""
    return modified_b(p + q, r)


def modified_pyr_c(p: Ints, q: Ints, r: Ints) -> Ints:
    """(m, 6) rows of ModifiedPyr_C factors; for p, q >= 2 they are Modified_B_{p+q-1,r} with one power of c less."""
    inside = (p >= 2) & (q >= 2)
    index = np.select([p == 0, p == 1, q < 2], [q, np.maximum(1, q), p], p + q - 1)
    rows = modified_b(index, r)
    rows[:, 0] -= inside
    return rows


def ortho_a(p: Ints) -> Ints:
    """(m, 6) rows of Ortho_A (Legendre) factors."""
    zero = np.zeros_like(p)
    return _rows(zero, zero, zero, zero, p, 2 * p + 1)


def ortho_b(p: Ints, q: Ints) -> Ints:
    """(m, 6) rows of Ortho_B factors."""
    zero = np.zeros_like(p)
    return _rows(p, zero, 2 * p + 1, zero, q, 2 * (p + q + 1))


def ortho_c(p: Ints, q: Ints, r: Ints) -> Ints:
    """(m, 6) rows of Ortho_C and OrthoPyr_C factors."""
    zero = np.zeros_like(p)
    return _rows(p + q, zero, 2 * p + 2 * q + 2, zero, r, 2 * (p + q + r) + 3)


def _rows(power: Ints, *columns: Ints) -> Ints:
    """(m, 6) table of columns; missing ones are 0 and the scale 1."""
    rows = np.zeros((len(power), 6), np.int64)
    rows[:, 5] = 2
    for column, values in enumerate((power, *columns)):
        rows[:, column] = values
    return rows


@dataclass(frozen=True)
class LineFactors:
    """All ``count`` functions of a family that only tensor shapes use: Lagrange, Chebyshev, Monomial or Fourier."""

    basis: Basis
    count: int

    def tables(self, points: Floats) -> Tables:
        """Values and derivatives; nothing is divided on a tensor shape."""
        if self.basis in (Basis.GLL_LAGRANGE, Basis.GAUSS_LAGRANGE):
            values, derivatives = _lagrange(self.basis, self.count, points)
        elif self.basis is Basis.CHEBYSHEV:
            ends = jacobi(self.count - 1, -0.5, -0.5, np.ones(1))
            values, derivatives = (table / ends for table in jacobi_with_derivative(self.count - 1, -0.5, -0.5, points))
        elif self.basis is Basis.MONOMIAL:
            degrees = np.arange(self.count)[:, None]
            values = points**degrees
            derivatives = degrees * points ** np.maximum(degrees - 1, 0)
        else:
            values, derivatives = (table.T for table in fourier(self.basis, range(self.count), points))
        return Tables(values, derivatives, np.zeros_like(values))

    def values(self, points: Floats) -> Floats:
        """Values alone."""
        return self.tables(points).values


def lagrange_nodes(basis: Basis, count: int) -> Floats:
    """(count,) nodes of GLL_Lagrange or Gauss_Lagrange, ascending."""
    return (lobatto(count) if basis is Basis.GLL_LAGRANGE else gauss(count))[0]


def _lagrange(basis: Basis, count: int, points: Floats) -> tuple[Floats, Floats]:
    """(count, n) values and derivatives, summed in Legendre polynomials."""
    values, derivatives = jacobi_with_derivative(count - 1, 0, 0, points)
    matrix = _legendre_of_lagrange(basis, count)
    return (values.T @ matrix).T, (derivatives.T @ matrix).T


@bounded_cache
def _legendre_of_lagrange(basis: Basis, count: int) -> Floats:
    """(count, count) Legendre coefficients of each Lagrange polynomial, by the nodes' own discrete orthogonality."""
    nodes, weights = lobatto(count) if basis is Basis.GLL_LAGRANGE else gauss(count)
    degrees = np.arange(count)
    norms = 2 / (2 * degrees + 1)
    if basis is Basis.GLL_LAGRANGE:
        norms[-1] = 2 / (count - 1)
    return frozen_floats(jacobi(count - 1, 0, 0, nodes) * weights / norms[:, None])


def fourier(basis: Basis, numbers: Sequence[int], points: Floats) -> tuple[Floats, Floats]:
    """(n, k) values and derivatives of the Fourier modes ``numbers`` at ``points`` in [-1, 1].

    Mode 0 is 1, mode 1 is 0, mode 2k is cos(k pi (z+1)) and mode 2k+1 is -sin(k pi (z+1)).  The single-mode family has
    k = 1 only; the half modes are cos(pi z) and -sin(pi z).
    """
    mode = np.asarray(numbers, np.int64)
    wave, sine = mode // 2, mode % 2
    angle = np.asarray(points, np.float64)[:, None] + 1
    if basis is Basis.FOURIER_SINGLE_MODE:
        wave = np.ones_like(mode)
    elif basis in (Basis.FOURIER_HALF_MODE_RE, Basis.FOURIER_HALF_MODE_IM):
        wave, sine, angle = np.ones_like(mode), np.full_like(mode, basis is Basis.FOURIER_HALF_MODE_IM), angle - 1
    k = np.pi * wave
    cosines, sines = np.cos(k * angle), np.sin(k * angle)
    return np.where(sine, -sines, cosines), np.where(sine, -k * cosines, -k * sines)
