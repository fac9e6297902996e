"""Series in the viewer: the slider, playing, values over time, a run that goes on."""

from pathlib import Path

import numpy as np
import pytest
from driving import PATIENCE, canvas_place, picture, settled
from test_page import as_rendered

from elvis import Copies, Dataset, ElvisError, Plane, Shape, write
from elvis.core.testing import approximated, grid
from elvis.plugins.data.data import Reading
from elvis.plugins.series import following
from elvis.plugins.testing.steps import polynomial, steps_of
from elvis.scene import Scene
from elvis.viewer.drawing_process import Source
from elvis.viewer.moments import Moments

TIMES = [0.0, 0.5, 1.2]


@pytest.fixture
def files(tmp_path):
    return tuple(map(str, steps_of(tmp_path, TIMES, lambda p, t: polynomial(p, t, 1))))


def test_steps_are_shown_played_and_plotted(files, start, browser, tmp_path):
    viewer = start(Scene("u", data=files, size=(200, 160)))
    context = browser.new_context(viewport={"width": 900, "height": 420}, bypass_csp=True)
    page = context.new_page()
    page.set_default_timeout(1000 * PATIENCE)
    faults = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(viewer.address)
    settled(page, viewer)
    assert page.get_by_label("step", exact=True).input_value() == "2"

    # any step and any time is what elvis render draws of it
    page.get_by_label("step", exact=True).fill("1")
    settled(page, viewer)
    assert viewer.session.current.step == 1
    assert picture(viewer) == as_rendered(viewer, tmp_path)
    page.get_by_label("time", exact=True).fill("0.3")
    page.get_by_label("time", exact=True).press("Enter")
    settled(page, viewer)
    assert (viewer.session.current.step, viewer.session.current.time) == (None, 0.3)
    assert page.get_by_text("between 0 and 1 of 0 to 2", exact=True).is_visible()
    assert picture(viewer) == as_rendered(viewer, tmp_path)

    page.get_by_role("button", name="one range").click()
    settled(page, viewer)
    assert np.allclose(viewer.session.current.range, (0.0, 2.2), rtol=0, atol=1e-9)
    assert page.get_by_role("button", name="one range").get_attribute("aria-pressed") == "true"

    # small pictures tell the time that they show
    page.evaluate("""() => {
        const [titles, draw] = [[], elvis.retitle];
        Object.assign(elvis, { titles, retitle: (text) => { titles.push(text); draw.call(elvis, text); } });
    }""")
    move = "() => elvis.titles.length > 2 || elvis.timeBar.go((elvis.timeBar.step + 1) % 3, true)"
    page.wait_for_function(move, polling=200)
    assert set(page.evaluate("elvis.titles")) <= {f"u, time {time:g}" for time in TIMES}
    page.get_by_label("step", exact=True).fill("1")
    settled(page, viewer)

    page.get_by_label("steps per second").select_option("25 / s")
    page.get_by_role("button", name="play").click()
    page.wait_for_function("() => elvis.timeBar.step === 2 && !elvis.timeBar.isPlaying")
    settled(page, viewer)
    assert viewer.session.current.step == 2

    # a page for a colleague contains all steps
    page.get_by_label("save", exact=True).select_option("page .html")
    for name, value in (("width", "40"), ("height", "30")):
        page.locator("dialog").get_by_label(name).fill(value)
    page.get_by_label("all steps", exact=True).check()
    with page.expect_download() as started:
        page.locator("dialog button", has_text="save").click()
    assert '"times": ["0", "0.5", "1.2"]' in Path(started.value.path()).read_text()

    page.get_by_role("button", name="over time").click()
    page.mouse.click(*canvas_place(page, 254, 98))
    with page.expect_download() as started:
        page.get_by_label("save the plot").select_option("CSV")
    table = Path(started.value.path()).read_text().splitlines()
    rows = np.array([line.rpartition('",')[2].split(",") for line in table[1:]], float)
    assert table[0] == 'source,time,x,y,z,"u"'
    assert rows[:, 0].tolist() == TIMES
    wanted = [polynomial(row[None, 1:4], row[0], 1)[0] for row in rows]
    assert np.allclose(rows[:, 4], wanted, rtol=0, atol=1e-12)
    assert not faults
    context.close()


def test_a_run_is_followed_until_another_time_is_requested(files, tmp_path, monkeypatch):
    monkeypatch.setattr(following, "SOON", 0.0)
    last = tmp_path / "run_2.chk"
    content = last.read_bytes()
    last.unlink()
    source = Source((str(tmp_path),), None, Reading(), is_live=True)
    shown = Moments(source)
    assert (shown.data.time, shown.times) == (0.5, TIMES[:2])
    assert not shown.look()
    last.write_bytes(content)
    assert [shown.look() for _ in range(3)] == [False, True, False]
    assert (shown.data.time, shown.times) == (1.2, TIMES)
    found = shown.history("u+t", [0.2, 0.1, 0.0])
    wanted = [polynomial(np.array([[0.2, 0.1]]), time, 1)[0] + time for time in TIMES]
    assert np.allclose(found["values"], wanted, rtol=0, atol=1e-12)
    with pytest.raises(ElvisError, match="waiting for files in"):
        Moments(Source((str(tmp_path / "none"),), None, Reading(), is_live=True))


def test_ranges_over_steps_are_those_of_mirror_images(tmp_path):
    """The other component of the velocity says that u changes its sign, although nobody asks for it."""
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    fields = [approximated(bare, name, lambda p: 1.0 + p[:, 1], 2) for name in ("u", "v")]
    files = [tmp_path / "flow.xml", *(tmp_path / f"flow_{step}.chk" for step in range(2))]
    for step, path in enumerate(files[1:]):
        write(Dataset(bare.mesh, tuple(fields), float(step)), None if step else files[0], path)
    mirrored = Copies(mirror=(Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),))
    shown = Moments(Source(tuple(map(str, files))))
    for copies, low in ((None, 1.0), (mirrored, -2.0)):
        assert shown.range_of("u", Scene("u", copies=copies)) == pytest.approx([low, 2.0], abs=1e-9)
