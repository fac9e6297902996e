"""The older container of CGNS, ADF (Advanced Data Format): a tree of nodes in one file.

Layout: comments at the head of ADF_internals.c of the CGNS library.  A file begins with a header.  A node is a record
of 246 bytes with its name, label, table of children and data.  Pointers are a number of blocks of 4096 bytes and an
offset.  Files of version A write pointers and dimensions as hexadecimal text, files of version B as numbers.
"""

from __future__ import annotations

import math
import mmap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from elvis.converters.cgns.tree import Node
from elvis.core.base.errors import FormatError

#: bytes of the file's header, of a block, of a node, of a pointer, of a tag
_HEADER = 186
_BLOCK = 4096
_NODE = 246
_POINTER = 12
_TAG = 4

#: bytes of a name, of an entry in a table of children, and of what stands before the data of a chunk
_NAME = 32
_ENTRY = _NAME + _POINTER
_LEAD = _TAG + _POINTER

#: maximum number of dimensions of an array, and of levels of nodes, links included
_MOST_DIMENSIONS = 12
_DEEPEST = 40

#: NumPy's types for the types of data
_TYPES = {
    "I4": "i4", "I8": "i8", "U4": "u4", "U8": "u8", "R4": "f4", "R8": "f8", "C1": "u1", "B1": "u1",
    "X4": "c8", "X8": "c16",
}  # fmt: skip


class _File:
    """The bytes of a file, with what its header says of their order and of pointers."""

    def __init__(self, data: mmap.mmap) -> None:
        self.data = data
        header = self.content(0, _HEADER)
        version, order = header[25:26], header[100:101]
        if version not in b"AB" or order not in b"BL" or not version or not order:
            raise FormatError("expected an ADF file of IEEE numbers", place="header")
        self.is_text = version == b"A"
        self.order = ">" if order == b"B" else "<"
        self.root = self.pointer(134)

    def content(self, start: int, count: int) -> bytes:
        """Bytes that the file holds; raises FormatError if it ends before."""
        if not 0 <= start <= start + count <= len(self.data):
            raise FormatError(f"expected {count} bytes at byte {start}, found the end of the file")
        return self.data[start : start + count]

    def hexadecimal(self, start: int, count: int) -> int:
        """A number that is text in files of both versions."""
        raw = self.content(start, count)
        try:
            return int(raw, 16)
        except ValueError:
            raise FormatError(f"expected a hexadecimal number at byte {start}, found {raw!r}") from None

    def number(self, start: int, count: int) -> int:
        """A number that is text only in files of version A."""
        if self.is_text:
            return self.hexadecimal(start, count)
        return int.from_bytes(self.content(start, count), "big" if self.order == ">" else "little")

    def pointer(self, start: int) -> int:
        """The byte to which a pointer leads."""
        return self.number(start, 8) * _BLOCK + self.number(start + 8, 4)

    def check(self, start: int, tag: bytes) -> None:
        """Raise FormatError unless a tag stands there."""
        if self.content(start, len(tag)).lower() != tag.lower():
            raise FormatError(f"expected {tag.decode()} at byte {start}, found {self.content(start, len(tag))!r}")

    def name(self, start: int) -> str:
        """A name or label, whose padding is blanks."""
        return self.content(start, _NAME).decode("ascii", "replace").split("\0")[0].rstrip()


class AdfNode(Node):
    """The node at byte ``start`` of a file."""

    def __init__(self, file: _File, start: int, parent: str, depth: int = 0) -> None:
        file.check(start, b"NoDe")
        file.check(start + _NODE - _TAG, b"TaiL")
        name = file.name(start + 4)
        place = f"{parent}/{name}" if depth else ""
        self.place = place
        self._file, self.start, self._depth = file, start, depth
        if depth > _DEEPEST:
            raise FormatError(f"expected nodes at most {_DEEPEST} deep, found more", place=place)
        if file.name(start + 96).startswith("LK"):
            dimensions, chunks = file.hexadecimal(start + 128, 2), file.hexadecimal(start + 226, 4)
            link = self._data("C1", dimensions, chunks).tobytes().decode("utf-8", "replace")
            self.start = _target(file, link.split("\0")[0].rstrip(), place, depth)
        super().__init__(name, file.name(self.start + 36), place)

    @cached_property
    def children(self) -> Sequence[Node]:
        """The nodes in the table of children, which holds a name and a pointer of each."""
        return [AdfNode(self._file, place, self.place, self._depth + 1) for _, place in self.entries()]

    def entries(self) -> list[tuple[str, int]]:
        """Name of each child, and where it stands."""
        count = self._file.hexadecimal(self.start + 68, 8)
        if not count:
            return []
        table = self._file.pointer(self.start + 84)
        self._file.check(table, b"SNTb")
        self._file.content(table + _LEAD, count * _ENTRY)
        starts = (table + _LEAD + i * _ENTRY for i in range(count))
        return [(self._file.name(start), self._file.pointer(start + _NAME)) for start in starts]

    def array(self) -> Any:
        """The data, whose chunks are put together; None if the node has none."""
        kind = self._file.name(self.start + 96)
        dimensions = self._file.hexadecimal(self.start + 128, 2)
        chunks = self._file.hexadecimal(self.start + 226, 4)
        if kind == "MT" or not dimensions or not chunks:
            return None
        return self._data(kind, dimensions, chunks)

    def _data(self, kind: str, dimensions: int, chunks: int) -> Any:
        if kind.upper() not in _TYPES or dimensions > _MOST_DIMENSIONS:
            raise FormatError(
                f"expected data of a known type, found {kind!r} of {dimensions} dimensions", place=self.place
            )
        shape = [self._file.number(self.start + 130 + 8 * i, 8) for i in range(dimensions)]
        dtype = np.dtype(self._file.order + _TYPES[kind.upper()])
        needed = math.prod(shape) * dtype.itemsize
        if needed > len(self._file.data):
            raise FormatError(f"expected {needed} bytes as declared, found a shorter file", place=self.place)
        raw = b"".join(self._chunks(chunks))
        if len(raw) < needed:
            raise FormatError(f"expected {needed} bytes as declared, found {len(raw)} stored", place=self.place)
        return np.frombuffer(raw[:needed], dtype).reshape(shape[::-1])

    def _chunks(self, count: int) -> Iterator[bytes]:
        """The bytes of each chunk; several of them have a table of pointers to their starts and ends."""
        first = self._file.pointer(self.start + 230)
        if count == 1:
            starts = [first]
        else:
            self._file.check(first, b"DCtb")
            self._file.content(first + _LEAD, 2 * count * _POINTER)
            starts = [self._file.pointer(first + _LEAD + 2 * i * _POINTER) for i in range(count)]
        for start in starts:
            self._file.check(start, b"DaTa")
            end = self._file.pointer(start + _TAG)
            self._file.check(end, b"dEnD")
            yield self._file.content(start + _LEAD, end - start - _LEAD)


def _target(file: _File, link: str, place: str, depth: int) -> int:
    """The node to which a link leads: a file and a path in it, separated by >."""
    other, _, path = link.partition(">")
    if other:
        raise FormatError(f"expected data in the file itself, found a link to {other[:80]!r}", place=place)
    found = AdfNode(file, file.root, "", 0)
    for name in path.strip("/").split("/"):
        start = dict(found.entries()).get(name)
        if start is None:
            raise FormatError(f"expected a node {path[:80]!r}, found none", place=place)
        found = AdfNode(file, start, found.place, depth + 1)
    return found.start


@contextmanager
def read_adf(path: Path) -> Iterator[Node]:
    """The root of a file."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        content = _File(data)
        yield AdfNode(content, content.root, "")
