"""Errors that are planted into what draws: the comparison finds them, says where they are and what they are of."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Camera, Dataset, Plane, Scene
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.reference.picture import render
from elvis.reference.report.summary import summary
from elvis.reference.study import compare_scene
from elvis.scene import Faces

PLANE = Plane((0.5, 0.5, 0.45), (0.1, 0.2, 1.0))
SCENE = Scene("u", PLANE, size=(60, 50))
VIEW = Camera((2.2, -1.7, 1.9), (0.5, 0.5, 0.5), fov=30.0)


def smooth(x):
    return np.sin(2 * x[:, 0]) + x[:, 1] * x[:, 2]


def data(function=smooth, shape=Shape.HEXAHEDRON, cells=3, modes=5):
    mesh = curved(grid(shape, cells), ripple(0.03, seed=2), 3)
    return Dataset(mesh, (approximated(Dataset(mesh), "u", function, modes=modes),))


def validated(right, wrong, scene=SCENE):
    """The comparison where what draws has other data than the reference."""

    def draw(dataset, own, device):
        return render(right if device == "reference" else wrong, own)

    return compare_scene(right, scene, (0,), 1 << 30, draw=draw, validation_size=60)


def failed_checks(study):
    return {check.name: check for check in study.validation.checks if not check.passed}


def test_no_false_errors_are_found():
    study = validated(data(), data())
    assert failed_checks(study) == {}
    assert summary(study)["pixel_exact"] is True


@pytest.mark.parametrize("size", [1e-9, 1e-3])
def test_a_wrong_coefficient(size):
    right = data()
    field = right.fields[0]
    block = field.blocks[0]
    element = 13  # the middle one
    coefficients = block.coefficients.copy()
    coefficients[np.flatnonzero(block.element_ids == element)[0], 62] += size
    wrong = replace(right, fields=(replace(field, blocks=(replace(block, coefficients=coefficients),)),))
    study = validated(right, wrong)
    assert set(failed_checks(study)) == {"field value"}
    check = failed_checks(study)["field value"]
    assert check.worst.element == element
    assert f"element {element}, (" in summary(study)["conclusion"]
    assert summary(study)["conclusion"].startswith("Not exact: field value fails at ")

    # all pixels above the tolerance lie in this element
    exact, drawn = render(right, SCENE), render(wrong, SCENE)
    off = np.abs(exact.field - drawn.field) > 1e-11 * np.ptp(exact.field[exact.seen])
    assert off.sum() == check.failed
    assert set(exact.element[off]) == {element}


@pytest.mark.thorough
def test_a_shifted_node():
    right = data(shape=Shape.TETRAHEDRON)
    vertices = right.mesh.vertices.copy()
    corner = int(np.linalg.norm(vertices - [1 / 3, 1 / 3, 1 / 3], axis=1).argmin())
    vertices[corner] += [0.0, 3e-4, 0.0]
    wrong = replace(right, mesh=replace(right.mesh, vertices=vertices))
    checks = failed_checks(validated(right, wrong))
    assert "field value" in checks
    x = np.array(checks["field value"].worst.position)
    assert np.linalg.norm(x - vertices[corner]) < 0.5

    # on the outer faces a node shows as a wrong place, too
    outer = int(np.linalg.norm(vertices - [1 / 3, 0, 1 / 3], axis=1).argmin())
    vertices = right.mesh.vertices.copy()
    vertices[outer] += [0.0, -1e-4, 0.0]
    wrong = replace(right, mesh=replace(right.mesh, vertices=vertices))
    checks = failed_checks(validated(right, wrong, replace(SCENE, plane=None, objects=(Faces(),), camera=VIEW)))
    assert np.linalg.norm(np.array(checks["position"].worst.position) - vertices[outer]) < 0.4
    assert checks["position"].found < 1e-3


def distance(x, clamp):
    """Distance from the segment between (0.3, 0.5, 0.5) and (0.7, 0.5, 0.5); from the whole line without the clamp."""
    along = np.clip(x[:, 0], 0.3, 0.7) if clamp else x[:, 0]
    return np.sqrt((x[:, 0] - along) ** 2 + (x[:, 1] - 0.5) ** 2 + (x[:, 2] - 0.5) ** 2 + 0.04)


def test_a_distance_function_that_ignores_the_end_of_its_line():
    """Wrong in the elements beyond the ends of the segment, right in those between: such pictures look plausible."""
    right, wrong = (data(lambda x, clamp=clamp: distance(x, clamp), modes=6) for clamp in (True, False))
    study = validated(right, wrong)
    check = failed_checks(study)["field value"]
    assert not 0.3 < check.worst.position[0] < 0.7
    assert check.worst.other < check.worst.exact
    assert check.found > 0.01
    assert "worst at column" in summary(study)["conclusion"]


def test_a_foreign_element_and_a_hole_are_named():
    """What draws takes an element for its neighbour, and leaves one out."""
    right = data()

    def draw(dataset, own, device):
        frame = render(right, own)
        if device == "reference":
            return frame
        element, status = frame.element.copy(), frame.status.copy()
        element[frame.element == 12] = 13
        hole = frame.element == 14
        element[hole], status[hole] = -1, 0
        field = np.where(hole, np.nan, frame.field)
        return replace(frame, element=element, status=status, field=field)

    checks = failed_checks(compare_scene(right, SCENE, (0,), 1 << 30, draw=draw, validation_size=60))
    assert set(checks) == {"element", "coverage"}
    assert checks["element"].worst.element == 12
    assert checks["coverage"].worst.element == 14
