"""Tensor products on small boxes as Chebyshev series of a total degree, and how large the terms left out are."""

import numpy as np
import pytest
from kernel_functions import rows_of
from numpy.polynomial import chebyshev

COUNT, N, DEGREE = 24, 4, 7
TERMS = 120


def line_series(middle, half):
    """(n, DEGREE + 2, N + 1) series in s of t^i (1 - t)^(N - i) with 1 - 2 t = -(middle + half s)."""
    nodes = chebyshev.chebpts1(DEGREE + 2)
    t = 0.5 * (1 + middle[:, None] + half[:, None] * nodes)
    i = np.arange(N + 1)
    values = t[..., None] ** i * (1 - t[..., None]) ** (N - i)
    return np.linalg.solve(chebyshev.chebvander(nodes, DEGREE + 1), values)


def test_series_have_all_terms_up_to_their_degree_and_measure_the_next(functions):
    rng = np.random.default_rng(21)
    coefficients = rng.uniform(-1, 1, (COUNT, N + 1, N + 1, N + 1, 3))
    middle, half = rng.uniform(-0.5, 0.5, (COUNT, 3)), rng.choice([0.01, 0.1, 0.5], COUNT)
    kernel = functions("native_series")
    places = rng.uniform(-1, 1, (COUNT, 3))
    found = kernel(rows_of(COUNT, [middle, half, places]), 3 * TERMS + 4, coefficients=coefficients)
    terms, dropped = found[:, :-4].reshape(COUNT, TERMS, 3), found[:, -4:-1]

    # the axis of the side that a place of the cube is nearest to
    assert np.array_equal(found[:, -1], np.argmax(np.abs(places), axis=1))

    x, y, z = (line_series(middle[:, axis], half) for axis in range(3))
    every = np.einsum("nai,nbj,nck,nkjil->ncbal", x, y, z, coefficients)
    order = np.add.outer(np.add.outer(np.arange(9), np.arange(9)), np.arange(9))
    size = np.abs(every).max()
    # with the power of z first, then by the sum of those of x and y, then by that of y
    powers = [(kz, ky, total - ky) for kz in range(8) for total in range(8 - kz) for ky in range(total + 1)]
    assert len(powers) == TERMS
    expected = np.stack([every[:, kz, ky, kx] for kz, ky, kx in powers], axis=1)
    assert np.abs(terms - expected).max() < 1e-14 * size

    of_degree = [np.abs(every[:, order == degree]).sum(axis=1) for degree in (DEGREE, DEGREE + 1)]
    measured = np.maximum(of_degree[1], of_degree[0] / 64) - 64e-15 * np.abs(terms[:, 0])
    assert dropped == pytest.approx(np.maximum(measured, 0), rel=1e-3, abs=1e-14 * size)
    assert (of_degree[1] > of_degree[0] / 64).any()
    assert (of_degree[1] < of_degree[0] / 64)[dropped > 1e-12].any()
