"""Streamlines followed on a device against those of the host, which closed forms judge."""

from types import SimpleNamespace

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.streamlines.streamlines import trace
from elvis.core.streamlines.velocity import Velocity, velocity_expressions
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple
from elvis.renderer.passes.streams import following


@pytest.fixture
def follow(renderer, monkeypatch):
    """Lines on the device, however few, and how many steps it took."""
    monkeypatch.setattr(following, "FEW", 1)

    def follow(dataset, seeds, **settings):
        taken = []

        class Counting(following.DeviceTracer):
            def _take(self, stage, lines, found):
                taken.append(int(found["count"].sum()))
                super()._take(stage, lines, found)

        monkeypatch.setattr(following, "DeviceTracer", Counting)
        device = renderer("vulkan").device
        lines = trace(dataset, seeds, make=following.Followers(lambda: device), **settings)
        return lines, sum(taken)

    return follow


def rotating(mesh, modes, climb=0.03):
    """A rotation about the middle of the unit cube, a little upwards."""
    bare, d = Dataset(mesh), mesh.dimension
    parts = {
        "u": lambda p: 0.5 - p[:, 1],
        "v": lambda p: p[:, 0] - 0.5,
        "w": lambda p: np.full(len(p), climb),
    }
    return Dataset(mesh, tuple(approximated(bare, name, parts[name], modes) for name in "uvw"[:d]))


def check_same(lines, truth):
    """Both have the same ends, and their last points are the same."""
    assert lines.counts() == truth.counts()
    assert np.array_equal(lines.end, truth.end)
    for line in range(len(truth)):
        assert np.abs(lines[line][-1] - truth[line][-1]).max() < 1e-11
    last = truth.offsets[1:] - 1, lines.offsets[1:] - 1
    assert np.abs(lines.time[last[1]] - truth.time[last[0]]).max() < 1e-10
    assert np.abs(lines.length[last[1]] - truth.length[last[0]]).max() < 1e-10
    # along the middle, where elements meet, a line is in any of them
    aside = np.abs(truth.points[last[0], :2] - 0.5).max(axis=1) > 1e-9
    assert np.array_equal(lines.element[last[1]][aside], truth.element[last[0]][aside])


@pytest.mark.parametrize("modes", [3, 5])
@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
@pytest.mark.sampled(free=("shape", "modes", "bent"))
def test_lines_match_those_of_the_host(follow, shape, bent, modes):
    d = shape.dimension
    mesh = grid(shape, 3 if d == 2 else 2)
    dataset = rotating(curved(mesh, ripple(0.05), 2) if bent else mesh, modes)
    seeds = np.array([[0.75, 0.5, 0.45], [0.55, 0.45, 0.55], [0.05, 0.05, 0.5], [0.5, 0.5, 0.1]])[:, :d]
    settings = {"duration": 9.0, "direction": "both"}
    lines, taken = follow(dataset, seeds, **settings)
    check_same(lines, trace(dataset, seeds, **settings))
    assert taken > 20
    turn = lines[0][-1, :2] - 0.5
    assert np.abs(turn - 0.25 * np.array([np.cos(9.0), np.sin(9.0)])).max() < 1e-10


@pytest.mark.thorough
def test_all_shapes_in_one_mesh(follow):
    mesh = curved(mixed_volume(1), ripple(0.02), 2)
    bare = Dataset(mesh)
    helix = {"u": lambda p: 0.3 + 0 * p[:, 0], "v": lambda p: 0.5 - p[:, 2], "w": lambda p: p[:, 1] - 0.5}
    dataset = Dataset(mesh, tuple(approximated(bare, name, own, 3) for name, own in helix.items()))
    seeds = [[0.2, 0.8, 0.5], [0.2, 0.23, 0.4], [0.1, 0.5, 0.5], [9.0, 0.0, 0.0]]
    for settings in ({}, {"length": 1.2}):
        lines, taken = follow(dataset, seeds, **settings)
        check_same_but_outside(lines, trace(dataset, seeds, **settings))
        assert taken > 0
    # where steps end depends on rounding, how many there are does not
    lines, _ = follow(dataset, seeds, steps=7)
    assert lines.counts() == {"steps": 3, "outside": 1}


def check_same_but_outside(lines, truth):
    """The same of lines of which the last one has no points."""
    assert np.array_equal(lines.end, truth.end)
    assert len(lines[len(lines) - 1]) == len(truth[len(truth) - 1]) == 0
    for line in range(len(truth) - 1):
        assert np.abs(lines[line][-1] - truth[line][-1]).max() < 1e-11


def test_lines_on_elements_of_high_order_are_followed_with_models(follow, monkeypatch):
    halves = []
    take = following.DeviceTracer._take

    def watched(self, stage, lines, found):
        halves.append(found["half"].max())
        take(self, stage, lines, found)

    monkeypatch.setattr(following.DeviceTracer, "_take", watched)
    dataset = rotating(curved(grid(Shape.HEXAHEDRON, 2), ripple(0.05), 6), 6)
    seeds, settings = [[0.75, 0.5, 0.45], [0.5, 0.15, 0.45]], {"duration": 9.0}
    lines, taken = follow(dataset, seeds, **settings)
    check_same(lines, trace(dataset, seeds, **settings))
    assert taken > 20
    assert max(halves) > 0
    turn = lines[0][-1, :2] - 0.5
    assert np.abs(turn - 0.25 * np.array([np.cos(9.0), np.sin(9.0)])).max() < 1e-10


def test_without_a_device_the_host_follows(monkeypatch):
    monkeypatch.setattr(following, "FEW", 1)
    dataset = rotating(grid(Shape.TRIANGLE, 1), 3)
    lines = trace(dataset, [[0.7, 0.5]], duration=1.0, make=following.Followers(lambda: None))
    check_same(lines, trace(dataset, [[0.7, 0.5]], duration=1.0))


def cavity(p):
    """A stream function whose lines are closed."""
    return p[:, 0] * (1 - p[:, 0]) * p[:, 1] * (1 - p[:, 1])


@pytest.mark.thorough
@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("shape", Shape.of_dimension(2))
@pytest.mark.sampled(least=2, free=("bent", "shape"))
def test_closed_orbits_stay_closed_for_a_hundred_turns(follow, shape, bent):
    mesh = curved(grid(shape, 2), ripple(0.05), 2) if bent else grid(shape, 2)
    parts = {
        "u": lambda p: p[:, 0] * (1 - p[:, 0]) * (1 - 2 * p[:, 1]),
        "v": lambda p: -(1 - 2 * p[:, 0]) * p[:, 1] * (1 - p[:, 1]),
    }
    fields = [approximated(Dataset(mesh), name, own, 7 if bent else 4) for name, own in parts.items()]
    lines, taken = follow(Dataset(mesh, tuple(fields)), [[0.5, 0.6], [0.5, 0.8]], duration=1400.0, spacing=1.0)
    assert lines.counts() == {"duration": 2}
    assert taken > 3000
    for line in range(2):
        points = lines[line]
        assert (np.diff(np.sign(points[:, 0] - 0.5)) > 0).sum() >= 100
        values = cavity(points)
        assert np.abs(values - values[0]).max() < 1e-10


@pytest.mark.thorough
def test_a_few_long_lines_continue_on_the_device(follow, monkeypatch):
    monkeypatch.setattr(following, "FEW", 1000)
    dataset = rotating(curved(grid(Shape.HEXAHEDRON, 2), ripple(0.05), 2), 4)
    seeds, settings = [[0.75, 0.5, 0.45], [0.5, 0.15, 0.45]], {"duration": 9.0}
    truth = trace(dataset, seeds, **settings)
    for long, goes_on in ((5, True), (1000, False)):
        monkeypatch.setattr(following, "LONG", long)
        lines, taken = follow(dataset, seeds, **settings)
        check_same(lines, truth)
        assert (taken > 0) == goes_on


@pytest.mark.parametrize(("count", "order", "steps"), [(128, 1, 0), (100, 1, 100), (1, 7, 100), (100, 7, 20)])
def test_the_host_takes_fewer_steps_of_many_lines_and_modes(count, order, steps):
    dataset = rotating(grid(Shape.HEXAHEDRON, 1), order + 1)
    tracer = SimpleNamespace(velocity=Velocity(dataset, velocity_expressions(dataset, None)))
    assert following.DeviceTracer._host_steps(tracer, count) == steps


@pytest.mark.parametrize(("dimension", "states"), [(2, [[1, 2, 4]]), (3, [[1, 2, 3, 4]])])
def test_states_are_coordinates_and_the_length(dimension, states):
    found = following.DeviceTracer._states(SimpleNamespace(_dimension=dimension), np.array([[1, 2, 3, 4]]))
    assert found.tolist() == states
