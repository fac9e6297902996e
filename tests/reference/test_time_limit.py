"""The time limit of pictures that the reference draws."""

from itertools import count

import pytest

from elvis.core.shapes import Shape
from elvis.core.testing import grid, with_field
from elvis.reference import places
from elvis.reference.picture import render
from elvis.renderer.asking.completing import completed
from elvis.scene import Camera, Contours, CutSurface, Faces, Isosurface, Plane, Scene, Sphere, Style
from elvis.scene.model import time_limit
from elvis.scene.model.errors import SceneError

PLANE = Plane((0.5, 0.5, 0.52), (0.0, 0.0, 1.0))
CAMERA = Camera((2.5, -1.5, 3.0), (0.5, 0.5, 0.5), height=1.2)
OBJECTS = {
    "a plane": None,
    "contours": CutSurface(PLANE, Style(contours=Contours((0.3,)))),
    "a sphere": CutSurface(Sphere((0.5, 0.5, 0.5), 0.4)),
    "faces": Faces(),
    "an isosurface": Isosurface((0.3,)),
}


@pytest.fixture(scope="module")
def data():
    return with_field(grid(Shape.HEXAHEDRON, 2), lambda points: (points**2).sum(axis=-1), 3)


def scene_of(name, **options):
    shown = OBJECTS[name]
    own = {"plane": PLANE} if shown is None else {"objects": (shown,)}
    return Scene("u", camera=CAMERA, size=(30, 20), **own, **options)


@pytest.mark.sampled
@pytest.mark.parametrize("name", OBJECTS)
@pytest.mark.parametrize("samples", [1, 2])
def test_slow_pictures_are_abandoned(data, name, samples):
    with pytest.raises(SceneError, match="exceeded the time limit of 1e-09 s"):
        render(data, completed(data, scene_of(name, timeout=1e-9, samples=samples)))
    assert render(data, completed(data, scene_of(name, timeout=1e6))).seen.any()
    assert render(data, completed(data, scene_of(name))).seen.any()


@pytest.mark.parametrize(("name", "looks"), [("contours", 20), ("a sphere", 6), ("faces", 20), ("an isosurface", 50)])
def test_the_time_limit_is_checked_within_long_steps(data, name, looks, monkeypatch):
    """By a clock that goes on by a second whenever it is asked."""
    clock = count()
    monkeypatch.setattr(places, "_AT_ONCE", 50)
    monkeypatch.setattr(time_limit, "perf_counter", lambda: float(next(clock)))
    with pytest.raises(SceneError, match="exceeded the time limit"):
        render(data, completed(data, scene_of(name, timeout=float(looks))))
    assert next(clock) == looks + 2
