"""Quantities with derivatives on curved elements as polynomials: their denominators are powers of det J."""

from __future__ import annotations

from typing import NamedTuple

from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.expression_nets import degree_on
from elvis.core.quantities.tree import Node, fold, whole_exponent

#: the highest degree of polynomials with cleared denominators; beyond it nets have too much rounding
MOST_CLEARED = 24


class Cleared(NamedTuple):
    """A quantity f on elements for which f |det J|^power is a polynomial of a degree in any direction."""

    degree: int
    power: int = 0

    def is_known(self, is_valid: bool) -> bool:
        """Whether nets are known on elements of which ``is_valid`` tells whether det J keeps its sign."""
        return not self.power or (is_valid and self.degree <= MOST_CLEARED)


def cleared_on(expression: Expression, evaluator: Evaluator, patch: Patch, is_affine: bool) -> Cleared | None:
    """How the denominators of an expression are cleared, with the sign kept; None if that gives no polynomial.

    A first derivative is a sum of derivatives in reference coordinates times cofactors of J, divided by det J.
    """
    degree = degree_on(expression, evaluator, patch, is_affine)
    if degree is not None:
        return Cleared(degree)
    d = patch.shape.dimension
    if expression.order > 1 or not patch.is_flat or d < 2 or patch.homogeneous is not None:
        return None
    cofactor, jacobian = jacobian_degrees(patch)

    def leaf(node: Node) -> Cleared | None:
        if node.op == "number":
            return Cleared(0)
        is_slope = node.op == "field" and bool(node.axes)
        own = degree_on(Expression(expression.text, node), evaluator, patch, is_affine or is_slope)
        if own is None or not is_slope:
            return None if own is None else Cleared(own)
        return Cleared(max(own - 1, 0) + cofactor, 1)

    def inner(node: Node, parts: list[Cleared | None]) -> Cleared | None:
        known = [part for part in parts if part is not None]
        return None if len(known) < len(parts) else _combined(node, known, jacobian)

    return fold(expression.root, leaf, inner)


def jacobian_degrees(patch: Patch) -> tuple[int, int]:
    """The degrees of the cofactors of J and of det J in any direction."""
    d, m = patch.shape.dimension, max(box_degrees(bernstein_space(patch.geometry)))
    # in simplices degrees are total ones, and each derivative lowers them
    is_simplex = len(patch.shape.vertices) == d + 1
    return ((d - 1) * (m - 1), d * (m - 1)) if is_simplex else ((d - 1) * m, d * m - 1)


def _combined(node: Node, parts: list[Cleared], jacobian: int) -> Cleared | None:
    """An operation on cleared quantities; ``jacobian`` is the degree of det J."""
    first, last = parts[0], parts[-1]
    if node.op == "*":
        return Cleared(first.degree + last.degree, first.power + last.power)
    if node.op in "+-":
        power = max(first.power, last.power)
        return Cleared(max(part.degree + (power - part.power) * jacobian for part in parts), power)
    exponent = whole_exponent(node)
    if exponent is not None and exponent >= 0:
        return Cleared(first.degree * exponent, first.power * exponent)
    return first if node.op == "/" and node.operands[1].op == "number" else None
