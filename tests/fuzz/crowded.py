"""Crowded files, the shortest entries that a format has: ``python tests/fuzz/crowded.py [--size 16] [--only gmf,...]``.

Each file is as large as ``--size`` says, in millions of bytes, and consists of one kind of entry: vertices, elements,
sides, values, tokens, tables.  ``elvis info``, or the commands given with ``--command``, end with status 0 or with one
sentence.  Their memory stays below 20 times the files and 300 MB, or what the same command takes for a small file of
the same reader if that is more, because it opens a device.  Memory and seconds are those of all processes that a
command has waited for, the largest one's memory.
"""

from __future__ import annotations

import argparse
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from itertools import permutations
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from crowded_arrays import ARRAYS, Files, Maker
from large import BASE, outcome_of, run

from elvis.core.base.arrays import Floats, Ints

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

#: vertices of a cube, and one more in its middle: no number of one has two digits
PLACES = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)] + [(0.5, 0.5, 0.5)]
SEED = 20261130
#: size of a small file, in millions of bytes
SMALL = 0.02


def rows(size: int, columns: int, above: int, start: str = "", end: str = "\n", gap: str = " ", first: int = 1) -> str:
    """Rows of numbers from ``first`` to below ``above``, distinct in a row, as many as the size in bytes holds."""
    random = np.random.default_rng(SEED)
    width = len(start) + len(end) + columns * len(str(above - 1)) + len(gap) * (columns - 1)
    count = max(2, size // width)
    # distinct numbers of a row differ by steps that grow
    steps = 1 + random.integers(0, max(1, (above - first - 1) // columns), (count, columns))
    numbers = first + (random.integers(0, above - first, (count, 1)) + steps.cumsum(axis=1)) % (above - first)
    return "".join(start + gap.join(row) + end for row in numbers.astype(str).tolist())


def many(size: int, entry: str) -> tuple[str, int]:
    """An entry repeated, and how often."""
    count = max(1, size // len(entry))
    return entry * count, count


def counted(size: int, entry: str) -> str:
    """The number of entries, and these."""
    text, count = many(size, entry)
    return f"{count}\n{text}"


def lines(text: str) -> str:
    """The number of lines, and these."""
    return f"{text.count(chr(10))}\n{text}"


def grid(count: int, end: str = "\n") -> str:
    """Places of this many vertices, with short numbers: no two at one place."""
    side = int(np.ceil(count ** (1 / 3)))
    numbers = np.arange(count)
    table = np.stack([numbers % side, numbers // side % side, numbers // side**2], axis=1)
    return "".join(" ".join(row) + end for row in table.astype(str).tolist())


def strip(count: int, start: str = "", end: str = "\n", first: int = 1) -> str:
    """Tetrahedra of a helix, each of which shares three vertices with the one before it."""
    numbers = np.arange(first, first + count)[:, None] + np.arange(4)
    return "".join(start + " ".join(row) + end for row in numbers.astype(str).tolist())


def gmf(**sections: str) -> Files:
    """A GMF mesh of some sections; vertices are those of the cube if no others are given."""
    own = {"Vertices": lines("".join(f"{x} {y} {z} 0\n" for x, y, z in PLACES)), **sections}
    body = "".join(f"{name}\n{text}" for name, text in own.items())
    return {"a.mesh": f"MeshVersionFormatted 2\nDimension 3\n{body}End\n".encode()}


GMF: dict[str, Maker] = {
    "tetrahedra": lambda size: gmf(Tetrahedra=lines(rows(size, 4, 10, end=" 1\n"))),
    "one tetrahedron": lambda size: gmf(Tetrahedra=counted(size, "1 2 3 4 1\n")),
    "many faces": lambda size: gmf(
        Vertices=lines(grid(999, " 0\n")), Tetrahedra=lines(rows(size, 4, 1000, end=" 1\n"))
    ),
    "many vertices": lambda size: gmf(
        Vertices=lines(grid(99_999, " 0\n")), Tetrahedra=lines(rows(size - 1_200_000, 4, 100_000, end=" 1\n"))
    ),
    "helix": lambda size: gmf(
        Vertices=lines(grid(size // 38 + 4, " 0\n")), Tetrahedra=lines(strip(size // 38, end=" 1\n"))
    ),
    "hexahedra": lambda size: gmf(Hexahedra=lines(rows(size, 8, 10, end=" 1\n"))),
    "prisms": lambda size: gmf(Prisms=lines(rows(size, 6, 10, end=" 1\n"))),
    "pyramids": lambda size: gmf(Pyramids=lines(rows(size, 5, 10, end=" 1\n"))),
    "triangles": lambda size: gmf(Triangles=lines(rows(size, 3, 10, end=" 1\n"))),
    "triangles of many vertices": lambda size: gmf(
        Vertices=lines(grid(999, " 0\n")), Triangles=lines(rows(size, 3, 1000, end=" 1\n"))
    ),
    "sides": lambda size: gmf(Tetrahedra="1\n1 2 3 4 1\n", Triangles=lines(rows(size, 3, 10, end=" 1\n"))),
    "boundaries": lambda size: gmf(
        Tetrahedra="1\n1 2 3 4 1\n",
        Triangles=lines("".join(f"1 2 3 {i}\n" for i in range(size // 13))),
    ),
    "regions": lambda size: gmf(Tetrahedra=lines("".join(f"1 2 3 5 {i}\n" for i in range(size // 15)))),
    "vertices": lambda size: gmf(Vertices=counted(size, "0 0 0 0\n"), Tetrahedra="1\n1 2 3 4 1\n"),
    "comments": lambda size: {
        **gmf(Tetrahedra="1\n1 2 3 4 1\n"),
        "a.mesh": gmf(Tetrahedra="1\n1 2 3 4 1\n")["a.mesh"][:-4] + b"#\n" * (size // 2) + b"End\n",
    },
    "solution": lambda size: {
        **gmf(Vertices=counted(size // 5 * 4, "0 0 0 0\n"), Tetrahedra="1\n1 2 3 4 1\n"),
        "a.sol": (
            f"MeshVersionFormatted 2\nDimension 3\nSolAtVertices\n{size // 10}\n1 1\n" + "0\n" * (size // 10) + "End\n"
        ).encode(),
    },
}


def mfem(elements: str, vertices: str = "", boundary: str = "0\n", dimension: int = 3, more: str = "") -> Files:
    """An MFEM mesh."""
    places = vertices or lines("".join(f"{x} {y} {z}\n" for x, y, z in PLACES)).replace("\n", "\n3\n", 1)
    text = f"MFEM mesh v1.0\ndimension\n{dimension}\nelements\n{elements}boundary\n{boundary}vertices\n{places}{more}"
    return {"a.mesh": text.encode()}


ONE = "1\n1 4 0 1 2 3\n"
VALUES = "FiniteElementSpace\nFiniteElementCollection: {}\nVDim: 1\nOrdering: 0\n\n"
MFEM: dict[str, Maker] = {
    "helix": lambda size: mfem(
        lines(strip(size // 42, "1 4 ", first=0)), lines(grid(size // 42 + 4)).replace("\n", "\n3\n", 1)
    ),
    "triangles": lambda size: mfem(
        lines("".join(f"1 2 {i} {i + 1} {i + 2}\n" for i in range(size // 28))),
        lines("".join(f"{i} {i % 2}\n" for i in range(size // 28 + 3))).replace("\n", "\n2\n", 1),
        dimension=2,
    ),
    "segments": lambda size: mfem(
        lines(rows(size, 2, 9, "1 1 ", first=0)), "9\n1\n" + "\n".join("012345678") + "\n", dimension=1
    ),
    "attributes": lambda size: mfem(ONE, boundary=lines("".join(f"{i} 2 0 1 2\n" for i in range(1, size // 15)))),
    "vertices": lambda size: mfem(ONE, counted(size, "0 0 0\n").replace("\n", "\n3\n", 1)),
    "values": lambda size: {
        **mfem(lines(strip(size // 46, "1 4 ", first=0)), lines(grid(size // 46 + 4)).replace("\n", "\n3\n", 1)),
        "a.gf": (VALUES.format("H1_3D_P1") + "1\n" * (size // 46 + 3)).encode(),
    },
}


def gmsh(elements: str, nodes: str = "", more: str = "") -> Files:
    """A mesh of version 2.2."""
    places = nodes or lines("".join(f"{i} {x} {y} {z}\n" for i, (x, y, z) in enumerate(PLACES, 1)))
    text = f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n{places}$EndNodes\n$Elements\n{elements}$EndElements\n"
    return {"a.msh": (text + more).encode()}


def numbered(text: str) -> str:
    """Lines numbered from 1, and their number."""
    own = text.splitlines(keepends=True)
    return f"{len(own)}\n" + "".join(f"{i} {line}" for i, line in enumerate(own, 1))


def gmsh4(size: int) -> Files:
    """A mesh of version 4.1 with tetrahedra in one volume."""
    own = rows(size, 4, 10).splitlines()
    nodes = "\n".join(str(i) for i in range(1, 10)) + "\n" + "".join(f"{x} {y} {z}\n" for x, y, z in PLACES)
    text = "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 0 1\n1 0 0 0 1 1 1 0 0\n$EndEntities\n"
    text += f"$Nodes\n1 9 1 9\n3 1 0 9\n{nodes}$EndNodes\n"
    body = "\n".join(f"{i} {row}" for i, row in enumerate(own, 1))
    text += f"$Elements\n1 {len(own)} 1 {len(own)}\n3 1 4 {len(own)}\n{body}\n$EndElements\n"
    return {"a.msh": text.encode()}


GMSH: dict[str, Maker] = {
    "tetrahedra": lambda size: gmsh(numbered(rows(size * 10 // 17, 4, 10, "4 0 "))),
    "helix": lambda size: gmsh(numbered(strip(size // 54, "4 0 ")), numbered(grid(size // 54 + 4))),
    "tetrahedra 4.1": lambda size: gmsh4(size // 2),
    "nodes": lambda size: gmsh("1\n1 4 0 1 2 3 4\n", numbered("0 0 0\n" * (size // 13))),
    "values": lambda size: gmsh(
        numbered(rows(size // 3, 4, 10, "4 0 ")),
        more=f'$ElementData\n1\n"u"\n1\n0\n3\n0\n1\n{size // 25}\n'
        + "".join(f"{i} 1\n" for i in range(1, size // 25 + 1))
        + "$EndElementData\n",
    ),
}


def legacy(points: str, cells: str, types: str, more: str = "") -> Files:
    """A legacy VTK text."""
    head = "# vtk DataFile Version 3.0\na\nASCII\nDATASET UNSTRUCTURED_GRID\n"
    return {"a.vtk": f"{head}{points}{cells}{types}{more}".encode()}


POINTS = f"POINTS {len(PLACES)} double\n" + "".join(f"{x} {y} {z}\n" for x, y, z in PLACES)


def legacy_cells(size: int, corners: int, kind: int) -> Files:
    """A legacy VTK text of cells of one type."""
    own = rows(size * 10 // 13, corners, 9, f"{corners} ", first=0)
    count = own.count("\n")
    cells = f"CELLS {count} {count * (corners + 1)}\n{own}"
    return legacy(POINTS, cells, f"CELL_TYPES {count}\n" + f"{kind}\n" * count)


def vtu(size: int) -> Files:
    """Tetrahedra in a VTK XML text."""
    own = rows(size * 10 // 20, 4, 9, first=0)
    count = own.count("\n")
    points = "".join(f"{x} {y} {z} " for x, y, z in PLACES)
    ends = " ".join(map(str, range(4, 4 * count + 1, 4)))

    def array(name: str, kind: str, text: str, more: str = "") -> str:
        return f'<DataArray type="{kind}" Name="{name}" format="ascii"{more}>{text}</DataArray>'

    cells = array("connectivity", "Int32", own) + array("offsets", "Int32", ends)
    cells += array("types", "UInt8", "10 " * count)
    place = array("p", "Float64", points, ' NumberOfComponents="3"')
    piece = f'<Piece NumberOfPoints="{len(PLACES)}" NumberOfCells="{count}">'
    body = f"{piece}<Points>{place}</Points><Cells>{cells}</Cells></Piece>"
    head = '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian">'
    text = f"{head}<UnstructuredGrid>{body}</UnstructuredGrid></VTKFile>"
    return {"a.vtu": text.encode()}


def collection(size: int) -> Files:
    """A collection of VTK's with many entries."""
    entries = "".join(f'<DataSet timestep="{i}" file="a.vtu"/>' for i in range(size // 40))
    text = f'<VTKFile type="Collection"><Collection>{entries}</Collection></VTKFile>'
    return {"a.pvd": text.encode()}


VTK: dict[str, Maker] = {
    "tetrahedra": lambda size: legacy_cells(size, 4, 10),
    "triangles": lambda size: legacy_cells(size, 3, 5),
    "points": lambda size: legacy(
        f"POINTS {size // 6} double\n" + "0 0 0\n" * (size // 6), "CELLS 1 5\n4 0 1 2 3\n", "CELL_TYPES 1\n10\n"
    ),
    "xml": vtu,
    "collection": collection,
}


def netgen(points: str, elements: str, more: str = "") -> Files:
    """A mesh of Netgen's."""
    text = f"mesh3d\ndimension\n3\ngeomtype\n0\n{more}volumeelements\n{elements}points\n{points}endmesh\n"
    return {"a.vol": text.encode()}


CORNERS = lines("".join(f"{x} {y} {z}\n" for x, y, z in PLACES))
FACES = "facedescriptors\n1\n1 1 0 1 1\nsurfaceelements\n"
NGSOLVE: dict[str, Maker] = {
    "tetrahedra": lambda size: netgen(CORNERS, lines(rows(size, 4, 10, "1 4 "))),
    "many faces": lambda size: netgen(lines(grid(999)), lines(rows(size, 4, 1000, "1 4 "))),
    "helix": lambda size: netgen(lines(grid(size // 40 + 4)), lines(strip(size // 40, "1 4 "))),
    "surface": lambda size: netgen(CORNERS, "1\n1 4 1 2 3 4\n", FACES + lines(rows(size, 3, 10, "1 1 1 0 3 "))),
    "points": lambda size: netgen(counted(size, "0 0 0\n"), "1\n1 4 1 2 3 4\n"),
    "materials": lambda size: netgen(
        CORNERS, "1\n1 4 1 2 3 4\n", "materials\n" + lines("".join(f"{i} a\n" for i in range(1, size // 9)))
    ),
}


def patches(patch: str, more: str = "") -> Files:
    """NURBS volumes."""
    return {"a.json": f'{{"format":"elvis-nurbs","version":1,"patches":[{patch}]{more}}}'.encode()}


def line_of_points(count: int, more: str = "") -> str:
    """A patch of one element each, or of a line of ``count`` control points in x."""
    knots = "0," + ",".join(map(str, range(count))) + f",{count - 1}"
    x = ",".join(f"[{i},{y},{z}]" for z in (0, 1) for y in (0, 1) for i in range(count))
    values = ",".join("0" * 4 * count)
    lists = f'"knots":[[{knots}],[0,0,1,1],[0,0,1,1]],"points":[{x}],"fields":{{"u":[{values}]}}'
    return f'{{"degrees":[1,1,1],{lists}{more}}}'


NURBS: dict[str, Maker] = {
    "elements": lambda size: patches(line_of_points(size // 65)),
    "patches": lambda size: patches(",".join([line_of_points(2)] * (size // 180))),
    "lists": lambda size: patches("[]," * (size // 3) + "[]"),
    "tables": lambda size: patches(line_of_points(2), ',"more":[' + "{}," * (size // 3) + "{}]"),
    "boundaries": lambda size: patches(
        line_of_points(2), ',"boundaries":{"a":[' + '[0,"z-"],' * (size // 9) + '[0,"z-"]]}'
    ),
}


def native(**sections: str) -> Files:
    """A native mesh of some sections as text."""
    own = {
        "VERTEX": "".join(f'<V ID="{i}">{x} {y} {z}</V>' for i, (x, y, z) in enumerate(PLACES[:4])),
        "EDGE": "".join(f'<E ID="{i}">{a} {b}</E>' for i, (a, b) in enumerate(EDGES)),
        "FACE": "".join(f'<T ID="{i}">{a} {b} {c}</T>' for i, (a, b, c) in enumerate(TRIANGLES)),
        "ELEMENT": '<A ID="0">0 1 2 3</A>',
        "COMPOSITE": '<C ID="0">A[0]</C>',
        "DOMAIN": "C[0]",
        **sections,
    }
    body = "".join(f"<{name}>{text}</{name}>" for name, text in own.items())
    return {"a.xml": f'<NEKTAR><GEOMETRY DIM="3" SPACE="3">{body}</GEOMETRY></NEKTAR>'.encode()}


EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
TRIANGLES = ((0, 1, 2), (0, 4, 3), (1, 5, 4), (2, 5, 3))
NATIVE: dict[str, Maker] = {
    "vertices": lambda size: native(
        VERTEX="".join(f'<V ID="{i}">{i % 2} {i // 2 % 2} {i // 3 % 2}</V>' for i in range(size // 25))
    ),
    "edges": lambda size: native(
        EDGE="".join(f'<E ID="{i}">{EDGES[i % 6][0]} {EDGES[i % 6][1]}</E>' for i in range(size // 23))
    ),
    "faces": lambda size: native(
        FACE="".join(f'<T ID="{i}">{" ".join(map(str, TRIANGLES[i % 4]))}</T>' for i in range(size // 25))
    ),
    "elements": lambda size: native(
        ELEMENT="".join(f'<A ID="{i}">0 1 2 3</A>' for i in range(size // 27)),
        COMPOSITE=f'<C ID="0">A[0-{size // 27 - 1}]</C>',
    ),
    "composites": lambda size: native(
        COMPOSITE='<C ID="0">A[0]</C>' + "".join(f'<C ID="{i}">F[0]</C>' for i in range(1, size // 25))
    ),
    "tokens": lambda size: native(COMPOSITE='<C ID="0">A[0]</C><C ID="1">' + "F[0] " * (size // 5) + "</C>"),
    "numbers": lambda size: native(COMPOSITE='<C ID="0">A[0]</C><C ID="1">F[' + "0," * (size // 2) + "0]</C>"),
    "domain": lambda size: native(DOMAIN="C[" + "0," * (size // 2) + "0]"),
    "curves": lambda size: native(
        CURVED="".join(
            f'<E ID="{i}" EDGEID="0" NUMPOINTS="2" TYPE="PolyEvenlySpaced">0 0 0 1 0 0</E>' for i in range(size // 80)
        )
    ),
    "points of a curve": lambda size: native(
        CURVED=f'<E ID="0" EDGEID="0" NUMPOINTS="{size // 6}" TYPE="PolyEvenlySpaced">'
        + "0 0 0 " * (size // 6)
        + "</E>"
    ),
    "comments": lambda size: native(COMPOSITE='<C ID="0">A[0]</C>' + "<!---->" * (size // 7)),
    "tags": lambda size: {"a.xml": native()["a.xml"].replace(b"</NEKTAR>", b"<a/>" * (size // 4) + b"</NEKTAR>")},
    "parameters": lambda size: {
        "a.xml": native()["a.xml"].replace(
            b"</NEKTAR>",
            b"<CONDITIONS><PARAMETERS>"
            + b"".join(b"<P>a%d=1</P>" % i for i in range(size // 17))
            + b"</PARAMETERS></CONDITIONS></NEKTAR>",
        )
    },
    "metadata": lambda size: {
        **native(),
        "a.fld": b"<NEKTAR><Metadata>"
        + b"".join(b"<a%d>1</a%d>" % (i, i) for i in range(size // 20))
        + b"</Metadata></NEKTAR>",
    },
}


def boxed(size: int, bytes_of_index: int = 4) -> tuple[Floats, Ints]:
    """Vertices (n, 3) and tetrahedra (m, 4), from 0, of a cube of cubes: as many as arrays of this size hold.

    Six around a diagonal fill each cube, so that they match everywhere.
    """
    side = max(1, int((size / (24 * bytes_of_index + 24)) ** (1 / 3)))
    axis = np.arange(side + 1)
    z, y, x = (each.reshape(-1) for each in np.meshgrid(axis, axis, axis, indexing="ij"))
    steps = np.array([1, side + 1, (side + 1) ** 2])
    first = (np.arange(side)[:, None, None] * steps[2] + np.arange(side)[:, None] * steps[1] + np.arange(side)).ravel()
    cells = []
    for order in permutations(range(3)):
        ends = np.concatenate([[0], steps[list(order)].cumsum()])
        # odd permutations mirror the tetrahedron
        is_even = order in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
        cells.append(first[:, None] + (ends if is_even else ends[[1, 0, 2, 3]]))
    return np.stack([x, y, z], axis=1).astype(np.float64), np.concatenate(cells)


def binary_gmf(size: int) -> Files:
    """Matching tetrahedra in a binary file of version 3."""
    points, cells = boxed(size, 5)
    vertices = np.zeros(len(points), [("place", "<f8", 3), ("reference", "<i4")])
    vertices["place"] = points
    rows = np.ones((len(cells), 5), "<i4")
    rows[:, :4] = cells + 1
    text, start = struct.pack("<ii", 1, 3) + struct.pack("<iqi", 3, 24, 3), 24
    for code, table in ((4, vertices), (8, rows)):
        body = struct.pack("<i", len(table)) + table.tobytes()
        start = len(text) + 12 + len(body)
        text += struct.pack("<iq", code, start) + body
    return {"a.meshb": text + struct.pack("<iq", 54, 0)}


def written(write: Callable[[Path], object], name: str) -> Files:
    """The file that a writer of paths writes."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        return {name: path.read_bytes()}


def exodus(size: int, container: str = "hdf5") -> Files:
    """Matching tetrahedra in an Exodus file."""
    from exodus_writer import ExodusBlock, write_classic, write_hdf5

    points, cells = boxed(size)
    write = write_hdf5 if container == "hdf5" else write_classic
    return written(lambda path: write(path, [ExodusBlock("a", "TETRA", cells)], points), "a.e")


def cgns(size: int) -> Files:
    """Matching tetrahedra in a CGNS file."""
    import cgns_writing

    points, cells = boxed(size)
    section = cgns_writing.section("a", 10, 1, cells)
    zone = cgns_writing.unstructured("zone", points, len(cells), section)
    return written(lambda path: cgns_writing.write_hdf5(path, [cgns_writing.base(zone)], 4.0), "a.cgns")


def gmsh_binary(size: int) -> Files:
    """Matching tetrahedra in a binary mesh of version 2.2."""
    points, cells = boxed(size, 8)
    nodes = np.zeros(len(points), [("number", "<i4"), ("place", "<f8", 3)])
    nodes["number"], nodes["place"] = np.arange(1, len(points) + 1), points
    rows = np.ones((len(cells), 7), "<i4")
    rows[:, 0], rows[:, 3:] = np.arange(1, len(cells) + 1), cells + 1
    head = b"$MeshFormat\n2.2 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n"
    head += b"$Nodes\n%d\n" % len(nodes) + nodes.tobytes() + b"\n$EndNodes\n$Elements\n%d\n" % len(rows)
    return {"a.msh": head + struct.pack("<3i", 4, len(rows), 2) + rows.tobytes() + b"\n$EndElements\n"}


def native_hdf5(size: int) -> Files:
    """Matching tetrahedra in the native format's HDF5 files."""
    from elvis import Dataset, Shape, write
    from elvis.core.mapping.connectivity import connected

    points, cells = boxed(size, 16)
    mesh = connected(points, {Shape.TETRAHEDRON: cells})
    with TemporaryDirectory() as folder:
        write(Dataset(mesh), Path(folder) / "a.xml", mesh_format="hdf5")
        return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


BINARY: dict[str, Maker] = {
    "gmf": binary_gmf,
    "exodus": exodus,
    "netcdf": lambda size: exodus(size, "classic"),
    "cgns": cgns,
    "gmsh": gmsh_binary,
    "native": native_hdf5,
}


def table(rows: Floats | Ints, start: str = "", end: str = "\n") -> str:
    """Numbers (n, k), a line for each row."""
    return "".join(start + " ".join(map(str, row)) + end for row in rows.tolist())


def text_boxes(size: int, width: int) -> tuple[Ints, Ints]:
    """`boxed` with whole coordinates, for texts in which a tetrahedron takes about ``width`` bytes."""
    points, cells = boxed(size, width // 4)
    return points.astype(np.int64), cells


def text_gmf(size: int) -> Files:
    """Matching tetrahedra in a GMF text."""
    points, cells = text_boxes(size, 24)
    return gmf(Vertices=lines(table(points, end=" 0\n")), Tetrahedra=lines(table(cells + 1, end=" 1\n")))


def text_mfem(size: int) -> Files:
    """Matching tetrahedra in an MFEM text."""
    points, cells = text_boxes(size, 26)
    return mfem(lines(table(cells, "1 4 ")), lines(table(points)).replace("\n", "\n3\n", 1))


def text_gmsh(size: int) -> Files:
    """Matching tetrahedra in a text of Gmsh's version 2.2."""
    points, cells = text_boxes(size, 34)
    return gmsh(numbered(table(cells + 1, "4 0 ")), numbered(table(points)))


def text_gmsh4(size: int) -> Files:
    """Matching tetrahedra in a text of Gmsh's version 4.1."""
    points, cells = text_boxes(size, 30)
    count, end = len(points), int(points.max())
    text = f"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n0 0 0 1\n1 0 0 0 {end} {end} {end} 0 0\n$EndEntities\n"
    text += f"$Nodes\n1 {count} 1 {count}\n3 1 0 {count}\n{table(np.arange(1, count + 1)[:, None])}{table(points)}"
    body = table(np.column_stack([np.arange(1, len(cells) + 1), cells + 1]))
    text += f"$EndNodes\n$Elements\n1 {len(cells)} 1 {len(cells)}\n3 1 4 {len(cells)}\n{body}$EndElements\n"
    return {"a.msh": text.encode()}


def text_vtk(size: int) -> Files:
    """Matching tetrahedra in a legacy VTK text."""
    points, cells = text_boxes(size, 26)
    count = len(cells)
    places = f"POINTS {len(points)} double\n{table(points)}"
    return legacy(places, f"CELLS {count} {5 * count}\n{table(cells, '4 ')}", f"CELL_TYPES {count}\n" + "10\n" * count)


def text_netgen(size: int) -> Files:
    """Matching tetrahedra in a mesh of Netgen's."""
    points, cells = text_boxes(size, 26)
    return netgen(lines(table(points)), lines(table(cells + 1, "1 4 ")))


def text_native(size: int) -> Files:
    """Matching tetrahedra in the native format's XML."""
    from elvis import Dataset, Shape, write
    from elvis.core.mapping.connectivity import connected

    points, cells = boxed(size, 56)
    mesh = connected(points, {Shape.TETRAHEDRON: cells})
    return written(lambda path: write(Dataset(mesh), path, mesh_format="text"), "a.xml")


TEXTS: dict[str, Maker] = {
    "gmf": text_gmf,
    "mfem": text_mfem,
    "gmsh": text_gmsh,
    "gmsh 4.1": text_gmsh4,
    "vtk": text_vtk,
    "netgen": text_netgen,
    "native": text_native,
}

READERS: dict[str, dict[str, Maker]] = {
    "texts": TEXTS, "binary": BINARY, "native": NATIVE,
    "gmf": GMF, "mfem": MFEM, "gmsh": GMSH, "vtk": VTK, "ngsolve": NGSOLVE,
    "nurbs": NURBS, **ARRAYS,
}  # fmt: skip


def cases(readers: Sequence[str], kinds: Sequence[str]) -> Iterator[tuple[str, str, Maker]]:
    """Reader, kind and maker of files."""
    for reader in readers:
        for kind, make in READERS[reader].items():
            if not kinds or kind in kinds:
                yield reader, kind, make


def store(folder: Path, files: Files) -> None:
    """Write files into a folder."""
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(text)


def make_apart(folder: str, reader: str, kind: str, size: float) -> list[str]:
    """Names of the files of a kind, made in another process: the memory of a process starts with that of its parent."""
    words = ("--size", str(size), "--only", reader, "--kind", kind, "--keep", folder)
    subprocess.run([sys.executable, __file__, *words], check=True)
    return sorted(path.name for path in Path(folder).iterdir())


def filled(command: str, names: Sequence[str]) -> list[str]:
    """Words of a command with the files behind the first."""
    first, *rest = command.split()
    return [first, *names, *rest]


@cache
def base_of(reader: str, command: str) -> int:
    """Bytes that a command takes for a small file of a reader, at least those of the rule."""
    kind = next(iter(READERS[reader]))
    with TemporaryDirectory() as place:
        names = make_apart(place, reader, kind, SMALL)
        return max(BASE, outcome_of(Path(place), filled(command, names)).memory)


def main() -> int:
    """Print a line for each file; the exit status is 1 if one breaks the rule."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=float, default=16.0, help="of a file, in millions of bytes")
    parser.add_argument("--only", help="readers, commas between them")
    parser.add_argument("--kind", help="kinds of files, commas between them")
    parser.add_argument("--command", action="append", help="words of a command; files come behind the first")
    parser.add_argument("--keep", type=Path, help="only write the files into this folder")
    given = parser.parse_args()
    readers = given.only.split(",") if given.only else list(READERS)
    is_bad = False
    for reader, kind, make in cases(readers, given.kind.split(",") if given.kind else []):
        if given.keep is not None:
            store(given.keep, make(int(given.size * 1e6)))
            continue
        with TemporaryDirectory() as place:
            names = make_apart(place, reader, kind, given.size)
            for command in given.command or ["info"]:
                line = run(Path(place), names, filled(command, names), base_of(reader, command))
                is_bad |= line.endswith("FAULT")
                print(f"{reader}, {kind}: {line}", flush=True)
    return int(is_bad)


if __name__ == "__main__":
    sys.exit(main())
