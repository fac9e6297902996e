"""Expressions that are polynomials on their elements, expanded into one net of coefficients instead of a formula.

Sums, products and whole powers of fields, coordinates and constants are polynomials; derivatives in the world are
polynomials if the map is affine.  In scaled Bernstein form, coefficients times the weights of their functions, a
product is a product of polynomials in the barycentric coordinates: powers add, coefficients convolve (Farouki and
Rajan 1988, Algorithms for polynomials in Bernstein form, section 5).

Nets contain error bounds of their computed coefficients.  Coefficients of a product are means of products of
coefficients, so the errors of its factors grow only by their maximum coefficients.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.data.dataset import Expansion
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_coefficients, bernstein_space, differentiate
from elvis.core.polynomials.rounding import UNIT, coefficient_rounding
from elvis.core.polynomials.weights import weights
from elvis.core.quantities.attributes import Attributes, is_constant
from elvis.core.quantities.tree import Node, field, fold
from elvis.core.shapes import Shape

#: coefficients of one element, beyond which a formula is quicker
MOST_COEFFICIENTS = 5000
#: roundings of each term: two weights, two factors, their product, the weight of the result
_ROUNDINGS = 6
#: tolerance for Jacobians of affine maps about their mean, relative to their maximum entry: rounding of coordinates
_STRAIGHT = 1e-12


@dataclass(frozen=True, eq=False)
class Net:
    """Polynomials on n elements.

    coefficients  (count, n) of the Bernstein functions: sums of rows make products
    error         (n,) how far any of them may be from the true one
    """

    space: BernsteinSpace
    coefficients: Floats
    error: Floats

    @property
    def size(self) -> Floats:
        """(n,) the largest magnitude of a coefficient."""
        return np.asarray(np.abs(self.coefficients).max(axis=0, initial=0.0))

    def elevate(self, space: BernsteinSpace) -> Net:
        """The same polynomials in a space that contains theirs."""
        if space == self.space:
            return self
        missing = tuple(high - low for high, low in zip(space.degrees, self.space.degrees, strict=True))
        one = BernsteinSpace(space.shape, missing)
        count = len(self.error)
        return _product(self, Net(one, np.ones((one.count, count)), np.zeros(count)))

    def negative(self) -> Net:
        """The polynomials with the other sign."""
        return Net(self.space, -self.coefficients, self.error)

    def times(self, factors: Floats | float) -> Net:
        """The polynomials times exact numbers, one or (n,)."""
        product = Net(self.space, self.coefficients * factors, np.abs(factors) * self.error)
        return product.rounded()

    def over(self, number: float) -> Net:
        """The polynomials divided by an exact number."""
        quotient = Net(self.space, self.coefficients / number, self.error / abs(number))
        return quotient.rounded()

    def plus(self, value: float) -> Net:
        """The polynomials and an exact number."""
        return Net(self.space, self.coefficients + value, self.error).rounded()

    def rounded(self) -> Net:
        """The polynomials after one more rounding of each coefficient."""
        return Net(self.space, self.coefficients, self.error + UNIT * self.size)


class Leaves:
    """The nets of the leaves of expressions, on the elements ``rows`` (n,) of a patch.

    names  of the patch's fields
    """

    def __init__(self, patch: Patch, rows: Ints, names: Sequence[str], attributes: Attributes) -> None:
        self.patch, self.rows, self.names, self.attributes = patch, rows, names, attributes
        self._known: dict[Node, Net | None] = {}

    def net(self, leaf: Node) -> Net | None:
        """The net of a leaf; None for a leaf that is not a polynomial, or not known in these elements."""
        if leaf not in self._known:
            self._known[leaf] = self._compute(leaf)
        return self._known[leaf]

    def _compute(self, leaf: Node) -> Net | None:
        if leaf.op == "attribute":
            return self._constant(leaf.name)
        if leaf.op == "coordinate":
            return self._of_modes(self.patch.geometry, self.patch.geometry_coefficients[self.rows, leaf.axes[0]])
        if leaf.axes:
            return self._derivative(leaf)
        number = self.names.index(leaf.name)
        expansion, coefficients = self.patch.fields[number], self.patch.coefficients[number]
        if expansion is None or coefficients is None:
            return None
        return self._of_modes(expansion, coefficients[self.rows])

    def _of_modes(self, expansion: Expansion, coefficients: Floats) -> Net:
        """The net of modal coefficients (n, m)."""
        space = bernstein_space(expansion)
        with np.errstate(invalid="ignore"):
            plain = bernstein_coefficients(expansion, coefficients)
            error = coefficient_rounding(expansion, coefficients, space)
        return Net(space, np.ascontiguousarray(plain.T), error)

    def _constant(self, name: str) -> Net | None:
        """The net of an attribute that is constant on each element."""
        if not is_constant(name):
            return None
        values = self.attributes.constant(name, self.patch.shape, self.patch.element_ids[self.rows])
        space = BernsteinSpace(self.patch.shape, (0,) * len(bernstein_space(self.patch.geometry).degrees))
        return Net(space, np.asarray(values, np.float64)[None, :], np.zeros(len(self.rows)))

    def _derivative(self, leaf: Node) -> Net | None:
        """The net of a derivative: one direction after the other."""
        *before, axis = leaf.axes
        net = self.net(field(leaf.name, before))
        affine = self._affine
        if net is None or affine is None or axis >= self.patch.shape.dimension:
            return None
        return world_gradient(net, *affine, axis)

    @cached_property
    def _affine(self) -> tuple[Floats, Floats] | None:
        """Jacobians (n, d, d) of affine maps, and how far they are off (n,); None where a map is curved."""
        if not _may_be_affine(self.patch):
            return None
        jacobians, bent = mean_jacobians(self.patch, self.rows)
        return (jacobians, bent) if _are_affine(jacobians, bent).all() else None


def is_affine(patch: Patch, rows: Ints) -> Bools:
    """(n,) elements in which derivatives of polynomials along x, y and z are polynomials: their maps are affine."""
    if not _may_be_affine(patch):
        return np.zeros(len(rows), bool)
    return _are_affine(*mean_jacobians(patch, rows))


def _may_be_affine(patch: Patch) -> bool:
    """Not on pyramids, where derivatives of polynomials in eta are fractions, nor on surfaces in space."""
    return patch.shape is not Shape.PYRAMID and patch.is_flat


def _are_affine(jacobians: Floats, bent: Floats) -> Bools:
    """(n,) which maps are affine to rounding; see `mean_jacobians`."""
    sizes = np.abs(jacobians).max(axis=(1, 2))
    return np.asarray((bent <= _STRAIGHT * sizes) & (np.linalg.det(jacobians) != 0.0))


def mean_jacobians(patch: Patch, rows: Ints) -> tuple[Floats, Floats]:
    """Mean Jacobians (n, d, d) of some elements, and how far (n,) any entry may be from them anywhere.

    Rows are world coordinates, columns reference coordinates.  Derivatives lie between their Bernstein coefficients.
    """
    dimension, space = patch.shape.dimension, bernstein_space(patch.geometry)
    control = bernstein_coefficients(patch.geometry, patch.geometry_coefficients[rows, :dimension])
    jacobians = np.empty((len(rows), dimension, dimension))
    bent = np.zeros(len(rows))
    for direction in range(dimension):
        derivatives = differentiate(space, control, direction)[1]
        jacobians[:, :, direction] = derivatives.mean(axis=2)
        away = np.abs(derivatives - derivatives.mean(axis=2, keepdims=True)).max(axis=(1, 2), initial=0.0)
        bent = np.maximum(bent, away)
    return jacobians, bent


def expanded(root: Node, leaf: Callable[[Node], Net | None]) -> Net | None:
    """The net of an expression, from the nets of its leaves, except numbers; None if it is not a polynomial of them.

    leaf  gives all nets on the same elements, or None for a leaf that is not a polynomial
    """

    def outer(node: Node) -> Net | float | None:
        return node.value if node.op == "number" else leaf(node)

    def inner(node: Node, parts: list[Net | float | None]) -> Net | float | None:
        first, last = parts[0], parts[-1]
        if isinstance(first, Net) and isinstance(last, Net):
            return _of_two(node.op, first, last)
        if isinstance(first, Net) and isinstance(last, float):
            return _with_number(node.op, first, last)
        if isinstance(first, float) and isinstance(last, Net):
            return _after_number(node.op, first, last)
        return None

    found = fold(root, outer, inner)
    return found if isinstance(found, Net) else None


def _of_two(op: str, first: Net, last: Net) -> Net | None:
    """The result of an operator on two polynomials; None if it is not a polynomial."""
    match op:
        case "+":
            return _sum(first, last)
        case "-":
            return _sum(first, last.negative())
        case "*" if _fits(first, last):
            return _product(first, last)
    return None


def _with_number(op: str, net: Net, value: float) -> Net | None:
    """The result of an operator on a polynomial and a number."""
    if not np.isfinite(value):
        return None
    match op:
        case "+":
            return net.plus(value)
        case "-":
            return net.plus(-value)
        case "*":
            return net.times(value)
        case "/" if value != 0:
            return net.over(value)
        case "^" if value.is_integer() and value >= 1:
            return _power(net, int(value))
    return None


def _after_number(op: str, value: float, net: Net) -> Net | None:
    """The result of an operator on a number and a polynomial."""
    if op == "-":
        return _with_number("+", net.negative(), value)
    return _with_number(op, net, value) if op in ("+", "*") else None


def _power(net: Net, exponent: int) -> Net | None:
    """A whole power: one factor after the other."""
    result = net
    for _ in range(exponent - 1):
        if not _fits(result, net):
            return None
        result = _product(result, net)
    return result


def _sum(first: Net, second: Net) -> Net:
    """The sum, in the smallest space that contains both."""
    degrees = tuple(map(max, first.space.degrees, second.space.degrees))
    space = BernsteinSpace(first.space.shape, degrees)
    one, other = first.elevate(space), second.elevate(space)
    return Net(space, one.coefficients + other.coefficients, one.error + other.error).rounded()


def _product(first: Net, second: Net) -> Net:
    """The product: the shorter factor's terms, one after the other, times the longer."""
    if first.space.count < second.space.count:
        first, second = second, first
    space = _product_space(first.space, second.space)
    longer = first.coefficients * weights(first.space)[:, None]
    shorter = second.coefficients * weights(second.space)[:, None]
    scaled = np.zeros((space.count, len(first.error)))
    for row, place in zip(shorter, _places(first.space, second.space), strict=True):
        scaled[place] += longer * row
    one, other = first.size, second.size
    carried = first.error * (other + second.error) + one * second.error
    rounding = (second.space.count + _ROUNDINGS) * UNIT * one * other
    return Net(space, scaled / weights(space)[:, None], carried + rounding)


def _fits(first: Net, second: Net) -> bool:
    return _product_space(first.space, second.space).count <= MOST_COEFFICIENTS


def _product_space(first: BernsteinSpace, second: BernsteinSpace) -> BernsteinSpace:
    degrees = tuple(one + other for one, other in zip(first.degrees, second.degrees, strict=True))
    return BernsteinSpace(first.shape, degrees)


@bounded_cache
def _places(first: BernsteinSpace, second: BernsteinSpace) -> Ints:
    """(count of second, count of first) where in the product the products of their functions are."""
    target = _product_space(first, second)
    sums = second.powers[:, None, :] + first.powers[None, :, :]
    return frozen_ints(target.positions[tuple(np.moveaxis(sums, -1, 0))])


def world_gradient(net: Net, jacobians: Floats, bent: Floats, axis: int) -> Net:
    """The derivative along x, y or z, if the map is affine.

    jacobians  (n, d, d) derivatives of world coordinates (rows) with respect to reference coordinates
    bent       (n,) maximum deviation of any derivative from that in the element

    Uses the inverse of the Jacobian, whose error grows as its determinant is small relative to the lengths of its
    columns.  Coefficients of derivatives are differences, times half the degree.
    """
    dimension = net.space.shape.dimension
    lengths = np.linalg.norm(jacobians, axis=1).prod(axis=1)
    skewed = lengths / np.abs(np.linalg.det(jacobians))
    inverse: Floats = np.asarray(np.linalg.inv(jacobians), np.float64)
    plain, top = net.coefficients.T, max(net.space.degrees)
    derivatives = [differentiate(net.space, plain, direction) for direction in range(dimension)]
    steepest = np.max([np.abs(derivative).max(axis=1, initial=0.0) for _, derivative in derivatives], axis=0)

    # J^-T g of a Jacobian that is off by E is off by J^-T E^T J^-T g
    sums = np.abs(inverse).sum(axis=(1, 2))
    off = sums * sums * bent * steepest
    total = None
    for direction, (space, derivative) in enumerate(derivatives):
        error = top * net.error + (3 + 16 * skewed) * UNIT * np.abs(derivative).max(axis=1, initial=0.0)
        part = Net(space, np.ascontiguousarray(derivative.T), error).times(inverse[:, direction, axis])
        total = part if total is None else _sum(total, part)
    assert total is not None
    return Net(total.space, total.coefficients, total.error + off)
