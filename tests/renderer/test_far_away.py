"""Cuts of what lies far from the origin, where rounding of coordinates is more than the tolerance of borders."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Camera, Plane, Status
from elvis.core.shapes import Shape
from elvis.core.testing import grid, with_field

SHIFT = np.array([2.0**20, -(2.0**20), 2.0**20])


@pytest.mark.parametrize("count", [20, 32, 104])
def test_no_point_between_two_elements_is_certainly_outside(draw, count):
    """Pyramids of a cube: many pixels lie on the faces between them, exactly."""
    near = grid(Shape.PYRAMID, 1)
    far = replace(near, vertices=near.vertices + SHIFT)
    data = with_field(far, lambda points: (points - SHIFT)[:, 2], 4)
    middle = SHIFT + 0.5
    camera = Camera(tuple(np.subtract(middle, (0, 3, 0))), tuple(middle), (0, 0, 1), height=0.6)
    plane = Plane(tuple(np.add(SHIFT, (0.578125, 0.446875, 0.109375))), (-3.0, 2.0, 1.0))
    frame = draw(data, plane=plane, camera=camera, size=(count, count))
    points = frame.view.points() - SHIFT
    inside = np.isfinite(points).all(axis=2) & (points > 1e-6).all(axis=2) & (points < 1 - 1e-6).all(axis=2)
    assert inside.sum() > 200
    assert (frame.status[inside] != Status.MISS).all()
    assert (frame.status == Status.MISS).mean() > 0.1


def test_no_probe_between_two_elements_is_certainly_outside(renderer):
    near = grid(Shape.TRIANGLE, 2)
    shift = SHIFT * [1, 1, 0]
    far = replace(near, vertices=near.vertices + shift)
    device = renderer("vulkan")
    device.load(with_field(far, lambda points: (points - shift)[:, 1], 4), "u")
    x, y = (side.ravel() for side in np.meshgrid(np.arange(1, 64) / 64, np.arange(1, 64) / 64))
    points = np.column_stack([x, y, np.zeros_like(x)]) + shift
    places = device.probe(points)
    assert (places.status != Status.MISS).all()
    outside = device.probe(np.add(points, (1.0, 0.0, 0.0)))
    assert (outside.status == Status.MISS).all()
