"""Names come from files: no terminal acts on them, no page runs them, and other programs can read what is written."""

from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from xml.dom import minidom

import pytest
from click.testing import CliRunner

import elvis.viewer
from elvis import Dataset, ElvisError, Shape, sample, write
from elvis.core.base.terminal import plain_names
from elvis.core.testing import approximated, grid
from elvis.plugins.command.command import elvis as group

#: a title of the window, C1 deletion, text that runs backwards and isolates, deletion
CONTROLS = "\x1b]0;t\x07\x9b2J\u202e\u2066\x7f"
MARKUP = "<img src=x onerror=alert(1)>"
SMALL = ("--size", "16x12", "--device", "reference", "--plane", "0.5,0.5,0.5:0,0,1")


def dataset(hostile):
    """A hexahedron; all fields, boundaries, regions and metadata have the hostile text in their names."""
    mesh = grid(Shape.HEXAHEDRON, 1)
    named = tuple(replace(each, name=f"{each.name}{hostile}") for each in mesh.composites)
    bare = Dataset(replace(mesh, composites=named))
    fields = tuple(approximated(bare, name + hostile, lambda x, i=i: x[:, i] ** 2, 3) for i, name in enumerate("uvw"))
    return replace(bare, fields=fields, metadata={"Note": hostile}, time=0.5)


@pytest.fixture(params=[CONTROLS, MARKUP], ids=["controls", "markup"])
def hostile(request):
    return request.param


@pytest.fixture
def files(hostile, tmp_path, monkeypatch):
    """Files with a hostile name each, in the working folder."""
    monkeypatch.chdir(tmp_path)
    return write(dataset(hostile), Path(f"m{hostile}.xml"), field_format="hdf5")


def run(*arguments):
    """The outcome of a command, and all that it prints."""
    outcome = CliRunner().invoke(group, [str(argument) for argument in arguments], standalone_mode=False)
    return outcome, outcome.stdout + outcome.stderr


def test_no_command_prints_control_characters(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = write(dataset(CONTROLS), Path(f"m{CONTROLS}.xml"), field_format="hdf5")
    field, velocity = f"'u{CONTROLS}'", ",".join(f"'{name}{CONTROLS}'" for name in "uvw")
    for command in (
        ("info", *data),
        ("norms", *data),
        ("probe", *data, "--line", "0,0,0:1,1,1", "-n", 2),
        ("integrate", *data, "--field", field, "--over", "all"),
        ("trace", *data, "--seeds", "line:0.1,0.1,0.1:0.9,0.9,0.9:2", "--velocity", velocity),
        ("export", *data, "-o", f"x{CONTROLS}.vtu"),
        ("render", *data, "--field", field, *SMALL, "-o", f"x{CONTROLS}.svg"),
        ("render", *data, "--field", field, *SMALL),
    ):
        outcome, printed = run(*command)
        assert outcome.exception is None, (command, printed)
        assert all(character.isprintable() or character == "\n" for character in printed), command


def test_files_for_other_programs_can_be_read(files, hostile):
    """XML allows no control characters; what had them has question marks, what is markup stays as it is."""
    shown = f"u{plain_names([hostile])[0]}"
    for suffix in (".vtu", ".msh"):
        assert run("export", *files, "-o", f"x{suffix}")[0].exception is None
        assert shown in run("info", f"x{suffix}", "--json")[1]
    assert run("render", *files, "--field", f"'u{hostile}'", *SMALL, "-o", "x.svg")[0].exception is None
    # a title has as many lines as the width of the picture requires
    lines = [text.firstChild.data for text in minidom.parse("x.svg").getElementsByTagName("text")]
    assert shown in " ".join(lines)


def test_equal_names_are_numbered():
    assert plain_names(["u\x1b", "u\x9b", "u", "u\n"]) == ("u?", "u?_2", "u", "u?_3")


class Scripts(HTMLParser):
    """The handlers of events and the scripts in a page, by tag."""

    def __init__(self, text):
        super().__init__()
        self.found = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.found += [(tag, name) for name, _ in attributes if name.startswith("on")]


def test_notebooks_show_markup_as_text():
    data = dataset(MARKUP)
    for shown in (data, sample(data, f"'u{MARKUP}'", [[0.1, 0.2, 0.3]])):
        text = shown._repr_html_()
        assert "onerror" in text
        assert Scripts(text).found == []


def test_reports_show_markup_as_text(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data = write(dataset(MARKUP), Path(f"m{MARKUP}.xml"), field_format="hdf5")
    outcome, _ = run("compare", *data, "--field", f"'u{MARKUP}'", *SMALL, "-o", "report")
    assert outcome.exception is None
    pages = [*Path("report").rglob("*.html"), *Path("report").rglob("*.svg")]
    assert "onerror" in Path("report/index.html").read_text()
    assert [Scripts(page.read_text()).found for page in pages] == [[]] * len(pages)


def test_the_page_of_the_viewer_escapes_texts():
    """All texts enter the page as text: nothing in it parses HTML."""
    script = (Path(elvis.viewer.__file__).parent / "page" / "viewer.js").read_text()
    assert "textContent" in script
    for parsing in ("innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "DOMParser", "eval("):
        assert parsing not in script


@pytest.mark.parametrize("name", ["a\nb.xml", "-a.xml", "a\nb.e.4.1", "a\nb0.f00001", "a\nb.000001"])
def test_missing_files_with_odd_names_give_a_one_line_error(name, files):
    outcome, _ = run("info", "--", files[0], name)
    assert isinstance(outcome.exception, ElvisError)
    assert "there is no such file" in str(outcome.exception)
