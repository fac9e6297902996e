"""HDF5 files that lie: each gets its sentence, within seconds and bounded memory."""

import shutil

import h5py
import numpy as np
import pytest

from elvis.core.base.errors import FormatError
from elvis.formats.nektar.hdf5_checks import attribute_data
from elvis.formats.nektar.hdf5_heaps import check_heaps


@pytest.fixture
def hdf5_field(copied):
    """An HDF5 field file to damage, and its mesh."""
    folder = copied("kova_varp")
    return folder / "KovaFlow_varP.xml", folder / "KovaFlow_varP_hdf5.fld"


def replaced(root, name, **options):
    del root[name]
    return root.create_dataset(name, **options)


def alter_version(root):
    root.attrs["FORMAT_VERSION"] = np.uint32(2)


def drop_version(root):
    del root.attrs["FORMAT_VERSION"]


def declare_much(root):
    replaced(root, "DATA", shape=(10**13,), dtype="f8")


def declare_much_packed(root):
    replaced(root, "DATA", shape=(10**13,), dtype="f8", chunks=(1000,), compression="gzip")


def link_outside(root):
    del root["DATA"]
    root["DATA"] = h5py.ExternalLink("/etc/passwd", "/x")


def store_outside(root):
    replaced(root, "DATA", shape=(10,), dtype="f8", external=[("/etc/passwd", 0, 80)])


def cycle(root):
    del root["Metadata"]
    root["Metadata"] = h5py.SoftLink("/NEKTAR/Metadata")


def store_text(root):
    replaced(root, "DATA", data=[b"abc"] * 9)


def store_square(root):
    replaced(root, "ELEMENTIDS", data=np.ones((3, 4), np.uint32))


def store_group(root):
    del root["DATA"]
    root.create_group("DATA")


def store_nothing(root):
    del root["DATA"]
    root["DATA"] = h5py.Empty("f8")


def short_table(root):
    replaced(root, "DECOMPOSITION", data=np.ones(5, np.uint64))


def great_counts(root):
    replaced(root, "DECOMPOSITION", data=np.array([12, 2**63, 24, 0, 0, 0, 18380036883355646697], np.uint64))


def other_key(root):
    replaced(root, "DECOMPOSITION", data=np.array([12, 2328, 24, 0, 0, 0, 5], np.uint64))


def great_orders(root):
    root["POLYORDERS"][3] = 4_000_000_000


def other_basis(root):
    root["18380036883355646697"].attrs["BASIS"] = np.array([4, 77], np.int32)


def other_orders(root):
    root["18380036883355646697"].attrs["NUMMODESPERDIR"] = "UNIORDER:8,8"


HDF5_CHANGES = {
    alter_version: "/NEKTAR: expected FORMAT_VERSION 1 to 1, found \\[2\\]",
    drop_version: "/NEKTAR: expected an attribute FORMAT_VERSION, found none",
    declare_much: "/NEKTAR/DATA: expected 80000000000000 bytes as declared, found 0 stored",
    declare_much_packed: "/NEKTAR/DATA: expected 80000000000000 bytes as declared, found 0 stored",
    link_outside: "/NEKTAR/DATA: expected data in the file itself, found a link",
    store_outside: "/NEKTAR/DATA: expected data in the file itself, found references to others",
    cycle: "/NEKTAR/Metadata: expected data in the file itself, found a link",
    store_text: "/NEKTAR/DATA: expected numbers, found object of shape",
    store_square: r"/NEKTAR/ELEMENTIDS: expected whole numbers, found uint32 of shape \(3, 4\)",
    store_group: "/NEKTAR/DATA: expected a dataset, found a group",
    store_nothing: "/NEKTAR/DATA: expected numbers or strings, found none",
    short_table: "/NEKTAR: expected DECOMPOSITION with seven numbers a block, found otherwise",
    great_counts: "/NEKTAR/DECOMPOSITION: expected counts of data, found 9223372036854775808",
    other_key: "/NEKTAR: expected a group 5, found none",
    great_orders: "expected 1 to 1024 modes in a direction, found 4000000000",
    other_basis: r"expected numbers of bases, found \[4, 77\]",
    other_orders: "expected 2304 coefficients, found 2328",
}


@pytest.mark.parametrize("alter", HDF5_CHANGES)
def test_hdf5_fields_that_contradict_themselves(alter, hdf5_field, refused):
    mesh, field = hdf5_field
    with h5py.File(field, "r+") as file:
        alter(file["NEKTAR"])
    refused(mesh, field, match=rf"KovaFlow_varP_hdf5\.fld: {HDF5_CHANGES[alter]}|: {HDF5_CHANGES[alter]}")


def test_hdf5_meshes_that_contradict_themselves(copied, nektar, refused):
    mesh = copied("interptest_hdf5") / "interptest_hdf5.nekg"
    cases = [
        (
            "MESH/SEG",
            np.zeros((261, 3), np.int32),
            r"expected whole numbers in 2 columns, found int32 of shape \(261, 3\)",
        ),
        ("MESH/SEG", np.full((261, 2), 2**31 - 1, np.int32), "expected vertex ids that exist in the entries S"),
        ("MAPS/SEG", np.zeros(261, np.int32), "expected every edge once, found edge 0 twice"),
        ("MAPS/SEG", np.zeros(3, np.int32), "expected SEG in MESH and MAPS, of one length"),
        ("MAPS/TRI", np.zeros(145), "expected whole numbers, found float64"),
        ("MESH/CURVE_EDGE", np.full((247, 3), 2**31 - 1, np.int32), "expected curves of at most 1729 points"),
        ("MESH/VERT", np.full((105, 3), np.nan), "expected finite coordinates of vertices"),
        ("MESH/COMPOSITE", np.arange(3), "expected a list of strings, found int64"),
        ("MESH/DOMAIN", ["0-1-2"], "expected ascending ranges, found '0-1-2'"),
    ]
    for name, values, message in cases:
        shutil.copyfile(nektar / "interptest_hdf5" / mesh.name, mesh)
        with h5py.File(mesh, "r+") as file:
            del file[f"NEKTAR/GEOMETRY/{name}"]
            file[f"NEKTAR/GEOMETRY/{name}"] = values
        refused(mesh, match=message)


def patched(path, place, value):
    raw = bytearray(path.read_bytes())
    raw[place : place + len(value)] = value
    path.write_bytes(raw)


def test_heaps_that_would_make_the_library_loop_or_grow(hdf5_field, refused):
    mesh, field = hdf5_field
    original = field.read_bytes()
    heap = original.index(b"GCOL")
    patched(field, heap + 8, (2**33).to_bytes(8, "little"))
    refused(mesh, field, match=r"expected a heap of 4096 to \d+ bytes, found 8589934592")
    field.write_bytes(original)
    patched(field, heap + 16 + 8, (2**33).to_bytes(8, "little"))
    refused(mesh, field, match=rf"damaged \(the heap at byte {heap}\)")

    # the free space, shortened by some zeros: an object of no size follows
    free = heap + 16
    while original[free : free + 2] != b"\0\0":
        free += 16 + (int.from_bytes(original[free + 8 : free + 16], "little") + 7) // 8 * 8
    field.write_bytes(original)
    length = int.from_bytes(original[free + 8 : free + 16], "little")
    patched(field, free + 8, (length - 64).to_bytes(8, "little"))
    refused(mesh, field, match=rf"damaged \(the heap at byte {heap}\)")


@pytest.mark.parametrize("base", [0, 512])
def test_free_blocks_of_names_that_form_a_circle(base, tmp_path):
    """The library would allocate memory without end."""
    path = tmp_path / "a.h5"
    with h5py.File(path, "w", libver="earliest", userblock_size=base) as file:
        file["x"] = 1.0
    check_heaps(path)
    raw = path.read_bytes()
    heap = raw.index(b"HEAP")
    first, data = (int.from_bytes(raw[heap + at : heap + at + 8], "little") for at in (16, 24))
    patched(path, base + data + first, first.to_bytes(8, "little"))
    with pytest.raises(FormatError, match=rf"damaged \(the heap at byte {heap}\)"):
        check_heaps(path)


@pytest.mark.parametrize("place", [8, 12, 13, (1 << 20) - 3, (1 << 20) + 5])
def test_heaps_begin_anywhere(place, tmp_path):
    heap = b"GCOL\x01\x00\x00\x00" + (4096).to_bytes(8, "little")
    whole = bytes([1, 0, 0, 0, 0, 0, 0, 0]) + (4096 - 32).to_bytes(8, "little") + bytes(4096 - 32)
    (tmp_path / "a.h5").write_bytes(bytes(place) + heap + whole)
    check_heaps(tmp_path / "a.h5")
    (tmp_path / "a.h5").write_bytes(bytes(place) + heap + bytes(4096 - 16))
    with pytest.raises(FormatError, match=rf"damaged \(the heap at byte {place}\)"):
        check_heaps(tmp_path / "a.h5")


def test_an_unreadable_root_group(hdf5_field, refused):
    mesh, field = hdf5_field
    for part in (b"HEAP", b"TREE"):  # names and members of the root, which come first
        original = field.read_bytes()
        patched(field, original.index(part), b"none")
        refused(mesh, field, match="the HDF5 data are damaged")
        field.write_bytes(original)


@pytest.mark.parametrize("name", ["SHAPE", "FIELDS", "NUMMODESPERDIR"])
def test_strings_that_declare_gigabytes(name, hdf5_field, refused):
    mesh, field = hdf5_field
    with h5py.File(field) as file, field.open("rb") as raw:
        address = h5py.h5o.get_info(file["NEKTAR/18380036883355646697"].id).addr
        data = attribute_data(raw, address, name.encode())
    assert len(data) >= 16
    patched(field, field.read_bytes().index(data), (0xF0000000).to_bytes(4, "little"))
    refused(mesh, field, match=r"damaged \(a string of 4026531840 bytes\)")


def test_lists_of_strings_that_declare_gigabytes(copied, refused):
    mesh = copied("interptest_hdf5") / "interptest_hdf5.nekg"
    with h5py.File(mesh) as file:
        place = file["NEKTAR/GEOMETRY/MESH/COMPOSITE"].id.get_offset()
    patched(mesh, place + 16, (0xF0000000).to_bytes(4, "little"))
    refused(mesh, match=r"damaged \(a string of 4026531840 bytes\)")


def test_kinds_of_strings_that_would_crash_the_library(hdf5_field, refused):
    mesh, field = hdf5_field
    place = field.read_bytes().index(b"SHAPE\0\0\0\x19\x01") + 9
    patched(field, place, b"\x7f")
    refused(mesh, field, match="expected numbers or strings in SHAPE, found object")


@pytest.mark.parametrize(("more", "fits"), [(0, True), (8, False)])
def test_heaps_end_with_the_file_at_the_latest(more, fits, tmp_path):
    """Also if they begin so late that their length is less than the file's."""
    start, length = 512, 4096
    heap = b"GCOL\x01\x00\x00\x00" + (length + more).to_bytes(8, "little")
    whole = bytes([1, 0, 0, 0, 0, 0, 0, 0]) + (length - 32).to_bytes(8, "little") + bytes(length - 32)
    (tmp_path / "a.h5").write_bytes(bytes(start) + heap + whole)
    if fits:
        check_heaps(tmp_path / "a.h5")
    else:
        with pytest.raises(FormatError, match="expected a heap of 4096 to 4096 bytes, found 4104"):
            check_heaps(tmp_path / "a.h5")
