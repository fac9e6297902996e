"""HDF5 read defensively: only data stored in the file itself are read, sizes are checked before memory is allocated.

h5py raises many kinds of errors on damaged files; every call of it is made here, under `format_errors`,
which turns them into FormatError.

When a file is written, ElVis detects a full disk here, not through the library.  The library cannot close a file that
it can no longer write: it fails at every attempt, the last one when the process ends.  When it writes, the library also
reads data back.  The library therefore writes to a stream that continues in memory when the disk is full and that
records the system's error.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO, FileIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.formats.nektar.hdf5_checks import check_attribute, check_stored, check_strings, is_plain
from elvis.formats.nektar.hdf5_heaps import check_heaps
from elvis.formats.nektar.mapped_files import is_mapped

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]


HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
_MOST_STRINGS = 1 << 24
#: bytes beyond which an array is worth being mapped
_LONG = 1 << 20
#: types of tables that are taken without conversion
_OF_TABLES = (np.dtype("<i4"), np.dtype("<u4"), np.dtype("<i8"))


@contextmanager
def reading(path: Path) -> Iterator[h5py.File]:
    """The file, open for reading; errors of the block name it."""
    import h5py

    check_heaps(path)
    try:
        with format_errors():
            file = h5py.File(path, "r")
        with file:
            yield file
    except FormatError as error:
        raise error.within(path) from error


def group(parent: h5py.Group, name: str) -> h5py.Group | None:
    """A group of this name that is stored in this file, None if it does not exist."""
    import h5py

    found = _member(parent, name)
    if found is not None and not isinstance(found, h5py.Group):
        raise FormatError("expected a group, found a dataset", place=_place(parent, name))
    return found


def required_group(parent: h5py.Group, name: str) -> h5py.Group:
    """As `group`; raises FormatError if it does not exist."""
    found = group(parent, name)
    if found is None:
        raise FormatError(f"expected a group {name}, found none", place=_place(parent))
    return found


def ints(parent: h5py.Group, name: str, columns: int | None = None) -> Ints | None:
    """Whole numbers, (n,) or (n, columns), as int64; None if the dataset does not exist."""
    return _array(parent, name, columns, "iu", np.int64)


def table(parent: h5py.Group, name: str, columns: int | None = None) -> Ints | None:
    """`ints`, but of the stored type."""
    return _array(parent, name, columns, "iu", np.int64, is_table=True)


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
    with format_errors(_place(parent, name)):
        is_text = found.dtype.kind in "OS" and is_plain(found.dtype)
        if found.ndim != 1 or not is_text or found.size > _MOST_STRINGS:
            raise FormatError(f"expected a list of strings, found {_kind(found)}", place=_place(parent, name))
        check_strings(found)
        items = found[()]
    return [text(item) for item in items]


def attribute(owner: h5py.Group | h5py.Dataset, name: str, is_required: bool = True) -> NDArray[Any]:
    """The values of an attribute, as a flat array; raises FormatError if it must be there and isn't."""
    with format_errors(_place(owner)):
        if name in owner.attrs:
            check_attribute(owner, name)
            return np.asarray(owner.attrs[name]).reshape(-1)
    if is_required:
        raise FormatError(f"expected an attribute {name}, found none", place=_place(owner))
    return np.empty(0)


def dataset_attribute(parent: h5py.Group, name: str, attribute_name: str) -> NDArray[Any]:
    """The values of an attribute of a dataset, none if there are none."""
    found = _dataset(parent, name)
    return np.empty(0) if found is None else attribute(found, attribute_name, is_required=False)


def attribute_names(owner: h5py.Group) -> list[str]:
    """The names of all attributes."""
    with format_errors(_place(owner)):
        return list(owner.attrs)


def text_attribute(owner: h5py.Group, name: str) -> str:
    """An attribute that is one string."""
    values = attribute(owner, name)
    if len(values) != 1:
        raise FormatError(f"expected one string in {name}, found {len(values)}", place=_place(owner))
    return text(values[0])


def text(value: object) -> str:
    """A string attribute or item as text; raises FormatError for anything else."""
    if isinstance(value, str):
        value = value.encode("utf-8", "surrogateescape")
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    raise FormatError(f"expected a string, found {type(value).__name__}")


def version(owner: h5py.Group, greatest: int) -> int:
    """FORMAT_VERSION of a group; raises FormatError if it is missing or greater than ``greatest``."""
    value = attribute(owner, "FORMAT_VERSION")
    if value.dtype.kind not in "iu" or value.size != 1 or not 1 <= value[0] <= greatest:
        raise FormatError(f"expected FORMAT_VERSION 1 to {greatest}, found {value.tolist()}", place=_place(owner))
    return int(value[0])


@contextmanager
def format_errors(place: str | None = None) -> Iterator[None]:
    """Convert errors that h5py raises in the block to FormatError."""
    try:
        yield
    except (OSError, RuntimeError, LookupError, ValueError, TypeError, ArithmeticError, AttributeError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FormatError(f"the HDF5 data are damaged ({reason[:200]})", place=place) from error


def _place(owner: h5py.Group | h5py.Dataset, name: str = "") -> str:
    with format_errors():
        return f"{owner.name}/{name}".rstrip("/") or "/"


def _member(parent: h5py.Group, name: str) -> h5py.Group | h5py.Dataset | None:
    import h5py

    with format_errors(_place(parent, name)):
        link = parent.get(name, getlink=True)
        if link is None:
            return None
        if not isinstance(link, h5py.HardLink):
            raise FormatError("expected data in the file itself, found a link", place=_place(parent, name))
        return parent[name]


def _dataset(parent: h5py.Group, name: str) -> h5py.Dataset | None:
    """A dataset that is stored in this file and as large as declared, None if it does not exist."""
    import h5py

    found = _member(parent, name)
    if found is None:
        return None
    place = _place(parent, name)
    if not isinstance(found, h5py.Dataset):
        raise FormatError("expected a dataset, found a group", place=place)
    with format_errors(place):
        if found.is_virtual or found.external:
            raise FormatError("expected data in the file itself, found references to others", place=place)
        if found.shape is None:
            raise FormatError("expected numbers or strings, found none", place=place)
        check_stored(found, place)
    return found


def _array(
    parent: h5py.Group, name: str, columns: int | None, kinds: str, dtype: type, *, is_table: bool = False
) -> NDArray[Any] | None:
    found = _dataset(parent, name)
    if found is None:
        return None
    with format_errors(_place(parent, name)):
        shape = (*found.shape[:1], columns) if columns else found.shape[:1]
        if found.dtype.kind not in kinds or found.dtype.itemsize > 8 or found.shape != shape or not shape:
            expected = f"{'whole ' if 'i' in kinds else ''}numbers{f' in {columns} columns' if columns else ''}"
            raise FormatError(f"expected {expected}, found {_kind(found)}", place=_place(parent, name))
        is_wanted = found.dtype in _OF_TABLES if is_table else found.dtype == np.dtype("<f8") == dtype
        if is_mapped() and found.nbytes > _LONG and is_wanted:
            place = found.id.get_offset()
            if place is not None and not found.file.userblock_size:
                return np.memmap(found.file.filename, found.dtype, "r", place, found.shape)
        out = np.empty(found.shape, found.dtype if is_table and is_wanted else dtype)
        if out.size:
            found.read_direct(out)
        return out


def _kind(found: h5py.Dataset) -> str:
    return f"{found.dtype} of shape {found.shape}"


@contextmanager
def created(path: Path) -> Iterator[h5py.File]:
    """A new HDF5 file, open for writing in the block.

    Raises OSError at its end where not all of it could be written.
    """
    import h5py

    stream = _Stream(path)
    try:
        with h5py.File(stream, "w") as file:
            yield file
    except BaseException:
        # objects that h5py could not close because of an interrupt write again when they are released
        stream.go_on_in_memory()
        raise
    stream.content.close()
    if stream.failure:
        raise stream.failure


class _Stream:
    """A file that can always be written and read again; the first failure of the disk is remembered.

    content  the file on the disk, after a failure or an interrupt the same in memory
    """

    def __init__(self, path: Path) -> None:
        self.content: FileIO | BytesIO = FileIO(path, "w+")
        self.failure: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of it."""
        start = self.content.tell()
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while rest:
                rest = rest[self.content.write(rest) or 0 :]
        except OSError as error:
            self.failure = error
            self.go_on_in_memory()
            self.content.seek(start)
            self.content.write(data)
        return size

    def truncate(self, size: int) -> int:
        """Set the length of the file; this may need space."""
        try:
            return self.content.truncate(size)
        except OSError as error:
            self.failure = error
            self.go_on_in_memory()
            missing = size - self.content.seek(0, os.SEEK_END)
            self.content.write(bytes(max(missing, 0)))
            return self.content.truncate(size)

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer with what comes next."""
        return self.content.readinto(buffer) or 0

    def read(self, size: int = -1) -> bytes:
        """Up to ``size`` further bytes."""
        return self.content.read(size) or b""

    def seek(self, position: int, start: int = os.SEEK_SET) -> int:
        """Go to a place."""
        return self.content.seek(position, start)

    def tell(self) -> int:
        """The place."""
        return self.content.tell()

    def flush(self) -> None:
        """Nothing to do, since the stream has no buffer."""

    def go_on_in_memory(self) -> None:
        """Leave the disk: everything written from now on is lost with the stream."""
        self.content.seek(0)
        written = self.content.read()
        self.content.close()
        self.content = BytesIO(written or b"")
