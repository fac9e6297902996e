"""Taylor expansions of polynomials on boxes, and their ranges on discs of the three coordinates."""

from __future__ import annotations

from math import factorial

import numpy as np

from elvis.core.base.arrays import EPS, Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.quantities.discs import Disc

#: rounding of values on discs, relative to the sum of the magnitudes of all terms
ROUNDING = 64 * EPS
#: powers of s and t in the terms of a curved surface, in the order of its coefficients
BENDS = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
#: the highest power of each
_BENT = 2


def taylor(nets: Floats, places: Floats, sizes: Floats) -> Floats:
    """(n, A, B, C) coefficients c of sum c_abc s^a t^b u^c from Bernstein nets (n, A, B, C) on [0, 1]^3.

    places  (n, 3) centres of the expansions
    sizes   (n, 3) of the units of s, t and u
    """
    found = nets
    for axis in range(3):
        degree = found.shape[1] - 1
        tables = line_tables(degree, places[:, axis], degree)
        scale = sizes[:, axis] ** np.arange(degree + 1)[:, None] / _factorials(degree + 1)[:, None]
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


def straightened(coefficients: Floats, bends: Floats) -> Floats:
    """Coefficients in s, t, u of a polynomial whose third coordinate is u + P(s, t), with P of coefficients (n, 5).

    Uses Horner's method in that coordinate.  P must not depend on s if the first direction is missing.
    """
    _, a, b, c = coefficients.shape
    planes = [coefficients[..., c - 1]]
    for power in range(c - 2, -1, -1):
        products = [_bent(plane, bends) for plane in planes]
        products[0][:, :a, :b] += coefficients[..., power]
        for product, lower in zip(products[1:], planes[:-1], strict=True):
            product += lower
        planes = [*products, planes[-1]]
    found = np.zeros((*planes[0].shape, c))
    for power, plane in enumerate(planes):
        found[:, : plane.shape[1], : plane.shape[2], power] = plane
    return found


def _bent(plane: Floats, bends: Floats) -> Floats:
    """The product of a polynomial of s and t (n, A, B) with P."""
    n, a, b = plane.shape
    found = np.zeros((n, a + _BENT * (a > 1), b + _BENT))
    for (i, j), factor in zip(BENDS, bends.T, strict=True):
        if a > 1 or not i:
            found[:, i : i + a, j : j + b] += factor[:, None, None] * plane
    return found


def multiplied(coefficients: Floats, slopes: Floats) -> Floats:
    """The coefficients times 1 + p s + q t, with slopes (n, 2) p and q; p is 0 without a first direction."""
    n, a, b, c = coefficients.shape
    found = np.zeros((n, a + (a > 1), b + 1, c))
    p, q = slopes.T[:, :, None, None, None]
    found[:, :a, :b] = coefficients
    found[:, :a, 1:] += q * coefficients
    if a > 1:
        found[:, 1:, :b] += p * coefficients
    return found


def majorants(coefficients: Floats, first: Floats, second: Floats) -> Floats:
    """(n, columns, C) sums |c_abc| r^a s^b for each c, with radii r and s (n, columns) of the first two coordinates.

    Sums grow with the radii.  Columns whose r is at most that of column 0 have the sums over a of column 0: these are
    the columns of ellipses in other directions, where r is the same, and those in which nothing is proved.
    """
    n, a, b, c = coefficients.shape
    sizes = np.abs(coefficients).reshape(n, a, b * c)
    is_own = (first > first[:, :1]).any(axis=0)
    is_own[:1] = False
    common = (powers_of(first[:, :1], a) @ sizes).reshape(n, b, c)
    own = (powers_of(first[:, is_own], a) @ sizes).reshape(n, int(is_own.sum()), b, c)
    found = np.empty((*first.shape, c))
    found[:, ~is_own] = powers_of(second[:, ~is_own], b) @ common
    found[:, is_own] = np.einsum("nqb,nqbc->nqc", powers_of(second[:, is_own], b), own)
    return found


def constant_and_rest(coefficients: Floats, by_power: Floats, radius: Floats) -> Disc:
    """The disc of all values, around the constant (n, 1).

    by_power  (n, columns, C) bounds of the coefficients of each power of u
    radius    (n, columns) of the disc of u
    """
    total = by_power[..., -1]
    for power in range(by_power.shape[2] - 2, -1, -1):
        total = total * radius + by_power[..., power]
    constant = coefficients[:, 0, 0, 0][:, None]
    return constant, np.maximum(total - np.abs(constant), 0.0) + ROUNDING * total


def powers_of(radii: Floats, count: int) -> Floats:
    """(..., count) powers from 0."""
    found = np.ones((*radii.shape, count))
    for power in range(1, count):
        found[..., power] = found[..., power - 1] * radii
    return found


@bounded_cache
def _factorials(count: int) -> Floats:
    return frozen_floats([factorial(k) for k in range(count)])
