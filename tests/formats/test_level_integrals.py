"""Integrals over planes and isosurfaces inside elements, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals import integrate
from elvis.core.integrals.graphs import on_graph
from elvis.core.integrals.levels import of_elements as levels_of_elements
from elvis.core.integrals.subcells import corners, subcell_map
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, one_element

SOLIDS = [shape for shape in Shape if shape.dimension == 3]
SPHERE = "(x-0.5)^2 + (y-0.5)^2 + (z-0.5)^2 = 0.16"


@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
def test_cells_fill_the_shape_and_have_their_derivatives(shape):
    d, random = shape.dimension, np.random.default_rng(0)
    places = random.random((20, d))
    volume, step = 0.0, 1e-6
    lines = [np.polynomial.legendre.leggauss(4)] * d
    nodes = np.stack(np.meshgrid(*((1 + line[0]) / 2 for line in lines), indexing="ij"), axis=-1).reshape(-1, d)
    weights = np.array([1.0])
    for line in lines:
        weights = np.multiply.outer(weights, line[1] / 2).reshape(-1)
    for cell in range(len(corners(shape))):
        derivatives = subcell_map(shape, np.full(20, cell), places)[1]
        for axis in range(d):
            moved = places + step * np.eye(d)[axis]
            back = places - step * np.eye(d)[axis]
            ends = [subcell_map(shape, np.full(20, cell), end)[0] for end in (back, moved)]
            np.testing.assert_allclose(derivatives[:, :, axis], (ends[1] - ends[0]) / (2 * step), atol=1e-8)
        volume += np.abs(np.linalg.det(subcell_map(shape, np.full(len(nodes), cell), nodes)[1])) @ weights
    truth = {Shape.TRIANGLE: 2, Shape.TETRAHEDRON: 4 / 3, Shape.PYRAMID: 8 / 3, Shape.PRISM: 4}
    assert volume == pytest.approx(truth.get(shape, 2**d), rel=1e-13)


def test_the_polynomial_is_zero_on_points_of_graphs():
    nets = np.random.default_rng(1).normal(size=(50, 3, 3, 3)) * 0.1 + np.linspace(-1, 1, 3)
    graph = on_graph(nets, (3, 3))
    assert len(graph.box) > 100
    tables = [line_tables(2, graph.points[:, axis])[0] for axis in range(3)]
    values = np.einsum("nabc,na,nb,nc->n", nets[graph.box], *tables)
    assert np.abs(values).max() < 1e-14


@pytest.mark.parametrize("shape", SOLIDS)
def test_planes_through_a_cube(shape):
    """Straight through, through its corners as a hexagon, along borders of elements, and on its slope."""
    planes = ["plane:0.3,0.4,0.5:0,0,1", "plane:0.5,0.5,0.5:1,1,1", "plane:0.5,0,0:1,0,0", "plane:0.1,0,0:3,0,1"]
    found = integrate(Dataset(grid(shape, 2)), ["area", "nx", "x*y"], planes, error=1e-10)
    areas = [1, 3 * np.sqrt(3) / 4, 1]
    assert [found.of("area", name).value for name in planes[:3]] == pytest.approx(areas, rel=1e-12)
    # x from 0.1 down to 0: z = 0.3 - 3 x there
    assert found.of("area", planes[3]).value == pytest.approx(0.3 * np.sqrt(1 + 1 / 9), rel=1e-12)
    assert found.of("nx", planes[3]).value == pytest.approx(0.3, rel=1e-12)
    assert found.of("x*y", planes[2]).value == pytest.approx(0.25, rel=1e-12)
    assert not found.remarks


@pytest.mark.parametrize("shape", [Shape.PRISM, Shape.HEXAHEDRON])
def test_the_area_of_a_sphere(shape):
    found = integrate(Dataset(grid(shape, 2)), ["area", "(x-0.5)*nx + (y-0.5)*ny + (z-0.5)*nz"], SPHERE, error=1e-9)
    area, outwards = (row.value for row in found)
    assert area == pytest.approx(4 * np.pi * 0.16, rel=1e-10)
    assert outwards == pytest.approx(4 * np.pi * 0.064, rel=1e-10)
    assert abs(area - 4 * np.pi * 0.16) <= found[0].error < 2e-9


@pytest.mark.thorough
@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize("shape", SOLIDS)
def test_spheres_and_cylinders_by_name(shape):
    """Area, and flux of what comes from the centre or the axis, whose length is that of the cube; normals point out."""
    dataset = Dataset(grid(shape, 2))
    surfaces = ["sphere:0.5,0.45,0.5:0.4", "cylinder:0.5,0.45,3:0,0,-2:0.4"]
    flux = "(x-0.5)*nx + (y-0.45)*ny + (z-0.5)*nz"
    found = integrate(dataset, ["area", flux], surfaces, error=1e-10)
    areas = 4 * np.pi * 0.16, 2 * np.pi * 0.4
    truth = [areas[0], 0.4 * areas[0], areas[1], 0.4 * areas[1]]
    assert [row.value for row in found] == pytest.approx(truth, rel=1e-10)
    assert all(abs(row.value - own) <= row.error for row, own in zip(found, truth, strict=True))


def test_curves_in_a_plane():
    dataset = Dataset(grid(Shape.TRIANGLE, 3))
    found = integrate(dataset, "length", ["plane:0.5,0.5:1,1", "(x-0.5)^2 + (y-0.5)^2 = 0.16", "x*y = 0.25"])
    x = np.linspace(0.25, 1, 20001)
    hyperbola = np.trapezoid(np.sqrt(1 + (0.25 / x**2) ** 2), x)
    assert [row.value for row in found] == pytest.approx([np.sqrt(2), 0.8 * np.pi, hyperbola], rel=1e-8)


def test_moments_of_a_cut_through_a_tetrahedron():
    """The plane z = -1 + 2 s leaves the triangle of side 2 (1 - s)."""
    dataset = Dataset(one_element(Shape.TETRAHEDRON))
    for part in (0.1, 0.6):
        over = f"plane:0,0,{-1 + 2 * part}:0,0,1"
        side = 2 * (1 - part)
        found = integrate(dataset, ["area", "x + 1", "(x + 1)*(y + 1)"], over)
        truth = [side**2 / 2, side**3 / 6, side**4 / 24]
        assert [row.value for row in found] == pytest.approx(truth, rel=1e-12)


def bent_inside(points):
    """The unit cube, moved where it is not its border."""
    bump = 0.06 * np.prod(np.sin(np.pi * points), axis=1, keepdims=True)
    return points + bump * [1, -1, 0.5]


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON])
def test_planes_through_curved_elements(shape):
    dataset = Dataset(curved(grid(shape, 2), bent_inside, 3))
    found = integrate(dataset, ["area", "x*y", "nx"], "plane:0.5,0.5,0.45:0,0.2,1", error=1e-9)
    slope = np.sqrt(1 + 0.2**2)
    assert [row.value for row in found] == pytest.approx([slope, slope / 4, 0], rel=1e-9, abs=1e-12)
    assert all(row.error < 1e-8 for row in found)


def test_an_isosurface_of_a_field():
    """A quarter of a cylinder of radius 0.4 and height 1, by the root of x^2 + y^2."""
    bare = Dataset(grid(Shape.PRISM, 2))
    field = approximated(bare, "u", lambda p: p[:, 0] ** 2 + p[:, 1] ** 2, 4)
    found = integrate(Dataset(bare.mesh, (field,)), ["area", "z"], "sqrt(u) = 0.4", error=1e-9)
    assert [row.value for row in found] == pytest.approx([0.2 * np.pi, 0.1 * np.pi], rel=1e-10)


def test_a_surface_that_touches_borders_of_elements():
    """Radius 0.5: the cylinder touches the planes x = 0.5 and y = 0.5 of the mesh along lines."""
    found = integrate(Dataset(grid(Shape.HEXAHEDRON, 2)), "area", "x*x + y*y = 0.25", error=1e-8)[0]
    assert abs(found.value - np.pi / 4) <= found.error < 1e-8


@pytest.mark.sampled
@pytest.mark.parametrize("over", ["u = 0.25", "-u = -0.25"])
@pytest.mark.parametrize("modes", [4, 5])
@pytest.mark.parametrize("shape", [Shape.PRISM, Shape.HEXAHEDRON])
def test_errors_of_surfaces_touching_borders_cover_jumps_of_rounding(shape, modes, over):
    """The same cylinder of a field projected element by element: it jumps by 1e-13 to 1e-11 across the planes."""
    field = approximated(Dataset(grid(shape, 2)), "u", lambda p: p[:, 0] ** 2 + p[:, 1] ** 2, modes)
    found = integrate(Dataset(grid(shape, 2), (field,)), "area", over, error=1e-8)[0]
    assert abs(found.value - np.pi / 4) <= found.error < 1e-3
    if over == "u = 0.25":  # values are raised by more than they jump: the surface is all in the elements inside
        assert found.value == pytest.approx(np.pi / 4, abs=1e-10)


def test_areas_that_borders_leave_in_doubt_are_in_the_error(monkeypatch):
    """A hundredth of each of the six elements that the cylinder passes or touches."""
    field = approximated(Dataset(grid(Shape.HEXAHEDRON, 2)), "u", lambda p: p[:, 0] ** 2 + p[:, 1] ** 2, 4)
    dataset = Dataset(grid(Shape.HEXAHEDRON, 2), (field,))
    monkeypatch.setattr(levels_of_elements, "touched", lambda piece, *_: np.full(len(piece), 0.01))
    (row,) = integrate(dataset, "area", "u = 0.25", error=1e-8)
    assert row.error == pytest.approx(0.06, abs=1e-6)


def scaled(field, factors):
    """The field times a factor (n,) on each element of its only block."""
    (block,) = field.blocks
    return replace(field, blocks=(replace(block, coefficients=block.coefficients * factors[:, None]),))


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.HEXAHEDRON])
def test_a_field_may_be_small_in_some_elements(shape):
    """Scaled element by element, down to 1e-12, it is zero where it was, and its jumps there are no rounding."""
    bare = Dataset(grid(shape, 2))
    field = approximated(bare, "u", lambda p: p[:, 0] ** 2 + p[:, 1] ** 2 - 0.3**2, 3)
    factors = 10.0 ** -np.linspace(0, 12, len(field.blocks[0].coefficients))
    found = integrate(Dataset(bare.mesh, (scaled(field, factors),)), "area", "u = 0", error=1e-8)[0]
    assert abs(found.value - 0.15 * np.pi) <= found.error < 1e-7


def test_functions_that_vanish_on_elements_have_no_surface_there():
    bare = Dataset(grid(Shape.HEXAHEDRON, 2))
    field = approximated(bare, "u", lambda p: p[:, 0] - 0.75, 2)
    is_low = np.arange(8) < 4  # of the unit cube's eighths those below z = 0.5
    found = integrate(Dataset(bare.mesh, (scaled(field, is_low),)), "area", "u = 0")
    assert found.value == pytest.approx(0.5, rel=1e-12)
    assert found[0].error < 1e-11


@pytest.mark.parametrize(
    ("over", "sentence"),
    [
        ("plane:0,0,0", "expected plane:POINT:NORMAL, such as plane:0,0,0.5:0,0,1, found 'plane:0,0,0'"),
        ("plane:0,0,0:0,0,0", "expected plane:POINT:NORMAL"),
        ("plane:0,a,0:0,0,1", "expected plane:POINT:NORMAL"),
        ("cylinder:0,0,0:0,0,1", "expected cylinder:POINT:AXIS:RADIUS, such as cylinder:0,0,0:0,0,1:0.5, found"),
        ("sphere:0,0,0:-1", "expected sphere:CENTRE:RADIUS"),
        ("x=half", "x=half: expected a number after =, found 'half'"),
        ("q=1", "there is no 'q'"),
        ("sin(x)*y=1", "sin(x)*y=1: expected a polynomial of fields, their first derivatives and coordinates"),
    ],
)
def test_invalid_surfaces_are_rejected(over, sentence):
    with pytest.raises(ElvisError) as error:
        integrate(Dataset(grid(Shape.HEXAHEDRON, 1)), "area", over)
    assert sentence in str(error.value)


@pytest.mark.parametrize("value", [-5.0, 5.0])
def test_a_value_outside_the_range_has_no_area(value):
    dataset = Dataset(grid(Shape.HEXAHEDRON, 1))
    dataset = replace(dataset, fields=(approximated(dataset, "u", lambda p: p[:, 0], 2),))
    assert integrate(dataset, "area", f"u={value}")[0].value == 0.0


def test_a_surface_outside_the_mesh_has_no_area():
    found = integrate(Dataset(grid(Shape.TETRAHEDRON, 1)), ["area", "x"], "plane:0,0,3:0,0,1")
    assert [row.value for row in found] == [0, 0]
