"""Binary meshes of Gmsh: whether their numbers fit their bytes, for its library does not survive all that do not.

Layout: Gmsh reference manual, chapter "MSH file format"; versions 4.1 and 2.2.
"""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Callable
from mmap import mmap
from pathlib import Path

from elvis.converters.shared.inputs import is_count
from elvis.core.base.errors import FormatError

#: the integers at the beginning of a section of version 4.1, and at the beginning of its blocks
_HEAD, _BLOCK = "4Q", "3iQ"

_FORMAT = re.compile(rb"\$MeshFormat\s*\n(\S+)\s+1\s+8[ \t\r]*\n")


def check(path: Path, raw: bytes | mmap, width: Callable[[int], int]) -> Counter[int] | None:
    """Number of elements of each type; None for texts and other versions, which pass.

    raw    the file's bytes, without data
    width  number of nodes of a type of elements; FormatError for types that aren't there

    Raises FormatError if the sections of a mesh are longer or shorter than they say.
    """
    found = _FORMAT.match(raw)
    if found is None or found[1] not in (b"4.1", b"2.2", b"2.1", b"2"):
        return None
    counts: Counter[int] = Counter()
    order = "<" if raw[found.end() : found.end() + 4] == b"\1\0\0\0" else ">"
    for name in ("Nodes", "Elements"):
        start, stop = raw.find(f"${name}\n".encode()), raw.rfind(f"$End{name}".encode())
        if 0 <= start < stop:
            walk = _NEW[name] if found[1] == b"4.1" else _OLD[name]
            try:
                end = walk(raw, start + len(name) + 2, order, width, stop, counts)
            except (struct.error, OverflowError):
                end = -1
            if not stop - 2 <= end <= stop:
                expected = "the number of bytes that its counts require"
                raise FormatError(f"expected {expected}, found others", file=path, place=f"${name}")
    return counts


def _new_nodes(
    raw: bytes | mmap, at: int, order: str, width: Callable[[int], int], stop: int, counts: Counter[int]
) -> int:
    """End of the nodes of version 4.1."""
    blocks, *_ = struct.unpack_from(order + _HEAD, raw, at)
    at += 32
    for _ in range(_plausible(blocks, at, stop)):
        dimension, _, parametric, count = struct.unpack_from(f"{order}{_BLOCK}", raw, at)
        at += 20 + count * (32 + 8 * (dimension if parametric else 0))
        if at > stop:
            return -1
    return at


def _new_elements(
    raw: bytes | mmap, at: int, order: str, width: Callable[[int], int], stop: int, counts: Counter[int]
) -> int:
    """End of the elements of version 4.1."""
    blocks, *_ = struct.unpack_from(order + _HEAD, raw, at)
    at += 32
    for _ in range(_plausible(blocks, at, stop)):
        _, _, kind, count = struct.unpack_from(f"{order}{_BLOCK}", raw, at)
        counts[kind] += count
        at += 20 + count * 8 * (1 + width(kind))
        if at > stop:
            return -1
    return at


def _old_nodes(
    raw: bytes | mmap, at: int, order: str, width: Callable[[int], int], stop: int, counts: Counter[int]
) -> int:
    """End of the nodes of version 2."""
    line = raw.find(b"\n", at, stop)
    text = raw[at:line].strip() if line >= 0 else b""
    return line + 1 + int(text) * 28 if is_count(text) else -1


def _old_elements(
    raw: bytes | mmap, at: int, order: str, width: Callable[[int], int], stop: int, counts: Counter[int]
) -> int:
    """End of the elements of version 2."""
    line = raw.find(b"\n", at, stop)
    text = raw[at:line].strip() if line >= 0 else b""
    left, at = int(text) if is_count(text) else -1, line + 1
    while left > 0:
        kind, count, tags = struct.unpack_from(f"{order}3i", raw, at)
        if count < 1 or tags < 0:
            return -1
        counts[kind] += count
        at += 12 + count * 4 * (1 + tags + width(kind))
        left -= count
        if at > stop:
            return -1
    return at if left == 0 else -1


def _plausible(blocks: int, at: int, stop: int) -> int:
    """The number of blocks, limited by the number of bytes."""
    return min(blocks, 1 + (stop - at) // 20)


_NEW = {"Nodes": _new_nodes, "Elements": _new_elements}
_OLD = {"Nodes": _old_nodes, "Elements": _old_elements}
