"""The site: `make docs` builds it from docs/, the areas' READMEs and the commands and docstrings themselves.

The source folder is the top of the repository, so links between pages lead to the same places on the site and where
the repository is browsed.
"""

import os
import re
import sys
from pathlib import Path

from pygments.lexers.c_cpp import CppLexer
from sphinx.application import Sphinx

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tools"))

project = "ElVis"
copyright = "the authors of ElVis"
root_doc = "docs/index"
include_patterns = [
    "docs/**.md",
    "docs/**.ipynb",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
    "*/README.md",
    "examples/reports/*.md",
]
exclude_patterns = [".venv", "out", "tests", "build", "dist"]
extensions = ["myst_parser"]
myst_enable_extensions = ["colon_fence", "deflist", "attrs_inline"]
myst_heading_anchors = 4
suppress_warnings = ["misc.highlighting_failure"]
html_theme = "furo"
html_title = "ElVis"
html_static_path = ["site"]
html_css_files = ["site.css"]
html_extra_path = ["site/extra"]
html_show_sphinx = False
html_copy_source = False
smartquotes = False
templates_path = []
html_theme_options = {
    "navigation_with_keys": True,
    "light_css_variables": {"color-brand-primary": "#3b528b", "color-brand-content": "#2c6e8f"},
    "dark_css_variables": {"color-brand-primary": "#6fb7c9", "color-brand-content": "#6fb7c9"},
}
pygments_style = "friendly"
pygments_dark_style = "github-dark"
LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(([^)#:\s]+)(#[^)\s]*)?\)")


def setup(app: Sphinx) -> None:
    """Add what is made of the program itself."""
    import api_page
    import commands_page
    import notebooks

    # Slang is near enough to C++ for its colours
    app.add_lexer("slang", CppLexer)
    made = {"docs/commands": commands_page.page, "docs/api": api_page.page}

    def read(app: Sphinx, name: str, text: list[str]) -> None:
        if name in made:
            text[0] += made[name]()
        text[0] = LINK.sub(lambda link: _to_a_page(Path(name).parent, *link.groups()), text[0])

    app.connect("source-read", read)
    app.add_source_suffix(".ipynb", "notebook")
    app.add_source_parser(notebooks.parser())


def _to_a_page(folder: Path, text: str, target: str, anchor: str | None) -> str:
    """A link of a page as the site has it: a folder stands for its README, the README is its first page.

    Files that are no pages are named only.
    """
    path = ROOT / folder / target
    readme = path / "README.md"
    if path.resolve() == ROOT / "README.md":
        return f"[{text}]({os.path.relpath(ROOT / 'docs' / 'index.md', ROOT / folder)})"
    if path.is_dir() and readme.exists():
        return f"[{text}]({target.rstrip('/')}/README.md)"
    if path.is_dir() or path.suffix not in (".md", ".ipynb", ".json", ""):
        return text
    return f"[{text}]({target}{anchor or ''})"
