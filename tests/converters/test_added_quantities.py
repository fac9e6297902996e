"""Quantities as fields: polynomials come back to rounding, others within the tolerance, and nothing else changes."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from elvis import Dataset, ElvisError, Shape, read, sample, with_quantity, write
from elvis.core.testing import approximated, curved, grid, scattered
from elvis.plugins.command.command import elvis
from elvis.plugins.data.added_quantities import add_quantities

FUNCTIONS = {
    "u": lambda x: x[:, 0] ** 2 + x[:, 1] * x[:, 0],
    "v": lambda x: x[:, 1] ** 2 - x[:, 0],
    "p": lambda x: 1.5 + x[:, 0] * x[:, 1],
}
#: quantities and their closed forms
POLYNOMIALS = {
    "Cp=2*(p-1)": lambda x: 1 + 2 * x[:, 0] * x[:, 1],
    "square=u^2+x*v": lambda x: FUNCTIONS["u"](x) ** 2 + x[:, 0] * FUNCTIONS["v"](x),
    "slope=d(v,x)-d(u,y)": lambda x: -1 - x[:, 0],
    "q_criterion": lambda x: -0.5 * ((2 * x[:, 0] + x[:, 1]) ** 2 - 2 * x[:, 0] + 4 * x[:, 1] ** 2),
}


def flow(mesh, modes=3):
    data = Dataset(mesh, time=0.5)
    fields = tuple(replace(approximated(data, name, f, modes), continuous=True) for name, f in FUNCTIONS.items())
    return replace(data, fields=fields)


def values(data, name, points):
    return sample(data, [name], points).values[:, 0]


@pytest.mark.parametrize(
    "shape", [Shape.TRIANGLE, Shape.QUADRILATERAL, Shape.TETRAHEDRON, Shape.PRISM, Shape.HEXAHEDRON]
)
def test_polynomials_come_back_to_rounding(shape):
    data = flow(grid(shape, 1))
    wanted = POLYNOMIALS if shape.dimension == 2 else {k: f for k, f in POLYNOMIALS.items() if "crit" not in k}
    found = add_quantities(data, list(wanted))
    points = np.random.default_rng(3).uniform(0.02, 0.98, (40, 3))
    points[:, shape.dimension :] = 0
    assert all(measure.is_exact for measure in found.measures)
    for text, function in wanted.items():
        name = text.partition("=")[0]
        assert np.abs(values(found.dataset, name, points) - function(points)).max() < 1e-12
    assert [own.is_continuous for own in found.measures] == [
        "slope" not in text and "crit" not in text for text in wanted
    ]


def test_on_curved_elements_products_are_exact_and_derivatives_within_the_tolerance():
    data = flow(curved(grid(Shape.QUADRILATERAL, 2), lambda x: x + 0.04 * np.sin(3 * x[..., [1, 0, 2]]) * [1, 1, 0], 3))
    found = add_quantities(data, ["square=u^2", "du=d(u,x)"], tolerance=1e-5)
    square, slope = found.measures
    assert square.is_exact
    assert not slope.is_exact
    points = np.random.default_rng(5).uniform(0.1, 0.9, (400, 3)) * [1, 1, 0]
    exact = values(data, "d(u,x)", points)
    off = np.abs(values(found.dataset, "du", points) - exact).max()
    assert off <= slope.max <= 2e-5 * np.ptp(exact)
    assert off > 1e-12


def test_a_requested_order_is_used_and_its_error_measured():
    data = flow(grid(Shape.TRIANGLE, 2))
    found = add_quantities(data, ["s=sqrt(p)"], order=2)
    points = np.random.default_rng(5).uniform(0.02, 0.98, (400, 3)) * [1, 1, 0]
    off = np.abs(values(found.dataset, "s", points) - np.sqrt(FUNCTIONS["p"](points))).max()
    assert found.measures[0].order == 2
    assert 0.3 * found.measures[0].max < off <= found.measures[0].max
    finer = add_quantities(data, ["s=sqrt(p)"], tolerance=1e-9).measures[0]
    assert finer.relative < 1e-9
    kink = add_quantities(data, ["k=abs(x-0.3)"])
    assert kink.measures[0].relative > 1e-4
    assert "is within the tolerance 1e-06" in kink.dataset.remarks[-1]
    assert not add_quantities(data, ["s=sqrt(p)"]).dataset.remarks


def test_existing_coefficients_are_unchanged_and_one_section_contains_all(tmp_path):
    data = flow(grid(Shape.QUADRILATERAL, 2))
    write(data, tmp_path / "a.xml")
    write(with_quantity(read(tmp_path / "a.xml", tmp_path / "a.fld"), "square=u^2"), tmp_path / "b.fld")
    again = read(tmp_path / "a.xml", tmp_path / "b.fld")
    (before,), (after,) = data.field("u").blocks, again.field("u").blocks
    assert after.expansion.modes == (5, 5)
    assert after.expansion == again.field("square").blocks[0].expansion
    few, many = (np.sort(np.abs(own.coefficients), axis=1) for own in (before, after))
    assert (many[:, -few.shape[1] :] == few).all()
    assert not many[:, : -few.shape[1]].any()


def test_errors_of_projections_travel_with_the_file(tmp_path):
    data = with_quantity(flow(grid(Shape.QUADRILATERAL, 1)), "s=sqrt(p)", order=1)
    write(data, tmp_path / "a.xml")
    samples = sample(read(tmp_path / "a.xml", tmp_path / "a.fld"), ["s", "u"], np.array([[0.3, 0.6, 0.0]]))
    assert samples.errors[0, 0] > 1e-3
    assert samples.errors[0, 1] == 0


@pytest.fixture
def files(tmp_path):
    return write(flow(grid(Shape.QUADRILATERAL, 1)), tmp_path / "a.xml")


def test_the_command_writes_only_the_fields_if_the_mesh_is_unchanged(files, tmp_path, elvis_json):
    out = tmp_path / "out.fld"
    added = ("--add", "Cp=2*(p-1)", "--add", "vorticity", "--add", "s=sqrt(p)")
    report = elvis_json("convert", *files, *added, "--fields", "p", "--rename", "p=pressure", "-o", out)
    assert {name: facts["state"] for name, facts in report["fields"].items()} == {
        "Cp": "exact",
        "vorticity": "exact",
        "s": "projected",
    }
    assert not (tmp_path / "out.xml").exists()
    assert list(read(files[0], out)) == ["pressure", "Cp", "vorticity", "s"]


@pytest.mark.parametrize("suffix", ["vtu", "msh"])
def test_exports_hold_quantities(files, tmp_path, elvis, suffix):
    elvis("export", *files, "--fields", "p", "--add", "square=u^2", "-o", tmp_path / f"a.{suffix}")
    found = read(tmp_path / f"a.{suffix}", cache=False)
    assert [name for name in found if name != "element"] == ["p", "square"]
    points = np.array([[0.3, 0.6, 0.0], [0.8, 0.1, 0.0]])
    assert values(found, "square", points) == pytest.approx(FUNCTIONS["u"](points) ** 2, abs=1e-12)


def test_sums_with_another_solution_are_fields(files, tmp_path, elvis):
    elvis("convert", *files, "--other", f"b={files[0]},{files[1]}", "--add", "mean=(u+b:u)/2", "-o", tmp_path / "m.fld")
    points = scattered(Shape.QUADRILATERAL, 20) / 2 + 0.5
    points = np.hstack([points, np.zeros((20, 1))])
    found = read(files[0], tmp_path / "m.fld")
    assert values(found, "mean", points) == pytest.approx(FUNCTIONS["u"](points), abs=1e-13)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--add", "p=2*p"], "field 'p' already exists"),
        (["--add", "d(u,x)"], "expected NAME=EXPRESSION"),
        (["--add", "q=log(x-0.5)"], "q: expected finite values, found others in 1 elements: 0"),
        (["--add", "n=nx*p"], "n: expected a quantity with values inside elements, found one on faces only"),
        (["--add", "q=2*r"], "there is no 'r'"),
        (["--rename", "u=p"], "--rename: expected names that no other field has, found 'p'"),
        (["--rename", "w=p"], "there is no field 'w'"),
        (["--add", "q=2*p", "--order", "31"], "expected an order from 1 to 30, found 31"),
        (["--order", "3"], "expected quantities that --add names, found none"),
    ],
)
def test_bad_input_gives_a_one_line_error_and_no_file(files, tmp_path, elvis, options, message):
    with pytest.raises(ElvisError) as raised:
        elvis("convert", *files, *options, "-o", tmp_path / "out.fld")
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)
    assert not (tmp_path / "out.fld").exists()


def test_converted_data_get_quantities_with_the_mesh(files, tmp_path, elvis):
    elvis("export", *files, "-o", tmp_path / "a.vtu")
    with pytest.raises(ElvisError, match=r"expected a name ending in \.xml, as the mesh is converted"):
        elvis("convert", tmp_path / "a.vtu", "--add", "square=u^2", "-o", tmp_path / "b.fld")
    report = json.loads(elvis("convert", tmp_path / "a.vtu", "--add", "square=u^2", "-o", tmp_path / "b.xml", "--json"))
    assert list(report["fields"]) == ["u", "v", "p", "element", "square"]
    found = read(tmp_path / "b.xml", tmp_path / "b.fld")
    points = np.array([[0.3, 0.6, 0.0]])
    assert values(found, "square", points) == pytest.approx(FUNCTIONS["u"](points) ** 2, abs=1e-12)


def test_indicators_of_closed_surfaces_are_fields(tmp_path):
    """The command that the page "From FieldConvert" names for phifile, within the error that it reports."""
    box = trimesh.creation.box((0.5, 0.5, 0.5), trimesh.transformations.translation_matrix((0.5, 0.5, 0.5)))
    box.export(tmp_path / "body.stl")
    files = write(Dataset(grid(Shape.HEXAHEDRON, 2)), tmp_path / "a.xml")
    out = tmp_path / "phi.fld"
    words = ["--add", f"phi=indicator('{tmp_path / 'body.stl'}',0.5)", "--order", "2", "--json", "-o", out]
    outcome = CliRunner().invoke(elvis, ["convert", *map(str, files), *map(str, words)])
    assert outcome.exit_code == 0, outcome.output
    error = json.loads(outcome.stdout)["fields"]["phi"]["max"]
    points = np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 0.75], [0.5, 0.95, 0.5], [0.3, 0.5, 0.5]])
    exact = (1 - np.tanh(np.array([-0.25, 0, 0.2, -0.05]) / 0.5)) / 2
    found = values(read(*files, out), "phi", points)
    assert 0 < error < 0.2
    assert np.abs(found - exact).max() <= error
