"""Arithmetic of intervals: what holds every value of a function over intervals of its operands, to rounding.

An interval is a pair of arrays, least and greatest; where a function has no value at all both are NaN.  Values that
it lacks in a part of the intervals are left out: a root of [-1, 4] lies in [0, 2].
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from elvis.core.arrays import Floats

Interval = tuple[Any, Any]
ENTIRE: Interval = (-np.inf, np.inf)
#: of functions that are evaluated in many steps, in parts of the size of what they are made of
_ROUNDING = 64 * np.finfo(np.float64).eps


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
    """a b; nought times anything is nought."""
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
    least = 1 / np.where(has_zero, 1.0, b[1])
    greatest = 1 / np.where(has_zero, 1.0, b[0])
    inverse = _entire_where(has_zero, (least, greatest))
    low, high = _entire_where(has_zero, times(a, inverse))
    return _sound(low, high, a, b)


def _entire_where(condition: Any, a: Interval) -> Interval:
    """Everything where a condition holds."""
    return np.where(condition, -np.inf, a[0]), np.where(condition, np.inf, a[1])


def _empty_where(condition: Any, a: Interval) -> Interval:
    """No value where a condition holds."""
    return np.where(condition, np.nan, a[0]), np.where(condition, np.nan, a[1])


def power(a: Interval, b: Interval) -> Interval:
    """a^b: exact for whole constant exponents, by logarithms for others."""
    is_constant = np.ndim(b[0]) == 0 and b[0] == b[1]
    exponent = float(b[0]) if is_constant else np.nan
    grow = increasing(lambda x: x**exponent)
    if exponent.is_integer():
        if exponent < 0:
            return over(number(1.0), power(a, number(-exponent)))
        is_even = exponent % 2 == 0
        return _even(a, int(exponent)) if is_even else grow(a)
    if exponent > 0:
        return grow(_clip(a, 0.0, np.inf))
    return increasing(np.exp)(times(b, logarithm(a)))


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
    """1 where a < b."""
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
    """Between -pi/2 and pi/2."""
    return increasing(np.arcsin)(_clip(a, -1.0, 1.0))


def arccosine(a: Interval) -> Interval:
    """Between 0 and pi."""
    low, high = _clip(a, -1.0, 1.0)
    return np.arccos(high), np.arccos(low)


def hyperbolic_cosine(a: Interval) -> Interval:
    """At least 1."""
    return increasing(np.cosh)(absolute(a))


def cosine(a: Interval) -> Interval:
    """Extremes at whole multiples of pi, ends elsewhere."""
    first = np.cos(a[0])
    last = np.cos(a[1])
    low = np.where(_holds(a, np.pi), -1.0, np.minimum(first, last))
    high = np.where(_holds(a, 0.0), 1.0, np.maximum(first, last))

    # all values where an end is infinite
    total = a[0] + a[1]
    is_endless = ~np.isfinite(total) & ~np.isnan(total)
    return np.where(is_endless, -1.0, low), np.where(is_endless, 1.0, high)


def _holds(a: Interval, place: float) -> Any:
    """Whether the interval holds the place or its copies, 2 pi apart."""
    first = np.ceil((a[0] - place) / (2 * np.pi))
    last = np.floor((a[1] - place) / (2 * np.pi))
    return last >= first


def sine(a: Interval) -> Interval:
    """A cosine, a quarter of a turn later."""
    return cosine((a[0] - np.pi / 2, a[1] - np.pi / 2))


def tangent(a: Interval) -> Interval:
    """Everything where there is a pole."""
    first_pole = np.ceil(a[0] / np.pi - 0.5)
    last_pole = np.floor(a[1] / np.pi - 0.5)
    has_pole = last_pole >= first_pole
    return _entire_where(has_pole, (np.tan(a[0]), np.tan(a[1])))


def angle(y: Interval, x: Interval) -> Interval:
    """Of the point (x, y): at the corners, unless the half line that it jumps across, or the origin, is touched."""
    corners = [np.arctan2(b, a) for a in x for b in y]
    low = _fold(np.minimum, corners)
    high = _fold(np.maximum, corners)
    jumps = (x[0] <= 0) & (y[0] <= 0) & (y[1] >= 0)
    low = np.where(jumps, -np.pi, low)
    high = np.where(jumps, np.pi, high)
    return _sound(low, high, x, y)


def imaginary_root(value: Callable[..., Any]) -> Callable[[Interval, Interval], Interval]:
    """Of the cubics t^3 + a t + b, whose imaginary part grows with a and with |b|; ``value`` gives it for numbers.

    Its square is off by rounding, which is more than rounding of the root where that is near zero.
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
    """Of symmetric matrices: that of the middle one, give or take the norm of how far entries are from it.

    Eigenvalues move no farther than the norm of what is added to a matrix (Weyl 1912), at most its greatest sum of a
    row.  ``value`` gives the eigenvalue of numbers.
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

        # what overflows on the way bounds nothing, entries without values have no eigenvalue
        is_unknown = np.isnan(low) | np.isnan(high)
        is_empty = _fold(np.logical_or, [np.isnan(entry[0]) for entry in entries])
        return _empty_where(is_empty, _entire_where(is_unknown, (low, high)))

    return bounded


def _clip(a: Interval, low: float, high: float) -> Interval:
    """The part of the interval between two ends, NaN where there is none."""
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
    """Least and greatest coefficient (n,) of Bernstein nets (n, ...)."""
    flat = net.reshape(len(net), -1)
    return flat.min(axis=1), flat.max(axis=1)
