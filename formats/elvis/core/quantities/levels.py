"""Where an expression has a value: other expressions that have a value of theirs there, and no denominators or roots.

sqrt(a) = v where a = v^2, a / b = v where a - v b = 0, and so on; so that isosurfaces of many quantities are those of
polynomials, of which proofs are known.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from elvis.core.quantities.tree import LEAVES, ONE, ZERO, Node, call, folded, number, whole_exponent

Fraction = tuple[Node, Node]

#: functions that have each value once at most: where they have it, NaN where they don't
_INVERSES: Mapping[str, Callable[[float], float]] = {
    "sqrt": lambda v: v * v if v >= 0 else math.nan,
    "exp": lambda v: math.log(v) if v > 0 else math.nan,
    "log": math.exp,
    "sinh": math.asinh,
    "tanh": lambda v: math.atanh(v) if abs(v) < 1 else math.nan,
    "atan": lambda v: math.tan(v) if abs(v) < math.pi / 2 else math.nan,
}
_MOST_POWER = 16


def same_level(root: Node, value: float) -> tuple[Node, float] | None:
    """An expression and its value: it has it exactly where the first has its own, but for poles.  None: none is known.

    What comes out is made of + - * and whole powers of the leaves.
    """
    try:
        root, value = _peel(root, value)
    except OverflowError:
        return None
    squares = _square(root) if value > 0 else None
    fraction = _fraction(root)
    if fraction is None and squares is not None and squares[1] <= 1:
        fraction, value = _fraction(squares[0]), value * value
    if fraction is None or not math.isfinite(value):
        return None
    above, below = fraction
    return (above, value) if below is ONE else (call("-", above, call("*", number(value), below)), 0.0)


def _peel(node: Node, value: float) -> tuple[Node, float]:
    """What is left without functions that have each value once, and without constants around it."""
    while node.op not in LEAVES:
        first, last = node.operands[0], node.operands[-1]
        if node.op in _INVERSES:
            node, value = first, _INVERSES[node.op](value)
        elif first.op == "number" and node.op in ("+", "-"):
            node, value = last, value - first.value if node.op == "+" else first.value - value
        elif last.op == "number" and node.op in ("+", "-"):
            node, value = first, value - last.value if node.op == "+" else value + last.value
        elif first.op == "number" and node.op == "*" and first.value:
            node, value = last, value / first.value
        elif last.op == "number" and node.op in ("*", "/") and last.value:
            node, value = first, value / last.value if node.op == "*" else value * last.value
        else:
            break
    return node, value


def _fraction(root: Node) -> Fraction | None:
    """Polynomials of the leaves whose quotient an expression is."""

    def inner(node: Node, parts: list[Fraction | None]) -> Fraction | None:
        one, two = parts[0], parts[-1]
        if one is None or two is None:
            return None
        if node.op in ("+", "-"):
            if one[1] is two[1]:
                return call(node.op, one[0], two[0]), one[1]
            return call(node.op, call("*", one[0], two[1]), call("*", two[0], one[1])), call("*", one[1], two[1])
        if node.op == "*":
            return call("*", one[0], two[0]), call("*", one[1], two[1])
        if node.op == "/":
            return call("*", one[0], two[1]), call("*", one[1], two[0])
        return _power(node, one)

    return folded(root, lambda leaf: (leaf, ONE), inner)


def _power(node: Node, base: Fraction) -> Fraction | None:
    """A whole power of a fraction."""
    exponent = whole_exponent(node)
    if exponent is None or abs(exponent) > _MOST_POWER:
        return None
    times = number(abs(exponent))
    above, below = (each if each is ONE else call("^", each, times) for each in base)
    return (above, below) if exponent >= 0 else (below, above)


def _square(root: Node) -> tuple[Node, int] | None:
    """The square of what is nowhere negative, and how many of the roots in it may be of what is negative somewhere."""

    def inner(node: Node, parts: list[tuple[Node, int] | None]) -> tuple[Node, int] | None:
        if node.op == "sqrt":
            return node.operands[0], int(not _is_positive(node.operands[0]))
        if node.op == "abs":
            return call("*", node.operands[0], node.operands[0]), 0
        one, two = parts[0], parts[-1]
        if node.op not in ("*", "/") or one is None or two is None:
            return None
        return call(node.op, one[0], two[0]), one[1] + two[1]

    def leaf(node: Node) -> tuple[Node, int] | None:
        return (number(node.value**2), 0) if node.op == "number" and node.value >= 0 else None

    return folded(root, leaf, inner)


def _is_positive(root: Node) -> bool:
    """Whether an expression is nowhere negative, by its form."""

    def inner(node: Node, parts: list[bool]) -> bool:
        first, last = node.operands[0], node.operands[-1]
        if node.op in ("abs", "sqrt", "exp") or (node.op in ("*", "/") and first is last):
            return True
        if node.op == "^" and last.op == "number" and last.value % 2 == 0:
            return True
        return node.op in ("+", "*", "/") and all(parts)

    return folded(root, lambda node: node is ZERO or (node.op == "number" and node.value >= 0), inner)
