"""The page in a real browser: every way to change the picture, and what is seen at rest."""

import os
import shutil
import signal
import struct
import time
from pathlib import Path

import numpy as np
import pytest

from elvis.formats import read, sample
from elvis.renderer import render
from elvis.scene.files import read_scene
from elvis.viewer.session import Session

playwright = pytest.importorskip("playwright.sync_api")
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="needs a browser: chromium or google-chrome")


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as tools:
        own = tools.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield own
        own.close()


@pytest.fixture
def page(browser, viewer):
    """The page with its first picture; nothing may fail in it."""
    context = browser.new_context(viewport={"width": 900, "height": 420}, bypass_csp=True)
    own = context.new_page()
    own.set_default_timeout(90_000)
    faults = []
    own.on("pageerror", lambda error: faults.append(str(error)))
    own.on("dialog", lambda dialog: faults.append("a dialog"))
    own.goto(viewer.address)
    settled(own, viewer)
    yield own
    assert not faults
    context.close()


def settled(page, viewer):
    """Wait until the page shows the scene as it is, at rest and whole."""
    end = time.monotonic() + 90
    while time.monotonic() < end:
        shown = page.get_attribute(".elvis", "data-final")
        own = viewer.session
        if shown == str(own.revision) and not own._wake.is_set() and not own._is_drawing_whole:
            page.wait_for_timeout(200)
            if page.get_attribute(".elvis", "data-final") == str(own.revision) and not own._is_drawing_whole:
                return
        page.wait_for_timeout(50)
    raise AssertionError(f"no picture at rest; the page says: {page.inner_text('.elvis-error')}")


def picture(viewer):
    """The file of the picture at rest."""
    message = viewer.session.message
    return message[4 + struct.unpack("<I", message[:4])[0] :]


def as_rendered(viewer, tmp_path):
    """The picture that elvis render makes of the scene, saved next to the data."""
    path = Path(viewer.session.scene.data[0]).with_name("scene.toml")
    path.write_text(viewer.session.text(".toml"))
    render(scene=read_scene(path)).save(tmp_path / "picture.png")
    return (tmp_path / "picture.png").read_bytes()


def setting(page, name):
    """The control of a setting of the whole scene."""
    return page.locator(".elvis-panel > .elvis-row").filter(has_text=name).locator("input").first


def canvas_place(page, column, row):
    """Where a pixel of the picture's image lies on the page."""
    box = page.locator("canvas").bounding_box()
    corner = page.evaluate("window.elvis.picture.image")
    return box["x"] + corner[0] + column + 0.5, box["y"] + corner[1] + row + 0.5


def test_the_picture_at_rest_is_that_of_the_saved_scene(page, viewer, tmp_path):
    """Turned, moved, zoomed, and with other colours and objects."""
    assert picture(viewer) == as_rendered(viewer, tmp_path)
    x, y = canvas_place(page, 150, 100)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 40, y + 15, steps=5)
    page.mouse.up()
    page.mouse.wheel(0, -120)
    page.wait_for_timeout(400)
    settled(page, viewer)
    camera = viewer.session.table["camera"]
    assert camera["height"] > 0
    assert picture(viewer) == as_rendered(viewer, tmp_path)

    setting(page, "palette").fill("plasma")
    setting(page, "palette").press("Enter")
    page.get_by_label("add an object").select_option("isosurface")
    settled(page, viewer)
    assert viewer.session.table["palette"] == "plasma"
    assert viewer.session.table["objects"][0]["kind"] == "isosurface"
    assert picture(viewer) == as_rendered(viewer, tmp_path)

    for _ in range(20):
        if page.get_by_title("Undo (ctrl z)").is_disabled():
            break
        page.get_by_title("Undo (ctrl z)").click()
        settled(page, viewer)
    assert "objects" not in viewer.session.table
    assert viewer.session.table["camera"] == "iso"


def test_values_under_the_pointer_are_those_of_the_solution(page, viewer, scene):
    width, height = page.evaluate("window.elvis.picture.image.slice(2)")
    page.mouse.move(*canvas_place(page, width // 2, height // 2))
    page.wait_for_function("document.querySelector('.elvis-status output').textContent.includes('certain')")
    text = page.inner_text(".elvis-status output")
    value = float(text.split("=")[1].split()[0])
    point = [float(part) for part in text.split("(")[1].split(")")[0].split(",")]
    found = sample(read(*scene.data), ["u"], [point])
    assert abs(found["u"][0] - value) < 1e-11
    assert f"element {found.location.element_id[0]} " in text


def test_names_of_data_are_text(page):
    """A field whose name is an element of HTML makes none."""
    assert page.locator("img").count() == 0
    assert page.locator("datalist option").first.get_attribute("value") == "u"


def test_keys_turn_and_fit(page, viewer):
    page.locator(".elvis-stage").focus()
    page.keyboard.press("ArrowLeft")
    settled(page, viewer)
    assert not isinstance(viewer.session.table["camera"], str)
    page.keyboard.press("f")
    settled(page, viewer)
    assert viewer.session.table["camera"] == "fit"


def test_an_expression_that_is_none_is_told_while_it_is_typed(page, viewer):
    field = setting(page, "field")
    field.press_sequentially("+nothing")
    page.wait_for_function("[...document.querySelectorAll('.elvis-note')].some((note) => note.textContent)")
    assert "nothing" in page.locator(".elvis-note", has_text="nothing").inner_text()
    field.press("Enter")
    page.wait_for_selector(".elvis-error:not([hidden])")
    page.get_by_title("Undo (ctrl z)").click()
    settled(page, viewer)


def test_another_page_follows(browser, page, viewer):
    other = browser.new_page()
    other.goto(viewer.address)
    settled(other, viewer)
    page.get_by_title("View +x").click()
    settled(page, viewer)
    settled(other, viewer)
    for one in (page, other):
        assert one.evaluate("window.elvis.table.camera") == "+x"
    other.close()


def test_a_killed_drawing_process_is_started_again(page, viewer):
    os.kill(viewer.session._drawer.pid, signal.SIGKILL)
    page.get_by_title("View +y").click()
    settled(page, viewer)
    assert isinstance(viewer.session, Session)
    assert viewer.session.table["camera"] == "+y"
    assert np.frombuffer(picture(viewer)[:4], np.uint8)[1:].tobytes() == b"PNG"
