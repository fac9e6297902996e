"""The shared data on a device and in NumPy: the same pixels."""

import numpy as np
import pytest

from elvis import Camera, Plane, Scene
from elvis.core.base.errors import ElvisError
from elvis.core.shapes import Shape
from elvis.reference.picture import render as render_reference

#: cases for the slow device: every shape but the quadrilateral, then that
SMALL = ("gen_allelem_n4", "gen_pyr_curved", "kova_varp")


def period(dataset):
    """The length of the Fourier direction, None where there is none."""
    homogeneous = dataset.fields[0].blocks[0].expansion.homogeneous
    return homogeneous and homogeneous.lengths[0]


def drawable(dataset):
    """Whether the data are 2D in the plane, 3D, or 2D with a Fourier direction."""
    return 2 <= dataset.mesh.dimension == dataset.mesh.space


def views(dataset):
    """Two pictures: straight on with an automatic view, and in perspective from the side."""
    low, high = dataset.mesh.vertices.min(axis=0), dataset.mesh.vertices.max(axis=0)
    high[2] = period(dataset) or high[2]
    middle, size = (low + high) / 2, np.linalg.norm(high - low)
    flat = dataset.mesh.dimension == 2 and not period(dataset)
    eye = middle + size * np.array([0.3, -0.5, 1.0])
    camera = Camera(tuple(eye), tuple(middle + 0.01 * size), (0.1, 1.0, 0.2), fov=40.0)
    straight = None if flat else Plane(tuple(middle + 0.01 * (high - low)), (0.1, 0.2, 1.0))
    tilted = None if flat else Plane(tuple(middle), (1.0, -0.9, 1.1))
    yield {"plane": straight, "size": (40, 33)}
    yield {"plane": tilted, "size": (42, 31), "camera": camera}


@pytest.mark.sampled(least=14, free=("case",))
def test_same_pixels(case, shared, same_on, liveliest):
    dataset = shared(case)
    if not drawable(dataset):
        refused(dataset)
        return
    for view in views(dataset):
        drawn, _ = same_on(dataset, field=liveliest(dataset), **view)
        assert drawn.counts()["certain"] > 30


@pytest.mark.thorough
@pytest.mark.parametrize("name", SMALL)
def test_same_pixels_without_a_graphics_driver(name, shared, same_on, liveliest):
    dataset = shared(name)
    scene = next(iter(views(dataset)))
    same_on(dataset, "cpu", field=liveliest(dataset), **{**scene, "size": (35, 28)})


def refused(dataset):
    scene = Scene(dataset.fields[0].name, Plane((0, 0, 0), (0, 0, 1)), size=(8, 8))
    with pytest.raises(ElvisError, match=r"expected 2D data in the plane|1D data are drawn on the host"):
        render_reference(dataset, scene)


def test_every_shape_is_among_them(nektar, shared):
    small = [shared(name) for name in SMALL]
    every = [*small, shared("bfs_tq7")]
    assert {s for d in every for s in d.mesh.elements} == {*Shape.of_dimension(2), *Shape.of_dimension(3)}
