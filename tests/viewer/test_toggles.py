"""Buttons of the toolbar switch the usual parts of a picture, and show whether it has them."""

import os
import signal

import numpy as np
import pytest
from driving import add, change, settled

from elvis.scene.model.tables import scene_of


def button(page, name):
    """A button of the group, by its name."""
    return page.get_by_role("group", name="show", exact=True).get_by_role("button", name=name, exact=True)


def pressed(page, viewer, name):
    """Press a button, and the scene at rest after it."""
    button(page, name).click()
    settled(page, viewer)
    assert page.locator(".elvis-error").is_hidden(), page.inner_text(".elvis-error")
    return scene_of(viewer.session.table)


def without_size(viewer):
    """The scene's table, except the size, which follows the window."""
    return {key: value for key, value in viewer.session.table.items() if key != "size"}


@pytest.mark.parametrize("name", ["mesh", "contours"])
def test_lines_on_all_surfaces(page, viewer, name):
    key = {"mesh": "mesh_lines", "contours": "contours"}[name]
    settled(page, viewer)
    before = without_size(viewer)
    for is_on in (True, False):
        scene = pressed(page, viewer, name)
        assert [getattr(each.style, key) is not None for each in scene.objects] == [is_on]
        assert button(page, name).get_attribute("aria-pressed") == str(is_on).lower()
    page.get_by_title("Undo (Ctrl+Z)").click()
    page.get_by_title("Undo (Ctrl+Z)").click()
    settled(page, viewer)
    assert without_size(viewer) == before


def test_lights_axes_and_walls(page, viewer):
    settled(page, viewer)
    assert [each.style.lit for each in pressed(page, viewer, "light").objects] == [False]
    assert pressed(page, viewer, "axes").axes
    scene = pressed(page, viewer, "walls")
    assert scene.objects[-1].kind == "faces"
    assert scene.objects[-1].style.color == (0.7, 0.7, 0.7)
    assert scene.objects[-1].style.lit is not False
    assert len(pressed(page, viewer, "walls").objects) == 1
    assert [each.style.lit for each in pressed(page, viewer, "light").objects] == [None]
    assert not pressed(page, viewer, "axes").axes


def test_the_logarithm_needs_positive_values(page, viewer):
    settled(page, viewer)
    change(page, {"field": "2 + u"})
    settled(page, viewer)
    assert pressed(page, viewer, "log").bar.scale == "log"
    assert pressed(page, viewer, "log").bar is None


def test_long_drawing_is_announced(page, viewer):
    settled(page, viewer)
    assert page.get_by_label("activity").is_hidden()
    # the drawing process is paused
    os.kill(viewer.session._drawer.pid, signal.SIGSTOP)
    try:
        button(page, "axes").click()
        page.get_by_text("drawing… 1 s").wait_for()
    finally:
        os.kill(viewer.session._drawer.pid, signal.SIGCONT)
    settled(page, viewer)
    assert page.get_by_label("activity").is_hidden()


def test_seeds_of_streamlines_are_edited(page, viewer):
    """New lines go both ways; the kind of seeds and their fields make the text that the scene stores."""
    change(page, {"objects[0]": {"kind": "streamlines", "seeds": ["7"], "velocity": "u,x,1", "steps": 20}})
    settled(page, viewer)
    assert page.locator(".elvis-error").is_hidden(), page.inner_text(".elvis-error")
    panel = page.get_by_role("region", name="settings")
    assert panel.get_by_label("count", exact=True).input_value() == "7"
    panel.get_by_label("kind of seeds").select_option("line")
    panel.get_by_label("from 2").wait_for()
    settled(page, viewer)
    panel.get_by_label("count", exact=True).fill("3")
    panel.get_by_label("count", exact=True).press("Enter")
    settled(page, viewer)
    panel.get_by_label("from 2").fill("0.25")
    panel.get_by_label("from 2").press("Enter")
    settled(page, viewer)
    panel.get_by_label("direction", exact=True).first.select_option("both")
    settled(page, viewer)
    found = scene_of(viewer.session.table).objects[0]
    kind, start, _, count = found.seeds[0].split(":")
    assert (kind, start.split(",")[1], count, found.direction) == ("line", "0.25", "3", "both")
    names = panel.locator("summary").all_inner_texts()
    assert [name for name in names if name in ("seeds", "look", "advanced")] == ["seeds", "look", "advanced"]
    assert panel.get_by_label("steps", exact=True).is_hidden()


def test_new_streamlines_are_tubes_of_a_size_that_is_seen(page, viewer):
    """The visible part sets the size, not the whole data."""
    change(page, {"plane": None, "objects[0]": {"kind": "isosurface", "values": [0.2]}})
    settled(page, viewer)
    add(page, "streamlines")
    page.wait_for_function("elvis.table.objects.length === 2")
    low, high = np.array(page.evaluate("elvis.facts.seen"))
    radius = page.evaluate("elvis.table.objects[1].radius")
    assert 0 < radius == pytest.approx(np.linalg.norm(high - low) / 350, rel=0.06)
