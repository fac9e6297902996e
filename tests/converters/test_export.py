"""Exports: what VTK and Gmsh themselves find in the files is what was written."""

import struct
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from elvis import ElvisError, read, write
from elvis.converters.gmsh.export import GmshTarget
from elvis.converters.gmsh.gmsh import Gmsh
from elvis.converters.shared.exporting import exported
from elvis.converters.tables.points import PointTarget
from elvis.converters.tables.tecplot import TecplotTarget
from elvis.converters.vtk.export import VtkTarget
from elvis.converters.vtk.vtk import Vtk
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.patch import patches
from elvis.core.numbers.sampling import sample
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple, scattered, shuffled
from elvis.plugins.conversion.converting import convert

#: the library's number of linear hexahedra
VTK_HEXAHEDRON = 12

FUNCTIONS = {"u": lambda x: x[:, 0] ** 2 + x[:, 1] * x[:, 2], "jump": lambda x: np.sin(3 * x[:, 0] - x[:, 1])}


def with_fields(mesh, modes):
    dataset = Dataset(mesh, time=0.25)
    return replace(dataset, fields=tuple(approximated(dataset, n, f, modes) for n, f in FUNCTIONS.items()))


MESHES = {
    "volume": lambda: curved(shuffled(mixed_volume(3), 1), ripple(0.05), 3),
    "plane": lambda: curved(mixed_plane(1), lambda x: x + 0.05 * np.sin(x[:, [1, 0, 2]]), 3),
    "line": lambda: grid(Shape.SEGMENT, 3),
}


@pytest.fixture(params=[(mesh, modes) for mesh in MESHES for modes in (2, 4)], ids=lambda p: f"{p[0]}-{p[1]}")
def files(request, tmp_path):
    mesh, modes = request.param
    return write(with_fields(MESHES[mesh](), modes), tmp_path / "a.xml")


@pytest.mark.parametrize("suffix", ["vtu", "msh"])
def test_round_trip(elvis, elvis_json, files, tmp_path, suffix):
    out = tmp_path / f"out.{suffix}"
    losses = elvis_json("export", *files, "-o", out)["losses"]
    assert [loss["name"] for loss in losses] == ["coordinates", "u", "jump"]
    assert max(loss["relative"] for loss in losses) < 1e-12
    before = read(*files)
    again = convert({"vtu": Vtk, "msh": Gmsh}[suffix]([out])).dataset
    assert again.time == 0.25
    points = inside(before)
    old, new = (sample(each, list(FUNCTIONS), points).values for each in (before, again))
    assert np.isfinite(old).all()
    assert np.nanmax(np.abs(old - new)) < 1e-11
    assert np.isfinite(new).all()


def inside(dataset, count=12):
    """Places of random points inside every element."""
    found = []
    for patch in patches(dataset):
        points = 0.6 * scattered(patch.shape, count) + 0.4 * patch.shape.vertices.mean(axis=0)
        found.append(evaluate(patch.geometry, patch.geometry_coefficients, points).transpose(0, 2, 1).reshape(-1, 3))
    return np.concatenate(found)


def test_vtk_itself_finds_the_values(elvis, tmp_path):
    """Each cell of the file, as the library locates and evaluates parametric points in it."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkGenericCell
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    paths = write(with_fields(MESHES["volume"](), 4), tmp_path / "a.xml")
    elvis("export", *paths, "-o", tmp_path / "a.vtu")
    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(tmp_path / "a.vtu"))
    reader.Update()
    output, cell = reader.GetOutput(), vtkGenericCell()
    ids = vtk_to_numpy(output.GetCellData().GetArray("element"))
    u = vtk_to_numpy(output.GetPointData().GetArray("u"))
    places, values = [], []
    rng = np.random.default_rng(3)
    for number in range(output.GetNumberOfCells()):
        output.GetCell(number, cell)
        a, b, c = sorted(rng.uniform(0.05, 0.95, 3))
        weights = [0.0] * cell.GetNumberOfPoints()
        cell.InterpolateFunctions([a, b - a, c - b], weights)
        own = [cell.GetPointId(i) for i in range(cell.GetNumberOfPoints())]
        corners = np.array([output.GetPoint(i) for i in own])
        places.append(np.array(weights) @ corners)
        values.append(np.array(weights) @ u[own])
    found = sample(read(*paths), ["u"], np.array(places)).values.reshape(-1)
    assert len(ids) == len(places)
    assert np.abs(found - values).max() < 1e-11


def test_gmsh_itself_finds_the_values(elvis, tmp_path):
    """The library reads the mesh, and the data through its own views."""
    import gmsh

    paths = write(with_fields(MESHES["volume"](), 3), tmp_path / "a.xml")
    elvis("export", *paths, "-o", tmp_path / "a.msh")
    gmsh.initialize(["test"], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "a.msh"))
        places, values = [], []
        view = gmsh.view.getTags()[0]
        _, tags, data, time, components = gmsh.view.getModelData(view, 0)
        held = dict(zip(tags.tolist(), data, strict=True))
        for kind in gmsh.model.mesh.getElementTypes(3):
            table = gmsh.model.mesh.getBasisFunctions(kind, [0.1, 0.2, 0.15], "Lagrange")[1]
            tags, nodes = gmsh.model.mesh.getElementsByType(kind)
            for tag, own in zip(tags, nodes.reshape(len(tags), -1), strict=True):
                places.append(table @ [gmsh.model.mesh.getNode(node)[0] for node in own])
                values.append(table @ held[int(tag)])
    finally:
        gmsh.finalize()
    assert (time, components, len(values)) == (0.25, 1, 12)
    found = sample(read(*paths), ["u"], np.array(places)).values.reshape(-1)
    assert np.abs(found - values).max() < 1e-11


def test_vtk_reads_tecplot_text(elvis, tmp_path):
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOGeometry import vtkTecplotReader

    paths = write(with_fields(mixed_volume(3), 4), tmp_path / "a.xml")
    elvis("export", *paths, "-o", tmp_path / "a.dat")
    reader = vtkTecplotReader()
    reader.SetFileName(str(tmp_path / "a.dat"))
    reader.Update()
    zones = [reader.GetOutput().GetBlock(number) for number in range(reader.GetOutput().GetNumberOfBlocks())]
    assert len(zones) == 4
    assert {zone.GetCellType(0) for zone in zones} == {VTK_HEXAHEDRON}
    places = np.concatenate([vtk_to_numpy(zone.GetPoints().GetData()) for zone in zones])
    u = np.concatenate([vtk_to_numpy(zone.GetPointData().GetArray("u")) for zone in zones])
    # VTK keeps single precision
    assert np.abs(u - FUNCTIONS["u"](places)).max() < 1e-6


def test_tecplot_binary_ends_with_values_and_cells(elvis, tmp_path):
    """The values of each variable at all points, then the points of cells, as the format's guide orders them."""
    data = with_fields(grid(Shape.TRIANGLE, 2), 4)
    paths = write(data, tmp_path / "a.xml")
    elvis("export", *paths, "-o", tmp_path / "a.plt")
    binary = (tmp_path / "a.plt").read_bytes()
    assert binary[:16] == b"#!TDV112" + struct.pack("<ii", 1, 0)
    header = np.frombuffer(binary[16:416], "<i4")
    words, at = [], 2
    assert header[:2].tolist() == [0, 4]
    for _ in range(5):
        if len(words) == 4:
            assert header[at : at + 1].view("<f4") == 299.0
            at += 1
        size = header[at:].tolist().index(0)
        words.append("".join(map(chr, header[at : at + size])))
        at += size + 1
    assert words[:4] == ["x", "y", "u", "jump"]
    assert words[4]
    # no parent, a time, no colour of its own; quadrilaterals; points and cells; then the header ends
    assert header[at : at + 2].tolist() == [-1, 0]
    assert header[at + 4 : at + 12].tolist() == [-1, 3, 0, 0, 0, 8 * 16, 8 * 9, 0]
    assert header[at + 15 : at + 17].view("<f4").tolist() == [357.0, 299.0]
    points, cells = 8 * 16, 8 * 9
    end = len(binary) - 16 * cells
    corners = np.frombuffer(binary[end:], np.int32).reshape(cells, 4)
    x, y, u, jump = np.frombuffer(binary[end - 32 * points : end]).reshape(4, points)
    ends = np.frombuffer(binary[end - 32 * points - 64 : end - 32 * points]).reshape(4, 2)
    assert np.array_equal(ends, [(own.min(), own.max()) for own in (x, y, u, jump)])
    assert np.abs(u - x**2).max() < 1e-14
    # the quadrilaterals cover the square
    shifted = np.roll(corners, -1, axis=1)
    area = (x[corners] * y[shifted] - x[shifted] * y[corners]).sum(axis=1) / 2
    assert area.sum() == pytest.approx(1, rel=1e-14)
    assert area.min() > 0


def test_linear_cells_converge_with_their_number():
    losses = {
        order: exported(with_fields(MESHES["plane"](), 4), None, order, TecplotTarget()).losses for order in (7, 14, 28)
    }
    for early, late in ((7, 14), (14, 28)):
        for coarse, fine in zip(losses[early], losses[late], strict=True):
            assert fine.relative < coarse.relative / 3


def test_points_determine_the_fields(elvis, tmp_path):
    """As many points in each direction as a polynomial has coefficients, inside their elements."""
    data = with_fields(grid(Shape.TRIANGLE, 1), 3)
    paths = write(data, tmp_path / "a.xml")
    for name in ("a.csv", "a.pts"):
        elvis("export", *paths, "-o", tmp_path / name)
    table = np.genfromtxt(tmp_path / "a.csv", delimiter=",", names=True)
    assert table.dtype.names == ("x", "y", "z", "u", "jump", "element")
    assert len(table) == 9 * len(np.unique(table["element"]))
    places = np.stack([table[axis] for axis in "xyz"], axis=1)
    assert np.abs(table["u"] - sample(data, ["u"], places).values[:, 0]).max() < 1e-14
    lines = (tmp_path / "a.pts").read_text().splitlines()
    assert lines[2] == '<POINTS DIM="2" FIELDS="u,jump">'
    rows = np.array([line.split() for line in lines[3:-2]], float)
    assert np.array_equal(rows[:, :2], np.stack([table["x"], table["y"]], axis=1))
    assert np.array_equal(rows[:, 2], table["u"])


@pytest.mark.parametrize("target", [VtkTarget, GmshTarget, PointTarget])
def test_every_shape_and_order_is_exact(target):
    context = target()
    for shape in Shape:
        for modes in (2, 3, 4, 5):
            mesh = curved(grid(shape, 1), ripple(0.03) if shape.dimension == 3 else lambda x: x, min(modes, 4))
            losses = found(context, with_fields(mesh, modes), None)
            assert max(loss.relative for loss in losses) < 1e-11, (shape, modes)


def found(target, dataset, order):
    if isinstance(target, GmshTarget):
        with target:
            return exported(dataset, None, order, target).losses
    return exported(dataset, None, order, target).losses


@pytest.mark.parametrize("target", [VtkTarget, GmshTarget])
def test_lower_orders_are_measured(target):
    dataset = with_fields(grid(Shape.TETRAHEDRON, 2), 6)
    errors = [found(target(), dataset, order)[2].relative for order in (1, 2, 3, 4, 5)]
    assert errors[-1] < 1e-12
    assert all(late < 0.6 * early for early, late in pairwise(errors))


def test_maps_given_as_fields_determine_positions(elvis_json, solvers, tmp_path):
    from elvis.converters.hopr import Hopr

    source = convert(Hopr([solvers / "hopr_flexi" / "convcurved_N4_State.h5"])).dataset
    paths = write(source, tmp_path / "a.xml")
    losses = elvis_json("export", *paths, "-o", tmp_path / "a.vtu", "--fields", "Density")["losses"]
    assert [loss["name"] for loss in losses] == ["coordinates", "Density"]
    assert max(loss["relative"] for loss in losses) < 1e-12


def test_nothing_is_written_on_errors(elvis, tmp_path):
    paths = write(with_fields(grid(Shape.TETRAHEDRON, 1), 6), tmp_path / "a.xml")
    with pytest.raises(ElvisError, match="not written"):
        elvis("export", *paths, "-o", tmp_path / "a.vtu", "--order", 2, "--max-error", 1e-6)
    with pytest.raises(ElvisError, match="there is no field 'w'"):
        elvis("export", *paths, "-o", tmp_path / "a.msh", "--fields", "w")
    assert not list(tmp_path.glob("a.[vm]*"))


def test_constants_are_accepted(elvis, elvis_json, tmp_path):
    """Their range is rounding, or nothing, and so are their errors."""
    mesh = curved(grid(Shape.TETRAHEDRON, 1), ripple(0.05), 3)
    plain = Dataset(mesh)
    functions = {
        "one": lambda x: np.sin(x[:, 0]) ** 2 + np.cos(x[:, 0]) ** 2,
        "pressure": lambda x: 101325 / 3 + 0 * x[:, 0],
    }
    # of few modes, as more of them round more: beyond 1e-13 a range is none of rounding any more
    fields = tuple(approximated(plain, name, function, 3) for name, function in functions.items())
    paths = write(replace(plain, fields=fields), tmp_path / "a.xml")
    losses = elvis_json("export", *paths, "-o", tmp_path / "b.vtu", "--order", 6, "--max-error", 1e-13)["losses"]
    assert max(loss["relative"] for loss in losses) < 1e-13
    elvis("convert", *paths, "-o", tmp_path / "c.xml", "--order", 7, "--max-error", 1e-13)
    assert "exact" in elvis("export", *paths, "-o", tmp_path / "d.msh", "--order", 6)
