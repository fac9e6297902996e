"""Expressions that are polynomials, expanded: against their values point by point, and within their own errors."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.mapping.patch import patches
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values
from elvis.core.polynomials.rounding import UNIT
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, one_element, ripple, scattered
from elvis.plugins.native import NativeVolume
from elvis.plugins.native.polynomials import Leaves, Net, expanded, is_affine

PLAIN = ("u*v - 2*x", "(u - 0.5)^3 + v/4", "1 - u*u*u", "y*u + 3", "u - x*v + element")
SLOPED = ("d(u, x)", "u*d(v, x) - d(u, y)^2", "d(d(u, y), x) + d(d(v, y), y)*x")
SOLID = ("q_criterion", "d(u, x) + d(v, y) + d(w, z)", "d(d(u, z), z)")


def data(shape, seed=3, mesh=None):
    """One element, moved by an affine map, with fields of random coefficients and several orders."""
    rng = np.random.default_rng(seed)
    mesh = mesh or one_element(shape)
    matrix = np.eye(3)
    d = shape.dimension
    matrix[:d, :d] += 0.3 * rng.normal(size=(d, d))
    mesh = replace(mesh, vertices=mesh.vertices @ matrix.T)
    dataset, fields = Dataset(mesh), []
    for name, modes in zip("uvw"[: max(2, d)], (4, 3, 5), strict=False):
        field = approximated(dataset, name, lambda p: p[:, 0], modes)
        blocks = [replace(b, coefficients=rng.normal(size=b.coefficients.shape)) for b in field.blocks]
        fields.append(replace(field, blocks=tuple(blocks)))
    return replace(dataset, fields=tuple(fields))


def net_of(dataset, text):
    """The expression, its net on the only patch, and the patch."""
    names = tuple(field.name for field in dataset.fields)
    (patch,) = patches(dataset, names)
    expression = Expression.of(dataset, text)
    leaves = Leaves(patch, np.arange(len(patch)), names, Attributes(dataset))
    return expression, expanded(expression.root, leaves.net), patch


def texts(shape):
    sloped = SLOPED if shape is not Shape.PYRAMID else ()
    return PLAIN + sloped + (SOLID if shape.dimension == 3 and sloped else ())


CASES = [(shape, text) for shape in Shape if shape is not Shape.SEGMENT for text in texts(shape)]


@pytest.mark.sampled
@pytest.mark.parametrize(("shape", "text"), CASES)
def test_nets_are_the_expressions(shape, text):
    dataset = data(shape)
    expression, net, patch = net_of(dataset, text)
    points = scattered(shape, 200)
    if shape is Shape.PYRAMID:
        points = points[points[:, 2] < 0.9]
    truth = Evaluator(dataset, [expression]).at(expression, patch.element_ids[np.zeros(len(points), int)], points)
    values = bernstein_values(net.space, points) @ net.coefficients[:, 0]
    np.testing.assert_allclose(values, truth, rtol=0, atol=1e-12 * np.abs(truth).max())
    assert net.error[0] < 1e-11 * net.size[0]


@pytest.mark.parametrize(
    "text", ["sin(u)", "u/v", "sqrt(u)", "u^0.5", "abs(u)", "min(u, v)", "jacobian*u", "1/u", "2^u"]
)
def test_other_expressions_have_no_polynomial(text):
    assert net_of(data(Shape.HEXAHEDRON), text)[1] is None


def test_derivatives_on_curved_elements_and_pyramids_are_not_polynomials():
    bent = data(Shape.HEXAHEDRON, mesh=curved(one_element(Shape.HEXAHEDRON), ripple(0.1), 3))
    assert net_of(bent, "d(u, x)")[1] is None
    assert net_of(bent, "u*v")[1] is not None
    assert net_of(data(Shape.PYRAMID), "d(u, x)")[1] is None


def exact(space, plain, point):
    """The value of a polynomial on a quadrilateral at a point of rational coordinates."""
    total = Fraction(0)
    for (i, j), coefficient in zip(space.powers.tolist(), plain, strict=True):
        value = Fraction(float(coefficient))
        for power, degree, x in ((i, space.degrees[0], point[0]), (j, space.degrees[1], point[1])):
            value *= binomial(degree, power) * x**power * (1 - x) ** (degree - power)
        total += value
    return total


def binomial(n, k):
    return Fraction(int(np.prod([*range(n - k + 1, n + 1)] or [1])), int(np.prod([*range(1, k + 1)] or [1])))


@pytest.mark.parametrize("seed", range(5))
def test_errors_are_valid_under_cancellation(seed):
    """(u + 2^20)^2 - u^2 - 2^21 u is 2^40, computed from coefficients that are exact; the error says what is lost."""
    rng = np.random.default_rng(seed)
    space = BernsteinSpace(Shape.QUADRILATERAL, (3, 2))
    plain = rng.normal(size=(1, space.count))
    u = Net(space, plain.T, np.zeros(1))
    u = replace(u, error=4 * UNIT * u.size)
    big = 2.0**20

    square = expanded(Expression.parse("(a + 1048576)^2 - a^2 - 2097152*a", Names(("a",))).root, lambda leaf: u)
    for point in ((Fraction(1, 3), Fraction(1, 7)), (Fraction(0), Fraction(1)), (Fraction(2, 5), Fraction(5, 9))):
        found = exact(square.space, square.coefficients[:, 0], point)
        away = abs(found - Fraction(big) ** 2)
        assert away <= Fraction(float(square.error[0]))
    assert 0 < square.error[0] < 1e-14 * big**2


def test_parallelepipeds_are_separate_parts_for_derivatives():
    mesh = grid(Shape.HEXAHEDRON, 2)
    vertices = mesh.vertices.copy()
    vertices[np.abs(vertices - 1).max(axis=1) < 1e-9] += 0.1
    dataset = data(Shape.HEXAHEDRON, mesh=replace(mesh, vertices=vertices))
    (patch,) = patches(dataset, ("u",))
    assert is_affine(patch, np.arange(8)).sum() == 7
    assert [len(part) for part in NativeVolume.of(dataset, ["u", "d(u, x)"]).parts] == [7, 1]
    assert [part.quantities["d(u, x)"].degree > 0 for part in NativeVolume.of(dataset, ["u", "d(u, x)"]).parts] == [
        True,
        False,
    ]
    assert [len(part) for part in NativeVolume.of(dataset, ["u", "u*u"]).parts] == [8]
