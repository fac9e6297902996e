"""Pictures requested from Python by the command line's names: the same scenes, and hints where names are wrong."""

from dataclasses import replace
from pathlib import Path

import click
import numpy as np
import pytest

from elvis import (
    Camera,
    Clip,
    ColorBar,
    Contours,
    CutSurface,
    Dataset,
    Faces,
    Isosurface,
    Light,
    MeshLines,
    Plane,
    Scene,
    SceneError,
    Shape,
    Sphere,
    render,
    write,
)
from elvis.core.data.mesh import Composite
from elvis.core.testing import approximated, grid
from elvis.scene.commandline.composing import composed
from elvis.scene.commandline.keywords import ELSEWHERE, KeywordError, keywords, scene_of_keywords
from elvis.scene.commandline.options import scene_options
from elvis.scene.commandline.other_programs import INSTEAD, SAME, in_own_words
from elvis.scene.model.surfaces import Middle

POINT, NORMAL = (0.0, 0.0, 0.5), (0.0, 0.0, 1.0)
CUT = Plane(POINT, NORMAL)


@pytest.fixture(scope="module")
def cube():
    bare = Dataset(grid(Shape.HEXAHEDRON, 1))
    functions = {"u": lambda x: x[:, 0], "v": lambda x: x[:, 1], "w": lambda x: x[:, 2]}
    return replace(bare, fields=tuple(approximated(bare, name, f, modes=3) for name, f in functions.items()))


def test_every_option_of_the_command_line_is_a_keyword():
    names = {name for option in scene_options(()) for name in option.opts if name.startswith("--")}
    here = {name[2:].replace("-", "_") for name in names} - {"panels", "stats"}
    assert len(here) > 30
    assert here <= keywords().keys()


@pytest.mark.parametrize(
    ("option", "text", "given", "value"),
    [
        ("plane", "0,0,0.5:0,0,1", "plane", (POINT, NORMAL)),
        ("plane", "0,0,0.5:0,0,1", "plane", CUT),
        ("plane", "0,0,0.5:0,0,1", "plane", (np.array(POINT), np.array(NORMAL))),
        ("plane", "0,0,0.5:0,0,1", "plane", "0,0,0.5:0,0,1"),
        ("plane", "z=0.5", "plane", "z=0.5"),
        ("plane", "z", "plane", "middle:z"),
        ("plane", "z", "plane", "plane:z"),
        ("cut", "z", "cut", "middle:z"),
        ("plane", "0,0,0.5:0,0,1", "plane", "z = 0.5"),
        ("plane", "0,-2e-1,0:0,1,0", "slice", {"y": -0.2}),
        ("cut", "plane:z=0.5", "cut", CUT),
        ("clip", "outside:z=0.5", "clip", Clip(CUT, "outside")),
        ("streamlines", "random:100", "streamplot", "random:100"),
        ("streamlines", "100", "streamlines", 100),
        ("size", "60x60", "window_size", 60),
        ("size", "60,40", "window_size", (60, 40)),
        ("field", "u", "scalars", "u"),
        ("range", "0:1", "clim", (0, 1)),
        ("palette", "turbo", "cmap", "turbo"),
        ("mesh_lines", True, "show_edges", True),
        ("camera", "-x", "cpos", "-x"),
        ("camera", "top", "camera", "xy"),
        ("contours", "10", "levels", 10),
        ("contours", "10", "contours", 10),
        ("contours", "10", "contours", np.int64(10)),
        ("contours", "0.1,0.5", "contours", [0.1, 0.5]),
        ("contours", "0.1,0.5:labels", "contours", {"values": (0.1, 0.5), "labels": True}),
        ("contours", "9:even:labels", "contours", {"count": 9, "round": False, "labels": True}),
        ("palette", "turbo", "colormap", "turbo"),
        ("palette", "turbo", "palette", "turbo"),
        ("camera", "top", "camera", "top"),
        ("camera", "3,0,0:0,0,0", "camera", ((3, 0, 0), (0, 0, 0))),
        ("camera", "3,0,0:0,0,0:0,1,0:30", "camera", Camera((3, 0, 0), (0, 0, 0), (0, 1, 0), 30)),
        ("range", "0:1", "range", (0, 1)),
        ("range", "all", "range", "all"),
        ("size", "60x40", "size", [60, 40]),
        ("isosurface", "0.2,0.4", "isosurface", (0.2, 0.4)),
        ("isosurface", "0.2", "isosurface", 0.2),
        ("isosurface", "v=0.2", "isosurface", {"v": 0.2}),
        ("faces", "wall,inlet", "faces", ["wall", "inlet"]),
        ("faces", "all", "faces", "all"),
        ("cut", "sphere:0,0,0:1", "cut", Sphere((0, 0, 0), 1.0)),
        ("cut", "sphere:0,0,0:1", "cut", "sphere:0,0,0:1"),
        ("clip", "outside:sphere:0,0,0:1", "clip", [Clip(Sphere((0, 0, 0), 1.0), "outside")]),
        ("lights", "1,0,0", "light", (1, 0, 0)),
        ("lights", "1,0,0", "lights", [(1, 0, 0)]),
        ("mesh_lines", True, "mesh_lines", True),
        ("mesh_lines", True, "mesh_lines", MeshLines()),
        ("opacity", "0.5", "opacity", 0.5),
        ("lit", False, "lit", False),
        ("color", "red", "color", (1, 0, 0)),
        ("color", "red", "color", "red"),
        ("background", "transparent", "background", (1, 1, 1, 0)),
        ("region", "0:1,2:3", "region", ((0, 1), (2, 3))),
        ("bar", "unit=Pa,bands=8", "bar", {"unit": "Pa", "bands": 8}),
        ("volume", "0:1,1:2", "volume", "0:1,1:2"),
        ("reader", "step=3", "reader", {"step": 3}),
    ],
)
def test_keywords_match_options(option, text, given, value):
    """The option's text goes the way of the command line, by click."""
    own = next(each for each in scene_options(()) if each.name == option)
    context = click.Context(click.Command("render", params=[own]))
    flag = next(name for name in own.opts if name.startswith("--"))
    arguments = [flag, text] if isinstance(text, str) else [flag] if text else [flag.replace("--lit", "--unlit")]
    parsed = context.command.make_context("render", arguments).params
    assert scene_of_keywords({given: value}) == composed((), parsed, ())


def test_every_term_of_other_programs_maps_to_an_option():
    """None hides a keyword of ElVis, and each stands for one, or its advice names one."""
    known = keywords()
    assert not (SAME.keys() | INSTEAD.keys()) & known.keys()
    assert not SAME.keys() & INSTEAD.keys()
    assert set(SAME.values()) <= known.keys()
    options = {"--plane", "--colormap", "--mesh-lines"}
    words = ["--slice=z=1", "--cmap", "--clim", "--show-edges", "a.xml", "--", "--cmap"]
    own = ["--plane=z=1", "--colormap", "--clim", "--mesh-lines", "a.xml", "--", "--cmap"]
    assert in_own_words(words, options) == own
    assert in_own_words(["--slice", "3"], {"--slice", "--plane"}) == ["--slice", "3"]


def test_several_of_one_kind():
    planes = scene_of_keywords({"plane": [(POINT, NORMAL), "0,0,0:1,0,0"]})
    assert planes.objects == (CutSurface(CUT), CutSurface(Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))))
    assert len(scene_of_keywords({"isosurface": [{"u": 0.1}, {"v": 0.2}]}).objects) == 2
    assert len(scene_of_keywords({"light": [(1, 0, 0), Light()]}).lights) == 2


def test_an_axis_is_the_plane_through_the_middle(cube):
    low, high = cube.mesh.corners
    point = tuple((0.5 * (low + high)).tolist())
    for given, clips in (({"plane": "y"}, 0), ({"plane": "y", "clip": "x"}, 1)):
        frame = render(cube, "u", **given, size=(30, 20), device="reference")
        (cut,) = frame.scene.every_object
        assert cut.surface == Plane(point, (0.0, 1.0, 0.0))
        assert [own.surface for own in frame.scene.clip] == [Plane(point, (1.0, 0.0, 0.0))] * clips
    with pytest.raises(SceneError, match="axis of a plane through the middle: expected x, y or z, found 't'"):
        Middle("t")


@pytest.mark.parametrize("device", ["vulkan", "reference"])
def test_faces_of_2d_data_are_elements(device):
    square = Dataset(grid(Shape.QUADRILATERAL, 2))
    ids = square.mesh.domain_ids()
    own = Composite(7, (("Q", ids[:1]),), "corner")
    square = Dataset(replace(square.mesh, composites=(*square.mesh.composites, own)))
    look = {"camera": Camera((0.5, 0.5, 1.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=1.0), "size": (16, 16)}
    frame = render(square, "x", faces=f"region:corner,element:{ids[3]}", **look, device=device)
    seen, counts = np.unique(frame.element, return_counts=True)
    assert dict(zip(seen.tolist(), counts.tolist(), strict=True)) == {-1: 128, int(ids[0]): 64, int(ids[3]): 64}
    with pytest.raises(SceneError, match=r"faces of 2D data are their elements: expected all, .*, found 'boundary'"):
        render(square, "x", faces="boundary", **look, device=device)


def test_settings_of_bars_are_true_or_false():
    shown = [scene_of_keywords({"bar": f"bands=3,round={text}"}).bar for text in ("true", "false")]
    assert shown == [ColorBar(bands=3), ColorBar(bands=3, round=False)]
    with pytest.raises(SceneError, match="expected true or false, found 'yes'"):
        scene_of_keywords({"bar": "round=yes"})


def test_styles_apply_to_every_object():
    scene = scene_of_keywords({"plane": CUT, "isosurface": 0.5, "contours": 4, "opacity": 0.5})
    assert [item.style.contours for item in scene.every_object] == [Contours(count=4)] * 2
    assert [type(item) for item in scene.every_object] == [CutSurface, Isosurface]


def test_models_of_scenes_are_not_modified():
    objects = (Faces(("wall",)), Isosurface((0.5,), "v"))
    made = scene_of_keywords({"field": "u", "objects": objects, "bar": ColorBar(unit="Pa"), "samples": 2})
    assert made == Scene("u", objects=objects, bar=ColorBar(unit="Pa"), samples=2)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("colour", "did you mean color?"),
        ("colourmap", "did you mean colormap?"),
        ("Colormap", "did you mean colormap?"),
        ("contour", "contours draws lines, isosurface draws surfaces"),
        ("isosurfac", "did you mean isosurface?"),
        ("vmax", "range holds both ends"),
        ("threshold", "clip hides a region"),
        ("zzz", "there are ambient, axes, background, bar"),
        *((name, advice) for name, advice in ELSEWHERE.items()),
    ],
)
def test_wrong_keywords_get_hints(cube, name, told):
    with pytest.raises(KeywordError) as raised:
        render(cube, **{name: 1})
    assert told in str(raised.value)
    assert isinstance(raised.value, TypeError)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"plane": 0.2}, "plane: expected an axis with the value, such as 'z=0.2', found 0.2"),
        ({"plane": ((0, 0), (0, 0, 1))}, "plane: expected POINT:NORMAL"),
        ({"plane": "0,0:1"}, "plane: expected"),
        ({"plane": (POINT, (0, 0, 0))}, "must be a direction"),
        ({"contours": True}, "contours: expected N|V,V[:…]"),
        ({"contours": "many"}, "contours: expected numbers"),
        ({"camera": "Top"}, "found 'Top' (perhaps top)"),
        ({"camera": 3}, "camera: expected VIEW"),
        ({"opacity": 2}, "opacity: expected a number above 0 and at most 1, found 2"),
        ({"opacity": "half"}, "opacity: expected"),
        ({"size": (100,)}, "size: expected"),
        ({"plane": {"w": 0.2}}, "plane: expected"),
        ({"range": (1, 0)}, "range: expected a colour range from a smaller"),
        ({"zoom": "near"}, "zoom: expected a finite number, found 'near'"),
        ({"samples": 1.5}, "samples: expected a whole number, found 1.5"),
        ({"colormap": "turbo", "palette": "gray"}, "given twice"),
        ({"colormap": "Turbbo"}, "unknown colour map 'Turbbo' (perhaps turbo)"),
        ({"bar": {"units": "Pa"}}, "bar: ColorBar has no keyword 'units': did you mean unit?"),
        ({"field": "sped"}, "(perhaps speed)"),
    ],
)
def test_wrong_values_are_reported_by_name(cube, given, told):
    with pytest.raises(SceneError) as raised:
        render(cube, **{"size": (8, 8), **given}, device="reference")
    assert told in str(raised.value)


@pytest.mark.parametrize(
    ("positional", "told"),
    [
        ((), "expected data first"),
        ((3,), "expected data (what read returns, or names of files), found 3"),
        (("cube", "u", "v"), "expected one quantity, found 'u' and 'v'"),
        (("cube", 3), "expected a quantity or a Scene after the data, found 3"),
    ],
)
def test_wrong_positions_are_reported(cube, positional, told):
    given = [cube if each == "cube" else each for each in positional]
    with pytest.raises(SceneError) as raised:
        render(*given)
    assert told in str(raised.value)


def test_files_then_a_quantity(cube, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(cube, Path("case.xml"))
    how = {"size": (16, 12), "plane": (POINT, NORMAL)}
    here = render(cube, "speed", **how)
    for data in (("case.xml", "case.fld"), (["case.xml", "case.fld"],), (Path("case.xml"), Path("case.fld"))):
        assert np.array_equal(render(*data, "speed", **how).field, here.field, equal_nan=True)
    with pytest.raises(Exception, match=r"case\.fdl"):
        render("case.xml", "case.fdl", "u")


def test_the_values_match_the_quantity(cube):
    frame = render(cube, "speed", contours=3, colormap="turbo", plane=(POINT, NORMAL), size=(20, 20))
    seen = frame.seen
    assert frame.field[seen] == pytest.approx(np.linalg.norm(frame.position[seen], axis=1), abs=1e-12)
    assert np.allclose(frame.position[seen][:, 2], 0.5)
    assert frame.scene.palette == "turbo"


def test_output_writes_the_picture_but_not_over_data(cube, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    frame = render(cube, "u", output="u.png", size=(16, 12), plain=True, plane=CUT)
    assert [path.name for path in tmp_path.iterdir()] == ["u.png"]
    frame.save("again.png", plain=True)
    assert Path("again.png").read_bytes() == Path("u.png").read_bytes()
    with pytest.raises(SceneError, match=r"ends in .png"):
        render(cube, "u", output="u.bmp", size=(16, 12), plane=CUT)


def test_keywords_change_a_scene(cube):
    scene = Scene("u", plane=CUT, size=(16, 12), palette="gray")
    frame = render(cube, scene, field="v", contours=2)
    assert frame.scene.field == "v"
    assert frame.scene.palette == "gray"
    assert frame.scene.every_object[0].style.contours == Contours(count=2)
