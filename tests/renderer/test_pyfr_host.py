"""PyFR itself, on two processes, as a host: its last picture is that of the file which it writes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from elvis.renderer import render

#: how many squares the mesh has in a row and in a column
WIDE, HIGH = 3, 2
CONFIG = """
[backend]
precision = double
[backend-openmp]
cflags = -O0
[constants]
gamma = 1.4
[solver]
system = euler
order = 2
[solver-time-integrator]
scheme = euler
controller = none
tstart = 0
tend = 0.004
dt = 0.001
[solver-interfaces]
riemann-solver = rusanov
[solver-interfaces-line]
flux-pts = gauss-legendre
[solver-elements-quad]
soln-pts = gauss-legendre
[soln-bcs-wall]
type = slp-adia-wall
[soln-ics]
rho = 1 + 0.2*exp(-2*((x - 0.7)*(x - 0.7) + (y - 0.4)*(y - 0.4)))
u = 0.1*y
v = 0
p = 1
[soln-plugin-writer]
dt-out = 0.004
basename = case-{t:.3f}
[soln-plugin-elvis]
scene = scene.toml
every = 2
output = rho_{step}.png
[soln-plugin-elvis-wrong]
scene = wrong.toml
"""
#: PyFR's own commands, with a partitioner that gives each process half of the elements, out of order
PREPARE = """
import sys
import numpy as np
from pyfr.__main__ import main
from pyfr.partitioners.base import BasePartitioner

class Halves(BasePartitioner):
    name, has_part_weights, has_multiple_constraints = "halves", True, True
    int_opts, enum_opts, dflt_opts = [], {}, {}

    def _partition_graph(self, graph, partwts):
        return np.array([0, 0, 1, 0, 1, 1], np.int32)

for words in ("import mesh.msh mesh.pyfrm", "partition add -f -p halves mesh.pyfrm 2"):
    sys.argv[1:] = words.split()
    main()
"""


def mesh_file():
    """A rectangle of squares as MSH 2.2, with its boundary."""

    def node(i, j):
        return 1 + i + j * (WIDE + 1)

    nodes = [f"{node(i, j)} {i} {j} 0" for j in range(HIGH + 1) for i in range(WIDE + 1)]
    rows = [(i, j) for j in range(HIGH) for i in range(WIDE)]
    squares = [f"3 2 1 1 {node(i, j)} {node(i + 1, j)} {node(i + 1, j + 1)} {node(i, j + 1)}" for i, j in rows]
    walls = [(node(i, j), node(i + 1, j)) for i in range(WIDE) for j in (0, HIGH)]
    walls += [(node(i, j), node(i, j + 1)) for j in range(HIGH) for i in (0, WIDE)]
    elements = squares + [f"1 2 2 1 {first} {last}" for first, last in walls]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "2", '2 1 "fluid"', '1 2 "wall"']
    lines += ["$EndPhysicalNames", "$Nodes", str(len(nodes)), *nodes, "$EndNodes", "$Elements", str(len(elements))]
    return "\n".join([*lines, *(f"{i + 1} {text}" for i, text in enumerate(elements)), "$EndElements", ""])


@pytest.fixture
def run(tmp_path):
    """Run a program in the folder of the case, with what PyFR needs."""
    pytest.importorskip("pyfr")
    programs = Path(sys.executable).parent
    if shutil.which("cc") is None or not (programs / "mpiexec").exists():
        pytest.skip("there is no C compiler or no mpiexec")
    library = tmp_path / "libxsmm.so"
    source = Path(__file__).parent / "pyfr" / "xsmm.c"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", str(source), "-o", str(library)], check=True)
    own = {"PYFR_XSMM_LIBRARY_PATH": str(library), "PYFR_OMP_CACHE_DIR": str(tmp_path / "cache")}

    def start(*words):
        environment = {
            **os.environ,
            **own,
            "OMP_NUM_THREADS": "1",
            "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
        }
        done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stderr

    return start


def test_the_last_picture_is_that_of_the_file(run, tmp_path):
    (tmp_path / "mesh.msh").write_text(mesh_file())
    (tmp_path / "case.ini").write_text(CONFIG)
    (tmp_path / "scene.toml").write_text('field = "rho"\nsize = [30, 20]\n')
    (tmp_path / "wrong.toml").write_text('field = "temperature"\noutputs = ["wrong.png"]\n')
    run(sys.executable, "-c", PREPARE)
    host = ("-m", "elvis.renderer.pyfr_host", "run", "-b", "openmp", "mesh.pyfrm", "case.ini")
    told = run("mpiexec", "-n", "2", sys.executable, *host)
    assert told.count("has no picture, the solver goes on") == 1
    assert "temperature" in told
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["rho_0.png", "rho_2.png", "rho_4.png"]
    files = [str(tmp_path / name) for name in ("mesh.pyfrm", "case-0.004.pyfrs", "scene.toml")]
    render(*files, output=str(tmp_path / "file.png"))
    assert (tmp_path / "rho_4.png").read_bytes() == (tmp_path / "file.png").read_bytes()
