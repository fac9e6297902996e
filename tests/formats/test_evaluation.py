"""Evaluation in batches is plain summation over modes."""

import numpy as np
import pytest

from elvis.core.data.dataset import Expansion
from elvis.core.polynomials import curvature, evaluation, tensor_points
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.expansion import mode_count, values, values_and_gradients
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape

EXPANSIONS = [
    Expansion(Shape.TRIANGLE, (Basis.MODIFIED_A, Basis.MODIFIED_B), (3, 5)),
    Expansion(Shape.HEXAHEDRON, (Basis.GLL_LAGRANGE,) * 3, (3, 2, 4)),
    Expansion(Shape.QUADRILATERAL, (Basis.MODIFIED_A,) * 2, (5, 5)),
]


@pytest.fixture(params=EXPANSIONS, ids=lambda e: e.shape.label)
def case(request, monkeypatch):
    """An expansion, coefficients of 5 elements with 3 components, 40 points and their elements; small batches."""
    monkeypatch.setattr(evaluation, "_BATCH", 1000)
    monkeypatch.setattr(tensor_points, "_NUMBERS", 300)
    monkeypatch.setattr(tensor_points, "_TABULATED", 17)
    random = np.random.default_rng(0)
    expansion = request.param
    points = random.uniform(-1, 0, (40, expansion.shape.dimension))
    return expansion, random.normal(size=(5, 3, mode_count(expansion))), points, random.integers(0, 5, 40)


def test_many_elements_at_the_same_points(case):
    expansion, coefficients, points, _ = case
    table, derivatives = values_and_gradients(expansion, points)
    expected = np.einsum("ecm,nm->ecn", coefficients, table)
    assert np.allclose(evaluation.evaluate(expansion, coefficients, points), expected, rtol=0, atol=1e-13)
    found, gradients = evaluation.evaluate_with_gradients(expansion, coefficients, points)
    assert np.allclose(found, expected, rtol=0, atol=1e-13)
    assert np.allclose(gradients, np.einsum("ecm,ndm->ecnd", coefficients, derivatives), rtol=0, atol=1e-12)


@pytest.mark.parametrize("elements", [5, 2])
def test_an_element_for_each_point(case, elements):
    expansion, coefficients, points, rows = case
    rows = rows % elements
    table, derivatives = values_and_gradients(expansion, points)
    expected = np.einsum("ncm,nm->nc", coefficients[rows], table)
    assert np.allclose(evaluation.evaluate_at(expansion, coefficients, rows, points), expected, rtol=0, atol=1e-13)
    found, gradients = evaluation.evaluate_at_with_gradients(expansion, coefficients, rows, points)
    assert np.allclose(found, expected, rtol=0, atol=1e-13)
    assert np.allclose(gradients, np.einsum("ncm,ndm->ncd", coefficients[rows], derivatives), rtol=0, atol=1e-12)


def test_scalar_fields_have_no_component_axis(case):
    expansion, coefficients, points, rows = case
    field = coefficients[:, 0]
    assert evaluation.evaluate(expansion, field, points).shape == (5, 40)
    found = evaluation.evaluate_at(expansion, field, rows, points)
    assert np.allclose(found, (field[rows] * values(expansion, points)).sum(axis=1), rtol=0, atol=1e-13)
    assert evaluation.evaluate_at_with_gradients(expansion, field, rows, points)[1].shape == points.shape


def test_no_points_give_no_values(case):
    expansion, coefficients, points, rows = case
    assert evaluation.evaluate(expansion, coefficients, points[:0]).shape == (5, 3, 0)
    assert evaluation.evaluate_at(expansion, coefficients, rows[:0], points[:0]).shape == (0, 3)


TENSOR = [
    Expansion(Shape.SEGMENT, (Basis.MODIFIED_A,), (5,)),
    Expansion(Shape.QUADRILATERAL, (Basis.MODIFIED_A, Basis.GLL_LAGRANGE), (5, 3)),
    Expansion(Shape.HEXAHEDRON, (Basis.GLL_LAGRANGE, Basis.MODIFIED_A, Basis.ORTHO_A), (3, 5, 4)),
]


@pytest.mark.parametrize("expansion", TENSOR, ids=lambda e: e.shape.label)
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0), (2, 1, 0)])
@pytest.mark.parametrize("counts", [(4, 2, 3), (5, 3, 1)])
def test_lattices_are_evaluated_by_factors(monkeypatch, expansion, order, counts):
    """Whichever direction runs fastest; a lattice with one point gone, or moved, is none."""
    dimension = expansion.shape.dimension
    order = [direction for direction in order if direction < dimension]
    random = np.random.default_rng(3)
    lines = [random.uniform(-1, 1, count) for count in counts[:dimension]]
    points = np.empty((int(np.prod(counts[:dimension])), dimension))
    for direction, line in zip(order, np.meshgrid(*lines, indexing="ij"), strict=True):
        points[:, direction] = line.reshape(-1)
    coefficients = random.normal(size=(3, 2, mode_count(expansion)))
    moved = points.copy()
    moved[-1, -1] += 1e-9
    assert evaluation.lattice_lines(expansion, moved) is None or dimension == 1
    if dimension > 1:
        assert evaluation.lattice_lines(expansion, points[:-1]) is None

    assert evaluation.lattice_lines(expansion, points) is not None
    found = evaluation.evaluate_with_gradients(expansion, coefficients, points)
    plain = evaluation.evaluate(expansion, coefficients, points)
    monkeypatch.setattr(evaluation, "lattice_lines", lambda *args: None)
    expected = evaluation.evaluate_with_gradients(expansion, coefficients, points)
    assert np.allclose(plain, expected[0], rtol=0, atol=1e-13)
    for own, known in zip(found, expected, strict=True):
        assert np.allclose(own, known, rtol=0, atol=1e-12)


@pytest.mark.parametrize("shape", list(Shape))
def test_second_derivatives_match_differences_of_gradients(shape, monkeypatch):
    """On pyramids, too, where the coordinates of the polynomials depend on those of the points."""
    monkeypatch.setattr(curvature, "_BATCH", 100)
    random, d, step = np.random.default_rng(1), shape.dimension, 1e-5
    expansion = modified(shape, (4,) * d)
    points, rows = random.uniform(-0.9, -0.5, (12, d)), random.integers(0, 3, 12)
    coefficients = random.normal(size=(3, 2, mode_count(expansion)))
    found = curvature.hessians_at(expansion, coefficients, rows, points)
    for axis in range(d):
        ends = [points + sign * step * np.eye(d)[axis] for sign in (-1, 1)]
        slopes = [evaluation.evaluate_at_with_gradients(expansion, coefficients, rows, own)[1] for own in ends]
        assert found[..., axis] == pytest.approx((slopes[1] - slopes[0]) / (2 * step), rel=1e-6, abs=1e-6)
