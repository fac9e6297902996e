"""HDF5 files that lie: each gets its sentence, within seconds and bounded memory."""

import shutil

import h5py
import numpy as np
import pytest


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
    store_nothing: "/NEKTAR/DATA: expected numbers or strings, found nothing",
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
