"""Archives of arrays (.npz): members are read one by one on demand, with a limit on their size.

Layout: NumPy's documentation, "NPY format"; PKWARE, .ZIP File Format Specification.
"""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from elvis.core.base.errors import FormatError
from elvis.core.files.plain import check_plain, unpacked_limit

_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_SUFFIX = ".npy"

#: exceptions that libraries raise for damaged archives and arrays
_DAMAGES = (
    OSError,
    ValueError,
    LookupError,
    RuntimeError,
    TypeError,
    ArithmeticError,
    EOFError,
    SyntaxError,
    TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


def names_in(path: Path) -> frozenset[str]:
    """The names of the arrays in an archive; empty if it is damaged or not an archive."""
    try:
        check_plain(path)
        if not zipfile.is_zipfile(path):
            return frozenset()
        with zipfile.ZipFile(path) as archive:
            return frozenset(_names(archive))
    except (FormatError, *_DAMAGES):
        return frozenset()


class Archive:
    """An open archive; nothing in it is executed.

    names  of its arrays, in their order
    what   description of the expected content, for messages
    Raises FormatError, here and while reading arrays, if the archive is damaged or holds less than it declares.
    """

    def __init__(self, path: Path, what: str = "an archive of arrays") -> None:
        check_plain(path)
        self._path, self._what = path, what
        with self._guard():
            self._archive = zipfile.ZipFile(path)
        self.names = _names(self._archive)

    def __enter__(self) -> Archive:
        return self

    def __exit__(self, *unused: object) -> None:
        self._archive.close()

    def __getitem__(self, name: str) -> NDArray[Any]:
        """An array of numbers or texts."""
        if name not in self.names:
            raise FormatError(f"expected an array {name}, found none", file=self._path)
        with self._guard(name):
            self._check(name)
            with self._archive.open(name + _SUFFIX) as member:
                return np.asarray(npy.read_array(member, allow_pickle=False))

    def _check(self, name: str) -> None:
        """Raise FormatError if a member can't be as large as it says, or its array is of another size."""
        member = self._archive.getinfo(name + _SUFFIX)
        size = self._path.stat().st_size
        held = min(member.compress_size, size)
        most = unpacked_limit(held, size) if member.compress_type == zipfile.ZIP_DEFLATED else held
        if member.compress_type not in _PACKINGS or member.file_size > most:
            raise FormatError(f"expected {member.file_size} bytes as declared, found {held} packed ones")
        shape, dtype, start = self._header(name)
        if dtype.kind not in "biufSU":
            raise FormatError(f"expected numbers or texts, found {dtype}")
        claimed = math.prod(shape) * dtype.itemsize
        if claimed != member.file_size - start:
            raise FormatError(f"expected {claimed} bytes as declared, found {member.file_size - start}")

    def _header(self, name: str) -> tuple[tuple[int, ...], np.dtype[Any], int]:
        """Shape and type of an array, and how many bytes come before its numbers."""
        readers = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
        with self._archive.open(name + _SUFFIX) as member:
            version = npy.read_magic(member)
            if version not in readers:
                raise FormatError(f"expected version 1 or 2 of an array, found {version}")
            shape, _, dtype = readers[version](member)
            return shape, dtype, member.tell()

    @contextmanager
    def _guard(self, place: str | None = None) -> Iterator[None]:
        try:
            yield
        except FormatError as error:
            raise error.within(self._path, place) from error
        except _DAMAGES as error:
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise FormatError(f"expected {self._what}, found: {reason}", file=self._path, place=place) from error


def _names(archive: zipfile.ZipFile) -> tuple[str, ...]:
    return tuple(name.removesuffix(_SUFFIX) for name in archive.namelist() if name.endswith(_SUFFIX))
