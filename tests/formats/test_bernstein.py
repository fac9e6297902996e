"""Bernstein form: the same functions, bounds, elevation and derivatives, on every shape, family and order."""

import itertools
from fractions import Fraction
from math import comb, factorial

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.data.dataset import Expansion, Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.bernstein import (
    BernsteinSpace,
    bernstein_coefficients,
    bernstein_space,
    bernstein_values,
    bounds,
    difference,
    differentiate,
    gradient_nets,
    to_bernstein,
)
from elvis.core.polynomials.collapse import collapse, uncollapse
from elvis.core.polynomials.expansion import FAMILIES, mode_count, values, values_and_gradients
from elvis.core.polynomials.factors import JacobiFactors, ortho_a
from elvis.core.polynomials.forms import elevations
from elvis.core.polynomials.jacobi import jacobi
from elvis.core.shapes import Shape

FOURIER = (Basis.FOURIER, Basis.FOURIER_SINGLE_MODE, Basis.FOURIER_HALF_MODE_RE, Basis.FOURIER_HALF_MODE_IM)
LINE = [basis for basis in FAMILIES[Shape.SEGMENT][0][0] if basis not in FOURIER]
TENSOR = (Shape.SEGMENT, Shape.QUADRILATERAL, Shape.HEXAHEDRON)
SPACES = {
    Shape.SEGMENT: [(0,), (1,), (7,)],
    Shape.QUADRILATERAL: [(0, 0), (3, 5), (6, 1)],
    Shape.HEXAHEDRON: [(0, 0, 0), (1, 2, 3), (4, 0, 2)],
    Shape.TRIANGLE: [(0,), (1,), (6,)],
    Shape.TETRAHEDRON: [(0,), (1,), (5,)],
    Shape.PRISM: [(0, 0), (1, 3), (5, 2)],
    Shape.PYRAMID: [(0, 0, 0), (1, 1, 1), (2, 3, 4)],
}
ALL_SPACES = [BernsteinSpace(shape, degrees) for shape in Shape for degrees in SPACES[shape]]


def bases_of(shape):
    """Every polynomial family; on tensor shapes one basis in all directions, and one mixture."""
    for family in FAMILIES[shape]:
        if shape in TENSOR:
            yield from ((basis,) * shape.dimension for basis in LINE)
            yield tuple(LINE[i] for i in range(shape.dimension))
        else:
            yield from itertools.product(*([b for b in some if b not in FOURIER] for some in family))


CASES = [
    Expansion(shape, bases, (n,) * shape.dimension) for shape in Shape for bases in bases_of(shape) for n in (2, 3, 6)
]
VARIABLE = [
    Expansion(Shape.QUADRILATERAL, (Basis.MODIFIED_A,) * 2, (2, 5)),
    Expansion(Shape.HEXAHEDRON, (Basis.MODIFIED_A,) * 3, (4, 2, 3)),
    Expansion(Shape.TRIANGLE, (Basis.MODIFIED_A, Basis.MODIFIED_B), (2, 6)),
    Expansion(Shape.TETRAHEDRON, (Basis.MODIFIED_A, Basis.MODIFIED_B, Basis.MODIFIED_C), (2, 3, 5)),
    Expansion(Shape.TETRAHEDRON, (Basis.MODIFIED_A, Basis.MODIFIED_B, Basis.MODIFIED_C), (1, 1, 1)),
    Expansion(Shape.PRISM, (Basis.MODIFIED_A, Basis.MODIFIED_A, Basis.MODIFIED_B), (2, 5, 4)),
    Expansion(Shape.PYRAMID, (Basis.MODIFIED_A, Basis.MODIFIED_A, Basis.MODIFIED_PYR_C), (2, 4, 5)),
    Expansion(Shape.PYRAMID, (Basis.ORTHO_A, Basis.ORTHO_A, Basis.ORTHO_PYR_C), (4, 2, 4)),
]


def inside(shape, count=40, seed=0):
    return uncollapse(shape, np.random.default_rng(seed).uniform(-1, 1, (count, shape.dimension)))


def name(case):
    if isinstance(case, BernsteinSpace):
        return f"{case.shape.label} {case.degrees}"
    return f"{case.shape.label} {'x'.join(map(str, case.modes))} {'-'.join(basis.label for basis in case.bases)}"


def test_every_shape_and_polynomial_basis_is_listed():
    assert {case.shape for case in CASES} == {space.shape for space in ALL_SPACES} == set(Shape)
    assert {basis for case in CASES for basis in case.bases} == set(Basis) - {Basis.NONE, *FOURIER}


# --- the spaces ---


def function(space, powers, point):
    """One function of the space, from its definition, in plain arithmetic."""

    def line(p, i, t):
        return comb(p, i) * t**i * (1 - t) ** (p - i)

    def simplex(p, exponents, t):
        rest = p - sum(exponents)
        result = factorial(p) / factorial(rest) * (1 - sum(t)) ** rest
        for i, s in zip(exponents, t, strict=True):
            result *= s**i / factorial(i)
        return result

    if space.shape in (Shape.TRIANGLE, Shape.TETRAHEDRON):
        return simplex(space.degrees[0], powers, [(1 + x) / 2 for x in point])
    if space.shape is Shape.PRISM:
        i, j, k = powers
        t = [(1 + x) / 2 for x in point]
        return simplex(space.degrees[0], (i, k), (t[0], t[2])) * line(space.degrees[1], j, t[1])
    eta = collapse(space.shape, np.array([point]))[0] if space.shape is Shape.PYRAMID else point
    return np.prod([line(p, i, (1 + x) / 2) for p, i, x in zip(space.degrees, powers, eta, strict=True)])


def ordered(space):
    """Powers (i, j, k) in coefficient order, by plain loops."""
    n = [range(p + 1) for p in space.degrees]
    if space.shape is Shape.SEGMENT:
        return [(i,) for i in n[0]]
    if space.shape is Shape.QUADRILATERAL:
        return [(i, j) for j in n[1] for i in n[0]]
    if space.shape in (Shape.HEXAHEDRON, Shape.PYRAMID):
        return [(i, j, k) for k in n[2] for j in n[1] for i in n[0]]
    p = space.degrees[0]
    if space.shape is Shape.TRIANGLE:
        return [(i, j) for j in range(p + 1) for i in range(p + 1 - j)]
    if space.shape is Shape.PRISM:
        return [(i, j, k) for j in n[1] for k in range(p + 1) for i in range(p + 1 - k)]
    return [(i, j, k) for k in range(p + 1) for j in range(p + 1 - k) for i in range(p + 1 - k - j)]


@pytest.mark.parametrize("space", ALL_SPACES, ids=name)
def test_functions_and_their_order_follow_the_definition(space):
    assert [tuple(row) for row in space.powers.tolist()] == ordered(space)
    assert space.count == len(ordered(space))
    points = inside(space.shape, 5)
    expected = [[function(space, powers, point) for powers in ordered(space)] for point in points.tolist()]
    assert np.abs(bernstein_values(space, points) - np.array(expected)).max() < 1e-14


@pytest.mark.parametrize("space", ALL_SPACES, ids=name)
def test_functions_are_non_negative_and_sum_to_one(space):
    table = bernstein_values(space, inside(space.shape, 100))
    assert (table >= -1e-15).all()
    assert np.abs(table.sum(axis=1) - 1).max() < 1e-14


def test_wrong_degrees_are_rejected():
    with pytest.raises(ElvisError, match="expected 1 degrees of a Triangle space"):
        BernsteinSpace(Shape.TRIANGLE, (2, 2))


# --- conversion ---


@pytest.mark.parametrize("expansion", [*CASES, *VARIABLE], ids=name)
def test_conversion_preserves_every_function(expansion):
    space, matrix, points = bernstein_space(expansion), to_bernstein(expansion), inside(expansion.shape)
    assert matrix.shape == (mode_count(expansion), space.count)
    converted, direct = bernstein_values(space, points) @ matrix.T, values(expansion, points)
    scale = np.abs(matrix).max(axis=1)
    assert (np.abs(converted - direct) <= 1e-13 * scale).all()


@pytest.mark.parametrize("expansion", [*CASES[::3], *VARIABLE], ids=name)
def test_conversion_to_larger_spaces_preserves_every_function(expansion):
    least, points = bernstein_space(expansion), inside(expansion.shape)
    space = BernsteinSpace(expansion.shape, tuple(degree + 1 + i for i, degree in enumerate(least.degrees)))
    matrix = to_bernstein(expansion, space)
    converted, direct = bernstein_values(space, points) @ matrix.T, values(expansion, points)
    assert (np.abs(converted - direct) <= 1e-13 * np.abs(to_bernstein(expansion)).max(axis=1)).all()


@pytest.mark.parametrize("expansion", [*CASES[::3], *VARIABLE], ids=name)
def test_coefficients_convert_as_by_the_matrix(expansion):
    coefficients = np.random.default_rng(4).normal(size=(3, 2, mode_count(expansion)))
    matrix = to_bernstein(expansion)
    found = bernstein_coefficients(expansion, coefficients)
    assert np.abs(found - coefficients @ matrix).max() <= 1e-14 * np.abs(matrix).sum(axis=0).max() * 4


@pytest.mark.parametrize("degree", [8, 20])
def test_degrees_match_those_of_the_expansion(degree):
    n = degree + 1
    modified = {
        Shape.TRIANGLE: (degree,),
        Shape.TETRAHEDRON: (degree,),
        Shape.PRISM: (degree, degree),
        Shape.PYRAMID: (degree, degree, 2 * degree - 2),
    }
    for shape in Shape:
        bases = next(bases_of(shape))
        expected = modified.get(shape, (degree,) * shape.dimension)
        assert bernstein_space(Expansion(shape, bases, (n,) * shape.dimension)).degrees == expected
    ortho = Expansion(Shape.PYRAMID, (Basis.ORTHO_A, Basis.ORTHO_A, Basis.ORTHO_PYR_C), (n, n, n))
    assert bernstein_space(ortho).degrees == (degree, degree, 2 * degree)


@pytest.mark.parametrize("shape", [Shape.SEGMENT, Shape.TRIANGLE, Shape.QUADRILATERAL, Shape.TETRAHEDRON])
def test_degree_twenty_converts(shape):
    for bases in bases_of(shape):
        if shape in TENSOR and bases[0] not in (Basis.MODIFIED_A, Basis.ORTHO_A):
            continue
        expansion = Expansion(shape, bases, (21,) * shape.dimension)
        matrix, points = to_bernstein(expansion), inside(shape, 20)
        error = np.abs(bernstein_values(bernstein_space(expansion), points) @ matrix.T - values(expansion, points))
        assert (error <= 2e-13 * np.abs(matrix).max(axis=1)).all()


@pytest.mark.parametrize("n", range(1, 22))
def test_legendre_coefficients_are_exact_to_rounding(n):
    expansion = Expansion(Shape.SEGMENT, (Basis.LEGENDRE,), (n,))
    for p, row in enumerate(to_bernstein(expansion, BernsteinSpace(Shape.SEGMENT, (max(n - 1, 0),)))):
        # P_p = sum_i (-1)^(p-i) C(p,i) b_i^p, elevated to degree n - 1
        e = n - 1 - p
        form = [Fraction((-1) ** (p - i) * comb(p, i)) for i in range(p + 1)]
        raised = [
            sum(form[a] * comb(p, a) * comb(e, i - a) for a in range(p + 1) if 0 <= i - a <= e) / comb(n - 1, i)
            for i in range(n)
        ]
        expected = np.sqrt(p + 0.5) * np.array([float(b) for b in raised])
        assert np.abs(row - expected).max() <= 4e-16 * np.abs(expected).max()


def test_elevation_starts_at_the_degree_of_each_factor():
    nets = elevations(JacobiFactors(ortho_a(np.arange(4))), 3)
    assert nets.shape == (4, 4, 4)
    for degree, factor in itertools.product(range(4), repeat=2):
        assert nets[degree, factor].any() == (degree >= factor)
        if degree >= factor:
            t = np.linspace(0, 1, 9)
            table = np.stack([comb(degree, i) * t**i * (1 - t) ** (degree - i) for i in range(degree + 1)], axis=1)
            expected = np.sqrt(factor + 0.5) * jacobi(3, 0, 0, 2 * t - 1)[factor]
            assert np.abs(table @ nets[degree, factor, : degree + 1] - expected).max() < 1e-14


def test_nonpolynomial_bases_are_rejected():
    with pytest.raises(FormatError, match="found Fourier"):
        bernstein_space(Expansion(Shape.SEGMENT, (Basis.FOURIER,), (4,)))
    planes = Homogeneous((Basis.FOURIER,), (1.0,), (0,))
    with pytest.raises(FormatError, match="homogeneous"):
        to_bernstein(Expansion(Shape.SEGMENT, (Basis.MODIFIED_A,), (4,), planes))


def test_a_space_that_is_too_small_is_rejected():
    with pytest.raises(ElvisError, match="that contains"):
        to_bernstein(Expansion(Shape.SEGMENT, (Basis.MODIFIED_A,), (4,)), BernsteinSpace(Shape.SEGMENT, (2,)))


# --- derivatives and bounds ---


@pytest.mark.parametrize("expansion", [*CASES, *VARIABLE], ids=name)
def test_gradients_equal_those_of_the_modes(expansion):
    """Also at vertices, where the chain rule of collapsed coordinates reads 0 / 0; pyramids away from the apex."""
    shape, space, matrix = expansion.shape, bernstein_space(expansion), to_bernstein(expansion)
    points = np.vstack([inside(shape), shape.vertices[:4]]) if shape is Shape.PYRAMID else inside(shape)
    points = points if shape is Shape.PYRAMID else np.vstack([points, shape.vertices, *midpoints(shape)])
    nets = [differentiate(space, matrix, i) for i in range(shape.dimension)]
    derivatives = np.stack([bernstein_values(lower, points) @ net.T for lower, net in nets], axis=1)
    if shape is Shape.PYRAMID:
        derivatives = from_collapsed(derivatives, collapse(shape, points))
    direct = values_and_gradients(expansion, points)[1]
    scale = np.max([np.abs(net).max(axis=1) for _, net in nets], axis=0)
    steep = 1 if shape is not Shape.PYRAMID else (2 / (1 - points[:, -1]))[:, None, None]
    assert (np.abs(derivatives - direct) <= 1e-13 * (1 + scale) * steep).all()


@pytest.mark.parametrize("expansion", [case for case in CASES if case.shape not in (*TENSOR, Shape.PYRAMID)], ids=name)
def test_nothing_jumps_near_collapsed_vertices(expansion):
    """At any distance from a vertex, down to rounding, values and gradients are those of the Bernstein form."""
    shape, space, matrix = expansion.shape, bernstein_space(expansion), to_bernstein(expansion)
    centre = shape.vertices.mean(axis=0)
    steps = 10.0 ** -np.arange(6, 17)[:, None, None]
    points = (shape.vertices + steps * (0.5 * inside(shape, 1) + 0.5 * centre - shape.vertices)).reshape(
        -1, shape.dimension
    )
    table, derivatives = values_and_gradients(expansion, points)
    assert (np.abs(table - bernstein_values(space, points) @ matrix.T) <= 1e-13 * np.abs(matrix).max(axis=1)).all()
    for i in range(shape.dimension):
        lower, net = differentiate(space, matrix, i)
        error = np.abs(derivatives[:, i] - bernstein_values(lower, points) @ net.T)
        assert (error <= 1e-13 * (1 + np.abs(net).max(axis=1))).all()


def midpoints(shape):
    return [shape.vertices[list(edge)].mean(axis=0) for edge in shape.edges]


def from_collapsed(derivatives, eta):
    """Derivatives in eta -> in xi, on a pyramid (format notes 2.2)."""
    e = eta[:, :, None]
    first, second = 2 / (1 - e[:, 2]) * derivatives[:, 0], 2 / (1 - e[:, 2]) * derivatives[:, 1]
    third = (1 + e[:, 0]) / 2 * first + (1 + e[:, 1]) / 2 * second + derivatives[:, 2]
    return np.stack([first, second, third], axis=1)


@pytest.mark.parametrize("space", ALL_SPACES, ids=name)
def test_gradient_nets_are_differences(space):
    coefficients = np.random.default_rng(1).normal(size=(2, space.count))
    for direction, (lower, matrix) in enumerate(gradient_nets(space)):
        found_space, found = differentiate(space, coefficients, direction)
        assert lower == found_space == difference(space, direction).space
        assert np.abs(found - coefficients @ matrix).max() < 1e-14


@pytest.mark.parametrize("expansion", [*CASES[::2], *VARIABLE], ids=name)
def test_bounds_contain_all_samples(expansion):
    coefficients = np.random.default_rng(7).normal(size=(20, mode_count(expansion)))
    net = bernstein_coefficients(expansion, coefficients)
    low, high = bounds(bernstein_space(expansion), net)
    samples = coefficients @ values(expansion, np.vstack([inside(expansion.shape, 300), expansion.shape.vertices])).T
    slack = 1e-13 * np.abs(net).max(axis=1)
    assert (samples.min(axis=1) >= low - slack).all()
    assert (samples.max(axis=1) <= high + slack).all()


def test_bounds_tighten_with_elevation():
    expansion = Expansion(Shape.TRIANGLE, (Basis.MODIFIED_A, Basis.MODIFIED_B), (5, 5))
    coefficients = np.random.default_rng(8).normal(size=(10, mode_count(expansion)))
    widths = []
    for degree in range(4, 12):
        space = BernsteinSpace(Shape.TRIANGLE, (degree,))
        low, high = bounds(space, bernstein_coefficients(expansion, coefficients, space))
        widths.append(high - low)
    assert (np.diff(widths, axis=0) <= 1e-12).all()


def test_coefficients_of_another_space_are_rejected():
    with pytest.raises(ElvisError, match="expected 3 Bernstein coefficients, found 4"):
        bounds(BernsteinSpace(Shape.TRIANGLE, (1,)), np.zeros(4))
