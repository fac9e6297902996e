"""Two fingers on the picture zoom and move it."""

import numpy as np
import pytest
from driving import settled


@pytest.fixture
def touch(page):
    """Put fingers on places of the page, and move or lift them."""
    session = page.context.new_cdp_session(page)

    def send(kind, *points):
        touches = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})

    return send


def camera(page):
    """The camera of the picture."""
    return page.evaluate("window.elvis.picture.camera")


def test_two_fingers_zoom_and_move(page, viewer, touch):
    settled(page, viewer)
    before = camera(page)
    box = page.locator("canvas").first.bounding_box()
    x, y = box["x"] + box["width"] / 3, box["y"] + box["height"] / 2
    touch("touchStart", (x - 30, y))
    touch("touchStart", (x - 30, y), (x + 30, y))
    for way in (15, 30):
        touch("touchMove", (x - 30 - way, y), (x + 30 + way, y))
    touch("touchEnd")
    settled(page, viewer)
    after = camera(page)
    # twice the distance: half of the height is visible, in the same direction
    assert after["height"] == pytest.approx(before["height"] / 2, rel=1e-6)
    directions = [np.subtract(own["at"], own["eye"]) for own in (before, after)]
    assert np.cross(*directions) == pytest.approx([0, 0, 0], abs=1e-9)

    touch("touchStart", (x - 30, y), (x + 30, y))
    touch("touchMove", (x - 10, y + 8), (x + 50, y + 8))
    touch("touchEnd")
    settled(page, viewer)
    moved = camera(page)
    assert moved["height"] == pytest.approx(after["height"], rel=1e-9)
    assert np.linalg.norm(np.subtract(moved["at"], after["at"])) > 0.01 * after["height"]
