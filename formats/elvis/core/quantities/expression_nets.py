"""Expressions that are polynomials on elements: their degrees, and Bernstein nets from their values."""

from __future__ import annotations

import operator
from dataclasses import dataclass
from functools import reduce

import numpy as np

from elvis.core.base.arrays import EPS, Floats, Ints, grid_points
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import bernstein_coefficients, bernstein_space, line_tables
from elvis.core.polynomials.boxnets import box_degrees, box_nets, nets_through, product, total
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities.elements.points import Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import Node, fold, whole_exponent

#: values at once
_BATCH = 1 << 20
#: rounding of a number, and of nets of fields relative to their coefficients and to it
_BASIS = 32


def degree_on(expression: Expression, evaluator: Evaluator, patch: Patch, is_affine: bool) -> int | None:
    """The degree of an expression in any direction of the collapsed coordinates of elements.

    None if it is not a polynomial.

    is_affine  whether the elements' maps are affine, so that derivatives are polynomials
    """

    def leaf(node: Node) -> int | None:
        if node.op == "attribute" or (node.axes and node.op == "field" and not is_affine):
            return None
        own = patch.geometry if node.op == "coordinate" else patch.fields[evaluator.names.index(node.name)]
        return None if own is None else max(box_degrees(bernstein_space(own)))

    return expression.degree(leaf)


def places_of(degree: int) -> Floats:
    """(degree + 1,) points in [0, 1] whose values determine polynomials of a degree."""
    return np.asarray((1 + gauss(degree + 1)[0]) / 2)


def lattice_of(places: Floats, dimension: int) -> Floats:
    """(n^dimension, dimension) points of the unit cube with places (n,) each way; the last direction runs fastest."""
    return grid_points(*[places] * dimension)


@dataclass(frozen=True, eq=False)
class NetsOf:
    """Nets of an expression on parts of a patch's elements, moved by ``away`` (elements,).

    places  (n,) in [0, 1], at whose lattice it is evaluated
    power   of |det J|, relative to its maximum at the lattice, by which it is multiplied (see `cleared_on`)
    """

    expression: Expression
    evaluator: Evaluator
    patch: Patch
    places: Floats
    away: Floats | None = None
    power: int = 0

    def on(self, rows: Ints, reference: Floats) -> Floats:
        """(m, n, …, n) nets on parts of elements (m,) from reference points (n^k, d) at the lattice of places."""
        count = len(self.places)
        k = round(np.log(len(reference)) / np.log(count))
        parts = [np.empty((0, *(count,) * k))]
        for part in chunks(len(rows), max(1, _BATCH // len(reference))):
            lattice = Lattice(self.patch, rows[part], reference)
            (values,) = self.evaluator.values_at([self.expression], lattice)
            found = np.broadcast_to(values, len(lattice))
            if self.away is not None:
                found = found + np.repeat(self.away[rows[part]], len(reference))
            if self.power:
                found = found * _relative_volumes(lattice, len(reference)) ** self.power
            parts.append(nets_through(found, self.places, k))
        return np.concatenate(parts)


def _relative_volumes(lattice: Lattice, count: int) -> Floats:
    """(e count,) |det J| at the points of elements (e,), relative to the maximum in each."""
    d = lattice.patch.shape.dimension
    sizes = np.abs(np.linalg.det(lattice.jacobians[:, :d, :d])).reshape(-1, count)
    largest = sizes.max(axis=1, keepdims=True)
    return np.asarray(sizes / np.where(largest > 0, largest, 1.0)).reshape(-1)


@dataclass(frozen=True, eq=False)
class Rounded:
    """Nets (n, D1, …, Dd) of a polynomial on elements, and by how much (n,) rounding may have moved it there.

    A single net applies to all elements.
    """

    nets: Floats
    slack: Floats

    @property
    def size(self) -> Floats:
        """(n,) of the coefficients, at most."""
        return np.asarray(np.abs(self.nets).max(axis=tuple(range(1, self.nets.ndim)), initial=0.0))

    def __add__(self, other: Rounded) -> Rounded:
        nets = total(self.nets, other.nets)
        return Rounded(nets, self.slack + other.slack + EPS * sum(nets.shape[1:]) * (self.size + other.size))

    def __mul__(self, other: Rounded) -> Rounded:
        # sums with one term per coefficient of the first factor, with weights that add up to 1
        terms = self.nets[0].size + sum(self.nets.shape[1:]) + sum(other.nets.shape[1:])
        own = EPS * terms * self.size * other.size
        slack = own + self.size * other.slack + other.size * self.slack + self.slack * other.slack
        return Rounded(product(self.nets, other.nets), slack)


def rounded_nets(expression: Expression, evaluator: Evaluator, patch: Patch, rows: Ints) -> Rounded:
    """The nets of an expression, a polynomial on elements (n,) of a patch, by adding and multiplying nets of fields.

    The result on an element doesn't depend on other elements.
    """
    d = patch.shape.dimension

    def constant(value: float) -> Rounded:
        return Rounded(np.full((1, *(1,) * d), value), np.zeros(1))

    def leaf(node: Node) -> Rounded:
        if node.op == "number":
            return constant(node.value)
        field = None if node.op == "coordinate" else evaluator.names.index(node.name)
        expansion = patch.geometry if field is None else patch.fields[field]
        every = patch.geometry_coefficients[:, node.axes[0]] if field is None else patch.coefficients[field]
        assert expansion is not None
        assert every is not None
        own = every[rows]
        space = bernstein_space(expansion)
        if field is not None and node.axes:
            return _through(Expression(expression.text, node), evaluator, patch, rows, max(box_degrees(space)))
        nets = box_nets(space, bernstein_coefficients(expansion, own))
        return Rounded(nets, _BASIS * EPS * np.abs(own).max(axis=1, initial=0.0))

    def inner(node: Node, parts: list[Rounded]) -> Rounded:
        first, last = parts[0], parts[-1]
        exponent = whole_exponent(node)
        if exponent is not None:
            return reduce(operator.mul, [first] * exponent, constant(1.0))
        if node.op == "/":
            return first * constant(1 / node.operands[1].value)
        if node.op == "-":
            last = Rounded(-last.nets, last.slack)
        return first * last if node.op == "*" else first + last

    found = fold(expression.root, leaf, inner)
    count = len(rows)
    nets = np.broadcast_to(found.nets, (count, *found.nets.shape[1:]))
    return Rounded(nets, np.broadcast_to(found.slack, count))


def _through(expression: Expression, evaluator: Evaluator, patch: Patch, rows: Ints, degree: int) -> Rounded:
    """The nets of a polynomial from its values, whose rounding a matrix enlarges in each direction."""
    places = places_of(degree)
    reference = uncollapse(patch.shape, 2 * lattice_of(places, patch.shape.dimension) - 1)
    found = Rounded(NetsOf(expression, evaluator, patch, places).on(rows, reference), np.zeros(len(rows)))
    inverse = np.linalg.inv(line_tables(degree, places)[0])
    growth = float(np.abs(inverse).sum(axis=1).max()) ** patch.shape.dimension
    return Rounded(found.nets, _BASIS * EPS * found.size * growth)
