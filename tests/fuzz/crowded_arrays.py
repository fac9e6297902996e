"""Crowded files that hold arrays, by reader, and small ones that declare much; `crowded` runs them."""

from __future__ import annotations

import io
import struct
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py
import numpy as np

from elvis.core.base.arrays import Floats, Ints

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))

#: texts by the name of their file; the command reads all of them
Files = dict[str, bytes]
Maker = Callable[[int], Files]

#: corners of the unit cube, the first coordinate fastest
CORNERS = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
#: a number of entries that no file of ours holds
MUCH = 2_000_000_000


def cubes(size: int, bytes_of_one: int) -> tuple[Floats, Ints, Floats]:
    """Matching cubes, as many as a file of this size holds: corners (n, 8, 3), their vertices (n, 8), and vertices."""
    side = max(1, int((size / bytes_of_one) ** (1 / 3)))
    grids = np.meshgrid(*[np.arange(side)] * 3, indexing="ij")
    low = np.stack([each.reshape(-1) for each in grids[::-1]], axis=1)
    places = low[:, None] + CORNERS
    axis = np.arange(side + 1.0)
    vertices = np.stack([each.reshape(-1) for each in np.meshgrid(axis, axis, axis, indexing="ij")[::-1]], axis=1)
    numbers = (places @ [1, side + 1, (side + 1) ** 2]).astype(np.int64)
    return places, numbers, vertices


def hdf5(fill: Callable[[h5py.File], object], name: str) -> Files:
    """The file that a function fills."""
    content = io.BytesIO()
    with h5py.File(content, "w") as file:
        fill(file)
    return {name: content.getvalue()}


def declared(file: h5py.File, name: str, shape: tuple[int, ...], kind: Any) -> None:
    """An array without stored values."""
    chunks = (min(shape[0], 1024), *shape[1:])
    file.create_dataset(name, shape, kind, chunks=chunks, compression="gzip")


def hopr(size: int) -> Files:
    """Matching hexahedra without neighbours' numbers in a HOPR mesh."""
    places, numbers, _ = cubes(size, 368)
    count = len(places)

    def fill(file: h5py.File) -> None:
        rows = np.arange(count)[:, None]
        firsts = np.concatenate([6 * rows, 6 * rows + 6, 8 * rows, 8 * rows + 8], axis=1)
        file["ElemInfo"] = np.concatenate([np.full((count, 2), (108, 1)), firsts], axis=1).astype(np.int32)
        sides = np.zeros((6 * count, 5), np.int32)
        sides[:, 0], sides[:, 1] = 4, np.arange(1, 6 * count + 1)
        file["SideInfo"] = sides
        file["GlobalNodeIDs"] = (numbers + 1).reshape(-1).astype(np.int32)
        file["NodeCoords"] = places.reshape(-1, 3)
        file["BCNames"] = np.array([b"wall"], "S255")
        file["BCType"] = np.array([[4, 1, 0, 0]], np.int32)
        file.attrs["Ngeo"], file.attrs["nElems"] = np.array([1]), np.array([count])

    return hdf5(fill, "a_mesh.h5")


def declared_hopr(_: int) -> Files:
    """A HOPR mesh that declares very many elements."""

    def fill(file: h5py.File) -> None:
        arrays = {"ElemInfo": (MUCH // 8, 6), "SideInfo": (MUCH, 5), "GlobalNodeIDs": (MUCH,)}
        for name, shape in arrays.items():
            declared(file, name, shape, np.int32)
        declared(file, "NodeCoords", (MUCH, 3), np.float64)
        file["BCNames"], file["BCType"] = np.array([b"wall"], "S255"), np.array([[4, 1, 0, 0]], np.int32)
        file.attrs["Ngeo"], file.attrs["nElems"] = np.array([1]), np.array([MUCH // 8])

    return hdf5(fill, "a_mesh.h5")


#: an element of PyFR's with eight nodes
HEXAHEDRON = np.dtype([("nodes", "<i8", (8,)), ("curved", "?"), ("faces", [("cidx", "<i2"), ("off", "<i8")], (6,))])
NODE = np.dtype([("location", "<f8", (3,)), ("valency", "<u2")])


def pyfr_head(file: h5py.File) -> None:
    """Groups of a PyFR mesh besides elements and nodes."""
    file["codec"], file["creator"] = np.array([b"eles/hex", b"bc/wall"], "S10"), np.bytes_("pyfr")
    file["mesh-uuid"], file["version"] = np.bytes_("0" * 36), 1
    file["eles/hex"].attrs["pts"] = 2 * CORNERS - 1


def pyfr(size: int) -> Files:
    """Matching hexahedra in a mesh of PyFR."""
    _, numbers, vertices = cubes(size, 160)

    def fill(file: h5py.File) -> None:
        elements = np.zeros(len(numbers), HEXAHEDRON)
        elements["nodes"], elements["faces"]["cidx"] = numbers, 1
        nodes = np.zeros(len(vertices), NODE)
        nodes["location"] = vertices
        file["eles/hex"], file["nodes"] = elements, nodes
        pyfr_head(file)

    return hdf5(fill, "a.pyfrm")


def declared_pyfr(_: int) -> Files:
    """A mesh of PyFR that declares very many hexahedra."""

    def fill(file: h5py.File) -> None:
        declared(file, "eles/hex", (MUCH,), HEXAHEDRON)
        declared(file, "nodes", (MUCH,), NODE)
        pyfr_head(file)

    return hdf5(fill, "a.pyfrm")


def horses_head(count: int) -> bytes:
    """The head of a mesh of HORSES3D."""
    return b"a".ljust(128, b"\0") + struct.pack("<4i7di", 1, 1, count, 12, 0.5, *(0.0,) * 6, 88)


def horses(size: int) -> Files:
    """Matching hexahedra in a mesh of HORSES3D."""
    places, _, _ = cubes(size, 212)
    nodes = places.mean(axis=1, keepdims=True) + (places - places.mean(axis=1, keepdims=True)) / np.sqrt(3)
    rows = np.zeros(len(places), [("head", "<i4", 5), ("nodes", "<f8", (8, 3))])
    rows["head"], rows["nodes"] = (4, 3, 2, 2, 2), nodes
    return {"a.hmesh": horses_head(len(rows)) + rows.tobytes() + struct.pack("<i", 99)}


def trixi_solution(mesh: str, kind: str, count: int, stored: int) -> Files:
    """A Trixi solution that stores only some of its values."""

    def fill(file: h5py.File) -> None:
        head = {"ndims": 2, "equations": "E", "polydeg": 1, "n_vars": 1, "n_elements": count, "mesh_type": kind}
        for name, value in (head | {"mesh_file": mesh, "time": 0.5, "timestep": 1}).items():
            file.attrs[name] = value
        if stored:
            file["variables_1"] = np.arange(4.0 * stored) % 7
        else:
            declared(file, "variables_1", (4 * count,), np.float64)
        file["variables_1"].attrs["name"] = "u"

    return hdf5(fill, "a.h5")


def structured(side: int, stored: int) -> Files:
    """A structured mesh of Trixi's of side x side elements."""

    def fill(file: h5py.File) -> None:
        head = {"mesh_type": "StructuredMesh", "ndims": 2, "size": np.array([side, side])}
        for name, value in (head | {"mapping": "mapping(x, y) = (x, y)", "periodicity": np.array([0, 0])}).items():
            file.attrs[name] = value

    return {**trixi_solution("mesh.h5", "StructuredMesh", side * side, stored), **hdf5(fill, "mesh.h5")}


def trixi(size: int) -> Files:
    """Values on squares."""
    side = int((size / 32) ** 0.5)
    return structured(side, side * side)


def nek_head(count: int, contents: str = "XP") -> bytes:
    """The head of a field of elements of two points in each direction."""
    sizes = f" 2  2  2 {count:10d} {count:10d}"
    head = f"#std 8 {sizes}  0.5000000000000E+00         1      0      1 {contents}"
    return head.ljust(132).encode() + struct.pack("<f", 6.54321)


def nek(size: int) -> Files:
    """Matching hexahedra with a pressure in a field of Nek5000."""
    places, _, _ = cubes(size, 260)
    numbers = np.arange(1, len(places) + 1, dtype="<i4").tobytes()
    position = places.transpose(0, 2, 1).astype("<f8").tobytes()
    return {"a0.f00001": nek_head(len(places)) + numbers + position + places[:, :, 0].astype("<f8").tobytes()}


def nek_mesh(size: int, rows: int = 0) -> Files:
    """A field of one element, and a mesh with very many boundary conditions, or one that declares ``rows`` of them."""
    stored = size // 64
    table = np.zeros((stored, 8))
    table[:, 0], table[:, 1] = 1, np.arange(stored) % 6 + 1
    table.view("S8")[:, 7] = b"W  "
    head = f"#v002 {1:9d} {3:2d} {1:9d} hdr".ljust(80).encode() + struct.pack("<f", 6.54321)
    body = np.zeros(25).tobytes() + np.array([0.0]).tobytes() + np.array([float(rows or stored)]).tobytes()
    return {**nek(260), "a.re2": head + body + table.tobytes()}


def mfem_piece(count: int, first: int) -> bytes:
    """A piece of a helix of tetrahedra."""
    numbers = np.arange(count)[:, None] + np.arange(4)
    elements = "".join("1 4 " + " ".join(row) + "\n" for row in numbers.astype(str).tolist())
    height = first + np.arange(count + 3)
    places = np.stack([np.cos(2.3 * height), np.sin(2.3 * height), height], axis=1)
    vertices = "".join(" ".join(f"{x:.6g}" for x in row) + "\n" for row in places.tolist())
    head = f"MFEM mesh v1.0\ndimension\n3\nelements\n{count}\n{elements}boundary\n0\nvertices\n{count + 3}\n3\n"
    return (head + vertices).encode()


def mfem_pieces(size: int, of_each: int) -> Files:
    """Pieces of some elements each."""
    bytes_of_piece = len(mfem_piece(of_each, 1000 * of_each))
    count = max(2, size // bytes_of_piece)
    return {f"mesh.{number:06d}": mfem_piece(of_each, number * of_each) for number in range(count)}


def vtkhdf(size: int) -> Files:
    """Matching hexahedra in a .vtkhdf."""
    _, numbers, vertices = cubes(size, 104)

    def fill(file: h5py.File) -> None:
        root = file.create_group("VTKHDF")
        root.attrs.create("Type", np.bytes_("UnstructuredGrid"))
        root.attrs["Version"] = [2, 0]
        sizes = {"NumberOfPoints": len(vertices), "NumberOfCells": len(numbers)}
        for name, count in (sizes | {"NumberOfConnectivityIds": numbers.size}).items():
            root[name] = [count]
        root["Points"], root["Connectivity"] = vertices, numbers[:, [0, 1, 3, 2, 4, 5, 7, 6]].reshape(-1)
        root["Offsets"] = 8 * np.arange(len(numbers) + 1)
        root["Types"] = np.full(len(numbers), 12, np.uint8)

    return hdf5(fill, "a.vtkhdf")


def declared_vtkhdf(_: int) -> Files:
    """A .vtkhdf that declares very many cells."""

    def fill(file: h5py.File) -> None:
        root = file.create_group("VTKHDF")
        root.attrs.create("Type", np.bytes_("UnstructuredGrid"))
        for name in ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds"):
            root[name] = [MUCH]
        arrays: dict[str, tuple[tuple[int, ...], Any]] = {
            "Points": ((MUCH, 3), np.float64), "Connectivity": ((MUCH,), np.int64),
            "Offsets": ((MUCH + 1,), np.int64), "Types": ((MUCH,), np.uint8),
        }  # fmt: skip
        for name, (shape, kind) in arrays.items():
            declared(file, f"VTKHDF/{name}", shape, kind)

    return hdf5(fill, "a.vtkhdf")


def appended(size: int, is_short: bool = False) -> Files:
    """Matching hexahedra in a .vtu with appended raw arrays; a short one declares more cells than it holds."""
    _, numbers, vertices = cubes(size, 89)
    cells = numbers[:, [0, 1, 3, 2, 4, 5, 7, 6]].astype("<i8")
    ends = np.arange(8, 8 * len(cells) + 1, 8, dtype="<i8")
    arrays = {"Points": vertices, "connectivity": cells, "offsets": ends, "types": np.full(len(cells), 12, np.uint8)}
    kinds = {"<f8": "Float64", "<i8": "Int64", "|u1": "UInt8"}
    data, parts = b"", {}
    for name, array in arrays.items():
        more = ' NumberOfComponents="3"' if name == "Points" else ""
        kind = kinds[array.dtype.str]
        parts[name] = f'<DataArray type="{kind}" Name="{name}"{more} format="appended" offset="{len(data)}"/>'
        data += struct.pack("<Q", array.nbytes) + array.tobytes()
    own = "".join(parts[name] for name in ("connectivity", "offsets", "types"))
    count = MUCH if is_short else len(cells)
    head = '<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">'
    head += f'<UnstructuredGrid><Piece NumberOfPoints="{len(vertices)}" NumberOfCells="{count}">'
    head += f"<Points>{parts['Points']}</Points><Cells>{own}</Cells></Piece></UnstructuredGrid>"
    return {"a.vtu": head.encode() + b'<AppendedData encoding="raw">_' + data + b"</AppendedData></VTKFile>"}


def archive(places: Floats, numbers: Ints, is_compressed: bool = False) -> Files:
    """Linear hexahedra as a script of ours writes them from NGSolve."""
    around = [0, 1, 3, 2, 4, 5, 7, 6]
    arrays = {
        "hex_elem": np.arange(len(places)),
        "hex_verts": numbers[:, around],
        "hex_ref": CORNERS,
        "hex_xyz": places,
        "hex_f_u": places[:, :, :1],
        "order": np.array([1, 1]),
    }
    content = io.BytesIO()
    (np.savez_compressed if is_compressed else np.savez)(content, **arrays)
    return {"a.elems.npz": content.getvalue()}


def npz(size: int) -> Files:
    """Matching hexahedra in an archive of NumPy's."""
    places, numbers, _ = cubes(size, 328)
    return archive(places, numbers)


def compressed_npz(size: int) -> Files:
    """Many elements at one place, which take few bytes."""
    count = min(size, 4_000_000) // 8
    return archive(np.zeros((count, 8, 3)), np.zeros((count, 8), np.int64), is_compressed=True)


def elvisdat(size: int) -> Files:
    """Matching hexahedra of the first ElVis."""
    places, _, _ = cubes(size, 292)
    rows = np.zeros(
        len(places),
        [("type", ">i4", 2), ("range", ">f8", 2), ("vertices", ">f8", (8, 3)), ("degrees", ">i4", 3), ("c", ">f8", 8)],
    )
    rows["type"], rows["degrees"] = (1, 0), 1
    rows["vertices"] = places[:, [0, 1, 3, 2, 4, 5, 7, 6]]
    return {"a.dat": b"many".ljust(24) + struct.pack(">2i", 1, len(rows)) + rows.tobytes()}


def declared_elvisdat(text: bytes) -> bytes:
    """The file with a number of elements that it doesn't hold."""
    return text[:28] + struct.pack(">i", MUCH) + text[32:]


def mixed_elvisdat(size: int) -> Files:
    """Hexahedra of the first ElVis, no two neighbours of one degree."""
    kinds = []
    for degree in (0, 1):
        text = struct.pack(">2i2d", 1, 0, 0, 0) + (2 * CORNERS - 1).astype(">f8").tobytes()
        kinds.append(text + struct.pack(">3i", degree, 0, 0) + np.zeros(degree + 1, ">f8").tobytes())
    count = size // len(b"".join(kinds))
    return {"a.dat": b"mixed".ljust(24) + struct.pack(">2i", 1, 2 * count) + b"".join(kinds) * count}


def adf(size: int) -> Files:
    """Matching hexahedra in an older CGNS file."""
    import cgns_writing as writing

    _, numbers, vertices = cubes(size, 56)
    section = writing.section("a", 17, 1, numbers[:, [0, 1, 3, 2, 4, 5, 7, 6]])
    zone = writing.unstructured("zone", vertices, len(numbers), section)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.cgns"
        writing.write_adf(path, [writing.base(zone)], 3.3)
        return {path.name: path.read_bytes()}


def adf_nodes(size: int) -> Files:
    """An older CGNS file of many nodes without data."""
    import cgns_writing as writing

    many = [writing.node(f"n{number}", "UserDefinedData_t") for number in range(size // 300)]
    zone = writing.structured("Box", writing.grid(2, 2, 2), *many)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "a.cgns"
        writing.write_adf(path, [writing.base(zone)], 3.3)
        return {path.name: path.read_bytes()}


def vtx(size: int) -> dict[str, bytes]:
    """Matching hexahedra in a folder of ADIOS2's."""
    import vtx_writer as writing

    _, numbers, vertices = cubes(size, 120)
    arrays = {
        "geometry": [vertices],
        "connectivity": [np.column_stack([np.full(len(numbers), 8), numbers[:, [0, 1, 3, 2, 4, 5, 7, 6]]])],
        "vtkOriginalPointIds": [np.arange(len(vertices))],
        "u": [vertices[:, :1]],
    }
    with TemporaryDirectory() as folder:
        path = writing.write_vtx(Path(folder) / "u.bp", 72, [(0.5, arrays)], writing.schema_of(["u"], []))
        return {f"u.bp/{own.name}": own.read_bytes() for own in path.iterdir()}


ARRAYS: dict[str, dict[str, Maker]] = {
    "hopr": {"hexahedra": hopr, "declared": declared_hopr},
    "pyfr": {"hexahedra": pyfr, "declared": declared_pyfr},
    "horses": {"hexahedra": horses, "declared": lambda _: {"a.hmesh": horses_head(MUCH)}},
    "trixi": {"squares": trixi, "declared": lambda _: structured(40_000, 0)},
    "nek": {
        "hexahedra": nek,
        "declared": lambda _: {"a0.f00001": nek_head(MUCH)},
        "boundaries": nek_mesh,
        "declared boundaries": lambda _: nek_mesh(64, MUCH),
    },
    "mfem pieces": {
        "many": lambda size: mfem_pieces(size, 20),
        "large": lambda size: mfem_pieces(size, max(20, size // 160)),
    },
    "vtkhdf": {"hexahedra": vtkhdf, "declared": declared_vtkhdf},
    "vtu": {"hexahedra": appended, "declared": lambda _: appended(1000, is_short=True)},
    "npz": {"hexahedra": npz, "compressed": compressed_npz},
    "elvisdat": {
        "hexahedra": elvisdat,
        "mixed": mixed_elvisdat,
        "declared": lambda _: {"a.dat": declared_elvisdat(elvisdat(300)["a.dat"])},
    },
    "adf": {"hexahedra": adf, "nodes": adf_nodes},
}  # fmt: skip
if find_spec("adios2") is not None:
    ARRAYS["vtx"] = {"hexahedra": vtx}
