"""Automatic views: what the plane meets of boxes, and nothing else."""

import tracemalloc

import numpy as np
import pytest

from elvis import Camera, Clip, CutSurface, Faces, Implicit, Isosurface, Plane, Scene, SceneError, Sphere
from elvis.scene.cameras.fitting import automatic, crossings, is_of_elements, proportionate, surrounding

CUT = CutSurface(Plane((0, 0, 0), (0, 0, 1)))
UNIT = np.array([[0, 0, 0, 1, 1, 1]], np.float32)


def never(scene):
    raise AssertionError("nothing had to be looked at")


@pytest.mark.parametrize(
    ("plane", "count"),
    [
        (Plane((0.5, 0.5, 0.5), (0, 0, 1)), 4),
        (Plane((0.5, 0.5, 0.5), (1, 1, 1)), 6),
        (Plane((0, 0, 0.25), (1, 1, 1)), 3),
        (Plane((0, 0, 1), (0, 0, 1)), 4),
        (Plane((0, 0, 1.001), (0, 0, 1)), 0),
        (Plane((0, 0, 0), (1, 1, 1)), 1),
    ],
)
def test_a_cube_is_cut_in_a_polygon(plane, count):
    points = crossings(UNIT, plane)
    distinct = np.unique(points.round(12), axis=0)
    assert len(distinct) == count
    assert np.abs((points - plane.point) @ plane.basis()[2]).max(initial=0) < 1e-15


def test_flat_boxes_intersect_their_plane():
    flat = np.array([[0, 0, 0, 2, 1, 0]], np.float32)
    points = crossings(flat, Plane((0, 0, 0), (0, 0, 1)))
    assert {tuple(p) for p in points} == {(0, 0, 0), (2, 0, 0), (0, 1, 0), (2, 1, 0)}


def test_every_point_of_a_section_lies_within_its_crossings():
    rng = np.random.default_rng(3)
    corners = np.sort(rng.uniform(-1, 1, (50, 2, 3)), axis=1)
    boxes = corners.reshape(50, 6).astype(np.float32)
    plane = Plane((0.1, 0.0, 0.05), (0.3, -1.0, 0.6))
    right, up, normal = plane.basis()
    axes = np.array([right, up])
    met = crossings(boxes, plane) @ axes.T
    inner = boxes[:, None, :3] + rng.uniform(0, 1, (50, 400, 3)) * (boxes[:, None, 3:] - boxes[:, None, :3])
    near = inner[np.abs((inner - plane.point) @ normal) < 0.02] @ axes.T
    assert (near > met.min(axis=0) - 0.1).all()
    assert (near < met.max(axis=0) + 0.1).all()


def test_the_box_around_all_boxes():
    boxes = [np.array([[0, 1, 2, 3, 4, 5]], np.float32), np.empty((0, 6), np.float32), UNIT]
    assert np.array_equal(surrounding(boxes), [[0, 0, 0], [3, 4, 5]])


def test_a_given_camera_is_unchanged():
    for camera in (Camera((0, 0, 1), (0, 0, 0), (0, 1, 0), fov=30.0), Camera((0, 0, 1), (0, 0, 0), height=2.0)):
        scene = Scene("u", Plane((9, 9, 9), (0, 0, 1)), camera, (10, 20))
        assert automatic(scene, [UNIT], never) == scene


@pytest.mark.parametrize("view", ["fit", "+x", "-y", "iso", Camera((5, 4, 3), (0, 0, 0))])
def test_a_preview_determines_the_view(view):
    """Where only the middle third of a box is seen, the picture shows just that."""

    def middle(scene):
        mask = np.zeros((scene.size[1], scene.size[0]), bool)
        mask[scene.size[1] // 3 : 2 * scene.size[1] // 3, scene.size[0] // 3 : 2 * scene.size[0] // 3] = True
        return mask

    scene = Scene("u", Plane((0.5, 0.5, 0.5), (1, 1, 1)), view, (300, 300), domain_outline=False)
    whole = automatic(scene, [UNIT], lambda scene: np.ones((scene.size[1], scene.size[0]), bool)).camera
    part = automatic(scene, [UNIT], middle).camera
    nothing = automatic(scene, [UNIT], lambda scene: np.zeros((scene.size[1], scene.size[0]), bool)).camera
    assert 0.3 < part.height / whole.height < 0.4
    assert nothing.height <= whole.height * 1.05
    assert np.allclose(part.basis(), whole.basis())


def test_thin_ends_of_small_bodies_are_in_the_picture():
    """A needle in a wide box: coarse previews have no pixel whose centre is in its tip."""
    box = np.array([[0, 0, 0, 100, 100, 0]], np.float32)

    def needle(scene):
        width, height = scene.size
        right, up, _ = scene.camera.basis()
        pixel = scene.camera.height / height
        x = right @ scene.camera.eye + (np.arange(width) + 0.5 - width / 2) * pixel
        y = up @ scene.camera.eye - (np.arange(height)[:, None] + 0.5 - height / 2) * pixel
        return (y > 48) & (y < 52) & (np.abs(x - 50) < 0.2 * (y - 48))

    camera = automatic(Scene("u", objects=(Faces(),), camera="top", size=(200, 200)), [box], needle).camera
    low = camera.eye[1] - camera.height / 2
    assert 47.5 < low < 48.1
    assert camera.height < 5.0


def test_a_plane_that_misses_every_box_is_rejected():
    with pytest.raises(SceneError, match=r"the picture is empty: .* through \(0, 0, 9\) with normal \(0, 0, 1\)"):
        automatic(Scene("u", Plane((0, 0, 9), (0, 0, 1))), [UNIT], never)
    with pytest.raises(SceneError, match="nothing to draw"):
        automatic(Scene("u", Plane((0, 0, 9), (0, 0, 1))), [UNIT[:0]], never)


@pytest.mark.parametrize("sides", [(1, 1), (10, 1), (1, 10), (1e-200, 1), (0, 0), (3e300, 1e300)])
def test_pictures_have_the_proportions_of_the_visible_part(sides):
    width, height = proportionate(np.array([[0.0, 0.0], sides]))
    assert 160 <= width <= 1000
    assert 160 <= height <= 800
    assert width == 1000 or height == 800


def test_without_zoom_a_region_is_shown_to_the_last_bit():
    for left, right in [(0.1, 0.7), (-0.3, 0.9), (0.2, 0.9), (-0.7, 0.1), (1 / 3, 3.7)]:
        scene = Scene("u", plane=Plane((0, 0, 0), (0, 0, 1)), region=(left, right, left, right), size=(64, 64))
        assert automatic(scene, [UNIT], never).camera.height == right - left


@pytest.mark.parametrize(
    ("given", "stays"),
    [
        ({"objects": (Faces(), CUT)}, True),
        ({"plane": Plane((0, 0, 0), (0, 0, 1)), "clip": (Clip(Sphere((0, 0, 0), 1.0)),)}, True),
        ({"objects": (Faces(), Isosurface((1.0,)))}, False),
        ({"objects": (Faces(), Isosurface((1.0,))), "camera": Camera((9, 0, 0), (0, 0, 0), fov=30.0)}, True),
        ({"objects": (CutSurface(Implicit("u")),)}, False),
        ({"objects": (Faces(),), "clip": (Clip(Implicit("u")),)}, False),
    ],
)
def test_views_independent_of_values(given, stays):
    assert is_of_elements(Scene("u", **given)) == stays


@pytest.mark.parametrize("given", [{}, {"plane": Plane((0.5, 0.5, 0.5), (0.0, 0.6, 0.8))}])
def test_memory_of_a_view_does_not_grow_with_the_elements(given):
    """Corners and edges of boxes take much more memory than these; some are taken at a time, and none is left out."""
    last = np.array([[7, 7, 7, 9, 8, 11]], np.float32)
    extents, peaks = [], []
    for count in (100_000, 400_000):
        boxes = np.concatenate([np.tile(UNIT, (count, 1)), last])
        tracemalloc.start()
        found = automatic(Scene(**given), [boxes], lambda scene: np.ones((scene.size[1], scene.size[0]), bool))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        extents.append(found.camera)
    assert extents[0] == extents[1]
    few = automatic(Scene(**given), [UNIT, last], lambda scene: np.ones((scene.size[1], scene.size[0]), bool))
    assert extents[0] == few.camera
    assert peaks[1] < 2 * peaks[0]
