"""The tree of data: contents of the files, parts that are shown, hidden and coloured, and the order of objects."""

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from driving import change, picture, settled
from PIL import Image

from elvis import Dataset, Scene, Shape, read, write
from elvis.core.data.mesh import Composite
from elvis.core.testing import approximated, grid
from elvis.scene.model.tables import scene_of
from elvis.viewer.contents import contents_of


@pytest.fixture
def tree(page):
    return page.get_by_role("navigation", name="data and objects")


def objects(viewer):
    return [(each.kind, getattr(each, "select", None)) for each in scene_of(viewer.session.table).objects]


def test_contents_are_counted(scene):
    found = contents_of(read(*scene.data))
    assert found["elements"] == {"hexahedron": 8}
    assert found["orders"] == {"2": 8}
    assert found["boundaries"] == {"boundary": 24}
    assert found["regions"] == {}


def test_boundaries_are_shown_hidden_and_coloured(page, viewer, tree):
    """The last visible part stays: a scene without objects shows everything."""
    assert tree.get_by_text("8, 3D").is_visible()
    tree.get_by_role("button", name="show boundary").click()
    settled(page, viewer)
    assert objects(viewer) == [("cut", None), ("faces", ("boundary",))]
    tree.get_by_label("colour of boundary").fill("#ff0000")
    settled(page, viewer)
    assert scene_of(viewer.session.table).objects[1].style.color == (1.0, 0.0, 0.0)
    tree.get_by_role("button", name="colour boundary by the field").click()
    settled(page, viewer)
    assert scene_of(viewer.session.table).objects[1].style.color is None
    tree.get_by_role("button", name="hide boundary").click()
    settled(page, viewer)
    assert objects(viewer) == [("cut", None)]
    change(page, {"objects": None})
    settled(page, viewer)
    assert tree.get_by_role("button", name="hide boundary").is_disabled()


def squares(folder):
    """Files of a square of two regions, the left and the right half."""
    mesh = grid(Shape.QUADRILATERAL, 2)
    (cells,) = mesh.elements.values()
    is_left = [mesh.vertices[np.unique(mesh.of(Shape.SEGMENT).members[own])][:, 0].max() < 0.9 for own in cells.members]
    halves = [("left", cells.ids[is_left]), ("right", cells.ids[~np.array(is_left)])]
    regions = tuple(Composite(n, (("Q", ids),), name) for n, (name, ids) in enumerate(halves))
    boundary = replace(next(own for own in mesh.composites if own.name == "boundary"), id=2)
    mesh = replace(mesh, composites=(*regions, boundary), domains={0: (0, 1)})
    data = Dataset(mesh, (approximated(Dataset(mesh), "u", lambda x: x[:, 0], 2),))
    return tuple(map(str, write(data, folder / "square.xml")))


@pytest.fixture
def regions(start, browser, tmp_path):
    """A viewer of the square, and its page at rest."""
    viewer = start(Scene("u", data=squares(tmp_path), size=(200, 160)))
    page = browser.new_page()
    page.goto(viewer.address)
    settled(page, viewer)
    yield viewer, page
    page.close()


def test_regions_of_2d_data_are_hidden_and_coloured(regions):
    viewer, page = regions
    page.get_by_label("colour of left").fill("#ff0000")
    settled(page, viewer)
    assert objects(viewer) == [("faces", ("region:right",)), ("faces", ("region:left",))]
    red = (np.asarray(Image.open(BytesIO(picture(viewer))).convert("RGB")) == (255, 0, 0)).all(axis=2)
    assert 0.2 < red.mean() < 0.8
    page.get_by_role("button", name="hide left").click()
    settled(page, viewer)
    assert objects(viewer) == [("faces", ("region:right",))]
    # without elements there would be no picture
    assert page.get_by_role("button", name="hide right").is_disabled()
    page.get_by_role("button", name="show left").click()
    settled(page, viewer)
    assert objects(viewer) == [("faces", ("all",))]


def test_boundaries_of_2d_data_are_lines(regions):
    viewer, page = regions
    page.get_by_label("colour of boundary").fill("#ff0000")
    settled(page, viewer)
    faces, line = viewer.session.current.objects
    assert (faces.kind, line.along, line.style.color) == ("faces", "boundary:boundary", (1.0, 0.0, 0.0))
    pixels = np.asarray(Image.open(BytesIO(picture(viewer))).convert("RGB"))
    assert (pixels == (255, 0, 0)).all(axis=2).sum() > 500
    page.get_by_role("button", name="hide boundary").click()
    settled(page, viewer)
    assert objects(viewer) == [("faces", ("all",))]


def test_objects_change_places(page, viewer, tree):
    """By the arrow keys, and by dragging; the view stays."""
    change(page, {"objects[0]": {"kind": "isosurface", "values": [0.2]}, "objects[1]": {"kind": "faces"}})
    settled(page, viewer)
    tree.get_by_role("button", name="move 1 cut").press("ArrowDown")
    settled(page, viewer)
    assert [kind for kind, _ in objects(viewer)] == ["isosurface", "cut", "faces"]
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == "move 2 cut"
    camera = viewer.session.table["camera"]
    tree.get_by_label("add an object").scroll_into_view_if_needed()
    last = tree.get_by_role("button", name="move 3 faces").bounding_box()
    first = tree.get_by_role("button", name="move 1 isosurface").bounding_box()
    page.mouse.move(last["x"] + 5, last["y"] + 5)
    page.mouse.down()
    page.mouse.move(first["x"] + 5, first["y"] - 3, steps=4)
    page.mouse.up()
    settled(page, viewer)
    assert [kind for kind, _ in objects(viewer)] == ["faces", "isosurface", "cut"]
    assert viewer.session.table["camera"] == camera
