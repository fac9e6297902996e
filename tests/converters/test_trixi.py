"""Files of Trixi.jl, which are written here after its documentation, against closed forms."""

import h5py
import numpy as np
import pytest
from trixi_writer import (
    Brick,
    lobatto_line,
    reference_nodes,
    write_plane_mesh,
    write_solution,
    write_structured_mesh,
    write_tree_mesh,
)

from elvis import FormatError
from elvis.converters.trixi.julia import definitions, evaluated
from elvis.converters.trixi.trixi import Trixi
from elvis.core.data.mesh import NON_CONFORMING, PERIODIC
from elvis.core.integrals import integrate
from elvis.core.summary.summary import summary
from elvis.plugins.conversion.converting import convert
from elvis.plugins.testing import check

FUNCTIONS = {"u": lambda x: x[..., 0] * x[..., -1] + 1, "v": lambda x: 2 * x[..., 0] - x[..., -1]}
NEAR = 1e-12


def near_corner(depth):
    """Refine cells at the lower corner of all, down to a level."""
    return lambda level, corner: level < 1 or (level < depth and not corner.any())


def box_integral(function, low, high):
    """The integral of a polynomial over a box, by Gauss points."""
    points, weights = np.polynomial.legendre.leggauss(8)
    low, high = np.array(low, float), np.array(high, float)
    places = low + (reference_nodes(points, len(low)) + 1) / 2 * (high - low)
    weights = np.prod(reference_nodes(weights, len(low)), axis=1)
    return float(weights @ function(places)) * float(np.prod((high - low) / 2))


def is_exact(report):
    return all(measure.is_exact for measure in (report.geometry, *report.fields))


def boundary(dataset, name, quantity="1"):
    return integrate(dataset, quantity, over=name, error=1e-12)[-1].value


@pytest.mark.parametrize("dimension", [1, 2, 3])
def test_trees_with_hanging_nodes(tmp_path, dimension):
    """Squares of three sizes; a periodic direction has no boundary."""
    periodic = [axis == 1 for axis in range(dimension)]
    centre, length, order = [0.5, -1.0, 2.0][:dimension], 3.0, 3
    corners = write_tree_mesh(tmp_path / "mesh.h5", near_corner(3), dimension, centre, length, periodic)
    inside = (reference_nodes(lobatto_line(order), dimension) + 1) / 2
    places = corners[:, None, 0] + inside * (corners[:, 1] - corners[:, 0])[:, None]
    path = write_solution(
        tmp_path / "solution_000000005.h5", tmp_path / "mesh.h5", "TreeMesh", places, FUNCTIONS, order,
        {"indicator": np.arange(len(corners))}, {"w": places[..., 0].reshape(len(corners), *(order + 1,) * dimension)},
    )  # fmt: skip
    conversion = check(Trixi, [path])
    dataset = conversion.dataset
    assert dataset.time == Trixi.times([path])[0] == 0.25
    assert is_exact(conversion.report)
    low, high = np.array(centre) - length / 2, np.array(centre) + length / 2
    for name, function in {**FUNCTIONS, "w": lambda x: x[..., 0]}.items():
        assert integrate(dataset, name)[0].value == pytest.approx(box_integral(function, low, high), rel=NEAR)
    sizes = np.prod(corners[:, 1] - corners[:, 0], axis=1)
    assert integrate(dataset, "indicator")[0].value == pytest.approx(sizes @ np.arange(len(corners)), rel=NEAR)
    if dimension > 1:
        assert boundary(dataset, "x_pos") == pytest.approx(length ** (dimension - 1), rel=NEAR)
        assert boundary(dataset, PERIODIC) == pytest.approx(2 * length ** (dimension - 1), rel=NEAR)
        assert NON_CONFORMING in {composite.name for composite in dataset.mesh.composites}
        assert boundary(dataset, "all") == pytest.approx(2 * (dimension - 1) * length ** (dimension - 1), rel=NEAR)


SHEARED = """function mapping(xi_, eta_)
    # a parabola on a box; the determinant is constant
    xi, eta = 1.5 * xi_, 2eta_
    return SVector(xi + 0.25f0 * eta^2, eta)
end
"""
FACES = """f1(s) = SVector(s^2 / 4 - 1, s);f2(s) = SVector(s^2 / 4 + 1, s)
f3(s) = SVector(s + 0.25, -1.0);f4(s) = SVector(s + 1//4, 1.0)
faces = (f1, f2, f3, f4);mapping = transfinite_mapping(faces)"""
BOX = "coordinates_min = (-1.5, -2.0);coordinates_max = (1.5, 2.0);"
BOX += "mapping = coordinates2mapping(coordinates_min, coordinates_max)"


def sheared(x, y):
    return lambda s: np.stack([x * s[..., 0] + 0.25 * (y * s[..., 1]) ** 2, y * s[..., 1]], axis=-1)


@pytest.mark.parametrize(
    ("mapping", "bend", "half"),
    [
        (SHEARED, sheared(1.5, 2.0), (1.5, 2.0)),
        (FACES, sheared(1.0, 1.0), (1.0, 1.0)),
        (BOX, lambda s: s * [1.5, 2.0], (1.5, 2.0)),
    ],
)
def test_structured_meshes(tmp_path, mapping, bend, half):
    size, order = (3, 2), 4
    write_structured_mesh(tmp_path / "mesh.h5", size, mapping, (False, False))
    brick = Brick(size, lambda s: bend(2 * s / size - 1), order, lambda _: lambda *_: False)
    path = write_solution(
        tmp_path / "s.h5", tmp_path / "mesh.h5", "StructuredMesh", brick.nodes(order), FUNCTIONS, order
    )
    conversion = check(Trixi, [path])
    assert is_exact(conversion.report)
    low, high = [-1.0, -1.0], [1.0, 1.0]
    jacobian = half[0] * half[1]
    for name, function in FUNCTIONS.items():
        wanted = jacobian * box_integral(lambda s, f=function: f(bend(s)), low, high)
        assert integrate(conversion.dataset, name)[0].value == pytest.approx(wanted, rel=NEAR)
    assert boundary(conversion.dataset, "y_neg") == pytest.approx(2 * half[0], rel=NEAR)
    alone = check(Trixi, [tmp_path / "mesh.h5"]).dataset
    assert integrate(alone, "1")[0].value == pytest.approx(4 * jacobian, rel=NEAR)


def test_mappings_of_three_dimensions(tmp_path):
    """A transfinite mapping in space: the Boolean sum of faces of a map is that map if its parts are linear in one."""
    faces = "f1(s, t) = g(-1, s, t);f2(s, t) = g(1, s, t);f3(s, t) = g(s, -1, t);f4(s, t) = g(s, 1, t);"
    faces += "f5(s, t) = g(s, t, -1);f6(s, t) = g(s, t, 1)"
    code = f"g(x, y, z) = SVector(x + 0.1 * y * z, y + 0.2z^2, z);{faces};"
    code += "faces = (f1, f2, f3, f4, f5, f6);mapping = transfinite_mapping(faces)"
    write_structured_mesh(tmp_path / "mesh.h5", (2, 1, 2), code, (True, False, False))
    source = Trixi([tmp_path / "mesh.h5"])
    (block,) = source.blocks
    points = np.array([[-1.0, -1, -1], [0.5, 0.25, -0.75], [1, 1, 1]])
    for element, corner in enumerate([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1]]):
        x, y, z = (2 * np.array(corner) + 1 + points).T / [[2], [1], [2]] - 1
        wanted = np.stack([x + 0.1 * y * z, y + 0.2 * z**2, z], axis=1)
        assert np.allclose(source.positions(block, points)[element], wanted, rtol=0, atol=1e-15)
    assert {own.name for own in source.boundaries} == {PERIODIC, "y_neg", "y_pos", "z_neg", "z_pos"}


def test_a_ring_of_cells_is_closed_without_a_boundary(tmp_path):
    code = "mapping(xi, eta) = SVector((1.5 + 0.5eta) * cospi(xi), (1.5 + 0.5eta) * sinpi(xi))"
    write_structured_mesh(tmp_path / "mesh.h5", (8, 2), code, (True, False))
    conversion = convert(Trixi([tmp_path / "mesh.h5"]))
    names = {composite.name for composite in conversion.dataset.mesh.composites}
    assert names == {"quadrilateral", "y_neg", "y_pos"}
    # the map is no polynomial: its error is measured and stated
    area = integrate(conversion.dataset, "1")[0].value
    assert abs(area - np.pi * 3) < 1e-5
    assert not is_exact(conversion.report)


def bent(space):
    """A map of degree 2 with the determinant 1."""
    return lambda s: np.concatenate([s[..., :1] + 0.1 * s[..., 1:2] ** 2, s[..., 1:]], axis=-1)[..., :space]


@pytest.mark.parametrize("kind", ["P4estMesh", "T8codeMesh"])
@pytest.mark.parametrize("size", [(3, 1), (2, 1, 3)])
def test_nodes_of_forests(tmp_path, kind, size):
    """Three sizes of leaves in some trees, one in others; values at nodes are those of functions of their places."""
    dimension, order = len(size), 3
    brick = Brick(size, bent(dimension), 2, lambda tree: near_corner(3) if tree % 2 else lambda *_: False)
    mesh = brick.write(tmp_path / "mesh.h5", kind)
    source = Trixi([write_solution(tmp_path / "s.h5", mesh, kind, brick.nodes(order), FUNCTIONS, order)])
    (block,) = source.blocks
    found = source.positions(block, reference_nodes(lobatto_line(5), dimension))
    assert np.allclose(found, brick.nodes(5), rtol=0, atol=1e-14)
    values = source.sample(block, source.fields[0], reference_nodes(lobatto_line(order), dimension))
    assert np.allclose(values, FUNCTIONS["u"](brick.nodes(order)), rtol=0, atol=1e-13)


@pytest.mark.parametrize(("kind", "size"), [("P4estMesh", (2, 1, 2)), ("T8codeMesh", (3, 2))])
def test_forests(tmp_path, kind, size):
    """Two levels of refinement in some trees, none in others; one direction is periodic."""
    dimension, order = len(size), 3
    periodic = [axis == dimension - 1 for axis in range(dimension)]
    brick = Brick(size, bent(dimension), 2, lambda tree: near_corner(2) if tree % 2 else lambda *_: False, periodic)
    mesh = brick.write(tmp_path / "mesh.h5", kind)
    path = write_solution(tmp_path / "solution_5.h5", mesh, kind, brick.nodes(order), FUNCTIONS, order)
    conversion = check(Trixi, [path])
    dataset = conversion.dataset
    assert is_exact(conversion.report)
    assert sum(conversion.report.elements.values()) == len(brick.nodes(1))
    for name, function in FUNCTIONS.items():
        wanted = box_integral(lambda s, f=function: f(brick.bend(s)), [0] * dimension, size)
        assert integrate(dataset, name)[0].value == pytest.approx(wanted, rel=NEAR)
    across = np.prod(size) / size[0] if dimension == 3 else None
    if across:
        length = integral_of_arc(size[1])
        assert boundary(dataset, "x_pos") == pytest.approx(length * size[2], rel=NEAR)
        assert boundary(dataset, PERIODIC) == pytest.approx(2 * size[0] * size[1], rel=NEAR)
    else:
        assert boundary(dataset, "x_neg") == pytest.approx(integral_of_arc(size[1]), rel=NEAR)
        assert boundary(dataset, PERIODIC) == pytest.approx(2 * size[0], rel=NEAR)
    names = {composite.name for composite in dataset.mesh.composites}
    assert NON_CONFORMING in names
    assert "boundary" not in names


def integral_of_arc(length):
    """The length of x = 0.1 y^2 from 0 to ``length``: (a/2) sqrt(1 + a^2) + asinh(a)/2 over the factor of y in a."""
    slope = 0.2 * length
    return (slope / 2 * np.sqrt(1 + slope**2) + np.arcsinh(slope) / 2) / 0.2


def test_meshes_of_curved_quadrilaterals(tmp_path):
    """Two squares with a parabola on top, and a straight one; one edge alone is curved."""
    order = 3
    line = -np.cos(np.pi * np.arange(order + 1) / order)
    top = np.stack([(line + 1) / 2, 1 + (1 - line**2) / 4], axis=1)
    corners = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]
    elements = [
        ((0, 1, 4, 3), {2: top}, ("floor", "---", "roof", "west")),
        ((1, 2, 5, 4), {}, ("floor", "east", "roof", "---")),
    ]
    write_plane_mesh(tmp_path / "two.mesh", order, corners, elements)
    with h5py.File(tmp_path / "mesh.h5", "w") as file:
        for name, value in {"mesh_type": "UnstructuredMesh2D", "ndims": 2, "size": 2, "periodicity": False}.items():
            file.attrs[name] = value
        file.attrs["mesh_filename"] = "/some/where/two.mesh"
    nodes = reference_nodes(lobatto_line(4), 2)
    height = 1 + (1 - nodes[:, 0] ** 2) / 4
    curved = np.stack([(nodes[:, 0] + 1) / 2, (nodes[:, 1] + 1) / 2 * height], axis=1)
    places = np.stack([curved, (nodes + 1) / 2 + [1, 0]])
    path = write_solution(tmp_path / "s.h5", tmp_path / "mesh.h5", "UnstructuredMesh2D", places, FUNCTIONS, 4)
    conversion = check(Trixi, [path])
    assert is_exact(conversion.report)
    # 1 + the area below the parabola: 1 + 1/4 (1 - 1/3)
    assert integrate(conversion.dataset, "1")[0].value == pytest.approx(2 + 1 / 6, rel=NEAR)
    # x over both: 1/2 (1 + 1/6) + 3/2
    wanted = 2 * (0.5 * (1 + 1 / 6) + 1.5) - (0.5 * (1 + 2 * 1 / 6 + (1 / 16) * (8 / 15)) + 0.5)
    assert integrate(conversion.dataset, "v")[0].value == pytest.approx(wanted, rel=NEAR)
    assert boundary(conversion.dataset, "floor") == pytest.approx(2, rel=NEAR)
    assert boundary(conversion.dataset, "east") == pytest.approx(1, rel=NEAR)


def test_gauss_nodes_are_an_option(tmp_path):
    write_structured_mesh(tmp_path / "mesh.h5", (2,), "mapping(x) = 2x + 1", (False,))
    line = np.polynomial.legendre.leggauss(4)[0]
    places = np.stack([(line - 1), (line + 1)])[..., None] + 1
    path = write_solution(
        tmp_path / "s.h5", tmp_path / "mesh.h5", "StructuredMesh", places, {"u": lambda x: x[..., 0] ** 3}, 3
    )
    dataset = convert(Trixi([path], nodes="gauss")).dataset
    assert integrate(dataset, "u")[0].value == pytest.approx((3**4 - 1) / 4, rel=NEAR)


POINTS = np.linspace(-1, 1, 7)
FORMULAS = [
    ("-x^2", lambda x: -(x**2)),
    ("2x^2 - 3 - 1", lambda x: 2 * x**2 - 4),
    ("1 / 2(x + 3)", lambda x: 1 / (2 * (x + 3))),
    ("2^2x", lambda x: 2.0 ** (2 * x)),
    ("2^-1 * x", lambda x: x / 2),
    ("x > 0 ? 1.0f0 : -x", lambda x: np.where(x > 0, 1, -x)),
    ("(y -> y^2)(x) + (x, 1.0)[1]", lambda x: x**2 + x),
    ("abs.(x) .+ 1//2", lambda x: abs(x) + 0.5),
    ("max(x, 0, 0.5x) + atan(x, 2)", lambda x: np.maximum(x, 0) * (x > 0) + np.arctan2(x, 2)),
]


@pytest.mark.parametrize(("formula", "wanted"), FORMULAS)
def test_formulas_bind_as_in_julia(formula, wanted):
    (found,) = evaluated(definitions(f"mapping(x) = {formula} # a remark", {})["mapping"], [POINTS])
    assert np.allclose(found, wanted(POINTS), rtol=1e-15, atol=1e-15)


DOUBLED = "f0(x) = x\n" + "\n".join(f"f{i}(x) = f{i - 1}(x) + f{i - 1}(x)" for i in range(1, 40))
UNREADABLE = [
    ("mapping(x) = R0 * x", "found 'R0', which the file doesn't define"),
    ("function mapping(x)\n for i in 1:3\n end\n end", "expected a formula, found 'for'"),
    ("mapping(x) = mapping(x)", "functions that don't call themselves"),
    (f"{DOUBLED}\nmapping(x) = f39(x)", "at most 20000 steps"),
    (f"mapping(x) = {'(' * 100}x{')' * 100}", "at most 60 formulas inside each other"),
    ("mapping(x) = 'a'", "expected a formula, found"),
    ("mapping(x) = sin(x, x, x)", "functions with their arguments"),
    ("mapping(x) = 1 / (x - x)", "expected finite coordinates"),
    ("", "give mapping_as_string"),
]


@pytest.mark.parametrize(("code", "message"), UNREADABLE)
def test_an_invalid_formula_gives_a_one_line_error(tmp_path, code, message):
    write_structured_mesh(tmp_path / "mesh.h5", (2,), code, (False,))
    with pytest.raises(FormatError, match=message.replace("(", r"\(")):
        Trixi([tmp_path / "mesh.h5"])


def test_missing_definitions_can_be_given(tmp_path):
    write_structured_mesh(tmp_path / "mesh.h5", (2,), "mapping(x) = R0 * x", (False,))
    dataset = convert(Trixi([tmp_path / "mesh.h5"], mapping="R0 = 3.0")).dataset
    assert integrate(dataset, "1")[0].value == pytest.approx(6, rel=NEAR)


def other_count(folder):
    with h5py.File(folder / "s.h5", "r+") as file:
        file.attrs["n_elements"] = 3


def many_variables(folder):
    with h5py.File(folder / "s.h5", "r+") as file:
        file.attrs["n_vars"] = 10**15


def no_forest(folder):
    (folder / "p4est_data").unlink()


def torn_forest(folder):
    data = (folder / "p4est_data").read_bytes()
    (folder / "p4est_data").write_bytes(data[:-8])


def other_levels(folder):
    data = bytearray((folder / "p4est_data").read_bytes())
    data[-4] = 1
    (folder / "p4est_data").write_bytes(bytes(data))


def other_kind(folder):
    with h5py.File(folder / "mesh.h5", "r+") as file:
        file.attrs["mesh_type"] = "DGMultiMesh"


DAMAGES = [
    (other_count, "expected a solution on the 2 elements of the mesh"),
    (many_variables, "expected a dataset variables_3, found none"),
    (no_forest, "expected p4est_data next to it"),
    (torn_forest, "expected 24 bytes more, found 16"),
    (other_levels, "leaves that fill their trees"),
    (other_kind, "expected a TreeMesh, .* found a DGMultiMesh"),
]


@pytest.mark.parametrize(("damage", "message"), DAMAGES)
def test_damaged_files_give_a_one_line_error(tmp_path, damage, message):
    brick = Brick((2, 1), bent(2), 2, lambda _: lambda *_: False)
    mesh = brick.write(tmp_path / "mesh.h5", "P4estMesh")
    path = write_solution(tmp_path / "s.h5", mesh, "P4estMesh", brick.nodes(2), FUNCTIONS, 2)
    damage(tmp_path)
    with pytest.raises(FormatError, match=message):
        Trixi([path])


def test_summary_counts_joined_sides(tmp_path):
    write_tree_mesh(tmp_path / "mesh.h5", near_corner(2), 2, (0, 0), 2, (True, False))
    found = summary(convert(Trixi([tmp_path / "mesh.h5"])).dataset)["mesh"]
    assert (found["periodic_sides"], found["non_conforming_sides"]) == (5, 6)
