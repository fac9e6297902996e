"""Common functions of converters of HDF5 files: opening, sniffing, and reading with errors that name missing data.

Only data stored in the file itself are read, and no memory is allocated that it cannot fill.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.files.plain import check_plain
from elvis.formats.nektar.hdf5_checks import check_attribute, check_stored, check_strings
from elvis.formats.nektar.hdf5_heaps import check_heaps

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]


#: exceptions of the library for damaged files
_DAMAGES = (
    OSError,
    RuntimeError,
    LookupError,
    ValueError,
    TypeError,
    ArithmeticError,
    AttributeError,
    SystemError,  # for names that are not text, when links are listed
)
_MOST_TEXTS = 1 << 20


@contextmanager
def reading(path: Path) -> Iterator[h5py.File]:
    """The file, open for reading; raises FormatError if it is damaged, also inside the block."""
    import h5py

    check_plain(path)
    check_heaps(path)
    try:
        with h5py.File(path) as file:
            check_links(file)
            yield file
    except FormatError as error:
        raise error.within(path) from error
    except _DAMAGES as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FormatError(f"expected a complete HDF5 file, found: {reason[:200]}", file=path) from error


def holds(path: Path, *names: str) -> bool:
    """Whether this is an HDF5 file with all these members."""
    import h5py

    if not path.is_file() or not h5py.is_hdf5(path):
        return False
    try:
        check_heaps(path)
        with h5py.File(path) as file:
            return all(_has_member(file, name) for name in names)
    except (FormatError, *_DAMAGES):
        return False


def check_links(file: h5py.File) -> None:
    """Raise FormatError for links to other files, which may be pipes or devices; nothing is opened to find them."""
    from h5py import h5l

    def place_of_external(name: bytes, link: h5l.LinkInfo) -> str | None:
        is_inside = link.type in (h5l.TYPE_HARD, h5l.TYPE_SOFT)
        return None if is_inside else name.decode("utf-8", "replace")

    # h5py's own visititems_links looks up the path of each link four times
    place = file.id.links.visit(place_of_external, info=True)
    if place is not None:
        raise FormatError("expected data in the file itself, found references to others", place=place)


def _has_member(file: h5py.File, name: str) -> bool:
    """Whether the file has a path with this name; a soft or external link on it is not followed and counts as found."""
    import h5py

    parent = file
    for part in name.split("/"):
        link = parent.get(part, getlink=True) if isinstance(parent, h5py.Group) else None
        if not isinstance(link, h5py.HardLink):
            return link is not None
        parent = parent[part]
    return True


def require(file: h5py.File, name: str) -> Any:
    """A dataset of the file itself that is as large as declared; raises FormatError if it is missing."""
    found = _member(file, name)
    check_stored(found, name)
    return found


def rows(file: h5py.File, name: str, index: tuple[int, ...]) -> Any:
    """A part of a dataset, at first indices.

    Raises FormatError if it is missing, or larger than the data in the file.
    """
    found = _member(file, name)
    check_stored(found, name, math.prod(found.shape[len(index) :]) if index else None)
    return found[index or ...]


def ints(file: h5py.File, name: str, *shape: int | None) -> Ints:
    """Whole numbers of a dataset, an array of this shape, None for any length.

    Raises FormatError if it holds others.
    """
    return np.asarray(_numbers(file, name, "iu", shape), np.int64)


def floats(file: h5py.File, name: str, *shape: int | None) -> Floats:
    """Floating-point numbers of a dataset, checked like `ints`."""
    return np.asarray(_numbers(file, name, "iuf", shape), np.float64)


def texts(file: h5py.File, name: str, *shape: int) -> list[str]:
    """The strings of a dataset, one after another: of a list, or of an array of this shape."""
    found = require(file, name)
    is_shaped = found.shape == shape if shape else found.ndim <= 1
    if found.dtype.kind not in "OS" or not is_shaped or found.size > _MOST_TEXTS:
        raise FormatError(f"expected a list of strings, found {found.dtype} of shape {found.shape}", place=name)
    check_strings(found)
    return [text(item) for item in np.ravel(found[()])]


def attribute(file: h5py.File, name: str) -> Any:
    """The only value of an attribute, a scalar or an array of one; raises FormatError if it is missing."""
    values = attributes(file, name)
    if len(values) != 1:
        raise FormatError(f"expected one value of the attribute {name}, found {len(values)}", file=file.file.filename)
    return values[0]


def attributes(owner: h5py.HLObject, name: str) -> Any:
    """The values of an attribute, one after another; raises FormatError if it is missing."""
    if name not in owner.attrs:
        raise FormatError(f"expected an attribute {name}, found none", file=owner.file.filename)
    check_attribute(owner, name)
    return np.ravel(owner.attrs[name])


def number(file: h5py.File, name: str) -> float:
    """The only value of an attribute, a finite number; raises FormatError for other values."""
    value = attribute(file, name)
    if not isinstance(value, np.number) or not np.isfinite(value):
        raise FormatError(f"expected a number in the attribute {name}, found {value!r:.40}", file=file.file.filename)
    return float(value)


def text(value: Any) -> str:
    """A string of a file, with its padding gone."""
    decoded = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
    return decoded.strip("\0 ")


def _member(file: h5py.File, name: str) -> Any:
    """A dataset that is stored in the file itself."""
    import h5py

    found = file.get(name)
    if isinstance(found, h5py.Dataset) and (
        # checked before the shape, for which the library opens the files of virtual datasets
        found.is_virtual or found.external or found.file.filename != file.file.filename
    ):
        raise FormatError("expected data in the file itself, found references to others", place=name)
    if not isinstance(found, h5py.Dataset) or found.shape is None:
        raise FormatError(f"expected a dataset {name}, found none", file=file.file.filename)
    return found


def _numbers(file: h5py.File, name: str, kinds: str, shape: tuple[int | None, ...]) -> Any:
    return checked_numbers(require(file, name), kinds, shape, name)


def checked_numbers(found: Any, kinds: str, shape: tuple[int | None, ...], place: str) -> Any:
    """An array or dataset, if it has the shape, None for any length, and a type of ``kinds``; else a FormatError."""
    fits = found is not None and found.ndim == len(shape) and found.dtype.kind in kinds
    if not fits or any(n not in (None, m) for n, m in zip(shape, found.shape, strict=True)):
        expected = f"{'whole ' if kinds == 'iu' else ''}numbers of shape ({', '.join(str(n or 'n') for n in shape)})"
        what = "nothing" if found is None else f"{found.dtype} of shape {found.shape}"
        raise FormatError(f"expected {expected}, found {what}", place=place)
    return found
