"""The database in which slangpy stores compiled kernels while a process runs, read and filled through its own library.

It is an LMDB database in a folder ``rhi``: ``data`` contains kernels by key, ``meta`` the time of their last use.  LMDB
trusts its file without any checksum and needs memory maps and locks that network folders don't have, so it lies in a
private folder of this process.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

#: maximum size of the database in bytes; slangpy drops the least recently used entries beyond a part of it
SIZE = 128 << 20
#: flags and operations of lmdb.h
_READ_ONLY, _NO_SYNC, _NO_LOCK, _CREATE = 0x20000, 0x10000, 0x400000, 0x40000
_NEXT, _NOT_FOUND = 8, -30798


class DatabaseError(Exception):
    """An error of LMDB, or a missing LMDB."""


class _Value(ctypes.Structure):
    """MDB_val."""

    _fields_ = (("size", ctypes.c_size_t), ("data", ctypes.c_void_p))

    @staticmethod
    def of(content: bytes) -> _Value:
        """A value that refers to the bytes, which must stay."""
        return _Value(len(content), ctypes.cast(ctypes.c_char_p(content), ctypes.c_void_p))

    def content(self) -> bytes:
        """A copy of the referenced bytes."""
        return ctypes.string_at(self.data, self.size) if self.size else b""


def fill(folder: Path, entries: Iterable[tuple[bytes, bytes]]) -> None:
    """Make a database in an empty folder, of kernels by key that were not used yet; DatabaseError where that fails."""
    never = _Value.of(bytes(8))
    with _transaction(folder, _NO_SYNC | _NO_LOCK) as (library, transaction):
        data, meta = (_table(library, transaction, name, _CREATE) for name in (b"data", b"meta"))
        for key, kernel in entries:
            own = _Value.of(key)
            for table, value in ((data, _Value.of(kernel)), (meta, never)):
                _check(library, library.mdb_put(transaction, table, ctypes.byref(own), ctypes.byref(value), 0))


def content(folder: Path, known: set[bytes]) -> tuple[dict[bytes, bytes], set[bytes]]:
    """Kernels whose keys aren't known, and the keys of all that were used since the database was filled.

    Nobody may write to the database meanwhile.  DatabaseError where there is none, or one that can't be read.
    """
    with _transaction(folder, _READ_ONLY | _NO_LOCK) as (library, transaction):
        used = {key for key, last in _items(library, transaction, b"meta", set()) if any(last)}
        return dict(_items(library, transaction, b"data", known)), used


@cache
def _library() -> Any:
    """The library that slangpy brings LMDB in."""
    import slangpy

    for name in ("libsgl.so", "libsgl.dylib", "sgl.dll"):
        path = Path(slangpy.__file__).parent / name
        if path.is_file():
            library = ctypes.CDLL(str(path))
            library.mdb_strerror.restype = ctypes.c_char_p
            library.mdb_env_close.restype = library.mdb_txn_abort.restype = library.mdb_cursor_close.restype = None
            return library
    raise DatabaseError("slangpy's library was not found")


@contextmanager
def _transaction(folder: Path, flags: int) -> Iterator[tuple[Any, ctypes.c_void_p]]:
    """The library and a transaction, which is committed where the block ends well."""
    try:
        library = _library()
        environment, transaction = ctypes.c_void_p(), ctypes.c_void_p()
        _check(library, library.mdb_env_create(ctypes.byref(environment)))
    except (OSError, AttributeError) as error:
        raise DatabaseError(str(error)) from error
    try:
        _check(library, library.mdb_env_set_mapsize(environment, ctypes.c_size_t(SIZE)))
        _check(library, library.mdb_env_set_maxdbs(environment, 2))
        _check(library, library.mdb_env_open(environment, bytes(folder / "rhi"), flags, 0o600))
        begun = library.mdb_txn_begin(environment, None, flags & _READ_ONLY, ctypes.byref(transaction))
        _check(library, begun)
        try:
            yield library, transaction
        except BaseException:
            library.mdb_txn_abort(transaction)
            raise
        _check(library, library.mdb_txn_commit(transaction))
    finally:
        library.mdb_env_close(environment)


def _table(library: Any, transaction: ctypes.c_void_p, name: bytes, flags: int = 0) -> ctypes.c_uint:
    """One of the tables of the database."""
    table = ctypes.c_uint()
    _check(library, library.mdb_dbi_open(transaction, name, flags, ctypes.byref(table)))
    return table


def _items(library: Any, transaction: ctypes.c_void_p, name: bytes, known: set[bytes]) -> Iterator[tuple[bytes, bytes]]:
    """Keys and values of a table, but for those with known keys."""
    cursor, key, value = ctypes.c_void_p(), _Value(), _Value()
    _check(library, library.mdb_cursor_open(transaction, _table(library, transaction, name), ctypes.byref(cursor)))
    try:
        while (got := library.mdb_cursor_get(cursor, ctypes.byref(key), ctypes.byref(value), _NEXT)) != _NOT_FOUND:
            _check(library, got)
            own = key.content()
            if own not in known:
                yield own, value.content()
    finally:
        library.mdb_cursor_close(cursor)


def _check(library: Any, result: int) -> None:
    if result:
        raise DatabaseError(library.mdb_strerror(result).decode())
