"""Errors of conversions are measured against the source's own functions where no fit has looked, and carried along."""

import json
import re

import numpy as np
import pytest

from elvis import from_ngsolve, integrate, read, sample, write
from elvis.converters.ngsolve.export import export
from elvis.core.bounds.bounding import quantity_range
from elvis.core.bounds.quantity_extrema import quantity_extrema
from elvis.core.data.conversion_errors import ConversionErrors
from elvis.core.numbers.norms import quantity_norms
from elvis.core.quantities import Expression
from elvis.plugins.command.command import main


@pytest.fixture(scope="module")
def disk(ngsolve):
    geom2d = pytest.importorskip("netgen.geom2d")
    geometry = geom2d.SplineGeometry()
    geometry.AddCircle((0, 0), 1, bc="circle")
    mesh = ngsolve.Mesh(geometry.GenerateMesh(maxh=1))
    mesh.Curve(3)
    return mesh


@pytest.fixture(scope="module")
def square(ngsolve):
    geom2d = pytest.importorskip("netgen.geom2d")
    return ngsolve.Mesh(geom2d.unit_square.GenerateMesh(maxh=0.6))


def random(ngsolve, space):
    field = ngsolve.GridFunction(space)
    field.vec.FV().NumPy()[:] = np.random.default_rng(4).uniform(-1, 1, len(field.vec))
    return field


def true_error(ngsolve, mesh, dataset, name, function, component=0):
    """The largest difference of a field to the library's values at random points of all elements."""
    points = np.random.default_rng(1).dirichlet([1, 1, 1], 12)[:, :2]
    rule = ngsolve.IntegrationRule([tuple(point) for point in points], [1] * len(points))
    mapped = mesh.MapToAllElements({ngsolve.ET.TRIG: rule}, ngsolve.VOL)
    places = np.asarray(ngsolve.CoefficientFunction((ngsolve.x, ngsolve.y))(mapped))
    wanted = np.asarray(function(mapped)).reshape(len(places), -1)[:, component]
    return np.abs(sample(dataset, name, places).values[:, 0] - wanted).max()


def stated(dataset, name):
    """The error that the record of a conversion tells; rounding where it tells none."""
    errors = ConversionErrors.of(dataset.metadata).fields
    return errors[name].value if name in errors else 1e-11


CASES = {
    "wave of low order": (lambda n, m: (n.sin(10 * n.x) * n.cos(7 * n.y), 2)),
    "wave of order 6": (lambda n, m: (n.sin(10 * n.x) * n.cos(7 * n.y), 6)),
    "jump": (lambda n, m: (n.IfPos(n.x - 0.37, 1, 0), 3)),
    "gradient": (lambda n, m: (n.grad(random(n, n.H1(m, order=3))), 3)),
    "HDiv": (lambda n, m: (random(n, n.HDiv(m, order=2)), None)),
    "HCurl": (lambda n, m: (random(n, n.HCurl(m, order=1)), None)),
    "H1": (lambda n, m: (random(n, n.H1(m, order=3)), None)),
}


@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("name", CASES)
def test_no_true_error_is_greater_than_the_stated_one(ngsolve, disk, square, name, bent):
    mesh = disk if bent else square
    function, order = CASES[name](ngsolve, mesh)
    dataset = from_ngsolve(mesh, u=function, order=order)
    first = next(iter(dataset))
    assert true_error(ngsolve, mesh, dataset, first, function) <= stated(dataset, first)
    is_exact = first not in ConversionErrors.of(dataset.metadata).fields
    assert ("exact to the rounding" in dataset.remarks[0]) == (not ConversionErrors.of(dataset.metadata))
    assert is_exact == (name == "H1" or (not bent and name in ("HDiv", "HCurl", "gradient")))


def test_orders_may_differ_by_element(ngsolve, square):
    space = ngsolve.L2(square, order=2)
    space.SetOrder(ngsolve.NodeId(ngsolve.FACE, 1), 5)
    space.UpdateDofTables()
    function = random(ngsolve, space)
    dataset = from_ngsolve(square, u=function)
    assert true_error(ngsolve, square, dataset, "u", function) < 1e-12
    assert not ConversionErrors.of(dataset.metadata)


@pytest.fixture(scope="module")
def flux(ngsolve, disk, tmp_path_factory):
    """A function of H(div) on curved elements: the mesh and the function as files, and as samples."""
    folder = tmp_path_factory.mktemp("flux")
    disk.ngmesh.Save(str(folder / "disk.vol"))
    mesh = ngsolve.Mesh(str(folder / "disk.vol"))
    function = random(ngsolve, ngsolve.HDiv(mesh, order=1))
    function.Save(str(folder / "disk.flux.gfu"))
    export(folder / "disk.elems.npz", mesh, {"flux": function})
    return folder, mesh, function


def test_samples_in_files_state_their_error(ngsolve, flux):
    folder, mesh, function = flux
    dataset = read(folder / "disk.elems.npz")
    off = true_error(ngsolve, mesh, dataset, "flux_x", function)
    assert 0 < off <= stated(dataset, "flux_x") < 1e-4
    assert "with errors of up to" in dataset.remarks[0]


@pytest.mark.thorough
def test_probes_norms_and_extrema_state_the_error_of_the_conversion(ngsolve, flux, tmp_path, capsys):
    folder, mesh, function = flux
    paths = write(read(folder / "disk.elems.npz"), tmp_path / "a.xml")
    dataset = read(*paths)
    places = np.random.default_rng(3).uniform(-0.6, 0.6, (200, 2))
    mapped = [mesh(*place) for place in places]
    wanted = np.array([function(at) for at in mapped])
    truth = {"flux_x": wanted[:, 0], "flux_x^2-flux_y": wanted[:, 0] ** 2 - wanted[:, 1]}
    found = sample(dataset, list(truth), places)
    for number, values in enumerate(truth.values()):
        off = np.abs(found.values[:, number] - values)
        assert off.max() > 0
        assert (off <= found.errors[:, number]).all()
        assert found.errors[:, number].max() < 1e-3

    exact = ngsolve.sqrt(ngsolve.Integrate((function[0] ** 2 - function[1]) ** 2, mesh, order=20))
    text = "flux_x^2-flux_y"
    (norm,) = quantity_norms(dataset, [Expression.of(dataset, text)]).values()
    assert 0 < abs(norm.l2 - exact) <= norm.l2_error < 1e-3
    least, greatest = quantity_extrema(dataset, Expression.of(dataset, text))
    assert greatest.bound - greatest.value >= found.errors[:, 1].max()
    assert least.value - least.bound >= found.errors[:, 1].max()

    # ranges hold the source's values, too
    known = quantity_range(dataset, Expression.of(dataset, "flux_x"))
    assert min(known.upper - known.maximum, known.minimum - known.lower) >= 0.99 * stated(dataset, "flux_x")
    with pytest.raises(SystemExit):
        main(["info", "--json", *map(str, paths)])
    told = {own["name"]: own["range"] for own in json.loads(capsys.readouterr().out)["fields"]}["flux_x"]
    assert [told["lower"], told["upper"]] == pytest.approx([known.lower, known.upper], rel=1e-12)

    # one note in each command
    picture = ["render", "--size", "16x16", "-o", str(tmp_path / "a.png")]
    commands = (["norms", "--json"], ["probe", "--json", "--point", "0,0,0"], ["info", "--extrema", "--json"], picture)
    for command in commands:
        with pytest.raises(SystemExit) as status:
            main([*command, "--field", text, *map(str, paths)])
        assert not status.value.code
        assert capsys.readouterr().err.count("off by the error of the conversion (an estimate): flux_x^2") == 1


def test_integrals_include_the_error_of_the_conversion(ngsolve, flux, tmp_path):
    folder, mesh, function = flux
    dataset = read(folder / "disk.vol", folder / "disk.flux.gfu", reader=["spaces=HDiv:1"])
    truth = {
        ("flux_x*nx+flux_y*ny", "circle"): ngsolve.Integrate(
            function * ngsolve.specialcf.normal(2), mesh, ngsolve.BND, order=14
        ),
        ("flux_x^2", "domain"): ngsolve.Integrate(function[0] ** 2, mesh, order=16),
        ("d(flux_x,x)+d(flux_y,y)", "domain"): ngsolve.Integrate(ngsolve.div(function), mesh, order=14),
    }
    # the record of errors stays in native files, and what is made of them has it
    again = read(*write(dataset, tmp_path / "a.xml"))
    assert again.remarks == (f"the data were converted with {ConversionErrors.of(dataset.metadata).sentence()}",)
    for data in (dataset, again):
        for (integrand, over), wanted in truth.items():
            found = integrate(data, integrand, over)[0]
            assert 1e-13 < found.error < 1e-2
            assert abs(found.value - wanted) <= found.error
            assert not found.exact


ARC = """<VTKFile type="UnstructuredGrid" version="2.3" byte_order="LittleEndian" header_type="UInt64">
<UnstructuredGrid><Piece NumberOfPoints="9" NumberOfCells="1">
<PointData RationalWeights="w"><DataArray type="Float64" Name="w" format="ascii">1 1 1 1 1 {w} 1 {w} {w}</DataArray>
</PointData>
<Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">
1 0 0 2 0 0 0 2 0 0 1 0 1.5 0 0 2 2 0 0 1.5 0 1 1 0 1.5 1.5 0</DataArray></Points>
<Cells><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2 3 4 5 6 7 8</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">9</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">77</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>"""


def arc(folder):
    """A quarter of a ring as one rational Bezier cell."""
    pytest.importorskip("vtk")
    path = folder / "arc.vtu"
    path.write_text(ARC.format(w=repr(0.5**0.5)))
    return path


def test_the_map_of_rational_cells_has_more_orders_and_a_stated_error(tmp_path):
    dataset = read(arc(tmp_path), cache=False)
    truth = {("area", "domain"): 0.75 * np.pi, ("x", "domain"): 7 / 3, ("1", "boundary"): 2 + 1.5 * np.pi}
    for (integrand, over), wanted in truth.items():
        found = integrate(dataset, integrand, over)[0]
        assert 0 < abs(found.value - wanted) <= found.error < 1e-2
        assert abs(found.value - wanted) < 1e-5
        assert not found.exact
    found = integrate(dataset, "1", "plane:0,0.5,0:0,1,0")
    assert re.search("do not include those of the conversion: errors of up to .* in coordinates", found.remarks[-1])
