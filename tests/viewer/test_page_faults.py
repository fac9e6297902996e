"""What goes on around the page in a real browser: others, links, files, and what goes wrong."""

import os
import signal
from pathlib import Path

import numpy as np
from driving import PATIENCE, Fragile, picture, setting, settled

from elvis.viewer.session import Session


def test_another_page_is_synchronised(browser, page, viewer):
    other = browser.new_page()
    other.set_default_timeout(1000 * PATIENCE)
    other.goto(viewer.address)
    settled(other, viewer)
    page.get_by_title("View +x").click()
    settled(page, viewer)
    settled(other, viewer)
    for one in (page, other):
        assert one.evaluate("window.elvis.table.camera") == "+x"
    other.close()


def test_a_link_brings_the_view_back(page, viewer):
    """Its fragment is a change as any other, and is no part of what the server is requested."""
    page.get_by_title("View -y").click()
    # the controls are made again with what is known of the picture
    settled(page, viewer)
    setting(page, "palette").fill("magma")
    setting(page, "palette").press("Enter")
    settled(page, viewer)
    page.get_by_label("save", exact=True).select_option("copy link")
    link = page.get_by_label("link", exact=True).input_value()
    assert link.startswith(f"{viewer.address}#camera=")
    page.get_by_role("button", name="close").click()
    for _ in range(2):
        page.get_by_title("Undo (Ctrl+Z)").click()
    settled(page, viewer)
    assert "palette" not in viewer.session.table

    asked = []
    page.on("request", lambda request: asked.append(request.url))
    page.goto("about:blank")
    page.goto(link)
    settled(page, viewer)
    assert (viewer.session.table["camera"], viewer.session.table["palette"]) == ("-y", "magma")
    assert "#" not in page.url
    assert not any("magma" in address for address in asked if address != link)

    revision = viewer.session.revision
    for fragment, part in (
        ("camera=nowhere", "expected JSON"),
        ('device="cpu"', "cannot be changed"),
        ('camera="up"', "unknown view"),
    ):
        page.evaluate("(text) => { location.hash = text; }", fragment)
        page.wait_for_function("(part) => document.querySelector('.elvis-error').textContent.includes(part)", arg=part)
        assert page.locator(".elvis-error").is_visible()
    assert viewer.session.revision == revision


def test_pictures_are_written_next_to_the_data(page, viewer):
    """Once the viewer allows it, and over others once that was confirmed."""
    assert "here…" not in page.get_by_label("save", exact=True).inner_text()
    viewer.session.may_write = True
    page.get_by_title("View -x").click()
    settled(page, viewer)
    path = Path(viewer.session.scene.data[0]).with_name("here.png")
    page.get_by_label("save", exact=True).select_option("here…")
    page.get_by_label("name of the file").fill("here.png")
    page.get_by_role("button", name="write").click()
    page.get_by_text("wrote").wait_for()
    assert path.read_bytes() == picture(viewer)
    path.write_bytes(b"another")
    page.get_by_role("button", name="write").click()
    page.get_by_role("button", name="replace").wait_for()
    assert path.read_bytes() == b"another"
    page.get_by_role("button", name="replace").click()
    page.get_by_text("wrote").wait_for()
    assert path.read_bytes() == picture(viewer)
    page.get_by_role("button", name="close").click()


def test_a_lost_connection_is_restored_with_the_view(page, viewer):
    """What was asked meanwhile is given up, so that one can go on to ask."""
    page.get_by_title("View +z").click()
    settled(page, viewer)
    page.evaluate("() => { window.elvis.model.socket.close(); window.elvis.fit(); }")
    page.get_by_text("Connection lost").wait_for()
    page.get_by_text("Connection lost").wait_for(state="hidden")
    settled(page, viewer)
    assert viewer.session.table["camera"] == page.evaluate("window.elvis.table.camera") == "+z"
    box = page.get_by_label("the picture", exact=True).bounding_box()
    page.mouse.move(box["x"] + box["width"] / 3, box["y"] + box["height"] / 2)
    page.wait_for_function("document.querySelector('.elvis-status output').textContent.includes('element')")


def test_a_changed_file_is_reported_and_read_again(page, viewer):
    os.utime(viewer.session.scene.data[0])
    page.get_by_role("button", name="read again").click()
    page.get_by_text("has changed on disk").wait_for(state="hidden")
    settled(page, viewer)


def test_a_killed_drawing_process_is_started_again(page, viewer, tmp_path):
    """Then its device is lost, for good as it seems: the page says one sentence, keeps its view, and goes on."""
    lost = tmp_path / "lost"
    viewer.session._drawer.source = Fragile(viewer.session.scene.data, lost)
    os.kill(viewer.session._drawer.pid, signal.SIGKILL)
    page.get_by_title("View +y").click()
    settled(page, viewer)
    assert isinstance(viewer.session, Session)
    assert viewer.session.table["camera"] == "+y"
    assert np.frombuffer(picture(viewer)[:4], np.uint8)[1:].tobytes() == b"PNG"

    lost.touch()
    page.get_by_title("View -z").click()
    told = page.locator(".elvis-error")
    told.get_by_text("the device failed: ERROR_DEVICE_LOST").wait_for()
    assert told.inner_text().count("\n") == 0
    assert viewer.session.table["camera"] == page.evaluate("window.elvis.table.camera") == "-z"
    lost.unlink()
    page.get_by_title("View +x").click()
    settled(page, viewer)
    assert viewer.session.table["camera"] == "+x"
    assert not told.is_visible()
