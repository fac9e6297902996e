"""Pictures and commands on deformed geometry agree with data whose map was moved beforehand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import Camera, Dataset, Deform, MeshLines, Scene, SceneError, Shape, deform, render, sample, write
from elvis.core.testing import approximated, grid
from elvis.plugins.command.command import elvis as group
from elvis.reference.study import compare_scene
from elvis.renderer.frame.rendering import Pictures
from elvis.renderer.frame.undeformed import GREY, OPACITY
from elvis.scene.commandline.writing import option_words
from elvis.scene.figure.saving import arrays
from elvis.scene.model.tables import scene_of, table_of

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
def test_pictures_match_those_of_a_moved_map(drawn):
    data, options = solid(), {"size": 40, "camera": "iso", **drawn}
    ours = render(data, "p", deform={"displacement": "u,v,w", "scale": 1.5}, **options)
    theirs = render(moved(data, 1.5), "p", **options)
    assert np.array_equal(ours.element, theirs.element)
    assert np.nanmax(np.abs(ours.field - theirs.field)) < 1e-12
    assert any("deformed by 1.5" in remark for remark in ours.remarks)
    (told,) = arrays(ours)["deformation"].tolist()
    assert told.endswith("deformed by 1.5 · (u, v, w); gradients are taken in the undeformed configuration")
    assert "deformation" not in arrays(theirs)


def test_flat_data_are_drawn_deformed():
    data = solid(Shape.QUADRILATERAL)
    ours, theirs = render(data, "p", deform="u,v", scale=2, size=40), render(moved(data, 2), "p", size=40)
    assert np.array_equal(ours.field, theirs.field, equal_nan=True)


def test_a_scene_without_deformation_shows_the_original_data():
    data, drawn = solid(Shape.QUADRILATERAL), {"size": (20, 20)}
    with Pictures(data) as pictures:
        fields = [
            pictures.draw(Scene("p", deform=deform, **drawn)).field for deform in (None, Deform("u,v", 2.0), None)
        ]
    assert np.array_equal(fields[0], fields[2], equal_nan=True)
    assert not np.array_equal(fields[0], fields[1], equal_nan=True)


def test_bricks_match_those_of_the_geometry():
    data, drawn = solid(Shape.QUADRILATERAL), {"size": (20, 20), "memory": float(1 << 30)}
    deformed = [Deform("u,v", scale) for scale in (1.0, 2.0)]
    with Pictures(data) as pictures:
        found = [pictures.draw(Scene("p", deform=each, **drawn)).field for each in (None, *deformed, None)]
    for each, field in zip((None, *deformed, None), found, strict=True):
        with Pictures(data) as fresh:
            assert np.array_equal(field, fresh.draw(Scene("p", deform=each, **drawn)).field, equal_nan=True)


def test_points_over_the_plane_are_probed_on_the_height(flat_files):
    points = [("0.31", "0.77"), ("0.123", "0.456", "9"), ("0.25", "1")]
    words = [word for point in points for word in ("--point", ",".join(point))]
    command = ["probe", *flat_files, *words, "--height", "u", "--scale", "3", "--field", "p", "--json"]
    found = json.loads(CliRunner().invoke(group, command, catch_exceptions=False).stdout)
    for row, (x, y, *_) in zip(found, points, strict=True):
        assert row["status"] == 1
        # the surface is z = 3 · 0.2 y^2
        assert row["z"] == pytest.approx(0.6 * float(y) ** 2, rel=1e-12)
        place = [float(x), float(y), row["z"]]
        assert [row[axis] for axis in "xyz"] == place
        flat = sample(solid(Shape.QUADRILATERAL), "p", [[*place[:2], 0.0]])["p"]
        assert row["p"] == pytest.approx(flat[0], rel=1e-12)
    outside = CliRunner().invoke(group, [*command[:3], "--point", "2,2", *command[9:]], catch_exceptions=False)
    assert json.loads(outside.stdout)[0]["status"] == 0


#: a view of which the flat data before and after the deformation fill a part
FLAT = Camera((0.5, 0.5, 5.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=2.0)


def both(how, **changes):
    options = {"deform": "u,v", "scale": 2, "size": 40, "camera": FLAT, **changes}
    return render(solid(Shape.QUADRILATERAL), "p", undeformed=how, **options)


def test_lines_of_the_undeformed_mesh_match_those_of_the_data():
    alone, shown = both(None), both("mesh")
    black = {"color": (0, 0, 0), "mesh_lines": MeshLines(color=(1, 0, 0)), "background": (0, 0, 0)}
    lines = render(solid(Shape.QUADRILATERAL), "p", camera=FLAT, size=40, **black)
    is_line = lines.color[..., 0] > 0.05
    assert is_line.sum() > 60
    assert np.array_equal(np.abs(shown.color - alone.color).max(axis=2) > 0.01, is_line)
    for name in ("element", "field", "depth", "status"):
        assert np.array_equal(getattr(shown, name), getattr(alone, name), equal_nan=True)
    assert shown.legends == alone.legends or shown.range == alone.range


@pytest.mark.parametrize("how", ["mesh", "outline"])
def test_bands_of_rows_show_the_same_undeformed_mesh(monkeypatch, how):
    whole = both(how)
    # bands of five rows, whose borders are those of the square
    monkeypatch.setattr("elvis.renderer.device.persistence.BAND", 200)
    bands = both(how)
    assert np.array_equal(bands.color, whole.color)
    assert np.array_equal(bands.element, whole.element)
    ours, theirs = ([np.concatenate(stroke.lines) for stroke in own.drawing.strokes] for own in (bands, whole))
    assert [len(own) for own in ours] == [len(own) for own in theirs]


def test_undeformed_faces_are_grey_and_an_outline_surrounds_them():
    alone, shown, outlined = both(None), both("faces"), both("outline")
    height, width = alone.element.shape
    inside = np.abs(FLAT.height / 40 * (np.indices((height, width)) - 19.5)).max(axis=0) < 0.5
    grey = inside & (alone.element < 0)
    assert np.allclose(shown.color[grey], 1 - OPACITY * (1 - np.array(GREY)), atol=1e-12)
    assert np.array_equal(shown.color[~grey], alone.color[~grey])
    # the unit square covers 20 of 40 pixels each way
    (stroke,) = outlined.drawing.strokes
    points = np.concatenate(stroke.lines)
    assert np.allclose([points.min(axis=0), points.max(axis=0)], [[9.5, 9.5], [29.5, 29.5]], atol=0.01)


@pytest.mark.parametrize("displacement", ["0,0,p", "0,0,0.4*x*y"])
def test_undeformed_geometry_hides_and_is_hidden_in_space(displacement):
    """Sides that move in their own planes coincide with the undeformed ones, which they hide."""
    options = {"deform": displacement, "scale": 1.0, "size": 30, "camera": "iso", "faces": "all", "mesh_lines": True}
    alone, shown = (render(solid(), "p", undeformed=how, **options) for how in (None, "faces"))
    rest = render(solid(), "p", camera=shown.view.camera, size=30, faces="all")
    ours = render(solid(), "p", **{**options, "camera": shown.view.camera})
    # the view is fitted to both
    assert not np.array_equal(alone.element, shown.element)
    assert np.array_equal(ours.element, shown.element)
    changed = np.abs(shown.color - ours.color).max(axis=2) > 1e-12
    assert np.array_equal(changed, (rest.element >= 0) & (rest.depth < ours.depth - 1e-5))


def test_undeformed_geometry_needs_whole_data_and_a_device_that_draws_it():
    for changes, words in (
        ({"memory": float(1 << 30)}, "with a limit of memory"),
        ({"device": "reference"}, "found device reference"),
    ):
        with pytest.raises(SceneError, match=f"undeformed: .*{words}"):
            both("mesh", **changes)
    with pytest.raises(SceneError, match="outline, mesh or faces"):
        both("edges")
    with pytest.raises(SceneError, match="walls: expected a height, found a displacement"):
        both(None, walls=True)


def test_walls_close_the_jumps_of_a_height():
    data = Dataset(grid(Shape.QUADRILATERAL, 2))
    data = replace(data, fields=(approximated(data, "u", lambda x: np.where(x[:, 0] > 0.5, 1.0, 0.0), 2),))
    view = Camera((-5.0, 0.5, 1.5), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), height=2.0)
    options = {"height": "u", "camera": view, "size": 40, "faces": "all", "lit": False}
    alone, closed = (render(data, "u", walls=walls, **options) for walls in (None, True))
    # where rays meet the strip x = 0.5 between both halves, nothing of which is hidden
    origins, directions = closed.view.rays_of(np.arange(1600))
    way = (0.5 - origins[:, 0]) / directions[:, 0]
    places = (origins + way[:, None] * directions)[:, 1:]
    is_wall = (np.abs(places - 0.5) < 0.5).all(axis=1).reshape(40, 40)
    assert is_wall.sum() > 300
    changed = np.abs(closed.color - alone.color).max(axis=2) > 0
    assert np.array_equal(changed, is_wall)
    assert np.array_equal(closed.element, alone.element)
    told = "walls: 2 vertical strips close the jumps of the height; values and positions in records leave walls out"
    assert told in closed.remarks
    assert arrays(closed)["deformation"][1] == told
    assert not any("walls" in remark for remark in alone.remarks)


def test_a_height_seen_from_above_is_the_picture_of_the_plane():
    data = solid(Shape.QUADRILATERAL)
    view = Camera((0.5, 0.5, 5.0), (0.5, 0.5, 0.0), (0.0, 1.0, 0.0), height=1.2)
    lines = {"contours": 5, "mesh_lines": True}
    options = {"camera": view, "size": 40, "faces": "all", "lit": False, "range": (0.0, 2.0), **lines}
    flat, high = render(data, "p", **options), render(data, "p", height="u", scale=3, **options)
    both = (flat.element >= 0) & (high.element >= 0)
    assert both.sum() > 1000
    assert np.array_equal(flat.element, high.element)
    assert np.abs(flat.field - high.field)[both].max() < 1e-12
    # contours and mesh lines lie on the surface
    assert np.abs(flat.color - high.color).max() < 1 / 255
    bare = render(data, "p", **{**options, "contours": None, "mesh_lines": None})
    assert (np.abs(flat.color - bare.color).max(axis=2) > 0.1).sum() > 100
    heights = 5 - high.depth[both]
    # u = 0.2 y^2 at the places of the pixels
    assert np.abs(heights - 0.6 * high.position[both][:, 1] ** 2).max() < 1e-10
    assert any("z = 3" in remark for remark in high.remarks)


def test_a_deformation_is_set_by_files_options_and_python():
    scene = scene_of({"deform": {"displacement": "u,v,w", "scale": 50.0, "gradients": "deformed"}})
    assert scene.deform == Deform("u,v,w", 50.0, "deformed")
    assert scene_of(table_of(scene)) == scene
    assert option_words(scene)[:2] == ["--deform", "u,v,w"]
    with pytest.raises(SceneError, match="expected --deform or --height with --scale"):
        render(solid(), "p", scale=2)
    with pytest.raises(SceneError, match="gradients"):
        Scene(deform=Deform("u,v", 1.0, "elsewhere"))


def played(folder, data, look, option, values, count):
    """Files of the frames of an animation, and of stills of the same look at values of an option, as bytes.

    data  words of the command; the last two are the option that moves, with its motion
    """

    def run(*words):
        outcome = CliRunner().invoke(group, list(map(str, words)))
        assert outcome.exit_code == 0, outcome.output

    run("animate", *data, *look, "--frames", count, "-o", folder / "film")
    frames = [path.read_bytes() for path in sorted((folder / "film").glob("*.png"))]
    stills = []
    for value in values:
        run("render", *data[:-2], option, value, *look, "-o", folder / "still.png")
        stills.append((folder / "still.png").read_bytes())
    return frames, stills


@pytest.fixture(scope="module")
def flat_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flat")
    write(solid(Shape.QUADRILATERAL), folder / "flat.xml")
    return [str(folder / name) for name in ("flat.xml", "flat.fld")]


LOOK = ["--field", "p", "--range", "0:2", "--size", "20", "--plain"]


@pytest.mark.parametrize("option", ["--scale", "--key"])
def test_frames_over_the_scale_are_stills(flat_files, tmp_path, option):
    motion = "0:1.5" if option == "--scale" else "deform.scale=0:1.5"
    words = [*flat_files, "--deform", "u,v", option, motion]
    frames, stills = played(tmp_path, words, LOOK, "--scale", [0.0, 0.75, 1.5], 3)
    assert frames == stills
    assert frames[0] != frames[1]


def test_linear_pictures_of_deformed_data_are_those_of_a_moved_map(flat_files):
    deformed = ["--deform", "u,v", "--scale", "2", "--undeformed", "mesh"]
    look = ["--field", "p", "--size", "30", "--refinements", "0,1", "--validate", "20", "--json"]
    outcome = CliRunner().invoke(group, ["compare", *flat_files, *deformed, *look])
    assert outcome.exit_code == 0, outcome.output
    found = json.loads(outcome.stdout)
    data = moved(solid(Shape.QUADRILATERAL), 2)
    expected = compare_scene(data, Scene("p", size=(30, 30)), (0, 1), validation_size=20)
    assert found["pixel_exact"]
    assert "deformed by 2" in outcome.stderr
    for own, other in zip(found["baselines"][:2], expected.rivals, strict=False):
        assert own["value_max"] == pytest.approx(other.errors.value_max, rel=1e-8)
        assert own["position_max"] == pytest.approx(other.errors.position_max, rel=1e-8)
        assert own["value_max"] > 0.01


def test_films_report_scales_that_fold_elements(tmp_path):
    # x + S (-x, 0) is flat at S = 1 and inverted beyond
    data = Dataset(grid(Shape.QUADRILATERAL, 1))
    data = replace(data, fields=(approximated(data, "u", lambda x: -x[:, 0], 2),))
    files = map(str, write(data, tmp_path / "flat.xml"))
    words = ["animate", *files, "--deform", "u,0", "--size", "8", "--plain", "--frames", "4", "-o", f"{tmp_path}/film"]
    told = CliRunner().invoke(group, [*words, "--scale", "0:1.8"]).stderr
    assert "folded at 2 of the scales, the nearest to 0 is 1.2" in " ".join(told.split())
    told = CliRunner().invoke(group, [*words, "--scale", "0:0.9", "--overwrite"]).stderr
    assert "folded" not in told


def test_a_mode_oscillates_without_a_seam(flat_files, tmp_path):
    words = [*flat_files, "--deform", "u,v", "--undeformed", "mesh", "--scale", "mode:2"]
    frames, (rest, most, least) = played(tmp_path, words, LOOK, "--scale", [0.0, 2.0, -2.0], 4)
    assert frames == [rest, most, rest, least]
    assert most != least


def test_an_animation_over_the_phase_equals_its_still_pictures(flat_files, tmp_path):
    # Re(E exp(i phase)) with E = u + i v displaces the geometry
    words = [*flat_files, "--complex", "E=u,v", "--deform", "E,0", "--phase", "0:360"]
    frames, stills = played(tmp_path, words, LOOK, "--phase", [0, 90, -180, 270, 360], 4)
    assert [*frames, frames[0]] == stills
    assert frames[0] != frames[2]


TURN = ("--phase", "0:90")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--scale", "0:1"), "expected --deform or --height"),
        (("--deform", "u,v", "--scale", "mode:x"), "--scale: expected a finite amplitude after mode:"),
        (("--deform", "u,v", "--scale", "0:b"), "--scale: expected two or more numbers"),
        (("--phase", "0:360"), "--phase: expected pairs such as E_re and E_im"),
        (("--complex", "p=u,v", *TURN), "expected a name that no field has"),
        (("--complex", "E=u", *TURN), "expected NAME=REAL,IMAGINARY"),
        (("--complex", "E=u,nothing", *TURN), "expected fields or vectors, found nothing"),
    ],
)
def test_bad_motions_and_complex_fields_give_one_line_errors(flat_files, tmp_path, words, told):
    found = CliRunner().invoke(group, ["animate", *flat_files, *words, "--frames", "2", "-o", f"{tmp_path}/film"])
    assert found.exit_code != 0
    assert told in str(found.exception) + found.output


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
