"""Where streamlines end in the accuracy report: closed forms, and what linear elements are known to hold."""

import json
from itertools import pairwise

import numpy as np
import pytest

from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.streamlines.course import Course, Flow
from elvis.core.testing import approximated, curved, grid, mixed_plane, ripple
from elvis.reference.baseline.mesh import concatenate, linear_meshes
from elvis.reference.baseline.vtk_lines import linear_grid, places_after
from elvis.reference.line_study import line_facts, line_studies
from elvis.reference.quantities import Quantities
from elvis.reference.report.page import page
from elvis.reference.report.summary import summary
from elvis.reference.study import compare_scene
from elvis.scene import Camera, Faces, Scene, Streamlines

pytest.importorskip("vtkmodules.vtkFiltersFlowPaths")


def data(mesh, modes, **functions):
    bare = Dataset(mesh)
    return Dataset(mesh, tuple(approximated(bare, name, own, modes) for name, own in functions.items()))


def rotation(mesh):
    return data(mesh, 5, u=lambda p: 0.5 - p[:, 1], v=lambda p: p[:, 0] - 0.5, w=lambda p: np.full(len(p), 0.1))


def study(dataset, shown, levels):
    scene = Scene(field="u", objects=(Faces(), shown))
    (found,) = line_studies(dataset, scene, Quantities(dataset, ["u"]), levels, 1 << 30)
    return found


def test_linear_fields_are_exact_in_linear_elements_and_in_elvis_everywhere():
    dataset = rotation(curved(grid(Shape.HEXAHEDRON, 2), ripple(0.03), 3))
    shown = Streamlines(("line:0.6,0.5,0.5:0.75,0.5,0.5:3",), direction="both", duration=1.0)
    found = study(dataset, shown, (0, 1))
    assert (found.name, found.lines) == ("objects[1]", 6)
    assert found.ours.maximum < 1e-12
    # places are in single precision
    for own in found.others[:2]:
        assert own.maximum < 1e-6, own.name
    assert found.others[2].name == "VTK's own cells"
    assert found.others[2].maximum > 1e-4
    assert json.loads(json.dumps(line_facts(found)))["others"][1]["level"] == 1


@pytest.mark.parametrize("sign", [1, -1])
def test_places_of_vtk_are_those_after_a_time(sign):
    dataset = rotation(grid(Shape.TETRAHEDRON, 2))
    velocity = Flow.of(dataset, Course([[0.8, 0.5, 0.4]])).velocity
    mesh = concatenate(linear_meshes(velocity.patches, 0, {}))
    times = np.array([0.3, 1.0])
    seeds = np.array([[0.8, 0.5, 0.4], [0.5, 0.7, 0.5]])
    found = places_after(linear_grid(mesh, velocity), seeds, times, 1.0, sign)
    angle = sign * times
    away = seeds - [0.5, 0.5, 0.0]
    x, y = (
        away[:, 0] * np.cos(angle) - away[:, 1] * np.sin(angle),
        away[:, 0] * np.sin(angle) + away[:, 1] * np.cos(angle),
    )
    assert np.abs(found - np.stack([0.5 + x, 0.5 + y, seeds[:, 2] + 0.1 * angle], axis=1)).max() < 1e-6


def test_errors_of_linear_elements_fall_with_the_square_of_their_size():
    # a shear u = y^2 along x: lines are straight, and linear elements have the speed wrong between their corners
    dataset = data(grid(Shape.QUADRILATERAL, 2), 3, u=lambda p: p[:, 1] ** 2 + 0.2, v=lambda p: 0 * p[:, 0])
    found = study(dataset, Streamlines(("line:0.05,0.1:0.05,0.9:9",), duration=0.7), (0, 1, 2, 3))
    medians = [own.median for own in found.others[:4]]
    assert found.ours.maximum < 1e-12
    assert all(0.15 < fine / coarse < 0.4 for coarse, fine in pairwise(medians))


def test_reports_state_where_lines_end():
    dataset = data(curved(mixed_plane(), ripple(0.03), 3), 5, u=lambda p: 1 + p[:, 1] ** 2, v=lambda p: 0.1 * p[:, 0])
    camera = Camera((1.5, 0.5, 3.0), (1.5, 0.5, 0.0), up=(0.0, 1.0, 0.0), height=1.5)
    shown = Streamlines(("line:0.1,0.2:0.1,0.6:3",), length=1.5, width=2.0)
    scene = Scene(field="u", objects=(Faces(), shown), camera=camera, size=(40, 20), device="reference")
    made = compare_scene(dataset, scene, (0, 1), validation_size=0)
    numbers = summary(made)
    assert numbers["lines"][0]["ours"]["maximum"] < 1e-11
    assert "Streamlines of objects[1] end within" in numbers["conclusion"]
    text, files = page(made)
    assert "Where streamlines end: objects[1]" in text
    assert "plots/lines-0.svg" in files
    assert "VTK, 1 refinement" in text
