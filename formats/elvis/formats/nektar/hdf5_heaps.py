"""Check the heaps of an HDF5 file, whose sizes and offsets the library trusts.

A size in a global heap, which stores strings, that is too small makes the library loop forever; one that is too large
makes it allocate gigabytes.  The free blocks of a local heap, which stores the names in a group, form a list: if this
has no end, the library allocates memory without end.  Layout: HDF5 File Format Specification, III.D (Local Heaps),
III.E (Global Heap) and II.A (Superblock).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import BinaryIO

from elvis.core.base.errors import FormatError

_GLOBAL = b"GCOL\x01\x00\x00\x00"
_LOCAL = b"HEAP\x00\x00\x00\x00"
_SIGNATURE_LENGTH = 8
_HEAP_HEADER, _LEAST_HEAP, _HEAP_STEP = 16, 4096, 1 << 20
#: free blocks of all local heaps of a file, which take a second to follow; each takes 16 bytes of it
MAX_FREE_BLOCKS = 1 << 19
#: offset that ends the list of free blocks in a local heap
_END_OF_LIST = 1
_ARE_OWN = ContextVar("own files", default=False)


@contextmanager
def own_files() -> Iterator[None]:
    """Trust files within the block: this program has written them, and they haven't changed."""
    token = _ARE_OWN.set(True)
    try:
        yield
    finally:
        _ARE_OWN.reset(token)


def check_heaps(path: Path) -> None:
    """Raise FormatError unless the objects of each global heap fill it exactly, and free blocks of local ones end.

    A valid file is examined again only if it has changed.
    """
    if _ARE_OWN.get():
        return
    stat = path.stat()
    _check_heaps(path, stat.st_size, (stat.st_dev, stat.st_ino, stat.st_mtime_ns, stat.st_ctime_ns))


@lru_cache(maxsize=256)
def _check_heaps(path: Path, size: int, mark: tuple[int, ...]) -> None:
    """Check all heaps of a file for `check_heaps`; ``mark`` distinguishes versions of the file."""
    with path.open("rb") as file:
        numbers = _numbers_of(file)
        blocks_left = min(size // _HEAP_HEADER, MAX_FREE_BLOCKS)
        for start, signature in list(_heaps(file)):
            file.seek(start + _SIGNATURE_LENGTH)
            if signature == _LOCAL:
                blocks_left -= _free_blocks(file, numbers, size, blocks_left)
            if blocks_left < 0 or (signature == _GLOBAL and not _is_sound(file, path, start, size)):
                raise FormatError(f"the HDF5 data are damaged (the heap at byte {start})", file=path)


def _is_sound(file: BinaryIO, path: Path, start: int, size: int) -> bool:
    """Whether the objects fill the global heap whose signature was read last."""
    length = int.from_bytes(file.read(8), "little")
    if not _LEAST_HEAP <= length <= size - start:
        raise FormatError(f"expected a heap of {_LEAST_HEAP} to {size - start} bytes, found {length}", file=path)
    return _is_filled(file.read(length - _HEAP_HEADER))


@dataclass(frozen=True)
class _Numbers:
    """How a file states numbers: bytes of offsets and of lengths, and the byte from which offsets count."""

    offset: int = 8
    length: int = 8
    base: int = 0


def _numbers_of(file: BinaryIO) -> _Numbers:
    """Numbers of the superblock, which begins at byte 0, 512, 1024, ...; the usual numbers if there is none."""
    end = file.seek(0, 2)
    place = 0
    while place < end:
        file.seek(place)
        block = file.read(16)
        if block[:8] == b"\x89HDF\r\n\x1a\n" and len(block) == 16:
            first = 13 if block[8] < 2 else 9
            return _Numbers(block[first], block[first + 1], place)
        place = 2 * place or 512
    return _Numbers()


def _free_blocks(file: BinaryIO, numbers: _Numbers, size: int, most: int) -> int:
    """Number of free blocks in the local heap whose signature was read last; ``most`` + 1 for a list without an end.

    Each block states the offset of the next one.  The library itself finds offsets beyond the heap.
    """
    sizes = (numbers.length, numbers.length, numbers.offset)
    length, place, data = (int.from_bytes(file.read(count), "little") for count in sizes)
    count = 0
    while place != _END_OF_LIST and place < length and numbers.base + data + place < size and count <= most:
        file.seek(numbers.base + data + place)
        place = int.from_bytes(file.read(numbers.length), "little")
        count += 1
    return count


def _heaps(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Offsets and signatures of heaps, which need not begin at multiples of eight bytes."""
    file.seek(0)
    base, block = 0, file.read(_HEAP_STEP)
    while len(block) >= _SIGNATURE_LENGTH:
        found = [(place, own) for own in (_GLOBAL, _LOCAL) for place in _places(block, own)]
        yield from ((base + place, own) for place, own in sorted(found))

        # a signature may lie across two blocks
        kept = block[1 - _SIGNATURE_LENGTH :]
        base, block = base + len(block) - len(kept), kept + file.read(_HEAP_STEP)
        if len(block) == len(kept):
            return


def _places(block: bytes, part: bytes) -> Iterator[int]:
    """Offsets of a signature in a block; `bytes.find` is several times faster than a regular expression."""
    place = block.find(part)
    while place >= 0:
        yield place
        place = block.find(part, place + len(part))


def _is_filled(objects: bytes) -> bool:
    """Whether the objects lie end to end; the free space at the end counts as one, of index zero."""
    position = 0
    while len(objects) - position >= _HEAP_HEADER:
        index = int.from_bytes(objects[position : position + 2], "little")
        size = int.from_bytes(objects[position + 8 : position + _HEAP_HEADER], "little")
        length = _HEAP_HEADER + (size + 7) // 8 * 8 if index else size
        if length < _HEAP_HEADER:
            return False
        position += length
    return position <= len(objects)
