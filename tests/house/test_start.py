"""The command starts at once."""

import resource
import subprocess
import sys
from dataclasses import replace

import pytest

from elvis import Dataset, Shape, write
from elvis.core.testing import approximated, grid

#: the quickest of so many runs is that of a quiet moment
REPETITIONS = 4
HELP = "from elvis.plugins.command.command import main; main(['--help'])"


def test_help_costs_little_more_than_its_library():
    """Processor time of the help, as a multiple of what loading click takes: 4.5 on a quiet machine.

    A ratio, so that no slower machine breaks it; the tolerance in seconds is one of the benchmark ``start``.
    """
    library = min(processor_seconds("import click") for _ in range(REPETITIONS))
    command = min(processor_seconds(HELP) for _ in range(REPETITIONS))
    assert command < 8 * library


def processor_seconds(code):
    """Seconds of the processor, user's and system's, that a new interpreter takes to run some code."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def test_import_is_quick_and_loads_nothing_heavy():
    """``import elvis`` takes a third of what loading click takes, which is a measure of the machine."""
    code = "import sys, elvis; assert not {'numpy', 'pydantic', 'click', 'slangpy'} & set(sys.modules)"
    library, own, nothing = (
        min(processor_seconds(each) for _ in range(REPETITIONS)) for each in ("import click", code, "pass")
    )
    assert own - nothing < 1.5 * (library - nothing)


@pytest.mark.parametrize(
    ("words", "heavy"),
    [
        (["--help"], {"numpy", "pydantic", "lxml", "h5py", "slangpy", "rich", "PIL", "asyncio"}),
        (["render", "--help"], {"numpy", "pydantic", "h5py", "slangpy"}),
        (["compare", "--help"], {"numpy", "pydantic", "h5py", "slangpy"}),
    ],
)
def test_help_loads_nothing_heavy(words, heavy):
    lines = (
        "import sys",
        "from elvis.plugins.command.command import elvis",
        f"elvis({words!r}, standalone_mode=False)",
    )
    code = "; ".join([*lines, f"found = {heavy!r} & set(sys.modules)", "assert not found, found"])
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


def test_a_scene_of_options_loads_no_pydantic():
    """It is for what comes from outside: scene files and --set."""
    lines = (
        "import sys",
        "from elvis.scene.commandline.composing import composed",
        "composed((), {'opacity': 0.5}, ())",
    )
    code = "; ".join([*lines, "assert 'pydantic' not in sys.modules"])
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


def test_native_files_are_described_without_converters_and_document_writers(tmp_path):
    """Each of several ranks has what is loaded: nothing that looks for other formats, fetches, or writes XML."""
    mesh = Dataset(grid(Shape.TETRAHEDRON, 1))
    dataset = replace(mesh, fields=(approximated(mesh, "u", lambda p: p[:, 0], 2),))
    files = [str(path) for path in write(dataset, tmp_path / "a.xml", mesh_format="text", field_format="hdf5")]
    heavy = ["urllib.request", "ssl", "html", "concurrent.futures", "elvis.converters.nek.nek", "pydantic"]
    # before Python 3.12, importlib.metadata itself loads it
    heavy += ["email.message"] if sys.version_info >= (3, 12) else []
    lines = (
        "import sys",
        "from elvis.plugins.command.command import elvis",
        f"elvis(['info', '--extrema', *{files!r}], standalone_mode=False)",
        f"found = [name for name in {heavy!r} if name in sys.modules]",
        "assert not found, found",
    )
    subprocess.run([sys.executable, "-c", "; ".join(lines)], check=True, capture_output=True)
