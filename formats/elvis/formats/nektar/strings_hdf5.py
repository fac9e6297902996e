"""Where HDF5 files say how long their strings are, looked up before the library believes it.

A string of variable length is a descriptor of 16 bytes (length, heap, index), and the library takes memory for whatever
the length says.  No interface of it tells the length beforehand, so descriptors are read from the file itself.  Layout:
HDF5 File Format Specification, IV.A.1 (object headers, version 1) and IV.A.2.m (attributes); data laid out otherwise,
which the tools of this format don't write, are not looked into.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import BinaryIO

import numpy as np

from elvis.core.errors import FormatError

_DESCRIPTOR = 16
_PREFIX = 16
_CONTINUATION, _ATTRIBUTE = 0x10, 0x0C
_MOST_BLOCKS, _GREATEST_BLOCK = 64, 1 << 20


def check_lengths(descriptors: bytes, file_size: int) -> None:
    """FormatError where a string would be longer than the whole file."""
    whole = len(descriptors) // _DESCRIPTOR * _DESCRIPTOR
    lengths = np.frombuffer(descriptors[:whole], "<u4")[::4]
    if len(lengths) and lengths.max() > file_size:
        raise FormatError(f"the HDF5 data are damaged (a string of {lengths.max()} bytes)")


def attribute_data(file: BinaryIO, address: int, name: bytes) -> bytes:
    """The raw data of an attribute in the object header at ``address``, none where it isn't found there."""
    for kind, body in _messages(file, address):
        if kind == _ATTRIBUTE and len(body) > 9:
            found, data = _attribute(body)
            if found == name:
                return data
    return b""


def _messages(file: BinaryIO, address: int) -> Iterator[tuple[int, bytes]]:
    """Kind and body of each message of an object header, its continuations included."""
    file.seek(address)
    prefix = file.read(_PREFIX)
    if len(prefix) < _PREFIX or prefix[0] != 1:
        return
    blocks = [(address + _PREFIX, _number(prefix, 8, 4))]
    for start, length in blocks:
        file.seek(start)
        block, position = file.read(min(length, _GREATEST_BLOCK)), 0
        while position + 8 <= len(block):
            kind, size = _number(block, position, 2), _number(block, position + 2, 2)
            body = block[position + 8 : position + 8 + size]
            if kind == _CONTINUATION and len(body) >= 16 and len(blocks) < _MOST_BLOCKS:
                blocks.append((_number(body, 0, 8) % 2**62, _number(body, 8, 8)))
            yield kind, body
            position += 8 + size


def _attribute(body: bytes) -> tuple[bytes, bytes]:
    """Name and data of an attribute message; version 1 pads its parts to multiples of eight bytes."""
    sizes = [_number(body, place, 2) for place in (2, 4, 6)]
    start = 9 if body[0] == 3 else 8
    name = body[start : start + sizes[0]].split(b"\0")[0]
    for size in sizes:
        start += (size + 7) // 8 * 8 if body[0] == 1 else size
    return name, body[start:]


def _number(raw: bytes, place: int, size: int) -> int:
    return int.from_bytes(raw[place : place + size], "little")
