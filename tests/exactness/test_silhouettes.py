"""Curved faces seen nearly edge-on, against their closed forms: certain depths are known to a part of 1e-8."""

from fractions import Fraction

import numpy as np
import pytest
from audit.polynomials import X, Y, Z
from audit.running import Gallery
from audit.worlds import World

from elvis import Camera, Faces, Scene, Status
from elvis.core.shapes import Shape
from elvis.core.testing import grid

#: how far the face bulges, where it is steepest, and where a ray y -> (x, y) that is ``down`` from there meets it first
SILHOUETTES = {
    "a fold": (Y * Fraction(1, 4) - Y**2 * Fraction(1, 2), 1 + 1 / 32, lambda down: 0.25 - np.sqrt(2 * down)),
    "an inflection": (Y**3 - Y**2 * Fraction(3, 2) + Y * Fraction(3, 4), 1 + 1 / 8, lambda down: 0.5 - np.cbrt(down)),
}


@pytest.fixture(scope="module")
def gallery():
    opened = Gallery("vulkan")
    yield opened
    opened.close()


def seen(gallery, kind, far, height, size, up=(0.0, 0.0, 1.0)):
    """The frame of a hexahedron seen along y at its silhouette, and the depths (n,) of its bulging face.

    They are NaN where it is not hit, or touched to within rounding; then (n,) whether it is touched.
    """
    bulge, steepest, first = SILHOUETTES[kind]
    world = World(kind, grid(Shape.HEXAHEDRON, 1), shift=(far, 0.0, 0.0))
    data = world.dataset({"u": X}, 4, local=(X + bulge, Y, Z), map_modes=4)
    camera = Camera((far + steepest, -3.0, 0.4), (far + steepest, 0.0, 0.4), up, height=height)
    frame = gallery.frame(data, Scene(field="u", camera=camera, size=size, objects=(Faces(),)))
    x = frame.view.every_ray()[0][:, 0].astype(np.longdouble) - np.longdouble(far)
    with np.errstate(invalid="ignore"):
        down = np.longdouble(steepest) - x
        touching = np.abs(down) <= 16 * np.finfo(float).eps * (far + 3)
        return frame, 3 + first(np.where(touching, np.nan, down)), touching


@pytest.mark.sampled
@pytest.mark.parametrize("kind", SILHOUETTES)
@pytest.mark.parametrize(
    ("far", "height"), [*((0.0, 10.0**n) for n in (-3, -8, -10, -12, -14)), *((2.0**20, 10.0**n) for n in (-3, -4, -8))]
)
def test_depths_of_faces_seen_edge_on_are_known_where_they_are_certain(gallery, kind, far, height):
    frame, depth, _ = seen(gallery, kind, far, height, (61, 5))
    status, found = frame.status.reshape(-1), frame.depth.reshape(-1)
    hit = np.isfinite(depth)
    assert hit.sum() > 100
    certain = hit & (status == Status.CERTAIN)
    assert (np.abs(found - depth)[certain] <= 1e-8 * depth[certain]).all()
    assert (status[hit] != Status.MISS).all()
    if far and height < 1e-3:
        assert (status[hit] == Status.AMBIGUOUS).mean() > 0.5
    if not far and height >= 1e-8:
        assert certain.sum() >= hit.sum() - 2 * 5


@pytest.mark.sampled
@pytest.mark.parametrize("kind", SILHOUETTES)
@pytest.mark.parametrize(
    ("far", "height"), [*((0.0, 10.0**n) for n in (-9, -10, -12, -14)), *((2.0**20, 10.0**n) for n in (-3, -4, -8))]
)
def test_rays_that_touch_a_face_within_rounding_are_ambiguous(gallery, kind, far, height):
    frame, _, touching = seen(gallery, kind, far, height, (61, 9), up=(1.0, 0.0, 0.0))
    assert touching.sum() >= 61
    assert (frame.status.reshape(-1)[touching] == Status.AMBIGUOUS).all()


@pytest.mark.parametrize(
    ("far", "height"), [(0.0, 1e-8), (0.0, 1e-14), (2.0**20, 1e-6), (2.0**20, 1e-8), (2.0**20, 1e-10)]
)
def test_borders_of_faces_are_certain_up_to_rounding(gallery, far, height):
    """Two cubes side by side, aslant: rays that come close to the edge between them, and to the one they end at."""
    data = World("cubes", grid(Shape.HEXAHEDRON, 2), shift=(far, 0.0, 0.0)).dataset({"u": X}, 4)
    for edge in (0.5, 1.0):
        place = np.array([far + edge, 0.0, 0.4])
        camera = Camera(tuple(place - [1.5, 3.0, 0.0]), tuple(place), (0.0, 0.0, 1.0), height=height)
        frame = gallery.frame(data, Scene(field="u", camera=camera, size=(61, 9), objects=(Faces(),)))
        origins, ways = (np.asarray(part, np.longdouble) for part in frame.view.every_ray())
        x = origins[:, 0] - far - origins[:, 1] * ways[:, 0] / ways[:, 1]
        status, touching = frame.status.reshape(-1), np.abs(x - edge) <= 4 * np.finfo(float).eps * (far + 3)
        assert (status[touching] == Status.AMBIGUOUS).all()
        assert (status[(x < edge) | (edge < 1.0)] != Status.MISS).all()
        assert (status[(x > edge) & (edge == 1.0)] != Status.CERTAIN).all()
        if height * 1e7 >= max(far, 0.1):
            assert (status == Status.AMBIGUOUS).mean() < 0.02


def test_a_distant_face_seen_edge_on_leaves_all_pixels_ambiguous(gallery):
    """What is as near to the eye as rounding may be anywhere in the picture; it is not bisected without end."""
    data = World("a cube", grid(Shape.HEXAHEDRON, 1), shift=(2.0**20, 0.0, 0.0)).dataset({"u": X}, 4)
    eye = np.array([2.0**20, 0.5, 0.5])
    camera = Camera(tuple(eye), (eye[0], 1.0, 0.75), (0.0, 0.0, 1.0), fov=40.0)
    frame = gallery.frame(data, Scene(field="u", camera=camera, size=(61, 9), objects=(Faces(),)))
    assert (frame.status == Status.AMBIGUOUS).all()


@pytest.mark.parametrize("kind", SILHOUETTES)
def test_faces_of_ordinary_pictures_are_certain(gallery, kind):
    frame, _, _ = seen(gallery, kind, 0.0, 3.1, (120, 100))
    assert (frame.status == Status.AMBIGUOUS).mean() < 1e-3
    assert (frame.status == Status.CERTAIN).sum() > 1000
