"""Citations of the page on the native format lead to its sections."""

import re
from itertools import pairwise
from pathlib import Path

import pytest

PAGE = "docs/nektar-format.md"
SECTION = r"\d+(?:\.\d+)?"
CITATION = re.compile(rf"format notes(?: ({SECTION}(?:(?:, | and | to ){SECTION})*))?", re.I)
HEADING = re.compile(rf"^#+ ({SECTION}) ", re.M)


def citations(text):
    """The sections that a text cites, None for a citation of none; lines of comments are taken as one."""
    for found in CITATION.finditer(re.sub(r"\s*\n\s*(?:#:?|//)?\s*", " ", text)):
        yield from re.findall(SECTION, found[1]) if found[1] else [None]


@pytest.fixture(scope="module")
def sections(root):
    """The numbers of the page's headings, in order."""
    return HEADING.findall((root / PAGE).read_text(encoding="utf-8"))


def test_sections_are_numbered_in_order(sections):
    numbers = [tuple(map(int, section.split("."))) for section in sections]
    assert len(numbers) > 10
    for one, next_ in pairwise(numbers):
        assert next_ in {(*one, 1), (one[0] + 1,), (*one[:-1], one[-1] + 1)}


def test_citations_resolve(root, project_files, sections):
    own = Path(__file__)
    sources = [path for path in project_files if path.suffix in (".py", ".slang", ".md") and path != own]
    cited = {
        (str(path.relative_to(root)), section)
        for path in sources
        for section in citations(path.read_text(encoding="utf-8"))
    }
    assert len(cited) > 40
    assert not {place for place in cited if place[1] not in sections}


def test_every_form_of_citation_is_recognised():
    text = 'Format notes 1.4 and\n# 2.3.  See (format notes\n    1.1 to 1.7), "format notes 3, 7" and format notes.'
    assert list(citations(text)) == ["1.4", "2.3", "1.1", "1.7", "3", "7", None]
