"""The region where an expression is less than a value, as signs of polynomials.

If f - v = P / D, then f < v is the same as P D < 0.  If P = 0, f equals v; zeros of D are poles, across which f changes
its side without attaining v.  Regions of max, min and eigenvalues are intersections and unions of such.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Ints
from elvis.core.quantities.levels import factors, fraction, is_positive, minors_of, peel, square
from elvis.core.quantities.tree import ZERO, Node, call, number, ordered


@dataclass(frozen=True, eq=False)
class Region:
    """A part of space, by the signs that polynomials have there.

    kind      "product": sign times the product of the polynomials is negative; "all", "any": the intersection, or the
              union, of the parts
    surfaces  the polynomials at whose zeros the expression attains the value; zeros of the others are poles
    """

    kind: str
    parts: tuple[Region, ...] = ()
    sign: int = 1
    polynomials: tuple[Node, ...] = ()
    surfaces: frozenset[Node] = frozenset()

    def holds(self, signs: Mapping[Node, Ints]) -> Ints:
        """(n,) 1 inside, -1 outside, 0 if undecided, from signs (n,) of polynomials, which are 0 if unknown."""
        if self.kind == "product":
            return np.asarray(-self.sign * math.prod((signs[each] for each in self.polynomials), start=np.int64(1)))
        inner = [part.holds(signs) for part in self.parts]
        if self.kind == "all":
            return np.asarray(np.minimum.reduce(np.broadcast_arrays(np.int64(1), *inner)))
        return np.asarray(np.maximum.reduce(np.broadcast_arrays(np.int64(-1), *inner)))

    @property
    def every_polynomial(self) -> tuple[Node, ...]:
        """All polynomials of the region, each once."""
        inner = (node for part in self.parts for node in part.every_polynomial)
        return tuple(dict.fromkeys((*self.polynomials, *inner)))

    @property
    def every_surface(self) -> frozenset[Node]:
        """All polynomials whose zeros bound the region where the expression has the value."""
        return self.surfaces.union(*(part.every_surface for part in self.parts))


#: the whole space, and nothing
EVERYWHERE, NOWHERE = Region("all"), Region("any")


def of_polynomial(root: Node) -> Region:
    """The region in which a polynomial is negative."""
    return Region("product", polynomials=(root,), surfaces=frozenset((root,)))


def side(root: Node, value: float, sign: int) -> Region | None:
    """The region in which sign times (expression - value) is negative; None if no such polynomials are known.

    The result is right where the expression is defined.
    """
    try:
        node, level, turned = peel(root, value)
    except OverflowError:
        return None
    sign *= turned
    level += 0.0  # no negative zero, which no rule of expressions leaves out
    if not math.isfinite(level):
        return EVERYWHERE if (level > 0) == (sign > 0) else NOWHERE
    if node.op in _COMBINED:
        return _COMBINED[node.op](node.operands, level, sign)
    return _of_quotient(node, level, sign)


def defined_side(root: Node, value: float, sign: int) -> Region | None:
    """The part of `side` in which the expression is defined."""
    domain = list(_domain(root))
    return _intersection([side(root, value, sign), *domain])


def _domain(root: Node) -> Iterator[Region | None]:
    """The regions in which operands of roots and logarithms are positive, except operands that always are."""
    for node in ordered(root):
        if node.op in ("sqrt", "log") and not is_positive(node.operands[0]):
            found = side(node.operands[0], 0.0, -1)
            yield found and _inner(found)


def _inner(region: Region) -> Region:
    """The region without surfaces: at its bounds the expression doesn't attain the value."""
    return Region(region.kind, tuple(map(_inner, region.parts)), region.sign, region.polynomials)


def _intersection(regions: Sequence[Region | None]) -> Region | None:
    return _joined("all", regions)


def _joined(kind: str, regions: Sequence[Region | None]) -> Region | None:
    known = [each for each in regions if each is not None]
    if len(known) < len(regions):
        return None
    return known[0] if len(known) == 1 else Region(kind, tuple(known))


def _of_quotient(node: Node, value: float, sign: int) -> Region | None:
    """The region of f - v = P / D; of squares where f is nowhere negative, with at most one root in it."""
    squares = square(node)
    if squares is not None and value < 0:
        return EVERYWHERE if sign < 0 else NOWHERE
    quotient = fraction(node)
    if quotient is None and squares is not None and squares[1] <= 1 and value > 0:
        quotient = fraction(squares[0])
        value = value * value
    if quotient is None or not math.isfinite(value):
        return None
    above, below = quotient
    return _of_fraction(call("-", above, call("*", number(value), below)), below, sign)


def _of_fraction(above: Node, below: Node, sign: int) -> Region | None:
    """The region in which sign P / D is negative, from the factors of both.

    Even powers of a divisor have no sign.  Even powers of P stay as squares: f has the value there, and no side.
    """
    polynomials: list[Node] = []
    for base, times in (factors(above) or {above: 1}).items():
        if base.op != "number":
            polynomials.append(base if times % 2 else call("^", base, number(2)))
        elif base is ZERO:
            return None
        elif base.value < 0 and times % 2:
            sign = -sign
    surfaces = frozenset(polynomials)
    for base, times in (factors(below) or {below: 1}).items():
        if base.op == "number":
            sign = -sign if base.value < 0 and times % 2 else sign
        elif times % 2 and not is_positive(base):
            polynomials.append(base)
    return Region("product", (), sign, tuple(polynomials), surfaces)


def _of_extremum(kind: str) -> Callable[[Sequence[Node], float, int], Region | None]:
    """The rule that max(a, b) < v if both are, and max(a, b) > v if any is; for min the other way round."""

    def rule(operands: Sequence[Node], value: float, sign: int) -> Region | None:
        regions = [side(operand, value, sign) for operand in operands]
        bound = _joined(kind if sign > 0 else _OTHER[kind], regions)
        return _intersection([bound, *(each for operand in operands for each in _domain(operand))])

    return rule


def _of_middle_eigenvalue(entries: Sequence[Node], value: float, sign: int) -> Region | None:
    """The region in which the second of three eigenvalues is less, or greater, than a value.

    M is the matrix less v, d its determinant, e the sum of its principal minors, t its trace.  All eigenvalues are
    positive if d, e and t are (Descartes' rule of signs); if d > 0 otherwise, two are negative.  The eigenvalues of -M
    have the opposite signs.
    """
    zero, minors, trace = minors_of(entries, value)
    positive = {name: _sign_of(node, -1) for name, node in (("d", zero), ("e", minors), ("t", trace))}
    negative = {name: _sign_of(node, 1) for name, node in (("d", zero), ("e", minors), ("t", trace))}
    if sign < 0:
        # second eigenvalue of M > 0: second eigenvalue of -M < 0, whose determinant and trace have the opposite sign
        for name in ("d", "t"):
            positive[name], negative[name] = negative[name], positive[name]
    two = _intersection([positive["d"], _joined("any", [_hidden(negative["e"]), _hidden(negative["t"])])])
    three = _intersection([negative["d"], _hidden(positive["e"]), _hidden(negative["t"])])
    domain = [each for entry in entries for each in _domain(entry)]
    return _intersection([_joined("any", [two, three]), *domain])


def _hidden(region: Region | None) -> Region | None:
    return region and _inner(region)


def _sign_of(node: Node, sign: int) -> Region | None:
    """The region in which sign times an expression is negative."""
    quotient = fraction(node)
    return quotient and _of_fraction(*quotient, sign)


def _of_imaginary_root(operands: Sequence[Node], value: float, sign: int) -> Region | None:
    """The rule that imaginary_root(a, b) < v, v > 0, is the same as b^2 < 4/27 (v^2 - a) (4 v^2 - a)^2.

    The square s^2 = a + 3/4 r^2 grows with r^2 of the real root r if the other roots are complex, and so does b^2.
    If a > v^2, the right side isn't positive, and s > v.
    """
    if value <= 0:
        return (EVERYWHERE if sign < 0 else NOWHERE) if value < 0 else None
    a, b = operands
    squared = value * value
    far = call("-", number(4.0 * squared), a)
    cubic = call("*", call("-", number(squared), a), call("*", far, far))
    zero = call("-", call("*", b, b), call("*", number(4.0 / 27.0), cubic))
    return _intersection([_sign_of(zero, sign), *_domain(a), *_domain(b)])


_OTHER = {"all": "any", "any": "all"}
#: functions whose regions are combinations of others
_COMBINED: Mapping[str, Callable[[Sequence[Node], float, int], Region | None]] = {
    "max": _of_extremum("all"),
    "min": _of_extremum("any"),
    "middle_eigenvalue": _of_middle_eigenvalue,
    "imaginary_root": _of_imaginary_root,
}
