"""Where a report may stand: only what an earlier report has written is ever replaced."""

import json
import os
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from elvis import Plane, Scene
from elvis.core.base.errors import ElvisError
from elvis.core.files import replacement
from elvis.reference.picture import render
from elvis.reference.record import Record
from elvis.reference.report import plots, writing
from elvis.reference.report.writing import check_folder, write_report
from elvis.reference.study import compare_records


@pytest.fixture(scope="module")
def study(blocks):
    """Two records of a small picture that differ in one pixel."""
    record = Record.of(render(blocks, Scene("wave", Plane((1.5, 0.5, 0.45), (0.1, 0.2, 1.0)), size=(24, 16))))
    field = record.field.copy()
    field[8, 12] += 1.0
    return compare_records(record, replace(record, field=field), "other.npz")


@pytest.fixture
def drawn(monkeypatch):
    """Pages of two small files instead of all pictures and plots."""
    monkeypatch.setattr(
        writing, "page", lambda study, text: ("<p>new</p>", {"pictures/a.png": np.zeros((2, 2, 3), "u1")})
    )


def contents(folder):
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_the_marker_lists_the_files_of_the_report(study, tmp_path):
    write_report(study, tmp_path / "report")
    mark = json.loads((tmp_path / "report" / "report.json").read_text())
    assert (mark["kind"], mark["version"]) == ("ElVis accuracy report", 1)
    assert mark["files"] == sorted(contents(tmp_path / "report"))
    assert len(mark["files"]) > 8
    write_report(study, tmp_path / "report")
    assert os.listdir(tmp_path) == ["report"]


@pytest.mark.parametrize(
    "mark",
    [
        None,
        "{",
        "[]",
        "[" * 5000,
        '{"kind": "ElVis accuracy report", "version": 2, "files": ["wing.xml", "summary.json"]}',
        '{"kind": "other", "version": 1, "files": ["wing.xml", "summary.json"]}',
    ],
)
def test_a_summary_is_not_a_report(study, drawn, tmp_path, mark):
    """A folder of data with a file of that name, or with another program's mark, is left as it is."""
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "wing.xml").write_text("<NEKTAR/>")
    (folder / "summary.json").write_text("{}")
    if mark is not None:
        (folder / "report.json").write_text(mark)
    before = contents(folder)
    with pytest.raises(ElvisError, match="it is a folder of other things"):
        write_report(study, folder)
    assert contents(folder) == before


def test_a_marker_that_is_a_link_is_ignored(study, drawn, tmp_path):
    write_report(study, tmp_path / "report")
    (tmp_path / "report" / "report.json").rename(tmp_path / "mark.json")
    (tmp_path / "report" / "report.json").symlink_to(tmp_path / "mark.json")
    with pytest.raises(ElvisError, match="it is a folder of other things"):
        check_folder(tmp_path / "report")


@pytest.mark.parametrize("name", ["notes.txt", "pictures/mine.png", "data", "link"])
def test_foreign_files_in_a_report_stop_it(study, drawn, tmp_path, name):
    folder = tmp_path / "report"
    write_report(study, folder)
    if name == "data":
        (folder / name).mkdir()
    elif name == "link":
        (folder / name).symlink_to(tmp_path)
    else:
        (folder / name).write_text("mine")
    before = contents(folder)
    with pytest.raises(ElvisError, match=f"report: cannot be written: the report in it did not write {name};"):
        write_report(study, folder)
    assert contents(folder) == before
    assert os.path.lexists(folder / name)


def test_files_added_during_a_report_stop_it(study, drawn, tmp_path, monkeypatch):
    folder = tmp_path / "report"
    write_report(study, folder)
    put = writing.put

    def slowly(path, content):
        (folder / "notes.txt").write_text("mine")
        put(path, content)

    monkeypatch.setattr(writing, "put", slowly)
    with pytest.raises(ElvisError, match=r"did not write notes\.txt"):
        write_report(study, folder)
    assert (folder / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("swapping", ["at once", "one after the other"])
@pytest.mark.parametrize("error", [RuntimeError("no more disk"), KeyboardInterrupt()])
def test_a_failure_leaves_the_old_report(study, drawn, tmp_path, monkeypatch, error, swapping):
    """While files are written, and while the folders change their names."""
    write_report(study, tmp_path / "report")
    before = contents(tmp_path / "report")

    def fail(*arguments):
        raise error

    for module, name in ((writing, "times"), (os, "rename")):
        with monkeypatch.context() as patch:
            if swapping == "one after the other":
                patch.setattr(replacement, "exchange", lambda one, other: False)
            patch.setattr(module, name, fail)
            if module is writing or swapping == "one after the other":
                with pytest.raises(type(error)):
                    write_report(study, tmp_path / "report")
                assert contents(tmp_path / "report") == before
                assert os.listdir(tmp_path) == ["report"]


def test_inputs_in_a_report_are_preserved(study, drawn, tmp_path):
    """Its own files may be inputs, too: a scene, through a link."""
    folder = tmp_path / "report"
    write_report(study, folder)
    (tmp_path / "scene.toml").hardlink_to(folder / "summary.json")
    before = contents(folder)
    with pytest.raises(ElvisError, match=r"summary\.json: not written: it is the input .*scene\.toml.*--overwrite"):
        write_report(study, folder, inputs=[tmp_path / "scene.toml"])
    assert contents(folder) == before
    write_report(study, folder, inputs=[tmp_path / "scene.toml"], overwrite=True)


def test_an_empty_folder_and_a_link_to_one(study, drawn, tmp_path):
    (tmp_path / "real").mkdir(mode=0o750)
    (tmp_path / "link").symlink_to("real")
    write_report(study, tmp_path / "link")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "index.html").is_file()
    assert (tmp_path / "real").stat().st_mode & 0o777 == 0o750


def test_errors_in_plots_have_the_units_of_their_labels():
    rival = SimpleNamespace(errors=SimpleNamespace(value_max=0.02, value_mean=0.005, off=3.0, contour_max=0.4))
    labels, numbers, *_ = zip(*plots._CURVES, strict=True)
    assert [number(rival) for number in numbers] == [2.0, 0.5, 3.0, 0.4]
    assert ["%" in label for label in labels] == [True, True, True, False]
    assert [number(SimpleNamespace(errors=None)) for number in numbers] == [None] * 4
