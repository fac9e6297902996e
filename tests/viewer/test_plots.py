"""Plots below the picture: sections of walls, curves that stay, files."""

from pathlib import Path

import numpy as np
import pytest
from driving import canvas_place, settled

from elvis import Dataset, Shape
from elvis.core.base.errors import ElvisError
from elvis.core.testing import approximated, curved, grid, with_field
from elvis.core.wall_curves import at_walls
from elvis.viewer.wall_sections import wall_section


def ball(x):
    """The cube from 0 to 1 onto a ball of radius 1, almost."""
    y = 2 * x - 1
    squares = y**2
    return y * np.sqrt(
        1 - squares[:, [1, 0, 0]] / 2 - squares[:, [2, 2, 1]] / 2 + squares[:, [1, 0, 0]] * squares[:, [2, 2, 1]] / 3
    )


def test_sections_pass_through_the_point():
    """All points of the section of a ball lie in the plane and on the wall; values are those of the function."""
    mesh = curved(grid(Shape.HEXAHEDRON, 2), ball, n=5)
    bare = Dataset(mesh)
    dataset = Dataset(mesh, (approximated(bare, "u", lambda x: x[:, 0] - 2 * x[:, 1], 5),))
    found = at_walls(dataset, "boundary", ball(np.array([[0.7, 0.4, 1.0]])), [])
    place = np.array([found[name][0] for name in "xyz"])
    found = wall_section(dataset, place, ["u"], "y")
    columns = {name: np.array(own) for name, own in found["columns"].items()}
    assert (found["wall"], found["axis"]) == ("boundary", "y")
    assert np.allclose(columns["y"], place[1], rtol=0, atol=1e-11)
    points = np.stack([columns[name] for name in "xyz"], axis=1)
    assert np.abs(np.linalg.norm(points, axis=1) - 1).max() < 0.01
    assert np.abs(columns["u"] - (columns["x"] - 2 * columns["y"])).max() < 0.02
    # all three sections are closed: the longest is the one nearest to the centre
    assert wall_section(dataset, place, ["u"], None)["axis"] == "xyz"[np.abs(place).argmin()]
    with pytest.raises(ElvisError, match="click a wall"):
        wall_section(dataset, [0.1, 0.1, 0.1], ["u"], None)
    with pytest.raises(ElvisError, match="expected x, y or z"):
        wall_section(dataset, place, ["u"], "w")


def test_walls_of_plane_data_are_followed():
    dataset = with_field(grid(Shape.QUADRILATERAL, 2), lambda x: x[:, 0])
    found = wall_section(dataset, [0.9, 0.5], ["u"], None)
    assert found["axis"] is None
    assert max(found["columns"]["length"]) == pytest.approx(4.0)
    assert np.allclose(found["columns"]["u"], found["columns"]["x"], rtol=0, atol=1e-12)


def test_plots_stay_and_are_saved(page, viewer, tmp_path):
    """Curves of one kind share a plot; a histogram has its own; SVG and PNG have named axes."""
    page.set_viewport_size({"width": 1000, "height": 700})
    page.get_by_role("button", name="show boundary").click()
    settled(page, viewer)
    for row, column in ((0.4, 0.45), (0.45, 0.55)):
        page.get_by_role("button", name="wall plot").click()
        page.get_by_role("status").filter(has_text="Click a wall").wait_for()
        width, height = page.evaluate("window.elvis.picture.image.slice(2)")
        count = page.evaluate("elvis.plots.all[0]?.sources.length ?? 0")
        page.mouse.click(*canvas_place(page, int(column * width), int(row * height)))
        page.wait_for_function("(count) => elvis.plots.all[0]?.sources.length > count", arg=count)
        settled(page, viewer)
    page.get_by_role("button", name="histogram", exact=True).click()
    page.get_by_role("region", name="plot histogram by volume").get_by_text("share of volume").wait_for()
    plot = page.get_by_role("region", name="plot along walls")
    assert plot.get_by_role("img").get_attribute("aria-label").startswith("u over x/c: boundary, ")
    assert plot.get_by_label("normal of the section").input_value().startswith("normal ")
    for kind in ("SVG", "PNG"):
        with page.expect_download() as started:
            plot.get_by_label("save the plot").select_option(kind)
        started.value.save_as(tmp_path / kind)
        assert started.value.suggested_filename == f"wave-section.{kind.lower()}"
    text = Path(tmp_path / "SVG").read_text()
    assert ">x/c</text>" in text
    assert text.count("boundary, ") >= 2
    assert Path(tmp_path / "PNG").read_bytes().startswith(b"\x89PNG")
    # keys move the cursor, which the picture shows
    plot.get_by_role("img").press("ArrowRight")
    assert "u = " in plot.get_by_label("values at the cursor").inner_text()
    assert page.locator(".elvis-handles polyline").count() == 4
    before = page.get_by_role("region", name="plots").bounding_box()["height"]
    page.get_by_role("separator", name="height of the plots").press("ArrowUp")
    settled(page, viewer)
    assert page.get_by_role("region", name="plots").bounding_box()["height"] == before + 20
    for _ in range(2):
        page.get_by_role("button", name="Close the plot").first.click()
    assert page.get_by_role("region", name="plots").count() == 0
    settled(page, viewer)


def test_parts_of_a_line_outside_the_data_are_reported(page, viewer):
    """The cube fills a third of the line."""
    page.evaluate("elvis.plots.add('line', { start: [-1, 0.5, 0.5], end: [2, 0.5, 0.5], name: 'across' })")
    share = page.get_by_text("% outside the data").text_content()
    assert 64 <= int(share.split()[0]) <= 70
