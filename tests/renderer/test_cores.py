"""Vortex cores in pictures: tubes about them are where closed forms have them, on every device."""

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from elvis import Camera, Scene, Streamlines, Style, render, write
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.plugins.command.command import elvis
from elvis.scene.model.errors import SceneError
from elvis.scene.model.files import read_scene

CENTRE = np.array([0.45, 0.52, 0.5])
AXIS = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])
RADIUS = 0.03


def vortex(shape, bend):
    """A rigid rotation with a speed along its axis, in curved elements."""
    mesh = curved(grid(shape, 1), ripple(bend), 3)
    bare = Dataset(mesh)

    def component(axis):
        return lambda p: (np.cross(AXIS, p - CENTRE) + AXIS)[:, axis]

    return Dataset(mesh, tuple(approximated(bare, name, component(axis), 4) for axis, name in enumerate("uvw")))


@pytest.fixture(scope="module")
def bent():
    """What is found once in these data, others draw, too; cores of all shapes are in tests/formats."""
    return vortex(Shape.PRISM, 0.04)


@pytest.mark.thorough
@pytest.mark.parametrize("device", ["auto", "reference"])
def test_tubes_around_a_tilted_axis(bent, device):
    lines = Streamlines(cores="acceleration", radius=RADIUS, style=Style(quantity="w"))
    camera = Camera((3.0, -2.0, 1.2), (0.5, 0.5, 0.5), height=1.4)
    frame = render(bent, objects=[lines], camera=camera, size=(48, 48), device=device)
    hits = frame.position[frame.status == 1]
    offset = hits - CENTRE
    height = offset @ AXIS
    away = np.linalg.norm(offset - np.outer(height, AXIS), axis=1)
    # those next to the ends are on the balls there
    inner = np.abs(height) < 0.8 * np.abs(height).max()
    assert inner.sum() > 40
    assert away[inner] == pytest.approx(RADIUS, abs=1e-7)
    assert away.max() <= RADIUS + 1e-7


def test_invalid_cores_are_reported():
    mesh = grid(Shape.HEXAHEDRON, 1)
    bare = Dataset(mesh)
    still = Dataset(mesh, tuple(approximated(bare, name, lambda p: 1.0 + 0 * p[:, 0], 2) for name in "uvw"))
    with pytest.raises(SceneError, match="vortex cores: none has the requested swirl and length"):
        render(still, objects=[Streamlines(cores="vorticity")], size=(16, 16))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"seeds": ("random:3",), "cores": "vorticity"}, "found seeds"),
        ({"cores": "vorticity", "ribbon": 0.1, "wall": "all"}, "found wall, ribbon|ribbons"),
        ({"seeds": ("random:3",), "min_swirl": 1.0}, "expected cores with min_swirl"),
        ({}, "seeds of streamlines: expected at least one"),
    ],
)
def test_incompatible_settings(settings, words):
    with pytest.raises(SceneError, match=words):
        Scene("u", objects=(Streamlines(**settings),))


def test_an_option(tmp_path):
    write(vortex(Shape.HEXAHEDRON, 0.0), tmp_path / "a.xml", tmp_path / "a.fld")
    text = "cores=acceleration;radius=0.05;min_length=0.2"
    words = [tmp_path / "a.xml", tmp_path / "a.fld", "--streamlines", text, "--size", "24x24", "-o", tmp_path / "a.png"]
    command = ["render", *map(str, words), "--save-scene", str(tmp_path / "a.toml")]
    outcome = CliRunner().invoke(elvis, command, standalone_mode=False)
    assert outcome.exception is None
    (shown,) = read_scene(tmp_path / "a.toml").objects
    assert shown == Streamlines(cores="acceleration", radius=0.05, min_length=0.2)
    assert len(np.unique(np.asarray(Image.open(tmp_path / "a.png")).reshape(-1, 3), axis=0)) > 5
