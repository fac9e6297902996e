"""Fields made continuous by ``elvis convert``, and what that changes."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, Shape, integrate, sample
from elvis.core.base.errors import ElvisError
from elvis.core.quantities.jumps import jumps
from elvis.core.testing import approximated, grid
from elvis.plugins.conversion.arrays import from_arrays
from elvis.plugins.transfers.continuous_fields import continuous, continuous_fields

SQUARE = np.array([(0, 0), (1, 0), (0, 1), (1, 1)], np.float64)


def test_two_steps_become_a_line():
    # u = 0 on the first square and 1 on the second; the nearest function is linear in x on each
    squares = np.stack([SQUARE, SQUARE + np.array([1, 0])])
    steps = from_arrays({"quadrilateral": squares}, u=np.array([[0.0] * 4, [1.0] * 4]))
    found = continuous_fields(steps)
    mass = np.array([[2, 1, 0], [1, 4, 1], [0, 1, 2]]) / 6
    ends = np.linalg.solve(mass, [0, 0.5, 0.5])
    values = found.dataset["u"]([0.0, 1.0, 2.0], [0.3, 0.3, 0.3])
    np.testing.assert_allclose(values, ends, atol=1e-13)

    (measure,) = found.measures
    assert measure.max == pytest.approx(abs(ends[1]), rel=0.05)
    assert measure.l2 == pytest.approx(np.sqrt(1 - ends @ [0, 0.5, 0.5]), rel=1e-12)


def test_hanging_nodes_raise_an_error():
    # a square next to two halves of one; the field is 1 on the first half, and 0 elsewhere
    halves = [SQUARE * (1, 0.5) + (1, 0), SQUARE * (1, 0.5) + (1, 0.5)]
    rough = from_arrays({"quadrilateral": np.stack([SQUARE, *halves])}, u=np.repeat([[0.0], [1.0], [0.0]], 4, axis=1))
    with pytest.raises(ElvisError, match="expected elements that share whole sides"):
        continuous_fields(rough)


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.HEXAHEDRON, Shape.PRISM])
def test_smoothing_reduces_waves_by_the_factor_of_their_length(shape):
    """A cosine without slope at the ends of the unit box: half a wave, so its length is 2; the integral stays."""
    bare = Dataset(grid(shape, 2))
    wave = approximated(bare, "u", lambda p: 1 + np.cos(np.pi * p[:, 0]), 7)
    smooth = continuous(replace(bare, fields=(wave,)), 0.6)
    points = np.random.default_rng(2).uniform(0.1, 0.9, (40, 3))
    points[:, shape.dimension :] = 0
    found = sample(smooth, ["u"], points).values[:, 0]
    assert np.abs(found - 1 - np.cos(np.pi * points[:, 0]) / (1 + (0.6 / 2) ** 2)).max() < 1e-5
    assert integrate(smooth, "u").value == pytest.approx(integrate(replace(bare, fields=(wave,)), "u").value, rel=1e-12)


def test_jumps_across_sides_with_hanging_nodes_belong_to_the_elements_of_both():
    """A square with the value -1 meets a half square with 1 and a triangle with 3."""
    corner = np.array([(1, 0.5), (2, 0.5), (1, 1)])
    squares = np.stack([SQUARE, SQUARE * (1, 0.5) + (1, 0)])
    triangles = np.stack([(3, 1.5) - corner, corner])
    rough = from_arrays(
        {"triangle": triangles, "quadrilateral": squares},
        u={"triangle": np.repeat([[2.5], [3.0]], 3, axis=1), "quadrilateral": np.repeat([[-1.0], [1.0]], 4, axis=1)},
    )
    jump = jumps(rough, "u")[1]
    assert jump == pytest.approx([0.5, 4.0, 4.0, 2.0])
