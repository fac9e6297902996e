"""Jacobi polynomials P_n^{a,b} in the classical normalisation P_n^{a,b}(1) = C(n + a, n).

All degrees come at once: row n of a result is the polynomial of degree n, because the recurrences run over rows.
"""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.bounded_cache import bounded_cache


def jacobi(degree: int, alpha: float, beta: float, points: Floats) -> Floats:
    """(degree + 1, n) values of P_0 to P_degree at ``points`` (n,); alpha, beta > -1."""
    x = np.asarray(points, np.float64)
    values = np.zeros((degree + 1, len(x)))
    values[0] = 1.0
    if degree > 0:
        values[1] = ((alpha + beta + 2) * x + alpha - beta) / 2
    for n in range(1, degree):
        factor, shift, weight = _recurrence(n, alpha, beta)
        values[n + 1] = (factor * x + shift) * values[n] - weight * values[n - 1]
    return values


def jacobi_with_derivative(degree: int, alpha: float, beta: float, points: Floats) -> tuple[Floats, Floats]:
    """Values and derivatives, (degree + 1, n) each, of P_0 to P_degree at ``points`` (n,).

    Three-term recurrence of DLMF 18.9.2 and its derivative; stable on [-1, 1].
    """
    x = np.asarray(points, np.float64)
    values, derivatives = np.zeros((2, degree + 1, len(x)))
    values[0] = 1.0
    if degree > 0:
        values[1] = ((alpha + beta + 2) * x + alpha - beta) / 2
        derivatives[1] = (alpha + beta + 2) / 2

    # P_{n+1} = (factor x + shift) P_n - weight P_{n-1}, and the same differentiated
    for n in range(1, degree):
        factor, shift, weight = _recurrence(n, alpha, beta)
        line = factor * x + shift
        values[n + 1] = line * values[n] - weight * values[n - 1]
        derivatives[n + 1] = line * derivatives[n] + factor * values[n] - weight * derivatives[n - 1]
    return values, derivatives


@bounded_cache
def _recurrence(n: int, alpha: float, beta: float) -> tuple[float, float, float]:
    """Coefficients of the step from degrees n - 1 and n to n + 1, n >= 1."""
    total = 2 * n + alpha + beta
    divisor = 2 * (n + 1) * (n + alpha + beta + 1) * total
    factor = total * (total + 1) * (total + 2) / divisor
    shift = (total + 1) * (alpha * alpha - beta * beta) / divisor
    weight = 2 * (n + alpha) * (n + beta) * (total + 2) / divisor
    return factor, shift, weight
