"""Sizes that files declare are compared with what they hold, before memory is taken."""

import os
import resource
import shutil
import struct
import subprocess
import sys
import tracemalloc
import zipfile
import zlib
from base64 import b64encode

import h5py
import numpy as np
import pytest
from neko_writer import add_virtual

from elvis.converters.cgns.cgns import Cgns
from elvis.converters.exodus.files import Variables
from elvis.converters.hopr import Hopr
from elvis.converters.ngsolve.ngsolve import NGSolve
from elvis.converters.pyfr.pyfr import PyFR
from elvis.converters.shared.hdf5 import holds, reading, require
from elvis.converters.vtk import files as vtk_files
from elvis.converters.vtk.times import time_in
from elvis.converters.vtk.vtk import Vtk
from elvis.core.base.errors import FormatError
from elvis.core.files.archives import Archive

MANY = 10**10
MEBIBYTE = 1 << 20


def declared(path, name, **options):
    """A dataset replaced by one of many rows that hold nothing."""
    with h5py.File(path, "r+") as file:
        found = file[name]
        shape, dtype, attributes = found.shape, found.dtype, dict(found.attrs)
        del file[name]
        new = file.create_dataset(name, (MANY, *shape[1:]), dtype, **options)
        new.attrs.update(attributes)


@pytest.mark.parametrize(
    ("converter", "folder", "files", "name"),
    [
        (Hopr, "hopr_flexi", ["cavity4x4x4_mesh.h5"], "ElemInfo"),
        (Hopr, "hopr_flexi", ["cavity4x4x4_mesh.h5"], "NodeCoords"),
        (Hopr, "hopr_flexi", ["cavity4x4x4_mesh.h5"], "BCNames"),
        (PyFR, "pyfr", ["mixed3d_p3.pyfrm"], "nodes"),
        (PyFR, "pyfr", ["mixed3d_p3.pyfrm"], "eles/hex"),
        (PyFR, "pyfr", ["mixed3d_p3-01.pyfrs", "mixed3d_p3.pyfrm"], "soln/p3-hex"),
        (PyFR, "pyfr", ["mixed3d_p3-01.pyfrs", "mixed3d_p3.pyfrm"], "stats"),
        (Cgns, "cgns", ["gmsh_mixed_o2.cgns"], "gmsh_mixed_o2.cgns/mixed_Part0/GridCoordinates/CoordinateX/ data"),
    ],
)
@pytest.mark.parametrize("packed", [False, True])
def test_hdf5_that_declares_more_than_it_contains(solvers, tmp_path, converter, folder, files, name, packed):
    for file in files:
        shutil.copyfile(solvers / folder / file, tmp_path / file)
    options = {"chunks": True, "compression": "gzip"} if packed else {}
    declared(tmp_path / files[0], name, **options)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(FormatError, match=r"expected \d+ bytes as declared, found 0 stored"):
        converter([tmp_path / file for file in files])
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100 * 1024


def test_unwritten_chunks_are_empty(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        values = file.create_dataset("u", (1000, 100), "f8", chunks=(10, 100), compression="gzip")
        values[:10] = np.random.default_rng(1).random((10, 100))
        whole = file.create_dataset("v", (1000, 100), "f8", chunks=(300, 30), compression="gzip")
        whole[...] = 0.0
    with reading(tmp_path / "a.h5") as file:
        assert require(file, "v").shape == (1000, 100)
    message = r"a\.h5: u: expected 800000 bytes as declared, found 8000 in chunks"
    with pytest.raises(FormatError, match=message), reading(tmp_path / "a.h5") as file:
        require(file, "u")


@pytest.mark.parametrize("place", ["link", "storage", "virtual"])
def test_data_of_other_files_are_not_read(tmp_path, place):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["u"] = np.arange(10.0)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        if place == "link":
            file["u"] = h5py.ExternalLink("other.h5", "u")
        elif place == "storage":
            file.create_dataset("u", (10,), "f8", external=[(str(tmp_path / "other.h5"), 0, 80)])
        else:
            layout = h5py.VirtualLayout((10,), "f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "u", (10,))
            file.create_virtual_dataset("u", layout)
    message = r"a\.h5: u: expected data in the file itself, found references to others"
    with pytest.raises(FormatError, match=message), reading(tmp_path / "a.h5") as file:
        require(file, "u")


def test_missing_filters_are_named(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_chunk((10,))
        properties.set_shuffle()
        # a number for tests, which no filter has; optional, so that the data may be written without it
        properties.set_filter(257, h5py.h5z.FLAG_OPTIONAL, ())
        space = h5py.h5s.create_simple((10,))
        found = h5py.h5d.create(file.id, b"u", h5py.h5t.NATIVE_DOUBLE, space, properties)
        found.write_direct_chunk((0,), np.arange(10.0).tobytes(), 0)
    message = r"a\.h5: u: expected data that HDF5 can unpack here, found its filter 257; h5repack -f NONE"
    with pytest.raises(FormatError, match=message), reading(tmp_path / "a.h5") as file:
        require(file, "u")


def test_a_link_to_a_pipe_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["u"] = np.arange(10.0)
        file["group/pipe"] = h5py.ExternalLink("pipe", "/x")
        file["soft"] = h5py.SoftLink("/group/pipe")
    assert holds(tmp_path / "a.h5", "u", "soft", "group/pipe")
    assert not holds(tmp_path / "a.h5", "group/none")
    message = r"a\.h5: group/pipe: expected data in the file itself, found references to others"
    with pytest.raises(FormatError, match=message), reading(tmp_path / "a.h5"):
        pass


READ = """
import sys
from pathlib import Path
from elvis.converters.exodus.files import Variables
from elvis.converters.shared.hdf5 import reading, require
from elvis.core.base.errors import FormatError

path = Path(sys.argv[1])
Variables(path)
try:
    with reading(path) as file:
        require(file, "u")
except FormatError as error:
    print(error)
"""


def test_a_pipe_behind_a_virtual_dataset_is_not_opened(tmp_path):
    """The library opens the files of such a dataset to tell its length, and would wait for ever."""
    os.mkfifo(tmp_path / "pipe0")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        add_virtual(file, "u", (4,), 2, "pipe%b")
    command = [sys.executable, "-c", READ, str(tmp_path / "a.h5")]
    found = subprocess.run(command, capture_output=True, text=True, check=True, timeout=30)
    assert "u: expected data in the file itself, found references to others" in found.stdout


def classic(path, counts, size):
    """A classic netCDF file of one variable x over dimensions of these sizes, with ``size`` bytes of data."""
    text = lambda name: struct.pack(">i", len(name)) + name.encode().ljust(-(-len(name) // 4) * 4, b"\0")  # noqa: E731
    dimensions = b"".join(text(f"d{i}") + struct.pack(">i", count) for i, count in enumerate(counts))
    head = (
        b"CDF\x01" + struct.pack(">i", 7) + struct.pack(">ii", 10, len(counts)) + dimensions + struct.pack(">ii", 0, 0)
    )
    variable = text("x") + struct.pack(">i", len(counts)) + struct.pack(f">{len(counts)}i", *range(len(counts)))
    variable += struct.pack(">ii", 0, 0) + struct.pack(">ii", 6, size)
    head += struct.pack(">ii", 11, 1) + variable
    path.write_bytes(head + struct.pack(">i", len(head) + 4) + bytes(size))


@pytest.mark.parametrize("counts", [(2**31 - 1,), (2**30, 2**30), (0, 2**28), (11,)])
def test_netcdf_that_declares_more_than_it_contains(tmp_path, counts):
    classic(tmp_path / "good.e", (10,), 80)
    assert Variables(tmp_path / "good.e")["x"].tolist() == [0.0] * 10
    classic(tmp_path / "bad.e", counts, 80)
    with pytest.raises(FormatError, match=r"bad\.e: expected a complete netCDF file, found"):
        Variables(tmp_path / "bad.e")["x"]


def test_variables_that_are_not_requested_are_not_read(tmp_path):
    with h5py.File(tmp_path / "a.e", "w") as file:
        file["x"] = np.arange(10.0)
        file["vals"] = np.arange(20.0).reshape(2, 10)
        file.create_dataset("other", (200 * MEBIBYTE,), "i1", chunks=(MEBIBYTE,), compression="gzip")[...] = 0
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found = Variables(tmp_path / "a.e")
    assert "other" in found
    assert found["x"].tolist() == list(range(10))
    assert found.at("vals", 1, 3) == 13.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100 * 1024


def test_only_known_members_of_archives_are_read(solvers, tmp_path, monkeypatch):
    known = solvers / "ngsolve" / "hexprism_p3_hex.elems.npz"
    asked = []
    read = Archive.__getitem__
    monkeypatch.setattr(Archive, "__getitem__", lambda self, name: asked.append(name) or read(self, name))
    with np.load(known) as file:
        arrays = dict(file)
    np.savez(tmp_path / "a.npz", extra=np.zeros(10), order2=np.zeros(10), **arrays)
    NGSolve([tmp_path / "a.npz"])
    assert sorted(asked) == sorted(set(asked))
    assert set(asked) == set(arrays)


def test_a_member_with_an_excessive_size_is_rejected(solvers, tmp_path):
    source = zipfile.ZipFile(solvers / "ngsolve" / "hexprism_p3_hex.elems.npz")
    with source as old, zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as new:
        for name in old.namelist():
            content = old.read(name)
            if name == "hex_xyz.npy":
                content = content.replace(b"'shape': (", b"'shape': (9", 1).replace(b" \n", b"\n", 1)
            new.writestr(name, content)
    with pytest.raises(FormatError, match=r"hex_xyz: expected \d+ bytes as declared, found"):
        NGSolve([tmp_path / "a.npz"])


@pytest.mark.parametrize("name", ["NumberOfComponents", "NumberOfPoints", "NumberOfTuples"])
def test_xml_that_declares_more_than_it_contains(tmp_path, name):
    inside = f'<PUnstructuredGrid {name}="99999999999999999999"></PUnstructuredGrid>'
    (tmp_path / "a.pvtu").write_text(f'<VTKFile type="PUnstructuredGrid">{inside}</VTKFile>')
    with pytest.raises(FormatError, match=rf"a\.pvtu: {name}: expected at most \d+, from \d+ bytes, found 9{{20}}"):
        Vtk([tmp_path / "a.pvtu"])


def packed_file(path, place, integer, order, unpacked):
    """A VTK file with an array of zeros in packed form; ``unpacked`` bytes in blocks of 32 kB."""
    blocks = [bytes(1 << 15)] * (unpacked >> 15) + [bytes(unpacked % (1 << 15))] * (unpacked % (1 << 15) > 0)
    contents = [zlib.compress(block) for block in blocks]
    head = np.array([len(blocks), 1 << 15, unpacked % (1 << 15), *map(len, contents)], order + integer).tobytes()
    body = b"".join(contents)
    text = b64encode(head) + b64encode(body)
    where = 'format="binary"' if place == "inline" else 'format="appended" offset="3"'
    end = f">\n{text.decode()}</DataArray>" if place == "inline" else "/>"
    array = f'<DataArray type="Float64" Name="a" {where}{end}'
    kind = {"u4": "UInt32", "u8": "UInt64"}[integer]
    bytes_order = {"<": "LittleEndian", ">": "BigEndian"}[order]
    attributes = f'byte_order="{bytes_order}" header_type="{kind}" compressor="vtkZLibDataCompressor"'
    first = f'<VTKFile type="UnstructuredGrid" {attributes}>'
    appended = b""
    if place != "inline":
        appended = f'<AppendedData encoding="{place}">_abc'.encode() + (head + body if place == "raw" else text)
        appended += b"</AppendedData>"
    path.write_bytes(f"{first}<FieldData>{array}</FieldData>".encode() + appended + b"</VTKFile>")


@pytest.mark.parametrize("place", ["inline", "base64", "raw"])
@pytest.mark.parametrize(("integer", "order"), [("u4", "<"), ("u8", ">")])
def test_packed_arrays_of_vtk_that_grow_beyond_all_bounds(tmp_path, place, integer, order):
    """The size is that of whole blocks and of the last one; less is left to the library."""
    path = tmp_path / "a.vtu"
    packed_file(path, place, integer, order, 40_000_000)
    with pytest.raises(FormatError, match=r"expected packed arrays of at most \d+ bytes, .*, found at least 40000000$"):
        vtk_files.read([path])
    packed_file(path, place, integer, order, 4_000_000)
    with pytest.raises(FormatError, match="expected a complete VTK file"):
        vtk_files.read([path])


def test_the_time_of_a_vtk_file_is_unpacked_alone(tmp_path):
    packed = zlib.compress(struct.pack("<d", 2.5) + bytes(1 << 24))
    head = struct.pack("<4Q", 1, 1 << 24, 0, len(packed))
    text = (b64encode(head) + b64encode(packed)).decode()
    attributes = 'byte_order="LittleEndian" header_type="UInt64" compressor="vtkZLibDataCompressor"'
    data = f'<DataArray type="Float64" Name="TimeValue" format="binary">{text}</DataArray>'
    (tmp_path / "a.vtu").write_text(f"<VTKFile {attributes}><FieldData>{data}</FieldData></VTKFile>")
    tracemalloc.start()
    assert time_in(tmp_path / "a.vtu") == 2.5
    assert tracemalloc.get_traced_memory()[1] < MEBIBYTE
    tracemalloc.stop()
