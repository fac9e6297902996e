"""Limits of searches: what is within a bound is examined, what is beyond it is not."""

from types import SimpleNamespace

import numpy as np
import pytest

from elvis.core.dataset import Dataset
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.newton import Targets, newton
from elvis.core.patch import patches
from elvis.core.polynomials.chebyshev_nodes import series
from elvis.core.quantities import Expression, bounding
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.core.validity import enclosed_determinants, largest_scale

#: unit roundoff of the model
COARSE = 2.0**-11


@pytest.mark.parametrize(("part", "is_inside"), [(0.99, True), (1.01, False)])
def test_roots_beyond_a_side_by_rounding_are_inside(part, is_inside):
    """Next to each side of a unit square: its heights are distances, which may have the tolerance in addition."""
    patch = patches(Dataset(grid(Shape.QUADRILATERAL, 1)))[0]
    rounding = 1e-10
    away = rounding + part * TOLERANCE
    ends = [-away, 1 + away]
    points = np.array([[ends[0], 0.3, 0], [ends[1], 0.3, 0], [0.3, ends[0], 0], [0.3, ends[1], 0]])
    tiny = np.full(4, 1e-14)
    found = newton(Targets(patch, np.zeros(4, int), points, tiny, tiny, np.full(4, rounding)), np.zeros((4, 2)))
    assert found.converged.all()
    assert (found.inside == is_inside).all()


def test_elements_may_fold_where_their_smallest_coefficient_may_be_zero(monkeypatch):
    """Of three elements the second has one coefficient below its error, the third one just above."""
    nets = np.ones((3, 2, 2, 2))
    nets[1, 0, 1, 0] = 0.0999
    nets[2, 1, 0, 1] = 0.1001
    places = np.arange(3.0)[:, None, None]
    examined = []

    def are_regular_between(expansion, first, last):
        examined.extend(first.ravel().tolist())
        return np.zeros(len(first), bool)

    monkeypatch.setattr(largest_scale, "are_regular_between", are_regular_between)
    maps = SimpleNamespace(places=places, moves=0 * places, expansion=None)
    piece = SimpleNamespace(
        boxes=lambda low, high: nets, error_at=lambda scale: np.full(3, 0.1), rows=np.arange(3), maps=maps
    )
    assert not largest_scale._Search._is_regular(piece, 0.0, 1.0)
    assert examined == [1.0]


@pytest.mark.parametrize("degrees", [[1, 1, 1], [1, 2, 4], [7, 3, 2]])
def test_rounding_of_transforms_has_a_part_for_each_term(degrees, monkeypatch):
    """Rounding of values to coefficients and of coefficients to the net, each of one sign; errors of values."""
    monkeypatch.setattr(enclosed_determinants, "gamma", lambda roundings: roundings * COARSE)
    none = np.zeros((1, 2, 2, 2))

    def slack(greatest=0.0, low=none, error=0.0):
        return enclosed_determinants._slack(np.full(1, greatest), low, degrees, np.full(1, error))[0]

    transforms = [series(degree)[1] for degree in degrees]
    largest = np.prod([np.abs(own).sum() for own in transforms])
    # sums of so many products, with cosines that are accurate to 5 roundings
    least = COARSE * sum(degree + 1 + 5 for degree in degrees) * largest
    assert least <= slack(greatest=1.0) <= 8 * least

    low = np.random.default_rng(3).normal(size=(1, 6, 6, 6))
    matrix = np.abs(enclosed_determinants._to_bernstein(6))
    raised = np.einsum("ai,bj,ck,ijk->abc", matrix, matrix, matrix, np.abs(low[0])).max()
    least = COARSE * 3 * (6 + 1) * raised
    assert least <= slack(low=low) <= 2.1 * least

    places = np.polynomial.chebyshev.chebvander(np.linspace(-1, 1, 201), max(degrees))
    lebesgue = [np.abs(places[:, : len(own)] @ own).sum(axis=1).max() for own in transforms]
    exact = slack(error=1.0)
    assert np.prod(lebesgue) <= exact <= 1.1 * max(lebesgue) ** 3
    # the bound itself has about 20 roundings
    monkeypatch.setattr(enclosed_determinants, "UNIT", COARSE)
    assert 1 + 20 * COARSE <= slack(error=1.0) / exact <= 1 + 100 * COARSE


def test_bounds_of_a_quantity_move_with_a_constant():
    """Accuracy is relative to the range of values, not to their size."""
    dataset = Dataset(grid(Shape.QUADRILATERAL, 1))
    text = "sin(5*x + 3)*cos(4*y + 1)"
    for constant in (-30.0, 30.0):
        found = bounding.quantity_range(dataset, Expression.of(dataset, f"{text} + {constant}"))
        size = found.maximum - found.minimum
        assert found.lower <= constant - 1 + 1e-12
        assert found.upper >= constant + np.cos(1) * 1.0
        assert found.minimum - found.lower <= 2 * bounding._TOLERANCE * size
        assert found.upper - found.maximum <= 2 * bounding._TOLERANCE * size
