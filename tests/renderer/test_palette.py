"""Colour maps: those of the first ElVis by name and as files in its layout."""

import numpy as np
import pytest

from elvis import ColorBar, Scene, SceneError
from elvis.core.base.errors import FormatError
from elvis.scene.model.files import read_scene, write_scene
from elvis.scene.record.palette import FIRST, STEPS, Palette, levels, points_in

#: the layout of the first ElVis
RAINBOW = """<ColorMap name="Rainbow" space="RGB">
  <Point x="0" o="0.5" r="0" g="0" b="1"/>
  <Point x=".25" o="0.5" r="0" g="1" b="1"/>
  <Point x=".5" o="0.5" r="0" g="1" b="0"/>
  <Point x=".75" o="0.5" r="1" g="1" b="0"/>
  <Point x="1" o="0.5" r="1" g="0" b="0"/>
  <NaN r="0.498039" g="0.498039" b="0.498039"/>
</ColorMap>
"""


@pytest.fixture
def rainbow(tmp_path):
    path = tmp_path / "rainbow.xml"
    path.write_text(RAINBOW)
    return str(path)


def test_a_file_of_the_first_elvis_is_its_colour_map(rainbow):
    assert points_in(rainbow) == FIRST["elvis:rainbow"]
    found, named = (Palette.of_name(name, -2.0, 3.0) for name in (rainbow, "elvis:rainbow"))
    assert np.array_equal(found.table, named.table)
    assert found.table.shape == (STEPS, 3)
    assert np.abs(found.colors(np.array([-2.0, 0.5, 3.0])) - [[0, 0, 1], [0, 1, 0], [1, 0, 0]]).max() < 0.01


@pytest.mark.parametrize("name", [*FIRST, "elvis:diverging"])
def test_the_first_elvis_has_five(name):
    assert Palette.of_name(name, 0.0, 1.0).table.shape == (STEPS, 3)


def test_places_beyond_the_unit_interval_are_scaled(tmp_path):
    """As in ParaView's presets, which wrap maps in a list."""
    path = tmp_path / "preset.xml"
    path.write_text('<ColorMaps><ColorMap><Point x="-3" r="0" g="0" b="0"/><Point x="5" r="1" g="1" b="1"/>'
                    "</ColorMap></ColorMaps>")  # fmt: skip
    assert points_in(str(path)) == [(0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 1.0, 1.0)]


def test_scenes_refer_to_files_next_to_them(rainbow, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path.parent)
    scene = Scene("u", palette=rainbow)
    write_scene(scene, tmp_path / "scene.toml")
    assert 'palette = "rainbow.xml"' in (tmp_path / "scene.toml").read_text()
    assert Palette.of_name(read_scene(tmp_path / "scene.toml").palette, 0, 1).table[0].tolist() == [0, 0, 1]
    (tmp_path / "plain.toml").write_text('palette = "magma"')
    assert read_scene(tmp_path / "plain.toml").palette == "magma"


BOMB = '<!DOCTYPE x [<!ENTITY a "b"><!ENTITY c "&a;&a;">]><ColorMap>&c;</ColorMap>'


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "no element found"),
        ("<ColorMap", "unclosed token"),
        ("<Other/>", "found none"),
        ("<ColorMap/>", "expected points of ascending x"),
        (BOMB, "a document type declaration"),
        (BOMB.replace("<!DOCTYPE", f"<!--{'x' * (1 << 20)}-->"), "more than a mebibyte"),
        (RAINBOW.replace("RGB", "HSV"), "found the space HSV"),
        (RAINBOW.replace('g="1" ', ""), "a point without 'g'"),
        (RAINBOW.replace('x=".5"', 'x="a"'), "could not convert string to float"),
        (RAINBOW.replace('x=".5"', 'x="nan"'), "expected points of ascending x"),
        (RAINBOW.replace('x=".5"', 'x=".1"'), "expected points of ascending x"),
        (RAINBOW.replace('r="1"', 'r="255"'), "r, g, b from 0 to 1"),
    ],
)
def test_invalid_colour_maps_are_reported(tmp_path, text, sentence):
    path = tmp_path / "map.xml"
    path.write_text(text)
    with pytest.raises(SceneError, match=sentence) as said:
        Palette.of_name(str(path), 0.0, 1.0)
    assert str(said.value).startswith(str(path))


def test_a_missing_file_is_reported(tmp_path):
    with pytest.raises(FormatError, match=r"nowhere\.xml: there is no such file"):
        Palette.of_name(str(tmp_path / "nowhere.xml"), 0.0, 1.0)
    (tmp_path / "binary.xml").write_bytes(b"\xff\xfe<\x00")
    with pytest.raises(SceneError, match="expected a ColorMap of RGB points"):
        Palette.of_name(str(tmp_path / "binary.xml"), 0.0, 1.0)


def test_round_bands_end_where_round_contours_lie():
    palette = Palette.of_name("viridis", -0.93, 0.41).over_range(ColorBar(bands=8, round=True))
    assert np.allclose(palette.edges, [-0.8, -0.6, -0.4, -0.2, 0, 0.2], rtol=0, atol=1e-15)
    assert np.array_equal(palette.edges, levels(-0.93, 0.41, 7, is_round=True))
    assert len(palette.table) == 7
    assert len(levels(0.0, 1.0, 5, is_round=True)) == 4
    assert len(levels(0.0, 1.0, 7, is_round=True)) == 9
    assert len(levels(-3.0, 3.0, 10, is_round=True)) == 11
    # a range that is too narrow for round values has one in the middle
    assert levels(1.0, np.nextafter(1.0, 2), 5, is_round=True).shape == (1,)
