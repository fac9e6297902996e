"""Runs that are followed: a step counts once it is whole and stands still."""

import os
import shutil

import numpy as np
import pytest

from elvis import ElvisError, render, sample
from elvis.plugins.data.data import Reading
from elvis.plugins.series.following import Following, _stamp, files_of_run
from elvis.plugins.testing.steps import polynomial, steps_of


@pytest.fixture
def made(tmp_path):
    """A mesh and three steps, which a solver has yet to write."""
    (folder := tmp_path / "made").mkdir()
    return steps_of(folder, [0.0, 0.5, 1.0], lambda p, t: polynomial(p, t, 1))


@pytest.fixture
def run(tmp_path):
    (folder := tmp_path / "run").mkdir()
    return folder


def test_a_rewritten_member_of_a_folder_is_detected(tmp_path):
    """Also with its size unchanged, the oldest as well as the newest, and the folder's own entry unchanged."""
    for number, name in enumerate("abc"):
        (tmp_path / name).write_bytes(b"1234")
        os.utime(tmp_path / name, (100 + number,) * 2)
    os.utime(tmp_path, (50, 50))
    for number, name in enumerate("cab"):
        before = _stamp(tmp_path)
        (tmp_path / name).write_bytes(b"4321")
        os.utime(tmp_path / name, (200 + number,) * 2)
        os.utime(tmp_path, (50, 50))
        assert _stamp(tmp_path) != before, name


def test_a_step_counts_once_it_is_complete_and_unchanged(made, run):
    following = Following([run], Reading())
    look = following.look

    assert look() is None
    assert following.waiting == f"waiting for files in {run}"
    shutil.copy(made[0], run)
    assert (look(), look()) == (None, None)
    assert following.waiting == "waiting for a step: found a mesh, but no field yet"
    shutil.copy(made[1], run)
    assert look() is None
    assert look().time == 0.0
    assert look() is None

    # written in place, piece after piece: what stands still for a while need not be whole
    whole = made[2].read_bytes()
    for part in (40, len(whole) - 5, len(whole)):
        (run / made[2].name).write_bytes(whole[:part])
        assert look() is None
        found = look()
        assert (found is None) == (part < len(whole))
    assert found.time == 0.5
    assert np.allclose(sample(found, "u", [(0.3, 0.2, 0)])["u"], polynomial(np.array([(0.3, 0.2)]), 0.5, 1), atol=1e-13)

    # a step written again is news, on the mesh that is known; so is another mesh
    for changed, has_old_mesh in ((made[2], True), (made[0], False)):
        os.utime(run / changed.name, (1, 1))
        assert look() is None
        again = look()
        assert again.time == 0.5
        assert (again.mesh is found.mesh) == has_old_mesh


def test_files_that_change_while_they_are_read_do_not_count(made, run, monkeypatch):
    for file in made[:3]:
        shutil.copy(file, run)
    following = Following([run / "mesh.xml", run / "run_*.chk"], Reading())
    following.look()
    at_moment = "elvis.plugins.series.series.Series.at_moment"
    monkeypatch.setattr(at_moment, lambda self: os.utime(run / "run_1.chk", (2, 2)) or self[1])
    assert following.look() is None
    monkeypatch.undo()
    assert [following.look().time for _ in range(2)] == [0.0, 0.5]


@pytest.mark.parametrize("gone", ["mesh.xml", "run_1.chk", "all"])
def test_files_that_vanish_while_they_are_read_are_tolerated(made, run, monkeypatch, gone):
    for file in made:
        shutil.copy(file, run)
    following = Following([run], Reading())
    following.look()
    newest = Following._newest

    def vanishing(self, stable):
        if gone == "all":
            shutil.rmtree(run)
        else:
            (run / gone).unlink()
        return newest(self, stable)

    monkeypatch.setattr(Following, "_newest", vanishing)
    assert following.look() is None
    assert following.waiting.startswith("waiting: ")
    monkeypatch.undo()
    run.mkdir(exist_ok=True)
    for file in made:
        shutil.copy(file, run)
    assert [found and found.time for found in (following.look(), following.look())] in ([None, 1.0], [1.0, None])


def test_files_of_a_run_are_distinguished_from_others_in_the_folder(tmp_path):
    names = [*(f"flow-{n}.pyfrs" for n in range(3)), "flow.pyfrm", "run.log", "latest.png", ".hidden"]
    for name in names:
        (tmp_path / name).write_text("")
    assert [path.name for path in files_of_run(tmp_path)] == ["flow.pyfrm", *names[:3]]
    (tmp_path / "flow.pvd").write_text("")
    assert files_of_run(tmp_path) == [tmp_path / "flow.pvd"]


def test_the_picture_of_the_newest_step_is_that_of_render(made, run, tmp_path, elvis):
    for file in made:
        shutil.copy(file, run)
    options = ["--size", "12x9", "--device", "reference", "--plain"]
    told = elvis("watch", run, *options, "--every", "0.4", "--idle", "0.1", "-o", tmp_path / "latest.png")
    assert told == f"{tmp_path}/latest.png: time 1\n"
    render(*made, size=(12, 9), device="reference", plain=True, output=str(tmp_path / "still.png"))
    assert (tmp_path / "latest.png").read_bytes() == (tmp_path / "still.png").read_bytes()


def test_a_run_without_a_step_is_a_failure(made, run, tmp_path, elvis):
    shutil.copy(made[0], run)
    with pytest.raises(
        ElvisError, match=r"no step was drawn in 0\.2 s: waiting for a step: found a mesh, but no field"
    ):
        elvis("watch", run, "--every", "0.05", "--idle", "0.2", "-o", tmp_path / "latest.png")
    assert not (tmp_path / "latest.png").exists()


def test_unwatchable_input_fails_at_once(run, tmp_path, elvis):
    for given, sentence in (
        ([run], "expected -o, the name of the picture"),
        ([run / "none", "-o", tmp_path / "x.png"], "none: there is no such file or folder"),
        ([run, "-o", tmp_path / "x.gif"], r"x\.gif: expected a name that ends in"),
        ([run, "-o", tmp_path / "none" / "x.png"], "cannot be written: there is no folder"),
        ([run, "--range", "series", "-o", tmp_path / "x.png"], "range: later steps are not known"),
    ):
        with pytest.raises(ElvisError, match=sentence):
            elvis("watch", *given)
