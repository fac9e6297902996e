"""The page in a real browser: every way to change the picture, and what is seen at rest."""

import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from driving import PATIENCE, add, canvas_place, change, choose, picture, setting, settled, turn

from elvis import Shape, read, render, sample, write
from elvis.core.bounds.extrema import extrema
from elvis.core.testing import curved, grid, with_field
from elvis.renderer.commands.render import render as render_command
from elvis.scene import Scene
from elvis.scene.cameras.view import View
from elvis.scene.model.files import read_scene


def as_rendered(viewer, tmp_path):
    """The picture that elvis render makes of the scene, saved next to the data."""
    path = Path(viewer.session.scene.data[0]).with_name("scene.toml")
    path.write_text(viewer.session.text(".toml"))
    render(scene=read_scene(path)).save(tmp_path / "picture.png")
    return (tmp_path / "picture.png").read_bytes()


def as_copied(page, language, folder):
    """The picture that the command or the lines of Python make which the page copies."""
    page.get_by_label("save", exact=True).select_option(f"copy {language}")
    field = page.get_by_label(language, exact=True)
    text = field.input_value()
    # all is seen, or as much as there is room for, from the beginning
    heights = field.evaluate("each => [each.scrollTop, each.scrollHeight, each.clientHeight, window.innerHeight]")
    assert heights[0] == 0
    assert heights[2] >= min(heights[1], 0.6 * heights[3])
    page.get_by_role("button", name="close").click()
    folder.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        if language == "command":
            render_command.main(shlex.split(text)[2:], standalone_mode=False)
        else:
            exec(compile(text, "copied", "exec"), {})
    return (folder / "picture.png").read_bytes()


STYLED = {"objects[0].style": {"opacity": 0.6, "lit": False}, "objects[0].style.contours": {"count": 6}}
LINES = {"objects[0].style": {"mesh_lines": {"width": 1.5, "color": [0.8, 0.1, 0.1]}}}
ARROWS = {"objects[0]": {"kind": "glyphs", "points": ["elements"], "vector": "u,x,0.5", "length": 0.3}}
LOG = {"field": "2 + u", "palette": "magma", "bar": {"scale": "log", "title": "all"}}
#: what one does, by what the picture shows then
DRIVEN = {
    "a plane, turned": (turn,),
    "a sphere": (lambda page: add(page, "sphere"),),
    "faces by the name of a boundary": (
        lambda page: add(page, "faces"),
        lambda page: page.get_by_label("boundary", exact=True).check(),
        lambda page: page.get_by_title("View -z").click(),
    ),
    "isosurface and colour map": (lambda page: choose(page, "palette", "plasma"), lambda page: add(page, "isosurface")),
    "a volume": (lambda page: add(page, "volume"),),
    "a clip, opacity and contours": (
        lambda page: add(page, "faces"),
        lambda page: add(page, "clip"),
        lambda page: change(page, STYLED),
    ),
    "mesh lines": (lambda page: add(page, "cylinder"), lambda page: change(page, LINES)),
    "arrows with their key": (lambda page: change(page, ARROWS),),
    "parallel": (lambda page: page.get_by_title("View +x").click(), turn),
    "perspective": (lambda page: page.get_by_title("Perspective or parallel view").click(),),
    "colours by the logarithm": (lambda page: change(page, LOG),),
}


def test_pictures_at_rest_match_those_of_saved_scenes(page, viewer, tmp_path):
    """Byte for byte: the picture on the page, that of elvis render of the scene, and of what the page copies."""
    page.set_viewport_size({"width": 780, "height": 290})
    begun = {key: viewer.session.table[key] for key in ("field", "plane", "camera")}
    known = set()
    for name, steps in DRIVEN.items():
        changes = {**dict.fromkeys(viewer.session.table), **begun}
        change(page, changes)
        settled(page, viewer)
        for step in steps:
            step(page)
            settled(page, viewer)
        assert page.locator(".elvis-error").is_hidden(), name
        assert picture(viewer) == as_rendered(viewer, tmp_path), name
        known.add(picture(viewer))
        if name.startswith("faces"):
            assert viewer.session.table["objects"] == [{"kind": "faces", "select": ["boundary"]}]
    assert len(known) == len(DRIVEN)
    for language in ("command", "Python"):
        assert picture(viewer) == as_copied(page, language, tmp_path / language)

    change(page, {**dict.fromkeys(viewer.session.table), **begun})
    settled(page, viewer)


def test_pictures_of_plane_data_are_moved_and_zoomed(browser, start, tmp_path):
    """Byte for byte as well."""
    mesh = curved(grid(Shape.TRIANGLE, 2), lambda x: x + 0.1 * np.sin(x[:, [1, 0, 2]]) * [1, 1, 0], n=3)
    files = write(with_field(mesh, lambda x: np.exp(x[:, 0]) * x[:, 1]), tmp_path / "flat.xml")
    viewer = start(Scene("u", data=tuple(map(str, files))))
    page = browser.new_page(viewport={"width": 780, "height": 290}, bypass_csp=True)
    page.set_default_timeout(1000 * PATIENCE)
    page.goto(viewer.address)
    settled(page, viewer)
    turn(page)
    change(page, {"objects": [{"kind": "faces", "style": {"contours": {"count": 5}, "mesh_lines": {}}}]})
    settled(page, viewer)
    assert page.locator(".elvis-error").is_hidden()
    assert viewer.session.table["camera"]["at"][2] == 0.0
    assert picture(viewer) == as_rendered(viewer, tmp_path)
    page.close()


def test_steps_are_undone_and_done_again(page, viewer):
    before = viewer.session.table
    choose(page, "palette", "plasma")
    page.get_by_title("View -x").click()
    settled(page, viewer)
    after = viewer.session.table
    for title, wanted in (("Undo (Ctrl+Z)", before), ("Redo (Ctrl+Y)", after), ("Undo (Ctrl+Z)", before)):
        for _ in range(2):
            page.get_by_title(title).click()
        settled(page, viewer)
        assert viewer.session.table == wanted


def test_values_under_the_pointer_match_the_solution(page, viewer, scene):
    width, height = page.evaluate("window.elvis.picture.image.slice(2)")
    page.mouse.move(*canvas_place(page, width // 2, height // 2))
    page.wait_for_function("document.querySelector('.elvis-status output').textContent.includes('certain')")
    text = page.inner_text(".elvis-status output")
    picked = page.evaluate("elvis.picked")
    found = sample(read(*scene.data), ["u"], [picked["position"]])
    assert abs(found["u"][0] - picked["value"]) < 1e-11
    assert f"element {found.location.element_id[0]} " in text
    # the row has six digits, "copy all" has the others
    place = ", ".join(f"{part:.6g}" for part in picked["position"])
    assert f"u = {picked['value']:.6g} at ({place})" in text
    # a picture that has been replaced has no values
    older = "elvis.ask('pick', {row: 9, column: 9, number: elvis.picture.number - 1})"
    assert page.evaluate(older) is None


def test_values_along_a_line_are_plotted_and_saved(page, viewer, scene):
    """Two clicks are its ends; all its values are those of the solution there. What is long covers no picture."""
    width, height = page.evaluate("window.elvis.picture.image.slice(2)")
    page.get_by_role("button", name="line", exact=True).click()
    for part in (0.45, 0.55):
        page.mouse.click(*canvas_place(page, int(part * width), height // 2))
        page.wait_for_function("elvis.line.length || elvis.plots.all[0]?.sources.length")
    plot = page.get_by_role("region", name="plot along lines")
    plot.get_by_label("add a quantity to the plot").select_option("x")
    plot.locator("text", has_text="distance").nth(1).wait_for()
    with page.expect_download() as started:
        plot.get_by_label("save the plot").select_option("CSV")
    names, *rows = Path(started.value.path()).read_text().splitlines()
    assert names == 'source,distance,x,y,z,element,"u","x"'
    table = np.array([row.rpartition('",')[2].split(",") for row in rows], float)
    found = sample(read(*scene.data), ["u"], table[:, 1:4])
    assert len(table) > 10
    assert np.allclose(table[:, 5], found["u"], rtol=0, atol=1e-11)
    assert np.allclose(table[:, 6], table[:, 1], rtol=0, atol=1e-11)
    assert np.allclose(table[:, 0], np.linalg.norm(table[:, 1:4] - table[0, 1:4], axis=1), rtol=0, atol=1e-12)
    page.evaluate("elvis.values.textContent = '-1.2345678901234567e-123 '.repeat(40)")
    assert page.evaluate(
        "elvis.stage.getBoundingClientRect().bottom <= elvis.values.parentElement.getBoundingClientRect().top"
    )
    plot.get_by_role("button", name="Close the plot").click()
    settled(page, viewer)


def test_names_of_data_are_text(page, scene):
    """A field whose name is an element of HTML makes none."""
    assert page.locator("img").count() == 0
    names = page.get_by_label("names: field").locator("option").all_inner_texts()
    assert set(read(*scene.data)) <= set(names)


#: three steps of the wheel, between which a picture of the camera before comes, as it may where drawing is slow
ROLLED = """async () => {
  const { width, height } = elvis.canvas, { camera } = elvis.picture;
  const image = elvis.picture.image.slice(2);
  for (let step = 0; step < 3; step++) {
    elvis.stage.dispatchEvent(new WheelEvent("wheel", { deltaY: 120, cancelable: true }));
    const canvas = new OffscreenCanvas(...image);
    canvas.getContext("2d");
    const motion = { size: [0, 0], low: 0, high: 0, lines: [] }, picture = await createImageBitmap(canvas);
    elvis.show({ ...elvis.picture, camera, final: false, size: image, motion }, picture, new Uint16Array(0));
  }
  return camera.height;
}"""


def test_keys_turn_and_fit(page, viewer):
    page.locator(".elvis-stage").focus()
    page.keyboard.press("ArrowLeft")
    settled(page, viewer)
    assert not isinstance(viewer.session.table["camera"], str)
    turned = viewer.session.current.camera
    page.keyboard.press("f")
    settled(page, viewer)
    fitted = viewer.session.current.camera
    assert (fitted.height, fitted.fov) == (None, None)
    assert np.allclose(fitted.basis(), turned.basis(), rtol=0, atol=1e-12)

    before = page.evaluate(ROLLED)
    settled(page, viewer)
    assert viewer.session.current.camera.height / before == pytest.approx(np.exp(3 * 60 / 400), rel=1e-12)

    # a perspective stays one, of the same direction; both are one step
    page.get_by_title("Perspective or parallel view").click()
    settled(page, viewer)
    page.keyboard.press("-")
    settled(page, viewer)
    away = viewer.session.current.camera
    page.keyboard.press("f")
    settled(page, viewer)
    near = viewer.session.current.camera
    assert near.fov == away.fov
    assert np.allclose(near.basis(), turned.basis(), rtol=0, atol=1e-12)
    page.keyboard.press("Control+z")
    settled(page, viewer)
    assert viewer.session.current.camera == away


def test_an_invalid_expression_is_flagged_while_typing(page, viewer):
    field = setting(page, "field")
    field.press_sequentially("+nothing")
    page.wait_for_function("[...document.querySelectorAll('.elvis-note')].some((note) => note.textContent)")
    assert "nothing" in page.locator(".elvis-note", has_text="nothing").inner_text()
    field.press("Enter")
    page.wait_for_selector(".elvis-error:not([hidden])")
    page.get_by_title("Undo (Ctrl+Z)").click()
    settled(page, viewer)


def test_pictures_are_saved_in_any_size(page, viewer, tmp_path):
    """The file that the dialog gives is the picture that elvis render makes in that size, with those samples."""
    page.get_by_label("save", exact=True).select_option("picture .png")
    page.get_by_label("width").fill("9000")
    page.locator("dialog button", has_text="save").click()
    assert page.evaluate("document.querySelector('dialog input:invalid').ariaLabel") == "width"
    for name, value in (("width", "97"), ("height", "61"), ("samples", "2")):
        page.locator("dialog").get_by_label(name).fill(value)
    with page.expect_download() as started:
        page.locator("dialog button", has_text="save").click()
    wanted = render(scene=replace(viewer.session.current, size=(97, 61), samples=2))
    wanted.save(tmp_path / "own.png")
    assert Path(started.value.path()).read_bytes() == (tmp_path / "own.png").read_bytes()
    page.locator("dialog").wait_for(state="hidden")


def test_a_page_for_others_is_saved(page, viewer, tmp_path):
    """The same file as that of elvis render."""
    page.get_by_label("save", exact=True).select_option("page .html")
    for name, value in (("width", "97"), ("height", "61")):
        page.locator("dialog").get_by_label(name).fill(value)
    with page.expect_download() as started:
        page.locator("dialog button", has_text="save").click()
    render(scene=replace(viewer.session.current, size=(97, 61), samples=1)).save(tmp_path / "own.html")
    assert Path(started.value.path()).read_bytes() == (tmp_path / "own.html").read_bytes()


def test_proof_is_shown_in_grey_until_it_is_not(page, viewer):
    exact = picture(viewer)
    proof = page.get_by_role("button", name="proof")
    for pressed in ("true", "false"):
        proof.click()
        page.wait_for_function("(on) => elvis.proofButton.ariaPressed === on", arg=pressed)
        settled(page, viewer)
        assert (picture(viewer) == exact) == (pressed == "false")


def test_the_range_is_set_by_values(page, viewer):
    """They begin with those that are shown, and go again; what is rejected leaves no trace in the panel."""
    row = page.locator(".elvis-panel > .elvis-row").filter(has_text="range")
    low, high = page.evaluate("elvis.picture.ranges.u")
    row.locator("select").select_option("own values")
    settled(page, viewer)
    assert viewer.session.table["range"] == [low, high]
    row.get_by_label("range 1").fill(str(high + 1.0))
    row.get_by_label("range 1").press("Enter")
    page.get_by_text("from a smaller to a greater value").wait_for()
    assert float(row.get_by_label("range 1").input_value()) == pytest.approx(low, rel=1e-5)
    row.get_by_title("Back to").click()
    settled(page, viewer)
    assert "range" not in viewer.session.table


def test_the_minimum_is_found_and_cut(page, viewer, scene):
    least, _ = extrema(read(*scene.data), "u")
    page.locator("button", has_text="minimum").click()
    page.locator("text.elvis-over").wait_for()
    told = page.get_by_label("values under the pointer").inner_text()
    assert told.startswith(f"u = {least.value:.6g} ")
    assert page.evaluate("elvis.picked.value") == least.value
    assert f"element {least.element}" in told
    add(page, "plane")
    settled(page, viewer)
    # the plane through it lies across the direction along which one looks most nearly, and the view stays
    scene = viewer.session.current
    assert scene.objects[0].surface.point == least.position
    assert scene.camera.height == page.evaluate("elvis.picture.camera.height")
    page.get_by_title("View -y").click()
    settled(page, viewer)
    add(page, "plane")
    settled(page, viewer)
    assert viewer.session.current.objects[1].surface.normal == (0.0, 1.0, 0.0)


def test_lines_of_equal_value_are_switched_on_by_a_tick(page, viewer):
    """A tick in the panel makes valid settings: of contours a count, which gives way to values."""
    page.locator(".elvis-panel summary", has_text="style").click()
    page.locator(".elvis-own").get_by_label("contours").click()
    settled(page, viewer)
    assert page.locator(".elvis-error").is_hidden()
    assert viewer.session.current.every_object[0].style.contours.count == 10
    field = page.get_by_label("values", exact=True)
    field.fill("0.2")
    field.press("Enter")
    settled(page, viewer)
    assert viewer.session.current.every_object[0].style.contours.values == (0.2,)
    page.get_by_label("count", exact=True).first.click()
    settled(page, viewer)
    assert page.locator(".elvis-error").is_hidden()
    found = viewer.session.current.every_object[0].style.contours
    assert (found.values, found.count) == ((), 10)


def test_the_view_rotates_about_the_visible_point(page, viewer):
    """After a look at one corner, a drag turns about what is there: it stays in its place, and something stays."""
    page.get_by_title("View iso").click()
    settled(page, viewer)
    width, height = page.evaluate("window.elvis.picture.image.slice(2)")
    page.mouse.move(*canvas_place(page, int(0.62 * width), int(0.45 * height)))
    for _ in range(8):
        page.mouse.wheel(0, -100)
    settled(page, viewer)
    page.wait_for_function("elvis.warp.source.parts")
    middle = np.array([page.evaluate("elvis.warp.seen(elvis.current()).middle")])
    before = View.through(viewer.session.current.camera, viewer.session.size)
    x, y = canvas_place(page, width // 2, height // 2)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 25, steps=4)
    page.mouse.up()
    settled(page, viewer)
    after = View.through(viewer.session.current.camera, viewer.session.size)
    assert not np.allclose(before.camera.basis(), after.camera.basis(), atol=0.1)
    one, other = (view.projected(middle)[0] for view in (before, after))
    assert np.allclose(one[:2] / one[2], other[:2] / other[2], rtol=0, atol=0.01)
    assert page.locator(".elvis-error").is_hidden()


def test_an_empty_view_offers_a_reset(page, viewer):
    camera = {"eye": [9, 9, 9], "at": [9, 9, 0], "up": [0, 1, 0], "height": 1.0}
    change(page, {"camera": camera})
    fit = page.get_by_role("alert").get_by_role("button", name="fit")
    fit.wait_for()
    fit.click()
    settled(page, viewer)
    assert page.locator(".elvis-error").is_hidden()
    assert sum(page.evaluate("Object.values(elvis.picture.counts)")) > 0


def test_pages_and_files_are_named_after_the_data(page):
    assert page.title() == "wave - ElVis"
    with page.expect_download() as started:
        page.get_by_label("save", exact=True).select_option("scene .toml")
    assert started.value.suggested_filename == "wave.toml"


def test_names_are_grouped_and_found_by_typing(page):
    chapters = (
        page.get_by_label("names: field")
        .locator("optgroup")
        .evaluate_all("groups => groups.map((own) => [own.label, ...[...own.children].map((one) => one.textContent)])")
    )
    assert [own[0] for own in chapters] == ["fields", "mesh", "resolution"]
    assert {"decay(u)", "recovered_error(u)", "truncated(u)"} <= set(chapters[2])
    assert {"element", "order", "x"} <= set(chapters[1])
    for _, *names in chapters:
        assert names == sorted(names, key=str.lower)
    listed = page.locator(f"#{setting(page, 'field').get_attribute('list')} option")
    assert listed.count() == sum(len(own) - 1 for own in chapters)


def test_a_value_is_copied_with_all_digits(page, viewer, scene):
    """Six digits stand next to the pointer."""
    width, height = page.evaluate("window.elvis.picture.image.slice(2)")
    page.mouse.move(*canvas_place(page, width // 2, height // 2))
    page.locator(".elvis-tip").wait_for()
    told = page.inner_text(".elvis-tip")
    page.get_by_role("button", name="copy all").click()
    rows = dict(line.split("\t") for line in page.get_by_label("values", exact=True).input_value().splitlines())
    page.get_by_role("button", name="close").click()
    point = [float(rows[axis]) for axis in "xyz"]
    exact = sample(read(*scene.data), ["u"], [point])["u"][0]
    assert float(rows["u"]) == pytest.approx(exact, rel=0, abs=1e-11)
    assert told == f"{float(rows['u']):.6g}"
    assert (rows["status"], rows["order"]) == ("certain", "2")


def test_a_text_that_is_being_typed_survives_changes_of_others(page, viewer):
    """With its caret; it applies where the reader ends it, and no sooner."""
    field = setting(page, "field")
    field.fill("")
    page.keyboard.type("u*")
    viewer.call(viewer.session.change({"palette": "magma"}))
    settled(page, viewer)
    assert setting(page, "palette").input_value() == "magma"
    assert viewer.session.table["field"] == "u"
    page.keyboard.type("2")
    page.keyboard.press("Home")
    viewer.call(viewer.session.change({"palette": "viridis"}))
    settled(page, viewer)
    page.keyboard.type("3*")
    assert field.input_value() == "3*u*2"
    field.fill("u*2")
    viewer.call(viewer.session.change({"palette": "magma"}))
    settled(page, viewer)
    # a browser reports no change of a text that was put back
    page.keyboard.press("Tab")
    settled(page, viewer)
    assert viewer.session.table["field"] == "u*2"
