"""Archives of arrays: what is read is as large as it says, and nothing else is read."""

import io
import zipfile

import numpy as np
import pytest

from elvis.core.base.errors import FormatError
from elvis.core.files.archives import Archive, names_in


def member(shape, values, descr="<f8"):
    """The bytes of an array that declares a shape."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": descr, "fortran_order": False, "shape": shape})
    return stream.getvalue() + values


def archived(path, packing=zipfile.ZIP_DEFLATED, **members):
    with zipfile.ZipFile(path, "w", packing) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return path


def test_arrays_survive_a_round_trip(tmp_path):
    arrays = {
        "z": np.ones(3),
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.array(["x", "yz"]),
        "c": np.asfortranarray(np.eye(3)),
        "d": 1,
    }
    for save in (np.savez, np.savez_compressed):
        save(tmp_path / "a.npz", **arrays)
        assert names_in(tmp_path / "a.npz") == set(arrays)
        with Archive(tmp_path / "a.npz") as archive:
            assert archive.names == tuple(arrays)
            for name, array in arrays.items():
                assert np.array_equal(archive[name], array)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (member((10**12,), bytes(80)), "expected 8000000000000 bytes as declared, found 80"),
        (member((2**62, 2**62), bytes(80)), "expected 1701\\d* bytes as declared, found 80"),
        (member((10,), bytes(72)), "expected 80 bytes as declared, found 72"),
        (member((9,), bytes(80)), "expected 72 bytes as declared, found 80"),
        (member((1,), b"x" * 8, "|O"), "expected numbers or texts, found object"),
        (member((1,), b"x" * 8, "|V8"), "expected numbers or texts, found"),
        (b"\x93NUMPY\x07\x00", "expected version 1 or 2 of an array, found"),
        (b"", "expected an archive of arrays, found: "),
        (b"\x93NUMPY\x01\x00\x10\x00{'descr': (((((", "expected an archive of arrays, found: "),
    ],
)
def test_arrays_of_wrong_size_are_rejected(tmp_path, content, message):
    with (
        Archive(archived(tmp_path / "a.npz", a=content)) as archive,
        pytest.raises(FormatError, match=rf"a\.npz: a: {message}"),
    ):
        archive["a"]


def test_members_with_impossible_sizes_are_rejected(tmp_path):
    path = archived(tmp_path / "a.npz", a=member((10,), bytes(80)))
    raw = bytearray(path.read_bytes())
    place = raw.rfind(b"PK\x01\x02") + 24
    raw[place : place + 4] = (1 << 30).to_bytes(4, "little")
    path.write_bytes(raw)
    with Archive(path) as archive, pytest.raises(FormatError, match=r"a: expected 1073741824 bytes as declared"):
        archive["a"]


def test_members_with_other_compression_are_rejected(tmp_path):
    path = archived(tmp_path / "a.npz", zipfile.ZIP_BZIP2, a=member((10,), bytes(80)))
    with Archive(path) as archive, pytest.raises(FormatError, match="packed"):
        archive["a"]


def test_damaged_bytes_and_missing_names_are_reported(tmp_path):
    path = archived(tmp_path / "a.npz", a=member((1000,), bytes(8000)))
    raw = bytearray(path.read_bytes())
    raw[60] ^= 255
    path.write_bytes(raw)
    with Archive(path) as archive:
        with pytest.raises(FormatError, match="expected an archive of arrays, found"):
            archive["a"]
        with pytest.raises(FormatError, match="expected an array b, found none"):
            archive["b"]
    (tmp_path / "b.npz").write_bytes(raw[:50])
    with pytest.raises(FormatError, match="expected an archive of arrays, found"):
        Archive(tmp_path / "b.npz")
    assert names_in(tmp_path / "b.npz") == frozenset()


def test_an_archive_of_zeros_is_rejected_before_allocation(tmp_path):
    with (
        zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as packed,
        packed.open("a.npy", "w", force_zip64=True) as stream,
    ):
        stream.write(member((1 << 24,), b""))
        for _ in range(128):
            stream.write(bytes(1 << 20))
    with (
        Archive(tmp_path / "a.npz") as archive,
        pytest.raises(FormatError, match=r"expected 134217\d+ bytes as declared, found 13\d+ packed ones"),
    ):
        archive["a"]
