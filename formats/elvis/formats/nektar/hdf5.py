"""HDF5 with suspicion: only what is stored in the file itself is read, sizes are checked before memory is taken.

h5py raises many kinds of errors on damaged files; `opened` turns them all into FormatError.
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

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

#: no deflate stream holds more than this many bytes for each of its own
_DEFLATE_RATIO = 1032
_MOST_STRINGS = 1 << 24


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """The file, open for reading; errors of the block that come from damage in the file become FormatError."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            yield file
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, ArithmeticError) as error:
        reason = " ".join(str(error).split())
        raise FormatError(f"the HDF5 data are damaged ({reason[:200]})", file=path) from error
    except FormatError as error:
        raise error.within(path) from error


def group(parent: h5py.Group, name: str) -> h5py.Group | None:
    """A group of this name that is stored right here, None where there is none."""
    import h5py

    found = _member(parent, name)
    if found is not None and not isinstance(found, h5py.Group):
        raise FormatError("expected a group, found a dataset", place=f"{parent.name}/{name}")
    return found


def required_group(parent: h5py.Group, name: str) -> h5py.Group:
    """As `group`; FormatError where there is none."""
    found = group(parent, name)
    if found is None:
        raise FormatError(f"expected a group {name}, found none", place=parent.name)
    return found


def dataset(parent: h5py.Group, name: str) -> h5py.Dataset | None:
    """A dataset of this name that is stored right here and as large as it claims, None where there is none."""
    import h5py

    found = _member(parent, name)
    if found is None:
        return None
    place = f"{parent.name}/{name}"
    if not isinstance(found, h5py.Dataset):
        raise FormatError("expected a dataset, found a group", place=place)
    if found.is_virtual or found.external:
        raise FormatError("expected data in the file itself, found references to others", place=place)
    _check_stored(found, place)
    return found


def ints(parent: h5py.Group, name: str, columns: int | None = None) -> Ints | None:
    """Whole numbers, (n,) or (n, columns), as int64."""
    return _array(parent, name, columns, "iu", np.int64)


def unsigned(parent: h5py.Group, name: str) -> NDArray[np.uint64] | None:
    """Whole numbers (n,) as uint64."""
    return _array(parent, name, None, "iu", np.uint64)


def floats(parent: h5py.Group, name: str, columns: int | None = None) -> Floats | None:
    """Numbers, (n,) or (n, columns), as float64."""
    return _array(parent, name, columns, "f", np.float64)


def strings(parent: h5py.Group, name: str) -> list[str] | None:
    """A list of strings, of variable or fixed length."""
    found = dataset(parent, name)
    if found is None:
        return None
    if found.ndim != 1 or found.dtype.kind not in "OS" or found.size > _MOST_STRINGS:
        raise FormatError(f"expected a list of strings, found {_kind(found)}", place=f"{parent.name}/{name}")
    return [text(item) for item in found[()]]


def attribute(owner: h5py.Group, name: str, is_required: bool = True) -> NDArray[Any]:
    """The values of an attribute, as a flat array; FormatError where it must be there and isn't."""
    if name not in owner.attrs:
        if is_required:
            raise FormatError(f"expected an attribute {name}, found none", place=owner.name)
        return np.empty(0)
    return np.asarray(owner.attrs[name]).reshape(-1)


def text_attribute(owner: h5py.Group, name: str) -> str:
    """An attribute that is one string."""
    values = attribute(owner, name)
    if len(values) != 1:
        raise FormatError(f"expected one string in {name}, found {len(values)}", place=owner.name)
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
        raise FormatError(f"expected FORMAT_VERSION 1 to {greatest}, found {value.tolist()}", place=owner.name)
    return int(value[0])


def _member(parent: h5py.Group, name: str) -> h5py.Group | h5py.Dataset | None:
    import h5py

    link = parent.get(name, getlink=True)
    if link is None:
        return None
    if not isinstance(link, h5py.HardLink):
        raise FormatError("expected data in the file itself, found a link", place=f"{parent.name}/{name}")
    return parent[name]


def _array(parent: h5py.Group, name: str, columns: int | None, kinds: str, dtype: type) -> NDArray[Any] | None:
    found = dataset(parent, name)
    if found is None:
        return None
    shape = (len(found), columns) if columns and found.ndim else found.shape[:1]
    if found.dtype.kind not in kinds or found.dtype.itemsize > 8 or found.shape != shape or found.ndim == 0:
        expected = f"{'whole ' if 'i' in kinds else ''}numbers{f' in {columns} columns' if columns else ''}"
        raise FormatError(f"expected {expected}, found {_kind(found)}", place=f"{parent.name}/{name}")
    out = np.empty(found.shape, dtype)
    if out.size:
        found.read_direct(out)
    return out


def _check_stored(found: h5py.Dataset, place: str) -> None:
    """FormatError where a dataset claims more than the file can hold for it."""
    claimed = math.prod(found.shape or (0,)) * found.dtype.itemsize
    stored = found.id.get_storage_size()
    is_packed = found.id.get_create_plist().get_nfilters() > 0
    if claimed > stored * (_DEFLATE_RATIO if is_packed else 1):
        raise FormatError(f"expected {claimed} bytes as declared, found {stored} stored", place=place)
    if is_packed and stored > 2 * claimed + (1 << 20):
        raise FormatError(f"expected at most {claimed} bytes packed, found {stored} stored", place=place)


def _kind(found: h5py.Dataset) -> str:
    return f"{found.dtype} of shape {found.shape}"
