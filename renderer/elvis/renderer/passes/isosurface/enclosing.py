"""Quantities that are not polynomials, enclosed: what the kernels read of them (iso_enclose.slang)."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache

#: long half axes of the ellipses that are tried, as in iso_enclose.slang: the first is the real box
AXES = (1.0, 1.6, 2.2, 3.2, 5.0, 8.0, 13.0)
#: half sides of boxes that errors are known on
BOXES = (1.0, 1.01, 1.02, 1.03, 1.05, 1.07, 1.1, 1.14, 1.18, 1.24, 1.32, 1.42)
#: terms of the sums, and the largest ratio of one to the one before
_TERMS, _SLOWEST = 400, 0.85


@bounded_cache
def tails(degree: int) -> Floats:
    """Bounds (ellipses, boxes, 4) on the error of a function's series of a degree, relative to M (iso_enclose.slang).

    Values, first derivatives, second ones along one direction, and across two.  Infinite if the sums don't converge.

    A term T_k that the series lacks equals T_j, j <= degree, at the Chebyshev points: both count.  With the sums of
    w_k r^-k T_k and of derivatives, w_0 = 1, else 2, over all k (``whole``) and over k beyond the degree (``rest``),
    terms beyond the degree in at least one direction sum to `rest` of that direction times `whole` of the others.
    """
    found = np.full((len(AXES), len(BOXES), 4), np.inf)
    for e, axis in enumerate(AXES):
        for b, box in enumerate(BOXES):
            ratio = axis + np.sqrt(axis * axis - 1.0)
            if (box + np.sqrt(box * box - 1.0)) / ratio <= _SLOWEST:
                found[e, b] = _tails(degree, ratio, box)
    return frozen_floats(found)


def powers(transform: Floats) -> Floats:
    """The matrix (n, n) from values at Chebyshev points to powers; ``transform`` leads to Chebyshev series."""
    count = len(transform)
    monomials = np.zeros((count, count))
    for k in range(count):
        monomials[: k + 1, k] = chebyshev.cheb2poly(np.eye(count)[k, : k + 1])
    return np.ascontiguousarray(monomials @ transform)


def _tails(degree: int, ratio: float, box: float) -> Floats:
    terms = _growth(box) * (2.0 * ratio ** -np.arange(_TERMS, dtype=float))
    terms[:, 0] /= 2.0
    whole, rest = terms.sum(axis=1), terms[:, degree + 1 :].sum(axis=1)
    value = 3.0 * rest[0] * whole[0] ** 2
    first = rest[1] * whole[0] ** 2 + 2.0 * rest[0] * whole[0] * whole[1]
    pure = rest[2] * whole[0] ** 2 + 2.0 * rest[0] * whole[0] * whole[2]
    mixed = 2.0 * rest[1] * whole[1] * whole[0] + rest[0] * whole[1] ** 2
    return 2.0 * (1.0 + 1e-9) * np.array([value, first, pure, mixed])


def _growth(box: float) -> Floats:
    """(3, terms) the largest values of T_k and of its first and second derivative on [-box, box]."""
    found = np.zeros((3, _TERMS))
    found[0, 0], found[:2, 1] = 1.0, (box, 1.0)
    for k in range(2, _TERMS):
        found[:, k] = 2.0 * box * found[:, k - 1] - found[:, k - 2]
        found[1, k] += 2.0 * found[0, k - 1]
        found[2, k] += 4.0 * found[1, k - 1]
    return found
