"""Pictures of particles in series: paths as tubes, streaks as balls, against closed forms."""

from functools import partial

import numpy as np
import pytest

from elvis import Glyphs, Streamlines, Style, open_series, read, render, write
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.scene.model.errors import SceneError

TIMES = (0.0, 0.5, 1.1, 1.6)
RADIUS = 0.03


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A series on curved quadrilaterals: u = 0.3, v = 0.6 t - 0.4."""
    folder = tmp_path_factory.mktemp("paths")
    mesh = curved(grid(Shape.QUADRILATERAL, 2), ripple(0.03), 3)
    write(Dataset(mesh), folder / "mesh.xml")
    (folder / "mesh.fld").unlink(missing_ok=True)
    found = [folder / "mesh.xml"]
    for number, time in enumerate(TIMES):
        values = {"u": 0.3, "v": 0.6 * time - 0.4}
        fields = tuple(approximated(Dataset(mesh), name, partial(_same, own), 2) for name, own in values.items())
        found.append(folder / f"run_{number}.chk")
        write(Dataset(mesh, fields, time), field_path=found[-1])
    return found


def _same(value, points):
    return np.full(len(points), value)


def place(release, time):
    """(n, 2) where particles of the seed (0.3, 0.5) are at a time."""
    y = 0.3 * (time**2 - release**2) - 0.4 * (time - release)
    return np.stack([0.3 + 0.3 * (time - release), 0.5 + y], axis=-1)


@pytest.mark.parametrize("device", ["vulkan", "reference"])
def test_pathlines_and_streaklines_match_particles(device, files, renderer):
    renderer("vulkan")
    look = {"time": 1.3, "camera": "top", "size": (120, 120), "device": device}
    for releases, places in (
        (None, place(0.2, np.linspace(0.2, 1.3, 2001))),
        (12, place(np.linspace(0.2, 1.3, 12), 1.3)),
    ):
        lines = Streamlines(("point:0.3,0.5",), radius=RADIUS, since=0.2, releases=releases, style=Style(quantity="u"))
        frame = render(*files, objects=[lines], **look)
        assert frame.seen.any()
        seen = frame.position[frame.seen]
        # what is seen from above lies on the balls: as high as the nearest one below it
        apart = np.linalg.norm(seen[:, None, :2] - places[None], axis=2).min(axis=1)
        slack = 1e-9 if releases else 1e-6
        assert np.abs(np.sqrt(RADIUS**2 - np.minimum(apart, RADIUS) ** 2) - seen[:, 2]).max() < 1e-3 * RADIUS + slack
        assert apart.max() < RADIUS * (1 + 1e-4)
        area = frame.seen.sum()
        assert area > 100


def test_an_animation_begins_with_the_seeds(files, renderer):
    renderer("vulkan")
    lines = Streamlines(("point:0.3,0.5",), radius=RADIUS, since=0.5)
    frame = render(*files, objects=[lines], time=0.5, camera="top", size=(120, 120))
    seen = frame.position[frame.seen]
    assert len(seen) > 20
    assert np.linalg.norm(seen - (0.3, 0.5, 0), axis=1) == pytest.approx(RADIUS, abs=1e-10)


def test_data_without_paths(files):
    for settings, given, sentence in (
        ({"since": 0.2, "wall": "all"}, {}, "since: expected no wall, ribbon, arrows, duration and direction with it"),
        ({"releases": 5}, {}, "releases: expected since with it"),
        ({"since": 9.0}, {"time": 1.0}, "expected a time from 0 to 1.6, found 9"),
        (
            {"since": 1.2, "releases": 5},
            {"time": 1.0},
            "since: expected a time up to that of the picture, 1, found 1.2",
        ),
        ({"since": 0.2}, {"time": 1.0, "between": "nearest"}, "paths: expected linear or cubic between steps"),
    ):
        with pytest.raises(SceneError, match=sentence):
            render(*files, objects=[Streamlines(("point:0.3,0.5",), **settings)], device="reference", **given)
    still = read(files[0], files[1])
    with pytest.raises(SceneError, match="since: expected a moment of a series, found one state"):
        render(still, objects=[Streamlines(("point:0.3,0.5",), since=0.0)], device="reference")
    assert len(open_series(*files)) == 4


@pytest.mark.thorough
def test_animations_read_the_fields_of_default_velocities(files, tmp_path):
    """Of native files only fields that are needed are read: u is drawn, lines, arrows and streaks need v as well."""
    lines = Streamlines(("point:0.3,0.5",), radius=RADIUS)
    arrows = Glyphs(("plane:0,0,0:0,0,1:4",), length=0.1)
    frame = render(*files, "u", objects=[lines, arrows], time=1.3, size=(24, 24), camera="top", device="reference")
    assert frame.seen.any()
    assert render(*files, "u", lic=True, time=1.3, size=(24, 24), device="reference").seen.any()
