"""Pixels on the borders of elements, of tiles and of pictures."""

import numpy as np
import pytest

from elvis import Camera, Plane, Status
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, ripple
from elvis.renderer.raster.tiles import TILE

SOLIDS = Shape.of_dimension(3)
SIZES = ((1, 1), (7, 5), (8, 8), (9, 17), (64, 3), (2, 41))
#: pixel centres at multiples of 1/32 over the unit square, the outermost two beyond it
ON_LINES = Camera((0.5, 0.5, 2.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), height=35 / 32)


def ids(shapes):
    return shapes.label


@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize("shape", SOLIDS, ids=ids)
def test_a_plane_along_faces(draw, linear, shape):
    """The plane lies in faces, pixels on edges and vertices of a grid: full coverage, and always the same elements."""
    dataset = linear(grid(shape, 2))
    scene = {"plane": Plane((0.0, 0.0, 0.5), (0.0, 0.0, 1.0)), "camera": ON_LINES, "size": (35, 35)}
    frame, again, truth = (draw(dataset, device, **scene) for device in ("vulkan", "vulkan", "reference"))
    inside = np.zeros((35, 35), bool)
    inside[1:-1, 1:-1] = True
    assert np.array_equal(frame.seen, inside)
    assert np.array_equal(truth.seen, inside)
    assert np.array_equal(frame.element, again.element)
    assert frame.field.tobytes() == again.field.tobytes()
    assert np.abs(frame.field - frame.position @ [1.0, 2.0, -3.0])[inside].max() < 1e-14 * 20

    # pyramids have their apexes in the plane, and no faces along it
    ambiguous = frame.status[inside] == Status.AMBIGUOUS
    assert ambiguous.all() or shape is Shape.PYRAMID
    assert np.array_equal(frame.status, truth.status)
    assert np.array_equal(frame.element, truth.element)


@pytest.mark.parametrize("side", ["low", "high"])
@pytest.mark.parametrize("axis", range(3))
def test_a_plane_along_the_boundary(draw, linear, axis, side):
    place, normal = np.full(3, 0.5), np.eye(3)[axis]
    place[axis] = side == "high"
    plane = Plane(tuple(place), tuple(normal))
    camera = Camera(tuple(place + 2 * normal), tuple(place), tuple(np.eye(3)[axis - 1]), height=1.04)
    frame = draw(linear(grid(Shape.TETRAHEDRON, 2)), plane=plane, camera=camera, size=(52, 52))
    assert np.array_equal(frame.seen, np.pad(np.ones((50, 50), bool), 1))
    assert np.abs(frame.field - frame.position @ [1.0, 2.0, -3.0])[frame.seen].max() < 1e-13


@pytest.mark.sampled
@pytest.mark.parametrize("z", [0.5, 0.25, 1.0])
@pytest.mark.parametrize("case_name", ["gen_allelem_n4", "hex_c0"])
def test_faces_of_shared_cubes(same_on, shared, case_name, z):
    camera = Camera((0.5, 0.5, 2.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), height=1.02)
    plane = Plane((0.5, 0.5, z), (0.0, 0.0, 1.0))
    frame, _ = same_on(shared(case_name), plane=plane, camera=camera, size=(102, 102))
    assert np.array_equal(frame.seen, np.pad(np.ones((100, 100), bool), 1))


@pytest.mark.parametrize("size", SIZES, ids=str)
def test_odd_sizes(same_on, linear, size):
    dataset = linear(curved(grid(Shape.HEXAHEDRON, 3), ripple(0.05, seed=1), 3))
    camera = Camera((0.5, 0.5, 2.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), height=0.8)
    frame, _ = same_on(dataset, plane=Plane((0.5, 0.5, 0.5), (0.1, 0.2, 1.0)), camera=camera, size=size)
    assert frame.field.shape == size[::-1]
    assert frame.seen.all() or size[0] > size[1]


def test_a_part_of_a_picture_is_that_part_of_the_whole(draw, linear):
    """Tiles begin elsewhere, the pixels show the same."""
    dataset = linear(curved(grid(Shape.TETRAHEDRON, 3), ripple(0.05, seed=1), 3))
    scene = {"plane": Plane((0.5, 0.5, 0.5), (0.1, 0.2, 1.0))}
    eye, at, up = (0.5, 0.5, 2.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0)
    whole = draw(dataset, camera=Camera(eye, at, up, height=1.2), size=(120, 120), **scene)
    part = draw(dataset, camera=Camera(eye, at, up, height=0.46), size=(46, 46), **scene)
    window = (slice(37, 83), slice(37, 83))
    assert np.array_equal(part.element, whole.element[window])
    assert np.allclose(part.field, whole.field[window], rtol=0, atol=1e-13)


def test_more_tiles_than_a_row_of_groups_holds(draw, linear):
    dataset = linear(curved(grid(Shape.HEXAHEDRON, 1), ripple(0.1, seed=1), 3))
    camera = Camera((0.5, 0.5, 2.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), height=0.2)
    frame = draw(dataset, plane=Plane((0.5, 0.5, 0.5), (0.1, 0.2, 1.0)), camera=camera, size=(1700, 1300))
    assert frame.seen.all()
    assert frame.seen.size > 32768 * TILE**2
    assert np.abs(frame.field - frame.position @ [1.0, 2.0, -3.0]).max() < 1e-12


@pytest.mark.thorough
def test_more_disputed_pixels_than_the_first_list_holds(same_on, linear):
    """Eight elements meet in the plane: every pixel has two candidates, equal in rank."""
    camera = Camera((0.5, 0.5, 2.0), (0.5, 0.5, 0.5), (0.0, 1.0, 0.0), height=0.9)
    plane = Plane((0.0, 0.0, 0.5), (0.0, 0.0, 1.0))
    frame, truth = same_on(linear(grid(Shape.HEXAHEDRON, 2)), plane=plane, camera=camera, size=(260, 260))
    assert (frame.status == Status.AMBIGUOUS).all()
    assert np.array_equal(frame.element, truth.element)
    assert set(np.unique(frame.element)) == {0, 1, 2, 3}


@pytest.mark.parametrize("device", ["vulkan", "reference"])
def test_the_same_picture_twice(draw, linear, device):
    dataset = linear(curved(grid(Shape.PRISM, 2), ripple(0.05, seed=1), 3))
    first, second = (draw(dataset, device, plane=Plane((0.5, 0.5, 0.5), (1, 2, 3)), size=(90, 70)) for _ in range(2))
    for name in ("field", "element", "reference", "status", "color", "depth"):
        assert getattr(first, name).tobytes() == getattr(second, name).tobytes()


def test_objects_behind_the_camera_are_invisible(same_on, linear):
    dataset = linear(grid(Shape.HEXAHEDRON, 2))
    camera = Camera((0.5, 0.5, 0.6), (1.0, 0.5, 0.5), (0.0, 0.0, 1.0), fov=120.0)
    frame, _ = same_on(dataset, plane=Plane((0.5, 0.5, 0.5), (0.0, 0.0, 1.0)), camera=camera, size=(80, 60))
    assert frame.seen.any()
    assert not frame.seen[:15].any()
    assert (frame.position[frame.seen][:, 0] > 0.4).all()
    assert (frame.depth[frame.seen] > 0).all()
