"""Equations "quantity = value" on boxes: a linear part and a bound of the remainder, by the mean value theorem.

For fields w with w(t) = w0 + A t + rest on a box, |rest| <= rho, and a quantity g of them,

    g(w(t)) = g(w0) + sum_j g_j(somewhere) (w_j(t) - w0_j)

where interval arithmetic bounds the derivatives g_j over all values of the fields on the box (Moore, Kearfott and
Cloud, Introduction to Interval Analysis, 2009, chapter 6).  It holds where the quantity is continuous there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.core.quantities import intervals
from elvis.core.quantities.functions import function
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import ONE, Node, call, fold, leaves, number, partial, whole_exponent

#: part of the largest terms that rounding may change
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Linear:
    """A function on each of k boxes, t in [-1, 1]^d: value + gradient t + rest.

    value  (k,)    at the middle
    gradient  (k, d)
    rest   (k,) largest magnitude of all else, rounding included; infinite if nothing is known
    """

    value: Floats
    gradient: Floats
    rest: Floats


@dataclass(frozen=True, eq=False)
class Equation:
    """A quantity has its value if ``root`` is zero and no number of ``nonzero`` is."""

    root: Node
    nonzero: tuple[Node, ...] = ()

    @staticmethod
    def of(quantity: Node, value: float) -> Equation:
        """The equation of a quantity and a value, cleared of the outermost denominator, so that poles are no zeros."""
        if quantity.op == "/":
            above, below = quantity.operands
            return Equation(call("-", above, call("*", number(value), below)), (below,))
        if quantity.op == "tan":
            sine, cosine = (call(name, *quantity.operands) for name in ("sin", "cos"))
            return Equation(call("-", sine, call("*", number(value), cosine)))
        if quantity.op == "sign" and value not in (-1.0, 0.0, 1.0):
            return Equation(ONE)
        return Equation(call("-", quantity, number(value)))

    @cached_property
    def leaves(self) -> tuple[Node, ...]:
        """Its fields and coordinates."""
        return tuple(leaves(self.root, *self.nonzero))

    @property
    def is_known(self) -> bool:
        """Whether it contains only fields and coordinates, without derivatives and attributes of elements."""
        return all(leaf.op == "coordinate" or (leaf.op == "field" and not leaf.axes) for leaf in self.leaves)

    @cached_property
    def _partials(self) -> list[Node]:
        return [partial(self.root, leaf) for leaf in self.leaves]

    def on(self, parts: list[Linear]) -> tuple[Linear, Bools]:
        """The equation on boxes, from its leaves there; and (k,) where bounds leave room for a zero."""
        count = len(parts[0].value)
        spans = [np.abs(part.gradient).sum(axis=1) + part.rest for part in parts]
        ends = {
            leaf: (part.value - span, part.value + span)
            for leaf, part, span in zip(self.leaves, parts, spans, strict=True)
        }
        middle = self._value({leaf: part.value for leaf, part in zip(self.leaves, parts, strict=True)}, count)
        gradient, rest = np.zeros_like(parts[0].gradient), np.zeros(count)
        scale = np.abs(middle)
        for own, part, span in zip(self._partials, parts, spans, strict=True):
            low, high = (np.broadcast_to(end, count) for end in _bounds(own, ends)[0])
            with np.errstate(invalid="ignore"):
                half, mean = 0.5 * (high - low), 0.5 * (low + high)
            gradient += mean[:, None] * part.gradient
            rest += np.abs(mean) * part.rest + half * span
            scale = scale + np.maximum(np.abs(low), np.abs(high)) * (np.abs(part.value) + span)
        (low, high), broken = _bounds(self.root, ends)
        noise = _ROUNDING * sum(np.maximum(*np.abs(_bounds(node, ends)[0])) for node in self.root.operands)
        for node in self.nonzero:
            (least, most), torn = _bounds(node, ends)
            broken = broken | torn | ~((least > 0) | (most < 0))
        rest = rest + _ROUNDING * scale
        unknown = broken | ~np.isfinite(middle) | ~np.isfinite(gradient).all(axis=1) | ~np.isfinite(rest)
        rest = np.where(unknown, np.inf, rest)
        gradient = np.where(unknown[:, None], 0.0, gradient)
        possible = ~(low > noise) & ~(high < -noise) & ~(np.isnan(low) & np.isnan(high))
        return Linear(np.where(np.isfinite(middle), middle, 0.0), gradient, rest), np.broadcast_to(possible, count)

    def _value(self, known: dict[Node, Floats], count: int) -> Floats:
        """(k,) the left side where the leaves have these values."""

        def leaf(node: Node) -> Floats | float:
            return node.value if node.op == "number" else known[node]

        with np.errstate(all="ignore"):
            found = fold(self.root, leaf, lambda node, parts: function(node).numpy(*parts))
        return np.broadcast_to(np.asarray(found, np.float64), count)


def _bounds(root: Node, ends: dict[Node, Interval]) -> tuple[Interval, Bools]:
    """Smallest and largest values (k,) of an expression; and (k,) whether it may jump or lack values between them."""
    count = len(next(iter(ends.values()))[0])
    broken = np.zeros(count, bool)

    def leaf(node: Node) -> Interval:
        return intervals.number(node.value) if node.op == "number" else ends[node]

    def inner(node: Node, parts: list[Interval]) -> Interval:
        broken[:] |= _may_break(node, parts)
        return function(node).interval(*parts)

    with np.errstate(all="ignore"):
        low, high = fold(root, leaf, inner)
    return (np.broadcast_to(low, count), np.broadcast_to(high, count)), broken


def _may_break(node: Node, parts: list[Interval]) -> Bools | bool:
    """Whether an operation may jump or lack a value for some of its operands; poles have no bounds in any case."""
    (low, high), other = parts[0], parts[-1]
    if node.op == "sign":
        return np.asarray((low <= 0) & (high >= 0))
    if node.op == "step":
        return np.asarray((low <= other[1]) & (high >= other[0]))
    if node.op == "atan2":
        return np.asarray((low <= 0) & (high >= 0) & (other[0] <= 0))
    if node.op in ("sqrt", "log"):
        return np.asarray(low <= 0)
    if node.op in ("asin", "acos"):
        return np.asarray((low <= -1) | (high >= 1))
    if node.op == "^":
        return False if whole_exponent(node) is not None else np.asarray(low <= 0)
    return False
