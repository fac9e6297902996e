"""What one does with the page in a browser."""

import asyncio
import struct
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from elvis.viewer.drawing_process import Source

#: whether the page is about to send something, or waits for an answer
BUSY = """() => {
  const { sizing, pending, rolling, waiting } = window.elvis ?? { pending: true };
  return Boolean(sizing || pending || rolling || waiting.size);
}"""


#: seconds until something that should come counts as missing, however busy the machine is
PATIENCE = 300


def finished(work):
    """The result of a coroutine, by a loop in a thread of its own: a browser may have one in this thread."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, work).result(PATIENCE)


def settled(page, viewer):
    """Wait until the page shows the scene as it is, at rest, whole and in its last size."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if _is_at_rest(page, viewer.session):
            # what a change of sizes leads to comes with the next pictures of the screen
            page.evaluate("new Promise((resume) => requestAnimationFrame(() => requestAnimationFrame(resume)))")
            if _is_at_rest(page, viewer.session):
                return
        page.wait_for_timeout(50)
    raise AssertionError(f"no picture at rest; the page says: {page.inner_text('.elvis-error')}")


def _is_at_rest(page, session):
    """Whether nothing is on its way, neither from the page nor to it, and the last picture is of the last scene."""
    # an answer comes after all that the page has sent before
    page.evaluate("window.elvis?.ask('copy', 'Python').catch(() => null)")
    if page.evaluate(BUSY) or session._wake.is_set() or session.rereading.is_running:
        return False
    if session._leavable or any(one.waiting or one.sent > one.confirmed for one in session.viewers):
        return False
    return page.get_attribute(".elvis", "data-final") == str(session.revision)


def picture(viewer):
    """The file of the picture at rest."""
    message = viewer.session.message
    return message[4 + struct.unpack("<I", message[:4])[0] :]


def setting(page, name):
    """The control of a setting of the whole scene."""
    return page.locator(".elvis-panel > .elvis-row").filter(has_text=name).locator("input").first


class Fragile:
    """In place of a source: the process that reads it loses its device as long as a file is there."""

    def __init__(self, files, lost):
        self.files, self.lost = files, lost

    def __reduce__(self):
        return _source_of_lost_devices, (self.files, str(self.lost))


def _source_of_lost_devices(files, lost):
    from elvis.renderer.device.device import Kernel

    dispatch = Kernel._dispatch

    def run(*arguments):
        if Path(lost).exists():
            raise RuntimeError("ERROR_DEVICE_LOST")
        return dispatch(*arguments)

    Kernel._dispatch = run
    return Source(files)


def canvas_place(page, column, row):
    """Where a pixel of the picture's image lies on the page."""
    box = page.get_by_label("the picture", exact=True).bounding_box()
    corner = page.evaluate("window.elvis.picture.image")
    return box["x"] + corner[0] + column + 0.5, box["y"] + corner[1] + row + 0.5


def turn(page):
    """Turn by the mouse, and zoom."""
    x, y = canvas_place(page, 70, 50)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 40, y + 15, steps=5)
    page.mouse.up()
    page.mouse.wheel(0, -120)


def add(page, kind):
    page.get_by_label("add an object").select_option(kind)


def choose(page, name, text):
    setting(page, name).fill(text)
    setting(page, name).press("Enter")


def change(page, changes):
    page.evaluate("(changes) => window.elvis.change(changes)", changes)
