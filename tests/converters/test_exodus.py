"""Exodus files against VTK's own reader and cells, and against fields that are known."""

import subprocess
import sys

import h5py
import numpy as np
import pytest
from exodus_writer import ExodusBlock, cubes_in_blocks, unit_cubes, write_classic, write_hdf5
from scipy.io import netcdf_file

from elvis import ElvisError, FormatError, integrate, read, write
from elvis.converters.exodus.exodus import Exodus, _Functions, _functions_of
from elvis.converters.exodus.files import SIDES, nodes_of
from elvis.core.shapes import Shape
from elvis.formats.strict import findings
from elvis.plugins.conversion.converting import Settings, convert
from elvis.plugins.conversion.nodal import native_points
from elvis.plugins.conversion.plugin import PyramidSpace
from elvis.plugins.projection.frames import affine_between
from elvis.plugins.testing import check, positions_at, values_found

CASES = {
    "cylinder-hex-q2.gen": {"hexahedron": 252},
    "simple-cube-hex27.e": {"hexahedron": 27},
    "simple-cube-tet10.e": {"tetrahedron": 295},
    "simple-cube-multi-element-order2.e": {"tetrahedron": 295, "hexahedron": 27},
}

TYPES = {
    "TRI3": (Shape.TRIANGLE, 3),
    "TRI6": (Shape.TRIANGLE, 6),
    "TRI7": (Shape.TRIANGLE, 7),
    "SHELL7": (Shape.TRIANGLE, 7),
    "QUAD4": (Shape.QUADRILATERAL, 4),
    "QUAD8": (Shape.QUADRILATERAL, 8),
    "QUAD9": (Shape.QUADRILATERAL, 9),
    "TET4": (Shape.TETRAHEDRON, 4),
    "TETRA10": (Shape.TETRAHEDRON, 10),
    "TETRA14": (Shape.TETRAHEDRON, 14),
    "TETRA15": (Shape.TETRAHEDRON, 15),
    "PYRAMID5": (Shape.PYRAMID, 5),
    "PYRAMID13": (Shape.PYRAMID, 13),
    "PYRAMID14": (Shape.PYRAMID, 14),
    "PYRAMID18": (Shape.PYRAMID, 18),
    "PYRAMID19": (Shape.PYRAMID, 19),
    "WEDGE6": (Shape.PRISM, 6),
    "WEDGE15": (Shape.PRISM, 15),
    "WEDGE18": (Shape.PRISM, 18),
    "WEDGE20": (Shape.PRISM, 20),
    "WEDGE21": (Shape.PRISM, 21),
    "HEX8": (Shape.HEXAHEDRON, 8),
    "HEX20": (Shape.HEXAHEDRON, 20),
    "HEX27": (Shape.HEXAHEDRON, 27),
}


@pytest.mark.parametrize("name", CASES)
def test_meshes_are_exact_and_pass_the_strict_checks(solvers, tmp_path, name):
    conversion = check(Exodus, [solvers / "exodus" / name])
    assert conversion.report.geometry.state == "exact"
    assert conversion.report.elements == CASES[name]
    assert not any(conversion.report.listed.values())
    assert findings(*write(conversion.dataset, tmp_path / "a.xml")) == ()
    written = []
    for _ in range(2):
        write(convert(Exodus([solvers / "exodus" / name])).dataset, tmp_path / "a.xml")
        written.append((tmp_path / "a.xml").read_bytes())
    assert written[0] == written[1]


@pytest.mark.parametrize("name", CASES)
def test_places_match_those_of_another_reader(solvers, name):
    """VTK reads the file, in single precision, and evaluates its own cells."""
    from vtkmodules.vtkIOExodus import vtkExodusIIReader

    reader = vtkExodusIIReader()
    reader.SetFileName(str(solvers / "exodus" / name))
    reader.Update()
    blocks = reader.GetOutput().GetBlock(0)
    source, conversion = Exodus([solvers / "exodus" / name]), convert(Exodus([solvers / "exodus" / name]))
    rng, checked = np.random.default_rng(0), 0
    for number, block in enumerate(source.blocks):
        grid = blocks.GetBlock(number)
        assert grid.GetNumberOfCells() == len(block)
        for row in range(0, len(block), 7):
            cell = grid.GetCell(row)
            a = np.sort(rng.uniform(0.1, 0.9, 3))
            point, weights = [a[0], a[1] - a[0], a[2] - a[1]], [0.0] * cell.GetNumberOfPoints()
            cell.InterpolateFunctions(point, weights)
            wanted = weights @ np.array([cell.GetPoints().GetPoint(i) for i in range(cell.GetNumberOfPoints())])
            found = positions_at(conversion, number, np.array([row]), 2 * np.array([point]) - 1)[0]
            assert np.abs(found - wanted).max() < 1e-7
            checked += 1
    assert checked > 3


def test_side_sets_lie_on_the_boundary(solvers):
    dataset = convert(Exodus([solvers / "exodus" / "simple-cube-multi-element-order2.e"])).dataset
    counts = sorted(sum(len(ids) for _, ids in c.parts) for c in dataset.mesh.composites if c.parts[0][0] in "FTQ")
    assert counts[:2] == [35, 35]


def field(x):
    """In the space of every element of order 2, serendipity ones included."""
    return 1 + x[:, 0] ** 2 - 2 * x[:, 1] * x[:, 0] + x[:, -1] ** 2


def one_element(path, name, values=field):
    """A file with one element whose corners are those of our reference shape."""
    shape, count = TYPES[name]
    nodes = nodes_of(shape, count)
    file = netcdf_file(str(path), "w", version=2)
    file.createDimension("time_step", None)
    sizes = {
        "num_nodes": count,
        "num_el_blk": 1,
        "one": 1,
        "num_nod": count,
        "len_name": 33,
        "sides": 1,
        "num_side_sets": 1,
    }
    for key, size in sizes.items():
        file.createDimension(key, size)
    for axis, column in zip("xyz", nodes.T, strict=False):
        file.createVariable(f"coord{axis}", "d", ("num_nodes",))[:] = column
    connect = file.createVariable("connect1", "i", ("one", "num_nod"))
    connect[:] = 1 + np.arange(count)[None]
    connect.elem_type = name.encode()
    names = file.createVariable("name_nod_var", "c", ("one", "len_name"))
    names[:] = np.array([list("temperature".ljust(33, "\0"))], "S1")
    own = file.createVariable("name_elem_var", "c", ("one", "len_name"))
    own[:] = np.array([list("flag".ljust(33, "\0"))], "S1")
    times = file.createVariable("time_whole", "d", ("time_step",))
    nodal = file.createVariable("vals_nod_var1", "d", ("time_step", "num_nodes"))
    flags = file.createVariable("vals_elem_var1eb1", "d", ("time_step", "one"))
    for step, time in enumerate((0.5, 1.5)):
        times[step], nodal[step], flags[step] = time, (1 + step) * values(nodes), 7.0 + step
    file.createVariable("elem_ss1", "i", ("sides",))[:] = 1
    file.createVariable("side_ss1", "i", ("sides",))[:] = 1
    file.close()
    return path


@pytest.mark.parametrize("name", TYPES)
def test_every_type_has_its_fields(tmp_path, name):
    shape, count = TYPES[name]
    is_linear = count == len(shape.vertices)
    wanted = (lambda x: 1 - x[:, 0] + 2 * x[:, 1]) if is_linear else field
    conversion = check(Exodus, [one_element(tmp_path / "one.e", name, wanted)])
    assert {measure.state for measure in conversion.report.fields} == {"exact"}
    assert conversion.dataset.time == 1.5
    inside = 0.3 * shape.vertices + 0.7 * shape.vertices.mean(axis=0)
    places = np.zeros((len(inside), 3))
    places[:, : shape.dimension] = inside
    assert np.abs(values_found(conversion.dataset, "temperature", places) - 2 * wanted(inside)).max() < 1e-12
    assert np.abs(values_found(conversion.dataset, "flag", places) - 8).max() < 1e-12


def test_pyramids_without_a_centre_node_have_the_functions_of_gmsh():
    gmsh = pytest.importorskip("gmsh")
    nodes = nodes_of(Shape.PYRAMID, 13)
    points = np.random.default_rng(3).dirichlet(np.ones(5), 40) @ Shape.PYRAMID.vertices
    gmsh.initialize(["test"], readConfigFiles=False, interruptible=False)
    try:
        local = np.array(gmsh.model.mesh.getElementProperties(19)[4]).reshape(-1, 3)
        own = native_points(Shape.PYRAMID, local[:5], local)
        order = [int(np.abs(own - node).max(axis=1).argmin()) for node in nodes]
        matrix, offset = affine_between(Shape.PYRAMID.vertices, local[:5])
        theirs = gmsh.model.mesh.getBasisFunctions(19, (points @ matrix.T + offset).reshape(-1), "Lagrange")[1]
    finally:
        gmsh.finalize()
    wanted = np.asarray(theirs).reshape(len(points), 13)[:, order]
    assert np.abs(_Functions(Shape.PYRAMID, 13).at(points) - wanted).max() < 1e-13


#: writes a cell whose nodes are where the library's own cell has them; in a process of its own, since where all of the
#: library is loaded its parallel writer takes the place of this one and crashes
WRITER = """
import sys
import numpy as np
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid
from vtkmodules.vtkIOExodus import vtkExodusIIWriter
grid, points, writer = vtkUnstructuredGrid(), vtkPoints(), vtkExodusIIWriter()
points.SetDataTypeToDouble()
for place in np.load(sys.argv[1]):
    points.InsertNextPoint(place)
grid.SetPoints(points)
grid.InsertNextCell(27, 13, list(range(13)))
writer.SetFileName(sys.argv[2])
writer.SetInputData(grid)
writer.Write()
"""


def test_pyramids_without_a_centre_node_have_the_node_order_of_another_writer(tmp_path):
    from vtkmodules.vtkCommonDataModel import vtkQuadraticPyramid

    local = np.array(vtkQuadraticPyramid().GetParametricCoords()).reshape(-1, 3)[:13]
    local[4] = (0.5, 0.5, 1)  # the cell's own coordinates are collapsed ones
    local[9:13] = (local[:4] + local[4]) / 2
    np.save(tmp_path / "nodes.npy", local)
    command = [sys.executable, "-c", WRITER, str(tmp_path / "nodes.npy"), str(tmp_path / "one.e")]
    subprocess.run(command, check=True, capture_output=True)
    source = Exodus([tmp_path / "one.e"])
    own = Shape.PYRAMID.vertices
    corners = source.positions(source.blocks[0], own)[0]
    inside = np.random.default_rng(3).dirichlet(np.ones(5), 20)
    # a straight pyramid: its map is linear
    assert np.abs(source.positions(source.blocks[0], inside @ own)[0] - inside @ corners).max() < 1e-14
    assert np.abs(corners - local[:5]).max() < 1e-14


@pytest.mark.parametrize("name", ["TET4", "WEDGE6", "HEX8", "PYRAMID5"])
def test_sides_are_the_faces_of_the_shape(name):
    shape, count = TYPES[name]
    nodes = nodes_of(shape, count)
    sides = {frozenset(map(tuple, nodes[list(side)].tolist())) for side in SIDES[shape]}
    assert sides == {frozenset(map(tuple, shape.vertices[list(face)].tolist())) for face in shape.faces}


def test_earlier_steps(tmp_path):
    path = one_element(tmp_path / "one.e", "HEX20")
    assert Exodus.times([path]) == [0.5, 1.5]
    source = Exodus([path], step="0")
    assert source.time == 0.5
    assert source.blocks[0].pyramid is PyramidSpace.RATIONAL
    with pytest.raises(FormatError, match="expected a step from 0 to 1, found 5"):
        Exodus([path], step="5")
    with pytest.raises(ElvisError, match="a number"):
        Exodus([path], step="last")


def test_bad_files(tmp_path, solvers):
    whole = (solvers / "exodus" / "simple-cube-tet10.e").read_bytes()
    (tmp_path / "half.e").write_bytes(whole[: len(whole) // 2])
    assert Exodus.opens([tmp_path / "half.e"])
    with pytest.raises(FormatError):
        Exodus([tmp_path / "half.e"])
    (tmp_path / "kind.e").write_bytes(whole.replace(b"TETRA10", b"TETQA10").replace(b"TETQA10", b"NSIDED1"))
    with pytest.raises(FormatError, match="found the type NSIDED1"):
        Exodus([tmp_path / "kind.e"])
    assert not Exodus.opens([solvers / "gmsh" / "mixed_o3.msh"])


WRITTEN = {"classic.e": write_classic, "other.e": write_hdf5}
WRITERS = pytest.mark.parametrize("write", [write_classic, write_hdf5])


@WRITERS
@pytest.mark.parametrize("counts", [(1, 0, 1), (0, 1, 1), (2, 1, 0), (0, 0, 3, 0, 2)])
def test_empty_blocks_and_sets_do_not_hide_others(tmp_path, write, counts):
    path = cubes_in_blocks(tmp_path / "row.e", write, counts)
    dataset = read(path)
    assert sum(len(entities) for entities in dataset.mesh.elements.values()) == sum(counts)
    names = [composite.name for composite in dataset.mesh.composites]
    assert {f"part{i}" for i, count in enumerate(counts) if count} <= set(names)
    ends = {"inflow": 0, "outflow": sum(counts)}
    for name, x in ends.items():
        area, moment = integrate(dataset, ["area", "x"], name)
        assert area.value == pytest.approx(1, abs=1e-13)
        assert moment.value == pytest.approx(x, abs=1e-13)


def test_a_declared_but_missing_block_is_an_error(tmp_path):
    classic, other = (cubes_in_blocks(tmp_path / name, write, (1, 1, 1)) for name, write in WRITTEN.items())
    classic.write_bytes(classic.read_bytes().replace(b"connect2", b"konnect2"))
    with h5py.File(other, "a") as file:
        del file["connect2"]
    for path in (classic, other):
        with pytest.raises(FormatError, match="connect2: expected 1 entries, found no variable"):
            read(path)


def test_skipped_elements_and_sides_are_named(tmp_path):
    places, nodes = unit_cubes(2)
    blocks = [ExodusBlock("solid", "HEX8", nodes), ExodusBlock("beam", "BEAM2", nodes[:, :2])]
    path = write_classic(tmp_path / "mixed.e", blocks, places, {"end": [(2, 2), (3, 1)]})
    remarks = " ".join(read(path).remarks)
    assert "mixed.e: 2 elements of lower dimension were skipped" in remarks
    assert "mixed.e: 1 of the 2 sides of the boundary 'end' were skipped" in remarks


def test_bars_are_a_curve_where_there_is_nothing_else(tmp_path):
    """The parabola y = x^2 from 0 to 2 in two parts, one of them given backwards."""
    places = np.array([(x, x * x, 0) for x in (0.0, 1.0, 2.0, 0.5, 1.5)])
    blocks = [ExodusBlock("wire", "BAR3", np.array([(0, 1, 3), (2, 1, 4)]))]
    dataset = read(write_classic(tmp_path / "wire.e", blocks, places, {"left": [(1, 1)], "right": [(2, 1)]}))
    length, moment = integrate(dataset, ["1", "x"])
    assert length.value == pytest.approx(np.sqrt(17) + np.arcsinh(4) / 4, abs=1e-10)
    assert moment.value == pytest.approx((17**1.5 - 1) / 12, abs=1e-10)
    ends = {part.name: dataset.mesh.vertices[part.parts[0][1]] for part in dataset.mesh.composites[1:]}
    assert ends.keys() == {"left", "right"}
    assert np.allclose(ends["left"], [[0, 0, 0]], rtol=0, atol=1e-15)
    assert np.allclose(ends["right"], [[2, 4, 0]], rtol=0, atol=1e-15)


def test_beams_with_a_direction_are_skipped(tmp_path):
    places, nodes = unit_cubes(1)
    blocks = [ExodusBlock("solid", "HEX8", nodes), ExodusBlock("beam", "BEAM", nodes[:, :4])]
    remarks = " ".join(read(write_classic(tmp_path / "mixed.e", blocks, places)).remarks)
    assert "mixed.e: 1 elements of lower dimension were skipped" in remarks


def test_missing_elements_are_an_error(tmp_path):
    path = cubes_in_blocks(tmp_path / "row.e", write_hdf5, (1, 2))
    with h5py.File(path, "a") as file:
        del file["num_elem"]
        file.create_dataset("num_elem", (4,), ">f4").make_scale("num_elem")
    with pytest.raises(FormatError, match="expected 4 elements, as the files declare, found 3"):
        read(path)


def test_unwritten_names_are_empty(tmp_path):
    path = cubes_in_blocks(tmp_path / "row.e", write_hdf5, (1, 1), unwritten=("eb_names", "ss_names"))
    names = [composite.name for composite in read(path).mesh.composites]
    assert names[:3] == ["block 1", "block 2", "sides 1"]


def test_names_end_at_their_first_zero(tmp_path):
    path = cubes_in_blocks(tmp_path / "row.e", write_hdf5, (1, 1))
    with h5py.File(path, "r+") as file:
        row = file["eb_names"][0]
        row[:8] = np.frombuffer(b"air\0?\xa4zG", "S1")
        file["eb_names"][0] = row
    assert read(path).mesh.composites[0].name == "air"


def test_unwritten_coordinates_are_an_error(tmp_path):
    path = cubes_in_blocks(tmp_path / "row.e", write_hdf5, (1, 1), unwritten=("coordy",))
    with pytest.raises(FormatError, match="expected 96 bytes as declared, found 0 stored"):
        read(path)


@WRITERS
def test_variables_of_some_blocks_exist_only_there(tmp_path, write):
    """At the orders of the file, at a tolerance, and as a step of a series."""
    places, nodes = unit_cubes(3)
    blocks = [ExodusBlock("left", "HEX8", nodes[:2]), ExodusBlock("right", "HEX8", nodes[2:])]
    own = {"stress": {1: [5.0, 6.0]}, "heat": {2: [7.0]}}
    path = write(tmp_path / "run.e", blocks, places, None, {"u": places[:, 0]}, own)
    points = np.array([(0.5, 0.4, 0.3), (1.5, 0.4, 0.3), (2.5, 0.4, 0.3)])
    wanted = {"u": [0.5, 1.5, 2.5], "stress": [5, 6, np.nan], "heat": [np.nan, np.nan, 7]}
    done = check(Exodus, [path])
    adapted = convert(Exodus([path]), Settings(tolerance=1e-9))
    for dataset in (done.dataset, adapted.dataset, read(path)):
        for name, values in wanted.items():
            assert values_found(dataset, name, points) == pytest.approx(values, nan_ok=True)
    assert integrate(read(path), ["u", "stress", "heat"])[1].value == pytest.approx(11)


def test_some_fields_are_converted_in_every_command(tmp_path, elvis, elvis_json):
    places, nodes = unit_cubes(1)
    blocks = [ExodusBlock("one", "HEX8", nodes)]
    path = write_classic(tmp_path / "run.e", blocks, places, None, {"u": places[:, 0], "map_x": places[:, 1]})
    with pytest.raises(ElvisError, match="expected no field 'map_x'"):
        read(path)
    assert list(read(path, reader={"fields": "u"})) == ["u"]
    assert [row["name"] for row in elvis_json("info", path, "--reader", "fields=u")["fields"]] == ["u"]
    assert "0.5" in elvis("probe", path, "--reader", "fields=u", "--point", "0.5,0.5,0.5")
    with pytest.raises(ElvisError, match="there is no field 'v'; the fields are u, map_x"):
        read(path, reader={"fields": "u, v"})


@pytest.mark.parametrize("name", ["TRI7", "TETRA14", "WEDGE20", "WEDGE21"])
def test_functions_with_bubbles(tmp_path, name):
    """In triangles 27 a b c is 1 in the middle and 0 on the edges; the map and values between nodes follow it."""
    shape, count = TYPES[name]

    def bubble(x):
        first, second = (1 + x[:, 0]) / 2, (1 + x[:, 2 if shape is Shape.PRISM else 1]) / 2
        rest = (1 - (x[:, 2] + 1) / 2) if shape is Shape.TETRAHEDRON else 1.0
        return 27 * first * second * (rest - first - second)

    def wanted(x):
        # on the tetrahedron, two of its faces have such functions here
        return 1 + x[:, 0] * x[:, 1] + (bubble(x) if count != 14 else 0)

    conversion = check(Exodus, [one_element(tmp_path / "one.e", name, wanted)])
    assert {measure.state for measure in conversion.report.fields} == {"exact"}
    inside = 0.3 * shape.vertices + 0.7 * shape.vertices.mean(axis=0)
    places = np.zeros((len(inside), 3))
    places[:, : shape.dimension] = inside
    assert np.abs(values_found(conversion.dataset, "temperature", places) - 2 * wanted(inside)).max() < 1e-12


def test_bubbles_of_tetrahedra_belong_to_their_faces():
    """Values at the middle of one face: 27 a b c of its corners, in the order of the nodes in libMesh's tables."""
    functions = _functions_of(Shape.TETRAHEDRON, 14)
    points = np.random.default_rng(5).dirichlet(np.ones(4), 30)
    table = functions.at(points @ Shape.TETRAHEDRON.vertices)
    for node, face in enumerate([(0, 1, 2), (1, 2, 3), (0, 2, 3), (0, 1, 3)], 10):
        assert np.abs(table[:, node] - 27 * points[:, list(face)].prod(axis=1)).max() < 1e-12


def test_bubbles_of_pyramids_match_those_of_libmesh():
    """In front 27 (c - y)/2 p1 p2 p4 z/c² with p1 = (c - y)/2, p2 = (c + x)/2, p4 = (c - x)/2 and c = 1 - z."""
    functions = _functions_of(Shape.PYRAMID, 18)
    rng = np.random.default_rng(6)
    z = rng.uniform(0, 0.9, 30)
    x, y = rng.uniform(-1, 1, (2, 30)) * (1 - z)
    # our height runs from -1 to 1, and our base does not shrink towards the apex at the origin
    points = np.stack([x - z, y - z, 2 * z - 1], axis=1)
    c = 1 - z
    for node, (s, t) in enumerate([(x, y), (y, -x), (-x, -y), (-y, x)], 14):
        front = 27 * (c - t) / 2 * (c - t) / 2 * (c + s) / 2 * (c - s) / 2 * z / c**2
        assert np.abs(functions.at(points)[:, node] - front).max() < 1e-12


@pytest.mark.parametrize(("name", "kind"), [("TETRA15", "vtkLagrangeTetra"), ("PYRAMID19", "vtkTriQuadraticPyramid")])
def test_elements_with_a_node_inside_have_the_functions_of_vtk(tmp_path, name, kind):
    """Any values at the nodes: those between them are the sums over the nodes that VTK finds with its own functions."""
    cells = pytest.importorskip("vtkmodules.vtkCommonDataModel")
    shape, count = TYPES[name]
    nodal = dict(zip(map(bytes, nodes_of(shape, count)), np.random.default_rng(7).normal(size=count), strict=True))
    path = one_element(tmp_path / "one.e", name, lambda nodes: np.array([nodal[bytes(node)] for node in nodes]))
    conversion = check(Exodus, [path])
    assert {measure.state for measure in conversion.report.fields} == {"exact"}
    places = np.random.default_rng(8).dirichlet(np.ones(len(shape.vertices)), 30) @ shape.vertices

    cell = getattr(cells, kind)()
    cell.GetPoints().SetNumberOfPoints(count)
    cell.GetPointIds().SetNumberOfIds(count)
    cell.Initialize()
    parametric = np.array([cell.GetParametricCoords()[i] for i in range(3 * count)]).reshape(-1, 3)
    # VTK's coordinates are affine in ours: the corners tell how
    corners = nodes_of(shape, count)[: len(shape.vertices)]
    affine, *_ = np.linalg.lstsq(np.column_stack([corners, np.ones(len(corners))]), parametric[: len(corners)])

    def weights(own):
        found = [0.0] * count
        cell.InterpolateFunctions((np.append(own, 1) @ affine).tolist(), found)
        return found

    order = [int(np.argmax(weights(node))) for node in nodes_of(shape, count)]
    wanted = np.array([weights(place) for place in places])[:, order] @ np.array(list(nodal.values()))
    assert sorted(order) == list(range(count))
    assert np.abs(values_found(conversion.dataset, "temperature", places) - 2 * wanted).max() < 1e-12


@pytest.mark.parametrize(
    ("name", "count", "words"),
    [
        ("TETRA11", 11, "expected a tetrahedron of 4, 10, 14 or 15 nodes, found TETRA11 of 11"),
        ("NSIDED", 5, "expected elements of the shapes segment, triangle, .*, found the type NSIDED"),
    ],
)
def test_unknown_elements_are_named(tmp_path, name, count, words):
    blocks = [ExodusBlock("fluid", name, np.arange(count)[None])]
    with pytest.raises(FormatError, match=words):
        read(write_classic(tmp_path / "a.e", blocks, np.zeros((count, 3)), {}, {}))
