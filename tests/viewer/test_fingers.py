"""Two fingers on the picture or on a trackpad, and the wheel of a mouse, zoom and move it."""

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


@pytest.fixture
def wheel(page, viewer):
    """Send events of the wheel to the middle of the picture."""
    box = page.locator("canvas").first.bounding_box()
    middle = {"clientX": box["x"] + box["width"] / 2, "clientY": box["y"] + box["height"] / 2}

    def send(*events):
        page.evaluate(
            """(events) => events.forEach((own) => {
              const { wheelDelta, ...known } = own;
              const event = new WheelEvent("wheel", { ...known, bubbles: true, cancelable: true });
              if (wheelDelta !== undefined) Object.defineProperty(event, "wheelDeltaY", { value: wheelDelta });
              window.elvis.canvas.dispatchEvent(event);
            })""",
            [{**middle, **event} for event in events],
        )
        settled(page, viewer)
        return camera(page)

    return send


#: events, and whether they move the picture: else they zoom it
WHEELS = {
    "a notch of a mouse": ([{"deltaY": 100, "wheelDelta": -120}], False),
    "a slow notch on a Mac": ([{"deltaY": 4.000244140625, "wheelDelta": -12}], False),
    "lines": ([{"deltaY": 3, "deltaMode": 1}], False),
    "two fingers": ([{"deltaY": 10, "wheelDelta": -30}, {"deltaY": 40, "wheelDelta": -120}], True),
    "two fingers aslant": ([{"deltaX": 6, "deltaY": 40, "wheelDelta": -120}], True),
    "fingers that spread": ([{"deltaY": 10.5, "ctrlKey": True, "wheelDelta": -120}], False),
}


@pytest.mark.parametrize("name", WHEELS)
def test_two_fingers_on_a_trackpad_move_and_wheels_zoom(page, viewer, wheel, name):
    events, is_move = WHEELS[name]
    before = wheel()
    after = wheel(*events)
    step = np.subtract(after["at"], before["at"])
    if not is_move:
        assert after["height"] > 1.005 * before["height"]
        return
    # the picture follows the fingers by as many pixels
    pixel = before["height"] / page.evaluate("window.elvis.picture.image[3]") * page.evaluate("window.elvis.density")
    moved = [sum(event.get(key, 0) for event in events) for key in ("deltaX", "deltaY")]
    assert after["height"] == pytest.approx(before["height"], rel=1e-12)
    assert np.linalg.norm(step) == pytest.approx(np.hypot(*moved) * pixel, rel=1e-6)
