"""What is dragged, in a real browser: handles of surfaces, ranges, points of transfer functions, the divider."""

from base64 import b64decode
from io import BytesIO

import numpy as np
import pytest
from driving import PATIENCE, change, settled
from PIL import Image

from elvis import ColorBar, read, render
from elvis.reference.linear_pictures import LinearPictures
from elvis.scene.cameras.view import View
from elvis.scene.record.palette import scales


def pull(page, grip, way):
    """Drag a grip by some pixels of the picture."""
    box = page.locator(f".elvis-grip[data-name={grip}]").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    for part in (0.5, 1.0):
        page.mouse.move(x + part * way[0], y + part * way[1])
    page.mouse.up()


def test_planes_and_spheres_are_dragged_in_the_picture(page, viewer, scene):
    """A plane by a fifth of its unit normal, a sphere's radius to the pointer: as the renderer's own view has it."""
    page.get_by_title("View iso").click()
    settled(page, viewer)
    page.get_by_title("View iso").click()
    settled(page, viewer)
    page.get_by_title("Perspective or parallel view").click()
    settled(page, viewer)
    page.locator("button", has_text="handle").click()
    view = View.through(viewer.session.current.camera, viewer.session.size)
    normal = np.array(scene.plane.normal) / np.linalg.norm(scene.plane.normal)
    wanted = scene.plane.point + 0.2 * normal
    column, row, weight = view.projected(np.array([scene.plane.point, wanted])).T
    pull(page, "move", (np.diff(column / weight)[0], np.diff(row / weight)[0]))
    settled(page, viewer)
    pixel = np.linalg.norm(view.row) * view.depth_of(wanted)
    moved = viewer.session.current.plane
    assert np.allclose(moved.point, wanted, atol=2 * pixel)
    assert moved.normal == scene.plane.normal

    page.get_by_label("add an object").select_option("sphere")
    settled(page, viewer)
    before = viewer.session.current.objects[0].surface
    pull(page, "radius", (12, 0))
    settled(page, viewer)
    sphere = viewer.session.current.objects[0].surface
    assert sphere.center == before.center
    away = np.linalg.norm(np.subtract(view.camera.eye, before.center))
    angles = np.arcsin(np.array([before.radius, sphere.radius]) / away)
    assert np.diff(np.tan(angles))[0] / np.linalg.norm(view.row) == pytest.approx(12, abs=1)


def test_cylinders_and_cones_are_dragged_in_the_picture(page, viewer):
    """A cylinder's axis, its radius and a cone's side go to the pointer: as the renderer's own view has it."""
    centre, axis = np.array([0.5, 0.5, 0.5]), np.array([0.2, 0.1, 1.0]) / np.linalg.norm([0.2, 0.1, 1.0])
    cylinder = {
        "kind": "cut",
        "surface": {"kind": "cylinder", "point": list(centre), "axis": list(axis), "radius": 0.2},
    }
    cone = {"kind": "cut", "surface": {"kind": "cone", "apex": list(centre), "axis": list(axis), "angle": 30.0}}
    camera = {"eye": [4.0, -3.0, 2.0], "at": list(centre), "up": [0, 0, 1], "fov": 25.0}
    change(page, {"plane": None, "camera": camera, "objects[0]": cylinder, "objects[1]": cone})
    settled(page, viewer)
    view = View.through(viewer.session.current.camera, viewer.session.size)

    def pixels(*points):
        column, row, weight = view.projected(np.array(points)).T
        return np.stack([column / weight, row / weight], axis=1)

    def surfaces():
        settled(page, viewer)
        return [item.surface for item in viewer.session.current.objects]

    # at right angles to axis and view
    aside = np.cross(axis, np.subtract(centre, camera["eye"]))
    aside /= np.linalg.norm(aside)
    page.locator("button", has_text="handle").nth(0).click()
    pull(page, "radius", np.diff(pixels(centre + 0.2 * aside, centre + 0.3 * aside), axis=0)[0])
    own = surfaces()[0]
    assert own.radius == pytest.approx(0.3, abs=0.01)
    assert np.allclose([own.point, own.axis], [centre, axis])
    pull(page, "move", (9, -6))
    own = surfaces()[0]
    assert np.allclose(pixels(own.point) - pixels(centre), (9, -6), atol=1.0)
    pull(page, "tilt", (10, 0))
    tilted = surfaces()[0]
    assert np.allclose(tilted.point, own.point)
    turn = np.arccos(np.dot(tilted.axis, axis))
    assert turn == pytest.approx(10 / 64, rel=0.3)

    page.locator("button", has_text="handle").nth(1).click()
    reach = 2 * 64 * np.linalg.norm(view.row) * view.depth_of(centre) * np.cos(np.radians(30.0))
    middle = centre + reach * axis
    ends = [middle + reach * np.tan(np.radians(angle)) * aside for angle in (30.0, 40.0)]
    pull(page, "angle", np.diff(pixels(*ends), axis=0)[0])
    own = surfaces()[1]
    assert own.angle == pytest.approx(40.0, abs=1.0)
    assert np.allclose([own.apex, own.axis], [centre, axis])


def test_new_volumes_show_the_rarer_end_of_the_values(page, viewer):
    page.get_by_label("add an object").select_option("volume")
    page.wait_for_function("elvis.table.objects?.[0]?.kind === 'volume'")
    (transfer,) = [own["transfer"] for own in viewer.session.table["objects"]]
    x, y, z = np.random.default_rng(0).random((3, 10_000))
    density = np.interp(np.sin(3 * x) + y * z, transfer["values"], transfer["densities"])
    assert 0.02 < (density > 0).mean() < 1 / 8 + 0.02
    # most values are low
    assert transfer["densities"][-1] > 0
    page.get_by_title("Undo (Ctrl+Z)").click()
    settled(page, viewer)


def test_transfer_functions_are_drawn_over_the_histogram(page, viewer):
    """Points are dragged, added and removed, with the mouse and with keys."""
    transfer = {"values": [0.0, 0.5, 1.0], "densities": [0.0, 1.0, 2.0]}
    volume = {"kind": "volume", "error": 0.3, "transfer": transfer}
    page.evaluate("volume => window.elvis.change({plane: null, 'objects[0]': volume})", volume)
    page.wait_for_selector(".elvis-bars")
    page.wait_for_function("document.querySelector('.elvis-bars').getAttribute('d')")

    def transfer():
        settled(page, viewer)
        return viewer.session.table["objects"][0]["transfer"]

    page.locator(".elvis-transfer").scroll_into_view_if_needed()
    box = page.locator(".elvis-transfer").bounding_box()
    ends = page.evaluate("[...window.elvis.histograms.values()][0]")
    span = max(ends["high"], 1.0) - min(ends["low"], 0.0)
    point = page.locator(".elvis-transfer .elvis-grip").nth(1).bounding_box()
    x, y = point["x"] + point["width"] / 2, point["y"] + point["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 20, y)
    page.mouse.up()
    assert transfer()["values"] == [0.0, pytest.approx(0.5 + 20 * span / box["width"], abs=0.01 * span), 1.0]
    assert transfer()["densities"] == [0.0, pytest.approx(1.0, abs=0.05), 2.0]

    page.locator(".elvis-transfer .elvis-grip").nth(0).focus()
    page.keyboard.press("Enter")
    assert transfer()["densities"] == [0.0, pytest.approx(0.5, abs=0.05), pytest.approx(1.0, abs=0.05), 2.0]
    page.locator(".elvis-transfer .elvis-grip").nth(0).dblclick()
    assert len(transfer()["values"]) == 3
    assert transfer()["densities"][0] == pytest.approx(0.5, abs=0.05)


def test_the_range_is_dragged_on_the_colour_bar(page, viewer):
    """In a figure whose bar lies below; a double click makes it automatic again."""
    page.evaluate("window.elvis.change({bar: {position: 'bottom'}})")
    settled(page, viewer)
    (bar,) = page.evaluate("window.elvis.picture.bars")
    pull(page, "high", (-0.25 * bar["box"][2], 0))
    settled(page, viewer)
    low, high = viewer.session.table["range"]
    assert low == bar["low"]
    assert high == pytest.approx(bar["low"] + 0.75 * (bar["high"] - bar["low"]), abs=0.01 * (bar["high"] - bar["low"]))
    assert page.evaluate("window.elvis.picture.bars[0].high") == high
    page.locator(".elvis-grip[data-name=low]").dblclick()
    settled(page, viewer)
    assert "range" not in viewer.session.table


def test_linear_elements_are_shown_next_to_the_exact_picture(page, viewer, scene, tmp_path):
    """To the right of the divider is the picture of `elvis compare`; it goes while something moves."""
    page.get_by_label("linear elements").select_option(index=2)
    page.wait_for_selector(".elvis-divider:not([hidden])")
    # the page may become narrower by a scroll bar since its first picture
    settled(page, viewer)
    width = viewer.session.current.size[0]
    page.wait_for_function(f"document.querySelector('.elvis-linear').width == {width}")
    shown = page.evaluate("document.querySelector('.elvis-linear').toDataURL('image/png').split(',')[1]")
    with Image.open(BytesIO(b64decode(shown))) as image:
        pixels = np.asarray(image.convert("RGB"))
    dataset = read(*scene.data)
    frame = render(dataset, viewer.session.current)
    image, _ = LinearPictures(dataset).draw(frame, 1)
    assert np.array_equal(pixels, image)
    assert (pixels != frame.rgb).any()

    divider = page.get_by_label("divider")
    x, y = page.locator(".elvis-divider").bounding_box()["x"] + 7, 200
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 30, y)
    page.mouse.up()
    width = page.evaluate("window.elvis.picture.image[2]")
    assert int(divider.get_attribute("aria-valuenow")) == pytest.approx(50 - 3000 / width, abs=1)
    divider.focus()
    page.keyboard.press("ArrowRight")
    assert int(divider.get_attribute("aria-valuenow")) == pytest.approx(52 - 3000 / width, abs=1)
    page.evaluate("window.elvis.look(camera => camera, true)")
    page.wait_for_selector(".elvis-divider", state="hidden")
    page.wait_for_selector(".elvis-divider:not([hidden])")


def test_objects_hidden_in_one_page_are_hidden_in_all(browser, page, viewer, scene):
    """The other page is narrow: its panel opens over the picture, which stays where it is."""
    other = browser.new_page(viewport={"width": 390, "height": 500})
    other.set_default_timeout(1000 * PATIENCE)
    other.goto(viewer.address)
    before = other.locator(".elvis-stage").bounding_box()
    other.get_by_title("Data, objects and settings").click()
    assert other.locator(".elvis-stage").bounding_box() == before
    page.get_by_role("button", name="hide 1 cut").click()
    other.get_by_role("button", name="show cut plane").wait_for()
    assert "plane" not in viewer.session.table
    page.get_by_title("Undo (Ctrl+Z)").click()
    other.locator(".elvis-hidden").wait_for(state="detached")
    page.get_by_title("Redo (Ctrl+Y)").click()
    other.get_by_role("button", name="show cut plane").click()
    page.locator(".elvis-hidden").wait_for(state="detached")
    assert viewer.session.current.plane == scene.plane
    other.close()


def test_ends_of_a_symmetric_logarithmic_range_have_grips(page, viewer):
    """A key moves an end by a hundredth of the bar, on the scale by which the renderer spreads its colours."""
    bar = {"scale": "symlog", "linear": 0.05}
    change(page, {"bar": bar, "range": [-2.0, 3.0]})
    settled(page, viewer)
    grip = page.locator(".elvis-bar-grip[data-name=high]")
    grip.focus()
    page.keyboard.press("ArrowDown")
    settled(page, viewer)
    low, high = viewer.session.table["range"]
    there, back = scales(ColorBar(**bar), -2.0, 3.0)
    ends = there(np.array([-2.0, 3.0]))
    wanted = back(ends[1:] - 0.01 * (ends[1] - ends[0]))[0]
    assert (low, high) == (-2.0, pytest.approx(wanted, rel=1e-12))
    assert page.locator(".elvis-bar-grip").count() == 2
