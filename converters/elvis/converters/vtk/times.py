"""The time in a VTK file, found without reading the file: a number in its field data.

XML files hold it as text, or as base64 or bytes, in place or appended at the end, raw or compressed by zlib; legacy
files as text or as bytes, the highest first.  Any other form is left to the library.
"""

from __future__ import annotations

import mmap
import re
import zlib
from base64 import b64decode
from binascii import Error
from pathlib import Path

import numpy as np

from elvis.core.files.plain import leading

#: names of the array that holds the time, the likeliest first
TIMES = ("TimeValue", "TIME", "time", "Time")
#: bytes at the beginning of a file in which field data stand, and of a number in base64
_HEAD, _NUMBER = 1 << 16, 1 << 10

_ARRAY = re.compile(rb"<DataArray\b([^>]*)>([^<]*)")
_ATTRIBUTE = re.compile(rb"""(\w+)\s*=\s*["']([^"']*)["']""")
_LEGACY = re.compile(rb"\b(TimeValue|TIME|time|Time) 1 1 (double|float)\r?\n")
_KINDS = {b"Float64": "f8", b"Float32": "f4", b"double": "f8", b"float": "f4"}


def time_in(path: Path) -> float | None:
    """The time in a file, None if it has none, or if only the library can find it."""
    head = leading(path, _HEAD)
    try:
        if head.startswith(b"# vtk DataFile"):
            return _legacy(head)
        return _of_xml(path, head)
    except (ValueError, KeyError, IndexError, Error, zlib.error, OSError):
        return None


def _legacy(head: bytes) -> float | None:
    """The time in a legacy file."""
    found = {match[1].decode(): match for match in _LEGACY.finditer(head)}
    match = next((found[name] for name in TIMES if name in found), None)
    if match is None:
        return None
    rest = head[match.end() :]
    if b"\nBINARY" in head[: match.start()]:
        kind = np.dtype(f">{_KINDS[match[2]]}")
        return float(np.frombuffer(rest[: kind.itemsize], kind)[0])
    return float(rest.split(maxsplit=1)[0])


def _of_xml(path: Path, head: bytes) -> float | None:
    """The time in an XML file."""
    start, end = head.find(b"<FieldData"), head.find(b"</FieldData>")
    if start < 0 or end < 0:
        return None
    arrays = {}
    for match in _ARRAY.finditer(head, start, end):
        own = dict(_ATTRIBUTE.findall(match[1]))
        arrays[own.get(b"Name", b"").decode()] = own, match[2].strip()
    name = next((name for name in TIMES if name in arrays), None)
    if name is None:
        return None
    own, text = arrays[name]
    if own[b"format"] == b"ascii":
        return float(text)
    file = dict(_ATTRIBUTE.findall(head[head.index(b"<VTKFile") : start]))
    if own[b"format"] == b"appended":
        content, is_text = _appended(path, int(own[b"offset"]))
    else:
        content, is_text = text, True
    order = "<" if file[b"byte_order"] == b"LittleEndian" else ">"
    kind = np.dtype(order + _KINDS[own[b"type"]])
    count = np.dtype(order + ("u8" if file.get(b"header_type") == b"UInt64" else "u4"))
    if b"compressor" not in file:
        data = b64decode(content[: _whole(count.itemsize + kind.itemsize)]) if is_text else content
        return float(np.frombuffer(data[count.itemsize :][: kind.itemsize], kind)[0])
    if file[b"compressor"] != b"vtkZLibDataCompressor":
        return None
    # one packed block: its number, the sizes of blocks and of the last, its packed size
    cut = _whole(4 * count.itemsize) if is_text else 4 * count.itemsize
    sizes = np.frombuffer(b64decode(content[:cut]) if is_text else content[:cut], count)[:4]
    packed = content[cut : cut + (_whole(int(sizes[3])) if is_text else int(sizes[3]))]
    first = zlib.decompressobj().decompress(b64decode(packed) if is_text else packed, kind.itemsize)
    return float(np.frombuffer(first, kind)[0])


def _whole(count: int) -> int:
    """Characters of base64 that hold some bytes."""
    return 4 * -(-count // 3)


def _appended(path: Path, offset: int) -> tuple[bytes, bool]:
    """The bytes at an offset of the appended data, and whether they are base64."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        start = content.find(b"<AppendedData")
        first = content.find(b"_", content.find(b">", start)) + 1
        if start < 0 or not first:
            raise ValueError("nothing is appended")
        is_text = b'"base64"' in content[start:first]
        return content[first + offset : first + offset + _NUMBER], is_text
