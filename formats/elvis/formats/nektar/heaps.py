"""The heaps in which HDF5 files keep their strings, checked before the library walks them.

The HDF5 library trusts sizes in a global heap: one that is too small makes it loop forever, one that is too great makes
it take gigabytes.  Layout: HDF5 File Format Specification, III.E, Global Heap.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from elvis.core.errors import FormatError

_SIGNATURE = b"GCOL\x01\x00\x00\x00"
_HEADER, _LEAST, _STEP = 16, 4096, 1 << 20


def check_heaps(path: Path) -> None:
    """FormatError where a global heap of the file isn't filled exactly by its objects."""
    size = path.stat().st_size
    with path.open("rb") as file:
        for start in list(_starts(file)):
            file.seek(start + len(_SIGNATURE))
            length = int.from_bytes(file.read(8), "little")
            if not _LEAST <= length <= size - start:
                raise FormatError(f"expected a heap of {_LEAST} to {size - start} bytes, found {length}", file=path)
            if not _is_filled(file.read(length - _HEADER)):
                raise FormatError(f"the HDF5 data are damaged (the heap at byte {start})", file=path)


def _starts(file: BinaryIO) -> Iterator[int]:
    """Where the signature stands; heaps need not begin at multiples of eight bytes."""
    base, block = 0, file.read(_STEP)
    while len(block) >= len(_SIGNATURE):
        found = block.find(_SIGNATURE)
        while found >= 0:
            yield base + found
            found = block.find(_SIGNATURE, found + 1)

        # a signature may lie across two blocks
        kept = block[1 - len(_SIGNATURE) :]
        base, block = base + len(block) - len(kept), kept + file.read(_STEP)
        if len(block) == len(kept):
            return


def _is_filled(objects: bytes) -> bool:
    """Whether the objects lie end to end; the free space at the end counts as one, of index zero."""
    position = 0
    while len(objects) - position >= _HEADER:
        index = int.from_bytes(objects[position : position + 2], "little")
        size = int.from_bytes(objects[position + 8 : position + _HEADER], "little")
        length = _HEADER + (size + 7) // 8 * 8 if index else size
        if length < _HEADER:
            return False
        position += length
    return position <= len(objects)
