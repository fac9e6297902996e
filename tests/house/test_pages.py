"""What the pages say can be done can be done: every Python example runs, every command exists, every link leads on."""

import re

import pytest

AREAS = ("formats", "plugins", "converters", "renderer", "reference")
PAGES = ("README.md", "CHANGELOG.md", *(f"{area}/README.md" for area in AREAS))
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


@pytest.mark.parametrize("page", PAGES)
def test_commands_that_are_shown_exist(root, page):
    from elvis.plugins.registry import plugins

    shown = {match for block in blocks(root, page, "sh") for match in re.findall(r"^(?:\S*/)?elvis (\w+)", block, re.M)}
    assert shown <= set(plugins("elvis.commands"))


@pytest.mark.parametrize("page", PAGES)
def test_make_targets_that_are_shown_exist(root, page):
    text = (root / page).read_text(encoding="utf-8")
    targets = set(re.findall(r"^(\w+):", (root / "Makefile").read_text(encoding="utf-8"), re.M))
    assert set(re.findall(r"\bmake (\w+)$", text, re.M)) | set(re.findall(r"`make (\w+)`", text)) <= targets


@pytest.mark.parametrize("page", PAGES)
def test_python_examples_run(root, page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for number, source in enumerate(blocks(root, page, "python"), 1):
        exec(compile(source, f"{page} example {number}", "exec"), {"__name__": "__main__"})
