"""Taylor expansions of polynomials on boxes, and what they attain on discs of their three coordinates."""

from __future__ import annotations

from math import factorial

import numpy as np

from elvis.core.arrays import Floats
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.quantities.discs import Disc

#: rounding of values on discs, in parts of the sum of the magnitudes of all terms
_ROUNDING = 64 * float(np.finfo(np.float64).eps)


def taylor(nets: Floats, places: Floats, sizes: Floats) -> Floats:
    """(n, A, B, C) coefficients c of sum c_abc s^a t^b u^c from Bernstein nets (n, A, B, C) on [0, 1]^3.

    places  (n, 3) centres of the expansions
    sizes   (n, 3) of the units of s, t and u
    """
    found = nets
    for axis in range(3):
        degree = found.shape[1] - 1
        tables = line_tables(degree, places[:, axis], degree)
        orders = np.arange(degree + 1)
        scale = sizes[:, axis] ** orders[:, None] / [[factorial(order)] for order in orders]
        matrices = (tables * scale[:, :, None]).transpose(1, 0, 2)
        rest = found.shape[2:]
        found = matrices @ found.reshape(len(found), degree + 1, int(np.prod(rest)))
        found = np.moveaxis(found.reshape(-1, degree + 1, *rest), 1, -1)
    return np.ascontiguousarray(found)


def slope(coefficients: Floats, axis: int) -> Floats:
    """Coefficients of the derivative in a direction, 0 to 2."""
    degree = coefficients.shape[1 + axis] - 1
    if degree == 0:
        return np.zeros_like(coefficients)
    powers = np.arange(1, degree + 1).reshape([-1 if other == axis else 1 for other in range(3)])
    return np.take(coefficients, range(1, degree + 1), axis=1 + axis) * powers


def sheared(coefficients: Floats, slopes: Floats) -> Floats:
    """Coefficients in s, t, u of a polynomial whose third coordinate is u + p s + q t, with slopes (n, 2) p and q.

    By Horner's method in that coordinate.  Without a first direction p is 0.
    """
    n, a, b, c = coefficients.shape
    first = a if a == 1 else a + c - 1
    found = np.zeros((n, first, b + c - 1, c))
    p, q = slopes.T[:, :, None, None, None]
    for power in range(c - 1, -1, -1):
        product = np.zeros_like(found)
        product[..., 1:] += found[..., :-1]
        product[:, :, 1:] += q * found[:, :, :-1]
        product[:, 1:] += p * found[:, :-1]
        found = product
        found[:, :a, :b, 0] += coefficients[..., power]
    return found


def majorants(coefficients: Floats, first: Floats, second: Floats) -> Floats:
    """(n, columns, C) sums |c_abc| r^a s^b for each c, with radii r and s (n, columns) of the first two coordinates."""
    n, a, b, c = coefficients.shape
    sizes = np.abs(coefficients)
    found = _powers(first, a) @ sizes.reshape(n, a, b * c)
    return np.asarray(np.einsum("nqb,nqbc->nqc", _powers(second, b), found.reshape(n, first.shape[1], b, c)))


def on_discs(coefficients: Floats, radii: tuple[Floats, Floats, Floats]) -> Disc:
    """The disc around the constant (n, 1) that holds all values on discs with radii (n, columns) around the centre."""
    by_last = majorants(coefficients, radii[0], radii[1])
    total = np.einsum("nqc,nqc->nq", by_last, _powers(radii[2], by_last.shape[2]))
    constant = coefficients[:, 0, 0, 0][:, None]
    return constant, np.maximum(total - np.abs(constant), 0.0) + _ROUNDING * total


def _powers(radii: Floats, count: int) -> Floats:
    """(..., count) powers from 0."""
    return np.asarray(radii[..., None] ** np.arange(count))
