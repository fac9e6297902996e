"""Walls of a height: their area is the integral of its jumps along the sides of elements."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, Shape, deform, integrate
from elvis.core.deformed.height_walls import height_walls
from elvis.core.testing import approximated, curved, grid, ripple

SCALE = 0.7


def surface(shape, function, nodes=2):
    mesh = grid(shape, 2) if nodes == 2 else curved(grid(shape, 2), ripple(0.05), nodes)
    data = Dataset(mesh)
    return deform(replace(data, fields=(approximated(data, "u", function, 4),)), height="u", scale=SCALE)


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_the_area_of_walls_is_the_integral_of_the_jumps(shape):
    # on one side of x = 1/2 the height is 0, on the other 1 + y^2
    walls = height_walls(surface(shape, lambda x: np.where(x[:, 0] > 0.5, 1 + x[:, 1] ** 2, 0.0)))
    assert walls.mesh.count == 2
    found = integrate(walls, ["1", "x", "y", "z"])
    # of z at t in [0, 1] from 0 to h: h^2 / 2, integrated over y
    expected = [4 / 3, 0.5 * 4 / 3, 3 / 4, 0.5 * SCALE * (1 + 2 / 3 + 1 / 5)]
    assert [own.value for own in found] == pytest.approx([SCALE * value for value in expected], rel=1e-12)


def test_walls_of_curved_elements_stand_on_their_sides():
    walls = height_walls(surface(Shape.TRIANGLE, lambda x: np.where(x[:, 0] > 0.5, 1.0, 0.0), 4))
    curve = ripple(0.05)(np.column_stack([np.full(2001, 0.5), np.linspace(0, 1, 2001), np.zeros(2001)]))
    length = np.linalg.norm(np.diff(curve, axis=0), axis=1).sum()
    # sides of order 3 follow the ripple, and the polygon has many corners
    assert integrate(walls, "1")[0].value == pytest.approx(SCALE * length, rel=1e-3)


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_continuous_heights_have_no_walls(shape):
    assert height_walls(surface(shape, lambda x: np.zeros(len(x)) + x[:, 0] ** 2 * x[:, 1])) is None
