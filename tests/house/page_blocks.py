"""The pages of the project, and what stands in them: for the tests of pages."""

import re
import shlex
from pathlib import Path

AREAS = ("formats", "plugins", "converters", "renderer", "reference")
ROOT = Path(__file__).resolve().parents[2]
DOCS = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").rglob("*.md"))
PAGES = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", *DOCS, *(f"{area}/README.md" for area in AREAS))
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.M | re.S)


def blocks(root, page, language):
    """The code blocks of a page in one language."""
    return [text for tongue, text in BLOCK.findall((root / page).read_text(encoding="utf-8")) if tongue == language]


def commands(page):
    """The lines of a page that call elvis, as lists of words."""
    lines = [line for block in blocks(ROOT, page, "sh") for line in block.replace("\\\n", "").splitlines()]
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("elvis ")]
