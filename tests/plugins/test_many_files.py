"""One command for many files: a pattern in quotes, and outputs that name {stem}."""

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from elvis import Dataset, Shape, read, write
from elvis.core.testing import approximated, grid
from elvis.plugins.command.command import elvis
from elvis.plugins.command.running import Settings
from elvis.plugins.conversion.report import Measure, RecordedReport, Report


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Fields of three runs on one mesh: u is the number of the run."""
    monkeypatch.chdir(tmp_path)
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    for number in (1, 2, 10):
        field = approximated(bare, "u", lambda p, value=number: value + 0 * p[:, 0], 2)
        write(Dataset(bare.mesh, (field,)), f"run_{number}.xml")
    (tmp_path / "run_1.xml").rename("mesh.xml")
    return tmp_path


def run(*words):
    found = CliRunner().invoke(elvis, [str(word) for word in words])
    text = " ".join(found.output.split())
    return found.exit_code, text if found.exception is None else f"{text} {found.exception}"


def test_each_file_has_its_outputs(folder):
    status, text = run("probe", "mesh.xml", "run_*.fld", "--point", "0.5,0.5", "-o", "p_{stem}.csv")
    assert status == 0, text
    last = [float((folder / f"p_run_{n}.csv").read_text().splitlines()[1].rpartition(",")[2]) for n in (1, 2, 10)]
    assert last == pytest.approx([1, 2, 10])
    size = ("--size", "12x10", "--device", "reference", "--plain")
    status, text = run("render", "mesh.xml", "run_?.fld", *size, "-o", "{stem}.jpg", "-o", "{stem}.npz")
    assert status == 0, text
    assert sorted(path.name for path in folder.glob("run_*.npz")) == ["run_1.npz", "run_2.npz"]
    assert np.nanmax(np.load("run_2.npz")["field"]) == pytest.approx(2)
    with Image.open("run_2.jpg") as image:
        assert (image.format, image.size) == ("JPEG", (12, 10))
        assert image.info["comment"] == b"Software: ElVis"
    assert run("convert", "mesh.xml", "run_*.fld", "--add", "v=2*u", "-o", "c_{stem}.fld")[0] == 0
    assert read("mesh.xml", "c_run_10.fld")["v"](0.5, 0.5) == pytest.approx(20)


def test_wildcards_of_several_patterns_correspond(folder):
    status, text = run("integrate", "run_*.xml", "run_*.fld", "--field", "u", "-o", "i_{stem}.csv")
    assert status == 0, text
    assert sorted(path.name for path in folder.glob("i_*")) == ["i_run_10.csv", "i_run_2.csv"]


def test_sets_of_characters_are_wildcards(folder):
    for pattern, names in (("run_[2-9].fld", ["s_run_2.csv"]), ("run_[!2]*.fld", ["s_run_1.csv", "s_run_10.csv"])):
        status, text = run("integrate", "mesh.xml", pattern, "--field", "u", "-o", "s_{stem}.csv")
        assert status == 0, text
        assert sorted(path.name for path in folder.glob("s_*")) == names
        for name in names:
            (folder / name).unlink()


def test_failures_are_summarised_and_other_files_continue(folder):
    (folder / "run_3.fld").write_text("x")
    status, text = run("integrate", "mesh.xml", "run_*.fld", "--field", "u", "-o", "i_{stem}.csv")
    assert status == 1
    assert "warning: run_3.fld: expected a file of a known format" in text
    assert "1 of 4 cases failed: run_3.fld" in text
    assert len(list(folder.glob("i_*"))) == 3
    assert "Traceback" not in text
    words = ["integrate", "mesh.xml", "run_*.fld", "--field", "u", "-o", "i_{stem}.csv", "--debug"]
    done = CliRunner().invoke(elvis, words, obj=Settings(debug=False))
    assert "Traceback" in done.output


@pytest.mark.parametrize(
    ("words", "status", "reason"),
    [
        (("mesh.xml", "run_1.fld", "-o", "{stem}.csv"), 2, "expected a pattern of files in quotes"),
        (("mesh.xml", "run_*.fld", "-o", "{name}.csv"), 2, "{name}.csv: expected {stem}, found {name}"),
        (("mesh.xml", "run_*.fld", "-o", "{stem}.csv", "--plot", "a.png"), 2, "as all cases would write a.png"),
        (("mesh.xml", "rnu_*.fld", "-o", "{stem}.csv"), 1, "rnu_*.fld: expected files of such names, found none"),
        (("mesh.xml", "run_*.fld", "-o", "{stem}.csv", "--feld", "u"), 2, "No such option"),
        (("*.xml", "run_*.fld", "-o", "{stem}.csv"), 1, "expected a file with mesh in its name, found none"),
    ],
)
def test_bad_input_gives_one_line_errors(folder, words, status, reason):
    found, text = run("integrate", "--field", "u", *words)
    assert found == status, text
    assert reason in text


def test_jpeg_has_no_transparency(folder):
    size = ("--size", "12x10", "--device", "reference")
    status, text = run("render", "mesh.xml", "run_1.fld", *size, "--background", "1,1,1,0", "-o", "a.jpg")
    assert status == 1
    assert "JPEG has no transparency" in text
    assert not (folder / "a.jpg").exists()


def test_remarks_on_very_many_files_stay_short():
    """A run of 1,000 processes has a file of each; a remark names the first ones and their number."""
    names = tuple(f"mesh.{number:06d}" for number in range(1000))
    measure = Measure("coordinates", 1, 0.0, 0.0, 1.0, 1.0, 1e-16, 0, True, None, 1.0)
    found = Report("mfem", names, {"tetrahedron": 1000}, measure, (0.0, 0), False, (), {}, (), ("a warning",))
    for remark in found.remarks():
        assert remark.startswith("mesh.000000, mesh.000001, ")
        assert ", ... (1000 files): " in remark
        assert len(remark) < 250
    recorded = RecordedReport.of(found.metadata())
    assert recorded is not None
    assert len(recorded.facts["files"]) == 1000
