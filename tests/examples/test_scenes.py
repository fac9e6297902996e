"""The scenes of the paper's figures: they can be read, their data made, and the folded element is drawn right."""

import importlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elvis import read, render
from elvis.scene.model.files import read_scene

ROOT = Path(__file__).resolve().parents[2]
SCENES = sorted((ROOT / "examples" / "scenes").glob("*.toml"))


def test_every_figure_has_scenes():
    names = {path.stem for path in SCENES}
    assert {"wing_pressure", "delta_isosurface", "delta_vortex", "hemisphere", "folded"} <= names
    assert {"distance_right", "distance_wrong", "together", "twist"} <= names


@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_every_scene_can_be_read_and_its_data_generated(path, monkeypatch):
    pytest.importorskip("gmsh")
    monkeypatch.syspath_prepend(ROOT / "examples")
    cases = importlib.import_module("cases").CASES
    scene = read_scene(path)
    sources = importlib.import_module("page_data").SOURCES
    for path_of_data in map(Path, scene.data):
        assert (
            path_of_data.stem in cases
            or path_of_data.name in sources
            or path_of_data.match("out/pages/ethier0.f00001")
            or path_of_data.match("out/street/street*")
        )
    assert scene.objects
    assert path.read_text().startswith("# ")


@pytest.mark.parametrize("path", [path for path in SCENES if (ROOT / "docs" / f"{path.stem}.png").exists()])
def test_pictures_of_the_gallery_are_small(path):
    assert (ROOT / "docs" / f"{path.stem}.png").stat().st_size < 300_000


def test_the_folded_element_is_drawn_where_it_is_and_shows_its_jacobian(tmp_path, monkeypatch):
    """Its field is 1 - 2.4 x' at the reference point x' of each pixel, which the map carries to the pixel's place."""
    pytest.importorskip("gmsh")
    monkeypatch.syspath_prepend(ROOT / "examples")
    importlib.import_module("cases").write_case("folded", tmp_path, quick=True)
    scene = replace(read_scene(ROOT / "examples" / "scenes" / "folded.toml"), size=(90, 76), samples=1, data=())
    frame = render(read(tmp_path / "folded.xml", tmp_path / "folded.fld"), scene)
    x, y, z = (1 + frame.reference[frame.seen].T) / 2
    assert frame.seen.mean() > 0.1
    assert frame.field[frame.seen] == pytest.approx(1 - 2.4 * x, abs=1e-10)
    assert frame.field[frame.seen].min() < -1
    place = np.stack([x, y, z + 2.4 * x * (1 - x - y - z)], axis=-1)
    assert frame.position[frame.seen] == pytest.approx(place, abs=1e-10)
    assert np.minimum.reduce([x, y, z, 1 - x - y - z]) == pytest.approx(0, abs=1e-10)
    assert not frame.counts()["failed"]
