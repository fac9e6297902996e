"""Integrals along curves through elements, and places along them, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Composite
from elvis.core.integrals import integrate
from elvis.core.integrals.curves import Curve
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, with_field


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PYRAMID, Shape.PRISM, Shape.HEXAHEDRON])
def test_lines_circles_and_splines(shape):
    dataset = Dataset(grid(shape, 2))
    line, circle = "line:0,0.1,0.2:1,0.6,0.7", "circle:0.5,0.5,0.4:0,0,1:0.3"
    found = integrate(dataset, ["length", "x*y"], [line, circle, "polyline:0,0,0:1,0,0:1,1,0:1,1,1"])
    size = np.sqrt(1.5)
    truth = [size, size * (0.1 / 2 + 0.5 / 3), 0.6 * np.pi, 0.6 * np.pi / 4, 3, 0 + 1 / 2 + 1]
    assert [row.value for row in found] == pytest.approx(truth, rel=1e-12)
    assert all(abs(row.value - own) <= row.error for row, own in zip(found, truth, strict=True))
    straight = integrate(dataset, "x", "spline:0,0,0:0.2,0.2,0.2:1,1,1")
    assert straight.value == pytest.approx(np.sqrt(3) / 2, rel=1e-12)


def test_kinks_at_borders_and_ends_of_the_data():
    """Piecewise linear |x - 1/3| on three squares each way; the line begins and ends outside of the unit square."""
    dataset = with_field(grid(Shape.QUADRILATERAL, 3), lambda p: np.abs(p[:, 0] - 1 / 3), 2)
    found = integrate(dataset, ["u", "average(u)"], "line:-1,0.3:2,0.3", error=1e-9)
    assert found[0].value == pytest.approx(5 / 18, rel=1e-9)
    assert abs(found[0].value - 5 / 18) <= found[0].error
    assert found[0].measure == pytest.approx(1, rel=1e-9)
    assert found[1].value == pytest.approx(5 / 18, rel=1e-8)
    assert found.remarks[0].startswith("u has no value on 0.667 of line:-1,0.3:2,0.3, as at -")


def test_the_thickness_of_a_layer_on_a_curved_wall():
    """u = 2 s - s^2 at the height s above a cylinder: displacement 1/3, momentum 2/15 of the layer."""
    mesh = grid(Shape.QUADRILATERAL, 2)
    edges = mesh.of(Shape.SEGMENT)
    at_wall = (mesh.vertices[edges.members][:, :, 0] == 0).all(axis=1)
    mesh = replace(mesh, composites=(*mesh.composites, Composite(100, (("E", edges.ids[at_wall]),), "wall")))

    def ring(points):
        radius, angle = 1 + points[:, 0], np.pi / 4 * points[:, 1]
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * radius], axis=1)

    def speed(points):
        height = np.minimum(np.linalg.norm(points[:, :2], axis=1) - 1, 1)
        return 2 * height - height**2

    bent = curved(mesh, ring, 10)
    dataset = Dataset(bent, (approximated(Dataset(bent), "u", speed, 12),))
    found = integrate(
        dataset, ["displacement_thickness(u)", "momentum_thickness(u)"], "normal:wall:1.1,0.5:0.9999999", error=1e-9
    )
    assert [row.value for row in found] == pytest.approx([1 / 3, 2 / 15], rel=1e-6)


def test_even_steps_of_length():
    curve = Curve.parse(Dataset(grid(Shape.SEGMENT, 1)), "spline:0,0:1,2:3,1:3,0")
    points, lengths = curve.evenly(200)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    np.testing.assert_allclose(steps, lengths[1], rtol=1e-3)
    assert points[[0, -1], 0].tolist() == [0, 3]
    dense = curve.at(np.linspace(0, 3, 20001))[0]
    assert lengths[-1] == pytest.approx(np.linalg.norm(np.diff(dense, axis=0), axis=1).sum(), rel=1e-7)


@pytest.mark.parametrize(
    ("over", "sentence"),
    [
        ("line:0,0,0", "expected line:P:Q, points as 0,0,0, found 'line:0,0,0'"),
        ("line:0,0,0:0,0,0", "expected line:P:Q"),
        ("circle:0,0,0:0,0,0:1", "expected circle:CENTRE:NORMAL:RADIUS"),
        ("spline:0,a:1,1", "expected spline:P:Q:R"),
        ("normal:wall:0.5,0.5,0:1", "there is no boundary 'wall'"),
        ("normal:0.5,0.5,0:1", "expected normal:BOUNDARY:POINT:LENGTH"),
    ],
)
def test_invalid_curves_are_rejected(over, sentence):
    with pytest.raises(ElvisError) as error:
        integrate(Dataset(grid(Shape.HEXAHEDRON, 1)), "length", over)
    assert sentence in str(error.value)


def test_normals_from_points_outside_go_into_the_data():
    """Above, on and below the lower edge of the unit square: the normal leads upwards."""
    dataset = Dataset(grid(Shape.QUADRILATERAL, 2))
    for height in (0.1, 0.0, -0.2):
        ends = Curve.parse(dataset, f"normal:all:0.5,{height}:0.3").at(np.array([0.0, 1.0]))[0]
        np.testing.assert_allclose(ends, [[0.5, 0, 0], [0.5, 0.3, 0]], atol=1e-15)


def test_normals_and_layers_need_their_boundary():
    dataset = Dataset(grid(Shape.QUADRILATERAL, 1))
    with pytest.raises(ElvisError, match="nx is only known on boundaries and cuts, not on line"):
        integrate(dataset, "nx", "line:0,0:1,1")
    with pytest.raises(ElvisError, match="expected one curve, such as --over normal:wall"):
        integrate(dataset, "momentum_thickness(x)")
