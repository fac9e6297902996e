"""Check that an HDF5 file holds as much data as it declares, before the library allocates memory for it.

Strings.  A string of variable length is a descriptor of 16 bytes (length, heap, index), and the library allocates
whatever memory the length demands.  Its interface does not reveal the length beforehand, so descriptors are read from
the file directly.  Layout: HDF5 File Format Specification, IV.A.1 (object headers, version 1) and IV.A.2.m
(attributes); other layouts, which the tools of this format don't write, are not examined.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from elvis.core.base.errors import FormatError
from elvis.core.files.plain import unpacked_limit

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]


_GREATEST_ATTRIBUTE = 1 << 20
#: maximum bytes of texts and whole numbers that were never written and have their fill values
_GREATEST_UNWRITTEN = 1 << 20


def check_stored(found: h5py.Dataset, place: str, count: int | None = None) -> None:
    """Raise FormatError if a dataset declares more data than the file can hold for it.

    Short texts and whole numbers that were never written, such as names, have their fill values; for real numbers, no
    fill value is accepted.

    count  number of numbers to be read, if not all
    """
    _check_filters(found, place)
    size = found.dtype.itemsize
    claimed = (math.prod(found.shape) if count is None else count) * size
    stored = found.id.get_storage_size()
    if not stored and found.dtype.kind in "Siu" and claimed <= _GREATEST_UNWRITTEN:
        return
    is_packed = found.id.get_create_plist().get_nfilters() > 0
    chunk = math.prod(found.chunks) * size if found.chunks else 0
    # no filter may hold more than deflate does
    most = unpacked_limit(stored, found.file.id.get_filesize()) if is_packed else stored
    if max(claimed, chunk if is_packed else 0) > most:
        raise FormatError(f"expected {claimed} bytes as declared, found {stored} stored", place=place)
    if is_packed and stored > 2 * max(claimed, chunk) + (1 << 20) and count is None:
        raise FormatError(f"expected at most {claimed} bytes packed, found {stored} stored", place=place)

    # chunks that were never written hold nothing, regardless of the number declared
    if count is None and chunk and claimed > found.id.get_num_chunks() * chunk:
        held = found.id.get_num_chunks() * chunk
        raise FormatError(f"expected {claimed} bytes as declared, found {held} in chunks", place=place)


def _check_filters(found: h5py.Dataset, place: str) -> None:
    """Raise FormatError if a dataset is packed by filters that this installation doesn't have."""
    import h5py

    properties = found.id.get_create_plist()
    codes = [properties.get_filter(number)[0] for number in range(properties.get_nfilters())]
    unknown = [str(code) for code in codes if not h5py.h5z.filter_avail(code)]
    if unknown:
        raise FormatError(
            f"expected data that HDF5 can unpack here, found its filter {', '.join(unknown)}; h5repack -f NONE, run "
            "where that filter is, unpacks the file",
            place=place,
        )


def check_attribute(owner: h5py.Group | h5py.Dataset, name: str) -> None:
    """Raise FormatError for an attribute of an unknown kind or greater than any.

    The library would crash or never end.
    """
    found = owner.attrs.get_id(name)
    if not is_plain(found.dtype):
        raise FormatError(f"expected numbers or strings in {name}, found {found.dtype}", place=owner.name)
    if found.dtype.kind == "O":
        _check_attribute_strings(owner, name)
    claimed = found.get_space().get_simple_extent_npoints() * found.get_type().get_size()
    if claimed > _GREATEST_ATTRIBUTE:
        raise FormatError(f"expected a short attribute {name}, found {claimed} bytes", place=owner.name)


def check_strings(found: h5py.Dataset) -> None:
    """Raise FormatError if strings of variable length claim more than the file holds."""
    offset = found.id.get_offset()
    if offset is not None and found.dtype.kind == "O":
        path = Path(found.file.filename)
        with path.open("rb") as file:
            file.seek(offset)
            check_lengths(file.read(found.id.get_storage_size()), path.stat().st_size)


def _check_attribute_strings(owner: h5py.Group | h5py.Dataset, name: str) -> None:
    """As `check_strings`."""
    import h5py

    path = Path(owner.file.filename)
    with path.open("rb") as file:
        data = attribute_data(file, h5py.h5o.get_info(owner.id).addr, name.encode("utf-8", "surrogateescape"))
    check_lengths(data, path.stat().st_size)


def is_plain(dtype: np.dtype[Any]) -> bool:
    """Whether a type is one of numbers or strings."""
    import h5py

    return dtype.kind in "biufS" or h5py.check_string_dtype(dtype) is not None


_DESCRIPTOR = 16
_PREFIX = 16
_CONTINUATION, _ATTRIBUTE = 0x10, 0x0C
_MOST_BLOCKS, _GREATEST_BLOCK = 64, 1 << 20


def check_lengths(descriptors: bytes, file_size: int) -> None:
    """Raise FormatError if a string would be longer than the whole file."""
    whole = len(descriptors) // _DESCRIPTOR * _DESCRIPTOR
    lengths = np.frombuffer(descriptors[:whole], "<u4")[::4]
    if len(lengths) and lengths.max() > file_size:
        raise FormatError(f"the HDF5 data are damaged (a string of {lengths.max()} bytes)")


def attribute_data(file: BinaryIO, address: int, name: bytes) -> bytes:
    """The raw data of an attribute in the object header at ``address``, none if it isn't found there."""
    for kind, body in _messages(file, address):
        if kind == _ATTRIBUTE and len(body) > 9:
            found, data = _attribute(body)
            if found == name:
                return data
    return b""


def _messages(file: BinaryIO, address: int) -> Iterator[tuple[int, bytes]]:
    """Kind and body of each message of an object header, its continuations included."""
    file.seek(address)
    prefix = file.read(_PREFIX)
    if len(prefix) < _PREFIX or prefix[0] != 1:
        return
    blocks = [(address + _PREFIX, _number(prefix, 8, 4))]
    for start, length in blocks:
        file.seek(start)
        block, position = file.read(min(length, _GREATEST_BLOCK)), 0
        while position + 8 <= len(block):
            kind, size = _number(block, position, 2), _number(block, position + 2, 2)
            body = block[position + 8 : position + 8 + size]
            if kind == _CONTINUATION and len(body) >= 16 and len(blocks) < _MOST_BLOCKS:
                blocks.append((_number(body, 0, 8) % 2**62, _number(body, 8, 8)))
            yield kind, body
            position += 8 + size


def _attribute(body: bytes) -> tuple[bytes, bytes]:
    """Name and data of an attribute message; version 1 pads its parts to multiples of eight bytes."""
    sizes = [_number(body, place, 2) for place in (2, 4, 6)]
    start = 9 if body[0] == 3 else 8
    name = body[start : start + sizes[0]].split(b"\0")[0]
    for size in sizes:
        start += (size + 7) // 8 * 8 if body[0] == 1 else size
    return name, body[start:]


def _number(raw: bytes, place: int, size: int) -> int:
    return int.from_bytes(raw[place : place + size], "little")
