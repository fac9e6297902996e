"""Pixels, plane points and back; cameras that are made for the user."""

import numpy as np
import pytest

from elvis import Camera, Plane, Scene, SceneError
from elvis.scene import NAMED_VIEWS
from elvis.scene.cameras.view import PlaneView, face_on, fit_camera, named_camera

PLANES = (Plane((0.2, -0.3, 0.5), (0.1, 0.2, 1.0)), Plane((1e3, 0.0, 0.0), (1.0, -1.0, 0.3)))
SIZES = ((1, 1), (9, 17), (64, 48))


def cameras(plane):
    """An orthographic and a perspective camera before the plane."""
    normal = plane.basis()[2]
    eye = tuple(np.asarray(plane.point) + 3 * normal + [0.4, -0.2, 0.3])
    return Camera(eye, plane.point, (0.1, 1.0, 0.2), height=2.5), Camera(eye, plane.point, (0.1, 1.0, 0.2), fov=50.0)


def pixels_of(view, points):
    """Columns and rows of world points, by the view's homogeneous rows."""
    columns, rows, weights = view.to_pixel[:, :3] @ points.T + view.to_pixel[:, 3:]
    return columns / weights, rows / weights


@pytest.mark.parametrize("plane", PLANES, ids=["near", "far"])
@pytest.mark.parametrize("kind", [0, 1], ids=["orthographic", "perspective"])
@pytest.mark.parametrize("size", SIZES, ids=str)
def test_pixel_to_plane_and_back(plane, kind, size):
    view = PlaneView.of(cameras(plane)[kind], plane, size)
    points = view.points()
    assert points.shape == (size[1], size[0], 3)
    flat, scale = points.reshape(-1, 3), np.abs(plane.point).max() + 1
    assert np.abs((flat - plane.point) @ plane.basis()[2]).max() < 1e-14 * scale
    j, i = np.indices(size[::-1]).reshape(2, -1)
    columns, rows = pixels_of(view, flat)
    assert np.abs(columns - i).max() < 1e-10
    assert np.abs(rows - j).max() < 1e-10
    assert np.array_equal(view.points_of(i[::3], j[::3]), flat[::3])


@pytest.mark.parametrize("kind", [0, 1], ids=["orthographic", "perspective"])
def test_points_lie_on_the_rays_of_the_camera(kind):
    plane = PLANES[0]
    camera = cameras(plane)[kind]
    view = PlaneView.of(camera, plane, (31, 21))
    right, up, forward = camera.basis()
    offsets = view.points() - camera.eye
    depth = offsets @ forward
    assert np.allclose(depth, view.depth_of(view.points()))
    step = camera.height / 21 if kind == 0 else 2 * np.tan(np.radians(25)) / 21 * depth
    i, j = np.meshgrid(np.arange(31) - 15.0, np.arange(21) - 10.0)
    assert np.allclose(offsets @ right, i * step)
    assert np.allclose(offsets @ up, -j * step)


def test_rows_run_downwards_and_columns_to_the_right():
    view = PlaneView.of(Camera((0, 0, 1), (0, 0, 0), (0, 1, 0), height=2.0), Plane((0, 0, 0), (0, 0, 1)), (4, 2))
    assert np.allclose(view.points()[0, 0], [-1.5, 0.5, 0])
    assert np.allclose(view.points()[1, 3], [1.5, -0.5, 0])


def test_rays_that_miss_have_no_point():
    """Looking along a floor: above the horizon there is nothing, nor in a plane seen edge on."""
    floor = Plane((0, 0, 0), (0, 0, 1))
    points = PlaneView.of(Camera((0, 0, 1), (1, 0, 1), (0, 0, 1), fov=90.0), floor, (8, 8)).points()
    assert np.isnan(points[:4]).all()
    assert np.isfinite(points[4:]).all()
    assert (
        not np.isfinite(PlaneView.of(Camera((0, 0, 1), (1, 0, 1), height=1.0), floor, (8, 8)).points())
        .all(axis=-1)
        .any()
    )


@pytest.mark.parametrize("turn", [1, -1])
def test_the_normal_looks_at_the_viewer(turn):
    plane = Plane((0, 0, 0), (0, 0, 3.0 * turn))
    for camera in (Camera((0, 1, 2), (0, 0, 0), height=1.0), Camera((0, 1, 2), (0, 0, 0), fov=30.0)):
        assert np.allclose(PlaneView.of(camera, plane, (2, 2)).normal(), [0, 0, 1])


@pytest.mark.parametrize("name", ["fit", *NAMED_VIEWS])
def test_a_fitted_camera_shows_all_of_an_extent(name):
    plane, size = Plane((0.3, 0.2, 0.1), (1.0, 2.0, 3.0)), (60, 40)
    camera = named_camera(name, plane)
    extent, box = np.array([[-1.0, 2.0], [3.0, 2.5]]), np.array([[-2.0, -2.0, -2.0], [3.0, 3.0, 3.0]])
    right, up, forward = camera.basis()
    shown = fit_camera(camera, size, extent, box)
    assert np.allclose(np.array(shown.basis()), np.array([right, up, forward]))
    points = np.array([x * right + y * up for x in extent[:, 0] for y in extent[:, 1]])
    columns, rows = pixels_of(PlaneView.of(shown, plane, size), points)
    assert -0.5 <= columns.min() < columns.max() <= 59.5
    assert -0.5 <= rows.min() < rows.max() <= 39.5
    assert np.ptp(columns) > 0.9 * 60

    # the whole domain lies before the eye
    corners = np.array(np.meshgrid(*box.T)).reshape(3, -1).T
    assert ((corners - shown.eye) @ forward > 0).all()


def test_the_plane_seen_head_on():
    for plane in PLANES:
        camera = face_on(plane)
        assert np.allclose(camera.basis()[2], -plane.basis()[2])
        assert np.allclose(np.linalg.norm(np.subtract(camera.eye, camera.at)), 1)


@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -2), (1, 0, 0), (0, 1, 0), (1, 1, 1), (1e-9, 0, 1)])
def test_the_axes_of_a_plane_are_right_handed(normal):
    right, up, towards = Plane((0, 0, 0), normal).basis()
    axes = np.array([right, up, towards])
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.allclose(np.cross(right, up), towards)
    assert np.allclose(np.cross(towards, normal), 0)


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: Plane((0, 0, 0), (0, 0, 0)).basis(), "normal of the plane must be a direction, found 0, 0, 0"),
        (lambda: Plane((0, 0, 0), (np.nan, 0, 1)).basis(), "normal of the plane must be a direction"),
        (lambda: Camera((1, 1, 1), (1, 1, 1)).basis(), "view of the camera .* must be a direction"),
        (lambda: Camera((0, 0, 1), (0, 0, 0), (0, 0, 0)).basis(), "up of the camera must be a direction"),
        (lambda: Scene("u", size=(0, 10)), "1 to 32768 pixels a side, found 0 x 10"),
        (lambda: Scene("u", size=(10, 40000)), "1 to 32768 pixels a side, found 10 x 40000"),
        (lambda: Scene("u", camera="above"), "unknown view 'above': expected fit, "),
        (lambda: Scene("u", range=(1.0, 1.0)), "from a smaller to a greater value, found 1 to 1"),
        (lambda: Scene("u", range=(0.0, np.inf)), "from a smaller to a greater value, found 0 to inf"),
    ],
)
def test_invalid_scenes_are_rejected(make, sentence):
    with pytest.raises(SceneError, match=sentence):
        make()
