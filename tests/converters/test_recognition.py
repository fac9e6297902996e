"""Files that nobody opens: the sentence says what they are and what to do next."""

import gzip

import h5py
import numpy as np
import pytest

from elvis.converters.vtk.vtk import Vtk
from elvis.core.base.errors import ElvisError, FormatError
from elvis.formats.reading import read
from elvis.plugins.conversion.discovery import choose_converter, installed_converters


def legacy(kind):
    return f"# vtk DataFile Version 3.0\nof a test\nASCII\nDATASET {kind}\n".encode()


def xml_of(kind):
    return f'<?xml version="1.0"?>\n<VTKFile type="{kind}" version="1.0"><{kind}/></VTKFile>\n'.encode()


SAVE = r"save an unstructured grid \(\.vtu\)"
FILES = {
    "a.vtk": (legacy("POLYDATA"), r"a surface of polygons \(PolyData\) without a volume: save the volume"),
    "b.vtk": (legacy("STRUCTURED_GRID"), f"a structured grid of linear cells: {SAVE}"),
    "c.vtk": (legacy("RECTILINEAR_GRID"), f"a rectilinear grid of linear cells: {SAVE}"),
    "d.vtk": (legacy("STRUCTURED_POINTS"), rf"an image of points on a lattice \(StructuredPoints\): {SAVE}"),
    "e.vtk": (b"# vtk DataFile Version 3.0\nx\nASCII\nFIELD a 1\n", "arrays without cells: give the grid"),
    "a.vtp": (xml_of("PolyData"), "a surface of polygons"),
    "a.pvtp": (xml_of("PPolyData"), "a surface of polygons"),
    "a.vti": (xml_of("ImageData"), "an image of points on a lattice"),
    "a.vts": (xml_of("StructuredGrid"), "a structured grid"),
    "a.vtpc": (xml_of("vtkPartitionedDataSetCollection"), "VTK data of the kind vtkPartitionedDataSetCollection"),
    "a.rea": (
        b"****** PARAMETERS *****\n 2.610000 NEKTON VERSION\n",
        r"a Nek5000 case \(\.rea\) without a field: also give a",
    ),
    "a.re2": (
        b"#v003       32  3       32 this is the hdr",
        r"a Nek5000 mesh \(\.re2\) without a field: also give a field",
    ),
    "a.ma2": (b"#v001       32        5", r"a Nek5000 partition \(\.ma2\) without a field"),
    "u.gfu": (
        bytes(range(200)),
        r"numbers of an NGSolve function \(\.gfu\) without a mesh: give the \.vol file and --reader",
    ),
    "s.pickle": (
        b"\x80\x04\x95\x00cngsolve.comp\nMesh",
        r"a pickled NGSolve session, .*elvis\.converters\.ngsolve\.export\.export in Python",
    ),
    "p.pickle": (b"\x80\x04\x95\x00anything", "a Python pickle, which could run any code"),
    "a.pos": (b'View "u" {\nSP(0,0,0){1};\n};\n', r"a list of values of Gmsh \(\.pos\) without a mesh: save the view"),
    "a.geo": (
        b'SetFactory("OpenCASCADE");\nBox(1) = {0,0,0,1,1,1};\n',
        r"a script of Gmsh \(\.geo\) without a mesh: mesh it",
    ),
    "a.stl": (b"solid cube\nfacet normal 0 0 1\n", "a surface of triangles, without a volume"),
    "a.plt": (b"#!TDV112\x01\0\0\0", "a Tecplot file"),
    "a.dat": (b'TITLE = "x"\nVARIABLES = "X", "Y"\n', "a Tecplot file"),
    "points": (b"FoamFile\n{\n version 2.0;\n}\n", "an OpenFOAM file: write VTK with foamToVTK"),
    "a.su2": (b"% made by\nNDIME= 3\nNELEM= 4\n", "an SU2 mesh"),
    "restart.dat": (b"\xec\x2b\x08\0\x08\0\0\0", "a restart file of SU2, which names no elements"),
    "flow.csv": (b'"PointID","x","y","Density"\n0, 1, 2, 3\n', "a table of points: elvis convert --onto MESH"),
    "a.case": (b"FORMAT\ntype: ensight gold\n", "EnSight data"),
    "a.nc": (b"CDF\x02" + bytes(60), "a netCDF file without elements of Exodus"),
    "a.xdmf": (b'<?xml version="1.0" ?>\n<Xdmf Version="3.0">', "an XDMF file, which names others"),
    "a.svg": (b'<?xml version="1.0"?>\n<svg/>', "an XML file with another root"),
    "a.png": (b"\x89PNG\r\n\x1a\n", "a picture"),
    "a.gz": (gzip.compress(b"nothing"), "a compressed file: unpack it"),
    "empty": (b"", "an empty file"),
    "notes.txt": (b"Dear all,\n", "a text that begins 'Dear all,'"),
    "sensors.csv": (b"# x, y, u\n0,0,1\n", "a table of points: elvis convert --onto MESH"),
    "scene.toml": (b'field = "p"\ndata = ["a.xml"]\n[reference]\nmu = 1\n', "a scene, which only render, view"),
    "scene.json": (b'{"data": ["a.xml"]}', "a scene, which only render, view"),
    "a.bin": (b"\x01\x02\0\x04abcdefgh", r"a binary file that begins b'.x01"),
}


@pytest.mark.parametrize("name", FILES)
def test_files_are_recognised_with_advice(tmp_path, name):
    content, words = FILES[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ElvisError, match=rf"{name}: expected a file of a known format \(.*\), found {words}") as told:
        choose_converter(installed_converters(), [tmp_path / name])
    assert "\n" not in str(told.value)
    assert "found others" not in str(told.value)


def test_hdf5_files_are_recognised_by_content(tmp_path):
    path = tmp_path / "a.h5"
    cases = [
        ({"Distance": 1}, {"File_Type": np.bytes_("WallDistance")}, "distances to walls of FLEXI, .*give a state file"),
        ({"WallDistance": 1}, {}, "distances to walls of FLEXI"),
        ({"Mean": 1}, {"File_Type": np.bytes_("TimeAvg")}, "a FLEXI file of the kind TimeAvg, without DG_Solution"),
        ({"VTKHDF": 1}, {}, "a VTKHDF file of the type none: save an unstructured grid"),
        ({"topologies": 1}, {}, "a checkpoint of Firedrake or PETSc"),
        ({"b": 1, "a": 1}, {}, "an HDF5 file with a, b$"),
        ({b"b\xff": 1, "a": 1}, {}, "an HDF5 file with a, b\ufffd$"),
        ({}, {}, "an HDF5 file with nothing"),
    ]
    for members, attributes, words in cases:
        with h5py.File(path, "w") as file:
            for name, value in members.items():
                file[name] = value
            file.attrs.update(attributes)
        with pytest.raises(ElvisError, match=f"found {words}"):
            choose_converter(installed_converters(), [path])
    path.write_bytes(path.read_bytes()[:20])
    with pytest.raises(ElvisError, match="found a damaged HDF5 file"):
        choose_converter(installed_converters(), [path])


def test_files_that_do_not_belong_together(solvers, tmp_path):
    mesh, grid = solvers / "gmsh" / "mixed_o3.msh", solvers / "vtk" / "mfem_escher_p3.vtu"
    with pytest.raises(
        ElvisError, match=r"found mixed_o3\.msh \(gmsh\), mfem_escher_p3\.vtu \(vtk\): give them one by"
    ):
        choose_converter(installed_converters(), [mesh, grid])
    ball = solvers / "cgns" / "gmsh_ball_tet_o3.cgns"
    with pytest.raises(ElvisError, match="expected files that belong together, found 2 that cgns opens one at a time"):
        choose_converter(installed_converters(), [ball, ball])
    (tmp_path / "a.txt").write_text("hello\n")
    with pytest.raises(ElvisError, match=r"a\.txt: expected a file of a known format .* begins 'hello'"):
        choose_converter(installed_converters(), [mesh, tmp_path / "a.txt"])


def test_a_named_converter_reports_the_same(tmp_path):
    (tmp_path / "a.vtp").write_bytes(xml_of("PolyData"))
    with pytest.raises(FormatError, match="expected an unstructured grid of VTK, found a surface of polygons"):
        Vtk([tmp_path / "a.vtp"])
    (tmp_path / "b.stl").write_bytes(FILES["a.stl"][0])
    with pytest.raises(FormatError, match="expected an unstructured grid of VTK, found a surface of triangles"):
        Vtk([tmp_path / "b.stl"])


def test_native_commands_name_the_converter(solvers):
    for path in ("vtk/mfem_escher_p3.vtu", "gmsh/mixed_o3.msh", "hopr_flexi/convcurved_N4_State.h5"):
        with pytest.raises(FormatError, match=r"; elvis.plugins.read takes the files of other programs$"):
            read(solvers / path)
