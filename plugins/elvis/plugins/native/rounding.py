"""How far computed values of fields and expressions may be from the true ones, anywhere in an element.

Bounds of the error of n rounded operations are n u times the magnitudes that go into them, u = 2^-53 (Higham 2002,
Accuracy and Stability of Numerical Algorithms, chapter 3).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_coefficients
from elvis.core.polynomials.rounding import UNIT, coefficient_rounding
from elvis.core.quantities.cells import Cells
from elvis.core.quantities.functions import function
from elvis.core.quantities.intervals import Interval, number
from elvis.core.quantities.tree import Node, fold, whole_exponent
from elvis.core.shapes import Shape

#: modes this much smaller than the largest one are none of a constant
_SMALL = 1e-3


def operations(space: BernsteinSpace) -> int:
    """Roundings that each term of a polynomial of degree p goes through on a device, by nested Horner schemes.

    For each direction 5 p + 2 are enough (Higham 2002, 3.1 and 5.1).  Term i goes through 2 i + 2 products and sums of
    the scheme, its power of 1 - t through p - i products of factors that are rounded once each.  t itself is off by one
    unit, and the derivative is at most 2 p times the largest coefficient.  Together 4 p + 2.

    Pyramids of degree r towards the apex have t = l / w along their base, w = 1 - t_z, in which l, w and the quotient
    are rounded once each: 2 units more, 4 p roundings.  w is also off by the one unit of t_z, so t by 1 / w units; but
    all coefficients of the apex's layer are one, so the derivative is at most 2 p (1 - t_z^r) <= 2 p r w of the
    largest: 2 p r roundings more.
    """
    collapsed = space.shape is Shape.PYRAMID
    return _horner(space.shape.dimension, max(space.degrees), collapsed)


def field_rounding(expansion: Expansion, modal: Floats, space: BernsteinSpace, coefficients: Floats) -> Floats:
    """(n,) bounds for a field.

    modal         (n, m) its coefficients
    coefficients  (n, count) its Bernstein coefficients, as rounded

    Bernstein functions are positive and sum to 1: the error of the evaluation is in proportion to the largest
    coefficient.  0 where the field is a constant.
    """
    with np.errstate(invalid="ignore"):
        modes, values = np.abs(modal), np.abs(coefficients)
        greatest = values.max(axis=1)
        rounding = coefficient_rounding(expansion, modal, space) + UNIT * operations(space) * greatest

        # a constant is a sum of modes of about one size
        alike = (coefficients == coefficients[:, :1]).all(axis=1)
        small = ((modes > 0) & (modes < _SMALL * modes.max(axis=1, keepdims=True))).any(axis=1)
    return np.where(alike & ~small, 0.0, rounding)


def polynomial_rounding(expansion: Expansion, modal: Floats, space: BernsteinSpace) -> Floats:
    """(n,) how far computed values of polynomials, constants too, may be from the true ones; as `field_rounding`."""
    with np.errstate(invalid="ignore"):
        greatest = np.abs(bernstein_coefficients(expansion, modal, space)).max(axis=1, initial=0.0)
        return np.asarray(coefficient_rounding(expansion, modal, space) + UNIT * operations(space) * greatest)


@dataclass(frozen=True, eq=False)
class _ComputedValues:
    """Values between two arrays, and how far computed ones may be from them."""

    ends: Interval
    error: Any

    @property
    def size(self) -> Any:
        """The largest magnitude."""
        return np.maximum(np.abs(self.ends[0]), np.abs(self.ends[1]))


def expression_rounding(root: Node, cells: Cells, field_errors: Callable[[str], Floats], degree: int) -> Floats:
    """Bounds (c,) for an expression on boxes: each operation adds its rounding to the errors of its operands.

    field_errors  errors of the fields by name, (c,)
    degree        of map and fields
    Infinite for operations that do not yield polynomials.
    """
    gradients = _Gradients(cells, degree)
    collapsed = cells.patch.shape is Shape.PYRAMID

    def leaf(node: Node) -> _ComputedValues:
        if node.op == "number":
            return _ComputedValues(number(node.value), 0.0)
        ends = cells.bounds(node)
        size = np.maximum(np.abs(ends[0]), np.abs(ends[1]))
        if node.op == "field":
            own = field_errors(node.name)
            return _ComputedValues(ends, gradients.error(node, own) if node.axes else own)
        return _ComputedValues(
            ends, _horner(3, degree, collapsed) * UNIT * size if node.op == "coordinate" else 0.0 * size
        )

    def inner(node: Node, parts: list[_ComputedValues]) -> _ComputedValues:
        ends = function(node).interval(*(part.ends for part in parts))
        size = np.maximum(np.abs(ends[0]), np.abs(ends[1]))
        return _ComputedValues(ends, _carried(node, parts) + _rounded(node) * UNIT * size)

    with np.errstate(all="ignore"):
        error = fold(root, leaf, inner).error
    return np.broadcast_to(np.where(np.isnan(error), np.inf, error), len(cells))


def _rounded(node: Node) -> int:
    """Roundings of an operation, its own."""
    if node.op in "+-*/":
        return 1
    exponent = whole_exponent(node)
    return 8 if exponent is None else 2 * abs(exponent) + 1


def _carried(node: Node, parts: list[_ComputedValues]) -> Any:
    """Error of an operation that results from the errors of its operands."""
    first, last = parts[0], parts[-1]
    if node.op in "+-":
        return first.error + last.error
    if node.op == "*":
        return first.size * last.error + last.size * first.error + first.error * last.error
    if node.op == "/" and node.operands[1].op == "number":
        return first.error / last.size
    exponent = whole_exponent(node)
    if exponent is not None and exponent >= 0:
        return exponent * (first.size + first.error) ** max(exponent - 1, 0) * first.error
    exact = sum(part.error for part in parts) == 0
    return np.where(exact, 0.0, np.inf)


@dataclass(frozen=True, eq=False)
class _Gradients:
    """Errors of the derivatives of fields along x, y and z in straight simplices."""

    cells: Cells
    degree: int

    def error(self, node: Node, field_error: Floats) -> Floats:
        """Error (c,) of a leaf: infinite for leaves that are not first derivatives, or not known.

        Coefficients of derivatives are differences times the degree; the inverse Jacobian, by cofactors, has a relative
        error that grows as its determinant is small compared with the lengths of its columns.
        """
        nets, number = self.cells.nets, self.cells.names.index(node.name)
        dimension = self.cells.patch.shape.dimension
        if len(node.axes) > 1 or ("field", number, 0) not in nets:
            return np.full(len(self.cells), np.inf)
        axes = tuple(range(1, dimension + 1))
        rows = [[nets["x", c, d].mean(axis=axes) for d in range(dimension)] for c in range(dimension)]
        jacobian = np.moveaxis(np.array(rows), 2, 0)
        lengths = np.linalg.norm(jacobian, axis=1).prod(axis=1)
        skewed = lengths / np.abs(np.linalg.det(jacobian))
        total = np.zeros(len(self.cells))
        weights = np.abs(np.linalg.inv(jacobian))[:, :, node.axes[0]]
        for direction in range(dimension):
            steepest = np.abs(nets["field", number, direction]).max(axis=axes)
            own = 2 * self.degree * field_error + (_horner(dimension, self.degree) + 16 * skewed) * UNIT * steepest
            total += weights[:, direction] * own
        return total


def _horner(dimension: int, degree: int, collapsed: bool = False) -> int:
    """See `operations`."""
    base = 2 * (4 * degree + 2 * degree * degree) if collapsed else 0
    return dimension * (5 * degree + 2) + base
