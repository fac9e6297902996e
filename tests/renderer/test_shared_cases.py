"""The shared data on a device and in NumPy: the same pixels."""

import numpy as np
import pytest

from elvis.formats.errors import ElvisError
from elvis.formats.shapes import Shape
from elvis.reference.picture import render as judge
from elvis.renderer import Camera, Plane, Scene

#: cases for the slow device: every shape but the quadrilateral, then that
SMALL = ("gen_allelem_n4", "gen_pyr_curved", "kova_varp")


def drawable(dataset):
    """Whether the data are 2D in the plane or 3D, without Fourier directions."""
    mesh, expansion = dataset.mesh, dataset.fields[0].blocks[0].expansion
    return 2 <= mesh.dimension == mesh.space and expansion.homogeneous is None


def views(mesh):
    """Two pictures: straight on with an automatic view, and in perspective from the side."""
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    middle, size = (low + high) / 2, np.linalg.norm(high - low)
    flat = mesh.dimension == 2
    eye = middle + size * np.array([0.3, -0.5, 1.0])
    camera = Camera(tuple(eye), tuple(middle + 0.01 * size), (0.1, 1.0, 0.2), fov=40.0)
    straight = None if flat else Plane(tuple(middle + 0.01 * (high - low)), (0.1, 0.2, 1.0))
    tilted = None if flat else Plane(tuple(middle), (1.0, -0.9, 1.1))
    yield {"plane": straight, "size": (150, 120)}
    yield {"plane": tilted, "size": (133, 101), "camera": camera}


def test_same_pixels(case, shared, same_on, liveliest):
    dataset = shared(case)
    if not drawable(dataset):
        refused(dataset)
        return
    for view in views(dataset.mesh):
        drawn, _ = same_on(dataset, field=liveliest(dataset), **view)
        assert drawn.counts()["certain"] > 100


@pytest.mark.parametrize("name", SMALL)
def test_same_pixels_without_a_graphics_driver(name, shared, same_on, liveliest):
    dataset = shared(name)
    scene = next(iter(views(dataset.mesh)))
    same_on(dataset, "cpu", field=liveliest(dataset), **{**scene, "size": (45, 36)})


def refused(dataset):
    scene = Scene(dataset.fields[0].name, Plane((0, 0, 0), (0, 0, 1)), size=(8, 8))
    with pytest.raises(ElvisError, match=r"pictures (are made of 2D data|of homogeneous)"):
        judge(dataset, scene)


def test_every_shape_is_among_them(nektar, shared):
    small = [shared(name) for name in SMALL]
    every = [*small, shared("bfs_tq7")]
    assert {s for d in every for s in d.mesh.elements} == {*Shape.of_dimension(2), *Shape.of_dimension(3)}
