"""While the mouse turns the picture: drafts of one size, lines and axes that the page draws, and the centre."""

import numpy as np
import pytest
from driving import canvas_place, change, settled

from elvis.scene.cameras.view import View

NOTE = """() => {
  const queue = elvis.queue.bind(elvis);
  window.drafts = [];
  elvis.queue = (facts, buffer) => (facts.final || drafts.push(facts.image.slice(2).join("x")), queue(facts, buffer));
}"""
#: middles of the red, green and blue pixels of a canvas in the square of the arrows along the axes
ARROWS = """(name) => {
  const canvas = name === "page" ? elvis.warp.axes.canvas : elvis.canvas;
  const { image: [left, top], arrows: [x, y, side] } = elvis.picture;
  const { data } = canvas.getContext("2d").getImageData(left + x, top + y, side, side);
  const sums = [0, 1, 2].map(() => [0, 0, 0]);
  for (let at = 0; at < data.length; at += 4) {
    const own = [...data.slice(at, at + 3)], main = own.indexOf(Math.max(...own));
    const rest = own.filter((_, i) => i !== main);
    if (data[at + 3] < 200 || own[main] - Math.max(...rest) < 80) continue;
    const pixel = at / 4;
    sums[main] = sums[main].map((sum, i) => sum + [1, pixel % side, Math.floor(pixel / side)][i]);
  }
  return sums.map(([count, column, row]) => [column / count, row / count]);
}"""
CAMERA = {"eye": [2, 1.5, 3], "at": [0.5, 0.5, 0.4], "up": [0, 1, 0], "height": 1.8}


#: dark pixels of the lines and of the axes that lie over the picture
DARK = """() => [elvis.warp.lines, elvis.warp.axes.canvas].map((canvas) => {
  if (canvas.hidden) return 0;
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let count = 0;
  for (let at = 0; at < data.length; at += 4) count += data[at + 3] > 128 && data[at] < 128;
  return count;
})"""


def turn(page, start, steps):
    """Press the mouse on the picture and move it; it stays pressed."""
    x, y = start
    page.mouse.move(x, y)
    page.mouse.down()
    for dx, dy in steps:
        page.mouse.move(x + dx, y + dy)
        page.wait_for_timeout(40)
        yield


def test_drafts_keep_their_size_and_lines_are_sharp(page, viewer):
    """Borders of elements and axes come with the drafts, over the picture; at rest they are part of it."""
    plane = {"kind": "plane", "point": [0.5, 0.5, 0.4], "normal": [0.1, 0.2, 1.0]}
    cut = {"kind": "cut", "surface": plane, "style": {"mesh_lines": {}}}
    change(page, {"camera": CAMERA, "plane": None, "objects": [cut], "box": True, "axes": True})
    settled(page, viewer)
    page.evaluate(NOTE)
    steps = ((20 * np.sin(0.2 * k), 5 * np.cos(0.2 * k)) for k in range(500))
    is_drawn = False
    width, height = page.evaluate("elvis.picture.image.slice(2)")
    for _ in turn(page, canvas_place(page, width // 2, height // 2), steps):
        is_drawn = is_drawn or min(page.evaluate(DARK)) > 100
        assert page.locator(".elvis-tip").is_hidden()
        if is_drawn and page.evaluate("drafts.length") > 2:
            break
    assert is_drawn
    assert len(set(page.evaluate("drafts"))) == 1
    page.mouse.up()
    settled(page, viewer)
    assert page.locator(".elvis-warp:visible").count() == 0
    # the value under the pointer returns without another movement
    page.wait_for_selector(".elvis-tip:visible", timeout=20_000)


def test_arrows_along_axes_are_those_of_the_sharp_picture(page, viewer):
    """The page draws them while it moves the picture; their middles agree."""
    change(page, {"camera": {**CAMERA, "at": [0.9, 0.9, 0.4]}})
    settled(page, viewer)
    sharp = page.evaluate(ARROWS, "picture")
    page.evaluate("elvis.warp.axes.draw(elvis.current())")
    assert np.abs(np.subtract(page.evaluate(ARROWS, "page"), sharp)).max() < 1.5
    page.evaluate("elvis.warp.hide()")


def test_close_up_the_point_under_the_pointer_stays(page, viewer):
    """In a close oblique view the middle of the visible part is far from the point."""
    change(
        page, {"camera": {**CAMERA, "eye": [0.5, -1.6, 0.5], "at": [0.5, 0.5, 0.4], "up": [0, 0, 1], "height": 0.03}}
    )
    settled(page, viewer)
    page.wait_for_function("elvis.warp.source.parts")
    place = page.evaluate(
        """() => {
          const { parts, known: { size: [columns], step } } = elvis.warp.source, at = parts.findIndex((one) => one);
          return [(at % columns) * step, Math.floor(at / columns) * step];
        }"""
    )
    point = page.evaluate("(place) => elvis.warp.under(place)", place)
    before = seen(viewer, point)
    list(turn(page, canvas_place(page, *place), [(6 * k, 2 * k) for k in range(1, 8)]))
    page.mouse.up()
    settled(page, viewer)
    assert np.linalg.norm(seen(viewer, point) - before) < 3


def seen(viewer, point):
    """Column and row of a point on the picture."""
    x, y, weight = View.through(viewer.session.current.camera, viewer.session.size).projected(np.array(point))
    return np.array([x, y]) / weight


@pytest.mark.parametrize("step", [1, -1])
def test_spread_fingers_on_a_trackpad_zoom(page, viewer, step):
    """They arrive as turns of a wheel with the control key."""
    change(page, {"camera": CAMERA})
    settled(page, viewer)
    page.mouse.move(*canvas_place(page, 80, 60))
    page.keyboard.down("Control")
    page.mouse.wheel(0, 10 * step)
    page.keyboard.up("Control")
    page.wait_for_timeout(200)
    settled(page, viewer)
    assert page.evaluate("elvis.picture.camera.height") == pytest.approx(1.8 * np.exp(0.1 * step), rel=1e-9)
