"""Pixels of which rounding decides what is seen are ambiguous: rays that touch, surfaces in one place, clips nearby."""

import numpy as np
import pytest

from elvis import Camera, CutSurface, Faces, Isosurface, Plane, Status, Style
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.scene import Clip, Cylinder, Implicit, Sphere

#: straight down on the unit cube, pixels of 1/51
ABOVE, SIZE = Camera((0.5, 0.5, 5.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=1.0), (51, 51)
ASIDE = Camera((2.6, -1.9, 1.9), (0.5, 0.5, 0.25), fov=32.0)


@pytest.mark.parametrize(
    "surface", [Sphere((0.5, 0.5, 0.5), 15 / 51), Cylinder((0.5, 0.5, 0.5), (1.0, 0.0, 0.0), 15 / 51)]
)
def test_rays_that_touch_a_surface_are_ambiguous(draw, cube, surface):
    """Its outline passes exactly through the centres of pixels."""
    frame = draw(cube, objects=(CutSurface(surface),), camera=ABOVE, size=SIZE)
    y, x = np.indices((51, 51)) - 25
    outside = x**2 + y**2 - 225 if isinstance(surface, Sphere) else y**2 - 225
    assert (frame.status[outside == 0] == Status.AMBIGUOUS).all()
    assert (frame.status[outside > 0] == Status.MISS).all()
    assert (frame.status[(outside < 0) & (x % 25 != 0) & (y % 25 != 0)] == Status.CERTAIN).mean() > 0.99


@pytest.mark.parametrize("scale", ["1e-30*", "", "1e30*"])
def test_expressions_clip_at_every_scale(draw, cube, scale):
    scene = {"objects": (Faces(),), "camera": ASIDE, "size": (30, 30)}
    clip = Clip(Implicit(f"{scale}(x-0.3)"), "outside")
    frame = draw(cube, **scene, clip=(clip,))
    other = draw(cube, **scene, clip=(Clip(Plane((0.3, 0.0, 0.0), (1.0, 0.0, 0.0)), "outside"),))
    assert np.array_equal(frame.seen, other.seen)
    assert np.array_equal(frame.depth, other.depth)
    assert (frame.position[..., 0][frame.seen] < 0.3).all()
    assert frame.seen.sum() > 50


def test_points_nearly_on_a_clip_are_ambiguous(draw, cube):
    """A cut 5e-12 beyond a clip that keeps 1e-11; and one that an expression puts in the same place."""
    cut = CutSurface(Plane((0.0, 0.0, 0.25), (0.0, 0.0, 1.0)))
    for height, status in ((0.25 - 5e-12, Status.AMBIGUOUS), (0.26, Status.CERTAIN), (0.25, Status.CERTAIN)):
        clip = Clip(Plane((0.0, 0.0, height), (0.0, 0.0, 1.0)), "outside")
        frame = draw(cube, objects=(cut,), camera=ASIDE, size=(16, 16), clip=(clip,))
        inner = frame.seen & (np.abs(frame.position[..., :2] % 0.5 - 0.25) < 0.2).all(axis=2)
        assert inner.sum() > 10
        assert (frame.status[inner] == status).all()
    clip = Clip(Implicit("z-0.25"), "outside")
    frame = draw(cube, objects=(cut,), camera=ASIDE, size=(16, 16), clip=(clip,))
    assert (frame.status[frame.seen] == Status.AMBIGUOUS).all()


def test_surfaces_in_one_place_are_ambiguous(draw, linear):
    """A plane and an isosurface at one height differ by rounding, or not at all: then the first one counts."""
    data = linear(grid(Shape.HEXAHEDRON, 1))
    plane = CutSurface(Plane((0.1, 0.0, 0.0), (1.0, 2.0, -3.0)), Style(color=(1.0, 0.0, 0.0), lit=False))
    level = Isosurface((0.1,), style=Style(color=(0.0, 0.0, 1.0), lit=False))
    frame = draw(data, objects=(plane, level), camera=ASIDE, size=(16, 16))
    assert frame.seen.sum() > 40
    assert (frame.status[frame.seen] == Status.AMBIGUOUS).mean() > 0.5
    assert (frame.color[frame.status == Status.CERTAIN] == (1.0, 0.0, 0.0)).all()

    # apart by more than rounding, each is certain
    frame = draw(data, objects=(plane, Isosurface((0.1 + 1e-10,))), camera=ASIDE, size=(16, 16))
    assert (frame.status[frame.seen] == Status.CERTAIN).mean() > 0.95


def test_a_plane_seen_edge_on_is_ambiguous(draw, cube):
    for angle, status in ((3e-9, Status.AMBIGUOUS), (1e-3, Status.CERTAIN)):
        camera = Camera((0.5, -3.0, 0.25 + 3.5 * angle), (0.5, 0.5, 0.25), height=angle)
        plane = Plane((0.5, 0.5, 0.25), (0.0, 0.0, 1.0))
        frame = draw(cube, plane=plane, camera=camera, size=(4, 9))
        assert frame.seen.any()
        assert (frame.status[frame.seen] == status).mean() > 0.5
