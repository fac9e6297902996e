"""Pages and docstrings are in plain technical English, by the measure of the style guide."""

import re
import subprocess
import sys

import pytest

#: limits in percent of sentences with a pattern of the dialect (pages, docstrings), and with their topic first
MOST_PATTERNS, MOST_PATTERNS_OF_DOCSTRINGS, MOST_TOPICS = 2, 3, 5
#: words of nine in ten sentences, on pages with some sentences
MOST_WORDS, FEW_SENTENCES = 28, 10

ROW = re.compile(r"(.+?) +(\d+) +(\d+) +(\d+) % +(\d+) %")


def table(root, of):
    """Rows of the tool's table for a folder: name, then sentences, words and the shares of topics and patterns."""
    tool = root.parent / "shared" / "tools" / "prose"
    if not tool.exists():
        pytest.skip(f"there is no {tool}")
    done = subprocess.run([sys.executable, "-B", tool, of], capture_output=True, text=True, check=True)
    rows = filter(None, map(ROW.fullmatch, done.stdout.splitlines()))
    return {row[1]: tuple(map(int, row.groups()[1:])) for row in rows}


def faults(rows):
    """Names of what exceeds a limit; one sentence always may."""
    for name, (sentences, words, topics, patterns) in rows.items():
        one = 100 / sentences
        most = MOST_PATTERNS_OF_DOCSTRINGS if name.startswith("docstrings") else MOST_PATTERNS
        is_long = sentences >= FEW_SENTENCES and words > MOST_WORDS
        if is_long or topics > max(MOST_TOPICS, one + 1) or patterns > max(most, one + 1):
            yield name


def test_pages_and_docstrings_are_plain(root):
    rows = table(root, root)
    assert len(rows) > 60
    assert {f"docstrings of {area}" for area in ("formats", "converters", "renderer")} < set(rows)
    assert list(faults(rows)) == []


def test_the_measure_finds_dialect(root, tmp_path):
    page = "# Page\n\nOf these what is told is said anew. What is there is left out. The reader is told so.\n"
    (tmp_path / "page.md").write_text(page)
    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    subprocess.run(["git", "-C", tmp_path, "add", "page.md"], check=True)
    assert list(faults(table(root, tmp_path))) == ["page.md", "all pages"]
