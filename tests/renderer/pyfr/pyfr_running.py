"""PyFR for tests and benchmarks: what configurations share, its library of small products, elements that are dealt."""

import json
import subprocess
import sys
from pathlib import Path

#: Euler's equations between walls that slip; kinds of elements, what there is at first and plugins are still to come
CONFIG = """
[backend]
precision = double
[backend-openmp]
cflags = -O0
[constants]
gamma = 1.4
[solver]
system = euler
order = {order}
[solver-time-integrator]
scheme = euler
controller = none
tstart = 0
tend = {end}
dt = {step}
[solver-interfaces]
riemann-solver = rusanov
[soln-bcs-wall]
type = slp-adia-wall
"""
#: PyFR's own commands, with a partitioner that deals elements out; of n elements and k owners i * k // n is that of i
COMMANDS = """
import json
import sys
import numpy as np
from pyfr.__main__ import main
from pyfr.partitioners.base import BasePartitioner

owners = json.loads(sys.argv.pop(1))

class Dealt(BasePartitioner):
    name, has_part_weights, has_multiple_constraints = "dealt", True, True
    int_opts, enum_opts, dflt_opts = [], {}, {}

    def _partition_graph(self, graph, partwts):
        count = len(graph.vtab) - 1
        return np.array(owners, np.int32)[np.arange(count) * len(owners) // count]

main()
"""


def imported(source, mesh):
    """Write the mesh of a file for PyFR."""
    _command([], "import", source, mesh)


def deal(mesh, owners):
    """Divide the elements of a mesh among processes, whose numbers are given for equal shares of the elements."""
    _command(owners, "partition", "add", "-f", "-p", "dealt", "-e", "balanced", mesh, str(max(owners) + 1))


def prepared(folder):
    """What PyFR's environment has so that its library of small products and its kernels are in a folder, compiled."""
    library = folder / "libxsmm.so"
    source = Path(__file__).parent / "xsmm.c"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", source, "-o", library], check=True)
    places = {"PYFR_XSMM_LIBRARY_PATH": str(library), "PYFR_OMP_CACHE_DIR": str(folder / "cache")}
    return {**places, "OMP_NUM_THREADS": "1"}


def _command(owners, *words):
    subprocess.run([sys.executable, "-c", COMMANDS, json.dumps(list(owners)), *map(str, words)], check=True)
