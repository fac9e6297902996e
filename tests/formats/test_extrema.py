"""Extrema of fields that are known in closed form, and those of others against samples."""

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.bounds.extrema import extrema
from elvis.core.data.dataset import Dataset
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple, scattered


@pytest.mark.parametrize("shape", Shape)
def test_the_maximum_of_a_paraboloid_is_at_its_apex(shape):
    top = np.array([0.37, 0.61, 0.29])[: shape.dimension]
    bare = Dataset(grid(shape, 2))
    field = approximated(bare, "u", lambda p: 2 - ((p[:, : len(top)] - top) ** 2).sum(axis=1), 3)
    least, greatest = extrema(Dataset(bare.mesh, (field,)), "u")
    assert greatest.value == pytest.approx(2, abs=1e-12)
    assert 0 <= greatest.bound - greatest.value < 1e-11
    assert greatest.position[: len(top)] == pytest.approx(top, abs=1e-5)
    farthest = np.where(top < 0.5, 1.0, 0.0)
    assert least.value == pytest.approx(2 - ((farthest - top) ** 2).sum(), abs=1e-12)
    assert least.position[: len(top)] == pytest.approx(farthest, abs=1e-12)


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.PYRAMID, Shape.PRISM])
def test_no_sample_exceeds_the_bounds(shape):
    bare = Dataset(curved(grid(shape, 1), ripple(0.05), 3))
    field = approximated(bare, "u", lambda p: np.sin(9 * p[:, 0]) * np.cos(7 * p[:, 1] + 3 * p[:, 2]), 5)
    dataset = Dataset(bare.mesh, (field,))
    least, greatest = extrema(dataset, "u")
    expression = Expression.of(dataset, "u")
    evaluator = Evaluator(dataset, [expression])
    for patch in evaluator.patches:
        points = np.tile(scattered(shape, 400, 1), (len(patch), 1))
        values = evaluator.values(expression, patch, np.repeat(np.arange(len(patch)), 400), points)
        assert least.bound <= values.min()
        assert values.max() <= greatest.bound
    assert least.value - least.bound < 1e-11
    assert greatest.bound - greatest.value < 1e-11


def test_missing_fields():
    with pytest.raises(ElvisError, match="expected a field of the dataset"):
        extrema(Dataset(grid(Shape.TRIANGLE, 1)), "u")
