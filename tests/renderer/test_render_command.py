"""``elvis render`` and ``elvis devices``: what they write, what they say, how they end."""

import json
import os

import numpy as np
import pytest
from archives import arrays_of

from elvis.plugins.command import command

CUBE = "gen_allelem_n4"
PLANE = ("--plane", "0.5,0.5,0.4:0.1,0.2,1")


@pytest.fixture
def elvis(capfd):
    """Run the command; exit status, standard output and standard error."""

    def run(*arguments):
        with pytest.raises(SystemExit) as ended:
            command.main([str(argument) for argument in arguments])
        out, err = capfd.readouterr()
        return ended.value.code or 0, out, err

    return run


@pytest.fixture
def render(elvis, shared_files, renderer, tmp_path):
    """Render a shared case into new files of these names; status, what was said and what is there afterwards."""
    renderer("vulkan")

    def run(case, *options, outputs=("a.npz",)):
        targets = [part for name in outputs for part in ("-o", tmp_path / name)]
        status, out, err = elvis("render", *shared_files(case), *options, *targets)
        assert out == ""
        return status, err, sorted(str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file())

    return run


def test_all_outputs_and_statistics(render, tmp_path):
    outputs = ("a.png", "a.exr", "a.npz")
    status, err, files = render(
        CUBE, *PLANE, "--size", "60x40", "--field", "v", "--stats", tmp_path / "s.json", outputs=outputs
    )
    assert (status, err, files) == (0, "", ["a.exr", "a.npz", "a.png", "s.json"])
    stats = json.loads((tmp_path / "s.json").read_text())
    assert stats["elements"] == 181
    assert sum(stats["pixels"][name] for name in ("miss", "certain", "ambiguous", "failed")) == 60 * 40
    assert stats["pixels"]["certain"] > 500
    assert stats["seconds"]["frame"] > 0
    assert all(count > 0 for count in stats["bytes"].values())
    assert set(stats["device"]) >= {"name", "label"}
    assert arrays_of(tmp_path / "a.npz")["field"].shape == (40, 60)


def test_devices_draw_the_same_automatic_picture(render, tmp_path):
    for name in ("auto", "vulkan", "vulkan:0", "reference"):
        assert render(CUBE, *PLANE, "--size", "60x45", "--device", name, outputs=(f"{name}.npz",))[0] == 0
    auto, vulkan, first, reference = (
        arrays_of(tmp_path / f"{name}.npz") for name in ("auto", "vulkan", "vulkan:0", "reference")
    )
    for name in auto:
        assert auto[name].tobytes() == vulkan[name].tobytes() == first[name].tobytes()
    assert np.array_equal(reference["element"], auto["element"])
    assert np.allclose(reference["field"], auto["field"], rtol=0, atol=1e-11, equal_nan=True)
    assert np.array_equal(reference["position"], auto["position"], equal_nan=True)


@pytest.mark.parametrize("case_name", [CUBE, "bfs_tq7"])
def test_the_automatic_size_follows_the_visible_part(render, tmp_path, case_name):
    options = PLANE if case_name == CUBE else ()
    assert render(case_name, *options, "--device", "vulkan")[0] == 0
    record = arrays_of(tmp_path / "a.npz")
    height, width = record["field"].shape
    assert width == 1000 or height == 800
    seen = record["element"] >= 0
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    assert np.ptp(columns) > 0.85 * width
    assert np.ptp(rows) > 0.85 * height or height == 160


def test_cameras_ranges_and_colours(render, tmp_path):
    options = ("--camera", "2,-1.5,1.4:0.5,0.5,0.5:0,0,1:40", "--range", "0:1", "--colormap", "gray", "--size", "50x40")
    assert render(CUBE, *PLANE, *options)[0] == 0
    record = arrays_of(tmp_path / "a.npz")
    seen = record["element"] >= 0
    grey = record["color"][seen]
    assert np.ptp(grey, axis=1).max() == 0
    expected = np.clip(record["field"][seen], 0, 1)
    assert np.abs(grey[:, 0] - expected).max() < 1 / 200
    assert np.ptp(record["depth"][seen]) > 0.1


@pytest.mark.parametrize("view", ["+x", "-y", "+z", "iso", "fit", "2,1,2:0.5,0.5,0.5", "2,1,2:0.5,0.5,0.5:0,1,0"])
def test_every_kind_of_view(render, view):
    assert render(CUBE, "--plane", "0.5,0.5,0.5:1,1,1", "--camera", view, "--size", "30x30")[:2] == (0, "")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (
            (*PLANE, "--field", "vorticity"),
            "elvis: error: expression 'vorticity': character 1: vorticity needs a velocity",
        ),
        (("--plane", "0,0,7:0,0,1"), "elvis: error: the picture is empty: nothing of the plane through (0, 0, 7)"),
        (
            (*PLANE, "--size", "90x60", "--camera", "5,5,5:6,6,6:0,0,1:10"),
            "elvis: error: the picture is empty: nothing of the plane",
        ),
        ((*PLANE, "--camera", "1,1,1:1,1,1"), "elvis: error: the view of the camera (at - eye) must be a direction"),
        ((*PLANE, "--camera", "1,1,5:1,1,1:0,0,0"), "elvis: error: up of the camera must be a direction"),
        ((*PLANE, "--colormap", "rainbowish"), "elvis: error: unknown colour map 'rainbowish'"),
        ((*PLANE, "--device", "abacus"), "elvis: error: no device 'abacus': found "),
        ((*PLANE, "--device", "vulkan:99"), "elvis: error: no device 'vulkan:99': found "),
    ],
)
def test_undrawable_input_gives_a_one_line_error(render, options, sentence):
    status, err, files = render(CUBE, *options, outputs=("a.npz", "a.png"))
    assert (status, files) == (1, [])
    assert err.startswith(sentence)
    assert err.count("\n") == 1


@pytest.mark.parametrize("device_name", ["vulkan", "reference"])
@pytest.mark.parametrize("camera", ["fit", "5,5,5:6,6,6:0,0,1:10"])
def test_an_empty_picture_is_rejected_by_every_device(render, device_name, camera):
    status, err, files = render(CUBE, "--plane", "0,0,7:0,0,1", "--camera", camera, "--device", device_name)
    assert (status, files) == (1, [])
    assert err.startswith("elvis: error: the picture is empty: nothing of the plane through (0, 0, 7)")
    assert "the domain lies between" in err


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (("--plane", "0,0,0"), "--plane"),
        (("--plane", "0,0,0:0,0,0"), "--plane"),
        (("--plane", "0,0,0:0,0,nan"), "--plane"),
        (("--size", "0x10"), "--size"),
        (("--size", "100x"), "--size"),
        (("--size", "99999x10"), "--size"),
        (("--range", "1:1"), "--range"),
        (("--range", "1"), "--range"),
        (("--camera", "above"), "--camera"),
        (("--camera", "1,2,3:4,5,6:0,0,1:180"), "--camera"),
        (("--no-such-option",), "--no-such-option"),
    ],
)
def test_a_usage_error_is_two(render, options, part):
    status, err, files = render(CUBE, *options)
    assert (status, files) == (2, [])
    assert part in err
    assert "see elvis render --help" in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("outputs", "sentence"),
    [
        (
            ("a.npz", "b.bmp"),
            "expected a name that ends in .png, .jpg, .jpeg, .svg, .pdf, .html, .exr, .npz, found .bmp",
        ),
        (("a.npz", "nowhere/b.png"), "there is no folder"),
    ],
)
def test_a_bad_output_fails_before_any_is_written(render, outputs, sentence):
    status, err, files = render(CUBE, *PLANE, outputs=outputs)
    assert (status, files) == (1, [])
    assert sentence in err
    assert err.count("\n") == 1


def test_an_existing_picture_survives_a_failure(render, tmp_path):
    (tmp_path / "a.png").write_bytes(b"before")
    assert render(CUBE, "--plane", "0,0,7:0,0,1", outputs=("a.png",))[0] == 1
    assert (tmp_path / "a.png").read_bytes() == b"before"


def test_a_mesh_without_fields_and_a_field_without_mesh(elvis, shared_files, tmp_path):
    mesh, field = shared_files(CUBE)
    status, out, err = elvis("render", field, *PLANE, "-o", tmp_path / "a.png")
    assert (status, out) == (1, "")
    assert "mesh" in err
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())
    status, out, err = elvis("render", mesh, *PLANE, "--size", "40x30", "-o", tmp_path / "a.png")
    assert (status, out) == (0, "")
    assert "a mesh but no field" in err
    assert (tmp_path / "a.png").is_file()


@pytest.mark.parametrize("device_name", ["vulkan", "reference"])
def test_quasi_3d_data_are_cut(render, device_name):
    plane = ("--plane", "0.5,0.5,0.5:1,0.2,0.1", "--size", "60x50")
    assert render("chan3dh1d", *plane, "--device", device_name)[:2] == (0, "")


@pytest.mark.parametrize("device_name", ["vulkan", "reference"])
@pytest.mark.parametrize("case_name", [CUBE, "chan3dh1d"])
def test_3d_data_show_their_outer_faces_by_default(render, case_name, device_name, tmp_path):
    """And say so in a line."""
    options = ("--size", "40x30", "--device", device_name)
    status, err, _ = render(case_name, *options)
    assert (status, err.count("\n")) == (0, 1)
    assert err.startswith("elvis: warning: no objects are given, such as --plane or --cut: all outer faces are")
    assert render(case_name, *options, "--faces", "all", outputs=("b.npz",))[:2] == (0, "")
    one, other = (arrays_of(tmp_path / name) for name in ("a.npz", "b.npz"))
    assert (one["element"] >= 0).any()
    assert all(np.array_equal(one[name], other[name], equal_nan=True) for name in one)


@pytest.mark.parametrize(
    ("case_name", "options", "sentence"),
    [
        ("line_1d", ("--device", "reference"), "1D data are drawn on the host"),
        ("line_1d", ("--plane", "0,0,0:0,0,1"), "1D data are drawn as curves: remove cuts, isosurfaces and volumes"),
    ],
)
def test_data_without_pictures(render, case_name, options, sentence):
    status, err, files = render(case_name, *options)
    assert (status, files) == (1, [])
    assert err.startswith(f"elvis: error: {sentence}")
    assert err.count("\n") == 1


def test_plane_data_reject_planes(render):
    status, err, _ = render("quad4", *PLANE)
    assert (status, err) == (1, "elvis: error: 2D data are drawn in their own plane: remove the cut plane\n")


def test_devices_are_listed(elvis, renderer):
    renderer("vulkan")
    status, out, err = elvis("devices")
    assert (status, err) == (0, "")
    names = [line.split()[0] for line in out.splitlines()[1:]]
    assert {"vulkan:0", "cpu", "reference"} <= set(names)
    listed = json.loads(elvis("devices", "--json")[1])
    assert [row["name"] for row in listed] == names
    assert sum(row["auto"] for row in listed) == 1
    assert all(row["label"] for row in listed)


def test_the_working_folder_stays_clean(render, tmp_path, monkeypatch):
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert render(CUBE, *PLANE, "--size", "20x20")[0] == 0
    assert os.listdir() == []


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("-o", "a.png"), "a.png: is to be written twice: name two files"),
        (("-o", "below/../a.png"), "below/../a.png: is the same file as a.png, which is to be written twice"),
        (("-o", "b.npz", "--stats", "b.npz"), "b.npz: is to be written twice"),
        (("--save-scene", "s.toml"), "s.toml: not written: it is an input; name another output, or pass --overwrite"),
        (("--stats", "s.toml"), "s.toml: not written: it is an input"),
        (("-o", "box.npz"), "box.npz: not written: it is an input"),
        (("-o", "link.npz"), "link.npz: not written: it is the input box.npz"),
        (("--stats", "body.stl"), "body.stl: not written: it is an input"),
        (("--stats", "map.xml"), "map.xml: not written: it is an input"),
        (("--stats", "mine.py"), "mine.py: not written: it is an input"),
    ],
)
def test_outputs_have_distinct_names(elvis, tmp_path, monkeypatch, options, sentence):
    """No two the same, and none that of an input; said before anything is read."""
    monkeypatch.chdir(tmp_path)
    for name in ("box.npz", "body.stl", "map.xml", "mine.py"):
        (tmp_path / name).write_text("input")
    (tmp_path / "link.npz").hardlink_to(tmp_path / "box.npz")
    (tmp_path / "below").mkdir()
    scene = 'data = ["box.npz"]\npalette = "map.xml"\nfield = "distance(\'body.stl\')"\noutputs = ["a.png"]\n'
    (tmp_path / "s.toml").write_text(scene)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    status, out, err = elvis("render", "s.toml", "-o", "a.png", "--plugin", "mine.py", *options)
    assert (status, out) == (1, "")
    assert sentence in err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before


def test_outputs_are_a_unit(render, tmp_path, monkeypatch):
    """One that can't be written leaves all as they were, and is named."""
    (tmp_path / "a.npz").write_text("before")

    def full(frame, path):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("elvis.scene.figure.saving._save_exr", full)
    options = (*PLANE, "--size", "20x20", "--stats", tmp_path / "s.json", "--save-scene", tmp_path / "s.toml")
    status, err, files = render(CUBE, *options, outputs=("a.npz", "b.exr", "c.png"))
    assert (status, files) == (1, ["a.npz"])
    assert err == f"elvis: error: {tmp_path}/b.exr: cannot be written: No space left on device\n"
    assert (tmp_path / "a.npz").read_text() == "before"


def test_a_scene_is_written_over_on_request(elvis, shared_files, renderer, tmp_path):
    renderer("vulkan")
    scene = tmp_path / "s.toml"
    scene.write_text("size = [20, 16]\n")
    options = (*PLANE, "-o", tmp_path / "a.png", "--save-scene", scene, "--overwrite")
    assert elvis("render", scene, *shared_files(CUBE), *options)[0] == 0
    assert "camera" in scene.read_text()
