"""What converters of HDF5 files share: opening, sniffing, and errors that name what is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.formats.errors import ElvisError, FormatError

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]


#: what the library raises for damaged files
_DAMAGES = (OSError, RuntimeError, KeyError, ValueError, TypeError)


@contextmanager
def opened(path: Path) -> Iterator[h5py.File]:
    """The file, open for reading; FormatError where it is damaged, inside the block too."""
    import h5py

    try:
        with h5py.File(path) as file:
            yield file
    except _DAMAGES as error:
        if isinstance(error, ElvisError):
            raise
        reason = " ".join(str(error).split())
        raise FormatError(f"expected a whole HDF5 file, found: {reason}", file=path) from error


def holds(path: Path, *names: str) -> bool:
    """Whether this is an HDF5 file with all these members."""
    import h5py

    if not path.is_file() or not h5py.is_hdf5(path):
        return False
    try:
        with h5py.File(path) as file:
            return all(name in file for name in names)
    except _DAMAGES:
        return False


def require(file: h5py.File, name: str) -> Any:
    """A dataset of the file; FormatError where there is none."""
    import h5py

    found = file.get(name)
    if not isinstance(found, h5py.Dataset):
        raise FormatError(f"expected a dataset {name}, found none", file=file.filename)
    return found


def attribute(file: h5py.File, name: str) -> Any:
    """The only value of an attribute, a scalar or an array of one; FormatError where there is none."""
    if name not in file.attrs:
        raise FormatError(f"expected an attribute {name}, found none", file=file.filename)
    values = np.ravel(file.attrs[name])
    if len(values) != 1:
        raise FormatError(f"expected one value of the attribute {name}, found {len(values)}", file=file.filename)
    return values[0]


def text(value: Any) -> str:
    """A string of a file, with its padding gone."""
    decoded = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return decoded.strip("\0 ")
