import ctypes
import gc
import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections import defaultdict
from functools import cache
from importlib.metadata import version
from pathlib import Path

import hypothesis
import pytest

# what examples take says how busy the machine is, nothing of the code
hypothesis.settings.register_profile("busy", deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile("busy")

# NumPy reads this once, when it is first imported: next to other workers, threads of its matrix products wait for each
# other at a cost of milliseconds per product
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


# tests start hundreds of processes, each of which would compile all modules again
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def compile_sooner(kernels):
    """Let software Vulkan work with vectors of 128 bits; neither it nor Slang optimises: compiling takes half the time.

    Pictures are the same at any width, optimised or not (tests/renderer/test_vector_width.py).  Its own cache takes
    kernels of one kind for those of another, so these tests have a folder ``kernels`` for theirs.
    """
    os.environ.setdefault("ELVIS_SLANG_OPTIMIZATION", "none")
    if "LP_NATIVE_VECTOR_WIDTH" not in os.environ:
        kernels.mkdir(parents=True, exist_ok=True)
        settings = {"LP_NATIVE_VECTOR_WIDTH": "128", "GALLIVM_PERF": "nopt", "MESA_SHADER_CACHE_DIR": str(kernels)}
        os.environ.update(settings)


def keep_compiled(kernels):
    """Let the compiler of slang's CPU target, which slang asks again each time, keep what it has made in a folder."""
    compiler = shutil.which("g++")
    if compiler is None or shutil.which("sha256sum") is None or "KEPT_COMPILER" in os.environ:
        return
    about = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=False).stdout
    versions = f"{about} slangpy {version('slangpy')}"
    os.environ.update(KEPT_COMPILER=compiler, KEPT_KERNELS=str(kernels), KEPT_VERSIONS=versions)
    os.environ["PATH"] = os.pathsep.join([str(Path(__file__).parent / "compiler"), os.environ["PATH"]])
    wait_longer()
    for kept in kernels.glob("*"):
        if kept.stat().st_mtime < time.time() - WEEK:
            kept.unlink(missing_ok=True)


def keep_memory():
    """Let processes that are started keep what they have freed: pages that are requested again cost a virtual machine
    more than the arithmetic on them (glibc alone reads these)."""
    os.environ.setdefault("MALLOC_TRIM_THRESHOLD_", str(1 << 28))
    os.environ.setdefault("MALLOC_MMAP_THRESHOLD_", str(1 << 28))


def give_back_memory():
    """Return to the system what tests have freed, which `keep_memory` keeps."""
    from elvis.core.base.memory import release_free_memory

    gc.collect()
    release_free_memory()


def wait_longer():
    """Let sleeps be a millisecond longer, also those of processes that are started.

    While a compiler runs, slang looks for its end after sleeps of no length, up to 20,000 times a second.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_TIMERSLACK, ctypes.c_ulong(1_000_000))


#: of linux/prctl.h, in nanoseconds
PR_SET_TIMERSLACK = 29
CACHE = Path(__file__).parents[1] / ".pytest_cache"
WEEK = 7 * 24 * 3600
keep_memory()
compile_sooner(CACHE / "kernels")
keep_compiled(CACHE / "compiled")

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "nektar"
#: processor seconds of ``job`` on the machine for which limits were chosen
JOB_SECONDS = 0.045
#: modules of more than about six processor seconds with nothing compiled: ``make check`` leaves them out
LONG = (Path(__file__).parent / "long.txt").read_text(encoding="utf-8").split()


#: of families of tests samples run, for which this is the seed; whole families where EVERY_TEST is in the environment
SEED = os.environ.get("SAMPLE_SEED", "1")


def pytest_configure(config):
    config.addinivalue_line("markers", "long: in a module of many seconds, which `make check` leaves out")
    config.addinivalue_line(
        "markers",
        "sampled(least=1, free=()): of these cases a sample runs, so many at least, in which each parameter but those"
        " that are free has each of its values; `make every-test` runs all",
    )
    config.addinivalue_line(
        "markers", "thorough: seconds of work on what quicker tests cover as well; `make every-test` runs it"
    )
    config.addinivalue_line("markers", "apart: leaves nothing for the next test: open devices may be closed after it")
    config.addinivalue_line("markers", "own_devices: about opening and closing devices: none is kept open for these")


@cache
def is_long(path):
    """Whether ``make check`` leaves a module out."""
    return str(path.relative_to(Path(__file__).parent).with_suffix("")) in LONG


def pytest_ignore_collect(collection_path, config):
    """Modules that are left out need not be imported, which takes each process seconds; None lets others decide."""
    return True if config.option.markexpr == "not long" and is_long(collection_path) else None


def pytest_collection_modifyitems(config, items):
    for item in items:
        if is_long(item.path):
            item.add_marker("long")

    # a test that is named runs, whether it is in the sample or not
    if "EVERY_TEST" not in os.environ and not any("::" in argument for argument in config.args):
        families = defaultdict(list)
        for item in items:
            families[item.nodeid.partition("[")[0] if item.get_closest_marker("sampled") else item.nodeid].append(item)
        chosen = {item for name, family in families.items() for item in sample(name, family)}
        chosen = {item for item in chosen if item.get_closest_marker("thorough") is None}
        config.hook.pytest_deselected(items=[item for item in items if item not in chosen])
        items[:] = [item for item in items if item in chosen]


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Thousands of tests and their modules stay until the end: the garbage collector needn't look at them each time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish():
    """Nor afterwards."""
    gc.freeze()


def sample(name, family):
    """The cases that run of a family of tests, which the marker ``sampled`` tells; always the same for a seed.

    Greedily: the case with most values that none before it has, the first of those in a random order.
    """
    marker = family[0].get_closest_marker("sampled")
    if marker is None:
        return family
    least, free = marker.kwargs.get("least", 1), marker.kwargs.get("free", ())
    left, chosen, seen = random.Random(f"{SEED} {name}").sample(family, len(family)), [], set()

    def new(case):
        values = {(name, repr(value)) for name, value in case.callspec.params.items() if name not in free}
        return values - seen

    while left:
        best = max(left, key=lambda case: len(new(case)))
        if len(chosen) >= least and not new(best):
            break
        seen |= new(best)
        chosen.append(best)
        left.remove(best)
    return chosen


@pytest.fixture(scope="session")
def nektar():
    """The folder of the solver's own files, which lies next to the repository."""
    if not DATA.is_dir():
        pytest.skip(f"there is no {DATA}")
    return DATA


@pytest.fixture
def elvis():
    """Run a command in this process and return what it printed; failures come out as they are."""

    from click.testing import CliRunner

    from elvis.plugins.command.command import elvis as group

    def run(*arguments):
        outcome = CliRunner().invoke(group, [str(argument) for argument in arguments], standalone_mode=False)
        if outcome.exception:
            raise outcome.exception
        return outcome.stdout

    return run


@pytest.fixture
def elvis_json(elvis):
    """As ``elvis``, what is printed parsed as strict JSON."""

    def refuse(constant):
        raise ValueError(constant)

    return lambda *arguments: json.loads(elvis(*arguments, "--json"), parse_constant=refuse)


class Started:
    """Runs of the command line in processes of their own, in a folder."""

    elvis = (sys.executable, "-c", "from elvis.plugins.command.command import main; main()")
    _mpiexec = Path(sys.executable).with_name("mpiexec")

    def alone(self, folder, *words):
        """One process."""
        return self._run(folder, *self.elvis, *words)

    def ranks(self, folder, *parts):
        """So many processes together for each part, a number and words."""
        return self.processes(folder, *((count, *self.elvis, *words) for count, *words in parts))

    def processes(self, folder, *parts):
        """The same of any commands."""
        if not self._mpiexec.exists():
            pytest.skip("there is no mpiexec beside Python")
        several = [word for count, *words in parts for word in (":", "-n", str(count), *words)]
        return self._run(folder, self._mpiexec, *several[1:])

    def _run(self, folder, *command):
        return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


@pytest.fixture(scope="session")
def started():
    """Commands in processes of their own, alone or under mpiexec."""
    return Started()


#: devices by name, and renderers on them, that stay open from test to test
OPENED, RENDERERS = {}, {}
#: bytes of a process from which, between modules, what is free is given back to the system and open devices are closed,
#: with all that they hold of kernels; bytes by which it may grow within a module until what is free goes
MUCH_RESIDENT, MOST_GROWTH = 3 << 28, 1 << 27
#: bytes of this process when memory was last given back
after_giving_back = 0


#: bytes of compiled kernels that tests keep, and of the modules that these are compiled of
MOST_KERNELS = 96 << 20


def keep_kernels(folder):
    """Keep the kernels that tests compile in their own processes in a folder with room for all of them.

    In the user's cache, where there is room for those of some scenes, the thousand kernels of all tests would push each
    other out, and every command that tests start would copy them.
    """
    from elvis.core.files.keeping import cache_folder
    from elvis.renderer.device import compiled_modules
    from elvis.renderer.device.kernels import cache as kernel_cache

    users = cache_folder("kernels")

    def place(name):
        # tests of the cache have one of their own
        return folder / name if users and cache_folder("kernels") == users else cache_folder(name)

    kernel_cache.cache_folder = place
    kernel_cache.MOST_BYTES = compiled_modules.MOST_BYTES = MOST_KERNELS


def close_devices():
    """Close what is open, and the cache: the next one has what other workers have compiled meanwhile."""
    from elvis.renderer.device.device import Device
    from elvis.renderer.device.kernels import cache as kernel_cache

    RENDERERS.clear()
    for device in dict.fromkeys(OPENED.values()):
        Device.close(device)
    OPENED.clear()
    for own in kernel_cache._caches.values():
        own.close()
    kernel_cache._caches.clear()


def resident():
    """Bytes of memory that this process has; 0 where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[1])
    except OSError:
        return 0
    return pages * os.sysconf("SC_PAGESIZE")


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_teardown(item, nextitem):
    """Release memory as it grows, and between modules: what all tests free and compile would take gigabytes."""
    global after_giving_back
    yield
    is_last = nextitem is None or nextitem.path != item.path or item.get_closest_marker("apart") is not None
    if resident() < (MUCH_RESIDENT if is_last else max(MUCH_RESIDENT, after_giving_back + MOST_GROWTH)):
        return
    give_back_memory()
    if is_last and OPENED and resident() > MUCH_RESIDENT:
        close_devices()
        give_back_memory()
    after_giving_back = resident()


@pytest.fixture(scope="session")
def devices():
    """``devices(name)`` in place of ``Device(name)``: each is opened once and stays open, so that slang, which no cache
    spares the work, links a kernel once for all tests that run in this process."""
    from elvis.renderer.device.device import Device

    keep_kernels(CACHE / "slang")

    class Kept(Device):
        def close(self):
            """Leave it open."""

    def device(name="auto"):
        if name not in OPENED:
            fresh = Kept(name)
            same = next((own for own in OPENED.values() if own.adapter.name == fresh.adapter.name), fresh)
            if same is not fresh:
                Device.close(fresh)
            OPENED[name] = same
        return OPENED[name]

    yield device
    close_devices()


@pytest.fixture(autouse=True)
def kept_devices(request, devices, monkeypatch):
    """Renderers take these, but for tests that are about devices (marker ``own_devices``)."""
    if request.node.get_closest_marker("own_devices") is None:
        monkeypatch.setattr("elvis.renderer.frame.renderer.Device", devices)


@pytest.fixture(scope="session")
def renderer(devices):
    """A renderer by name of the device; only a missing Vulkan driver is a reason to skip, and not in CI."""
    from elvis import Renderer
    from elvis.renderer.device.adapters import ADVICE, adapters

    def make(name):
        if name == "vulkan" and not any(adapter.kind == "vulkan" for adapter in adapters()):
            if os.environ.get("CI"):
                pytest.fail(f"no Vulkan device: {ADVICE}")
            pytest.skip(f"no Vulkan device: {ADVICE}")
        if name not in RENDERERS:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr("elvis.renderer.frame.renderer.Device", devices)
                RENDERERS[name] = Renderer(name)
        return RENDERERS[name]

    return make


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
