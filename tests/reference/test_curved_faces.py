"""No hit of a curved face is lost: edges like an S, and faces with two points at one place of the screen."""

import numpy as np
import pytest

from elvis import Camera, Dataset, Scene
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid
from elvis.reference.picture import render
from elvis.scene import Faces, Transfer, VolumeRendering

SOLIDS = Shape.of_dimension(3)


def cube(shape, cells, shifted, modes):
    """The unit cube with x, which is x + ``shifted`` (x, y)."""
    mesh = curved(grid(shape, cells), lambda x: x + shifted(x[:, 0], x[:, 1])[:, None] * [1, 0, 0], modes)
    return Dataset(mesh, (approximated(Dataset(mesh), "u", lambda x: x[:, 1], modes=modes),))


def seen(data, size, shown, middle=0.503, height=1.2):
    """Places x and y (n,) of the pixels of a picture along z, and whether anything is seen there."""
    camera = Camera((middle, 0.496, 5.0), (middle, 0.496, 0.0), up=(0.0, 1.0, 0.0), height=height)
    frame = render(data, Scene("u", camera=camera, size=size, objects=(shown,)))
    x, y, _ = frame.view.every_ray()[0].T
    return x, y, frame.status.ravel() > 0


@pytest.mark.sampled
@pytest.mark.parametrize("shape", SOLIDS, ids=lambda shape: shape.label)
@pytest.mark.parametrize("shown", [Faces(), VolumeRendering(Transfer((0.0, 1.0), (1.0, 1.0)))], ids=["faces", "volume"])
@pytest.mark.parametrize("degree", [3, 5])
def test_edges_with_inflection(shape, shown, degree):
    """An edge that is a polynomial of odd symmetry, without any bend in its middle, or in the middles of its halves."""

    def shifted(x, y):
        cubic = 0.8 * y * (1 - y) * (1 - 2 * y)
        return cubic if degree == 3 else cubic * (4 * y - 1) * (4 * y - 3)

    x, y, found = seen(cube(shape, 1, shifted, degree + 1), (16, 16), shown)
    side = shifted(x, y)
    assert np.array_equal(found, (y > 0) & (y < 1) & (x > side) & (x < 1 + side))


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PRISM, Shape.HEXAHEDRON], ids=lambda shape: shape.label)
def test_faces_that_fold_on_the_screen(shape):
    """x - 33/64 x^2 turns at x = 32/33, so near to the end that the fold is narrower than a pixel."""
    fold = 33 / 64
    x, y, found = seen(cube(shape, 1, lambda x, y: -fold * x**2, 3), (50, 40), Faces(), 0.5, 1.3856)
    assert np.array_equal(found, (y > 0) & (y < 1) & (x > 0) & (x < 1 / (4 * fold)))


def test_faces_that_bulge_past_the_eye():
    """Inside a bulge of a face, all corners of which lie behind the eye: whatever way one looks, one looks at it."""

    def bulging(x):
        return x + np.column_stack([8 * x[:, 0] * np.prod(x[:, 1:] * (1 - x[:, 1:]), axis=1), 0 * x[:, 1:]])

    mesh = curved(grid(Shape.HEXAHEDRON, 1), bulging, 3)
    data = Dataset(mesh, (approximated(Dataset(mesh), "u", lambda x: x[:, 1], modes=3),))
    camera = Camera((1.1, 0.5, 0.5), (2.0, 0.52, 0.53), fov=60.0)
    frame = render(data, Scene("u", camera=camera, size=(20, 16), objects=(Faces(),)))
    assert frame.seen.all()
    x, y, z = np.moveaxis(frame.position, -1, 0)
    assert np.abs(x - 1 - 8 * y * (1 - y) * z * (1 - z)).max() < 1e-10
