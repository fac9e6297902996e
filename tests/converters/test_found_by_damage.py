"""What damaged files have shown: each fault that ended in a traceback, a hang or a crash, made small."""

import shutil
import struct
import tracemalloc
from contextlib import suppress

import h5py
import numpy as np
import pytest
from exodus_writer import ExodusBlock, cubes_in_blocks, unit_cubes, write_classic, write_hdf5
from trixi_writer import Brick, write_solution

from elvis.converters.cgns.cgns import Cgns
from elvis.converters.exodus.exodus import Exodus
from elvis.converters.gmf.files import KEYWORDS, GmfFile
from elvis.converters.gmsh.binary import check
from elvis.converters.gmsh.gmsh import Gmsh
from elvis.converters.hopr import Hopr
from elvis.converters.mfem.mfem import Mfem
from elvis.converters.nek.nek import Nek
from elvis.converters.ngsolve.ngsolve import NGSolve
from elvis.converters.pyfr.pyfr import PyFR
from elvis.converters.trixi.trixi import Trixi
from elvis.core.base.errors import FormatError
from elvis.core.distances.triangle_files import triangles_of
from elvis.renderer.passes.solids.hits import triangles


def put(name, row, column, value):
    def change(file):
        values = file[name][()]
        values[row, column] = value
        file[name][...] = values

    return change


def instead(name, values):
    def change(file):
        attributes = dict(file[name].attrs)
        del file[name]
        file[name] = values
        file[name].attrs.update(attributes)

    return change


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (put("ElemInfo", 0, 2, 384), "ElemInfo: expected sides 0 to 383, found 5 to 384"),
        (put("ElemInfo", 0, 2, -1), "ElemInfo: expected sides 0 to 383, found -1 to"),
        (put("ElemInfo", 0, slice(4, 6), (-8, 0)), "ElemInfo: expected nodes 0 to 511, found -8 to"),
        (put("ElemInfo", 0, slice(4, 6), (512, 520)), "ElemInfo: expected nodes 0 to 511, found"),
        (instead("ElemInfo", np.zeros((64, 4), int)), "ElemInfo: expected 6 numbers an element, found 4"),
        (instead("ElemInfo", np.zeros((1, 64, 6), int)), r"ElemInfo: expected whole numbers of shape \(n, n\), found"),
        (instead("NodeCoords", np.zeros((511, 3))), r"NodeCoords: expected numbers of shape \(512, 3\), found"),
        (instead("SideInfo", np.zeros(5)), "SideInfo: expected whole numbers"),
        (instead("BCNames", np.zeros(5)), "BCNames: expected a list of strings"),
        (lambda file: file.attrs.modify("Ngeo", 10**9), "Ngeo: expected an order from 1 to 30, found 1000000000"),
        (lambda file: file.attrs.create("Ngeo", np.nan), "expected a number in the attribute Ngeo, found"),
    ],
)
def test_meshes_of_hopr(solvers, tmp_path, change, sentence):
    path = tmp_path / "a.h5"
    shutil.copyfile(solvers / "hopr_flexi" / "cavity4x4x4_mesh.h5", path)
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(FormatError, match=rf"a\.h5: {sentence}"):
        Hopr([path])


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (instead("mesh-uuid", np.zeros(3)), "mesh-uuid: expected a list of strings"),
        (instead("codec", np.zeros(3)), "codec: expected a list of strings"),
        (
            lambda file: file["eles/hex"].attrs.create("pts", np.zeros(3)),
            r"expected points, found numbers of shape \(3,\)",
        ),
        (
            instead("nodes", np.zeros(3, [("location", "f8", (5,))])),
            r"nodes: expected positions, found numbers of shape",
        ),
    ],
)
def test_meshes_of_pyfr(solvers, tmp_path, change, sentence):
    path = tmp_path / "a.pyfrm"
    shutil.copyfile(solvers / "pyfr" / "mixed3d_p3.pyfrm", path)
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(FormatError, match=sentence):
        PyFR([path]) if "uuid" not in sentence else PyFR([path, solvers / "pyfr" / "mixed3d_p3-01.pyfrs"])


@pytest.mark.parametrize(
    ("name", "values", "sentence"),
    [
        ("hex_verts", np.float64(1.0), "hex_verts: expected numbers of 2 dimensions, found float64 of shape"),
        ("hex_xyz", np.int64(1), "hex_xyz: expected numbers of 3 dimensions, found int64 of shape"),
        ("hex_region", np.array("x"), r"hex_region: expected \d+ names, found \(\)"),
        ("order", np.arange(36), r"order: expected orders from 0 to 30, found 0, 1, 2, 3, 4, 5, 6, 7, 8$"),
        ("order", np.array("x"), "order: expected orders from 0 to 30, found none"),
        ("time", np.zeros(3), "time: expected one number"),
    ],
)
def test_samples_of_ngsolve(solvers, tmp_path, name, values, sentence):
    with np.load(solvers / "ngsolve" / "hexprism_p3_hex.elems.npz") as file:
        np.savez(tmp_path / "a.npz", **{**file, name: values})
    with pytest.raises(FormatError, match=rf"a\.npz: {sentence}"):
        NGSolve([tmp_path / "a.npz"])


def test_a_netgen_mesh_with_foreign_curves_is_read_or_rejected(solvers, tmp_path):
    pytest.importorskip("ngsolve")
    text = (solvers / "ngsolve" / "ballbox_p4.vol").read_text()
    assert text.count("\n1 4 118 124 133 183") == 1
    (tmp_path / "a.vol").write_text(text.replace("\n1 4 118 124 133 183", "\n1 4 3 124 133 183"))
    with suppress(FormatError):
        NGSolve([tmp_path / "a.vol"])


def test_cgns_names_that_are_not_text(solvers, tmp_path):
    pytest.importorskip("gmsh")
    path = tmp_path / "a.cgns"
    shutil.copyfile(solvers / "cgns" / "gmsh_mixed_o2.cgns", path)
    with h5py.File(path, "r+") as file:
        file["gmsh_mixed_o2.cgns/S_1/wall/ data"][...] = np.full(4, -1, np.int8)
        file["gmsh_mixed_o2.cgns/mixed_Part0/ZoneBC/S_2/FamilyName/ data"][...] = np.full(3, -1, np.int8)
    assert len(Cgns([path]).blocks) == len(Cgns([solvers / "cgns" / "gmsh_mixed_o2.cgns"]).blocks)


@pytest.mark.parametrize("count", [2**62, 2**64 - 1])
def test_gmsh_sections_with_too_many_blocks(tmp_path, count):
    head = b"$MeshFormat\n4.1 1 8\n" + struct.pack("<i", 1) + b"\n$EndMeshFormat\n"
    blocks = struct.pack("<4Q", 1, 0, 0, 0) + struct.pack("<3iQ", 3, 1, 4, count)
    raw = head + b"$Elements\n" + blocks + bytes(64) + b"\n$EndElements\n"
    with pytest.raises(FormatError, match="expected the number of bytes that its counts require"):
        check(tmp_path / "a.msh", raw, lambda kind: 4)


def test_gmf_solutions_with_too_many_nodes(tmp_path):
    name = next(name for name, keyword in KEYWORDS.items() if keyword.solution == "ho")
    header = struct.pack("<5i", 1, 2, 3, 20, 3)  # version 2; the next section begins at byte 20
    solution = struct.pack("<7i", KEYWORDS[name].code, 0, 1, 1, 1, 3, 2**31 - 1)
    (tmp_path / "a.solb").write_bytes(header + solution + bytes(64))
    with pytest.raises(FormatError, match=r"a\.solb: .*: expected 2147483647 numbers a row, found fewer"):
        GmfFile(tmp_path / "a.solb")


@pytest.mark.parametrize("read", [triangles_of, triangles])
def test_triangles_without_dimension(tmp_path, read):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1\nf 1 2 3\n")
    with pytest.raises(FormatError, match=r"a\.obj: expected"):
        read(str(tmp_path / "a.obj"))


MFEM = """MFEM mesh v1.0
dimension
3
elements
1
1 4 0 1 2 3
boundary
1
3 2 0 1 2
vertices
4
3
0 0 0
1 0 0
0 1 0
0 0 1
"""
MFEM_NC = """MFEM NC mesh v1.0
dimension
2
elements
1
0 1 3 0 0 1 2 3
boundary
0
coordinates
4
2
0 0
1 0
1 1
0 1
mfem_mesh_end
"""
OTHER_DIMENSIONS = [
    (MFEM, "dimension\n3", "dimension\n0", "dimension: expected a dimension from 1 to 3, found 0"),
    (MFEM, "dimension\n3", "dimension\n4", "dimension: expected a dimension from 1 to 3, found 4"),
    (MFEM, "dimension\n3", "dimension\n2", "elements 0: expected a geometry of dimension 2, found geometry 4, of"),
    (MFEM, "1 4 0 1 2 3", "1 2 0 1 2", "elements 0: expected a geometry of dimension 3, found geometry 2, of"),
    (MFEM, "3 2 0 1 2", "3 0 0", "boundary 0: expected a geometry of dimension 2, found geometry 0, of dimension 0"),
    (MFEM, "4\n3\n", "4\n2\n", "vertices: expected vertices with 3 coordinates, found 2"),
    (MFEM, "4\n3\n", "4\n0\n", "vertices: expected vertices with 3 coordinates, found 0"),
    (MFEM, "4\n3\n", "4\n4\n", "vertices: expected vertices with 3 coordinates, found 4"),
    (MFEM_NC, "dimension\n2", "dimension\n1", "elements: expected elements of dimension 1, found some with 4 vertices"),
    (
        MFEM_NC,
        "4\n2\n0 0\n1 0\n1 1\n0 1",
        "4\n1\n0\n1\n1\n0",
        "vertices: expected vertices with 2 to 3 coordinates, found 1",
    ),
]


@pytest.mark.parametrize(("text", "old", "new", "message"), OTHER_DIMENSIONS)
def test_mfem_elements_of_another_dimension_than_the_mesh_are_rejected(tmp_path, text, old, new, message):
    pytest.importorskip("mfem")
    path = tmp_path / "a.mesh"
    path.write_text(text)
    assert len(Mfem([path]).blocks) == 1
    assert text.count(old) == 1
    path.write_text(text.replace(old, new))
    with pytest.raises(FormatError, match=rf"a\.mesh: {message}"):
        Mfem([path])


@pytest.mark.parametrize("width", ["099999999", "*", "-0999", "9999999999999999999"])
def test_nek_templates_of_overlong_names(tmp_path, width):
    path = tmp_path / "run.nek5000"
    path.write_text(f"filetemplate: run%01d.f%{width}d\nfirsttimestep: 1\nnumtimesteps: 2\n")
    tracemalloc.start()
    with pytest.raises(FormatError, match=r"run\.nek5000: expected filetemplate, firsttimestep and numtimesteps"):
        Nek([path])
    assert tracemalloc.get_traced_memory()[1] < 1 << 24
    tracemalloc.stop()


@pytest.mark.parametrize("digits", [20, 5000])
@pytest.mark.parametrize("old", ["15 54 53 2", " 54 53 2 -1", "3 15 54 53"])
def test_netgen_meshes_with_too_many_points(solvers, tmp_path, old, digits):
    pytest.importorskip("ngsolve")
    text = (solvers / "ngsolve" / "ballbox_p4.vol").read_text()
    assert text.count(old) == 1
    (tmp_path / "a.vol").write_text(text.replace(old, "9" * digits + old.lstrip("0123456789"), 1))
    with pytest.raises(FormatError, match=r"a\.vol: surfaceelements.*: expected an element and its points, found"):
        NGSolve([tmp_path / "a.vol"])


@pytest.mark.parametrize("digits", [20, 5000])
@pytest.mark.parametrize(("old", "place"), [("1 4 0 1 2 3", "elements 0"), ("\n4\n3\n", "vertices")])
def test_mfem_meshes_with_too_many_vertices(tmp_path, old, place, digits):
    (tmp_path / "a.mesh").write_text(MFEM.replace(old, old.replace("4", "9" * digits, 1)))
    with pytest.raises(FormatError, match=rf"a\.mesh: {place}: expected"):
        Mfem([tmp_path / "a.mesh"])


def test_gmsh_schemes_without_polynomials(solvers, tmp_path, monkeypatch):
    pytest.importorskip("gmsh")

    def squares(table, wanted, rcond):
        assert np.isfinite(wanted).all()  # of others the library's may never end
        return original(table, wanted, rcond=rcond)

    original = np.linalg.lstsq
    monkeypatch.setattr(np.linalg, "lstsq", squares)
    raw = (solvers / "gmsh" / "mixed_o2_v22.msh").read_bytes()
    assert b"\n2 1 1 \n" in raw
    (tmp_path / "a.msh").write_bytes(raw.replace(b"\n2 1 1 \n", b"\n2 1 1.5 \n"))
    with pytest.raises(FormatError, match="expected a scheme of polynomials for a "):
        Gmsh([tmp_path / "a.msh"])


@pytest.mark.parametrize("dimension", ["num_el_blk", "num_side_sets"])
def test_exodus_files_with_more_blocks_or_sets_than_bytes(tmp_path, dimension):
    path = cubes_in_blocks(tmp_path / "a.e", write_hdf5, [1])
    with h5py.File(path, "r+") as file:
        del file[dimension]
        file.create_dataset(dimension, (10**12,), ">f4", chunks=(1000,)).make_scale(dimension)
    with pytest.raises(
        FormatError, match=f"{dimension}: expected at most [0-9]+, from the size of the file, found 10000"
    ):
        Exodus([path])


def test_exodus_side_sets_of_an_empty_part(tmp_path):
    first = cubes_in_blocks(tmp_path / "a.e.2.0", write_classic, [1])
    places, nodes = unit_cubes(1, 1)
    other = write_classic(tmp_path / "a.e.2.1", [ExodusBlock("none", "HEX8", nodes[:0])], places, {"out": [(1, 2)]})
    source = Exodus([first, other])
    assert source.declared.sides["out"] == 1
    assert "out" not in {own.name for own in source.boundaries if own.sides}


def test_exodus_parts_of_different_dimensions(tmp_path):
    places, nodes = unit_cubes(1)
    solid = write_classic(tmp_path / "a.e.2.0", [ExodusBlock("solid", "HEX8", nodes)], places)
    plane = write_classic(tmp_path / "a.e.2.1", [ExodusBlock("plane", "QUAD4", nodes[:, :4])], places[:, :2])
    with pytest.raises(FormatError, match=r"a\.e\.2\.1: expected 3 coordinates as in the first, found 2"):
        Exodus([solid, plane])


def test_trixi_forests_with_more_leaves_than_listed(tmp_path):
    brick = Brick((2, 1), lambda x: x, 1, lambda _: lambda *_: False)
    mesh = brick.write(tmp_path / "mesh.h5", "T8codeMesh")
    with h5py.File(mesh, "r+") as file:
        file["num_elements_per_tree"][...] = [10**10, 1]
    path = write_solution(tmp_path / "s.h5", mesh, "T8codeMesh", brick.nodes(1), {"u": lambda x: x[..., 0]}, 1)
    with pytest.raises(FormatError, match="expected 2 leaves of trees that all have some, found 10000000001"):
        Trixi([path])


def test_exodus_files_with_two_unlimited_dimensions(tmp_path):
    """SciPy makes a type of numbers of the record variables, which Python's parser refuses."""
    path = cubes_in_blocks(tmp_path / "a.e", write_classic, [1, 1], nodal={"u": np.arange(12.0)})
    raw = path.read_bytes()
    count = b"num_nodes\0\0\0\0\0\0\x0c"
    assert count in raw
    path.write_bytes(raw.replace(count, count[:-1] + b"\0"))
    with pytest.raises(FormatError, match=r"a\.e: expected a complete netCDF file, found"):
        Exodus([path])
