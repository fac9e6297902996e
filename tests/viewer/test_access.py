"""The page without a mouse, in the dark, and for readers of contrasts and names."""

from io import BytesIO

import numpy as np
import pytest
from driving import PATIENCE, change, picture, settled

from elvis import read, render, sample
from elvis.scene.figure.saving import save_pixels

#: texts with less contrast than WCAG 2.1 AA demands, and controls without a name or smaller than 24 pixels
FAULTS = """() => {
  const channel = (x) => (x <= 0.03928 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
  const parts = (color) => color.match(/[\\d.]+/g).map(Number);
  const weights = [0.2126, 0.7152, 0.0722];
  const light = (color) => weights.reduce((sum, weight, i) => sum + weight * channel(parts(color)[i] / 255), 0);
  const under = (one) => {
    for (let at = one; at; at = at.parentElement) {
      const color = getComputedStyle(at).backgroundColor;
      if ((parts(color)[3] ?? 1) > 0.9) return color;
    }
    return "rgb(255, 255, 255)";
  };
  const shown = [...document.querySelectorAll(".elvis *")].filter((one) => one.offsetParent && !one.disabled);
  const hasText = (one) => [...one.childNodes].some((child) => child.nodeType === 3 && child.textContent.trim());
  const texts = shown.filter((one) => hasText(one) || /INPUT|SELECT/.test(one.tagName));
  const pale = texts.filter((one) => {
    const [low, high] = [light(getComputedStyle(one).color), light(under(one))].sort((a, b) => a - b);
    return (high + 0.05) / (low + 0.05) < 4.5;
  });
  const controls = shown.filter((one) => /BUTTON|INPUT|SELECT|TEXTAREA/.test(one.tagName));
  const hasName = (one) => one.getAttribute("aria-label") || one.labels?.length || one.textContent.trim();
  const nameless = controls.filter((one) => !hasName(one));
  const small = shown.filter((one) => one.tagName === "BUTTON" && (one.offsetWidth < 24 || one.offsetHeight < 20));
  return [...pale, ...nameless, ...small].map((one) => one.outerHTML.slice(0, 100));
}"""


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_texts_have_contrast_and_controls_have_names(browser, viewer, scheme):
    """The canvas of a dark page is dark, what is saved is not."""
    context = browser.new_context(viewport={"width": 1280, "height": 700}, color_scheme=scheme, bypass_csp=True)
    page = context.new_page()
    page.set_default_timeout(1000 * PATIENCE)
    page.goto(viewer.address)
    settled(page, viewer)
    page.get_by_role("button", name="handle").click()
    page.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    assert page.evaluate(FAULTS) == []
    pixel = page.evaluate("[...elvis.canvas.getContext('2d').getImageData(2, 2, 1, 1).data]")
    assert (max(pixel[:3]) < 40) == (scheme == "dark")
    if scheme == "dark":
        change(page, {"background": [1, 1, 1]})
        settled(page, viewer)
        stream = BytesIO()
        save_pixels(render(scene=viewer.session.current), stream, plain=False)
        assert picture(viewer) == stream.getvalue()
        change(page, {"background": None})
        # a light page that is opened later brings back white
        other = browser.new_page(bypass_csp=True)
        other.goto(viewer.address)
        other.wait_for_function("elvis.root.dataset.final")
        settled(page, viewer)
        assert viewer.session._paper is None
        other.close()
    settled(page, viewer)
    context.close()


def test_values_are_read_and_plotted_by_keys(page, viewer, scene):
    """A cross is moved to the middle, reads the value there, and is the start of a line."""
    stage = page.locator(".elvis-stage")
    stage.focus()
    for key in ("v", "ArrowLeft", "ArrowRight"):
        page.keyboard.press(key)
    page.wait_for_function("elvis.picked")
    settled(page, viewer)
    picked = page.evaluate("elvis.picked")
    assert sample(read(*scene.data), ["u"], [picked["position"]])["u"][0] == pytest.approx(picked["value"], abs=1e-11)
    page.get_by_role("button", name="line", exact=True).press("Enter")
    for count in (1, 0):
        page.keyboard.press("Enter")
        page.wait_for_function("(count) => elvis.line.length === count", arg=count)
        page.keyboard.press("ArrowDown")
    page.get_by_role("region", name="plot along lines").wait_for()
    page.keyboard.press("Escape")
    assert page.locator(".elvis-cross").is_hidden()
    page.get_by_role("button", name="Close the plot").press("Enter")
    settled(page, viewer)


def test_grips_are_moved_by_keys(page, viewer):
    """The plane moves along its normal, and its grip keeps the focus."""
    before = viewer.session.current.plane
    page.get_by_role("button", name="handle").press("Enter")
    grip = page.locator(".elvis-grip[data-name=move]")
    grip.focus()
    grip.press("ArrowUp")
    settled(page, viewer)
    after = viewer.session.current.plane
    step = np.subtract(after.point, before.point)
    assert np.linalg.norm(step) > 0
    assert np.allclose(np.cross(step, before.normal), 0, atol=1e-12)
    assert page.evaluate("document.activeElement.dataset.name") == "move"
