"""The types of keywords are made from the models of scenes, and cover each keyword."""

import importlib.util
from typing import get_type_hints

import pytest

from elvis.scene.commandline.keywords import keywords
from elvis.scene.commandline.other_programs import SAME


@pytest.fixture
def tool(root):
    """The module that writes the types."""
    spec = importlib.util.spec_from_file_location("keyword_types", root / "tools" / "keyword_types.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_module_is_up_to_date(tool):
    assert tool.OUTPUT.read_text(encoding="utf-8") == tool.text_of_module()


def test_every_keyword_has_a_type():
    from elvis.scene.render_keywords import RenderKeywords, ViewKeywords

    known = set(keywords()) | set(SAME)
    # functions have parameters of these names
    assert set(get_type_hints(RenderKeywords)) == known - {"device"}
    assert set(get_type_hints(ViewKeywords)) == known - {"height"}
