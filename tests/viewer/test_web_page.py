"""The HTML file of a picture in a browser: it shows the record, and requests and runs nothing else."""

import re
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from driving import PATIENCE
from PIL import Image

import elvis
from elvis import Status
from elvis.core.base.errors import ElvisError
from elvis.plugins.command.command import elvis as command
from elvis.plugins.testing.steps import polynomial, steps_of
from elvis.scene.model.files import write_scene
from elvis.scene.web_page import _narrow

READ_OUT = re.compile(r"(.*) = (\S+)  at \((.*), (.*), (.*)\)  element (\d+)  (\w+)  pixel (\d+), (\d+)")
#: pixels, column and row, that are given another status
DOUBTFUL = {(100, 80): Status.AMBIGUOUS, (90, 70): Status.FAILED}


@pytest.fixture(scope="module")
def frame(wave):
    """A picture of a plane, coloured by the field whose name is an element of HTML."""
    dataset = elvis.read(*wave)
    camera = elvis.Camera((2.0, -1.0, 1.5), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), fov=40.0)
    plane = elvis.Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0))
    name = dataset.fields[1].name
    assert name.startswith("<img")
    drawn = elvis.render(dataset, name, plane=plane, camera=camera, size=(200, 160))
    status = drawn.status.copy()
    for (column, row), value in DOUBTFUL.items():
        assert status[row, column] == Status.CERTAIN
        status[row, column] = value
    return replace(drawn, status=status)


@pytest.fixture
def show(browser):
    """Opens a file; what the page reports or requests is a fault."""
    context = browser.new_context(viewport={"width": 900, "height": 700})
    faults = []

    def show(path):
        page = context.new_page()
        page.set_default_timeout(1000 * PATIENCE)
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("dialog", lambda dialog: faults.append("a dialog"))
        page.on("console", lambda message: faults.append(message.text))
        page.on("request", lambda request: request.url.startswith("data:") or requests.append(request.url))
        requests = []
        page.goto(path.as_uri())
        page.wait_for_selector("#picture[data-shown='0']")
        assert requests == [path.as_uri()]
        return page

    yield show
    context.close()
    assert not faults


def place_of(page, column, row):
    """Place in the window of the centre of a pixel of the record."""
    box = page.locator("#picture img:visible").bounding_box()
    left, top = page.evaluate("views[current].corner")
    return box["x"] + left + column + 0.5, box["y"] + top + row + 0.5


def test_the_read_out_shows_the_record(frame, show, tmp_path):
    frame.save(tmp_path / "a.html")
    page = show(tmp_path / "a.html")
    pixels = [*DOUBTFUL, (60, 75), (101, 90), (95, 85)]
    for column, row in pixels:
        page.mouse.move(*place_of(page, column, row))
        told = page.inner_text("#told")
        name, value, *place, element, status, x, y = READ_OUT.fullmatch(told).groups()
        assert (name, int(x), int(y)) == (frame.scene.field, column, row)
        assert float(value) == float(f"{np.float32(frame.field[row, column]):.6g}")
        assert abs(float(value) - frame.field[row, column]) <= 1e-6
        assert np.abs(np.array(place, float) - frame.position[row, column]).max() <= 2e-6
        assert int(element) == frame.element[row, column]
        assert status == Status(frame.status[row, column]).name.lower()
    page.mouse.move(*place_of(page, 1, 1))
    assert page.inner_text("#told") == "nothing  pixel 1, 1"

    # the keyboard moves the pixel that was clicked
    page.mouse.click(*place_of(page, 100, 85))
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowUp")
    assert page.inner_text("#told").endswith("certain  pixel 101, 75")


def test_proof_marks_the_pixels_that_are_not_certain(frame, show, tmp_path):
    frame.save(tmp_path / "a.html", plain=True)
    page = show(tmp_path / "a.html")

    def picture():
        shot = Image.open(BytesIO(page.screenshot())).convert("RGB")
        # browsers draw images at whole pixels
        left, top = (round(centre - 0.5) for centre in place_of(page, 0, 0))
        return np.asarray(shot)[top : top + 160, left : left + 200].astype(int)

    assert np.array_equal(picture(), frame.rgb)
    page.check("#proof")
    proved = picture()
    is_marked = np.ptp(proved, axis=2) > 0
    assert {(x, y) for y, x in np.argwhere(is_marked)} == set(DOUBTFUL)
    assert proved[80, 100].tolist() == [255, 0, 200]
    assert proved[70, 90].tolist() == [255, 60, 0]
    certain = frame.counts()["certain"]
    assert page.inner_text("#counts") == f"{certain} pixels certain1 ambiguous1 failed"
    page.uncheck("#proof")
    assert np.array_equal(picture(), frame.rgb)


def test_texts_of_the_data_are_harmless(frame, show, tmp_path):
    """Names and titles may be elements of HTML, close scripts, or look like marks of the template."""
    title = f"</title></script>@@SCENE@@{frame.scene.field}"
    hostile = replace(frame, scene=replace(frame.scene, field=title, title=title, data=("secret/<pre>&.xml",)))
    hostile.save(tmp_path / "a.html")
    page = show(tmp_path / "a.html")
    assert page.title() == page.inner_text("h1") == title
    assert page.locator("img").count() == 1
    assert page.locator("script").count() == 2
    page.mouse.move(*place_of(page, 100, 85))
    assert page.inner_text("#told").startswith(f"{title} = ")
    text = page.locator("pre").text_content()
    assert 'data = ["<pre>&.xml"]' in text
    assert "secret" not in (tmp_path / "a.html").read_text(encoding="utf-8")


def test_a_slider_turns_the_scene(wave, show, tmp_path):
    """Each of four directions shows the values of its own record; all have one scale."""
    path = tmp_path / "a.html"
    options = ("--field", "u", "--faces", "all", "--camera", "iso", "--size", "60x50", "--directions", "4")
    command.main(["render", *wave, *options, "-o", str(path)], prog_name="elvis", standalone_mode=False)
    page = show(path)
    dataset = elvis.read(*wave)
    page.focus("#direction")
    for number in range(4):
        page.wait_for_selector(f"#picture[data-shown='{number}']")
        assert page.inner_text("#angle") == f"{90 * number}°"
        assert page.locator("#picture img:visible").count() == 1
        page.mouse.move(*place_of(page, 30, 25))
        value, *place = READ_OUT.fullmatch(page.inner_text("#told")).groups()[1:5]
        # rounding may move the point out of the data: a little inwards
        x, y, z = 0.5 + (np.array(place, float) - 0.5) * (1 - 1e-5)
        assert abs(dataset["u"](x, y, z) - float(value)) <= 1e-4
        page.keyboard.press("ArrowRight")

    # iso looks along (-1, -1, -1): quarter turns about z, and the same size of a pixel
    forward = np.array(page.evaluate("views.map((view) => view.rays.forward)"))
    assert np.allclose(forward * np.sqrt(3), [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1]])
    steps = np.linalg.norm(page.evaluate("views.map((view) => view.rays.column)"), axis=1)
    assert np.ptp(steps) <= 1e-12


def test_a_slider_passes_through_the_steps(show, tmp_path):
    """Each step shows the values of its own time; all have one colour range, and the same camera."""
    times = [0.0, 0.5, 1.2]
    files = steps_of(tmp_path, times, lambda p, t: polynomial(p, t, 1))
    path = tmp_path / "a.html"
    options = ("--field", "u", "--size", "60x50", "--times", "all", "-o", str(path))
    command.main(["render", *map(str, files), *options], prog_name="elvis", standalone_mode=False)
    page = show(path)
    assert page.locator("#turning").is_hidden()
    slider = page.get_by_label("time")
    slider.focus()
    for number, time in enumerate(times):
        page.wait_for_selector(f"#picture[data-shown='{number}']")
        assert page.inner_text("#time") == f"{time:g}"
        page.mouse.move(*place_of(page, 30, 25))
        value, *place = READ_OUT.fullmatch(page.inner_text("#told")).groups()[1:5]
        assert float(value) == pytest.approx(polynomial(np.array([place[:2]], float), time, 1)[0], abs=1e-4)
        slider.press("ArrowRight")
    assert len({str(view) for view in page.evaluate("views.map((view) => view.rays)")}) == 1
    with pytest.raises(ElvisError, match="expected several steps"):
        command.main(["render", *map(str, files[:2]), *options], prog_name="elvis", standalone_mode=False)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["-o", "a.png"], "--directions: expected outputs that end in .html, found a.png"),
        (["--panels", "1x2", "-o", "a.html"], "--directions: expected one scene, found --panels"),
    ],
)
def test_directions_need_one_scene_and_a_page(scene, tmp_path, options, sentence):
    write_scene(scene, tmp_path / "s.toml")
    data = [str(tmp_path / "s.toml")] * (1 + options.count("--panels"))
    with pytest.raises(ElvisError, match=re.escape(sentence)):
        command.main(["render", *data, "--directions", "4", *options], prog_name="elvis", standalone_mode=False)


def test_numbers_beyond_four_bytes_take_eight():
    for values in ([1e39, 0.5], [1e-40, 0.5], [2**31]):
        wide = _narrow(np.array(values))
        assert wide.dtype == np.float64
        assert wide.tolist() == values
    assert _narrow(np.array([0.0, np.nan, np.inf, -1.5])).dtype == np.float32
    assert _narrow(np.array([-1, 2**31 - 1])).dtype == np.int32
