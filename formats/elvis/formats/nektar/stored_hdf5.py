"""Whether an HDF5 file holds as much as it declares: looked up before memory is taken for it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.core.errors import FormatError
from elvis.core.files.plain import DEFLATE_RATIO
from elvis.formats.nektar.strings_hdf5 import attribute_data, check_lengths

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

_GREATEST_ATTRIBUTE = 1 << 20


def check_stored(found: h5py.Dataset, place: str, count: int | None = None) -> None:
    """FormatError where a dataset claims more than the file can hold for it.

    count  of the numbers that are to be read, where these aren't all
    """
    size = found.dtype.itemsize
    claimed = (math.prod(found.shape) if count is None else count) * size
    stored = found.id.get_storage_size()
    is_packed = found.id.get_create_plist().get_nfilters() > 0
    chunk = math.prod(found.chunks) * size if found.chunks else 0
    # no other filter is let to hold more than deflate
    if max(claimed, chunk if is_packed else 0) > stored * (DEFLATE_RATIO if is_packed else 1):
        raise FormatError(f"expected {claimed} bytes as declared, found {stored} stored", place=place)
    if is_packed and stored > 2 * max(claimed, chunk) + (1 << 20) and count is None:
        raise FormatError(f"expected at most {claimed} bytes packed, found {stored} stored", place=place)

    # chunks that were never written hold nothing, however many are declared
    if count is None and chunk and claimed > found.id.get_num_chunks() * chunk:
        held = found.id.get_num_chunks() * chunk
        raise FormatError(f"expected {claimed} bytes as declared, found {held} in chunks", place=place)


def check_attribute(owner: h5py.Group | h5py.Dataset, name: str) -> None:
    """FormatError for an attribute of an unknown kind or greater than any; the library would crash or never end."""
    found = owner.attrs.get_id(name)
    if not is_plain(found.dtype):
        raise FormatError(f"expected numbers or strings in {name}, found {found.dtype}", place=owner.name)
    if found.dtype.kind == "O":
        _check_attribute_strings(owner, name)
    claimed = found.get_space().get_simple_extent_npoints() * found.get_type().get_size()
    if claimed > _GREATEST_ATTRIBUTE:
        raise FormatError(f"expected a short attribute {name}, found {claimed} bytes", place=owner.name)


def check_strings(found: h5py.Dataset) -> None:
    """FormatError where strings of variable length claim more than the file holds."""
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

    return dtype.kind in "iufS" or h5py.check_string_dtype(dtype) is not None
