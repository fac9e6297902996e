"""Plain files: a device or a pipe may have no end, so none is opened to be read."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path
from typing import Any

from elvis.core.base.errors import FormatError

#: no deflate stream holds more than this many bytes for each of its own
DEFLATE_RATIO = 1032
#: packed data of meshes and fields grow by less, but for fields of zeros in small files
_GREATEST_RATIO = 64
_ALWAYS_ALLOWED = 1 << 24

_OTHERS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
}


def check_plain(path: str | Path) -> None:
    """Raise FormatError unless the path, or the target of the link, is a plain file."""
    found = _other(path)
    if found is not None:
        raise FormatError(found, file=path)


def check_plain_or_folder(path: str | Path) -> None:
    """`check_plain` that also accepts folders."""
    if not Path(path).is_dir():
        check_plain(path)


def leading(path: str | Path, count: int) -> bytes:
    """The first bytes, ``count`` at most, of a plain file; empty if it is unreadable or not a plain file."""
    if _other(path) is not None:
        return b""
    try:
        with open(path, "rb") as file:
            return file.read(count)
    except OSError:
        return b""


def content(path: str | Path) -> bytes:
    """All bytes of a plain file; raises FormatError if it is not a plain file or can't be read."""
    check_plain(path)
    try:
        return Path(path).read_bytes()
    except OSError as error:
        raise FormatError(f"cannot be read: {error.strerror}", file=path) from error


def json_content(path: str | Path) -> Any:
    """The content of a plain JSON file; raises FormatError if it is not JSON."""
    try:
        return json.loads(content(path))
    except RecursionError:
        raise FormatError("expected JSON, found lists or tables that are nested too deeply", file=path) from None
    except ValueError as error:
        raise FormatError(f"expected JSON, found something else ({error})", file=path) from error


def unpacked_limit(packed: int, whole: int | None = None) -> int:
    """Bytes that packed data may hold; readers reject larger claims before they allocate memory.

    packed  bytes of the data
    whole   bytes of their file, which may hold a field of zeros next to others; None if the data are all of it
    """
    size = packed if whole is None else whole
    return min(DEFLATE_RATIO * packed, _ALWAYS_ALLOWED + _GREATEST_RATIO * size)


def _other(path: str | Path) -> str | None:
    """A description of a path that isn't a plain file, None for a plain file."""
    try:
        kind = stat.S_IFMT(os.stat(path).st_mode)
    except (FileNotFoundError, NotADirectoryError, ValueError):  # ValueError: a name that holds a zero byte
        return "there is no such file"
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    return None if kind == stat.S_IFREG else f"expected a file, found {_OTHERS.get(kind, 'something else')}"
