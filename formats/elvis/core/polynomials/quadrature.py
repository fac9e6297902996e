"""Nodes and Gauss-type quadrature on [-1, 1], accurate to rounding.

A rule of weight (1 - z)^alpha (1 + z)^beta is a pair (nodes, weights), both (n,), nodes ascending.  Source: Karniadakis
and Sherwin, Spectral/hp Element Methods for CFD, appendix B; node families by name as in format notes 1.8.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from math import gamma
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import FormatError
from elvis.core.polynomials.jacobi import jacobi, jacobi_with_derivative

Rule: TypeAlias = tuple[Floats, Floats]


def jacobi_roots(count: int, alpha: float, beta: float) -> Floats:
    """(count,) ascending roots of P_count^{alpha,beta}: Golub-Welsch eigenvalues, polished by Newton's method."""
    if count == 0:
        return np.empty(0)
    roots = np.linalg.eigvalsh(_jacobi_matrix(count, alpha, beta)).astype(np.float64)
    for _ in range(3):
        values, derivatives = jacobi_with_derivative(count, alpha, beta, roots)
        roots = roots - values[-1] / derivatives[-1]
    return 0.5 * (roots - roots[::-1]) if alpha == beta else roots


def _jacobi_matrix(count: int, alpha: float, beta: float) -> Floats:
    """(count, count) symmetric tridiagonal matrix whose eigenvalues are the roots of P_count^{alpha,beta}."""
    n = np.arange(1, count, dtype=np.float64)
    total = 2 * n + alpha + beta
    middle = np.append((beta - alpha) / (alpha + beta + 2), (beta**2 - alpha**2) / (total * (total + 2)))

    # the first product is written without the factor (1 + alpha + beta), which may vanish on both sides
    ratio = np.append(1.0, (n[1:] + alpha + beta) / (total[1:] - 1))[: len(n)]
    squares = 4 * n * (n + alpha) * (n + beta) * ratio / (total**2 * (total + 1))
    return np.diag(middle) + np.diag(np.sqrt(squares), 1) + np.diag(np.sqrt(squares), -1)


@bounded_cache
def gauss(count: int, alpha: float = 0, beta: float = 0) -> Rule:
    """``count`` >= 1 inner nodes, exact to degree 2 count - 1; read-only."""
    nodes = jacobi_roots(count, alpha, beta)
    derivatives = jacobi_with_derivative(count, alpha, beta, nodes)[1][-1]
    scale = (count + 1 + alpha + beta) * _scale(count + 1, alpha, beta)
    return _freeze((nodes, scale / ((1 - nodes**2) * derivatives**2)))


def radau_minus(count: int, alpha: float = 0, beta: float = 0) -> Rule:
    """``count`` >= 1 nodes, the first at -1, exact to degree 2 count - 2."""
    inner, weights = gauss(count - 1, alpha, beta + 1) if count > 1 else (np.empty(0), np.empty(0))
    first = (beta + 1) * _scale(count, alpha, beta) / (beta + count) / jacobi(count - 1, alpha, beta, _MINUS)[-1] ** 2
    return np.append(-1.0, inner), np.append(first, weights / (1 + inner))


def radau_plus(count: int, alpha: float = 0, beta: float = 0) -> Rule:
    """``count`` >= 1 nodes, the last at +1, exact to degree 2 count - 2."""
    nodes, weights = radau_minus(count, beta, alpha)
    return -nodes[::-1], weights[::-1].copy()


def lobatto(count: int, alpha: float = 0, beta: float = 0) -> Rule:
    """``count`` >= 2 nodes with both ends, exact to degree 2 count - 3."""
    inner, weights = gauss(count - 2, alpha + 1, beta + 1) if count > 2 else (np.empty(0), np.empty(0))
    scale = _scale(count, alpha, beta) / (count - 1)
    first = (beta + 1) * scale / jacobi(count - 1, alpha, beta, _MINUS)[-1] ** 2
    last = (alpha + 1) * scale / jacobi(count - 1, alpha, beta, -_MINUS)[-1] ** 2
    nodes = np.concatenate([_MINUS, inner, -_MINUS])
    return nodes, np.concatenate([first, weights / (1 - inner**2), last])


_MINUS = np.array([-1.0])


def _scale(count: int, alpha: float, beta: float) -> float:
    """2^(a+b+1) Gamma(a+n) Gamma(b+n) / (Gamma(n) Gamma(a+b+n+1)): the integral of the weight, times exact ratios."""
    k = np.arange(1, count)
    integral = 2.0 ** (alpha + beta + 1) * gamma(alpha + 1) * gamma(beta + 1) / gamma(alpha + beta + 2)
    return float(integral * np.prod((alpha + k) * (beta + k) / (k * (alpha + beta + 1 + k))))


@bounded_cache
def gll(count: int) -> Rule:
    """Gauss-Lobatto-Legendre, ``count`` >= 2 nodes; read-only."""
    return _freeze(lobatto(count))


@bounded_cache
def grm10(count: int) -> Rule:
    """Gauss-Radau-Jacobi with node -1 and weight (1 - z)/2, the collapse of a triangle; read-only."""
    nodes, weights = radau_minus(count, 1, 0)
    return _freeze((nodes, weights / 2))


@bounded_cache
def grm20(count: int) -> Rule:
    """Gauss-Radau-Jacobi with node -1 and weight ((1 - z)/2)^2, the collapse of an apex; read-only."""
    nodes, weights = radau_minus(count, 2, 0)
    return _freeze((nodes, weights / 4))


def _freeze(rule: Rule) -> Rule:
    return frozen_floats(rule[0]), frozen_floats(rule[1])


def evenly_spaced(count: int) -> Floats:
    """(count,) nodes from -1 to 1; the single node is 0."""
    return np.linspace(-1, 1, count) if count > 1 else np.zeros(1)


def fourier_evenly_spaced(count: int) -> Floats:
    """(count,) nodes -1 + 2 k / count of one period, the end left out."""
    return -1 + 2 * np.arange(count) / count


_Nodes: TypeAlias = Callable[[int], Floats]


def _nodes_of(rule: Callable[[int, float, float], Rule], alpha: float, beta: float) -> _Nodes:
    return lambda count: rule(count, alpha, beta)[0]


#: one-dimensional node families by PointsType name
FAMILIES: Mapping[str, _Nodes] = {
    "GaussGaussLegendre": _nodes_of(gauss, 0, 0),
    "GaussRadauMLegendre": _nodes_of(radau_minus, 0, 0),
    "GaussRadauPLegendre": _nodes_of(radau_plus, 0, 0),
    "GaussLobattoLegendre": _nodes_of(lobatto, 0, 0),
    "GaussGaussChebyshev": _nodes_of(gauss, -0.5, -0.5),
    "GaussRadauMChebyshev": _nodes_of(radau_minus, -0.5, -0.5),
    "GaussRadauPChebyshev": _nodes_of(radau_plus, -0.5, -0.5),
    "GaussLobattoChebyshev": _nodes_of(lobatto, -0.5, -0.5),
    "GaussRadauMAlpha0Beta1": _nodes_of(radau_minus, 0, 1),
    "GaussRadauMAlpha0Beta2": _nodes_of(radau_minus, 0, 2),
    "GaussRadauMAlpha1Beta0": _nodes_of(radau_minus, 1, 0),
    "GaussRadauMAlpha2Beta0": _nodes_of(radau_minus, 2, 0),
    "PolyEvenlySpaced": evenly_spaced,
    "FourierEvenlySpaced": fourier_evenly_spaced,
    "FourierSingleModeSpaced": fourier_evenly_spaced,
}


def line_nodes(family: str, count: int) -> Floats:
    """(count,) nodes of the family that files call ``family``.

    Raises FormatError if the family is not one-dimensional or not supported, or has no rule of so few nodes.
    """
    least = 2 if "Lobatto" in family or family == "PolyEvenlySpaced" else 1
    if family not in FAMILIES:
        raise FormatError(f"expected a one-dimensional node family ({', '.join(FAMILIES)}), found {family}")
    if count < least:
        raise FormatError(f"expected at least {least} {family} nodes, found {count}")
    return FAMILIES[family](count)
