"""Fields on another mesh: exact where its spaces hold them, else the best approximation, integrals kept."""

import json
from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, ElvisError, Shape, integrate, onto_mesh, read, sample, write
from elvis.core.polynomials.cubature import COLLAPSE
from elvis.core.polynomials.quadrature import gauss
from elvis.core.testing import approximated, curved, grid
from elvis.plugins.transfers.element_projection import _Rules
from elvis.plugins.transfers.onto_mesh import report_of_transfer

FUNCTIONS = {"u": lambda x: x[:, 0] ** 2 + x[:, 1], "p": lambda x: 1.5 + x[:, 0] * x[:, 1]}


def flow(mesh, modes=3):
    data = Dataset(mesh, time=0.5)
    return replace(data, fields=tuple(approximated(data, *item, modes) for item in FUNCTIONS.items()))


def moved(mesh, factor, shift):
    return replace(mesh, vertices=mesh.vertices * factor + shift)


def jumping(cells):
    """A field of order 1 with random coefficients on each of cells x cells squares."""
    data = flow(grid(Shape.QUADRILATERAL, cells), 2)
    (block,) = data.fields[0].blocks
    coefficients = np.random.default_rng(3).normal(size=block.coefficients.shape)
    return replace(data, fields=(replace(data.fields[0], blocks=(replace(block, coefficients=coefficients),)),))


@pytest.mark.parametrize(
    ("shape", "other", "cells"),
    [
        (Shape.QUADRILATERAL, Shape.QUADRILATERAL, (1, 2)),
        (Shape.QUADRILATERAL, Shape.QUADRILATERAL, (4, 2)),
        (Shape.TRIANGLE, Shape.QUADRILATERAL, (2, 3)),
        (Shape.HEXAHEDRON, Shape.TETRAHEDRON, (1, 1)),
        (Shape.TETRAHEDRON, Shape.PRISM, (1, 1)),
    ],
)
def test_polynomials_are_exact_on_any_mesh(shape, other, cells):
    found = onto_mesh(flow(grid(shape, cells[0])), Dataset(grid(other, cells[1])))
    points = np.random.default_rng(1).uniform(0.02, 0.98, (50, 3))
    points[:, shape.dimension :] = 0
    for own, total in zip(found.measures, found.integrals, strict=True):
        values = sample(found.dataset, [own.name], points).values[:, 0]
        assert np.abs(values - FUNCTIONS[own.name](points)).max() < 1e-12
        assert own.is_exact
        assert total.after == pytest.approx(total.before, abs=1e-13)
    assert found.covered == 1
    assert found.residual == 0


def test_jumps_inside_of_elements_are_cut_exactly_on_nested_meshes():
    """The means over the four small squares in each large one, by closed form."""
    source = jumping(4)
    same = onto_mesh(source, Dataset(source.mesh))
    assert all(own.is_exact for own in same.measures)
    found = onto_mesh(source, Dataset(grid(Shape.QUADRILATERAL, 2)), order=1)
    (total,) = found.integrals
    assert total.after == pytest.approx(total.before, abs=1e-13)
    # the difference is orthogonal to 1, x, y and xy on each large square: Gauss rules on the small ones are exact
    nodes, weights = gauss(4)
    line = ((np.arange(4)[:, None] + (1 + nodes) / 2) / 4).reshape(-1)
    weight = np.tile(weights / 8, 4)
    x, y = (own.reshape(-1) for own in np.meshgrid(line, line, indexing="ij"))
    points = np.stack([x, y, 0 * x], axis=1)
    both = [sample(data, ["u"], points).values[:, 0] for data in (source, found.dataset)]
    square = (x > 0.5) * 2 + (y > 0.5)
    for function in (1 + 0 * x, x, y, x * y):
        moments = np.bincount(square, (both[0] - both[1]) * function * np.outer(weight, weight).reshape(-1))
        assert np.abs(moments).max() < 1e-13


def test_unresolved_borders_are_reported_with_their_error():
    found = onto_mesh(jumping(3), Dataset(moved(grid(Shape.QUADRILATERAL, 1), [0.7, 0.7, 1], [0.1, 0.1, 0])))
    assert 0 < found.residual < 1e-2
    nodes = (np.arange(400) + 0.5) / 400 * 0.7 + 0.1
    x, y = (own.reshape(-1) for own in np.meshgrid(nodes, nodes))
    exact = sample(jumping(3), ["u"], np.stack([x, y, 0 * x], axis=1)).values.mean() * 0.49
    assert found.integrals[0].after == pytest.approx(exact, abs=2e-3)
    report = report_of_transfer(found, [])
    assert "of a field, an estimate from two rules" in report.notes[-1]
    assert report.facts()["is_bound"] is False


@pytest.mark.parametrize(
    ("shape", "order"), [(Shape.QUADRILATERAL, 8), (Shape.TRIANGLE, 12), (Shape.QUADRILATERAL, 22)]
)
def test_orders_far_above_those_of_the_fields_are_exact(shape, order):
    """The rules are exact for products of two functions of the projection as well, not only with the fields."""
    found = onto_mesh(flow(grid(shape, 1)), Dataset(grid(shape, 1)), order=order)
    assert all(own.is_exact for own in found.measures)
    assert found.residual == 0


@pytest.mark.parametrize("shape", COLLAPSE, ids=str)
def test_rules_on_boxes_are_exact_for_products_on_collapsed_elements(shape):
    """Of projections of order 4 with each other, or with fields of degree 3, on maps of order 5."""
    rules = _Rules(shape, 4, 3, 5)
    bend = 4 * shape.dimension
    counts = [round(len(rules.fine(False, fewer)[1]) ** (1 / shape.dimension)) for fewer in (0, 1)]
    assert counts[0] == counts[1] + 1
    for (points, weights), degree in ((rules.coarse, 8), (rules.fine(True), 9), (rules.fine(False), 9 + bend)):
        for axis, power in enumerate(COLLAPSE[shape]):
            for n in (degree + power - 1, degree + power):
                expected = 2**shape.dimension * ((1 - n % 2) / (n + 1))
                assert weights @ points[:, axis] ** n == pytest.approx(expected, abs=1e-13)


def test_curved_elements_are_located_exactly():
    bent = curved(grid(Shape.QUADRILATERAL, 2), lambda x: x + 0.04 * np.sin(3 * x[..., [1, 0, 2]]) * [1, 1, 0], 3)
    source = flow(grid(Shape.QUADRILATERAL, 1))
    target = Dataset(moved(bent, [0.6, 0.6, 1], [0.1, 0.1, 0]))
    found = onto_mesh(source, target, order=6)
    assert all(own.is_exact for own in found.measures)
    for name in FUNCTIONS:
        whole = integrate(target, {"u": "x^2+y", "p": "1.5+x*y"}[name]).value
        assert integrate(found.dataset, name).value == pytest.approx(whole, rel=1e-12)


def test_points_outside_get_the_requested_value():
    source = flow(grid(Shape.QUADRILATERAL, 2))
    target = Dataset(moved(grid(Shape.QUADRILATERAL, 2), 1.2, [-0.1, -0.1, 0]))
    with pytest.raises(ElvisError, match="the data don't cover the target"):
        onto_mesh(source, target)
    with pytest.raises(ElvisError, match="expected error, nan, nearest or a number"):
        onto_mesh(source, target, outside="zero")
    lost = onto_mesh(source, target, outside="nan")
    assert lost.not_finite == (0, 1, 2, 3)
    assert abs(lost.covered - 1 / 1.44) <= lost.residual < 0.01
    filled = onto_mesh(source, target, outside="0", order=1)
    total = filled.integrals[0]
    assert 0 < abs(total.after - total.before) <= filled.residual * total.before
    far = onto_mesh(source, target, outside="nearest", fields=["p"], order=2)
    assert far.integrals[0].after > 1.44 * 1.5
    assert not far.reaches_beyond
    assert onto_mesh(source, Dataset(moved(grid(Shape.QUADRILATERAL, 1), 0.5, 0))).reaches_beyond
    with pytest.raises(ElvisError, match="the mesh and the data do not overlap"):
        onto_mesh(source, Dataset(moved(grid(Shape.QUADRILATERAL, 1), 1, [3, 0, 0])), outside="nearest")


@pytest.fixture
def files(tmp_path):
    source = write(flow(grid(Shape.QUADRILATERAL, 1)), tmp_path / "a.xml")
    return source, write(Dataset(grid(Shape.TRIANGLE, 2)), tmp_path / "b.xml")


def test_the_command_writes_fields_for_the_other_mesh(files, tmp_path, elvis_json, elvis):
    source, target = files
    out = tmp_path / "on_b.fld"
    report = elvis_json("convert", *source, "--onto", target[0], "--order", "4", "--fields", "p", "-o", out)
    assert report["fields"]["p"]["exact"]
    assert report["integrals"]["p"]["after"] == pytest.approx(1.75, abs=1e-13)
    assert report["covered"] == 1
    found = read(*target, out)
    assert list(found) == ["p"]
    assert found.field("p").blocks[0].expansion.modes == (5, 5)
    assert found.time == 0.5
    diff = json.loads(elvis("diff", ",".join(map(str, source)), f"{target[0]},{out}", "--json"))
    assert diff["p"]["Linf"] < 1e-12


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--outside", "zero"], "--outside: expected error, nan, nearest or a number, found 'zero'"),
        (["--add", "q=2*u"], "--onto: expected no --add"),
        (["--fields", "w"], "there is no field 'w'"),
        (["--order", "31"], "expected an order from 1 to 30, found 31"),
    ],
)
def test_bad_input_gives_a_one_line_error_and_no_file(files, tmp_path, elvis, options, message):
    source, target = files
    with pytest.raises(ElvisError) as raised:
        elvis("convert", *source, "--onto", target[0], *options, "-o", tmp_path / "out.fld")
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)
    assert not (tmp_path / "out.fld").exists()


def test_meshes_of_other_dimensions_are_rejected():
    with pytest.raises(ElvisError, match="expected meshes of one dimension, found 2D and 3D"):
        onto_mesh(flow(grid(Shape.QUADRILATERAL, 1)), Dataset(grid(Shape.HEXAHEDRON, 1)))
