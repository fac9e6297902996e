"""PyFR itself, on two processes: as a host, whose last picture is that of the file that it writes; its steps."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
from pyfr_running import CONFIG, deal, imported, prepared

from elvis import open_series, render
from elvis.core.integrals import integrate
from elvis.plugins.testing.steps import agree

#: how many squares the mesh has in a row and in a column
WIDE, HIGH = 3, 2
#: of the configuration what it doesn't share with others
OWN = """
[solver-interfaces-line]
flux-pts = gauss-legendre
[solver-elements-quad]
soln-pts = gauss-legendre
[soln-ics]
rho = 1 + 0.2*exp(-2*((x - 0.7)*(x - 0.7) + (y - 0.4)*(y - 0.4)))
u = (1 - y)*exp(-2*((x - 1.5)*(x - 1.5) + (y - 1)*(y - 1)))
v = (x - 1.5)*exp(-2*((x - 1.5)*(x - 1.5) + (y - 1)*(y - 1)))
p = 1 - 0.125*exp(-4*((x - 1.5)*(x - 1.5) + (y - 1)*(y - 1)))
[soln-plugin-writer]
dt-out = 0.002
basename = case-{t:.3f}
[soln-plugin-elvis]
scene = scene.toml
every = 2
output = rho_{step}.png
[soln-plugin-elvis-wrong]
scene = wrong.toml
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


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    """The folder of a vortex in a closed box that PyFR has computed, and what it said."""
    pytest.importorskip("pyfr")
    folder, programs = tmp_path_factory.mktemp("pyfr"), Path(sys.executable).parent
    if shutil.which("cc") is None or not (programs / "mpiexec").exists():
        pytest.skip("there is no C compiler or no mpiexec")
    around = {**os.environ, **prepared(folder), "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}"}

    def run(*words):
        done = subprocess.run(words, cwd=folder, env=around, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stderr

    (folder / "mesh.msh").write_text(mesh_file())
    (folder / "case.ini").write_text(CONFIG.format(order=2, end=0.004, step=0.001) + OWN)
    (folder / "scene.toml").write_text('field = "rho"\nsize = [30, 20]\n')
    (folder / "wrong.toml").write_text('field = "temperature"\noutputs = ["wrong.png"]\n')
    imported(folder / "mesh.msh", folder / "mesh.pyfrm")
    # each process has half of the elements, out of order
    deal(folder / "mesh.pyfrm", [0, 0, 1, 0, 1, 1])
    host = ("-m", "elvis.renderer.insitu.pyfr_host", "run", "-b", "openmp", "mesh.pyfrm", "case.ini")
    return folder, run("mpiexec", "-n", "2", sys.executable, *host)


@pytest.mark.thorough
def test_the_last_picture_is_that_of_the_file(computed, tmp_path):
    folder, told = computed
    assert told.count("was not drawn; the solver continues") == 1
    assert "temperature" in told
    assert sorted(path.name for path in folder.glob("*.png")) == ["rho_0.png", "rho_2.png", "rho_4.png"]
    files = [str(folder / name) for name in ("mesh.pyfrm", "case-0.004.pyfrs", "scene.toml")]
    render(*files, output=str(tmp_path / "file.png"))
    assert (folder / "rho_4.png").read_bytes() == (tmp_path / "file.png").read_bytes()


def solved(folder):
    """PyFR's own places (n, 3) of its solution points, the times of its steps, and values (steps, n, 4) there."""
    inifile, shapes = pytest.importorskip("pyfr.inifile"), pytest.importorskip("pyfr.shapes")
    with h5py.File(folder / "mesh.pyfrm") as mesh:
        elements = mesh["eles/quad"]
        nodes = mesh["nodes"]["location"][elements["nodes"]]
    steps = []
    for path in sorted(folder.glob("case-*.pyfrs")):
        with h5py.File(path) as file:
            settings, stats = (inifile.Inifile(file[name][()].decode()) for name in ("config", "stats"))
            values = file["soln/p2-quad"][()].transpose(0, 2, 1).reshape(-1, 4)
        steps.append((stats.getfloat("solver-time-integrator", "tcurr"), values))
    shape = shapes.QuadShape(nodes.shape[1], settings)
    places = np.einsum("nq,enc->eqc", shape.sbasis.nodal_basis_at(shape.upts).T, nodes).reshape(-1, 2)
    times, values = zip(*steps, strict=True)
    return np.pad(places, ((0, 0), (0, 1))), times, np.array(values)


def test_steps_are_a_series_of_the_solvers_values(computed, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder, _ = computed
    points, times, values = solved(folder)
    assert times == pytest.approx((0, 0.002, 0.004), rel=1e-12)
    series = open_series(folder / "mesh.pyfrm", folder / "case-*.pyfrs")
    agree(series, points, times, dict(zip(("rho", "rhou", "rhov", "E"), np.moveaxis(values, 2, 0), strict=True)))

    # walls let no mass and no energy through, while the vortex turns both
    assert (np.abs(values[2] - values[0])[:, [0, 3]].max(axis=0) > 1e-4).all()
    held = [[row.value for row in integrate(step, ["rho", "E"])] for step in series]
    assert np.abs(np.subtract(held, held[0])).max() < 1e-12
