"""Some damaged files, with a fixed seed, are read or rejected with a one-line error; ``make fuzz`` does many more."""

import importlib.util
import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parent


def run(*arguments):
    command = [sys.executable, str(HERE / "run.py"), *arguments]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


def loaded(name):
    """A module of the harness."""
    spec = importlib.util.spec_from_file_location(name, HERE / f"{name}.py")
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    finally:
        del sys.modules[name]
    return module


#: our own readers: what the others' libraries take in memory differs from machine to machine, and is for ``make fuzz``
OWN = (
    "native XML,native HDF5,scene toml,scene yaml,scene json,palette,triangles,"
    "points,record,messages,live arrays,fourier,nurbs,elvisdat,nek,gmf,cgns,trixi,horses,vtkhdf"
)

READERS = (*OWN.split(","), "exodus", "hopr", "pyfr", "ngsolve", "gmsh", "vtk", "mfem", "vtx")
READERS += ("live blueprint", "live ngsolve", "live mfem")


def test_damaged_files_are_read_or_rejected(tmp_path):
    done = run("--small", "--cases", "120", "--seed", "14", "--only", OWN, "--keep", str(tmp_path))
    assert done.returncode == 0, done.stdout + done.stderr


def test_readers_without_a_case_are_listed(tmp_path):
    cases = [{"reader": name, "seed": 1, "case": 0, "kind": "read", "seconds": 0.1, "ratio": 1.0} for name in READERS]
    for count, missing in ((len(cases), ""), (len(cases) - 2, f"no cases of {READERS[-2]}, {READERS[-1]}\n")):
        (tmp_path / "log").write_text("".join(json.dumps(case) + "\n" for case in cases[:count]))
        done = run("--sum", str(tmp_path / "log"))
        assert done.returncode == (1 if missing else 0), done.stdout + done.stderr
        assert done.stdout.endswith(missing or f"{count} cases, 0 failures\n")


def test_each_reader_has_files(tmp_path):
    corpus = loaded("corpus")
    if not corpus.SHARED.is_dir():
        pytest.skip(f"there is no {corpus.SHARED}")
    found = corpus.subjects(tmp_path, READERS)
    without = set() if find_spec("adios2") else {"vtx"}
    assert {each.reader for each in found} == set(READERS) - without
    assert all(path.is_file() for each in found for path in each.files)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("body", "kind"),
    [
        ("raise IndexError('7 is out of bounds')", "traceback"),
        ("raise ElvisError('a\\nb')", "no sentence"),
        ("bytearray(300 << 20)", "large"),
        ("os.kill(os.getpid(), 11)", "crash"),
        ("while True: pass", "hang"),
    ],
)
def test_each_kind_of_failure_is_detected(tmp_path, body, kind):
    (tmp_path / "run_bad.py").write_text(
        f"import os, sys\nsys.path.insert(0, {str(HERE)!r})\n"
        "import reading, run, work\nfrom elvis import ElvisError\n"
        "work.PATIENCE = 1.0\nsound = reading.coloured\n"
        f"def bad(paths):\n    sound(paths)\n    if paths[0].read_bytes() != before:\n        {body}\n"
        "import corpus\nbefore = corpus.PALETTE.encode()\nreading.coloured = bad\n"
        f"sys.argv[1:] = ['--only', 'palette', '--small', '--cases', '4', '--keep', {str(tmp_path / 'kept')!r}]\n"
        "sys.exit(run.main())\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, str(tmp_path / "run_bad.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.returncode == 1, done.stdout + done.stderr
    assert f" x {kind} " in done.stdout
    kept = list((tmp_path / "kept").glob(f"palette-{kind.replace(' ', '_')}-*/rainbow.xml"))
    assert kept
    assert b"ColorMap" in kept[0].read_bytes()


def test_time_is_that_of_one_thread(tmp_path):
    (tmp_path / "a.py").write_text(
        f"import os, sys\nsys.path.insert(0, {str(HERE)!r})\nimport run\nimport numpy as np\n"
        "np.ones((500, 500)) @ np.ones((500, 500))\nprint(len(os.listdir('/proc/self/task')))\n"
    )
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    command = [sys.executable, str(tmp_path / "a.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert done.stdout == "1\n", done.stderr


@pytest.mark.thorough
@pytest.mark.parametrize(("reader", "library"), [("gmsh", "gmsh"), ("vtk", "vtkmodules"), ("mfem", "mfem")])
def test_libraries_read_sound_files_in_their_copies(tmp_path, reader, library):
    pytest.importorskip(library)
    done = run("--small", "--cases", "3", "--only", reader, "--keep", str(tmp_path))
    assert "sound files aren't read" not in done.stderr, done.stderr
    assert f"| {reader}" in done.stdout


@pytest.mark.skipif(sys.platform != "linux", reason="processes of processes are found in /proc")
def test_time_of_child_processes_counts(tmp_path):
    spin = "import time\nwhile time.process_time() < 0.5: pass"
    starting = f"import subprocess, sys\nsubprocess.run([sys.executable, '-c', {spin!r}])\nprint(flush=True)\ninput()"
    (tmp_path / "a.py").write_text(
        f"import subprocess, sys\nsys.path.insert(0, {str(HERE)!r})\nimport work\nbefore = work._seconds()\n"
        f"child = subprocess.Popen([sys.executable, '-c', {starting!r}], stdin=-1, stdout=-1)\n"
        "child.stdout.readline()\nprint(work._seconds() - before)\nchild.communicate(b'\\n')\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, str(tmp_path / "a.py")], capture_output=True, text=True, check=False, env=environment
    )
    assert 0.45 < float(done.stdout) < 5, done.stderr


def test_a_case_is_damaged_reproducibly(tmp_path):
    mutations = loaded("mutations")
    sound = "".join(f"<V ID='{i}'>{i / 7} 0 1</V>\n" for i in range(50)).encode()
    found = []
    for _ in range(2):
        (tmp_path / "a.xml").write_bytes(sound)
        mutations.damage(tmp_path / "a.xml", np.random.default_rng(3))
        found.append((tmp_path / "a.xml").read_bytes())
    assert found[0] == found[1] != sound


#: a process with a copy of it that takes 60 MB more, once it is told to
LIBRARY = """
import os, sys, time
kept = bytearray(os.urandom(1 << 20)) * 30
print(flush=True)
sys.stdin.readline()
child = os.fork()
if not child:
    more = bytearray(os.urandom(1 << 20)) * 60
    time.sleep(0.3)
    os._exit(0)
os.waitpid(child, 0)
"""


def test_the_memory_of_libraries_processes_counts():
    work = loaded("work")
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", LIBRARY], stdin=pipe, stdout=pipe, text=True) as process:
        process.stdout.readline()
        with work.Below() as below:
            process.communicate("go\n")
    assert 55 << 10 < below.grown < 70 << 10
