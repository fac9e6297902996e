"""Trials of libraries: crashes, loops, greed and modules that lie about end as sentences."""

import signal

import pytest

from elvis.converters import trial
from elvis.converters.cgns import Cgns
from elvis.converters.vtk import Vtk
from elvis.core.errors import FormatError


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(trial, "SECONDS", 0)
    monkeypatch.setattr(trial, "MEMORY", 1 << 28)


@pytest.mark.parametrize(
    ("program", "reason"),
    [
        ("bound()\nwhile True: pass", "one on which the library takes too long"),
        ("bound()\nos.abort()", "one on which the library fails"),
        ("bound()\nlarge = bytes(1 << 30)", "one on which the library fails"),
        ("bound()\nsay('a word')\nsys.exit(1)", "a word"),
        ("print('x' * 10000)\nraise ValueError", "one on which the library fails"),
    ],
)
def test_a_failure_has_a_reason(impatient, program, reason):
    outcome = trial.attempt(program, [])
    assert outcome.status != 0
    assert outcome.reason == reason


def test_sound_files_pass(tmp_path):
    (tmp_path / "a").write_bytes(bytes(100))
    program = "bound()\nsys.exit(0 if os.path.getsize(sys.argv[1]) == 100 else 1)"
    assert trial.attempt(program, [tmp_path / "a"]) == trial.Outcome(0, "")


def test_limits_grow_with_the_files(tmp_path):
    (tmp_path / "a").write_bytes(bytes(100))
    program = 'import resource\nbound()\nsay(f"{resource.getrlimit(resource.RLIMIT_AS)[0]}")'
    assert int(trial.attempt(program, []).said) == trial.MEMORY
    assert int(trial.attempt(program, [tmp_path / "a"]).said) == trial.MEMORY + 100 * trial.MEMORY_PER_BYTE


@pytest.mark.parametrize("name", ["resource", "contextlib", "vtkmodules", "gmsh", "numpy"])
def test_nothing_in_the_working_folder_is_run(tmp_path, monkeypatch, name):
    (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'run')!r}, 'w')")
    (tmp_path / "a.vtu").write_text('<VTKFile type="UnstructuredGrid">')
    (tmp_path / "a.cgns").write_text("@(#)ADF Database Version A02011>")
    monkeypatch.chdir(tmp_path)
    for converter in (Vtk, Cgns):
        with pytest.raises(FormatError, match="expected"):
            converter([tmp_path / ("a.vtu" if converter is Vtk else "a.cgns")])
    assert not (tmp_path / "run").exists()


def test_a_time_limit_is_told_from_other_signals():
    assert "too long" in trial.Outcome(-signal.SIGXCPU, "").reason
    assert "too long" not in trial.Outcome(-signal.SIGSEGV, "").reason
