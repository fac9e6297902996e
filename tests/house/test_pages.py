"""The pages hold together: links lead somewhere, pictures are those of commands, what is generated is up to date."""

import re
import runpy

import pytest
from page_blocks import DOCS, PAGES, ROOT, blocks, commands

from elvis.scene.model.files import read_scene

LINK = re.compile(r"\]\(([^)#:]+)\)")


@pytest.mark.parametrize("page", PAGES)
def test_links_have_targets(root, page):
    text = (root / page).read_text(encoding="utf-8")
    missing = [link for link in LINK.findall(text) if not (root / page).parent.joinpath(link).exists()]
    assert not missing


@pytest.mark.parametrize("page", DOCS)
def test_pictures_of_a_page_match_its_commands(page):
    drawn = {word for words in commands(page) for word in words}
    shown = re.findall(r"\]\((?:\.\./)?pictures/([^)]+)\)", (ROOT / page).read_text(encoding="utf-8"))
    assert set(shown) <= drawn


@pytest.mark.parametrize("page", PAGES)
def test_make_targets_that_are_shown_exist(root, page):
    text = (root / page).read_text(encoding="utf-8")
    targets = set(re.findall(r"^(\w+):", (root / "Makefile").read_text(encoding="utf-8"), re.M))
    assert set(re.findall(r"\bmake (\w+)$", text, re.M)) | set(re.findall(r"`make (\w+)`", text)) <= targets


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(ROOT, page, "toml")])
def test_scenes_of_pages_are_scenes(page, tmp_path):
    for number, text in enumerate(blocks(ROOT, page, "toml")):
        if text.startswith("data ="):
            path = tmp_path / f"{number}.toml"
            path.write_text(text, encoding="utf-8")
            assert read_scene(path).objects


def test_the_gallery_is_that_of_the_scenes(root):
    page = runpy.run_path(str(root / "tools" / "gallery_page.py"))["page"]()
    assert (root / "docs" / "gallery.md").read_text(encoding="utf-8") == page, "make pages"


def test_the_table_of_formats_is_that_of_the_converters(root):
    page = runpy.run_path(str(root / "tools" / "formats_page.py"))["page"]()
    assert (root / "docs" / "start" / "formats.md").read_text(encoding="utf-8") == page, "make pages"
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| `")]
    assert len(rows) >= 12
    assert not [row[0] for row in rows if "?" in row]


def test_the_manual_page_is_that_of_the_commands(root):
    page = runpy.run_path(str(root / "tools" / "manual.py"))
    text = (root / "docs" / "elvis.1").read_text(encoding="utf-8")
    assert text == page["manual"](), "make pages"
    assert text.count(".SS elvis ") >= 9
    assert "\\-\\-isosurface [Q=]V,V" in text
