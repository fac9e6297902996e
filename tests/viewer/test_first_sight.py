"""The first picture of a wing shows its pressure; first streamlines start near it."""

import pytest
from driving import add, settled

from elvis import Scene, read
from elvis.plugins.samples.sample import write_sample
from elvis.viewer.contents import first_sight, wall_field


@pytest.mark.parametrize(
    ("fields", "wanted"),
    [
        (("u", "v", "w", "p"), "p"),
        (("VelocityX", "VelocityY", "Pressure"), "Pressure"),
        (("rho", "rhou", "p"), None),
        (("u", "v"), None),
        ((), None),
    ],
)
def test_walls_are_coloured_by_the_pressure_if_the_first_field_is_a_velocity(fields, wanted):
    assert wall_field(fields) == wanted


@pytest.mark.parametrize("field", ["", "v"])
def test_a_field_that_is_given_stays(field):
    facts = {"bodies": ["wing"], "body_size": 0.1, "wall_field": "p", "kind": "solid"}
    table = first_sight(facts, bool(field))
    assert table == {"objects": [{"kind": "faces", "select": ["wing"]}], **({} if field else {"field": "p"})}
    assert first_sight({**facts, "kind": "plane"}, bool(field)) == {}


@pytest.mark.thorough
def test_streamlines_start_near_the_wing(start, browser, tmp_path):
    write_sample("wing", tmp_path)
    files = tuple(str(tmp_path / name) for name in ("wing.xml", "wing.fld"))
    viewer = start(Scene(data=files, size=(200, 160)))
    page = browser.new_page(viewport={"width": 900, "height": 420}, bypass_csp=True)
    page.goto(viewer.address)
    settled(page, viewer)
    add(page, "streamlines")
    page.wait_for_function("window.elvis.table.objects.length === 2")
    (text,) = viewer.session.table["objects"][1]["seeds"]
    kind, count, *corners = text.split(":")
    low, high = ([float(one) for one in corner.split(",")] for corner in corners)
    assert (kind, count) == ("random", "30")
    # the wing spans a domain of 16.2 x 15.8 x 3 along z
    data = read(*files).bounds
    sides = [upper - lower for lower, upper in zip(low, high, strict=True)]
    assert (low[2], high[2]) == (data[0][2], pytest.approx(3.0))
    assert all(side < 0.5 * (upper - lower) for side, lower, upper in zip(sides[:2], *data, strict=False))
    page.close()
