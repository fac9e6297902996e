"""The viewer in a notebook, without a notebook: what its cell gets, and messages of a page that is played."""

import base64
import time
from dataclasses import replace

import pytest

from elvis.formats import read
from elvis.renderer import render, view

pytest.importorskip("anywidget")


@pytest.fixture(scope="module")
def viewer(scene):
    own = view(read(*scene.data), scene)
    sent = []
    own._widget.send = lambda content, buffers=None: sent.append((content, buffers))
    own.sent = sent
    own._receive(None, {"type": "hello"}, None)
    yield own
    own.close()


def final(viewer, after=-1):
    """The whole picture after a revision, as the page gets it."""
    end = time.monotonic() + 60
    while time.monotonic() < end:
        for content, buffers in list(viewer.sent):
            if content["type"] == "frame" and content["final"] and content["revision"] > after:
                viewer._receive(None, {"type": "shown"}, None)
                return content, bytes(buffers[0])
        time.sleep(0.05)
    raise AssertionError("no picture came")


def test_a_page_is_told_what_it_needs_and_gets_the_picture(viewer, tmp_path):
    facts, file = final(viewer)
    kinds = [content["type"] for content, _ in viewer.sent]
    assert kinds[0] == "schema"
    assert "state" in kinds
    viewer.save(tmp_path / "own.png")
    assert file == (tmp_path / "own.png").read_bytes()
    assert facts["field"] == "u"


def test_a_notebook_that_is_only_read_has_the_picture(viewer):
    bundle = viewer._repr_mimebundle_()
    bundle = bundle[0] if isinstance(bundle, tuple) else bundle
    assert base64.b64decode(bundle["image/png"]) == final(viewer)[1]
    assert "application/vnd.jupyter.widget-view+json" in bundle


def test_the_scene_changes_both_ways(viewer):
    before = viewer._session.revision
    viewer.scene = replace(viewer.scene, palette="magma")
    final(viewer, before)
    assert viewer.scene.palette == "magma"
    viewer._receive(None, {"type": "change", "changes": {"title": "mine", "palette": None}}, None)
    final(viewer, before + 1)
    assert (viewer.scene.title, viewer.scene.palette) == ("mine", "viridis")
    assert (viewer.frame.rgb == render(read(*viewer.scene.data), viewer.scene).rgb).all()


def test_files_are_handed_to_the_page(viewer):
    viewer._receive(None, {"type": "save", "id": 7, "suffix": ".toml"}, None)
    viewer._receive(None, {"type": "save", "id": 8, "suffix": ".exe"}, None)
    end = time.monotonic() + 30
    found = {}
    while time.monotonic() < end and len(found) < 2:
        found = {content["id"]: (content, buffers) for content, buffers in viewer.sent if "id" in content}
        time.sleep(0.05)
    assert b'field = "u"' in found[7][1][0]
    assert "expected a name that ends in" in found[8][0]["text"]
