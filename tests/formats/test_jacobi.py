"""Jacobi polynomials against their exact rational values, and the identities between them."""

from fractions import Fraction
from math import comb

import numpy as np
import pytest

from elvis.core.polynomials.jacobi import jacobi, jacobi_with_derivative
from elvis.core.polynomials.quadrature import gauss

WEIGHTS = [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (5, 1), (17, 0), (39, 1), (-0.5, -0.5), (0.5, 0.5)]
POINTS = np.linspace(-1, 1, 33)
WHOLE = [pair for pair in WEIGHTS if all(float(a).is_integer() for a in pair)]


def exact(n, a, b, x):
    """P_n^{a,b}(x) in rational arithmetic, by its explicit sum."""
    low, high = (Fraction(x) - 1) / 2, (Fraction(x) + 1) / 2
    return sum(comb(n + a, n - s) * comb(n + b, s) * low**s * high ** (n - s) for s in range(n + 1))


@pytest.mark.parametrize(("a", "b"), WHOLE)
def test_values_match_those_of_the_explicit_sum(a, b):
    points = np.linspace(-1, 1, 17)
    table = jacobi(20, a, b, points)
    for n in range(21):
        expected = np.array([float(exact(n, a, b, x)) for x in points])
        assert np.abs(table[n] - expected).max() <= 1e-14 * (1 + n) * np.abs(expected).max()


@pytest.mark.parametrize(("a", "b"), WEIGHTS)
def test_values_at_one_follow_the_classical_normalisation(a, b):
    expected = np.cumprod(np.append(1.0, [(k + a) / k for k in range(1, 21)]))
    assert jacobi(20, a, b, np.ones(1))[:, 0] == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize(("a", "b"), WEIGHTS)
def test_reflection_swaps_the_weights(a, b):
    signs = (-1.0) ** np.arange(13)
    left, right = jacobi(12, a, b, -POINTS), signs[:, None] * jacobi(12, b, a, POINTS)
    assert np.allclose(left, right, rtol=0, atol=1e-13 * np.abs(left).max())


@pytest.mark.parametrize(("a", "b"), WEIGHTS)
def test_derivatives_are_polynomials_of_raised_weights(a, b):
    derivatives = jacobi_with_derivative(20, a, b, POINTS)[1]
    n = np.arange(1, 21)[:, None]
    expected = (n + a + b + 1) / 2 * jacobi(19, a + 1, b + 1, POINTS)
    assert not derivatives[0].any()
    assert (np.abs(derivatives[1:] - expected) <= 3e-13 * np.abs(expected).max(axis=1, keepdims=True)).all()


@pytest.mark.parametrize(("a", "b"), WEIGHTS)
def test_polynomials_are_orthogonal(a, b):
    nodes, weights = gauss(21, a, b)
    table = jacobi(20, a, b, nodes)
    gram = (table * weights) @ table.T
    norms = np.sqrt(np.diag(gram))
    assert np.abs(gram / np.outer(norms, norms) - np.eye(21)).max() < 2e-13


def test_degree_zero_is_one_and_flat():
    values, derivatives = jacobi_with_derivative(0, 3, 1, np.linspace(-1, 1, 5))
    assert values.shape == derivatives.shape == (1, 5)
    assert (values == 1).all()
    assert (derivatives == 0).all()
