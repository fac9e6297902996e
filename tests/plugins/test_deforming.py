"""Deformed geometry equals a file whose nodes were moved, and closed forms: points, gradients, integrals, messages."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import vtk_writer

from elvis import Dataset, ElvisError, Shape, deform, integrate, read, render, sample
from elvis.converters.vtk.cells import LAGRANGE, Cell, Kind
from elvis.core.data.dataset import Block, Expansion, Field
from elvis.core.deformed.deforming import _free, undeformed
from elvis.core.mapping.geometry import geometry
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import mode_count
from elvis.core.quantities import Expression
from elvis.core.quantities.elements.points import Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.testing import approximated, curved, grid, ripple, scattered

SCALE = 0.7
#: further kinds and orders of elements in pictures
MORE = [pytest.param(kind, order, marks=pytest.mark.thorough) for kind, order in ((71, 2), (73, 2), (72, 5))]
ORTHO_PYRAMID = (Basis.ORTHO_A, Basis.ORTHO_A, Basis.ORTHO_PYR_C)


def displacement(x):
    """A smooth field (n, 3) of moderate gradients."""
    return 0.1 * np.stack([np.sin(2 * x[:, 0] + x[:, 1]), x[:, 0] * x[:, 1] - x[:, 2], np.cos(x[:, 2] + x[:, 0])], 1)


def moved_files(folder, kind, order):
    """A file with the displacement of its nodes, and one whose nodes were moved."""
    nodes = vtk_writer.NODES[LAGRANGE[kind]](order)
    cell = Cell(Kind(kind, nodes), "")
    rng, dimension = np.random.default_rng(order), cell.shape.dimension
    x = cell.nodes + 0.05 * np.sin(3 * cell.nodes[:, [1, 2, 0]])
    d = displacement(x)
    x[:, dimension:], d[:, dimension:] = 0, 0
    values = {"p": rng.uniform(-1, 1, nodes), **{f"d_{axis}": d[:, k] for k, axis in enumerate("xyz"[:dimension])}}
    cells = [(kind, range(nodes))]
    before = vtk_writer.write(folder / "before.vtu", vtk_writer.grid(x, cells, values))
    return before, vtk_writer.write(folder / "after.vtu", vtk_writer.grid(x + SCALE * d, cells, values))


@pytest.mark.parametrize(
    ("kind", "order"), [(68, 4), (69, 3), (69, 8), (70, 1), (70, 6), (71, 2), (71, 5), (72, 2), (72, 3), (73, 2)]
)
def test_deformed_geometry_matches_a_file_with_moved_nodes(tmp_path, kind, order):
    before, after = (read(path, cache=False) for path in moved_files(tmp_path, kind, order))
    shape = LAGRANGE[kind]
    bent = deform(before, "d" if shape.dimension > 1 else "d_x", SCALE, gradients="deformed")
    (block,) = geometry(after)
    middle = shape.vertices.mean(axis=0)
    inner = middle + 0.9 * (scattered(shape, 30) - middle)
    points = evaluate(block.expansion, block.coefficients, inner)[0].T
    texts = ["p", "d(p,x)", "d(p,y)" if shape.dimension > 1 else "p", "x"]
    ours, theirs = (sample(data, texts, points).values for data in (bent, after))
    size = np.abs(theirs).max(axis=0)
    assert np.isfinite(ours).all()
    # derivatives of order 8 are rounded more than values
    allowed = np.array([1e-12, 1e-11, 1e-11 if shape.dimension > 1 else 1e-12, 1e-12])
    assert (np.abs(ours - theirs) <= allowed * np.maximum(1, size)).all()
    for texts, over in ((["1", "p"], "domain"), (["nx", "p*nx"], "all"))[: shape.dimension]:
        own, expected = (integrate(data, texts, over) for data in (bent, after))
        for a, b in zip(own, expected, strict=True):
            assert a.value == pytest.approx(b.value, rel=1e-12, abs=1e-13)


@pytest.mark.parametrize(("kind", "order"), [(72, 3), *MORE])
def test_pictures_match_those_of_a_file_with_moved_nodes(tmp_path, kind, order):
    before, after = (read(path, cache=False) for path in moved_files(tmp_path, kind, order))
    middle = 0.5 * (after.bounds[0] + after.bounds[1])
    cuts = {"plane": (middle, (0.2, 0.3, 1.0)), "isosurface": 0.1, "opacity": 0.7}
    for drawn in (cuts, {"faces": "all", "mesh_lines": True, "contours": 5}):
        options = {"size": 40, "camera": "iso", **drawn}
        ours, theirs = render(before, "p", deform="d", scale=SCALE, **options), render(after, "p", **options)
        certain = (ours.status == 1) & (theirs.status == 1)
        assert certain.sum() > 0.9 * (theirs.status > 0).sum() > 200
        assert np.array_equal(ours.element[certain], theirs.element[certain])
        assert np.abs(ours.field - theirs.field)[certain].max() < 1e-12 * max(1.0, np.nanmax(np.abs(theirs.field)))
        assert np.abs(ours.position - theirs.position)[certain].max() < 1e-12
        assert np.abs(ours.color - theirs.color).max(axis=2)[certain].max() < 1e-6


def polynomial_flow(shape, order, n=2):
    """A displacement of polynomials of degree ``order`` and a field of degree 2 on elements of one shape."""
    mesh = grid(shape, 1) if n == 2 else curved(grid(shape, 1), ripple(0.03), n)
    data, space = Dataset(mesh), shape.dimension
    functions = {
        "u": lambda x: 0.1 * (x.sum(axis=1) ** order + x[:, 0]),
        "v": lambda x: 0.05 * (x[:, 1] ** order - x[:, 0]),
        "w": lambda x: 0.08 * (x[:, 2] + x[:, 0]) ** order,
    }
    fields = [approximated(data, name, functions[name], order + 1) for name in "uvw"[:space]]
    return replace(data, fields=(*fields, approximated(data, "p", lambda x: x[:, 0] ** 2 + x.sum(axis=1), 3)))


@pytest.mark.parametrize(
    ("shape", "order"),
    [*((shape, 2) for shape in Shape), (Shape.SEGMENT, 8), (Shape.QUADRILATERAL, 7), (Shape.TETRAHEDRON, 4)],
)
def test_points_move_by_the_displacement_and_keep_their_values_and_gradients(shape, order):
    data, space = polynomial_flow(shape, order), shape.dimension
    scale = 0.5
    bent = deform(data, ",".join("uvw"[:space]), scale)
    points = np.zeros((20, 3))
    points[:, :space] = np.random.default_rng(order).uniform(0.05, 0.95, (20, space))
    moves = sample(data, list("uvw"[:space]), points).values
    places = points.copy()
    places[:, :space] += scale * moves
    found = sample(bent, ["p", "d(p,x)", "undeformed_x", "laplacian(p)"], places).values
    expected = [points[:, 0] ** 2 + points.sum(axis=1), 2 * points[:, 0] + 1, points[:, 0], np.full(20, 2.0)]
    assert np.abs(found[:, :3] - np.stack(expected[:3], axis=1)).max() < 1e-12 * 10 ** (order > 5)
    assert np.abs(found[:, 3] - 2).max() < 1e-9


@pytest.mark.parametrize("n", [2, 4])
def test_pyramids_get_a_space_that_contains_map_and_displacement(n):
    data = polynomial_flow(Shape.PYRAMID, 2, n)
    rng, fields = np.random.default_rng(n), []
    for name in "uvw":
        blocks = []
        for own in geometry(data):
            expansion = Expansion(Shape.PYRAMID, ORTHO_PYRAMID, (3,) * 3)
            values = 0.02 * rng.normal(size=(len(own), mode_count(expansion)))
            blocks.append(Block(expansion, own.element_ids, values))
        fields.append(Field(name, tuple(blocks)))
    data, points = replace(data, fields=tuple(fields)), scattered(Shape.PYRAMID, 20)
    (before,), (after,) = geometry(data), geometry(deform(data, "u,v,w", SCALE))
    expected = evaluate(before.expansion, before.coefficients, points)
    for axis, own in enumerate(fields):
        expected[:, axis] += SCALE * evaluate(own.blocks[0].expansion, own.blocks[0].coefficients, points)
    assert np.abs(evaluate(after.expansion, after.coefficients, points) - expected).max() < 1e-13


def test_deformation_by_expressions_matches_their_projection():
    data = polynomial_flow(Shape.QUADRILATERAL, 2)
    found = deform(data, "0.5*u*v+0.1*x, 2*v", 0.3)
    points = np.array([[0.3, 0.4, 0.0], [0.9, 0.1, 0.0]])
    u, v = sample(data, ["u", "v"], points).values.T
    places = points + 0.3 * np.stack([0.5 * u * v + 0.1 * points[:, 0], 2 * v, 0 * u], axis=1)
    assert np.abs(sample(found, ["u", "v"], places).values - np.stack([u, v], axis=1)).max() < 1e-13
    assert list(found) == ["u", "v", "p"]


def test_a_second_deformation_takes_the_place_of_the_first():
    data = polynomial_flow(Shape.TRIANGLE, 2)
    once, twice = deform(data, "u,v", 0.2), deform(deform(data, "v,u", 0.9), "u,v", 0.2)
    same = [
        np.array_equal(a.coefficients, b.coefficients) for a, b in zip(geometry(once), geometry(twice), strict=True)
    ]
    assert all(same)
    assert twice.remarks == once.remarks
    assert undeformed(once).remarks == data.remarks


@pytest.mark.parametrize("shape", list(Shape))
def test_a_repeated_deformation_is_identical_bit_by_bit(shape):
    data, texts = polynomial_flow(shape, 3, 4), ",".join("uvw"[: shape.dimension])
    once, again = deform(data, texts, SCALE), deform(deform(data, texts, 0.3), texts, SCALE)
    for own, other in zip(geometry(once), geometry(again), strict=True):
        assert own.expansion == other.expansion
        assert np.array_equal(own.coefficients, other.coefficients)


def test_the_record_names_the_deformation_and_folded_elements():
    data = polynomial_flow(Shape.QUADRILATERAL, 1)
    assert any("gradients are taken in the deformed" in own for own in deform(data, "u,v", 1, "deformed").remarks)
    assert any("inverted or folded" in own for own in deform(data, "-x,y", 2).remarks)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("u", "expected a displacement of 2 components, for x, y, found 1: u"),
        ("u,v,p", "found 3: u, v, p"),
        ("u,sin(v)", "polynomials of fields on every element, found sin(v)"),
        ("u,q", "there is no 'q'"),
        ("u,,v", "expected a component between commas, such as u,v,w or u,0,w, found u,,v"),
        ("d", "the vector d lacks the component d_y"),
        (" ", "expected the components of a displacement"),
    ],
)
def test_bad_displacements_give_one_line_errors(text, words):
    data = polynomial_flow(Shape.QUADRILATERAL, 2)
    data = replace(data, fields=(*data.fields, replace(data.field("u"), name="d_x")))
    with pytest.raises(ElvisError, match=words.replace("(", r"\(").replace(")", r"\)")):
        deform(data, text)


def test_elements_without_displacement_are_unmoved():
    data = Dataset(grid(Shape.QUADRILATERAL, 2))
    moves = [approximated(data, name, lambda x: 5 + 0 * x[:, 0], 2) for name in "uv"]
    few = tuple(replace(own, blocks=(own.blocks[0].of(np.array([1])),)) for own in moves)
    found = deform(replace(data, fields=few), "u,v")
    corners = sorted(
        float(values.min())
        for block in geometry(found)
        for values in evaluate(block.expansion, block.coefficients[:, 0], Shape.QUADRILATERAL.vertices)
    )
    assert corners == pytest.approx([0.0, 0.0, 0.5, 5.5], abs=1e-14)


def test_a_height_over_the_plane_has_the_right_gradients_and_area():
    data = polynomial_flow(Shape.TRIANGLE, 2, 3)
    plane = approximated(data, "plane", lambda x: 0.3 * x[:, 0] - 0.4 * x[:, 1], 3)
    flat = replace(data, fields=(*data.fields, plane))
    # the area of z = S (0.3 x - 0.4 y) is that of the plane times the root of 1 + S^2 / 4
    (area,), (before,) = integrate(deform(flat, height="plane", scale=2), ["1"]), integrate(flat, ["1"])
    assert area.value == pytest.approx(before.value * np.sqrt(2), rel=1e-12)
    texts, inner = ["d(p,x)", "d(p,y)", "grad(u*p)", "vorticity", "p"], scattered(Shape.TRIANGLE, 10)
    found = []
    for own in (flat, deform(flat, height="u*v+0.5*p", scale=1.5)):
        expressions = [Expression.of(own, text) for text in texts]
        evaluator = Evaluator(own, expressions)
        (patch,) = evaluator.patches
        found.append(np.array(list(evaluator.values_at(expressions, Lattice(patch, np.arange(len(patch)), inner)))))
    assert np.abs(found[1] - found[0]).max() < 1e-12
    assert undeformed(deform(flat, height="u")).mesh.space == 2
    assert deform(deform(flat, height="u"), "u,v").bounds.shape == (2, 2)


def test_heights_of_solids_and_two_deformations_are_rejected():
    with pytest.raises(ElvisError, match="expected 2D data in a plane, found 3D elements"):
        deform(polynomial_flow(Shape.TETRAHEDRON, 2), height="u")
    with pytest.raises(ElvisError, match="expected one of --deform and --height, found both"):
        deform(polynomial_flow(Shape.TRIANGLE, 2), "u,v", height="u")


def test_names_of_fields_are_taken_but_those_of_maps_are_not():
    data = SimpleNamespace(fields=[SimpleNamespace(name=name) for name in ("u", "x_map")], map_names=("x_map",))
    assert _free(data, ["x_map", "v"]) == ("x_map", "v")
    assert _free(data, ["x_map", "u"]) == ("x_map_", "u_")
