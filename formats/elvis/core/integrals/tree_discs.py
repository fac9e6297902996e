"""Discs of expressions on boxes, without the factors by which leaves vanish on faces of their boxes.

A velocity is zero on a wall, so the square of the speed has a double zero there: the root of a disc around 0 is
unknown.  On a box [-1, 1]^d a polynomial that vanishes on a face is u = (1 + t) g or (1 - t) g, with a polynomial g.
These factors are not negative on the box.  They are factored out of roots, absolute values, minima and maxima:

    sqrt(u^2 + v^2) = (1 + t) sqrt(g^2 + h^2),  |u| = (1 + t) |g|

The right sides are analytic beyond the face.  All values here have such factors separate: powers of 1 + t and 1 - t for
each direction, and the disc of the cofactor.

Data are rounded, so u has a remainder of that size on the face.  Its bound is propagated as the slack of a value: the
maximum difference from the analytic function on the real box.  The length of a vector changes by at most the length of
the difference, so a sum of squares has the slack of its root separately.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from elvis.core.base.arrays import EPS, Floats, Ints
from elvis.core.integrals.eta_boxes import to_legendre
from elvis.core.integrals.reference_cells import box_rule
from elvis.core.polynomials.jacobi import jacobi
from elvis.core.quantities import discs
from elvis.core.quantities.discs import Disc
from elvis.core.quantities.functions import function
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import LEAVES, Node, fold, ordered, whole_exponent

#: relative rounding of values of leaves, and of results from them
ROUNDING = 64 * EPS
#: value on a face, relative to the largest in the box, below which a polynomial is divided by a factor
_SMALL = 2.0**-40
#: the power of a factor in zero
_ANY_POWER = 1 << 20
#: discs of functions with a singularity at 0, from a lower bound of the real part of their last operand
_ABOVE: Mapping[str, Callable[..., Disc]] = {
    "sqrt": discs.root_above,
    "log": discs.logarithm_above,
    "/": discs.over_above,
}
#: functions whose bounds improve by factoring
_KINKED = frozenset({"sqrt", "abs", "min", "max"})


class Ball(NamedTuple):
    """A disc with a lower bound of the real part, and a bound of the size of the imaginary part.

    slack       maximum deviation of the value from the disc, at real points
    root_slack  maximum deviation of the value's root
    """

    middle: Any
    radius: Any
    low: Any
    imaginary: Any
    slack: Any = np.float64(0.0)
    root_slack: Any = np.float64(0.0)

    @staticmethod
    def around(disc: Disc) -> Ball:
        """The ball of any disc."""
        return Ball(*disc, disc[0] - disc[1], disc[1])

    @property
    def disc(self) -> Disc:
        """Middle and radius."""
        return self.middle, self.radius

    @property
    def size(self) -> Any:
        """(n, 1) the largest absolute value at real points, or one number."""
        return np.abs(self.middle) + (self.radius[:, :1] if np.ndim(self.radius) else self.radius) + self.slack

    @property
    def is_zero(self) -> Any:
        """(n,) whether nothing but 0 is in it, or one number."""
        return (np.equal(self.middle, 0) & np.equal(self.radius, 0)).all(axis=-1)


class Value(NamedTuple):
    """An expression on n boxes: all of it, and its cofactor with the powers (n, 2 d) of 1 + t and 1 - t before it."""

    whole: Ball
    powers: Ints
    cofactor: Ball


class Division(NamedTuple):
    """Polynomials on n boxes without their zeros on faces.

    powers  (n, 2 d) of 1 + t and 1 - t in each direction
    values  (n, q) of the cofactors at the points
    growth  (n,) by which rounding has grown
    slack   (n,) by how much the product may differ from the polynomial
    """

    powers: Ints
    values: Floats
    growth: Floats
    slack: Floats


def divided(values: Floats, counts: Sequence[int]) -> Division:
    """Polynomials with values (n, q) at Gauss points without their zeros on faces.

    With g = u/(1 + t) at the points, u - (1 + t) g is 0 there, so it equals P_n(t)/P_n(-1) times u at t = -1.
    """
    powers, growth = np.zeros((len(values), 2 * len(counts)), int), np.ones(len(values))
    slack = np.zeros(len(values))
    nodes, _ = box_rule(tuple(counts))
    for column in range(2 * len(counts)):
        axis, end = column // 2, 2.0 * (column % 2) - 1
        factor = 1 - end * nodes[:, axis]
        for _ in range(counts[axis] - 1):
            remainder, greatest = _on_face(values, counts, axis, end), np.abs(values).max(axis=1)
            is_divided = (remainder <= _SMALL * greatest) & (greatest > 0)
            if not is_divided.any():
                break
            slack += np.where(is_divided, 2.0 ** powers.sum(axis=1) * (remainder + ROUNDING * greatest), 0.0)
            values = np.where(is_divided[:, None], values / factor, values)
            growth = np.where(is_divided, growth / factor.min(), growth)
            powers[:, column] += is_divided
    return Division(powers, values, growth, slack)


def _on_face(values: Floats, counts: Sequence[int], axis: int, end: float) -> Floats:
    """(n,) bounds of polynomials on a face: sums of their Legendre coefficients."""
    at_end = jacobi(counts[axis] - 1, 0, 0, np.array([end]))[:, 0] @ to_legendre(counts[axis])
    coefficients = np.tensordot(values.reshape(-1, *counts), at_end, (1 + axis, 0))
    for count in (count for other, count in enumerate(counts) if other != axis):
        coefficients = np.tensordot(coefficients, to_legendre(count), (1, 1))
    return np.asarray(np.abs(coefficients).reshape(len(values), -1).sum(axis=1))


class TreeDiscs:
    """Discs of an expression on n boxes.

    leaf      the ball of a leaf
    cofactor  powers and cofactor of a leaf, None if it has none
    factors   radii (2 d, columns) of 1 + t and 1 - t around 1
    """

    def __init__(
        self,
        count: int,
        factors: Floats,
        leaf: Callable[[Node], Ball],
        cofactor: Callable[[Node], tuple[Ints, Ball] | None],
    ) -> None:
        self._leaf, self._cofactor, self._factors = leaf, cofactor, factors
        self._none = np.zeros((count, len(factors)), int)

    def of(self, root: Node) -> Ball:
        """The ball of an expression."""
        nodes = ordered(root)
        leaves = [node for node in nodes if node.op in LEAVES] if any(node.op in _KINKED for node in nodes) else []
        cofactors = {node: found for node in leaves if (found := self._cofactor(node)) is not None}
        if not any(powers.any() for powers, _ in cofactors.values()):
            return fold(root, self._leaf, _applied)

        def value(node: Node) -> Value:
            whole = self._leaf(node)
            return Value(whole, *cofactors.get(node, (self._none, whole)))

        return fold(root, value, self._value).whole

    def _value(self, node: Node, parts: list[Value]) -> Value:
        """A function of values."""
        whole = _applied(node, [part.whole for part in parts])
        rule = _powers(node, parts)
        if rule is None:
            return Value(whole, self._none, whole)
        wanted, powers = rule
        cofactor = _applied(node, [self._multiplied(*pair) for pair in zip(parts, wanted, strict=True)])
        if node.op in _KINKED:
            is_reduced = wanted[-1].any(axis=1)[:, None]
            product = self._product(cofactor, powers)
            whole = Ball(*(np.where(is_reduced, *pair) for pair in zip(product, whole, strict=True)))
        return Value(whole, powers, cofactor)

    def _multiplied(self, own: Value, powers: Ints) -> Ball:
        """The factor behind given powers, which are at most the value's own."""
        further = np.where(_column(own.cofactor.is_zero), 0, own.powers - powers)
        if not further.any():
            return own.cofactor
        product = self._product(own.cofactor, further)
        is_whole = ~powers.any(axis=1)[:, None]
        return Ball(*(np.where(is_whole, *pair) for pair in zip(own.whole, product, strict=True)))

    def _product(self, own: Ball, powers: Ints) -> Ball:
        """A ball multiplied by powers of factors."""
        found = own.disc
        for column, radius in enumerate(self._factors):
            for power in range(powers[:, column].max(initial=0)):
                is_further = (powers[:, column] > power)[:, None]
                product = discs.times(found, (np.float64(1.0), radius))
                found = np.where(is_further, product[0], found[0]), np.where(is_further, product[1], found[1])
        is_same = ~powers.any(axis=1)[:, None]
        known = own.low, own.imaginary, own.slack, own.root_slack
        scale = 2.0 ** powers.sum(axis=1)[:, None]
        changed = found[0] - found[1], found[1], scale * own.slack, np.sqrt(scale) * own.root_slack
        return Ball(*found, *(np.where(is_same, *pair) for pair in zip(known, changed, strict=True)))


def _applied(node: Node, parts: list[Ball]) -> Ball:
    """A function of balls; one with a singularity at 0 also by a lower bound of the real part of its operand."""
    operands = [part.disc for part in parts]
    middle, radius = function(node).disc(*operands)
    if node.op in _ABOVE:
        radius = np.fmin(radius, _ABOVE[node.op](*operands, parts[-1].low)[1])
    slack, root_slack = _slacks(node, parts)
    is_known = np.isfinite(slack)
    radius = np.where(is_known, radius, np.inf)
    slack = np.where(is_known, slack, 0.0)
    return Ball(middle, radius, _low(node, parts, (middle, radius)), radius, slack, root_slack)


def _slacks_of_product(node: Node, first: Ball, last: Ball) -> tuple[Any, Any]:
    """The slack of a product or square, and of its root; the root of a square has the slack of the squared value."""
    a, b = node.operands
    if node.op == "^" or a is b:
        return first.slack * (2 * first.size + first.slack), first.slack
    total = first.slack * last.size + last.slack * first.size
    is_scaled = a.op == "number" and a.value > 0
    return total, np.sqrt(a.value) * last.root_slack if is_scaled else np.sqrt(total)


def _slacks(node: Node, parts: list[Ball]) -> tuple[Any, Any]:
    """The slack of a function of balls, and the slack of its root; infinite if unknown."""
    first, last, exponent = parts[0], parts[-1], whole_exponent(node)
    if not any(np.any(part.slack) for part in parts):
        return np.float64(0.0), np.float64(0.0)
    if node.op in ("+", "-"):
        total = first.slack + last.slack
        return total, np.hypot(first.root_slack, last.root_slack) if node.op == "+" else np.sqrt(total)
    if node.op == "*" or exponent == 2:
        return _slacks_of_product(node, first, last)
    if node.op == "/":
        nearest = np.abs(last.middle) - (last.radius[:, :1] if np.ndim(last.radius) else last.radius)
        total = np.where((nearest > 0) & np.equal(last.slack, 0), first.slack / nearest, np.inf)
    elif node.op == "sqrt":
        total = first.root_slack
    elif node.op in ("abs", "min", "max"):
        total = np.maximum(first.slack, last.slack)
    else:
        total = np.where(np.equal(sum(part.slack for part in parts), 0), 0.0, np.inf)
    return total, np.sqrt(total)


def _low(node: Node, parts: list[Ball], found: Disc) -> Any:
    """A lower bound of the real part, from the operands' bounds; sharper than the disc for squares and their sums."""
    middle, radius = found
    low = middle - radius
    first, last = node.operands[0], node.operands[-1]
    if node.op == "+":
        low = np.fmax(low, parts[0].low + parts[1].low)
    elif node.op == "*" and first.op == "number" and first.value > 0:
        low = np.fmax(low, first.value * parts[1].low)
    elif (node.op == "*" and first is last) or whole_exponent(node) == 2:
        low = np.fmax(low, discs.square_above(parts[0].disc, parts[0].imaginary))
    return low - ROUNDING * (np.abs(middle) + np.where(np.isfinite(radius), radius, 0.0))


def _powers(node: Node, parts: list[Value]) -> tuple[list[Ints], Ints] | None:
    """Powers before the operands that a function can take out of them, and those before its value; None for no rule."""
    own = [part.powers for part in parts]
    exponent = whole_exponent(node)
    if node.op in ("+", "-", "min", "max"):
        common = _common(parts)
        return [common, common], common
    if node.op == "*":
        return own, own[0] + own[1]
    if exponent is not None and exponent >= 0:
        return own, exponent * own[0]
    if node.op == "sqrt":
        return [own[0] // 2 * 2], own[0] // 2
    if node.op == "abs":
        return own, own[0]
    return None


def _common(parts: list[Value]) -> Ints:
    """The powers (n, 2 d) that two values have in common; zero has any."""
    known = [np.where(_column(part.cofactor.is_zero), _ANY_POWER, part.powers) for part in parts]
    least = np.minimum(*known)
    return np.asarray(np.where(least == _ANY_POWER, 0, least))


def _column(flags: Any) -> Any:
    """(n, 1) of flags (n,), or one flag."""
    return flags[:, None] if np.ndim(flags) else flags


def interval_of(root: Node, leaf: Callable[[Node], Interval], count: int) -> Interval:
    """Bounds (count,) of an expression from the bounds of its leaves; infinite if unknown."""
    low, high = fold(root, leaf, lambda node, parts: function(node).interval(*parts))
    low, high = (np.broadcast_to(end, count) for end in (low, high))
    is_known = ~np.isnan(low) & ~np.isnan(high)
    return np.where(is_known, low, -np.inf), np.where(is_known, high, np.inf)


def integral_between(values: Interval, least: Floats, most: Floats) -> Interval:
    """Bounds (n,) of integrals over boxes of measures from ``least`` to ``most``, from bounds of the integrand."""
    low, high = values
    low, high = low * np.where(low < 0, most, least), high * np.where(high > 0, most, least)
    return np.where(np.isnan(low), -np.inf, low), np.where(np.isnan(high), np.inf, high)
