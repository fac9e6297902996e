"""Long work goes to the device in dispatches of bounded time: all is done once, and time limits are detected."""

import numpy as np
import pytest

from elvis import (
    Camera,
    Contours,
    CutSurface,
    Faces,
    Isosurface,
    MeshLines,
    Plane,
    Renderer,
    Scene,
    SceneError,
    Sphere,
    Style,
    Transfer,
    VolumeRendering,
)
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.renderer.device import pacing
from elvis.renderer.device.adapters import Adapter
from elvis.renderer.device.device import Kernel
from elvis.renderer.device.pacing import Pace, grid_of, rows_of
from elvis.renderer.passes.faces import faces
from elvis.scene.model import time_limit

NEAR = Camera((2.0, -1.6, 1.7), (0.5, 0.5, 0.5), fov=35.0)
PLANE = Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0))
LINES = Style(contours=Contours(count=4), mesh_lines=MeshLines())
SCENES = {
    "cut": {"plane": PLANE},
    "faces": {"objects": (Faces(style=LINES),)},
    "sphere": {"objects": (CutSurface(Sphere((0.5, 0.5, 0.5), 0.4)),)},
    "isosurface": {"objects": (Isosurface((0.5,)),)},
    "volume": {"objects": (VolumeRendering(Transfer((-3.0, 3.0), (0.0, 2.0))),)},
}


@pytest.fixture
def tiny(monkeypatch):
    """As many dispatches as there are groups."""
    monkeypatch.setattr(pacing, "AIM", 1e-300)
    monkeypatch.setattr(pacing, "FIRST", 1.0)


@pytest.fixture
def dispatches(monkeypatch):
    """A list that grows with each dispatch, and what is called with its length before."""
    made, before = [], [lambda number: None]
    plain = Kernel._dispatch

    def dispatch(self, *arguments):
        before[0](len(made))
        made.append(arguments[:2])
        return plain(self, *arguments)

    monkeypatch.setattr(Kernel, "_dispatch", dispatch)
    return made, before


class Clock:
    """Time that passes only as it is told to."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


@pytest.mark.parametrize("seconds", [0.0, 1e-6, 1e-3, 3.0])
def test_every_group_is_in_one_dispatch(monkeypatch, seconds):
    clock, pace = Clock(), Pace()
    monkeypatch.setattr(pacing, "perf_counter", clock)
    for count, work in (
        (1, None),
        (2, None),
        (700, None),
        (700, np.arange(700)),
        (500, np.zeros(500, np.uint32)),
        (0, None),
    ):
        end = 0
        for first, after in pace.batches(count, work):
            assert first == end < after <= count
            end = after
            clock.now += seconds
        assert end == count


def test_dispatch_sizes_follow_measured_work(monkeypatch):
    """The groups in the middle take a thousand times as long as all others; their work says fifty times."""
    clock, pace, taken = Clock(), Pace(), []
    monkeypatch.setattr(pacing, "perf_counter", clock)
    work = np.where(np.abs(np.arange(4000) - 2000) < 500, 100, 1)
    cost = 1e-4 * np.where(work > 1, 1000.0, 1.0)
    for _ in range(2):
        for first, end in pace.batches(len(work), work):
            taken.append(cost[first:end].sum())
            clock.now += taken[-1]
    assert max(taken) < 21 * pacing.AIM
    assert len(taken) < 3 * sum(taken) / pacing.AIM


@pytest.mark.parametrize(
    ("shape", "name"),
    [*((Shape.HEXAHEDRON, name) for name in SCENES), (Shape.TETRAHEDRON, "isosurface"), (Shape.TETRAHEDRON, "volume")],
)
def test_a_picture_in_many_dispatches_is_the_same(draw, linear, dispatches, tiny, monkeypatch, shape, name):
    dataset, scene = linear(grid(shape, 2)), SCENES[name]
    many = draw(dataset, camera=NEAR, size=(40, 30), **scene)
    count = len(dispatches[0])
    monkeypatch.setattr(pacing, "AIM", 1e300)
    monkeypatch.setattr(pacing, "FIRST", 1e300)
    whole = draw(dataset, camera=NEAR, size=(40, 30), **scene)
    assert len(dispatches[0]) - count < count / 2
    for channel in ("element", "status", "field", "depth", "color"):
        assert np.array_equal(getattr(many, channel), getattr(whole, channel), equal_nan=True), channel


@pytest.mark.parametrize("shares", [2, 7])
@pytest.mark.parametrize("count", [1, 5, 400, 1001])
def test_shares_have_similar_work(shares, count):
    """Rows take turns at what rises, what is even stays; here a share is a column and two turns longer at most."""
    for work in (np.arange(count) ** 2, np.full(count, 3)):
        columns, rows, turn = grid_of(count, rows_of(work, shares))
        grid, number = np.zeros((rows, columns)), np.arange(count)
        grid[number // turn % rows, number // (turn * rows) * turn + number % turn] = work
        amounts = [share.sum() for share in np.array_split(grid.reshape(-1), shares)]
        assert max(amounts) <= 1.1 * work.sum() / shares + 2 * turn * work.max()
    assert rows_of(np.full(100 * count, 3), shares) == 1


@pytest.mark.thorough
@pytest.mark.parametrize(("shares", "row"), [(1, 7), (3, 32768), (64, 5)])
def test_pictures_are_independent_of_the_distribution_of_groups(draw, cube, monkeypatch, shares, row):
    """Grids of one row or several, also where the last column isn't full."""
    monkeypatch.setattr(Adapter, "shares", shares)
    monkeypatch.setattr(pacing, "UNEVEN", 0.0)
    monkeypatch.setattr(pacing, "TURNS", 1)
    monkeypatch.setattr(pacing, "GROUPS_IN_ROW", row)
    with Renderer("vulkan") as drawing:
        drawing.load(cube, "u")
        for own in SCENES.values():
            whole = draw(cube, camera=NEAR, size=(40, 30), **own)
            shared = drawing.render(Scene("u", camera=NEAR, size=(40, 30), **own))
            for channel in ("element", "status", "field", "depth", "color"):
                assert np.array_equal(getattr(shared, channel), getattr(whole, channel), equal_nan=True), channel


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_time_limits_are_checked_within_a_step(draw, cube, dispatches, tiny, monkeypatch, scene):
    """Each dispatch takes a second of a clock of its own."""
    made, before = dispatches
    clock = Clock()
    before[0] = lambda number: setattr(clock, "now", clock.now + 1.0)
    monkeypatch.setattr(time_limit, "perf_counter", clock)
    with pytest.raises(SceneError, match="exceeded the time limit of 4 s"):
        draw(cube, camera=NEAR, size=(40, 30), timeout=4.0, **scene)
    assert len(made) == 5


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES)
def test_after_an_interrupt_the_next_picture_is_right(renderer, cube, dispatches, tiny, scene):
    drawing = renderer("vulkan")
    drawing.load(cube, "u")
    scene = Scene("u", camera=NEAR, size=(40, 30), **scene)
    whole = drawing.render(scene)
    made, before = dispatches
    for moment in (0, 3, 7):
        drawing.load(cube, "u")

        last = len(made) + moment

        def interrupt(number, last=last):
            if number == last:
                raise KeyboardInterrupt

        before[0] = interrupt
        with pytest.raises(KeyboardInterrupt):
            drawing.render(scene)
        before[0] = lambda number: None
        again = drawing.render(scene)
        assert np.array_equal(again.element, whole.element)
        assert np.array_equal(again.color, whole.color)


def test_faces_are_subdivided_again_after_an_interrupt(renderer, cube, monkeypatch):
    drawing = renderer("vulkan")
    drawing.load(cube, "u")
    scene = Scene("u", camera=NEAR, size=(40, 30), objects=(Faces(),))
    plain = faces.face_patches

    def interrupted(space, nets, view):
        raise KeyboardInterrupt

    monkeypatch.setattr(faces, "face_patches", interrupted)
    with pytest.raises(KeyboardInterrupt):
        drawing.render(scene)
    monkeypatch.setattr(faces, "face_patches", plain)
    assert drawing.render(scene).seen.any()


def test_the_time_limit_is_checked_while_faces_are_subdivided(draw, cube, dispatches, monkeypatch):
    clock, plain = Clock(), faces.face_patches

    def late(space, nets, view):
        clock.now += 5.0
        return plain(space, nets, view)

    monkeypatch.setattr(faces, "face_patches", late)
    monkeypatch.setattr(time_limit, "perf_counter", clock)
    with pytest.raises(SceneError, match="exceeded the time limit of 4 s"):
        draw(cube, camera=NEAR, size=(40, 30), objects=(Faces(),), timeout=4.0)
    assert not dispatches[0]
