"""Levels of expressions as levels of other expressions without denominators or roots.

For example, sqrt(a) = v if a = v^2, and a / b = v if a - v b = 0; isosurfaces of many quantities are thus isosurfaces
of polynomials, for which proofs exist.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from operator import or_

from elvis.core.quantities.tree import LEAVES, ONE, ZERO, Node, call, fold, negative, number, whole_exponent

Fraction = tuple[Node, Node]

#: inverses of increasing functions; -inf for values below their range, inf for values above it
_INVERSES: Mapping[str, Callable[[float], float]] = {
    "sqrt": lambda v: v * v if v >= 0 else -math.inf,
    "exp": lambda v: math.log(v) if v > 0 else -math.inf,
    "log": math.exp,
    "sinh": math.asinh,
    "tanh": lambda v: math.atanh(v) if abs(v) < 1 else math.copysign(math.inf, v),
    "atan": lambda v: math.tan(v) if abs(v) < math.pi / 2 else math.copysign(math.inf, v),
}
_MOST_POWER = 16
#: maximum number of factors compared between products
_MOST_FACTORS = 64


@dataclass(frozen=True, eq=False)
class Level:
    """An expression and its value on the level of another expression.

    spurious  positive where only this expression has its value, negative where both have theirs, except at single
              points and curves; None if both always have their values together
    matrix    xx, yy, zz, xy, xz, yz of a symmetric matrix whose second eigenvalue is 0 if both have their values; its
              determinant is 0 if this expression has its value; empty if its entries are not polynomials, or too long
    """

    root: Node
    value: float
    spurious: Node | None = None
    matrix: tuple[Node, ...] = ()


def same_level(root: Node, value: float) -> Level | None:
    """The level of another expression that coincides with a level of this one, except at poles.  None if none is known.

    The result consists of + - * and integer powers of the leaves.
    """
    try:
        root, value, _ = peel(root, value)
    except OverflowError:
        return None
    if root.op in _PRODUCTS and math.isfinite(value):
        found = _of_product(_PRODUCTS[root.op](*root.operands, value=value))
        if found is None or root.op != "middle_eigenvalue":
            return found
        return replace(found, matrix=_less(root.operands, value))
    squares = square(root) if value > 0 else None
    quotient = fraction(root)
    if quotient is None and squares is not None and squares[1] <= 1:
        quotient, value = fraction(squares[0]), value * value
    if quotient is None or not math.isfinite(value):
        return None
    above, below = quotient
    if below is ONE:
        return Level(above, value)
    return Level(_minus(above, call("*", number(value), below)), 0.0)


def _of_product(found: tuple[Node, Node] | None) -> Level | None:
    """The level 0 of a product; its factors also vanish at points that do not count."""
    if found is None:
        return None
    zero, other = map(fraction, found)
    # if one of two operands equals the value everywhere, the product is zero everywhere
    if zero is None or other is None or zero[0] is ZERO:
        return None
    return Level(zero[0], 0.0, other[0] if other[1] is ONE else call("*", *other))


def _larger(a: Node, b: Node, value: float) -> tuple[Node, Node]:
    """max(a, b) = v: one operand is v, and neither is larger."""
    one, two = (_minus(each, number(value)) for each in (a, b))
    return call("*", one, two), call("+", one, two)


def _smaller(a: Node, b: Node, value: float) -> tuple[Node, Node]:
    product, total = _larger(a, b, value)
    return product, negative(total)


def _less(entries: Sequence[Node], value: float) -> tuple[Node, ...]:
    """A symmetric matrix minus a value times the identity, times a common denominator; empty if there is none.

    For either sign of that factor, the second of three eigenvalues stays the second, with the same zeros.
    """
    fractions = [fraction(_minus(entry, number(value)) if k < 3 else entry) for k, entry in enumerate(entries)]
    found = [each for each in fractions if each is not None]
    divisors = [factors(below) for _, below in found]
    if len(found) < len(entries) or not all(divisors):
        return ()
    common = reduce(or_, divisors)
    return tuple(call("*", above, _product(common - own)) for (above, _), own in zip(found, divisors, strict=True))


def _middle_eigenvalue(xx: Node, yy: Node, zz: Node, xy: Node, xz: Node, yz: Node, value: float) -> tuple[Node, Node]:
    """With M the matrix minus v: det M = 0, and the product of the other two eigenvalues of M is not positive.

    If one eigenvalue is zero, the sum of the principal minors is the product of the others.
    """
    return minors_of((xx, yy, zz, xy, xz, yz), value)[:2]


def minors_of(entries: Sequence[Node], value: float) -> tuple[Node, Node, Node]:
    """Determinant, sum of the principal minors, and trace of a symmetric matrix less a value."""
    xx, yy, zz, xy, xz, yz = entries
    a, b, c = (_minus(each, number(value)) for each in (xx, yy, zz))
    minors = [_minus(call("*", p, q), call("*", r, r)) for p, q, r in ((b, c, yz), (a, c, xz), (a, b, xy))]
    by_row = (
        call("*", a, minors[0]),
        call("*", xy, _minus(call("*", xz, yz), call("*", xy, c))),
        call("*", xz, _minus(call("*", xy, yz), call("*", xz, b))),
    )
    return _total(*by_row), _total(*minors), _total(a, b, c)


def _imaginary_root(a: Node, b: Node, value: float) -> tuple[Node, Node] | None:
    """The roots -2 s, s + i v and s - i v of t^3 + a t + b satisfy 3 s^2 = v^2 - a and b = 2 s (s^2 + v^2).

    This gives b^2 = 4/27 (v^2 - a) (4 v^2 - a)^2, which also holds for a = 4 v^2 and b = 0; otherwise a is at most v^2.
    For v = 0 all roots are real; the result is None.
    """
    if not value > 0:
        return None
    square = number(value * value)
    far = _minus(number(4.0 * square.value), a)
    cubic = call("*", _minus(square, a), call("*", far, far))
    zero = _minus(call("*", b, b), call("*", number(4.0 / 27.0), cubic))
    return zero, _minus(a, number(2.0 * square.value))


def _minus(a: Node, b: Node) -> Node:
    return call("-", a, b)


def _total(*nodes: Node) -> Node:
    return reduce(partial(call, "+"), nodes)


#: functions whose levels are zeros of a product, as functions of their operands and the value; they return the product
#: and `Level.spurious`
_PRODUCTS: Mapping[str, Callable[..., tuple[Node, Node] | None]] = {
    "max": _larger,
    "min": _smaller,
    "middle_eigenvalue": _middle_eigenvalue,
    "imaginary_root": _imaginary_root,
}


def peel(node: Node, value: float) -> tuple[Node, float, int]:
    """The expression without increasing functions and constants around it, its value there, and a sign.

    sign  -1 if the result exceeds its value where the whole is below its own, else 1
    """
    sign = 1
    while node.op not in LEAVES:
        first, last = node.operands[0], node.operands[-1]
        if node.op in _INVERSES:
            value = _INVERSES[node.op](value) if math.isfinite(value) else value
            node = first
        elif first.op == "number" and node.op in ("+", "-"):
            sign = -sign if node.op == "-" else sign
            node, value = last, value - first.value if node.op == "+" else first.value - value
        elif last.op == "number" and node.op in ("+", "-"):
            node, value = first, value - last.value if node.op == "+" else value + last.value
        elif first.op == "number" and node.op == "*" and first.value:
            sign = -sign if first.value < 0 else sign
            node, value = last, value / first.value
        elif last.op == "number" and node.op in ("*", "/") and last.value:
            sign = -sign if last.value < 0 else sign
            node, value = first, value / last.value if node.op == "*" else value * last.value
        else:
            break
    return node, value, sign


def fraction(root: Node) -> Fraction | None:
    """Polynomials of the leaves whose quotient an expression is."""

    def inner(node: Node, parts: list[Fraction | None]) -> Fraction | None:
        one, two = parts[0], parts[-1]
        if one is None or two is None:
            return None
        if node.op in ("+", "-") and one[1] is two[1]:
            return _reduced(call(node.op, one[0], two[0]), one[1])
        if node.op in ("+", "-"):
            common = _common(one[1], two[1])
            left, right = (_without(each[1], common) for each in (one, two))
            above = call(node.op, call("*", one[0], right), call("*", two[0], left))
            return _reduced(above, call("*", one[1], right))
        if node.op == "*":
            return _reduced(call("*", one[0], two[0]), call("*", one[1], two[1]))
        if node.op == "/":
            return _reduced(call("*", one[0], two[1]), call("*", one[1], two[0]))
        return _power(node, one)

    return fold(root, lambda leaf: (leaf, ONE), inner)


def _reduced(above: Node, below: Node) -> Fraction:
    """A fraction without the factors that both have: powers of a density, which each division brings, add degrees."""
    common = _common(above, below)
    return _without(above, common), _without(below, common)


def _common(one: Node, two: Node) -> Counter[Node]:
    """Multiplicities of the common factors of products, without numbers; empty if a product has too many factors."""
    if one is ONE or two is ONE:
        return Counter()
    both = factors(one) & factors(two)
    return Counter({node: times for node, times in both.items() if node.op != "number"})


def factors(node: Node) -> Counter[Node]:
    """Multiplicity of each factor in a product, as written; empty for too many factors."""
    found: Counter[Node] = Counter()
    waiting = [(node, 1)]
    while waiting:
        own, times = waiting.pop()
        exponent = whole_exponent(own)
        if own.op == "*":
            waiting += [(operand, times) for operand in reversed(own.operands)]
        elif exponent is not None and exponent > 0:
            waiting.append((own.operands[0], times * exponent))
        else:
            found[own] += times
        if len(found) + len(waiting) > _MOST_FACTORS:
            return Counter()
    return found


def _without(node: Node, left_out: Counter[Node]) -> Node:
    """A product without some of its factors."""
    if not left_out:
        return node
    return _product(factors(node) - left_out)


def _product(bases: Counter[Node]) -> Node:
    powers = [base if times == 1 else call("^", base, number(times)) for base, times in bases.items()]
    return reduce(partial(call, "*"), powers, ONE)


def _power(node: Node, base: Fraction) -> Fraction | None:
    """A whole power of a fraction."""
    exponent = whole_exponent(node)
    if exponent is None or abs(exponent) > _MOST_POWER:
        return None
    times = number(abs(exponent))
    above, below = (each if each is ONE else call("^", each, times) for each in base)
    return (above, below) if exponent >= 0 else (below, above)


def square(root: Node) -> tuple[Node, int] | None:
    """The square of a nonnegative expression, and the number of its roots whose operand may be negative somewhere."""

    def inner(node: Node, parts: list[tuple[Node, int] | None]) -> tuple[Node, int] | None:
        if node.op == "sqrt":
            return node.operands[0], int(not is_positive(node.operands[0]))
        if node.op == "abs":
            return call("*", node.operands[0], node.operands[0]), 0
        one, two = parts[0], parts[-1]
        if node.op not in ("*", "/") or one is None or two is None:
            return None
        return call(node.op, one[0], two[0]), one[1] + two[1]

    def leaf(node: Node) -> tuple[Node, int] | None:
        return (number(node.value**2), 0) if node.op == "number" and node.value >= 0 else None

    return fold(root, leaf, inner)


def is_positive(root: Node) -> bool:
    """Whether an expression is nowhere negative, by its form."""

    def inner(node: Node, parts: list[bool]) -> bool:
        first, last = node.operands[0], node.operands[-1]
        if node.op in ("abs", "sqrt", "exp") or (node.op in ("*", "/") and first is last):
            return True
        if node.op == "^" and last.op == "number" and last.value % 2 == 0:
            return True
        return node.op in ("+", "*", "/") and all(parts)

    return fold(root, lambda node: node is ZERO or (node.op == "number" and node.value >= 0), inner)
