"""Quadrature on every shape: what it integrates exactly, and how many points it has."""

import itertools

import numpy as np
import pytest

from elvis.core.base.errors import FormatError
from elvis.core.data.dataset import Expansion, ExpansionRule
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values
from elvis.core.polynomials.cubature import _LINE, cubature, field_cubature, rule_cubature
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape

VOLUMES = {
    Shape.SEGMENT: 2,
    Shape.TRIANGLE: 2,
    Shape.QUADRILATERAL: 4,
    Shape.TETRAHEDRON: 4 / 3,
    Shape.PYRAMID: 8 / 3,
    Shape.PRISM: 4,
    Shape.HEXAHEDRON: 8,
}
#: points in each direction for n modes: of a field that was read, and of MODIFIED in EXPANSIONS (format notes 3, 7)
READ = {
    Shape.SEGMENT: lambda n: (n + 1,),
    Shape.TRIANGLE: lambda n: (n + 1, n),
    Shape.QUADRILATERAL: lambda n: (n + 1, n + 1),
    Shape.TETRAHEDRON: lambda n: (n + 1, n, n),
    Shape.PYRAMID: lambda n: (n + 1, n + 1, n),
    Shape.PRISM: lambda n: (n + 1, n + 1, n),
    Shape.HEXAHEDRON: lambda n: (n, n, n),
}
DECLARED = READ | {Shape.PYRAMID: lambda n: (n + 1,) * 3, Shape.HEXAHEDRON: lambda n: (n + 1,) * 3}


def test_every_shape_is_listed():
    assert set(VOLUMES) == set(READ) == set(Shape)


@pytest.mark.parametrize("shape", Shape)
@pytest.mark.parametrize("n", [2, 3, 5, 9])
def test_rules_have_the_points_of_the_solver_and_the_volume(shape, n):
    rules = [
        (field_cubature(modified(shape, (n,) * shape.dimension)), READ[shape](n)),
        (rule_cubature(shape, ExpansionRule((0,), "MODIFIED", (n,))), DECLARED[shape](n)),
    ]
    for rule, counts in rules:
        assert rule.points.shape == (np.prod(counts), shape.dimension)
        assert rule.weights.sum() == pytest.approx(VOLUMES[shape], rel=1e-13)
        assert (rule.weights > 0).all()


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape is not Shape.PYRAMID])
@pytest.mark.parametrize("n", [3, 5])
def test_bernstein_functions_integrate_to_equal_parts(shape, n):
    """All functions of one space have the same integral; on the pyramid, which is not a product, see the next test."""
    rule = field_cubature(modified(shape, (n,) * shape.dimension))
    degree = 2 * n - 3
    directions = {Shape.TRIANGLE: 1, Shape.TETRAHEDRON: 1, Shape.PRISM: 2}.get(shape, shape.dimension)
    space = BernsteinSpace(shape, (degree,) * directions)
    integrals = rule.weights @ bernstein_values(space, rule.points)
    assert integrals == pytest.approx(np.full(space.count, VOLUMES[shape] / space.count), rel=1e-12)


@pytest.mark.parametrize("exponents", list(itertools.product(range(4), repeat=3)))
def test_monomials_on_the_pyramid(exponents):
    """Integral of (1+xi1)^a (1+xi2)^b (1-xi3)^c over the pyramid, in closed form."""
    a, b, c = exponents
    rule = field_cubature(modified(Shape.PYRAMID, (7, 7, 7)))
    x, y, z = rule.points.T
    found = rule.weights @ ((1 + x) ** a * (1 + y) ** b * (1 - z) ** c)
    # with s = 1 - xi3 the section is the square [0, s]^2
    expected = 2 ** (a + b + c + 3) / ((a + 1) * (b + 1) * (a + b + c + 3))
    assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("shape", Shape)
@pytest.mark.parametrize("families", ["GaussGaussLegendre", "GaussLobattoLegendre", "GaussRadauMLegendre"])
def test_rules_without_the_weight_of_the_collapse_take_it_in(shape, families):
    rule = cubature(shape, (families,) * shape.dimension, (6,) * shape.dimension)
    assert rule.weights.sum() == pytest.approx(VOLUMES[shape], rel=1e-13)


@pytest.mark.parametrize(
    ("kind", "shape", "count"),
    [
        ("MODIFIEDQUADPLUS1", Shape.TETRAHEDRON, 6 * 5 * 5),
        ("MODIFIEDQUADPLUS2", Shape.HEXAHEDRON, 7**3),
        ("MODIFIEDGLLRADAU10", Shape.TETRAHEDRON, 5 * 4 * 4),
        ("GLL_LAGRANGE", Shape.QUADRILATERAL, 5**2),
        ("GLL_LAGRANGE_SEM", Shape.HEXAHEDRON, 4**3),
        ("GAUSS_LAGRANGE", Shape.HEXAHEDRON, 4**3),
        ("FOURIER", Shape.SEGMENT, 4),
    ],
)
def test_kinds_of_expansions(kind, shape, count):
    rule = rule_cubature(shape, ExpansionRule((0,), kind, (4,)))
    assert len(rule.weights) == count
    assert rule.weights.sum() == pytest.approx(VOLUMES[shape], rel=1e-13)


def test_explicit_points_are_taken():
    rule = ExpansionRule(
        (0,), "Modified_A,Modified_B", (3, 5), (), (4, 7), ("GaussLobattoLegendre", "GaussGaussLegendre")
    )
    assert len(rule_cubature(Shape.TRIANGLE, rule).weights) == 28
    strange = ExpansionRule((0,), "Modified_A", (3,), (), (4,), ("BoundaryLayerPoints",))
    with pytest.raises(FormatError, match="found BoundaryLayerPoints"):
        rule_cubature(Shape.SEGMENT, strange)
    with pytest.raises(FormatError, match="expected 2 point types"):
        rule_cubature(Shape.TRIANGLE, strange)


def test_fourier_directions_are_evenly_spaced():
    rule = field_cubature(Expansion(Shape.QUADRILATERAL, (Basis.FOURIER, Basis.MODIFIED_A), (6, 3)))
    assert len(np.unique(rule.points[:, 0])) == 6
    assert rule.points[:, 0].max() < 1
    assert rule.weights.sum() == pytest.approx(4, rel=1e-14)
    # a period of waves sums to nothing, but for the constant
    points, weights = _LINE["FourierEvenlySpaced"][1](6)
    waves = np.exp(1j * np.pi * np.arange(6)[:, None] * points)
    assert waves @ weights == pytest.approx(np.array([2, 0, 0, 0, 0, 0]), abs=1e-14)


@pytest.mark.parametrize("counts", [(4_001,) * 3, (10**6, 2, 2), (200, 200, 200)])
def test_a_rule_has_a_maximum_number_of_points(counts):
    with pytest.raises(FormatError, match="expected at most 4194304 quadrature points in an element, found"):
        cubature(Shape.HEXAHEDRON, ("GaussLobattoLegendre",) * 3, counts)
