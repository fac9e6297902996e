"""The operators and functions of expressions: in NumPy, as intervals, as complex discs, and their derivatives.

A function has the value NaN if it isn't defined: for division by zero, roots and logarithms of negative numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.quantities import discs as d
from elvis.core.quantities import intervals as i
from elvis.core.quantities.discs import Disc
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import ONE, ZERO, Node, call, negative, number

Partial = Callable[..., Node]


@dataclass(frozen=True)
class Function:
    """A function of some operands.

    numpy     of arrays
    interval  that holds all values which the function has on intervals
    disc      that holds all values of the function, which is analytic, on complex discs
    partials  derivative in each operand, from the operands
    """

    numpy: Callable[..., Any]
    interval: Callable[..., Interval]
    disc: Callable[..., Disc]
    partials: tuple[Partial, ...]

    @property
    def arity(self) -> int:
        """The number of operands."""
        return len(self.partials)


def quotient(a: Any, b: Any) -> Any:
    """a / b, NaN if b is zero."""
    is_pole = np.equal(b, 0)
    divisor = np.where(is_pole, 1.0, b)
    return np.where(is_pole, np.nan, np.divide(a, divisor))


def power(a: Any, b: Any) -> Any:
    """a^b, NaN for negative powers of zero."""
    is_pole = np.equal(a, 0) & np.less(b, 0)
    return np.where(is_pole, np.nan, np.power(np.asarray(a, np.float64), b))


def logarithm(a: Any) -> Any:
    """The natural logarithm, NaN unless a > 0."""
    is_known = np.greater(a, 0)
    return np.where(is_known, np.log(np.where(is_known, a, 1.0)), np.nan)


def imaginary_root(a: Any, b: Any) -> Any:
    """The imaginary part of the complex roots of t^3 + a t + b, not negative; 0 if all roots are real.

    Cardano's formula gives the real root r = u - a / (3 u) up to its sign, with u^3 = |b| / 2 + sqrt(b^2 / 4 + a^3 /
    27).  The square of the result, a + 3/4 r^2, has an error of some units in the last place of |a| + |b|^(2/3).  Near
    zero, half the digits of the root are therefore correct, as with any method, since double roots are ill-conditioned
    there.
    """
    half = np.abs(b) / 2
    third = np.divide(a, 3)
    discriminant = half * half + third * third * third
    is_complex = discriminant > 0

    # the real root, then the square of the result
    u = np.cbrt(half + np.sqrt(np.where(is_complex, discriminant, 1.0)))
    r = u - third / u
    root = np.sqrt(np.maximum(a + 0.75 * r * r, 0.0))
    return np.where(is_complex, root, np.where(np.isnan(discriminant), np.nan, 0.0))


def middle_eigenvalue(xx: Any, yy: Any, zz: Any, xy: Any, xz: Any, yz: Any) -> Any:
    """The second of the three eigenvalues of a symmetric matrix, to some units in the last place of its norm.

    With B the matrix minus its mean eigenvalue m, and C = B^2 minus its mean eigenvalue, the result is m - 2 sqrt(|B|^2
    / 6) sin(angle / 3), where tan(angle) = 3 det B / |B x C| (Smith 1961, Eigenvalues of a symmetric 3 x 3 matrix).
    The discriminant is taken as the sum of squares 3 |B|^2 |C|^2 - 3 (B .  C)^2 = 3 |B x C|^2, without cancellation, so
    the result is accurate near equal eigenvalues (Harari and Albocher 2022, Computation of eigenvalues of a real,
    symmetric 3 x 3 matrix with particular reference to the pernicious case of two nearly equal eigenvalues).
    """
    # B, relative to its largest entry
    mean = (xx + yy + zz) / 3
    entries = np.stack(np.broadcast_arrays(xx - mean, yy - mean, zz - mean, xy, xz, yz)).astype(np.float64)
    scale = np.abs(entries).max(axis=0)
    a, b, c, d, e, f = entries / np.where(scale == 0, 1.0, scale)
    own = np.stack([a, b, c])
    off = np.stack([d, e, f])

    # |B|^2, and C on its diagonal and beyond it
    squares = a * a + b * b + c * c + 2 * (d * d + e * e + f * f)
    third = squares / 3
    first = a * a + d * d + e * e - third
    second = b * b + d * d + f * f - third
    last = c * c + e * e + f * f - third
    diagonal = np.stack([first, second, last])
    mixed = np.stack([e * f - c * d, d * f - b * e, d * e - a * f])

    # |B x C|^2: pairs of entries on the diagonal, beyond it, and of one on it with one beyond it, which count twice
    area = _area(own, diagonal) + 4 * _area(off, mixed)
    for k in range(3):
        area = area + 2 * ((own * mixed[k] - off[k] * diagonal) ** 2).sum(axis=0)
    determinant = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e)
    angle = np.arctan2(3 * determinant, np.sqrt(area))
    return mean - 2 * scale * np.sqrt(squares / 6) * np.sin(angle / 3)


def _area(a: Floats, b: Floats) -> Any:
    """The square of the length of the cross product of (3, ...) vectors."""
    product = [a[i] * b[j] - a[j] * b[i] for i, j in ((0, 1), (1, 2), (2, 0))]
    return sum(part * part for part in product)


def _step(a: Node, b: Node) -> Node:
    return call("step", a, b)


def _less_one(a: Node, b: Node) -> Node:
    """b a^(b - 1)."""
    return call("*", b, call("^", a, call("-", b, ONE)))


def _square(a: Node) -> Node:
    return call("*", a, a)


def _reciprocal(a: Node) -> Node:
    return call("/", ONE, a)


def _bell(a: Node) -> Node:
    """1 - a^2."""
    return call("-", ONE, _square(a))


def _length(a: Node, b: Node) -> Node:
    return call("+", _square(a), _square(b))


def _root_by_a(a: Node, b: Node) -> Node:
    """(2 s^2 - a) / (2 s (4 s^2 - 3 a)) of the imaginary part s, from the equation that the real root fulfils."""
    s = call("imaginary_root", a, b)
    above = call("-", _times(2.0, _square(s)), a)
    below = call("*", _times(2.0, s), _steepness(a, s))
    return call("/", above, below)


def _root_by_b(a: Node, b: Node) -> Node:
    """-3 r / (4 s (4 s^2 - 3 a)) with the real root r, of the sign that b hasn't: r^2 = 4/3 (s^2 - a)."""
    s = call("imaginary_root", a, b)

    # 3/4 |r|, rounding aside
    square = _times(0.75, call("-", _square(s), a))
    real = call("sqrt", call("max", square, ZERO))
    above = call("*", call("sign", b), real)
    below = call("*", s, _steepness(a, s))
    return call("/", above, below)


def _steepness(a: Node, s: Node) -> Node:
    """3 r^2 + a, the derivative of the cubic at its real root."""
    return call("-", _times(4.0, _square(s)), _times(3.0, a))


def _times(factor: float, a: Node) -> Node:
    return call("*", number(factor), a)


def _in_matrix(place: int) -> Partial:
    """The derivative of the middle eigenvalue in one entry: v v^T with its vector v, twice that beyond the diagonal.

    v v^T is the adjugate of the matrix less the eigenvalue, divided by its trace, which is zero if eigenvalues meet.
    """

    def rule(xx: Node, yy: Node, zz: Node, xy: Node, xz: Node, yz: Node) -> Node:
        own = call("middle_eigenvalue", xx, yy, zz, xy, xz, yz)
        a, b, c = (call("-", entry, own) for entry in (xx, yy, zz))
        adjugate = [
            *(_minor(b, c, yz, yz), _minor(a, c, xz, xz), _minor(a, b, xy, xy)),
            *(_minor(xz, yz, xy, c), _minor(xy, yz, xz, b), _minor(xy, xz, yz, a)),
        ]
        trace = call("+", call("+", adjugate[0], adjugate[1]), adjugate[2])
        return call("/", _times(1.0 if place < 3 else 2.0, adjugate[place]), trace)

    return rule


def _minor(a: Node, b: Node, c: Node, d: Node) -> Node:
    """a b - c d."""
    return call("-", call("*", a, b), call("*", c, d))


def _over_divisor(a: Node, b: Node) -> Node:
    """The derivative of a / b in b, -a / b^2."""
    return negative(call("/", a, _square(b)))


def _times_logarithm(a: Node, b: Node) -> Node:
    """The derivative of a^b in b, a^b log a."""
    return call("*", call("^", a, b), call("log", a))


def _half_over_root(a: Node) -> Node:
    """1 / (2 sqrt a)."""
    return call("/", number(0.5), call("sqrt", a))


def _over_bell_root(a: Node) -> Node:
    """1 / sqrt(1 - a^2)."""
    return _reciprocal(call("sqrt", _bell(a)))


def _over_sum_of_squares(a: Node, b: Node) -> Node:
    """b / (a^2 + b^2)."""
    return call("/", b, _length(a, b))


def _is_less(a: Any, b: Any) -> Any:
    """1 if a < b, else 0."""
    return np.where(np.less(a, b), 1.0, 0.0)


def _not_step(a: Node, b: Node) -> Node:
    """1 if not a < b."""
    return call("-", ONE, _step(a, b))


OPERATORS: Mapping[str, Function] = {
    "+": Function(np.add, i.plus, d.plus, (lambda a, b: ONE, lambda a, b: ONE)),
    "-": Function(np.subtract, i.minus, d.minus, (lambda a, b: ONE, lambda a, b: number(-1.0))),
    "*": Function(np.multiply, i.times, d.times, (lambda a, b: b, lambda a, b: a)),
    "/": Function(quotient, i.over, d.over, (lambda a, b: _reciprocal(b), _over_divisor)),
    "^": Function(power, i.power, d.power, (_less_one, _times_logarithm)),
    "step": Function(_is_less, i.step, d.step, (lambda a, b: ZERO, lambda a, b: ZERO)),
}

FUNCTIONS: Mapping[str, Function] = {
    "abs": Function(np.abs, i.absolute, d.absolute, (lambda a: call("sign", a),)),
    "sign": Function(np.sign, i.sign, d.sign, (lambda a: ZERO,)),
    "sqrt": Function(np.sqrt, i.root, d.root, (_half_over_root,)),
    "exp": Function(np.exp, i.increasing(np.exp), d.exponential, (lambda a: call("exp", a),)),
    "log": Function(logarithm, i.logarithm, d.logarithm, (_reciprocal,)),
    "sin": Function(np.sin, i.sine, d.sine, (lambda a: call("cos", a),)),
    "cos": Function(np.cos, i.cosine, d.cosine, (lambda a: negative(call("sin", a)),)),
    "tan": Function(np.tan, i.tangent, d.tangent, (lambda a: call("+", ONE, _square(call("tan", a))),)),
    "asin": Function(np.arcsin, i.arcsine, d.arcsine, (_over_bell_root,)),
    "acos": Function(np.arccos, i.arccosine, d.arccosine, (lambda a: negative(_over_bell_root(a)),)),
    "atan": Function(
        np.arctan, i.increasing(np.arctan), d.arctangent, (lambda a: _reciprocal(call("+", ONE, _square(a))),)
    ),
    "sinh": Function(np.sinh, i.increasing(np.sinh), d.hyperbolic_sine, (lambda a: call("cosh", a),)),
    "cosh": Function(np.cosh, i.hyperbolic_cosine, d.hyperbolic_cosine, (lambda a: call("sinh", a),)),
    "tanh": Function(np.tanh, i.increasing(np.tanh), d.hyperbolic_tangent, (lambda a: _bell(call("tanh", a)),)),
    "atan2": Function(
        np.arctan2,
        i.angle,
        d.angle,
        (_over_sum_of_squares, lambda a, b: negative(call("/", a, _length(a, b)))),
    ),
    "min": Function(np.minimum, i.least, d.least, (_step, _not_step)),
    "max": Function(np.maximum, i.greatest, d.greatest, (_not_step, _step)),
    "imaginary_root": Function(
        imaginary_root, i.imaginary_root(imaginary_root), d.imaginary_root(imaginary_root), (_root_by_a, _root_by_b)
    ),
    "middle_eigenvalue": Function(
        middle_eigenvalue,
        i.middle_eigenvalue(middle_eigenvalue),
        d.middle_eigenvalue(middle_eigenvalue),
        tuple(map(_in_matrix, range(6))),
    ),
    "pow": Function(power, i.power, d.power, OPERATORS["^"].partials),
}

_EVERY = {**OPERATORS, **FUNCTIONS}


def function(node: Node) -> Function:
    """The function that a part of an expression is."""
    return _EVERY[node.op]


def partials(node: Node) -> list[Callable[[], Node]]:
    """The derivative of an operator or function in each operand, made when it is called for."""
    return [lambda rule=rule: rule(*node.operands) for rule in function(node).partials]  # type: ignore[misc]
