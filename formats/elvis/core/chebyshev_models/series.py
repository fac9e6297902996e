"""Tensor Chebyshev series over boxes, and bounds of their terms.

A box has the coordinates s in [-1, 1]^3.  Its series live on a box that is ROOM times as large, with the coordinates x
= s / ROOM.  Their bounds hold for |s| up to REACH, since rays that are followed through a box may leave it.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from itertools import pairwise

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.polynomials.chebyshev_nodes import cosines, series
from elvis.core.polynomials.rounding import UNIT

#: half sides of the box of a series in s, and of the box on which its bounds hold
ROOM, REACH = 1.25, 1.12
#: orders of derivatives that are bounded: values, first and second derivatives
ORDERS = 3
#: terms in each direction of series whose bounds are taken on parts of boxes
_RESTRICTED = 5
_INNER = REACH / ROOM
#: boxes that are summed together
_IN_CACHE = 32
#: rounding of `on_parts` and of series on eighths, relative to the sum of magnitudes: ample
PARTS_ROUNDING = 1e-11


@bounded_cache
def nodes(count: int) -> Floats:
    """(count,) zeros of the Chebyshev polynomial of that degree, in x."""
    return frozen_floats(series(count - 1)[0])


@bounded_cache
def to_coefficients(count: int) -> Floats:
    """(count, count) from values at the nodes to Chebyshev coefficients."""
    return frozen_floats(series(count - 1)[1])


@bounded_cache
def values_at(count: int, size: int) -> Floats:
    """(count, size) values at ``count`` nodes of T_0 to T_(size - 1), which are cosines."""
    return frozen_floats(cosines(np.outer(2 * np.arange(count) + 1, np.arange(size)), count))


@bounded_cache
def _derivative(size: int) -> Floats:
    """(size, size) matrix from the coefficients of a series to the coefficients of its derivative."""
    matrix = np.zeros((size, size))
    for degree in range(1, size):
        matrix[:degree, degree] = np.polynomial.Chebyshev.basis(degree).deriv().coef
    return frozen_floats(matrix)


def slopes_of(coefficients: Floats, direction: int) -> Floats:
    """(..., size, size, size) coefficients of the derivative along an axis; 0 is the array's last axis, x."""
    matrix = _derivative(coefficients.shape[-1])
    if direction == 0:
        return np.asarray(np.matmul(coefficients, matrix.T))
    if direction == 1:
        return np.asarray(np.matmul(matrix, coefficients))
    return np.asarray(np.einsum("ck,...kba->...cba", matrix, coefficients, optimize=True))


@bounded_cache
def to_half(count: int, side: int) -> Floats:
    """(count, count) from the coefficients of a series to those on the half of its box on one side, -1 or 1.

    The half has s' in [-1, 1], s = (side + s') / 2, so that x = side / (2 ROOM) + x' / 2.  Entries are exact rationals,
    rounded once: T_(k + 1) = 2 x T_k - T_(k - 1), x' T_k = (T_(k + 1) + T_|k - 1|) / 2.
    """
    middle = side / (2 * Fraction(ROOM))
    columns = [[Fraction(1)] + [Fraction(0)] * count, [middle, Fraction(1, 2)] + [Fraction(0)] * (count - 1)]
    while len(columns) < count:
        last, before = columns[-1], columns[-2]
        times = [middle * own for own in last]
        for k in range(count):
            times[k + 1] += last[k] / 4
            times[abs(k - 1)] += last[k] / 4
        columns.append([2 * new - old for new, old in zip(times, before, strict=True)])
    return frozen_floats(np.array([[float(own) for own in column[:count]] for column in columns[:count]]).T)


def along_axes(numbers: Floats, first: Floats, second: Floats, third: Floats) -> Floats:
    """(..., a, b, c) matrices applied to the last three axes, the first to the last axis, x."""
    *leading, a, b, c = numbers.shape
    for matrix in (third, second, first):
        # the first axis becomes the last: each step is one product of matrices for each of the leading numbers
        rows = numbers.reshape(*leading, a, b * c).swapaxes(-1, -2)
        numbers = np.matmul(rows, matrix.swapaxes(-1, -2))
        a, b, c = b, c, matrix.shape[-2]
        numbers = numbers.reshape(*leading, a, b, c)
    return np.asarray(numbers)


def coefficients_of(values: Floats) -> Floats:
    """(..., count, count, count) Chebyshev coefficients of values at the nodes."""
    matrix = to_coefficients(values.shape[-1])
    return along_axes(values, matrix, matrix, matrix)


def on_parts(series: Floats, centre: Floats, ratio: Floats) -> Floats:
    """(n, m, count, count, count) series on parts of their boxes, but for some rounding (`PARTS_ROUNDING`).

    centre  (n, 3) centres of the parts, in the coordinates s of the boxes
    ratio   (n,) sides of the parts divided by sides of the boxes
    """
    matrices = part_matrices(series.shape[-1], centre, ratio)
    return along_axes(series, *(matrices[:, None, axis] for axis in range(3)))


def part_matrices(count: int, centre: Floats, ratio: Floats) -> Floats:
    """(..., 3, count, count) from the coefficients of series to those on parts of boxes, as in `on_parts`."""
    places = centre[..., None] / ROOM + ratio[..., None, None] * nodes(count)
    return np.asarray(to_coefficients(count) @ np.polynomial.chebyshev.chebvander(places, count - 1))


@bounded_cache
def _to_inner_halves(count: int, reach: float) -> Floats:
    """(2 count, count) from the coefficients of a series to those on both halves of the box |s| <= 1, enlarged."""
    points = reach * nodes(count)
    places = [(side + points) / (2.0 * ROOM) for side in (-1, 1)]
    values = [np.polynomial.chebyshev.chebvander(place, count - 1) for place in places]
    return frozen_floats(np.concatenate([to_coefficients(count) @ own for own in values]))


@bounded_cache
def _sums_of_halves(count: int) -> Floats:
    """(2, 2 count) sums over the terms of both halves of `_to_inner_halves`."""
    return frozen_floats(np.kron(np.eye(2), np.ones(count)))


def magnitudes_of(coefficients: Floats, first: int = 0) -> Floats:
    """(n,) sums of the magnitudes of coefficients (n, count, count, count), without the ``first`` of each series."""
    flat = np.abs(coefficients).reshape(len(coefficients), coefficients.shape[-1] ** 3)
    return np.asarray(flat[:, first:].sum(axis=1))


def bounds_in_eighths(coefficients: Floats, total: Floats, reach: float = 1.0) -> tuple[Floats, Floats]:
    """Means (n, 8), and maximum distances from them (n, 8), of series (n, count, count, count) on eighths of |s| <= 1.

    The eighths are enlarged by the factor ``reach``, REACH at most.  Only terms of low degree are restricted.  The
    distances include the others, and the rounding of the restriction, for which the reserve is ample.

    total  (n,) sums of the magnitudes of the coefficients
    """
    boxes, count = len(coefficients), min(coefficients.shape[-1], _RESTRICTED)
    low = coefficients[:, :count, :count, :count]
    halves, sums = _to_inner_halves(count, reach), _sums_of_halves(count)
    parts = along_axes(low, halves, halves, halves)
    mean = parts[:, ::count, ::count, ::count].reshape(boxes, 8)
    sizes = along_axes(np.abs(parts), sums, sums, sums).reshape(boxes, 8)
    # the difference of both sums may be slightly negative by rounding, which the reserve covers
    reserve = total - magnitudes_of(low) + PARTS_ROUNDING * total
    return mean, sizes - np.abs(mean) + reserve[:, None]


@bounded_cache
def _shell_sums(count: int) -> Floats:
    """(count^2, count) from terms of two degrees to the sums of those whose highest degree is k."""
    k = np.arange(count)
    return frozen_floats(np.maximum(k[:, None], k).reshape(-1, 1) == k)


def shells_of(coefficients: Floats) -> Floats:
    """(n, count) sums of the magnitudes of the coefficients (n, count, count, count) whose highest degree is k."""
    count = coefficients.shape[-1]
    sums = _shell_sums(count)
    # the highest of two degrees first, then of that and the third; few boxes at a time stay in the processor's cache
    found = np.empty((len(coefficients), count))
    for first in range(0, len(coefficients), _IN_CACHE):
        some = np.abs(coefficients[first : first + _IN_CACHE]).reshape(-1, count, count * count)
        pairs = np.matmul(some, sums).reshape(-1, 1, count * count)
        found[first : first + _IN_CACHE] = np.matmul(pairs, sums)[:, 0]
    return found


@cache
def growth(count: int) -> Floats:
    """(ORDERS, count) bounds, where |s| <= REACH, of terms of shell k and of their derivatives in x.

    |T_k| <= 1; |T_k'| <= k / sqrt(1 - x^2), and k^2 at most; from (1 - x^2) T_k'' = x T_k' - k^2 T_k follows the
    second, and mixed derivatives are products of first ones.
    """
    k = np.arange(count, dtype=float)
    steep = 1.0 / np.sqrt(1.0 - _INNER * _INNER)
    first = np.minimum(k * k, k * steep)
    second = np.minimum(k * k * (k * k - 1.0) / 3.0, (_INNER * k * steep + k * k) * steep * steep)
    return frozen_floats(np.stack([np.ones(count), first, np.maximum(np.maximum(second, 0.0), first * first)]))


def sizes_of(shells: Floats) -> Floats:
    """(ORDERS, n) bounds of series and of their derivatives in x, from their shells (n, count)."""
    return np.asarray(growth(shells.shape[1]) @ shells.T)


def tails_of(shells: Floats) -> Floats:
    """(ORDERS, n, count) bounds of the terms of a degree and beyond, and of their derivatives, for each degree."""
    terms = growth(shells.shape[1])[:, None] * shells
    return np.asarray(np.cumsum(terms[..., ::-1], axis=-1)[..., ::-1])


@cache
def steepness(count: int, order: int) -> float:
    """Maximum of a derivative in x for |s| <= REACH, relative to a polynomial of ``count`` terms on its whole box.

    Bernstein's inequality is |p'| <= n / sqrt(1 - x^2); higher orders use nested boxes.  The factor is at most n^2 for
    each order (A. A. Markov 1889).
    """
    degree, found = count - 1, 1.0
    boxes = np.linspace(1.0, _INNER, order + 1)
    for outer, inner in pairwise(boxes):
        found *= degree * min(degree, 1.0 / np.sqrt(1.0 - (inner / outer) ** 2)) / outer
    return float(found)


def amplification(count: int) -> float:
    """Maximum amplification from errors at the nodes to the error of a series: the Lebesgue constant, cubed.

    For n Chebyshev points it is at most 1 + 2 / pi log(n) (Rivlin 1974, The Chebyshev polynomials, 1.3).
    """
    return float((1.0 + 0.637 * np.log(count)) ** 3)


def sum_rounding(count: int) -> float:
    """Rounding of a sum of three passes over ``count`` terms, relative to the sum of magnitudes.

    A pass has products and sums of ``count`` terms and table entries that are accurate to 8 units (Higham 2002,
    Accuracy and Stability of Numerical Algorithms, 3.1 and 3.5).
    """
    return 3.0 * (count + 8) * UNIT


def kernel_rounding(count: int) -> float:
    """Rounding of sums of series in kernels, relative to the sum of magnitudes (`rounded` in iso_leaves.slang)."""
    return (15.0 * count**2 + 3.0 * (count + 1)) * 1.1 * UNIT


def transform_rounding(count: int) -> float:
    """Rounding of coefficients from values at the nodes, relative to the sum of their magnitudes (iso_series.slang)."""
    return 6.0 * count**2 * (count + 7) * 1.1 * UNIT
