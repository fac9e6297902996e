"""What the pages say can be done can be done: examples and commands run, links lead somewhere."""

import re
import runpy
import shlex
from importlib.util import find_spec

import pytest
from click.testing import CliRunner

AREAS = ("formats", "plugins", "converters", "renderer", "reference")
PAGES = (
    "README.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "docs/installing.md",
    "docs/python.md",
    "docs/scene.md",
    *(f"{area}/README.md" for area in AREAS),
)
#: libraries that examples with these words need
OPTIONAL = {"to_pyvista": "pyvista", "to_meshio": "meshio", "to_xarray": "xarray", "to_pandas": "pandas"}
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)
LINK = re.compile(r"\]\(([^)#:]+)\)")


def blocks(root, page, language):
    """The code blocks of a page in one language."""
    return [text for tongue, text in BLOCK.findall((root / page).read_text(encoding="utf-8")) if tongue == language]


@pytest.mark.parametrize("page", [*PAGES, "docs/nektar-format.md", "docs/quantities.md"])
def test_links_lead_somewhere(root, page):
    text = (root / page).read_text(encoding="utf-8")
    missing = [link for link in LINK.findall(text) if not (root / page).parent.joinpath(link).exists()]
    assert not missing


@pytest.mark.parametrize("page", PAGES)
def test_commands_run(root, page, wing):
    from elvis.plugins.command import elvis

    lines = [line for block in blocks(root, page, "sh") for line in block.splitlines() if line.startswith("elvis ")]
    for line in lines:
        outcome = CliRunner().invoke(elvis, shlex.split(line, comments=True)[1:], standalone_mode=False)
        assert outcome.exception is None, f"{line}: {outcome.exception}"


@pytest.mark.parametrize("page", PAGES)
def test_make_targets_that_are_shown_exist(root, page):
    text = (root / page).read_text(encoding="utf-8")
    targets = set(re.findall(r"^(\w+):", (root / "Makefile").read_text(encoding="utf-8"), re.M))
    assert set(re.findall(r"\bmake (\w+)$", text, re.M)) | set(re.findall(r"`make (\w+)`", text)) <= targets


@pytest.mark.parametrize("page", PAGES)
def test_python_examples_run(root, page, wing):
    """Those of one page follow one another; what needs a library that is not installed is left out."""
    names = {"__name__": "__main__"}
    for number, source in enumerate(blocks(root, page, "python"), 1):
        if all(find_spec(module) for word, module in OPTIONAL.items() if word in source):
            exec(compile(source, f"{page} example {number}", "exec"), names)


def test_the_manual_page_is_that_of_the_commands(root):
    page = runpy.run_path(str(root / "tools" / "manual.py"))
    text = (root / "docs" / "elvis.1").read_text(encoding="utf-8")
    assert text == page["manual"](), "make pages"
    assert text.count(".SS elvis ") >= 9
    assert "\\-\\-isosurface [Q=]V,V" in text
