"""Integrals against closed forms and theorems, on every shape, straight and curved."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import read
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Block, Dataset, Field, Homogeneous
from elvis.core.data.mesh import Composite
from elvis.core.integrals import integrate
from elvis.core.numbers.norms import norms
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.expansion import mode_count
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_volume, one_element, ripple

BODIES = [shape for shape in Shape if shape.dimension > 1]


def with_random_velocity(mesh, order, seed=0):
    """Fields u, v and, in three dimensions, w, with random coefficients on each element."""
    random = np.random.default_rng(seed)
    fields = []
    for name in "uvw"[: mesh.dimension]:
        blocks = []
        for shape, entities in mesh.elements.items():
            expansion = modified(shape, (order + 1,) * shape.dimension)
            coefficients = random.uniform(-1, 1, (len(entities), mode_count(expansion)))
            blocks.append(Block(expansion, entities.ids, coefficients))
        fields.append(Field(name, tuple(blocks)))
    return Dataset(mesh, tuple(fields))


def sides_at(mesh, is_there):
    """The ids of faces, or edges of plane elements, all of whose vertices (k, 3) are at a place."""
    shapes = (Shape.SEGMENT,) if mesh.dimension == 2 else (Shape.TRIANGLE, Shape.QUADRILATERAL)
    edges = mesh.of(Shape.SEGMENT).members
    ids = []
    for shape in shapes:
        members = mesh.of(shape).members
        vertices = members if shape is Shape.SEGMENT else edges[members]
        there = [bool(is_there(mesh.vertices[rows.reshape(-1)]).all()) for rows in vertices]
        ids.append(mesh.of(shape).ids[np.array(there, bool)])
    return np.concatenate(ids)


def named(mesh, **places):
    """The mesh with a boundary for each name."""
    tag = "E" if mesh.dimension == 2 else "F"
    parts = [(name, sides_at(mesh, place)) for name, place in places.items()]
    sides = [Composite(100 + i, ((tag, ids),), name) for i, (name, ids) in enumerate(parts)]
    inner = tuple(composite for composite in mesh.composites if composite.name != "boundary")
    return replace(mesh, composites=(*inner, *sides))


@pytest.mark.sampled(least=8)
@pytest.mark.parametrize("order", range(1, 7))
@pytest.mark.parametrize("shape", BODIES)
@pytest.mark.parametrize("nodes", [2, 3, 4])
def test_the_flux_out_of_an_element_equals_its_divergence(shape, order, nodes):
    mesh = one_element(shape, shape.dimension)
    if nodes > 2:
        mesh = curved(mesh, ripple(0.15, seed=order), nodes)
        mesh = replace(mesh, vertices=mesh.vertices * [1, 1, shape.dimension == 3])
    dataset = with_random_velocity(mesh, order)
    # the theorems of Gauss and of Stokes: n x u through the border is the curl inside
    pairs = [("flux", "divergence"), ("nx*v - ny*u", "d(v,x) - d(u,y)")]
    if shape.dimension == 3:
        pairs += [("ny*w - nz*v", "d(w,y) - d(v,z)"), ("nz*u - nx*w", "d(u,z) - d(w,x)")]
    through, within = zip(*pairs, strict=True)
    size = integrate(dataset, "speed", "all", error=1e-2).value
    for out, inside in zip(integrate(dataset, through, "all"), integrate(dataset, within), strict=True):
        assert out.exact
        assert inside.exact
        assert abs(out.value - inside.value) < 1e-12 * size
        assert abs(out.value - inside.value) <= out.error + inside.error < 1e-12 * max(size, inside.measure)


def test_a_polynomial_on_all_shapes_together():
    dataset = Dataset(curved(mixed_volume(3), ripple(0.05), 4))
    inside = integrate(dataset, "3*x^2*y + x*z - 2*z")
    out = integrate(dataset, "(x^3*y)*nx + (x*y*z)*ny - (z^2)*nz", "all")
    assert inside[0].exact
    assert out[0].exact
    assert out.value == pytest.approx(inside.value, rel=1e-13)


def sector(points):
    """Part of the unit cube's image in spherical coordinates: radii 1 to 2, half a radian each way."""
    radius, polar, around = 1 + points[:, 0], 1 + 0.5 * points[:, 1], 0.5 * points[:, 2]
    return np.stack(
        [
            radius * np.sin(polar) * np.cos(around),
            radius * np.sin(polar) * np.sin(around),
            radius * np.cos(polar),
        ],
        axis=1,
    )


@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PYRAMID, Shape.PRISM, Shape.HEXAHEDRON])
def test_areas_and_volumes_of_a_part_of_a_sphere(shape):
    """Order 5 on half of it each way is as near to a sphere as 1e-7."""
    mesh = named(grid(shape, 2), inner=lambda p: p[:, 0] == 0, outer=lambda p: p[:, 0] == 1)
    dataset = Dataset(curved(mesh, sector, 6))
    angle = 0.5 * (np.cos(1) - np.cos(1.5))
    found = integrate(dataset, ["area", "x*nx + y*ny + z*nz"], ["inner", "outer"], error=1e-8)
    assert found.of("area", "inner").value == pytest.approx(angle, rel=2e-7)
    assert found.of("area", "outer").value == pytest.approx(4 * angle, rel=2e-7)
    assert found.of("area").value == pytest.approx(5 * angle, rel=2e-7)
    assert found.of("x*nx + y*ny + z*nz", "inner").value == pytest.approx(-angle, rel=2e-7)
    assert found.of("x*nx + y*ny + z*nz", "outer").value == pytest.approx(8 * angle, rel=2e-7)
    assert integrate(dataset, "volume").value == pytest.approx(7 / 3 * angle, rel=2e-7)


def tube(points):
    """Part of a cylinder's shell: radii 1 to 2, a radian, 1 high."""
    radius, around = 1 + points[:, 0], points[:, 1]
    return np.stack([radius * np.cos(around), radius * np.sin(around), points[:, 2]], axis=1)


def torus(points):
    """Part of the shell of a torus: radii 1/2 to 1 around a circle of radius 2, a radian each way."""
    radius, around, along = (1 + points[:, 0]) / 2, points[:, 1], points[:, 2]
    away = 2 + radius * np.cos(around)
    return np.stack([away * np.cos(along), away * np.sin(along), radius * np.sin(around)], axis=1)


@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize("shape", [Shape.TETRAHEDRON, Shape.PYRAMID, Shape.PRISM, Shape.HEXAHEDRON])
@pytest.mark.parametrize(
    ("shell", "inner", "outer", "volume"),
    [
        (tube, 1.0, 2.0, 1.5),
        (torus, 0.5 * (2 + 0.5 * np.sin(1)), 2 + np.sin(1), 0.75 + np.sin(1) * 7 / 24),
    ],
)
def test_areas_and_volumes_of_cylinders_and_tori(shell, inner, outer, volume, shape):
    """Order 6 on half a radian each way is as near to them as 1e-9."""
    mesh = named(grid(shape, 2), inner=lambda p: p[:, 0] == 0, outer=lambda p: p[:, 0] == 1)
    dataset = Dataset(curved(mesh, shell, 7))
    found = integrate(dataset, "area", ["inner", "outer"], error=1e-10)
    assert [row.value for row in found][:2] == pytest.approx([inner, outer], rel=2e-9)
    assert integrate(dataset, "volume").value == pytest.approx(volume, rel=2e-9)


def annulus(points):
    radius, angle = 1 + 4 * points[:, 0], 2 * np.pi * points[:, 1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * radius], axis=1)


def test_lift_is_that_of_kutta_and_joukowski():
    """Potential flow past the unit cylinder: the force per unit span is density times speed times circulation."""
    mesh = curved(named(grid(Shape.QUADRILATERAL, 8), wall=lambda p: p[:, 0] == 0), annulus, 8)
    circulation = 2.5

    def pressure(points):
        z = points[:, 0] + 1j * points[:, 1]
        return -0.5 * np.abs(1 - 1 / z**2 - 1j * circulation / (2 * np.pi * z)) ** 2

    dataset = Dataset(mesh, (approximated(Dataset(mesh), "p", pressure, 12),))
    found = integrate(dataset, ["force", "area", "moment"], "wall")
    assert found.remarks
    assert [row.integrand for row in found] == ["force_x", "force_y", "area", "moment_z"]
    assert found.of("force_x").value == pytest.approx(0, abs=1e-7)
    assert abs(found.of("force_y").value) == pytest.approx(circulation, abs=1e-7)
    assert found.of("area").value == pytest.approx(2 * np.pi, abs=1e-9)
    assert found.of("moment_z").value == pytest.approx(0, abs=1e-7)
    divided = integrate(dataset, [], "wall", coefficients="1,1,2,x,4")
    assert [row.integrand for row in divided][:2] == ["drag_coefficient (pressure)", "lift_coefficient (pressure)"]
    assert abs(divided[1].value) == pytest.approx(circulation, abs=1e-7)
    about = integrate(dataset, "moment(x_ref=2)", "wall")
    assert about.value == pytest.approx(-2 * found.of("force_y").value, abs=1e-6)
    divided = integrate(dataset, [], "wall", coefficients="1,1,2,x,4,2,0,0")
    assert divided.of("moment_coefficient_z").value == pytest.approx(about.value / 4, rel=1e-12)


def test_forces_in_a_channel_are_in_balance(nektar):
    """u = 1 - z^2 between walls at z = -1 and 1, four by area each: friction is 2 mu each, pressure is what p says."""
    dataset = read(nektar / "chan3d_tet" / "chan3D.xml", nektar / "chan3d_tet" / "chan3D.fld")
    found = integrate(dataset, ["viscous_force(mu=0.5)", "pressure_force", "force(mu=0.5)"], "all")
    walls = integrate(dataset, "-0.5*d(u,z)*nz", "all")
    assert walls.value == pytest.approx(8, rel=1e-12)
    total = {row.integrand: row.value for row in found if row.over == "total"}
    for axis in "xyz":
        parts = total[f"viscous_force_{axis}(mu=0.5)"] + total[f"pressure_force_{axis}"]
        assert total[f"force_{axis}(mu=0.5)"] == pytest.approx(parts, abs=1e-12)
    assert not found.remarks


def test_coefficients_by_pressure_and_friction(nektar):
    """The same channel: by rho u^2 area / 2 = 6 at 30 degrees to the flow, friction 8 on the walls of boundary 1."""
    dataset = read(nektar / "chan3d_tet" / "chan3D.xml", nektar / "chan3d_tet" / "chan3D.fld")
    dataset = replace(dataset, metadata={**dataset.metadata, "Kinvis": "0.5"})
    found = integrate(dataset, [], "1", coefficients="1,2,3,xz:30,0.5")
    assert found.of("drag_coefficient").value == pytest.approx(8 / 6 * np.cos(np.pi / 6), rel=1e-12)
    assert found.of("lift_coefficient").value == pytest.approx(-8 / 6 * np.sin(np.pi / 6), rel=1e-12)
    assert found.of("drag_coefficient (pressure)").value == pytest.approx(0, abs=1e-12)
    assert found.of("lift_coefficient (friction)").value == pytest.approx(-8 / 6 / 2, rel=1e-12)
    for text in ("1,2,3", "1,2,3,q", "1,2,0,x", "1,2,3,x:up", "1,2,3,xx", "1,2,3,x,1,0", "1,2,3,x,1,0,0,nan"):
        with pytest.raises(ElvisError, match="expected RHO,U,AREA,AXIS"):
            integrate(dataset, [], "1", coefficients=text)


def test_coefficients_with_missing_inputs_name_them():
    with pytest.raises(ElvisError, match=r"expression 'pressure_force_x': .* the data lack a pressure"):
        integrate(with_random_velocity(grid(Shape.TRIANGLE, 1), 1), [], "all", coefficients="1,1,1,x")


def test_squares_are_the_norms_of_the_solver(nektar):
    """Straight elements: the solver's rule is exact there, too."""
    dataset = read(nektar / "chan3d_tet" / "chan3D.xml", nektar / "chan3d_tet" / "chan3D.fld")
    for name, norm in norms(dataset).items():
        assert integrate(dataset, f"{name}^2").value == pytest.approx(norm.l2**2, rel=1e-12, abs=1e-20)


@pytest.mark.sampled
@pytest.mark.parametrize(
    ("text", "truth"),
    [
        ("sqrt(1 + x)", (2 * np.sqrt(2) - 1) * 2 / 3),
        ("exp(x + 2*y)", (np.e - 1) * (np.e**2 - 1) / 2),
        ("abs(x - 0.3)", (0.3**2 + 0.7**2) / 2),
        ("1/(1 + x*x)", np.pi / 4),
    ],
)
@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL, Shape.TETRAHEDRON])
def test_errors_of_nonpolynomial_integrands_are_stated(text, truth, shape):
    mesh = grid(shape, 1)
    for error in (1e-2, 1e-3) if "abs" in text else (1e-3, 1e-9):
        found = integrate(Dataset(mesh), text, error=error)[0]
        assert not found.exact
        assert abs(found.value - truth) <= found.error <= 1.1 * error * truth


def test_averages_and_measures():
    mesh = grid(Shape.PRISM, 1)
    found = integrate(Dataset(mesh), ["volume", "average(x^2)", "average(3)"])
    assert [row.value for row in found] == pytest.approx([1, 1 / 3, 3], rel=1e-13)
    assert integrate(Dataset(grid(Shape.SEGMENT, 4)), "length").value == pytest.approx(1, rel=1e-14)


def test_surfaces_and_curves_in_space_have_their_intrinsic_measure():
    mesh = grid(Shape.QUADRILATERAL, 3)
    tilted = replace(mesh, space=3, vertices=mesh.vertices + np.outer(mesh.vertices[:, 0], [0, 0, 2.0]))
    found = integrate(Dataset(tilted), ["area", "x"])
    assert [row.value for row in found] == pytest.approx([np.sqrt(5), np.sqrt(5) / 2], rel=1e-13)
    assert found[0].exact


def test_fourier_directions_count():
    """cos^2 of one wave in z on a unit square, 2.5 deep; its sides are 2.5 by 4."""
    planes = Homogeneous((Basis.FOURIER,), (2.5,), (0, 1, 2, 3))
    expansion = replace(modified(Shape.QUADRILATERAL, (2, 2)), homogeneous=planes)
    coefficients = np.zeros((1, mode_count(expansion)))
    coefficients[0, 8:12] = 1.0  # the second wave's cosine, in all four corners
    dataset = Dataset(grid(Shape.QUADRILATERAL, 1), (Field("u", (Block(expansion, np.arange(1), coefficients),)),))
    assert integrate(dataset, "volume").value == pytest.approx(2.5, rel=1e-12)
    assert integrate(dataset, "u^2").value == pytest.approx(norms(dataset)["u"].l2 ** 2, rel=1e-10)
    assert integrate(dataset, "area", "all").value == pytest.approx(10, rel=1e-12)
    for cut in ({"over": "z=0.3"}, {"over": "sphere:0.5,0.5,1:0.3"}, {"over": "u=0.1"}, {"clip": "x=0.5"}):
        with pytest.raises(ElvisError, match="expected no Fourier direction; elvis convert --extrude makes volume"):
            integrate(dataset, "1", **cut)


@pytest.mark.parametrize("mesh", [mixed_volume, lambda: grid(Shape.TRIANGLE, 2)])
def test_the_faces_of_an_element_have_normals_out_of_it(mesh):
    dataset = with_random_velocity(curved(mesh(), ripple(0.02), 3), 2)
    shapes = [shape for shape in dataset.mesh.elements if shape.dimension == dataset.mesh.dimension]
    for shape in shapes:
        own = int(dataset.mesh.of(shape).ids[0])
        lone = replace(dataset.mesh.composites[0], parts=((shape.tag, np.array([own])),), name="lone", id=999)
        part = replace(dataset, mesh=replace(dataset.mesh, composites=(*dataset.mesh.composites, lone)))
        rows = integrate(part, "flux", f"element:{own}")
        assert [row.over for row in rows][:-1] == [f"element:{own}/{k}" for k in range(len(rows) - 1)]
        within = integrate(part, "divergence", "region:lone").value
        assert rows.value == pytest.approx(within, abs=1e-13)


def test_boundaries_add_up_and_shared_faces_count_once():
    left, low = (lambda p: p[:, 0] == 0), (lambda p: p[:, 1] == 0)
    mesh = named(grid(Shape.HEXAHEDRON, 2), left=left, low=low, both=lambda p: left(p) | low(p))
    dataset = Dataset(mesh)
    rows = integrate(dataset, "area", "all")
    assert {row.over: round(row.value, 12) for row in rows} == {
        "left": 1,
        "low": 1,
        "both": 2,
        "(others)": 4,
        "total": 6,
    }
    assert integrate(dataset, "area", ["left", "both"]).value == pytest.approx(2, rel=1e-13)
    assert len(integrate(dataset, "area", ["left", "left"])) == 1


def test_regions_are_parts_of_the_domain():
    mesh = grid(Shape.HEXAHEDRON, 2)
    mesh = replace(mesh, composites=(*mesh.composites, Composite(7, (("H", np.arange(3)),), "core")))
    assert integrate(Dataset(mesh), "volume", "region:core").value == pytest.approx(3 / 8, rel=1e-13)
    assert integrate(Dataset(mesh), "volume", "region:7").value == pytest.approx(3 / 8, rel=1e-13)


def test_elements_without_the_field_do_not_count():
    whole = with_random_velocity(grid(Shape.QUADRILATERAL, 2), 2)
    half = Field("half", tuple(Block(b.expansion, b.element_ids[:2], b.coefficients[:2]) for b in whole["u"].blocks))
    found = integrate(replace(whole, fields=(*whole.fields, half)), ["half", "1"])
    assert [row.measure for row in found] == pytest.approx([0.5, 1.0])


@pytest.mark.parametrize(
    ("field", "over", "sentence"),
    [
        ("p", "domain", "there is no 'p'"),
        (
            "u",
            "wal",
            "there is no boundary 'wal' (perhaps wall); there are domain, all, wall, 100, region:triangle, region:0",
        ),
        ("u", "region:a", "there is no region 'a'"),
        ("u", "element:77", "there is no element 77 in the data"),
        ("u", "element:x", "expected element: and the id of an element of 2D or 3D data, found 'element:x'"),
        ("nx", "domain", "nx: nx is only known on boundaries and cuts, not on domain"),
        ("volume", "wall", "wall has a length, no volume"),
        ("length", "domain", "domain has an area, no length"),
        ("u +", "domain", "expected"),
    ],
)
def test_invalid_integrals_are_rejected(field, over, sentence):
    dataset = with_random_velocity(named(grid(Shape.TRIANGLE, 1), wall=lambda p: p[:, 0] == 0), 1)
    with pytest.raises(ElvisError) as error:
        integrate(dataset, field, over)
    assert sentence in str(error.value)
    assert "\n" not in str(error.value)


def test_a_pole_gives_nan_and_its_position():
    found = integrate(Dataset(grid(Shape.SEGMENT, 2)), ["1/(x - x)", "x"])
    assert np.isnan(found[0].value)
    assert found[1].value == pytest.approx(0.5)
    assert found.remarks[0].startswith("1/(x - x) has no value in domain at ")


def test_the_most_important_boxes_are_refined_first(monkeypatch):
    """The root of (x - 0.31)^2 + 0.01^2 on a square, by its antiderivative; all boxes together want more points."""

    def primitive(x):
        return (x * np.hypot(x, 0.01) + 1e-4 * np.arcsinh(x / 0.01)) / 2

    dataset, truth = Dataset(grid(Shape.QUADRILATERAL, 4), ()), primitive(0.69) - primitive(-0.31)
    errors = []
    for most in (0, 1000, 10000, 100000):
        monkeypatch.setattr("elvis.core.integrals.refinement._MOST", most)
        found = integrate(dataset, "sqrt((x - 0.31)^2 + 0.0001)", error=1e-13)[0]
        assert abs(found.value - truth) <= found.error
        errors.append(found.error)
    assert errors[1] < 0.3 * errors[0]
    assert errors[2] < 0.3 * errors[1]
    assert errors[3] < 1e-8


@pytest.mark.parametrize("bend", [0.0, 0.1])
@pytest.mark.parametrize("text", ["distance(boundary)", "x*distance(all)"])
def test_a_distance_that_is_zero_is_one_to_rounding(monkeypatch, bend, text):
    # in parts of nothing no error is small, but rounding is one of coordinates, here of about a hundred
    monkeypatch.setattr("elvis.core.integrals.refinement._MOST", 1 << 15)
    mesh = curved(grid(Shape.TETRAHEDRON, 1), lambda points: 100 + ripple(bend)(points), 3)
    taken = []
    (row,) = integrate(Dataset(mesh), text, "all", progress=lambda done, _: taken.append(done))
    assert taken[-1] < 20000
    assert abs(row.value) <= row.error < 1e-8


def test_an_empty_domain_is_an_error():
    mesh = grid(Shape.QUADRILATERAL, 2)
    edges = Composite(1, (("E", np.array([0])),))
    data = Dataset(replace(mesh, composites=(edges,), domains={0: (1,)}))
    with pytest.raises(ElvisError, match="expected elements of the domain, found none"):
        integrate(data, "x")
