"""First pictures of large data load only the elements near the cuts and faces."""

import dataclasses

import numpy as np
import pytest

from elvis.core.shapes import Shape
from elvis.core.testing.bending import curved, ripple
from elvis.core.testing.fields import with_field
from elvis.core.testing.meshes import grid
from elvis.renderer.frame.rendering import Pictures
from elvis.renderer.parts import near_boxes, near_cuts, relevance
from elvis.renderer.parts.near_cuts import NearCuts
from elvis.renderer.parts.relevance import Relevance
from elvis.scene import CutSurface, Faces, Isosurface, Plane, Scene, Sphere

#: gives exact boxes
WHOLE = near_boxes._exact
PLANE = Plane((0.5, 0.45, 0.52), (0.3, 0.2, 1.0))


@pytest.fixture(scope="module")
def bent():
    return with_field(curved(grid(Shape.HEXAHEDRON, 8), ripple(0.03), 2), lambda points: np.sin(3 * points).sum(1), 3)


@pytest.fixture
def large(monkeypatch):
    monkeypatch.setattr(near_cuts, "LARGE", 0)


@pytest.mark.parametrize(
    "scene",
    [
        Scene(field="u", plane=PLANE, size=(60, 45)),
        Scene(field="d(u,x)", plane=PLANE, size=(60, 45)),
        Scene(field="u", objects=(CutSurface(Sphere((0.2, 0.2, 0.3), 0.2)), Faces()), size=(60, 45)),
        Scene(field="u", objects=(CutSurface(PLANE),), size=(60, 45)),
    ],
    ids=["plane", "derivative", "sphere and faces", "plane in space"],
)
def test_pictures_are_those_of_all_elements(bent, scene, monkeypatch):
    with Pictures(bent) as pictures:
        whole = pictures.draw(scene)
    monkeypatch.setattr(near_cuts, "LARGE", 0)
    few = NearCuts().elements(bent, scene)
    assert few is not None
    assert len(few.mesh.domain_ids()) < bent.mesh.count
    with Pictures(bent) as pictures:
        found = pictures.draw(scene)
        loaded = len(pictures._renderer.stages.loaded.ids) - 1
    assert loaded == len(few.mesh.domain_ids())
    assert np.array_equal(found.image, whole.image)
    assert np.array_equal(found.element, whole.element)
    assert found.stats["elements"] == whole.stats["elements"]


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.PRISM])
@pytest.mark.parametrize("camera", ["fit", "iso"])
def test_wide_boxes_choose_the_elements_of_exact_ones(shape, camera, monkeypatch):
    """The ends of the domain, along the axes and as the camera sees it, and the elements near the surfaces."""
    mesh = curved(grid(shape, 8 if shape is Shape.HEXAHEDRON else 4), ripple(0.01), 4)
    data = with_field(mesh, lambda points: points.sum(1), 1)
    scene = Scene(field="u", objects=(CutSurface(PLANE), CutSurface(Sphere((0.2, 0.2, 0.3), 0.2))), camera=camera)
    exact = []
    monkeypatch.setattr(near_boxes, "_exact", lambda part, rows: exact.append(len(rows)) or WHOLE(part, rows))
    found = Relevance(data, scene).ids()
    assert (sum(exact) < 0.9 * mesh.count) == (shape is Shape.HEXAHEDRON)
    monkeypatch.setattr(relevance, "near_boxes", lambda part, rows, axes, may_meet: WHOLE(part, rows))
    assert found.tolist() == Relevance(data, scene).ids().tolist()


def test_another_cut_loads_all_elements_once(bent, large):
    near, scene = NearCuts(), Scene(field="u", plane=PLANE)
    few = near.elements(bent, scene)
    assert few is not None
    assert near.elements(bent, dataclasses.replace(scene, size=(30, 20))) is few
    assert near.elements(bent, dataclasses.replace(scene, plane=Plane((0.5, 0.5, 0.1), (0, 0, 1)))) is None
    assert near.elements(bent, scene) is None


@pytest.mark.parametrize("change", [{"objects": (CutSurface(PLANE), Isosurface((0.5,)))}, {"range": "all"}])
def test_pictures_that_depend_on_all_elements_load_them(bent, large, change):
    scene = dataclasses.replace(Scene(field="u", plane=None if "objects" in change else PLANE), **change)
    assert NearCuts().elements(bent, scene) is None


def test_small_data_are_loaded_at_once(bent):
    assert NearCuts().elements(bent, Scene(field="u", plane=PLANE)) is None
