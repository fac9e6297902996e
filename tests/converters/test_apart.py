import gc
import io
import os
import signal
import subprocess
import sys
import threading
import time
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from elvis.converters.gmsh.gmsh import Gmsh
from elvis.converters.mfem.mfem import Mfem
from elvis.converters.ngsolve.ngsolve import NGSolve
from elvis.converters.shared import apart, copies
from elvis.converters.shared.apart import Apart, LibraryError, receive, send
from elvis.converters.vtk.vtk import Vtk
from elvis.core.base.errors import ElvisError, FormatError

WORKER = """
import os, resource, signal, sys, time
from elvis.converters.shared import apart
from elvis.core.base.errors import ElvisError, FormatError
class Worker:
    def same(self, *given):
        return list(given)
    def limits(self):
        left = resource.getrlimit(resource.RLIMIT_DATA)[0] - apart._data()
        return [left, signal.getitimer(signal.ITIMER_PROF)[0]]
    def origin(self, *changed):
        self.changed = changed or getattr(self, "changed", None)
        return self.changed[0] if self.changed else os.getppid()
    def folder(self):
        return os.getcwd()
    def fail(self, how):
        exec(how)
"""


@pytest.fixture
def worker(tmp_path, monkeypatch):
    """The name of a worker in a module that this process can import."""
    (tmp_path / "working_apart.py").write_text(WORKER)
    monkeypatch.syspath_prepend(tmp_path)
    return "working_apart:Worker"


def test_numbers_texts_and_arrays_come_back_as_they_were(worker):
    arrays = [
        np.arange(6.0).reshape(2, 3).T,
        np.zeros((0, 4), np.int32),
        np.array(7.5),
        np.array(["a", "größer", ""]),
        np.array([True, False]),
        np.arange(5, dtype=">i8")[::2],
        np.array([1, 2**64 - 1], np.uint64),
    ]
    given = [None, 1, -2.5, "\udc80\n", {"": 1, "array": {"items": arrays[0]}}, [[], {}], float("inf"), *arrays]
    with Apart(worker, 0) as process:
        found = process.ask("same", *given, size=0)
    assert found[:4] == given[:4]
    assert list(found[4]) == ["", "array"]
    assert np.array_equal(found[4]["array"]["items"], arrays[0])
    assert found[5:7] == given[5:7]
    for own, wanted in zip(found[7:], arrays, strict=True):
        assert own.dtype == wanted.dtype
        assert own.shape == wanted.shape
        assert np.array_equal(own, wanted)


@pytest.mark.parametrize(
    ("how", "reason"),
    [
        ("while True: pass", "one on which the library takes too long"),
        ("os.abort()", "one on which the library fails"),
        ("os._exit(0)", "one on which the library fails"),
        ("large = bytes(1 << 28)", "one on which the library fails"),
        ("print('x' * 10000)\nraise ValueError", "one on which the library fails"),
    ],
)
def test_a_failure_has_a_reason(worker, monkeypatch, how, reason):
    monkeypatch.setattr(apart, "SECONDS", 1)
    monkeypatch.setattr(apart, "STACK", 0)
    with Apart(worker, 0) as process, pytest.raises(LibraryError) as caught:
        process.ask("fail", how, size=0)
    assert caught.value.reason == reason


def test_a_library_that_hangs_is_stopped(worker, monkeypatch):
    monkeypatch.setattr(apart, "SECONDS", 1)
    monkeypatch.setattr(apart, "_PATIENCE", 0.5)
    monkeypatch.setattr(apart, "_LOADING", 20)
    with Apart(worker, 0) as process:
        process.ask("same", size=0)
        with pytest.raises(LibraryError) as caught:
            process.ask("fail", "time.sleep(1000)", size=0)
    assert caught.value.is_out_of_time


def test_errors_of_elvis_are_passed_back(worker):
    with Apart(worker, 0) as process:
        with pytest.raises(FormatError) as caught:
            process.ask("fail", "raise FormatError('expected x', file='a.b', place='c')", size=0)
        assert (caught.value.message, caught.value.file, caught.value.place) == ("expected x", "a.b", "c")
        with pytest.raises(ElvisError, match="a sentence") as plain:
            process.ask("fail", "raise ElvisError('a sentence')", size=0)
        assert not isinstance(plain.value, FormatError)
        with pytest.raises(LibraryError, match="ValueError: 7"):
            process.ask("fail", "raise ValueError(7)", size=0)
        assert process.ask("same", 3, size=0) == [3]


def test_limits_grow_with_the_files(worker):
    for size, seconds in ((0, apart.SECONDS), (10 * apart.BYTES_PER_SECOND, apart.SECONDS + 10)):
        with Apart(worker, size) as process:
            memory, left = process.ask("limits", size=size)
        assert apart.limit_for(size) - (16 << 20) < memory <= apart.limit_for(size)
        assert seconds - 1 < left < seconds + 0.5


def is_there(pid):
    """Whether a process runs: one that has ended stays listed until another one has noticed."""
    try:
        os.kill(pid, 0)
        return copies.IS_POSSIBLE and Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


def test_processes_end_with_their_objects(worker):
    process = Apart(worker, 0)
    (number,) = process.ask("same", 1, size=0)
    child = process._process.pid
    gc.disable()
    try:
        del process
        while is_there(child):  # its end is detected by the process that it is a copy of
            time.sleep(0.01)
    finally:
        gc.enable()
    assert number == 1
    timers = [thread for thread in threading.enumerate() if isinstance(thread, threading.Timer)]
    # a thread may end a little after it has been told to
    assert all(timer.finished.is_set() for timer in timers)


@pytest.mark.skipif(not copies.IS_POSSIBLE, reason="this system makes no copies of processes")
def test_a_library_is_loaded_once_and_files_are_read_by_copies(worker):
    with Apart(worker, 0) as first, Apart(worker, 0) as second:
        origins = [process.ask("origin", size=0) for process in (first, second)]
        assert origins[0] == origins[1] != os.getpid()

        # what one does to itself, no other sees, not even one that is made later
        assert first.ask("origin", "changed", size=0) == "changed"
        with Apart(worker, 0) as third:
            assert second.ask("origin", size=0) == third.ask("origin", size=0) == origins[0]


@pytest.mark.skipif(not copies.IS_POSSIBLE, reason="this system makes no copies of processes")
def test_an_origin_that_has_ended_is_restarted(worker):
    with Apart(worker, 0) as process:
        origin = process.ask("origin", size=0)
    os.kill(origin, signal.SIGKILL)
    with Apart(worker, 0) as process:
        assert process.ask("origin", size=0) != origin


@pytest.mark.skipif(not copies.IS_POSSIBLE, reason="this system makes no copies of processes")
def test_an_idle_origin_ends(worker, tmp_path):
    """Not while it has copies; and with the process that asks, however that ends."""
    code = f"""
import os, signal, sys, time
sys.path.insert(0, {str(tmp_path)!r})
from elvis.converters.shared import copies
from elvis.converters.shared.apart import Apart
own = "import elvis.converters.shared.copies as c; c.IDLE = 0.2; multiply("
copies._PROGRAM = copies._PROGRAM.replace("multiply(", own)
with Apart({worker!r}, 0) as process:
    origin = process.ask("origin", size=0)
    time.sleep(0.6)
    os.kill(origin, 0)
    assert process.ask("origin", size=0) == origin
(known,) = copies._ORIGINS.values()
known._process.wait()
with Apart({worker!r}, 0) as process:
    print(process.ask("origin", size=0), process._process.pid, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert found.returncode == -signal.SIGKILL, found.stderr
    while any(is_there(int(pid)) for pid in found.stdout.split()):
        time.sleep(0.01)


@pytest.mark.skipif(not copies.IS_POSSIBLE, reason="this system makes no copies of processes")
def test_relative_paths_refer_to_the_requesting_process(worker, tmp_path, monkeypatch):
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        with Apart(worker, 0) as process:
            assert process.ask("folder", size=0) == str(tmp_path / name)


def test_processes_are_used_if_forking_is_impossible(worker, monkeypatch):
    monkeypatch.setattr(apart, "IS_POSSIBLE", False)
    with Apart(worker, 0) as process:
        assert process.ask("origin", size=0) == os.getpid()
        with pytest.raises(LibraryError) as caught:
            process.ask("fail", "os.abort()", size=0)
    assert not caught.value.is_out_of_time


def test_a_library_that_cannot_be_loaded_is_reported(tmp_path, monkeypatch):
    (tmp_path / "not_loaded.py").write_text("raise ImportError")
    monkeypatch.syspath_prepend(tmp_path)
    with Apart("not_loaded:Worker", 0) as process, pytest.raises(LibraryError):
        process.ask("same", size=0)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('{"array": ["<f8", [1000000]]}', "expected an array of 10.* bytes at most"),
        ('{"array": ["|O", [1]]}', "expected an array"),
        ('{"array": ["<f8", [-1]]}', "expected an array"),
        ('{"array": ["?!", [1]]}', "not understood"),
        ("x", "Expecting value"),
    ],
)
def test_messages_of_other_types_are_rejected(text, sentence):
    raw = len(text).to_bytes(8, "little") + text.encode() + bytes(100)
    with pytest.raises(ValueError, match=sentence):
        receive(io.BytesIO(raw), 1 << 20)


def test_objects_are_not_sent():
    for value in (np.array([None]), object(), np.float32(1)):
        with pytest.raises(TypeError):
            send(io.BytesIO(), value)


#: files of each library, and its modules that read them
READ = {
    Gmsh: (["gmsh/mixed_o2_v22.msh"], ["gmsh"]),
    Vtk: (["vtk/dealii_shell_p4.vtu"], ["vtkmodules.vtkIOXML", "vtkmodules.vtkIOLegacy"]),
    Mfem: (["mfem/pipe_nurbs.mesh", "mfem/pipe_nurbs.u.gf"], ["mfem.ser"]),
    NGSolve: (["ngsolve/ballbox_p4.vol"], ["ngsolve"]),
}


@pytest.mark.parametrize("converter", READ)
def test_no_library_reads_a_file_in_this_process(solvers, monkeypatch, converter):
    files, modules = READ[converter]
    for name in modules:
        pytest.importorskip(name)
        without = ModuleType(name)
        without.__spec__ = ModuleSpec(name, None)
        package, _, last = name.rpartition(".")
        monkeypatch.setitem(sys.modules, name, without)
        if package:
            monkeypatch.setattr(sys.modules[package], last, without)
    source = converter([solvers / file for file in files])
    for block in source.blocks:
        points = block.shape.vertices.mean(axis=0, keepdims=True) if block.frame is None else block.frame[:1]
        first = block.take(np.arange(1))
        assert np.isfinite(source.positions(first, points)).all()
        for field in source.fields:
            assert np.isfinite(source.sample(first, field, points)).all()


def test_a_library_that_crashes_later_is_reported(solvers):
    pytest.importorskip("mfem.ser")
    source = Mfem([solvers / "mfem" / "pipe_nurbs.mesh"])
    block = source.blocks[0]
    block.key.geometry.evaluate.__self__._asked._library._process.kill()
    with pytest.raises(FormatError, match=r"pipe_nurbs\.mesh: expected data that MFEM reads, found some"):
        source.positions(block, block.frame)


@pytest.mark.parametrize("name", ["resource", "contextlib", "vtkmodules", "gmsh", "numpy"])
def test_nothing_in_the_working_folder_is_run(tmp_path, monkeypatch, name):
    (tmp_path / f"{name}.py").write_text(f"open({str(tmp_path / 'run')!r}, 'w')")
    (tmp_path / "a.vtu").write_text('<VTKFile type="UnstructuredGrid">')
    (tmp_path / "a.msh").write_text("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n")
    monkeypatch.chdir(tmp_path)
    for converter, file in ((Vtk, "a.vtu"), (Gmsh, "a.msh")):
        with pytest.raises(FormatError, match="expected"):
            converter([tmp_path / file])
    assert not (tmp_path / "run").exists()


def test_a_time_limit_is_distinguished_from_other_signals():
    assert apart._OUT_OF_TIME == -signal.SIGPROF
    assert "too long" in LibraryError(True).reason
    assert "too long" not in LibraryError().reason


def test_closed_pipes_raise_exceptions_even_after_gmsh_has_started():
    """Gmsh's library makes them end the process: a question to a library that has died would have ended ours."""
    pytest.importorskip("gmsh")
    code = """
import gmsh
from elvis.converters.shared.apart import Apart, LibraryError
apart = Apart("elvis.converters.gmsh.library:Library", 0)
gmsh.initialize(["test"], readConfigFiles=False, interruptible=False)
apart._process.kill()
apart._process.wait()
try:
    apart.ask("mesh", "none", "none", False, size=0)
except LibraryError:
    print("an exception")
"""
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "an exception\n"
