"""Chebyshev points, and what makes series of values there, for the host and for kernels (chebyshev.slang)."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints


def series(degree: int) -> tuple[Floats, Floats]:
    """Chebyshev points (n,), n = degree + 1, and the matrix (n, n) from values to coefficients of T_0 to T_degree.

    Cosines are computed from angles up to pi / 4, or as sines: all are accurate to 5 roundings, including zeros.
    """
    n = degree + 1
    odd = 2 * np.arange(n) + 1
    transform = 2 / n * cosines(np.outer(np.arange(n), odd), n)
    transform[0] /= 2
    return cosines(odd, n), transform


def cosines(multiples: Ints, n: int) -> Floats:
    """The cosines of multiples of pi / (2 n)."""
    turned = multiples % (4 * n)
    half = np.minimum(turned, 4 * n - turned)
    quarter = np.minimum(half, 2 * n - half)
    magnitude = np.where(2 * quarter <= n, np.cos(np.pi * quarter / (2 * n)), np.sin(np.pi * (n - quarter) / (2 * n)))
    return np.asarray(np.where(half > n, -magnitude, magnitude))
