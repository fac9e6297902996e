"""Chebyshev models of expressions: of sums, products, quotients and whole powers of fields and their derivatives."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.chebyshev_models.model import ChebyshevModel, constant
from elvis.core.chebyshev_models.series import (
    ORDERS,
    REACH,
    along_axes,
    bounds_in_eighths,
    magnitudes_of,
    shells_of,
    slopes_of,
    steepness,
    sum_rounding,
    values_at,
)
from elvis.core.quantities.tree import LEAVES, Node, fold_all, leaves, ordered, whole_exponent
from elvis.core.quantities.tree import field as field_of

#: operations that models have
_OPERATIONS = ("+", "-", "*", "/", "^")
#: the highest power that is taken by products
_HIGHEST_POWER = 8


def has_models(root: Node) -> bool:
    """Whether models exist for all operations of an expression."""
    operations = [node for node in ordered(root) if node.op not in LEAVES]
    if any(node.op not in _OPERATIONS for node in operations):
        return False
    exponents = [whole_exponent(node) for node in operations if node.op == "^"]
    if any(exponent is None or not 1 <= abs(exponent) <= _HIGHEST_POWER for exponent in exponents):
        return False
    return all(leaf.op == "coordinate" or (leaf.op == "field" and len(leaf.axes) <= 1) for leaf in leaves(root))


@dataclass(frozen=True, eq=False)
class BoxLeaves:
    """The map and the fields on n boxes, from which models of expressions are made.

    names   of the fields
    derivatives  of fields that are leaves themselves, after the fields
    series  (n, leaves, degree + 1 three times) Chebyshev coefficients: x, y, z, the fields and the derivatives
    errors  (n, leaves) how far values that are computed in an element may be from the true ones
    off     (n, leaves) how far the series may be from the leaves, by polynomials of their degree
    lost    (n, ORDERS, leaves) bounds of other errors of the series, and of the derivatives of these errors in x
    scale   derivatives along a box's x over those along the coordinates of its element
    count   nodes of a line
    """

    names: tuple[str, ...]
    derivatives: tuple[Node, ...]
    series: Floats
    errors: Floats
    off: Floats
    lost: Floats
    scale: float
    count: int
    _known: dict[object, ChebyshevModel] = field(default_factory=dict)

    def value(self, leaf: int) -> ChebyshevModel:
        """A leaf, which is exact on the lattice but for rounding."""
        return self._evaluated(leaf, (0, 0, 0))

    def slope(self, leaf: int, direction: int) -> ChebyshevModel:
        """The derivative of a leaf along a coordinate of the element."""
        key = leaf, direction
        if key not in self._known:
            orders = tuple(int(axis == direction) for axis in range(3))
            self._known[key] = self._evaluated(leaf, orders)
        return self._known[key]

    def _series(self, leaf: int, orders: tuple[int, ...]) -> tuple[Floats, Floats]:
        """The series of a leaf or of a derivative, and maximum errors (n,) of their computed values."""
        coefficients, error = self.series[:, leaf], self.errors[:, leaf]
        if any(orders):
            # derivatives of Bernstein polynomials are differences of coefficients, times their degree
            error = 2.0 * (coefficients.shape[-1] - 1) * error
            coefficients = self.scale * slopes_of(coefficients, orders.index(1))
        return coefficients, error

    def _evaluated(self, leaf: int, orders: tuple[int, ...]) -> ChebyshevModel:
        coefficients, error = self._series(leaf, orders)
        size, order = coefficients.shape[-1], int(any(orders))
        shells = np.pad(shells_of(coefficients), ((0, 0), (0, self.count - size)))
        values = along_axes(coefficients, *3 * [values_at(self.count, size)])
        return ChebyshevModel(values, self._remainder(leaf, order), error, shells)

    def _remainder(self, leaf: int, order: int) -> Floats:
        """(ORDERS, n) errors of the series of a leaf, or of its derivatives, and of the derivatives of these errors.

        The difference to the true leaf is a polynomial of the same degree.
        """
        size = self.series.shape[-1]
        total = np.abs(self.series[:, leaf]).reshape(len(self.series), size**3).sum(axis=1)
        error = self.off[:, leaf] + sum_rounding(size) * total
        found = np.outer([steepness(size, k + order) * self.scale**order for k in range(ORDERS)], error)
        return found if order else found + self.lost[:, :, leaf].T

    def cofactor(self, direction: int, axis: int) -> ChebyshevModel:
        """An entry of the matrix of cofactors of the map: the gradient of a coordinate times the determinant."""
        key = "cofactor", direction, axis
        if key not in self._known:
            second, third = (direction + 1) % 3, (direction + 2) % 3
            a, b = (axis + 1) % 3, (axis + 2) % 3
            positive = self.slope(a, second) * self.slope(b, third)
            negative = self.slope(b, second) * self.slope(a, third)
            self._known[key] = positive - negative
        return self._known[key]

    def inverse_determinant(self) -> ChebyshevModel:
        """One over the determinant of the map."""
        if "inverse" not in self._known:
            terms = [self.slope(0, direction) * self.cofactor(direction, 0) for direction in range(3)]
            self._known["inverse"] = (terms[0] + terms[1] + terms[2]).reciprocal()
        return self._known["inverse"]

    def derivative(self, name: str, axis: int) -> ChebyshevModel:
        """The derivative of a field along x, y or z."""
        known = field_of(name, (axis,))
        if known in self.derivatives:
            return self.value(3 + len(self.names) + self.derivatives.index(known))
        leaf = 3 + self.names.index(name)
        terms = [self.slope(leaf, direction) * self.cofactor(direction, axis) for direction in range(3)]
        return (terms[0] + terms[1] + terms[2]) * self.inverse_determinant()


@dataclass(frozen=True, eq=False)
class LeavesOfEighths(BoxLeaves):
    """The leaves on the eighths of n boxes, enlarged by REACH, as constants: their models bound errors more closely."""

    def _evaluated(self, leaf: int, orders: tuple[int, ...]) -> ChebyshevModel:
        coefficients, error = self._series(leaf, orders)
        total = magnitudes_of(coefficients)
        mean, distance = (own.reshape(-1) for own in bounds_in_eighths(coefficients, total, REACH))
        distance = distance + np.repeat(self._remainder(leaf, int(any(orders)))[0], 8)
        none = np.zeros_like(distance)
        bounds = np.abs(mean) + distance
        values = mean[:, None, None, None]
        return ChebyshevModel(values, np.stack([distance, none, none]), np.repeat(error, 8), None, bounds)


def errors_in_eighths(roots: Sequence[Node], leaves_of_boxes: BoxLeaves) -> list[Floats]:
    """(n, 8) maximum errors of computed values of expressions in the eighths of boxes, for each expression."""
    own = {each.name: getattr(leaves_of_boxes, each.name) for each in fields(BoxLeaves) if each.init}
    found = models_of(roots, LeavesOfEighths(**{**own, "_known": {}}))
    return [model.error.reshape(-1, 8) for model in found]


def model_of(root: Node, leaves_of_boxes: BoxLeaves) -> ChebyshevModel:
    """The model of an expression on boxes."""
    return models_of((root,), leaves_of_boxes)[0]


def models_of(roots: Sequence[Node], leaves_of_boxes: BoxLeaves) -> list[ChebyshevModel]:
    """The models of expressions on boxes."""

    def leaf(node: Node) -> ChebyshevModel | float:
        if node.op == "number":
            return node.value
        if node.op == "coordinate":
            return leaves_of_boxes.value(node.axes[0])
        if node.axes:
            return leaves_of_boxes.derivative(node.name, node.axes[0])
        return leaves_of_boxes.value(3 + leaves_of_boxes.names.index(node.name))

    def inner(node: Node, operands: list[ChebyshevModel | float]) -> ChebyshevModel | float:
        exponent = whole_exponent(node)
        if exponent is not None and isinstance(operands[0], ChebyshevModel):
            power = operands[0].power(abs(exponent))
            return power if exponent > 0 else power.reciprocal()
        return _RULES[node.op](*operands)

    found = fold_all(roots, leaf, inner)
    return [own if isinstance(own, ChebyshevModel) else constant(leaves_of_boxes.value(0), own) for own in found]


def _sum(a: ChebyshevModel | float, b: ChebyshevModel | float) -> ChebyshevModel | float:
    if isinstance(a, ChebyshevModel):
        return a + b if isinstance(b, ChebyshevModel) else a.plus(b)
    return b.plus(a) if isinstance(b, ChebyshevModel) else a + b


def _difference(a: ChebyshevModel | float, b: ChebyshevModel | float) -> ChebyshevModel | float:
    return _sum(a, b.times(-1.0) if isinstance(b, ChebyshevModel) else -b)


def _product(a: ChebyshevModel | float, b: ChebyshevModel | float) -> ChebyshevModel | float:
    if isinstance(a, ChebyshevModel):
        return a * b if isinstance(b, ChebyshevModel) else a.times(b)
    return b.times(a) if isinstance(b, ChebyshevModel) else a * b


def _quotient(a: ChebyshevModel | float, b: ChebyshevModel | float) -> ChebyshevModel | float:
    if isinstance(b, ChebyshevModel):
        return _product(a, b.reciprocal())
    return a.times(1.0 / b) if isinstance(a, ChebyshevModel) else a / b


_RULES: Mapping[str, Callable[[ChebyshevModel | float, ChebyshevModel | float], ChebyshevModel | float]] = {
    "+": _sum,
    "-": _difference,
    "*": _product,
    "/": _quotient,
}
