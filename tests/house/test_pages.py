"""What the pages say can be done can be done: examples and commands run, links lead somewhere."""

import json
import re
import runpy
import shlex
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import nbformat
import pytest
from click.testing import CliRunner

from elvis.scene.files import read_scene

AREAS = ("formats", "plugins", "converters", "renderer", "reference")
ROOT = Path(__file__).resolve().parents[2]
DOCS = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").rglob("*.md"))
PAGES = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", *DOCS, *(f"{area}/README.md" for area in AREAS))
#: libraries that examples with these words need
OPTIONAL = {"to_pyvista": "pyvista", "to_meshio": "meshio", "to_xarray": "xarray", "to_pandas": "pandas"}
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)
LINK = re.compile(r"\]\(([^)#:]+)\)")


def blocks(root, page, language):
    """The code blocks of a page in one language."""
    return [text for tongue, text in BLOCK.findall((root / page).read_text(encoding="utf-8")) if tongue == language]


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(root, page):
    text = (root / page).read_text(encoding="utf-8")
    missing = [link for link in LINK.findall(text) if not (root / page).parent.joinpath(link).exists()]
    assert not missing


def commands(page):
    """The lines of a page that call elvis, as lists of words."""
    lines = [line for block in blocks(ROOT, page, "sh") for line in block.splitlines()]
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("elvis ")]


@pytest.mark.parametrize("page", [page for page in PAGES if commands(page)])
def test_commands_run(page, wing, monkeypatch):
    """Small pictures will do; without the solvers' files the commands that read them are left out."""
    from elvis.plugins.command import elvis

    monkeypatch.syspath_prepend(ROOT / "examples")
    absent = {name for name in import_module("page_data").SOURCES if name and not Path(name).exists()}
    for words in commands(page):
        if words[0] == "render":
            words += ["--size", "160x120"]
        if not absent.intersection(words):
            outcome = CliRunner().invoke(elvis, words, standalone_mode=False)
            assert outcome.exception is None, f"{words}: {outcome.exception}"


@pytest.mark.parametrize("page", DOCS)
def test_pictures_of_a_page_are_what_its_commands_draw(page):
    drawn = {word for words in commands(page) for word in words}
    shown = re.findall(r"\]\((?:\.\./)?pictures/([^)]+)\)", (ROOT / page).read_text(encoding="utf-8"))
    assert set(shown) <= drawn


@pytest.mark.parametrize("page", PAGES)
def test_make_targets_that_are_shown_exist(root, page):
    text = (root / page).read_text(encoding="utf-8")
    targets = set(re.findall(r"^(\w+):", (root / "Makefile").read_text(encoding="utf-8"), re.M))
    assert set(re.findall(r"\bmake (\w+)$", text, re.M)) | set(re.findall(r"`make (\w+)`", text)) <= targets


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(ROOT, page, "python")])
def test_python_examples_run(root, page, wing):
    """Those of one page follow one another; what needs a library that is not installed is left out."""
    names = {"__name__": "__main__"}
    for number, source in enumerate(blocks(root, page, "python"), 1):
        if all(find_spec(module) for word, module in OPTIONAL.items() if word in source):
            exec(compile(source, f"{page} example {number}", "exec"), names)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(ROOT, page, "toml")])
def test_scenes_of_pages_are_scenes(page, tmp_path):
    for number, text in enumerate(blocks(ROOT, page, "toml")):
        if text.startswith("data ="):
            path = tmp_path / f"{number}.toml"
            path.write_text(text, encoding="utf-8")
            assert read_scene(path).objects


@pytest.mark.parametrize("path", sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_run(path, wing):
    notebook = runpy.run_path(str(ROOT / "tools" / "notebooks.py"))["run"](path)
    nbformat.validate(nbformat.from_dict(notebook))
    kept = json.loads(path.read_text(encoding="utf-8"))
    assert [len(cell.get("outputs", ())) for cell in kept["cells"]] == [
        len(cell.get("outputs", ())) for cell in notebook["cells"]
    ], "make pages"


def test_the_manual_page_is_that_of_the_commands(root):
    page = runpy.run_path(str(root / "tools" / "manual.py"))
    text = (root / "docs" / "elvis.1").read_text(encoding="utf-8")
    assert text == page["manual"](), "make pages"
    assert text.count(".SS elvis ") >= 9
    assert "\\-\\-isosurface [Q=]V,V" in text
