"""HDF5 with suspicion: only what is stored in the file itself is read, sizes are checked before memory is taken.

h5py raises many kinds of errors on damaged files; every call of it is made here, under `_guarded`, which turns them
into FormatError.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Floats, Ints
from elvis.formats.errors import FormatError
from elvis.formats.nektar.heaps import check_heaps
from elvis.formats.nektar.strings_hdf5 import attribute_data, check_lengths

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

#: no deflate stream holds more than this many bytes for each of its own
_DEFLATE_RATIO = 1032
_GREATEST_ATTRIBUTE = 1 << 20
_MOST_STRINGS = 1 << 24


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """The file, open for reading; errors of the block name it."""
    import h5py

    check_heaps(path)
    try:
        with _guarded():
            file = h5py.File(path, "r")
        with file:
            yield file
    except FormatError as error:
        raise error.within(path) from error


def group(parent: h5py.Group, name: str) -> h5py.Group | None:
    """A group of this name that is stored right here, None where there is none."""
    import h5py

    found = _member(parent, name)
    if found is not None and not isinstance(found, h5py.Group):
        raise FormatError("expected a group, found a dataset", place=_place(parent, name))
    return found


def required_group(parent: h5py.Group, name: str) -> h5py.Group:
    """As `group`; FormatError where there is none."""
    found = group(parent, name)
    if found is None:
        raise FormatError(f"expected a group {name}, found none", place=_place(parent))
    return found


def ints(parent: h5py.Group, name: str, columns: int | None = None) -> Ints | None:
    """Whole numbers, (n,) or (n, columns), as int64; None where there is no such dataset."""
    return _array(parent, name, columns, "iu", np.int64)


def unsigned(parent: h5py.Group, name: str) -> NDArray[np.uint64] | None:
    """Whole numbers (n,) as uint64."""
    return _array(parent, name, None, "iu", np.uint64)


def floats(parent: h5py.Group, name: str, columns: int | None = None) -> Floats | None:
    """Numbers, (n,) or (n, columns), as float64."""
    return _array(parent, name, columns, "f", np.float64)


def strings(parent: h5py.Group, name: str) -> list[str] | None:
    """A list of strings, of variable or fixed length."""
    found = _dataset(parent, name)
    if found is None:
        return None
    with _guarded(_place(parent, name)):
        is_text = found.dtype.kind in "OS" and _is_plain(found.dtype)
        if found.ndim != 1 or not is_text or found.size > _MOST_STRINGS:
            raise FormatError(f"expected a list of strings, found {_kind(found)}", place=_place(parent, name))
        _check_strings(found)
        items = found[()]
    return [text(item) for item in items]


def attribute(owner: h5py.Group | h5py.Dataset, name: str, is_required: bool = True) -> NDArray[Any]:
    """The values of an attribute, as a flat array; FormatError where it must be there and isn't."""
    with _guarded(_place(owner)):
        if name in owner.attrs:
            _check_attribute(owner, name)
            return np.asarray(owner.attrs[name]).reshape(-1)
    if is_required:
        raise FormatError(f"expected an attribute {name}, found none", place=_place(owner))
    return np.empty(0)


def dataset_attribute(parent: h5py.Group, name: str, attribute_name: str) -> NDArray[Any]:
    """The values of an attribute of a dataset, none where there are none."""
    found = _dataset(parent, name)
    return np.empty(0) if found is None else attribute(found, attribute_name, is_required=False)


def attribute_names(owner: h5py.Group) -> list[str]:
    """The names of all attributes."""
    with _guarded(_place(owner)):
        return list(owner.attrs)


def text_attribute(owner: h5py.Group, name: str) -> str:
    """An attribute that is one string."""
    values = attribute(owner, name)
    if len(values) != 1:
        raise FormatError(f"expected one string in {name}, found {len(values)}", place=_place(owner))
    return text(values[0])


def text(value: object) -> str:
    """A string attribute or item as text; FormatError for anything else."""
    if isinstance(value, str):
        value = value.encode("utf-8", "surrogateescape")
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    raise FormatError(f"expected a string, found {type(value).__name__}")


def version(owner: h5py.Group, greatest: int) -> int:
    """FORMAT_VERSION of a group; FormatError where it is missing or greater than ``greatest``."""
    value = attribute(owner, "FORMAT_VERSION")
    if value.dtype.kind not in "iu" or value.size != 1 or not 1 <= value[0] <= greatest:
        raise FormatError(f"expected FORMAT_VERSION 1 to {greatest}, found {value.tolist()}", place=_place(owner))
    return int(value[0])


@contextmanager
def _guarded(place: str | None = None) -> Iterator[None]:
    """What h5py raises in the block becomes FormatError."""
    try:
        yield
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, ArithmeticError, AttributeError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FormatError(f"the HDF5 data are damaged ({reason[:200]})", place=place) from error


def _place(owner: h5py.Group | h5py.Dataset, name: str = "") -> str:
    with _guarded():
        return f"{owner.name}/{name}".rstrip("/") or "/"


def _member(parent: h5py.Group, name: str) -> h5py.Group | h5py.Dataset | None:
    import h5py

    with _guarded(_place(parent, name)):
        link = parent.get(name, getlink=True)
        if link is None:
            return None
        if not isinstance(link, h5py.HardLink):
            raise FormatError("expected data in the file itself, found a link", place=_place(parent, name))
        return parent[name]


def _dataset(parent: h5py.Group, name: str) -> h5py.Dataset | None:
    """A dataset that is stored right here and as large as it claims, None where there is none."""
    import h5py

    found = _member(parent, name)
    if found is None:
        return None
    place = _place(parent, name)
    if not isinstance(found, h5py.Dataset):
        raise FormatError("expected a dataset, found a group", place=place)
    with _guarded(place):
        if found.is_virtual or found.external:
            raise FormatError("expected data in the file itself, found references to others", place=place)
        if found.shape is None:
            raise FormatError("expected numbers or strings, found nothing", place=place)
        _check_stored(found, place)
    return found


def _array(parent: h5py.Group, name: str, columns: int | None, kinds: str, dtype: type) -> NDArray[Any] | None:
    found = _dataset(parent, name)
    if found is None:
        return None
    with _guarded(_place(parent, name)):
        shape = (*found.shape[:1], columns) if columns else found.shape[:1]
        if found.dtype.kind not in kinds or found.dtype.itemsize > 8 or found.shape != shape or not shape:
            expected = f"{'whole ' if 'i' in kinds else ''}numbers{f' in {columns} columns' if columns else ''}"
            raise FormatError(f"expected {expected}, found {_kind(found)}", place=_place(parent, name))
        out = np.empty(found.shape, dtype)
        if out.size:
            found.read_direct(out)
        return out


def _check_stored(found: h5py.Dataset, place: str) -> None:
    """FormatError where a dataset claims more than the file can hold for it."""
    claimed = math.prod(found.shape) * found.dtype.itemsize
    stored = found.id.get_storage_size()
    is_packed = found.id.get_create_plist().get_nfilters() > 0
    if claimed > stored * (_DEFLATE_RATIO if is_packed else 1):
        raise FormatError(f"expected {claimed} bytes as declared, found {stored} stored", place=place)
    if is_packed and stored > 2 * claimed + (1 << 20):
        raise FormatError(f"expected at most {claimed} bytes packed, found {stored} stored", place=place)


def _check_attribute(owner: h5py.Group | h5py.Dataset, name: str) -> None:
    """FormatError for an attribute of an unknown kind or greater than any; the library would crash or never end."""
    found = owner.attrs.get_id(name)
    if not _is_plain(found.dtype):
        raise FormatError(f"expected numbers or strings in {name}, found {found.dtype}", place=_place(owner))
    if found.dtype.kind == "O":
        _check_attribute_strings(owner, name)
    claimed = found.get_space().get_simple_extent_npoints() * found.get_type().get_size()
    if claimed > _GREATEST_ATTRIBUTE:
        raise FormatError(f"expected a short attribute {name}, found {claimed} bytes", place=_place(owner))


def _check_strings(found: h5py.Dataset) -> None:
    """FormatError where strings of variable length claim more than the file holds."""
    offset = found.id.get_offset()
    if offset is not None and found.dtype.kind == "O":
        path = Path(found.file.filename)
        with path.open("rb") as file:
            file.seek(offset)
            check_lengths(file.read(found.id.get_storage_size()), path.stat().st_size)


def _check_attribute_strings(owner: h5py.Group | h5py.Dataset, name: str) -> None:
    """As `_check_strings`."""
    import h5py

    path = Path(owner.file.filename)
    with path.open("rb") as file:
        data = attribute_data(file, h5py.h5o.get_info(owner.id).addr, name.encode("utf-8", "surrogateescape"))
    check_lengths(data, path.stat().st_size)


def _is_plain(dtype: np.dtype[Any]) -> bool:
    """Whether a type is one of numbers or strings."""
    import h5py

    return dtype.kind in "iufS" or h5py.check_string_dtype(dtype) is not None


def _kind(found: h5py.Dataset) -> str:
    return f"{found.dtype} of shape {found.shape}"
