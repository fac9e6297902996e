"""Data sets of many small pieces: the work is proportional to their number."""

import sys

import cgns_writing
import numpy as np
import pytest

import elvis
from elvis import Shape
from elvis.converters.shared.apart import Apart
from elvis.plugins.command.command import main

#: the work of four times as many pieces beyond that of twice as many is twice the work of twice as many beyond that
#: of one time; for work that grows with the square it is four times
MOST_GROWTH = 2.2
COUNTS = (16, 32, 64)

SQUARE = ((0, 0), (1, 0), (1, 1), (0, 1))

VTU = """<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid>
<Piece NumberOfPoints="{count}" NumberOfCells="{cells}">
<PointData><DataArray type="Float64" Name="u" format="ascii">{values}</DataArray></PointData>
<Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">{places}</DataArray></Points>
<Cells><DataArray type="Int64" Name="connectivity" format="ascii">{corners}</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">{ends}</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">{types}</DataArray></Cells>
</Piece></UnstructuredGrid></VTKFile>
"""

MESH = """MFEM mesh v1.0

dimension
2

elements
1
1 3 0 1 2 3

boundary
0

vertices
4
2
{places}

mfem_serial_mesh_end

communication_groups
number_of_groups 1

1 {number}

total_shared_vertices 0

mfem_mesh_end
"""

FUNCTION = """FiniteElementSpace
FiniteElementCollection: H1_2D_P1
VDim: 1
Ordering: 0

0
1
2
3
"""

MSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$Nodes
4
{nodes}
$EndNodes
$Elements
1
{element} 3 4 0 1 1 {part} {corners}
$EndElements
"""


def vtu(places, squares):
    """A grid of squares."""
    count, cells = len(places), len(squares)
    return VTU.format(
        count=count,
        cells=cells,
        values=" ".join(map(str, range(count))),
        places=" ".join(f"{x} {y} 0" for x, y in places),
        corners=" ".join(" ".join(map(str, square)) for square in squares),
        ends=" ".join(str(4 * i + 4) for i in range(cells)),
        types="9 " * cells,
    )


def vtk_pieces(folder, count):
    """Squares in a row, one in each file; each file is named as that of a process."""
    for i in range(count):
        yield write(folder / f"a_p{i}_000000.vtu", vtu([(x + i, y) for x, y in SQUARE], [range(4)]))


def vtk_rings(folder, count):
    """Rings around one point, one in each file, which all have the same middle."""
    squares = [(k, 4 + k, 4 + (k + 1) % 4, (k + 1) % 4) for k in range(4)]
    for i in range(count):
        places = [((2 * x - 1) * radius, (2 * y - 1) * radius) for radius in (i + 1, i + 2) for x, y in SQUARE]
        yield write(folder / f"a_p{i}_000000.vtu", vtu(places, squares))


def mfem_pieces(folder, count):
    """Squares in a row, one in each file, and its function in another file."""
    for i in range(count):
        places = "\n".join(f"{x + i} {y}" for x, y in SQUARE)
        yield write(folder / f"mesh.{i:06d}", MESH.format(places=places, number=i))
        yield write(folder / f"u.{i:06d}", FUNCTION)


def gmsh_pieces(folder, count):
    """Squares in a row, one partition in each file."""
    for i in range(count):
        numbers = [2 * (x + i) + y + 1 for x, y in SQUARE]
        nodes = "\n".join(f"{number} {x + i} {y} 0" for number, (x, y) in zip(numbers, SQUARE, strict=True))
        corners = " ".join(map(str, numbers))
        yield write(folder / f"m_{i + 1}.msh", MSH.format(nodes=nodes, element=i + 1, part=i + 1, corners=corners))


def cgns_zones(folder, count):
    """Squares in a row, each a zone with a boundary condition and a family of its own, in one file."""
    zones, families = [], []
    for i in range(count):
        points = np.array([(x + i, float(y)) for x, y in SQUARE])
        square = cgns_writing.section("cells", 7, 1, np.arange(4)[None])
        side = cgns_writing.section("side", 3, 2, np.array([[0, 1]]))
        wall = cgns_writing.condition("wall", "PointList", [[2]], "EdgeCenter", f"family{i}")
        values = cgns_writing.solution("flow", None, {"u": np.arange(4.0)})
        conditions = cgns_writing.conditions(wall)
        zones.append(cgns_writing.unstructured(f"zone{i}", points, 1, square, side, conditions, values))
        families.append(cgns_writing.node(f"family{i}", "Family_t"))
    path = folder / "a.cgns"
    cgns_writing.write_hdf5(path, [cgns_writing.base(*zones, *families, dimension=2)], 4.0)
    yield path


def write(path, text):
    path.write_text(text)
    return path


def run(*words):
    """A command that ends well."""
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    assert not end.value.code


def calls_of(function):
    """The number of calls of Python functions in a call."""
    count = 0

    def note(_frame, event, _given):
        nonlocal count
        count += event == "call"

    sys.setprofile(note)
    try:
        function()
    finally:
        sys.setprofile(None)
    return count


@pytest.mark.parametrize(
    ("pieces", "package"),
    [
        (vtk_pieces, "vtkmodules"),
        (vtk_rings, "vtkmodules"),
        (mfem_pieces, "mfem"),
        (gmsh_pieces, "gmsh"),
        (cgns_zones, "h5py"),
    ],
)
def test_the_work_of_pieces_is_proportional_to_their_number(tmp_path, pieces, package):
    pytest.importorskip(package)
    elvis.read(*pieces(tmp_path, 2))  # what is loaded once doesn't count
    counted = []
    for count in COUNTS:
        folder = tmp_path / str(count)
        folder.mkdir()
        paths = list(pieces(folder, count))
        counted.append(calls_of(lambda paths=paths: elvis.read(*paths)))
    one, two, four = counted
    assert 0 < four - two <= MOST_GROWTH * (two - one)
    squares = 4 if pieces is vtk_rings else 1
    assert len(elvis.read(*paths).mesh.entities[Shape.QUADRILATERAL]) == squares * COUNTS[-1]


@pytest.mark.parametrize(("pieces", "package"), [(vtk_pieces, "vtkmodules"), (gmsh_pieces, "gmsh")])
def test_the_memory_of_a_library_follows_the_largest_piece(tmp_path, monkeypatch, pieces, package):
    """It reads one piece after the other, so a damaged small one may not take what all of them may."""
    pytest.importorskip(package)
    sizes = []
    start = Apart.__init__

    def noted(self, worker, size):
        sizes.append(size)
        start(self, worker, size)

    monkeypatch.setattr(Apart, "__init__", noted)
    paths = list(pieces(tmp_path, 12))
    elvis.read(*paths, cache=False)
    assert sizes[-1] == max(path.stat().st_size for path in paths)


@pytest.mark.parametrize("command", ["convert", "probe"])
def test_the_work_of_commands_is_proportional_to_the_number_of_pieces(tmp_path, monkeypatch, command):
    pytest.importorskip("gmsh")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    counted = []
    for count in (2, *COUNTS):  # what is loaded once doesn't count
        folder = tmp_path / str(count)
        folder.mkdir()
        options = ("-o", folder / "a.xml") if command == "convert" else ("--point", "0.5,0.5", "--field", "x")
        words = (command, *gmsh_pieces(folder, count), *options)
        counted.append(calls_of(lambda words=words: run(*words)))
    _, one, two, four = counted
    assert 0 < four - two <= MOST_GROWTH * (two - one)
