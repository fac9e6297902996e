"""Files that a scene file names: ElVis replaces its own, and others only with ``--overwrite``."""

import pytest

from elvis import Dataset, Session, write
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid
from elvis.plugins.command.command import elvis
from elvis.scene.model.errors import SceneError
from elvis.scene.model.ownership import is_own

NAMES = ("p.png", "axes.png", "p.svg", "p.pdf", "p.html", "p.exr", "p.npz", "s.json")
SCENE = 'data = ["m.xml", "m.fld"]\nsize = [12, 8]\ncamera = "front"\ndevice = "reference"\nfield = "u"\n'


def command(name, *arguments):
    elvis.main([name, *map(str, arguments)], prog_name="elvis", standalone_mode=False)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with a mesh of one element."""
    monkeypatch.chdir(tmp_path)
    mesh = Dataset(grid(Shape.HEXAHEDRON, 1))
    dataset = Dataset(mesh.mesh, (approximated(mesh, "u", lambda p: p[:, 0], 2),))
    write(dataset, "m.xml")
    return tmp_path


def scene_of(folder, *lines):
    (folder / "s.toml").write_text(SCENE + "\n".join(lines))
    return folder / "s.toml"


def test_a_scene_replaces_files_it_wrote_in_every_format(folder):
    """Twice the same scene: each file bears the mark by which it may be replaced."""
    outputs = [name for name in NAMES if name not in ("axes.png", "s.json")]
    scene = scene_of(folder, f"outputs = {outputs}", 'stats = "s.json"')
    axes = ("--axes", "-o", folder / "axes.png")
    for _ in range(2):
        command("render", scene)
        command("render", scene, *axes)
    assert all(is_own(folder / name) for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_a_scene_does_not_replace_foreign_files(folder, name):
    (folder / name).write_bytes(b'{"name": "mine", "author": "ElVis"}')
    key = f'stats = "{name}"' if name == "s.json" else f'outputs = ["{name}"]'
    scene = scene_of(folder, key)
    before = (folder / name).read_bytes()
    with pytest.raises(SceneError, match=rf"{name}: not written: the scene file names it, but ElVis did not write"):
        command("render", scene)
    assert (folder / name).read_bytes() == before
    command("render", scene, "--overwrite")
    assert is_own(folder / name)


def test_names_on_the_command_line_are_the_users(folder):
    (folder / "p.png").write_text("mine")
    scene = scene_of(folder, 'outputs = ["p.png"]')
    command("render", scene, "-o", folder / "p.png")
    (folder / "p.png").write_text("mine")
    command("render", scene, "--set", 'outputs=["p.png"]')
    assert is_own(folder / "p.png")


def test_a_link_and_a_folder_of_that_name_are_preserved(folder):
    (folder / "p.png").symlink_to("nothing.png")
    with pytest.raises(SceneError, match=r"p\.png: not written"):
        command("render", scene_of(folder, 'outputs = ["p.png"]'))
    assert not (folder / "nothing.png").exists()


def test_pictures_of_steps_do_not_replace_foreign_files(folder):
    """``elvis watch`` and `Session` check the first step's files at once, the others before each is written."""
    (folder / "p1.png").write_text("mine")
    scene = scene_of(folder, 'outputs = ["p{step}.png"]')
    text = scene.read_text().replace('data = ["m.xml", "m.fld"]\n', "")
    (folder / "session.toml").write_text(text)
    mesh = Dataset(grid(Shape.HEXAHEDRON, 1))
    dataset = Dataset(mesh.mesh, (approximated(mesh, "u", lambda p: p[:, 0], 2),))
    fields = {"u": dataset.fields[0].blocks[0].coefficients}
    with Session(dataset, folder / "session.toml") as session:
        assert session.show(0, 0.0, fields) is not None, session.faults
        assert session.show(1, 0.5, fields) is None
    assert "p1.png: not written" in session.faults[0]
    assert (folder / "p1.png").read_text() == "mine"
    (folder / "p0.png").write_text("mine")
    with pytest.raises(SceneError, match=r"p0\.png: not written"):
        Session(dataset, folder / "session.toml")
    with pytest.raises(SceneError, match=r"p0\.png: not written"):
        command("watch", scene, "--idle", "0.2", "--every", "0.05")
