"""Polynomials in three variables with rational coefficients, and element data that hold them without any rounding."""

from fractions import Fraction
from functools import cache
from itertools import product
from math import log2

import numpy as np

from audit import basis
from elvis.core.data.dataset import Block
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape

#: modes each way, and what polynomials must be multiplied by to have dyadic Modified coefficients, on every shape
MULTIPLES = {2: 1, 3: 1, 4: 1, 5: 15, 6: 315, 8: 4729725}


class Polynomial:
    """A sum of monomials; ``terms`` maps exponents (i, j, k) to a Fraction."""

    def __init__(self, terms):
        self.terms = {key: Fraction(value) for key, value in terms.items() if value}

    def __add__(self, other):
        other, terms = _polynomial(other), dict(self.terms)
        for key, value in other.terms.items():
            terms[key] = terms.get(key, 0) + value
        return Polynomial(terms)

    def __mul__(self, other):
        terms = {}
        for (one, first), (two, second) in product(self.terms.items(), _polynomial(other).terms.items()):
            key = tuple(i + j for i, j in zip(one, two, strict=True))
            terms[key] = terms.get(key, 0) + first * second
        return Polynomial(terms)

    def __sub__(self, other):
        return self + _polynomial(other) * -1

    def __pow__(self, exponent):
        result = Polynomial({(0, 0, 0): 1})
        for _ in range(exponent):
            result = result * self
        return result

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other):
        return self * -1 + other

    @property
    def degree(self):
        return max((sum(key) for key in self.terms), default=0)

    def __call__(self, points):
        """(n,) values at points (n, 3) of doubles, extended doubles or fractions (an array of objects)."""
        points = np.asarray(points)
        number = Fraction if points.dtype == object else points.dtype.type
        powers = [np.ones_like(points)]
        for _ in range(max((max(key) for key in self.terms), default=0)):
            powers.append(powers[-1] * points)
        total = np.zeros(len(points), points.dtype)
        for (i, j, k), value in self.terms.items():
            part = _number(value, number) * np.ones(len(points), points.dtype)
            for axis, exponent in enumerate((i, j, k)):
                part = part * powers[exponent][:, axis] if exponent else part
            total = total + part
        return total

    def greatest_derivative(self):
        """A bound of the gradient's largest component over [-1, 1]^3."""
        return float(sum(abs(value) * sum(key) for key, value in self.terms.items()))

    def size(self):
        """A bound of the values over [-1, 1]^3."""
        return float(sum(abs(value) for value in self.terms.values()))


def _polynomial(other):
    return other if isinstance(other, Polynomial) else Polynomial({(0, 0, 0): other})


def _number(value, number):
    """A dyadic fraction in another arithmetic, exactly."""
    return value if number is Fraction else number(value.numerator) / number(value.denominator)


X, Y, Z = (Polynomial({tuple(int(i == j) for j in range(3)): 1}) for i in range(3))


@cache
def _fitting(shape, modes):
    """Points xi (n, d), values (n, m) of all modes there in extended precision, and a pseudo-inverse (m, n)."""
    expansion = modified(shape, (modes,) * shape.dimension)
    line = np.polynomial.legendre.leggauss(modes + 1)[0].astype(np.longdouble)
    eta = np.stack(np.meshgrid(*[line] * shape.dimension, indexing="ij")).reshape(shape.dimension, -1)
    table = basis.table(expansion, list(eta)).T
    return np.stack(basis.uncollapsed(shape, list(eta)), axis=1), table, np.linalg.pinv(table.astype(float))


def exact_block(straight, polynomial, modes):
    """The block of a polynomial of straight coordinates on elements, its coefficients without rounding.

    straight  a GeometryBlock of affine elements
    AssertionError where the coefficients are no doubles, or where fractions say that the block is something else.
    """
    shape = straight.expansion.shape
    xi, table, inverse = _fitting(shape, modes)
    corners = _affine(straight)
    points = corners[:, None, :, 0] + np.einsum("nic,pc->npi", corners[:, :, 1:], xi)
    wanted = polynomial(points.reshape(-1, 3)).reshape(points.shape[:2])
    coefficients = np.zeros((len(straight), table.shape[1]), np.longdouble)
    for _ in range(4):
        rest = wanted - coefficients @ table.T
        coefficients = coefficients + rest.astype(float) @ inverse.T

    # dyadic numbers of 50 bits below the largest coefficient
    bits = 50 - int(np.ceil(log2(float(np.abs(coefficients).max()) + 1e-300)))
    exact = np.ldexp(np.rint(np.ldexp(coefficients, bits)), -bits).astype(float)
    expansion = modified(shape, (modes,) * shape.dimension)
    for row in {0, len(straight) // 2, len(straight) - 1}:
        _verify(expansion, exact[row], corners[row], polynomial)
    return Block(expansion, straight.element_ids, exact)


def _affine(straight):
    """(n, 3, 1 + d) constant and linear parts of the maps of affine elements."""
    shape = straight.expansion.shape
    corners = np.zeros((shape.dimension + 1, shape.dimension), np.longdouble)
    corners[1:] = np.eye(shape.dimension)
    eta = [np.zeros(1, np.longdouble)] * shape.dimension
    centre = np.stack(basis.uncollapsed(shape, eta), axis=1)[0]
    ends = [np.full(1, -1.0, np.longdouble)] * shape.dimension
    first = straight.coefficients @ basis.table(straight.expansion, ends)[:, 0]
    middle = straight.coefficients @ basis.table(straight.expansion, eta)[:, 0]
    columns = []
    for axis in range(shape.dimension):
        # the vertex that differs from the first along one direction alone
        own = [np.full(1, 1.0 if i == axis else -1.0, np.longdouble) for i in range(shape.dimension)]
        columns.append((straight.coefficients @ basis.table(straight.expansion, own)[:, 0] - first) / 2)
    linear = np.stack(columns, axis=2)
    constant = first + linear.sum(axis=2)
    assert np.array_equal(constant + linear @ centre, middle), "the elements are not affine"
    return np.concatenate([constant[:, :, None], linear], axis=2)


def _verify(expansion, coefficients, corner, polynomial):
    """In fractions, at a point that no symmetry favours: the block is the polynomial."""
    eta = [Fraction(3, 7), Fraction(-5, 11), Fraction(2, 13)][: expansion.shape.dimension]
    modes = basis.table(expansion, eta)
    found = sum(Fraction(float(c)) * value for c, value in zip(coefficients, modes, strict=True))
    xi = basis.uncollapsed(expansion.shape, eta)
    point = [sum(Fraction(float(c)) * v for c, v in zip(row, [1, *xi], strict=True)) for row in corner]
    wanted = polynomial(np.array([point], dtype=object))[0]
    assert found == wanted, f"the coefficients are no doubles: off by {float(found - wanted):.3g}"


def multiple(modes, shapes=()):
    """What to multiply a polynomial by, to have coefficients without rounding."""
    if modes == 8 and Shape.PYRAMID not in shapes:
        return 51975
    return MULTIPLES[modes]
