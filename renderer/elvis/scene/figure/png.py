"""PNG files written row by row (ISO/IEC 15948): the picture need not be in memory as a whole."""

from __future__ import annotations

import zlib
from collections.abc import Iterable
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
#: 8 bits a channel, red green blue, zlib, filters by row, not interlaced
_HEADER = bytes([8, 2, 0, 0, 0])
_LEVEL = 6


def write_png(file: BinaryIO, width: int, height: int, strips: Iterable[NDArray[np.uint8]], software: str) -> None:
    """Write a picture from strips (rows, width, 3), from the top, that have ``height`` rows together.

    software  the program, named in a text of the file
    """
    file.write(_SIGNATURE)
    _chunk(file, b"IHDR", width.to_bytes(4, "big") + height.to_bytes(4, "big") + _HEADER)
    _chunk(file, b"tEXt", b"Software\0" + software.encode("latin-1"))
    compressor, above = zlib.compressobj(_LEVEL), np.zeros((width, 3), np.uint8)
    for strip in strips:
        if data := compressor.compress(_filtered(strip, above)):
            _chunk(file, b"IDAT", data)
        above = strip[-1].copy()
    _chunk(file, b"IDAT", compressor.flush())
    _chunk(file, b"IEND", b"")


def _filtered(strip: NDArray[np.uint8], above: NDArray[np.uint8]) -> bytes:
    """The rows of a strip, each preceded by the number of its filter, after the row (width, 3) above them.

    The filters leave a row unchanged (0), or subtract the pixel to the left (1) or above (2).  Each row takes the
    filter
    with the smallest sum of absolute differences, as signed numbers, as the standard recommends.
    """
    left = strip.copy()
    left[:, 1:] -= strip[:, :-1]
    up = strip - np.concatenate([above[None], strip[:-1]])
    every = [some.reshape(len(strip), -1) for some in (strip, left, up)]
    sums = [np.abs(some.view(np.int8).astype(np.int16)).sum(axis=1, dtype=np.int64) for some in every]
    chosen = np.argmin(sums, axis=0)
    rows = np.empty((len(strip), 1 + every[0].shape[1]), np.uint8)
    rows[:, 0] = chosen
    for number, some in enumerate(every):
        rows[chosen == number, 1:] = some[chosen == number]
    return rows.tobytes()


def _chunk(file: BinaryIO, kind: bytes, data: bytes) -> None:
    """Write one chunk: length, kind, data, checksum of both."""
    file.write(len(data).to_bytes(4, "big") + kind)
    file.write(data)
    file.write(zlib.crc32(data, zlib.crc32(kind)).to_bytes(4, "big"))
