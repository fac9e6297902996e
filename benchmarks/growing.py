"""Memory of PyFR with pictures over many steps: the first process's, as UCX watches memory and as it doesn't.

Beside it PyFR whose plugin draws nothing, or gathers the values of all processes and draws nothing.

    python benchmarks/growing.py [--steps 1000] [--cells 3] [--size 300x200] [--ranks 2] [--does draws,gathers,nothing]

Anonymous memory and the heap in use are noted after each ten steps (Linux, glibc).  A straight line is fitted to those
of the last nine tenths of the steps; its error is that of blocks of ten values, as those next to each other are alike.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import subprocess
import sys
import tempfile
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from hosting import mixed
from measuring import ENVIRONMENT, anonymous_memory
from pyfr_running import CONFIG, deal, prepared
from tables import Table

from elvis.renderer.insitu import pyfr_host

#: steps from one note to the next
EVERY = 10
#: values that are averaged before a line is fitted to them
BLOCK = 10
#: a step in time
STEP = 1e-6
#: of the configuration what it doesn't share with others
OWN = """
[solver-interfaces-quad]
flux-pts = gauss-legendre
[solver-interfaces-tri]
flux-pts = williams-shunn
[solver-elements-hex]
soln-pts = gauss-legendre
[solver-elements-pri]
soln-pts = williams-shunn~gauss-legendre
[solver-elements-pyr]
soln-pts = gauss-legendre
[solver-elements-tet]
soln-pts = shunn-ham
[soln-ics]
rho = 1 + 0.2*exp(-((x - 1)*(x - 1) + (y - 1)*(y - 1) + (z - 2)*(z - 2)))
u = 0.1*y
v = 0
w = 0
p = 1
[soln-plugin-elvis]
scene = scene.toml
output = rho.png
"""


class _MallInfo(ctypes.Structure):
    """What ``mallinfo2`` of glibc gives: number 4 is what is mapped, 7 what is in use of the rest, in bytes."""

    _fields_ = [(f"field_{number}", ctypes.c_size_t) for number in range(10)]


def heap() -> int:
    """Bytes of the heap that are in use, mapped pieces included."""
    ask = ctypes.CDLL(None).mallinfo2
    ask.restype = _MallInfo
    found = ask()
    return int(found.field_4 + found.field_7)


class Noting(pyfr_host.Host):
    """The plugin, whose first process notes its memory; it goes as far as the environment's ``DOES`` says."""

    notes: list[tuple[int, int, int]]

    def __call__(self, intg: Any) -> None:
        step = int(intg.nacptsteps)
        if os.environ["DOES"] == "draws":
            super().__call__(intg)
        elif os.environ["DOES"] == "gathers":
            parts = self._comm.gather(pyfr_host._part(intg, [0]), root=self._root)
            if self._session is not None:
                self._joined(self._names[:1], parts)
        if self._session is not None and step % EVERY == 0:
            self.notes = [*getattr(self, "notes", []), (step, anonymous_memory(), heap())]

    def finalise(self, intg: Any) -> None:
        if self._session is not None:
            notes = {"notes": self.notes, "drawn": self._session.drawn, "faults": self._session.faults}
            Path("notes.json").write_text(json.dumps(notes))
        super().finalise(intg)


def host() -> None:
    """PyFR with that plugin."""
    pyfr_host.Host = Noting  # type: ignore[misc]
    pyfr_host.run()


def lay_out(folder: Path, cells: int, ranks: int, steps: int, size: list[int]) -> None:
    """The mesh in parts, the configuration and the scene."""
    mesh = mixed(folder, cells)
    deal(mesh, range(ranks))
    (folder / "case.ini").write_text(CONFIG.format(order=3, end=STEP * steps, step=STEP) + OWN)
    (folder / "scene.toml").write_text(f'field = "rho"\nsize = {size}\n')


def measured(folder: Path, ranks: int, settings: dict[str, str]) -> dict[str, Any]:
    """What one run notes."""
    around = {**ENVIRONMENT, **prepared(folder), "PYTHONPATH": str(Path(__file__).parent), **settings}
    code = "import growing; growing.host()"
    mpiexec = [str(Path(sys.executable).parent / "mpiexec"), "-n", str(ranks), sys.executable, "-c", code]
    subprocess.run([*mpiexec, "run", "-b", "openmp", "mixed.pyfrm", "case.ini"], cwd=folder, env=around, check=True)
    found: dict[str, Any] = json.loads((folder / "notes.json").read_text())
    assert not found["faults"], found["faults"]
    return found


def slope(steps: Any, values: Any) -> tuple[float, float]:
    """Slope of the line through values (n,) at steps (n,), and its standard error, by averages of blocks."""
    count = len(steps) // BLOCK
    x, y = (np.asarray(own[-count * BLOCK :], np.float64).reshape(count, BLOCK).mean(axis=1) for own in (steps, values))
    (rate, _), covariance = np.polyfit(x - x.mean(), y, 1, cov=True)
    return float(rate), float(np.sqrt(covariance[0, 0]))


def row(name: str, found: dict[str, Any]) -> list[str]:
    """A line of the table."""
    steps, memory, used = np.array(found["notes"]).T
    late = steps > steps[-1] // 10
    cells = [name, f"{found['drawn']:,}"]
    for own in (memory, used):
        cells += [f"{own[late][0] / 2**20:.2f}", f"{own[-1] / 2**20:.2f}"]
        cells.append("{:+.0f} ± {:.0f}".format(*slope(steps[late], own[late])))
    return cells


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--cells", type=int, default=3)
    parser.add_argument("--size", default="300x200")
    parser.add_argument("--ranks", type=int, default=2)
    parser.add_argument("--does", default="draws,gathers,nothing", help="what the plugin does, of these, with commas")
    asked = parser.parse_args()
    least = 4 * EVERY * BLOCK
    if asked.steps < least:
        parser.error(f"--steps: expected {least} or more, so that a line can be fitted, found {asked.steps}")
    columns = [
        "",
        "pictures",
        "anonymous MiB, early",
        "late",
        "bytes a step",
        "heap MiB, early",
        "late",
        "bytes a step",
    ]
    table = Table(
        f"The first of {asked.ranks} processes of PyFR over {asked.steps:,} steps with a picture each", columns
    )
    with tempfile.TemporaryDirectory(prefix="elvis-growing-") as name:
        folder = Path(name)
        lay_out(folder, asked.cells, asked.ranks, asked.steps, list(map(int, asked.size.split("x"))))
        quiet = {"UCX_MEM_EVENTS": "n"}
        for does, settings in product(asked.does.split(","), ({}, quiet)):
            title = ", ".join([does, *(f"{name}={value}" for name, value in settings.items())])
            table.rows.append(row(title, measured(folder, asked.ranks, {"DOES": does, **settings})))
            print(table.text(), flush=True)


if __name__ == "__main__":
    main()
