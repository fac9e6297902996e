"""Factor functions as exact polynomials, and their Bernstein coefficients rounded once.

An integer form of degree d is a list h of d + 1 integers: h_0 (1-t)^d + h_1 t (1-t)^(d-1) + ... + h_d t^d, t = (1+z)/2.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from math import comb, prod
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.factors import Factors, JacobiFactors, LineFactors, lagrange_nodes

#: integers, the common denominator, and a factor that may be irrational
Form: TypeAlias = tuple[list[int], int, float]


def forms(factors: Factors) -> list[Form]:
    """The exact form of each factor; raises FormatError for Fourier modes, which are not polynomials."""
    if isinstance(factors, JacobiFactors):
        return [(_jacobi_form(row), 1, float(scale)) for row, scale in zip(factors.rows, factors.scales, strict=True)]
    if not isinstance(factors, LineFactors):
        raise TypeError(f"expected JacobiFactors or LineFactors, found {type(factors).__name__}")
    if factors.basis is Basis.CHEBYSHEV:
        return [([(-1) ** (p - i) * comb(2 * p, 2 * i) for i in range(p + 1)], 1, 1.0) for p in range(factors.count)]
    if factors.basis is Basis.MONOMIAL:
        return [([(-1) ** (p - i) * comb(p, i) for i in range(p + 1)], 1, 1.0) for p in range(factors.count)]
    if factors.basis in (Basis.GLL_LAGRANGE, Basis.GAUSS_LAGRANGE):
        return _lagrange_forms(lagrange_nodes(factors.basis, factors.count))
    raise FormatError(f"expected a polynomial basis, found {factors.basis.label}")


def _jacobi_form(row: Ints) -> list[int]:
    """c^power u^exponent P_n^{a,b}, by P_n^{a,b} = sum_s (-1)^s C(n+a, n-s) C(n+b, s) u^(n-s) c^s (DLMF 18.5.8)."""
    power, exponent, a, b, n = (int(entry) for entry in row[:5])
    jacobi = [(-1) ** s * comb(n + a, n - s) * comb(n + b, s) for s in range(n, -1, -1)]
    return [0] * exponent + jacobi + [0] * power


def _lagrange_forms(nodes: Floats) -> list[Form]:
    """Lagrange polynomials through the float64 nodes, taken as the rational numbers that they are."""
    exact = [Fraction(float(z)) for z in nodes]
    unit = max(z.denominator for z in exact)
    whole = [int(z * unit) for z in exact]
    result: list[Form] = []
    for i, here in enumerate(whole):
        others = whole[:i] + whole[i + 1 :]
        form = [1]
        for z in others:  # times unit (z - z_j) = (unit - z_j) t - (unit + z_j) (1 - t)
            low, high = [-(unit + z) * h for h in form] + [0], [0] + [(unit - z) * h for h in form]
            form = [first + second for first, second in zip(low, high, strict=True)]
        result.append((form, prod(here - z for z in others), 1.0))
    return result


def form_degrees(factors: Factors) -> Ints:
    """(k,) polynomial degree of each factor; raises FormatError for Fourier modes."""
    if isinstance(factors, JacobiFactors):
        return factors.degrees
    return np.array([len(form) - 1 for form, _, _ in forms(factors)], np.int64)


def elevations(factors: Factors, degree: int) -> Floats:
    """(degree + 1, k, degree + 1) Bernstein coefficients of each factor at every degree D <= ``degree``.

    Entry [D, j, i] belongs to C(D, i) t^i (1-t)^(D-i); it is 0 if D is less than the degree of factor j.  Each is
    rounded once from an exact quotient, and once more by an irrational scale.
    """
    exact = forms(factors)
    nets = np.zeros((degree + 1, len(exact), degree + 1))
    for j, (form, denominator, scale) in enumerate(exact):
        for raised in _elevations(form, degree):
            top = len(raised) - 1
            nets[top, j, : top + 1] = [scale * (h / (denominator * comb(top, i))) for i, h in enumerate(raised)]
    return nets


def _elevations(form: list[int], degree: int) -> Iterator[list[int]]:
    """The form at its own degree and at all higher ones: times t + (1 - t) = 1 at each step."""
    while len(form) <= degree + 1:
        yield form
        form = [first + second for first, second in zip([*form, 0], [0, *form], strict=True)]
