"""Bytes of files: whole, unpacked where they are gzipped, with a bound on what they may grow to."""

from __future__ import annotations

import zlib
from pathlib import Path

from elvis.core.errors import FormatError
from elvis.core.files.plain import check_plain, content
from elvis.formats.nektar.xml import Buffer, begins_like_xml

HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
GZIP_SIGNATURE = b"\x1f\x8b"

#: data of meshes and text shrink at most so far; what grows more on unpacking is refused
GREATEST_RATIO = 64
ALWAYS_ALLOWED = 1 << 24
_STEP = 1 << 18


def first_bytes(path: Path) -> bytes:
    """The first eight bytes of a file; FormatError where it can't be read or isn't a plain file."""
    check_plain(path)
    try:
        with path.open("rb") as file:
            return file.read(8)
    except OSError as error:
        raise FormatError(f"cannot be read: {error.strerror}", file=path) from error


def head(path: Path, size: int) -> bytes:
    """The first bytes of a file, unpacked where it is gzipped and not damaged; OSError where it can't be read."""
    with path.open("rb") as file:
        raw = file.read(size)
    if not raw.startswith(GZIP_SIGNATURE):
        return raw
    try:
        return zlib.decompressobj(wbits=31).decompress(raw, size)
    except zlib.error:
        return b""


def load(path: Path) -> Buffer:
    """All bytes of a file, unpacked where it is gzipped."""
    raw = content(path)
    return _unpacked(raw, path) if raw.startswith(GZIP_SIGNATURE) else raw


def _unpacked(raw: bytes, path: Path) -> bytearray:
    """The content of all members of a gzip file, one after another."""
    out, limit = bytearray(), ALWAYS_ALLOWED + GREATEST_RATIO * len(raw)
    try:
        while raw:
            raw = _member(raw, out, limit, path).lstrip(b"\0")
    except zlib.error as error:
        raise FormatError(f"the gzip data are damaged ({error})", file=path) from error
    return out


def _member(raw: bytes, out: bytearray, limit: int, path: Path) -> bytes:
    """Append one member to ``out``; the bytes after it."""
    decompressor, rest, start = zlib.decompressobj(wbits=31), b"", 0
    while not decompressor.eof:
        if not rest:
            rest, start = raw[start : start + _STEP], start + _STEP
        piece = decompressor.decompress(rest, _STEP)
        rest = decompressor.unconsumed_tail
        is_first = not out
        out += piece
        if is_first and out and not begins_like_xml(out):
            raise FormatError(f"expected XML in the gzip data, found {bytes(out[:8])!r}", file=path)
        if len(out) > limit:
            message = f"the gzip data grow beyond {GREATEST_RATIO} times their size, which no data of this format do"
            raise FormatError(message, file=path)
        if not (piece or rest or start < len(raw)):
            raise FormatError("the gzip data end early", file=path)
    return decompressor.unused_data + raw[start:]
