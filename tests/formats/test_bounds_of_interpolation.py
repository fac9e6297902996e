"""Bounds of the error of polynomials that stand for other functions on cells of elements, against values there."""

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.quantities import Expression
from elvis.core.quantities.elements.points import Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression_nets import places_of
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.core.triangles.distance_bounds import grown
from elvis.core.triangles.interpolation_errors import interpolation_errors
from elvis.core.triangles.level_cells import _CellNets, _in_cell


def errors(text, shape, degree):
    """Bounds of the errors on cells of elements, and the largest errors at a lattice (n,)."""
    bare = Dataset(curved(grid(shape, 1), ripple(0.05), 3))
    data = Dataset(bare.mesh, (approximated(bare, "u", lambda p: 1 + p[:, 0] * p[:, 1] - p[:, 2] ** 2, 3),))
    expression = Expression.of(data, text)
    evaluator = Evaluator(data, [expression])
    (patch,) = evaluator.patches
    rows = np.arange(len(patch))
    nets = _CellNets(evaluator, expression, patch, False, (degree,), False)
    cell = 0

    def in_cell(places):
        return _in_cell(shape, cell, places)

    def values(places):
        (found,) = evaluator.values_at([expression], Lattice(patch, rows, in_cell(places)))
        return np.reshape(found, (len(rows), *(len(places),) * 3))

    # at the tip of a pyramid derivatives depend on the direction
    nodes, fine = places_of(degree), np.linspace(0, 1 if shape is not Shape.PYRAMID else 0.999, 7)
    lagrange = np.polynomial.chebyshev.chebvander(2 * fine - 1, degree) @ np.linalg.inv(
        np.polynomial.chebyshev.chebvander(2 * nodes - 1, degree)
    )
    interpolated = np.einsum("nijk,ai,bj,ck->nabc", values(nodes), lagrange, lagrange, lagrange, optimize=True)
    off = np.abs(interpolated - values(fine)).max(axis=(1, 2, 3))
    return interpolation_errors(nets, rows, in_cell, degree), off


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.TETRAHEDRON, Shape.PRISM, Shape.PYRAMID])
@pytest.mark.parametrize("text", ["sin(3*x)*cos(2*y) + u", "exp(u)/(2 + z)", "sqrt(3 + u)*atan(y)", "d(u,x)*sin(y)"])
def test_no_value_is_off_by_more_than_the_bound(shape, text):
    for degree in (4, 8):
        bound, off = errors(text, shape, degree)
        assert (off <= bound + 1e-13).all()
        assert np.isfinite(bound).all()
        # discs are wide on large elements, but they are no more than that
        assert bound.min() < 1e6 * off.max() + 1e-11
    steep, _ = errors(text, shape, 4)
    assert (bound < 0.2 * steep).all()


def test_the_bound_is_near_the_error_of_a_line():
    bound, off = errors("exp(x)", Shape.HEXAHEDRON, 1)
    assert (off > bound / 20).all()


@pytest.mark.parametrize("text", ["abs(x - 0.5)", "1/(x - 0.5)", "d(d(u,x),y)", "sqrt(x - 0.2)"])
def test_kinks_poles_and_quotients_have_no_bound(text):
    assert np.isinf(errors(text, Shape.HEXAHEDRON, 8)[0]).all()


def test_solutions_of_nearly_solved_systems_are_grown_by_neumanns_series():
    """|x| of x = v + R x where rows of |R| sum to c: |v| + c / (1 - c) max |v| at most, for equal entries exactly."""
    rng = np.random.default_rng(2)
    part = rng.uniform(0.1, 0.9, 50)
    matrices = rng.uniform(-1, 1, (50, 3, 3))
    matrices *= (part / np.abs(matrices).sum(axis=2).max(axis=1))[:, None, None]
    vectors = rng.uniform(-1, 1, (50, 3))
    found = np.linalg.solve(np.eye(3) - matrices, vectors[..., None])[..., 0]
    assert (np.abs(found) <= grown(np.abs(vectors), part / (1 - part))).all()
    equal = np.ones((50, 3))
    found = np.linalg.solve((1 - part)[:, None, None] * np.eye(3), equal[..., None])[..., 0]
    assert grown(equal, part / (1 - part)) == pytest.approx(found)
