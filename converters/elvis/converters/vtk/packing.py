"""Sizes of packed arrays in XML files of VTK, checked before the library allocates memory for them.

A packed array begins with integers: the number of blocks, the bytes of a whole block, the bytes of the last block if it
is not whole (else 0), then the packed bytes of each block (VTK file formats, section "XML file formats").
"""

from __future__ import annotations

import mmap
import re
from base64 import b64decode
from binascii import Error
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from elvis.core.base.errors import FormatError
from elvis.core.files.plain import unpacked_limit

#: integers at the beginning of a packed array that tell its size
_SIZES = 3
#: bytes of a file in which its first element stands
_HEAD = 4096

_ARRAY = re.compile(rb"<(?:Data)?Array\b([^>]*[^>/])>\s*|<(?:Data)?Array\b([^>]*)/>")
_ATTRIBUTE = re.compile(rb"""(\w+)\s*=\s*["']([^"']*)["']""")
_FILE = re.compile(rb"<VTKFile\b([^>]*)>")
_APPENDED = re.compile(rb"<AppendedData\b([^>]*)>\s*_")


def check_packed(path: Path, raw: mmap.mmap, size: int) -> None:
    """Raise FormatError if the packed arrays of a file hold more than ``size`` bytes of all files can.

    raw  the content of the file
    """
    first = _FILE.search(raw, 0, _HEAD)
    file = dict(_ATTRIBUTE.findall(first[1])) if first else {}
    if b"compressor" not in file:
        return
    order = ">" if file.get(b"byte_order") == b"BigEndian" else "<"
    integer = np.dtype(order + ("u8" if file.get(b"header_type") == b"UInt64" else "u4"))
    limit, total = unpacked_limit(size), 0
    for start, is_text in _beginnings(raw):
        total += _unpacked_bytes(raw, start, integer, is_text)
        if total > limit:
            expected = f"packed arrays of at most {limit} bytes, from {size} bytes"
            raise FormatError(f"expected {expected}, found at least {total}", file=path)


def _beginnings(raw: mmap.mmap) -> Iterator[tuple[int, bool]]:
    """The offset of each binary array, and whether it is encoded in base64."""
    appended = _APPENDED.search(raw, max(raw.find(b"<AppendedData"), 0))
    is_text = appended is not None and b"raw" not in dict(_ATTRIBUTE.findall(appended[1])).get(b"encoding", b"base64")
    for array in _ARRAY.finditer(raw, 0, appended.start() if appended else len(raw)):
        own = dict(_ATTRIBUTE.findall(array[1] or array[2]))
        kind = own.get(b"format")
        if kind == b"binary":
            yield array.end(), True
        elif kind == b"appended" and appended is not None and own.get(b"offset", b"").isdigit():
            yield appended.end() + int(own[b"offset"]), is_text


def _unpacked_bytes(raw: mmap.mmap, start: int, integer: np.dtype[np.unsignedinteger], is_text: bool) -> int:
    """Bytes of the array that begins here; 0 if nothing readable does."""
    count = _SIZES * integer.itemsize
    try:
        head = b64decode(raw[start : start + 4 * -(-count // 3)]) if is_text else raw[start : start + count]
    except Error:
        return 0
    if len(head) < count:
        return 0
    blocks, whole, last = map(int, np.frombuffer(head[:count], integer))
    return blocks * whole if last == 0 else max(blocks - 1, 0) * whole + last
