"""Arithmetic of intervals: enclosures of all values of a function over intervals of its operands, up to rounding.

An interval is a pair of arrays, minimum and maximum; both are NaN if a function has no value at all.  Parts of the
intervals without a value are ignored: the root of [-1, 4] is [0, 2].
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from elvis.core.base.arrays import EPS, Floats

Interval = tuple[Any, Any]
ENTIRE: Interval = (-np.inf, np.inf)
#: rounding of functions that are evaluated in many steps, relative to the size of their terms
_ROUNDING = 64 * EPS


def largest_solution(size: Any, norm: Any) -> Any:
    """An upper bound of |g| for g = first - R g, from |first| and |R|; infinite if nothing is proved.

    |g| <= |first| / (1 - |R|) in the norm of the largest (Neumaier 1990, Interval methods for systems of equations,
    4.2).
    """
    return np.where(norm < 1, size / np.where(norm < 1, 1 - norm, 1.0), np.inf)


def number(value: float) -> Interval:
    """The interval of one number."""
    return np.float64(value), np.float64(value)


def plus(a: Interval, b: Interval) -> Interval:
    """a + b."""
    return _sound(a[0] + b[0], a[1] + b[1], a, b)


def minus(a: Interval, b: Interval) -> Interval:
    """a - b."""
    return _sound(a[0] - b[1], a[1] - b[0], a, b)


def times(a: Interval, b: Interval) -> Interval:
    """a b; zero times anything is zero."""
    if a is b:
        return _even(a, 2)
    products = [_product(x, y) for x in a for y in b]
    low = _fold(np.minimum, products)
    high = _fold(np.maximum, products)
    return _sound(low, high, a, b)


def _product(x: Any, y: Any) -> Any:
    return np.where((x == 0) | (y == 0), 0.0, x * y)


def _fold(choose: Any, arrays: list[Any]) -> Any:
    """The first two arrays combined, then that with the next, and so on."""
    result = arrays[0]
    for other in arrays[1:]:
        result = choose(result, other)
    return result


def over(a: Interval, b: Interval) -> Interval:
    """a / b; everything where b may be zero."""
    has_zero = (b[0] <= 0) & (b[1] >= 0)
    divisors = [np.where(has_zero, 1.0, end) for end in b]
    quotients = [x / y for x in a for y in divisors]
    low, high = _entire_where(has_zero, _hull(quotients))
    return _sound(low, high, a, b)


def _hull(corners: list[Any]) -> Interval:
    """The interval from the minimum to the maximum of some arrays."""
    return _fold(np.minimum, corners), _fold(np.maximum, corners)


def _entire_where(condition: Any, a: Interval) -> Interval:
    """Everything where a condition holds."""
    return np.where(condition, -np.inf, a[0]), np.where(condition, np.inf, a[1])


def _empty_where(condition: Any, a: Interval) -> Interval:
    """No value where a condition holds."""
    return np.where(condition, np.nan, a[0]), np.where(condition, np.nan, a[1])


def power(a: Interval, b: Interval) -> Interval:
    """a^b: exact for whole constant exponents."""
    is_constant = np.ndim(b[0]) == 0 and b[0] == b[1]
    exponent = float(b[0]) if is_constant else np.nan
    if exponent.is_integer():
        if exponent < 0:
            return over(number(1.0), power(a, number(-exponent)))
        is_even = exponent % 2 == 0
        return _even(a, int(exponent)) if is_even else increasing(lambda x: x**exponent)(a)
    return _with_negative_bases(_of_corners(_clip(a, 0.0, np.inf), b), a, b)


def _of_corners(a: Interval, b: Interval) -> Interval:
    """a^b of bases that aren't negative: b log a is extreme at the ends of both."""
    return _hull([np.power(x, y) for x in a for y in b])


def _with_negative_bases(found: Interval, a: Interval, b: Interval) -> Interval:
    """The interval extended by values of negative bases, which have only integer powers.

    Positive for an even exponent.
    """
    is_whole = (np.ceil(b[0]) <= np.floor(b[1])) & (a[0] < 0)
    low, high = _of_corners((np.maximum(-a[1], 0.0), np.maximum(-a[0], 0.0)), b)
    is_even = (b[0] == b[1]) & (np.remainder(b[0], 2) == 0)
    low = np.where(is_even, low, -high)
    return np.where(is_whole, np.fmin(found[0], low), found[0]), np.where(is_whole, np.fmax(found[1], high), found[1])


def _even(a: Interval, n: int) -> Interval:
    """a^n for even n."""
    low, high = absolute(a)
    return low**n, high**n


def increasing(function: Callable[[Any], Any]) -> Callable[[Interval], Interval]:
    """A function that grows everywhere."""
    return lambda a: (function(a[0]), function(a[1]))


def absolute(a: Interval) -> Interval:
    """|a|."""
    across = (a[0] <= 0) & (a[1] >= 0)
    low, high = np.abs(a[0]), np.abs(a[1])
    return np.where(across, 0.0, np.minimum(low, high)), np.maximum(low, high)


def sign(a: Interval) -> Interval:
    """-1, 0 or 1."""
    return np.sign(a[0]), np.sign(a[1])


def step(a: Interval, b: Interval) -> Interval:
    """1 if a < b."""
    return np.where(a[1] < b[0], 1.0, 0.0), np.where(a[0] < b[1], 1.0, 0.0)


def least(a: Interval, b: Interval) -> Interval:
    """The lesser."""
    return np.minimum(a[0], b[0]), np.minimum(a[1], b[1])


def greatest(a: Interval, b: Interval) -> Interval:
    """The greater."""
    return np.maximum(a[0], b[0]), np.maximum(a[1], b[1])


def root(a: Interval) -> Interval:
    """The square root."""
    return increasing(np.sqrt)(_clip(a, 0.0, np.inf))


def logarithm(a: Interval) -> Interval:
    """The natural logarithm."""
    return increasing(np.log)(_clip(a, 0.0, np.inf))


def arcsine(a: Interval) -> Interval:
    """The inverse sine, with values from -pi/2 to pi/2."""
    return increasing(np.arcsin)(_clip(a, -1.0, 1.0))


def arccosine(a: Interval) -> Interval:
    """The inverse cosine, with values from 0 to pi."""
    low, high = _clip(a, -1.0, 1.0)
    return np.arccos(high), np.arccos(low)


def hyperbolic_cosine(a: Interval) -> Interval:
    """At least 1."""
    return increasing(np.cosh)(absolute(a))


def cosine(a: Interval) -> Interval:
    """Extrema at whole multiples of pi, ends elsewhere."""
    return _wave(np.cos, a, 0.0, np.pi)


def sine(a: Interval) -> Interval:
    """Extrema a quarter of a turn from whole multiples of pi."""
    return _wave(np.sin, a, np.pi / 2, -np.pi / 2)


def _wave(wave: Callable[[Any], Any], a: Interval, top: float, bottom: float) -> Interval:
    """A wave that is largest at a place and smallest at another, and at their copies, 2 pi apart."""
    low, high = _hull([wave(end) for end in a])
    low = np.where(_holds(a, bottom, 2 * np.pi), -1.0, low)
    high = np.where(_holds(a, top, 2 * np.pi), 1.0, high)

    # all values where an end is infinite
    total = a[0] + a[1]
    is_endless = ~np.isfinite(total) & ~np.isnan(a[0])
    return np.where(is_endless, -1.0, low), np.where(is_endless, 1.0, high)


def _holds(a: Interval, place: float, period: float) -> Any:
    """Whether the interval holds the place or its copies, to rounding; always where rounding hides whole periods."""
    ends = [(end - place) / period for end in a]
    rounding = 1e-15 * (1.0 + _fold(np.maximum, [np.abs(end) for end in ends]))
    return np.floor(ends[1] + rounding) >= np.ceil(ends[0] - rounding)


def tangent(a: Interval) -> Interval:
    """Everything where there is a pole, or where an end is infinite."""
    has_pole = _holds(a, np.pi / 2, np.pi) | (~np.isfinite(a[0] + a[1]) & ~np.isnan(a[0]))
    return _entire_where(has_pole, (np.tan(a[0]), np.tan(a[1])))


def angle(y: Interval, x: Interval) -> Interval:
    """The angle of the point (x, y), from the corners unless the branch cut or the origin is touched."""
    corners = [np.arctan2(b, a) for a in x for b in y]
    low = _fold(np.minimum, corners)
    high = _fold(np.maximum, corners)
    jumps = (x[0] <= 0) & (y[0] <= 0) & (y[1] >= 0)
    low = np.where(jumps, -np.pi, low)
    high = np.where(jumps, np.pi, high)
    return _sound(low, high, x, y)


def imaginary_root(value: Callable[..., Any]) -> Callable[[Interval, Interval], Interval]:
    """The imaginary root of cubics t^3 + a t + b, which increases with a and with |b|.

    ``value`` computes it for numbers.

    Its square carries rounding, which exceeds the rounding of the root near zero.
    """

    def squared(a: Any, b: Any, direction: int) -> Any:
        """The square of the value, moved by its rounding in one direction."""
        rounding = direction * _ROUNDING * (np.abs(a) + np.cbrt(b) ** 2)
        return value(a, b) ** 2 + rounding

    def bounded(a: Interval, b: Interval) -> Interval:
        nearest, farthest = absolute(b)
        low = np.sqrt(np.maximum(squared(a[0], nearest, -1), 0.0))
        high = np.sqrt(np.maximum(squared(a[1], farthest, 1), 0.0))

        # values that overflow on the way bound nothing, operands without values have none
        low = np.where(np.isnan(low), 0.0, low)
        high = np.where(np.isnan(high), np.inf, high)
        return _empty_where(np.isnan(a[0]) | np.isnan(b[0]), (low, high))

    return bounded


def middle_eigenvalue(value: Callable[..., Any]) -> Callable[..., Interval]:
    """The middle eigenvalue of symmetric matrices: at the middle matrix, plus or minus the norm of the deviations.

    Eigenvalues change by at most the norm of the matrix added (Weyl 1912), which is at most its largest row sum.
    ``value`` computes the eigenvalue for numbers.
    """

    def bounded(*entries: Interval) -> Interval:
        middles = [(low + high) / 2 for low, high in entries]
        xx, yy, zz, xy, xz, yz = ((high - low) / 2 for low, high in entries)
        rows = [xx + xy + xz, xy + yy + yz, xz + yz + zz]
        size = sum(np.abs(middle) for middle in middles)
        away = _fold(np.maximum, rows) + _ROUNDING * size
        middle = value(*middles)
        low = middle - away
        high = middle + away

        # overflow gives no bounds; entries without values have no eigenvalue
        is_unknown = np.isnan(low) | np.isnan(high)
        is_empty = _fold(np.logical_or, [np.isnan(entry[0]) for entry in entries])
        return _empty_where(is_empty, _entire_where(is_unknown, (low, high)))

    return bounded


def _clip(a: Interval, low: float, high: float) -> Interval:
    """The part of the interval between two ends, NaN if there is none."""
    is_empty = (a[1] < low) | (a[0] > high)
    first = np.clip(a[0], low, high)
    last = np.clip(a[1], low, high)
    return _empty_where(is_empty, (first, last))


def _sound(low: Any, high: Any, a: Interval, b: Interval) -> Interval:
    """Infinities that meet bound nothing; operands without values have none."""
    is_empty = np.isnan(a[0]) | np.isnan(b[0])
    is_endless_low = np.isnan(low) & ~is_empty
    is_endless_high = np.isnan(high) & ~is_empty
    return np.where(is_endless_low, -np.inf, low), np.where(is_endless_high, np.inf, high)


def ends(net: Floats) -> Interval:
    """Smallest and largest coefficient (n,) of Bernstein nets (n, ...)."""
    flat = net.reshape(len(net), -1)
    return flat.min(axis=1), flat.max(axis=1)
