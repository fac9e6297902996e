import os
import shutil
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path

import pytest

# NumPy reads this once, when it is first imported: beside other workers, threads of its matrix products wait for each
# other at a cost of milliseconds per product
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


# tests start hundreds of processes, each of which would compile all modules again
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def set_vector_width(kernels):
    """Let software Vulkan work with vectors of 128 bits, for which it compiles kernels in two thirds of the time.

    Pictures are the same at any width (tests/renderer/test_vector_width.py).  Its own cache takes kernels of one width
    for those of another, so these tests have a folder ``kernels`` for theirs.
    """
    if "LP_NATIVE_VECTOR_WIDTH" not in os.environ:
        kernels.mkdir(parents=True, exist_ok=True)
        os.environ.update(LP_NATIVE_VECTOR_WIDTH="128", MESA_SHADER_CACHE_DIR=str(kernels))


def keep_compiled(kernels):
    """Let the compiler of slang's CPU target, which slang asks anew each time, keep what it has made in a folder."""
    compiler = shutil.which("g++")
    if compiler is None or shutil.which("sha256sum") is None or "KEPT_COMPILER" in os.environ:
        return
    about = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False).stdout
    versions = f"{about} slangpy {version('slangpy')}"
    os.environ.update(KEPT_COMPILER=compiler, KEPT_KERNELS=str(kernels), KEPT_VERSIONS=versions)
    os.environ["PATH"] = os.pathsep.join([str(Path(__file__).parent / "compiler"), os.environ["PATH"]])
    for kernel in kernels.glob("*.so"):
        if kernel.stat().st_mtime < time.time() - WEEK:
            kernel.unlink(missing_ok=True)


CACHE = Path(__file__).parents[1] / ".pytest_cache"
WEEK = 7 * 24 * 3600
set_vector_width(CACHE / "kernels")
keep_compiled(CACHE / "compiled")

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "nektar"
#: processor seconds of ``job`` on the machine for which limits were chosen
JOB_SECONDS = 0.045
#: modules of more than about six processor seconds with nothing compiled: ``make check`` leaves them out
LONG = (Path(__file__).parent / "long.txt").read_text(encoding="utf-8").split()


def pytest_configure(config):
    config.addinivalue_line("markers", "long: in a module of many seconds, which `make check` leaves out")


def pytest_collection_modifyitems(items):
    here = Path(__file__).parent
    for item in items:
        if str(item.path.relative_to(here).with_suffix("")) in LONG:
            item.add_marker("long")


@pytest.fixture(scope="session")
def nektar():
    """The folder of the solver's own files, which lies next to the repository."""
    if not DATA.is_dir():
        pytest.skip(f"there is no {DATA}")
    return DATA


@pytest.fixture(scope="session")
def slowness():
    """How many times slower than that machine this one is, 1 at least: limits in seconds are multiplied by it."""

    def seconds():
        start = time.process_time()
        job()
        return time.process_time() - start

    return max(1.0, min(seconds() for _ in range(5)) / JOB_SECONDS)


def job():
    """Work as readers do it: numbers to text and back."""
    text = " ".join(str(number / 7) for number in range(50000))
    return sum(float(word) for word in text.split())
