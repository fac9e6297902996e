"""What the pages say can be done can be done: their commands, Python examples and notebooks run."""

import json
import re
import runpy
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path

import nbformat
import pytest
from click.testing import CliRunner
from page_blocks import PAGES, ROOT, blocks, commands

pytestmark = pytest.mark.apart
#: libraries that examples with these words need
OPTIONAL = {"to_pyvista": "pyvista", "to_meshio": "meshio", "to_xarray": "xarray", "to_pandas": "pandas"}


#: of lines that are followed, where a page doesn't say how long they are
TOLERANCE, LENGTH = "1e-4", "0.2"
#: options with which lines have a length already, or go through time
IN_TIME = {"--length", "--duration", "--kind"}
#: the pages with commands, but for the first, the README
WITH_COMMANDS = [page for page in PAGES[1:] if commands(page)]
WITH_PYTHON = [page for page in PAGES if blocks(ROOT, page, "python")]


@pytest.fixture
def run_commands(page_folder, monkeypatch):
    """Small pictures and coarse lines will do, viewers end at once; what reads absent files of solvers is left out."""
    from elvis.plugins.command.command import elvis

    monkeypatch.syspath_prepend(ROOT / "examples")

    def run(page):
        absent = {name for name in import_module("page_data").SOURCES if name and not Path(name).exists()}
        for words in map(sooner, commands(page)):
            if not absent.intersection(words):
                outcome = CliRunner().invoke(elvis, words, standalone_mode=False)
                assert outcome.exception is None, f"{words}: {outcome.exception}"

    return run


def sooner(words):
    """The words of a command with options for less work."""
    found = [followed_sooner(word) if is_followed(before, word) else word for before, word in pairwise(["", *words])]
    # which has seeds alone after --streamlines
    if words[0] == "extract":
        return words
    if words[0] in ("render", "animate"):
        found += ["--size", "80x60", "--samples", "1"]
    if words[0] == "compare" and not any(word.endswith(".npz") for word in words):
        found += ["--size", "24x18"]
    if words[0] == "trace" and "--cores" not in words:
        found += ["--tolerance", TOLERANCE]
        if not IN_TIME.intersection(words):
            found += ["--length", LENGTH]
    if words[0] == "view":
        found += ["--no-browser", "--idle", "0.1"]
    return found


def followed_sooner(seeds):
    """Streamlines in a picture, short and rough ones; those through time are as long as their duration says."""
    short = "" if "length=" in seeds or "since=" in seeds else f";length={LENGTH}"
    return f"{seeds};tolerance={TOLERANCE}{short}"


def is_followed(option, value):
    """Whether an option asks for lines that are integrated, which cores and curves on walls aren't."""
    return option == "--streamlines" and not value.startswith(("cores=", "along="))


def test_commands_of_the_readme_run_in_an_empty_folder(tmp_path, monkeypatch):
    """The first one writes the sample that the others read."""
    from elvis.plugins.command.command import elvis

    monkeypatch.chdir(tmp_path)
    every = commands("README.md")
    assert every[0] == ["sample", "wing"]
    for words in map(sooner, every):
        outcome = CliRunner().invoke(elvis, words, standalone_mode=False)
        assert outcome.exception is None, f"{words}: {outcome.exception}"


@pytest.mark.sampled(least=len(WITH_COMMANDS) // 8, free=("page",))
@pytest.mark.parametrize("page", WITH_COMMANDS)
def test_commands_run(page, run_commands):
    run_commands(page)


@pytest.mark.sampled(least=len(WITH_PYTHON) // 5, free=("page",))
@pytest.mark.parametrize("page", WITH_PYTHON)
def test_python_examples_run(root, page, page_folder):
    """Those of one page follow one another; what needs a library that is not installed is left out."""
    names = {"__name__": "__main__"}
    for number, source in enumerate(blocks(root, page, "python"), 1):
        if all(find_spec(module) for word, module in OPTIONAL.items() if word in source):
            exec(compile(source, f"{page} example {number}", "exec"), names)


@pytest.mark.sampled(free=("path",))
@pytest.mark.parametrize("path", sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_run(path, page_folder):
    """With small pictures, but for those of which numbers are shown."""

    def smaller(source):
        return re.sub(r"size=\((?!300, 300)\d+, \d+\)", "size=(72, 64)", source)

    notebook = runpy.run_path(str(ROOT / "tools" / "notebooks.py"))["run"](path, smaller)
    nbformat.validate(nbformat.from_dict(notebook))
    kept = json.loads(path.read_text(encoding="utf-8"))
    assert [len(cell.get("outputs", ())) for cell in kept["cells"]] == [
        len(cell.get("outputs", ())) for cell in notebook["cells"]
    ], "make pages"
