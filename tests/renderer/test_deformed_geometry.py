"""Pictures and commands on deformed geometry agree with data whose map was moved beforehand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from elvis import Camera, Dataset, Deform, Scene, SceneError, Shape, deform, render, write
from elvis.core.testing import approximated, grid
from elvis.plugins.command import elvis as group
from elvis.renderer.rendering import Pictures
from elvis.scene.commandline.writing import option_words
from elvis.scene.tables import scene_of, table_of

FUNCTIONS = {
    "u": lambda x: 0.2 * x[:, 1] ** 2,
    "v": lambda x: 0.1 * x[:, 0],
    "w": lambda x: -0.1 * x[:, 0] ** 2,
    "p": lambda x: np.sin(2 * x[:, 0]) + x[:, 1],
}


def solid(shape=Shape.HEXAHEDRON):
    data = Dataset(grid(shape, 1))
    names = [name for name in FUNCTIONS if shape.dimension == 3 or name != "w"]
    return replace(data, fields=tuple(approximated(data, name, FUNCTIONS[name], 4) for name in names))


def moved(data, scale):
    """The same elements with a map that is read from a file, in which nothing is deformed any longer."""
    names = ["u", "v", "w"][: data.mesh.space]
    return replace(deform(data, ",".join(names), scale), deformation=None, remarks=())


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("solid")
    write(solid(), folder / "solid.xml")
    return [str(folder / name) for name in ("solid.xml", "solid.fld")]


@pytest.mark.parametrize(
    "drawn",
    [{"faces": "all", "mesh_lines": True}, {"plane": "z=0.3", "isosurface": "0.8"}],
    ids=["faces", "cut and isosurface"],
)
def test_pictures_are_those_of_a_moved_map(drawn):
    data, options = solid(), {"size": 40, "camera": "iso", **drawn}
    ours = render(data, "p", deform={"displacement": "u,v,w", "scale": 1.5}, **options)
    theirs = render(moved(data, 1.5), "p", **options)
    assert np.array_equal(ours.element, theirs.element)
    assert np.nanmax(np.abs(ours.field - theirs.field)) < 1e-12
    assert any("deformed by 1.5" in remark for remark in ours.remarks)


def test_flat_data_are_drawn_deformed():
    data = solid(Shape.QUADRILATERAL)
    ours, theirs = render(data, "p", deform="u,v", scale=2, size=40), render(moved(data, 2), "p", size=40)
    assert np.array_equal(ours.field, theirs.field, equal_nan=True)


def test_a_scene_without_deformation_shows_the_data_as_they_are():
    data, drawn = solid(Shape.QUADRILATERAL), {"size": (20, 20)}
    with Pictures(data) as pictures:
        fields = [
            pictures.draw(Scene("p", deform=deform, **drawn)).field for deform in (None, Deform("u,v", 2.0), None)
        ]
    assert np.array_equal(fields[0], fields[2], equal_nan=True)
    assert not np.array_equal(fields[0], fields[1], equal_nan=True)


def test_bricks_are_those_of_the_geometry():
    data, drawn = solid(Shape.QUADRILATERAL), {"size": (20, 20), "memory": float(1 << 30)}
    deformed = [Deform("u,v", scale) for scale in (1.0, 2.0)]
    with Pictures(data) as pictures:
        found = [pictures.draw(Scene("p", deform=each, **drawn)).field for each in (None, *deformed, None)]
    for each, field in zip((None, *deformed, None), found, strict=True):
        with Pictures(data) as fresh:
            assert np.array_equal(field, fresh.draw(Scene("p", deform=each, **drawn)).field, equal_nan=True)


def test_a_height_seen_from_above_is_the_picture_of_the_plane():
    data = solid(Shape.QUADRILATERAL)
    view = Camera((0.5, 0.5, 5.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=1.2)
    options = {"camera": view, "size": 40, "faces": "all", "lit": False}
    flat, high = render(data, "p", **options), render(data, "p", height="u", scale=3, **options)
    both = (flat.element >= 0) & (high.element >= 0)
    assert both.sum() > 1000
    assert np.array_equal(flat.element, high.element)
    assert np.abs(flat.field - high.field)[both].max() < 1e-12
    heights = 5 - high.depth[both]
    # u = 0.2 y^2 at the places of the pixels
    assert np.abs(heights - 0.6 * high.position[both][:, 1] ** 2).max() < 1e-10
    assert any("z = 3" in remark for remark in high.remarks)


def test_a_scene_says_the_deformation_in_files_options_and_python():
    scene = scene_of({"deform": {"displacement": "u,v,w", "scale": 50.0, "gradients": "deformed"}})
    assert scene.deform == Deform("u,v,w", 50.0, "deformed")
    assert scene_of(table_of(scene)) == scene
    assert option_words(scene)[:2] == ["--deform", "u,v,w"]
    with pytest.raises(SceneError, match="expected --deform or --height with --scale"):
        render(solid(), "p", scale=2)
    with pytest.raises(SceneError, match="gradients"):
        Scene(deform=Deform("u,v", 1.0, "elsewhere"))


def test_frames_over_the_scale_are_stills(files, tmp_path):
    own = ["--field", "p", "--deform", "u,v,w", "--camera", "3,-3,2:0.5,0.5,0.5", "--range", "0:2", "--size", "40"]
    film = [
        "animate",
        *files,
        *own,
        "--plain",
        "--key",
        "deform.scale=0:1.5",
        "--frames",
        "3",
        "-o",
        f"{tmp_path}/film",
    ]
    still = ["render", *files, *own, "--plain", "--scale", "0.75", "-o", f"{tmp_path}/still.png"]
    for words in (film, still):
        assert CliRunner().invoke(group, words).exit_code == 0
    frames = [np.array(Image.open(path)) for path in sorted((tmp_path / "film").glob("*.png"))]
    assert np.array_equal(frames[1], np.array(Image.open(tmp_path / "still.png")))
    assert not np.array_equal(frames[0], frames[1])


COMMANDS = {
    "integrate": (["--field", "volume", "--json"], lambda text: [row["value"] for row in json.loads(text)]),
    "probe": (["--point", "0.2,0.3,0.4", "--field", "d(p,x)"], lambda text: float(text.split(",")[-1])),
    "norms": (["--json"], lambda text: json.loads(text)["x"]["L2"]),
    "trace": (["--seeds", "point:0.3,0.3,0.3", "--json"], lambda text: json.loads(text)["lengths"][0]),
}


def told(command, *words):
    found = CliRunner().invoke(group, [command, *map(str, words)], catch_exceptions=False)
    assert found.exit_code == 0, found.output
    return COMMANDS[command][1](found.stdout)


@pytest.mark.parametrize("command", COMMANDS)
def test_commands_measure_on_the_deformed_geometry(files, tmp_path, command):
    write(moved(solid(), 0.5), tmp_path / "moved.xml")
    after = (tmp_path / "moved.xml", tmp_path / "moved.fld")
    options = ("--deform", "u,v,w", "--scale", 0.5, "--gradients", "deformed")
    ours, theirs = (told(command, *paths, *COMMANDS[command][0]) for paths in ((*files, *options), after))
    assert ours == pytest.approx(theirs, rel=1e-12)
