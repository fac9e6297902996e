"""Arithmetic of complex discs: enclosures of all values of an analytic function over discs of its operands.

A disc is a pair of arrays, a real middle and a radius.  The radius is infinite if a function isn't proved to be
analytic on all of its operands' discs, for example if abs(a) may change its branch; the middle is then meaningless.  If
the radius is finite, the function is analytic, and at real points it equals the function of expressions.  Each radius
is enlarged by the rounding of the middle and of the radius itself.  Source: Johansson 2017, Arb: efficient
arbitrary-precision midpoint-radius interval arithmetic (IEEE Transactions on Computers 66, 1281).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from elvis.core.base.arrays import EPS

Disc = tuple[Any, Any]

#: rounding of a middle and of a radius in one operation, relative to both: library functions are accurate to 4 units
_ROUNDING = 16 * EPS


def number(value: float) -> Disc:
    """The disc of one number."""
    return np.float64(value), np.float64(0.0)


def rounded(middle: Any, radius: Any, is_analytic: Any = True) -> Disc:
    """A disc with room for its rounding; infinite if a condition fails or nothing is known."""
    enlarged = radius + _ROUNDING * (np.abs(middle) + radius)
    return middle, np.where(is_analytic & ~np.isnan(enlarged), enlarged, np.inf)


def plus(a: Disc, b: Disc) -> Disc:
    """a + b."""
    return rounded(a[0] + b[0], a[1] + b[1])


def minus(a: Disc, b: Disc) -> Disc:
    """a - b."""
    return rounded(a[0] - b[0], a[1] + b[1])


def times(a: Disc, b: Disc) -> Disc:
    """a b: (m + s)(n + t) = m n + (m + s) t + n s; zero times anything is zero, as in a branch that isn't taken."""
    no_a, no_b = np.equal(a[0], 0), np.equal(b[0], 0)
    middle = np.where(no_a | no_b, 0.0, a[0] * b[0])
    middle, radius = rounded(middle, (np.abs(a[0]) + a[1]) * b[1] + np.abs(b[0]) * a[1])
    is_zero = (no_a & np.equal(a[1], 0)) | (no_b & np.equal(b[1], 0))
    return middle, np.where(is_zero, 0.0, radius)


def over(a: Disc, b: Disc) -> Disc:
    """a / b: (m + s)/(n + t) = m/n + (s - (m/n) t)/(n + t)."""
    nearest = np.abs(b[0]) - b[1]
    middle = a[0] / b[0]
    return rounded(middle, (a[1] + np.abs(middle) * b[1]) / nearest, nearest > 0)


def power(a: Disc, b: Disc) -> Disc:
    """a^b: whole exponents by the binomial theorem, variable ones as exp(b log a)."""
    is_constant = np.ndim(b[0]) == 0 and b[1] == 0
    if not is_constant:
        return exponential(times(b, logarithm(a)))
    exponent = float(b[0])
    if not exponent.is_integer():
        return _real_power(a, exponent)
    return _whole_power(a, exponent) if exponent >= 0 else over(number(1.0), _whole_power(a, -exponent))


def _whole_power(a: Disc, n: float) -> Disc:
    """|(m + s)^n - m^n| <= (|m| + |s|)^n - |m|^n."""
    if n == 2:
        return times(a, a)
    size, radius = np.abs(a[0]), a[1]
    grown = size**n * np.expm1(n * np.log1p(radius / np.where(size > 0, size, 1.0)))
    return rounded(a[0] ** n, (1 + n * _ROUNDING) * np.where(size > 0, grown, radius**n))


def _real_power(a: Disc, s: float) -> Disc:
    """m^s (1 + w)^s with |w| <= q < 1: |(1 + w)^s - 1| is at most the integral of |s| |1 + t w|^(s - 1) q over t.

    |z^s| = |z|^s for real s, and 1 - q <= |1 + w| <= 1 + q.
    """
    part = a[1] / a[0]
    change = np.abs(np.expm1(s * np.log1p(part if s > 1 else -part)))
    middle = np.power(a[0], s)
    return rounded(middle, (1 + np.abs(s) * _ROUNDING) * middle * change, a[0] > a[1])


def exponential(a: Disc) -> Disc:
    """e^(m + s) - e^m is e^(m + r) (1 - e^-r) at most."""
    return rounded(np.exp(a[0]), -np.exp(a[0] + a[1]) * np.expm1(-a[1]))


def logarithm(a: Disc) -> Disc:
    """log(1 + w) is -log(1 - |w|) at most, where its series has a sum."""
    return rounded(np.log(a[0]), -np.log1p(-a[1] / a[0]), a[0] > a[1])


def root(a: Disc) -> Disc:
    """The square root."""
    return _real_power(a, 0.5)


def _by_addition(function: Callable[[Any], Any], slope: Callable[[Any], Any]) -> Callable[[Disc], Disc]:
    """A function f with its derivative, but for the sign.

    |f(m + s) - f(m)| <= |f| (cosh r - 1) + |f'| sinh r for |s| <= r, by the addition theorems of sin, cos, sinh, cosh.
    """

    def enclosed(a: Disc) -> Disc:
        value = function(a[0])
        radius = np.abs(value) * 2 * np.sinh(a[1] / 2) ** 2 + np.abs(slope(a[0])) * np.sinh(a[1])
        return rounded(value, radius)

    return enclosed


sine = _by_addition(np.sin, np.cos)
cosine = _by_addition(np.cos, np.sin)
hyperbolic_sine = _by_addition(np.sinh, np.cosh)
hyperbolic_cosine = _by_addition(np.cosh, np.sinh)


def tangent(a: Disc) -> Disc:
    """tan z - tan m = sin(z - m) / (cos z cos m), with |cos z| >= |cos(Re z)|."""
    away = np.abs(a[0] - np.pi * np.round(a[0] / np.pi)) + _ROUNDING * np.abs(a[0])
    farthest = away + a[1]
    radius = np.sinh(a[1]) / (np.abs(np.cos(a[0])) * np.cos(np.minimum(farthest, np.pi / 2)))
    return rounded(np.tan(a[0]), radius, farthest < np.pi / 2 - _ROUNDING)


def hyperbolic_tangent(a: Disc) -> Disc:
    """tanh z - tanh m = sinh(z - m) / (cosh z cosh m), with |cosh(x + i y)|^2 = sinh^2 x + cos^2 y."""
    nearest = np.maximum(np.abs(a[0]) - a[1], 0.0)
    least = np.sqrt(np.sinh(nearest) ** 2 + np.cos(np.minimum(a[1], np.pi / 2)) ** 2)
    return rounded(np.tanh(a[0]), np.sinh(a[1]) / (np.cosh(a[0]) * least), a[1] < np.pi / 2 - _ROUNDING)


def arctangent(a: Disc) -> Disc:
    """With d = |m - i| = |m + i| the derivative 1/((z - i)(z + i)) is (d - t)^-2 at most, at a distance t from m."""
    away = np.hypot(1.0, a[0])
    return rounded(np.arctan(a[0]), a[1] / (away * (away - a[1])), away * (1 - _ROUNDING) > a[1])


def _change_of_arcsine(a: Disc) -> Any:
    """The series of asin has no negative coefficients, so its derivative is largest towards the nearer end."""
    farthest = np.abs(a[0]) + a[1]
    return np.arcsin(farthest) - np.arcsin(np.abs(a[0])) + _ROUNDING


def arcsine(a: Disc) -> Disc:
    """asin a."""
    return rounded(np.arcsin(a[0]), _change_of_arcsine(a))


def arccosine(a: Disc) -> Disc:
    """acos a = pi/2 - asin a."""
    return rounded(np.arccos(a[0]), _change_of_arcsine(a))


def angle(y: Disc, x: Disc) -> Disc:
    """The angle of (x, y): atan(y/x), or atan(x/y) from the vertical axis, off the half line that it jumps across."""
    by_x = arctangent(over(y, x))[1]
    by_y = arctangent(over(x, y))[1]
    is_right = x[0] > x[1]
    is_off_axis = np.abs(y[0]) > y[1]
    radius = np.minimum(np.where(is_right | is_off_axis, by_x, np.inf), np.where(is_off_axis, by_y, np.inf))
    return rounded(np.arctan2(y[0], x[0]), radius)


def root_above(a: Disc, low: Any) -> Disc:
    """The square root where Re z >= low > 0: |z - m| / |sqrt z + sqrt m|, with Re sqrt z >= sqrt(Re z)."""
    middle = np.sqrt(a[0])
    return rounded(middle, a[1] / (np.sqrt(low) + middle), low > 0)


def logarithm_above(a: Disc, low: Any) -> Disc:
    """The logarithm there: its slope on the way from m to z is 1/low at most."""
    return rounded(np.log(a[0]), a[1] / np.minimum(low, a[0]), low > 0)


def over_above(a: Disc, b: Disc, low: Any) -> Disc:
    """a / b where Re b >= low > 0, as in `over`."""
    middle = a[0] / b[0]
    return rounded(middle, (a[1] + np.abs(middle) * b[1]) / low, low > 0)


def square_above(a: Disc, imaginary: Any) -> Any:
    """A lower bound of Re z^2 on a disc, given a bound of |Im z|.

    It is (Re z)^2 - (Im z)^2.  For z = m + r e^(i t), this is m^2 - r^2 + 2 m r cos t + 2 r^2 cos^2 t, whose minimum is
    at an end or at cos t = -m/(2 r).
    """
    size, radius = np.abs(a[0]), a[1]
    by_parts = np.maximum(size - radius, 0.0) ** 2 - imaginary**2
    by_angle = np.where(size < 2 * radius, size * size / 2 - radius * radius, (size - radius) ** 2)
    return np.maximum(by_parts, by_angle)


def _is_decided(a: Disc) -> Any:
    """Whether the real part of all of the disc has the sign of the middle."""
    return np.abs(a[0]) > a[1]


def absolute(a: Disc) -> Disc:
    """a or -a."""
    return rounded(np.abs(a[0]), a[1], _is_decided(a))


def sign(a: Disc) -> Disc:
    """-1 or 1."""
    return np.sign(a[0]), np.where(_is_decided(a), 0.0, np.inf)


def step(a: Disc, b: Disc) -> Disc:
    """1 if a < b, else 0."""
    less = minus(b, a)
    return np.where(less[0] > 0, 1.0, 0.0), np.where(_is_decided(less), 0.0, np.inf)


def _chosen(is_first: Any, is_decided: Any, a: Disc, b: Disc) -> Disc:
    """The one or the other."""
    return np.where(is_first, a[0], b[0]), np.where(is_decided, np.where(is_first, a[1], b[1]), np.inf)


def least(a: Disc, b: Disc) -> Disc:
    """The lesser."""
    less = minus(b, a)
    return _chosen(less[0] > 0, _is_decided(less), a, b)


def greatest(a: Disc, b: Disc) -> Disc:
    """The greater."""
    less = minus(b, a)
    return _chosen(less[0] < 0, _is_decided(less), a, b)


def imaginary_root(value: Callable[..., Any]) -> Callable[[Disc, Disc], Disc]:
    """The imaginary part of the roots of t^3 + a t + b, where these stay simple; ``value`` gives it for numbers.

    With the real root r it is sqrt(a + 3/4 r^2); it is 0 if b^2/4 + a^3/27 stays below 0.
    """

    def bounded(a: Disc, b: Disc) -> Disc:
        half = times(b, number(0.5))
        third = times(a, number(1 / 3))
        discriminant = plus(times(half, half), _whole_power(third, 3.0))
        is_real = (discriminant[0] < 0) & _is_decided(discriminant)

        # r from its square and the sign that b hasn't
        square = np.maximum(4 / 3 * (value(a[0], b[0]) ** 2 - a[0]), 0.0)
        real = _real_root(a, b, -np.sign(b[0]) * np.sqrt(square))
        found = root(plus(a, times(number(0.75), times(real, real))))
        is_complex = (discriminant[0] > 0) & _is_decided(discriminant)
        radius = np.where(is_real, 0.0, np.where(is_complex, found[1], np.inf))
        return np.where(discriminant[0] < 0, 0.0, found[0]), radius

    return bounded


def _real_root(a: Disc, b: Disc, near: Any) -> Disc:
    """The root of t^3 + a t + b near a number r, with a positive slope, that is the only one in its disc.

    With t = r + w: w = -(p(r) + 3 r w^2 + w^3) / (3 r^2 + a).  If the right side maps |w| <= W into itself and is a
    contraction there, for all a and b, one simple root is inside (Banach), which is an analytic function of a and b.
    """
    residual = np.abs(near**3 + a[0] * near + b[0]) + a[1] * np.abs(near) + b[1]
    rounding = _ROUNDING * (np.abs(near) ** 3 + np.abs(a[0] * near) + np.abs(b[0]))
    slope = 3 * near * near + a[0]
    steep = slope * (1 - _ROUNDING) - a[1]
    width = 2 * (residual + rounding) / steep
    # where it is a contraction, 3 r W^2 + W^3 is less than half of steep W, and p(r) the other half
    contracts = 6 * np.abs(near) * width + 3 * width**2 < steep
    return rounded(near, width, (steep > 0) & contracts)


def middle_eigenvalue(value: Callable[..., Any]) -> Callable[..., Disc]:
    """The second eigenvalue of symmetric matrices, if it stays simple; ``value`` computes it for numbers.

    If a real symmetric matrix is changed by W, which may be complex, its eigenvalues change by at most the norm of W
    (Bauer and Fike 1960), and thus by at most its largest row sum.  The eigenvalues therefore stay simple if they are 2
    |W| apart.
    """

    def bounded(*entries: Disc) -> Disc:
        middles = np.broadcast_arrays(*(np.asarray(entry[0], np.float64) for entry in entries))
        xx, yy, zz, xy, xz, yz = (entry[1] for entry in entries)
        moved = np.maximum(np.maximum(xx + xy + xz, xy + yy + yz), xz + yz + zz)
        own = value(*middles)

        # the other two have the rest of the trace as their sum, and of |M|^2 as the sum of their squares
        trace = middles[0] + middles[1] + middles[2] - own
        squares = sum(m * m for m in middles[:3]) + 2 * sum(m * m for m in middles[3:]) - own * own
        apart = np.sqrt(np.maximum(2 * squares - trace * trace, 0.0))
        size = sum(np.abs(m) for m in middles)
        gap = apart / 2 - np.abs(own - trace / 2) - np.sqrt(_ROUNDING) * size
        return rounded(own, moved + _ROUNDING * size, gap > 2 * moved)

    return bounded
