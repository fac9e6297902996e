"""What the drawing process tells is about the geometry and the phase that the page shows."""

from dataclasses import replace

import numpy as np
import pytest
from driving import PATIENCE, picture, settled
from test_page import as_rendered

from elvis import Copies, Dataset, Deform, Plane, Reference, Repeat, Scene, Shape, write
from elvis.core.data.mesh import PERIODIC
from elvis.core.testing import approximated, grid
from elvis.viewer.drawing_process import _Drawing
from elvis.viewer.moments import source_of

FUNCTIONS = {"E_re": lambda x: 1 + 0 * x[:, 0], "E_im": lambda x: x[:, 0]}


@pytest.fixture
def drawing():
    data = Dataset(grid(Shape.QUADRILATERAL, 1))
    data = replace(data, fields=tuple(approximated(data, name, own, 3) for name, own in FUNCTIONS.items()))
    scene = Scene("E", deform=Deform("E,0", 1.0), phase=0.0, device="reference")
    return _Drawing(source_of(scene, data), None), scene


def test_lines_of_values_belong_to_the_scale_and_the_phase(drawing):
    process, scene = drawing
    facts = process.answer("facts", 0, None)
    assert facts["fields"] == ["E_re", "E_im", "E"]
    assert facts["complex"] == ["E"]
    assert facts["periods"] == {}
    for scale, phase in ((1.0, 0.0), (2.0, 0.0), (2.0, 90.0)):
        shown = replace(scene, deform=replace(scene.deform, scale=scale), phase=phase)
        process._take(process._in_state(shown))
        # the map X = x + scale Re(E exp(i phase)) takes x = 0.25 to
        moved = 0.25 + scale * (np.cos(np.radians(phase)) - 0.25 * np.sin(np.radians(phase)))
        content = {"quantities": ["undeformed_x", "E"], "start": [moved, 0.2, 0.0], "end": [moved, 0.8, 0.0]}
        found = process.answer("line", 0, content)
        assert np.allclose(found["values"][0], 0.25, atol=1e-12)
        assert np.allclose(found["values"][1], (moved - 0.25) / scale, atol=1e-12)


def test_reference_values_of_a_scene_reach_the_viewer(tmp_path):
    """They outdo those of the file next to the data, for data that the scene names and for data in memory."""
    data = Dataset(grid(Shape.QUADRILATERAL, 1))
    data = replace(data, fields=(approximated(data, "p", FUNCTIONS["E_im"], 3),))
    files = tuple(map(str, write(data, tmp_path / "a.xml")))
    (tmp_path / "a.elvis.toml").write_text("[reference]\nmu = 3\nu_ref = 5\n")
    scene = Scene("mu*p", data=files, reference=Reference(mu=8.0), device="reference")
    for source, quantity, factor in ((source_of(scene), "mu*u_ref*p", 40), (source_of(scene, data), "mu*p", 8)):
        content = {"quantities": [quantity], "start": [0.25, 0.2, 0.0], "end": [0.25, 0.8, 0.0]}
        found = _Drawing(source, None).answer("line", 0, content)
        assert np.allclose(found["values"][0], factor * 0.25, atol=1e-12)


@pytest.mark.thorough
def test_sliders_change_the_scale_and_the_phase(start, browser, tmp_path):
    data = Dataset(grid(Shape.QUADRILATERAL, 1))
    data = replace(data, fields=tuple(approximated(data, name, own, 3) for name, own in FUNCTIONS.items()))
    files = tuple(map(str, write(data, tmp_path / "wave.xml")))
    deform = Deform("E,0", 1.0)
    viewer = start(Scene("E_re", data=files, deform=deform, phase=0.0, size=(200, 160)))
    page = browser.new_page()
    page.set_default_timeout(1000 * PATIENCE)
    faults = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(viewer.address)
    settled(page, viewer)
    for label, value in (("scale", "0"), ("scale value", "1.5"), ("phase", "90")):
        before = picture(viewer)
        page.get_by_label(label, exact=True).fill(value)
        page.get_by_label(label, exact=True).press("Tab")
        settled(page, viewer)
        assert picture(viewer) != before
    shown = viewer.session.current
    assert (shown.deform, shown.phase) == (replace(deform, scale=1.5), 90.0)
    # x (1 - 1.5) at this phase
    assert "the deformation folds elements" in page.inner_text(".elvis-status")
    assert picture(viewer) == as_rendered(viewer, tmp_path)
    assert not faults
    page.close()


@pytest.mark.thorough
def test_copies_are_added_changed_and_removed(start, browser, tmp_path):
    mesh = grid(Shape.QUADRILATERAL, 1)
    sides = replace(mesh.composites[1], name=PERIODIC)
    data = Dataset(replace(mesh, composites=(mesh.composites[0], sides)))
    data = replace(data, fields=(approximated(data, "u", FUNCTIONS["E_im"], 3),))
    files = tuple(map(str, write(data, tmp_path / "wave.xml")))
    viewer = start(Scene("u", data=files, size=(200, 160)))
    page = browser.new_page()
    page.set_default_timeout(60000)
    page.goto(viewer.address)

    def shown():
        settled(page, viewer)
        assert page.locator(".elvis-error").is_hidden(), page.inner_text(".elvis-error")
        return viewer.session.current.copies

    assert shown() is None
    before = picture(viewer)
    adding = page.get_by_label("add copies")
    adding.select_option("mirror at x = 0")
    mirror = Copies(mirror=(Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)),))
    assert shown() == mirror
    adding.select_option("repeat along y, period 1")
    assert shown() == replace(mirror, repeat=(Repeat("y", 2),))
    page.get_by_label("count", exact=True).fill("3")
    page.get_by_label("count", exact=True).press("Tab")
    assert shown() == replace(mirror, repeat=(Repeat("y", 3),))
    assert picture(viewer) == as_rendered(viewer, tmp_path)
    for _ in range(2):
        page.get_by_title("Remove these copies").last.click()
        settled(page, viewer)
    assert shown() is None
    assert picture(viewer) == before
    page.close()
