"""What lies far from the origin is as real as what lies near: coordinates are rounded there, nothing else."""

import numpy as np
import pytest

from elvis import Camera, Faces, Isosurface, Scene, Status
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, with_field
from elvis.reference.picture import render

SHIFT = np.array([2.0**20, -(2.0**20), 2.0**20])


@pytest.mark.parametrize("item", [Faces(), Isosurface((0.125,))], ids=["faces", "isosurface"])
def test_a_cube_far_from_the_origin_is_visible(item):
    near = grid(Shape.HEXAHEDRON, 1)
    far = curved(near, lambda points: points + SHIFT, 2)
    data = with_field(far, lambda points: (points - SHIFT)[:, 2], 2)
    eye = np.add(SHIFT, (0.4, 0.45, 3.0))
    camera = Camera(tuple(eye), tuple(eye - [0, 0, 1]), (0, 1, 0), height=0.5)
    frame = render(Dataset(data.mesh, data.fields), Scene("u", objects=(item,), camera=camera, size=(9, 7)))
    assert (frame.status == Status.CERTAIN).all()
    expected = 2.0 if isinstance(item, Faces) else 2.875
    assert np.abs(frame.depth - expected).max() < 1e-8
