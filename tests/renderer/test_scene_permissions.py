"""What a scene file may do: it may come from anybody, and the command line alone goes further."""

import os

import pytest

from elvis import Scene, SceneError
from elvis.scene.commandline.composing import composed
from elvis.scene.model.files import SUFFIXES, read_scene, write_scene


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with a scene's folder in it, from which links lead out and stay."""
    home = tmp_path / "home"
    (home / "below").mkdir(parents=True)
    (home / "out").symlink_to(tmp_path)
    (home / "in").symlink_to("below")
    (home / "a.png").symlink_to(tmp_path / "a.png")
    (home / "b.png").symlink_to("below/b.png")
    monkeypatch.chdir(tmp_path)
    return home


def scene_in(folder, text):
    (folder / "s.toml").write_text(text)
    return folder / "s.toml"


PLUGIN = """
from pathlib import Path
Path("ran").write_text("")
"""


@pytest.mark.parametrize("name", ["x.py", "./x.py", "home/x.py", "X.PY", "/tmp/x.py", "home/native", "../native"])
def test_a_plugin_of_a_scene_is_an_installed_one(folder, name):
    (folder / "x.py").write_text(PLUGIN)
    (folder.parent / "x.py").write_text(PLUGIN)
    path = scene_in(folder, f'plugin = "{name}"')
    sentence = rf"s\.toml: plugin: expected the name of an installed plugin, found '{name}': .* --plugin"
    with pytest.raises(SceneError, match=sentence):
        read_scene(path)
    assert read_scene(scene_in(folder, 'plugin = "native"')).plugin == "native"


def test_the_command_runs_no_file_that_a_scene_names(folder, capsys):
    from elvis.plugins.command.command import main

    (folder / "x.py").write_text(PLUGIN)
    (folder / "d.xml").write_text("<NEKTAR/>")
    path = scene_in(folder, 'plugin = "x.py"\ndata = ["d.xml"]')
    for command in ("render", "compare"):
        with pytest.raises(SystemExit) as ended:
            main([command, str(path), "-o", str(folder / "o.png")])
        assert ended.value.code == 1
        assert "expected the name of an installed plugin, found 'x.py'" in capsys.readouterr().err
    assert not (folder.parent / "ran").exists()


BESIDE = "a name next to the scene or in a folder below"
LINK = "a name without links out of the scene's folder"


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("../o.png", BESIDE),
        ("below/../o.png", BESIDE),
        ("below/../../o.png", BESIDE),
        ("/tmp/o.png", BESIDE),
        ("out/o.png", LINK),
        ("a.png", LINK),
        ("o.toml", "a name that ends in .png, .jpg, .jpeg, .svg, .pdf, .html, .exr, .npz"),
        (".bashrc", "a name that ends in"),
        ("-rf.png", "a name that does not begin with '-'"),
        ("below/-o.png", "a name that does not begin with '-'"),
        ("o", "a name that ends in"),
    ],
)
@pytest.mark.parametrize("key", ["outputs", "stats"])
def test_a_scene_writes_only_to_its_folder_or_below(folder, key, name, expected):
    if key == "stats":
        name = name.replace(".png", ".json")
        expected = expected.replace(".png, .jpg, .jpeg, .svg, .pdf, .html, .exr, .npz", ".json")
        (folder / "a.json").symlink_to(folder.parent / "a.json")
    value = f'["{name}"]' if key == "outputs" else f'"{name}"'
    with pytest.raises(SceneError, match=rf"s\.toml: {key}.*: expected {expected}.*, found '{name}'"):
        read_scene(scene_in(folder, f"{key} = {value}"))


@pytest.mark.parametrize("name", [r"a\nb.png", r"a\rb.png", r"a\u009bb.png", r"a\u202eb.png"])
def test_a_scene_names_no_file_with_control_characters(folder, name):
    with pytest.raises(SceneError, match=r"outputs\[0\]: expected a name without line breaks") as raised:
        read_scene(scene_in(folder, f'outputs = ["{name}"]'))
    assert str(raised.value).isprintable()


def test_good_places(folder):
    path = scene_in(folder, 'outputs = ["o.png", "below/o.EXR", "in/o.npz", "b.png"]\nstats = "below/s.json"')
    scene = read_scene(path)
    assert [os.path.relpath(name, folder) for name in scene.outputs] == ["o.png", "below/o.EXR", "in/o.npz", "b.png"]


def test_the_command_line_has_more_permissions(folder):
    path = scene_in(folder, 'outputs = ["/etc/o.png"]\nstats = "../s.json"\nplugin = "x.py"')
    options = {"outputs": ("../mine.png",), "stats": "mine.json", "plugin": "y.py"}
    scene = composed((path,), options, ())
    assert (scene.outputs, scene.stats, scene.plugin) == (("../mine.png",), "mine.json", "y.py")
    assert composed((path,), options, (("samples", "2"),)).plugin == "y.py"
    for key in options:
        with pytest.raises(SceneError, match=f"{key}"):
            composed((path,), {**options, key: None}, ())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_written_scene_can_be_read(folder, suffix):
    """What it may not say is left out, and told."""
    scene = Scene("u", outputs=("mine.png",), stats=str(folder / "s.json"), plugin="x.py")
    assert write_scene(scene, folder / f"w{suffix}") == ("plugin", "outputs")
    assert read_scene(folder / f"w{suffix}") == Scene("u", stats=str(folder / "s.json"))


@pytest.mark.parametrize("text", [r"\ud800", r"\udc80.xml", r"a\u0000b"])
@pytest.mark.parametrize("key", ['{"title": "%s"}', '{"data": ["%s"]}', '{"palette": "%s"}'])
def test_texts_invalid_as_file_names_or_utf8(folder, key, text):
    (folder / "s.json").write_text(key % text)
    with pytest.raises(SceneError, match=r"s\.json: \S+: expected text in UTF-8 without zeros"):
        read_scene(folder / "s.json")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_names_that_are_not_text_are_not_written_to_scene_files(folder, suffix):
    """YAML and JSON would write escapes, which are rejected when they are read."""
    with pytest.raises(SceneError, match=rf"w\{suffix}: data\[0\]: expected text in UTF-8"):
        write_scene(Scene("u", data=(os.fsdecode(b"\xff.xml"),)), folder / f"w{suffix}")
    assert not (folder / f"w{suffix}").exists()
