"""Payloads: numbers as base64 of a zlib stream of little-endian 8-byte items (format notes 1.7).

Both directions go in steps, so that no second copy of a payload is ever held.  Decoding is bounded: by the size that
the reader expects, or by the ratio that meshes can reach at most.
"""

from __future__ import annotations

import binascii
import zlib
from collections.abc import Callable, Iterable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import FormatError
from elvis.core.base.threads import results
from elvis.core.files.plain import DEFLATE_RATIO, unpacked_limit

ENCODING = "B64Z-LittleEndian"

_STEP = 1 << 18
#: bytes that are packed by themselves
_CHUNK = 1 << 20
#: beginning of a zlib stream, and its last block, which is empty
_HEAD, _END = b"\x78\x01", b"\x03\x00"
_BLANKS = b" \t\r\n\f\v\0"
_ALPHABET = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/"


def decode_exactly(text: memoryview, items: int, first: int | None = None) -> NDArray[np.uint8]:
    """(8 items,) bytes of a payload that must hold this many items, as an array of bytes.

    first  number of items requested from the beginning: the rest is not examined

    Raises FormatError if the text is not base64, the stream is damaged or ends early, or holds another number of items.
    """
    check_possible(text, items)
    out, filled = np.empty(8 * (items if first is None else first), np.uint8), 0
    for piece in _exactly(text, items, first):
        out[filled : filled + len(piece)] = np.frombuffer(piece, np.uint8)
        filled += len(piece)
    return out


def numbers_exactly(text: memoryview, items: int, first: int | None = None) -> Iterator[Floats]:
    """The numbers of such a payload in pieces; errors as `decode_exactly`."""
    check_possible(text, items)
    carry = b""
    for piece in _exactly(text, items, first):
        carry += piece
        count = len(carry) // 8
        yield np.frombuffer(carry, "<f8", count)
        carry = carry[8 * count :]


def check_possible(text: memoryview, items: int) -> None:
    """Raise FormatError if the payload is too short for this number of items."""
    if 8 * items > possible_bytes(text):
        raise FormatError(f"expected {items} numbers, found {len(text)} characters, which are too few")


def _exactly(text: memoryview, items: int, first: int | None) -> Iterator[bytes]:
    """The bytes of a payload in pieces; see `decode_exactly`."""
    size, wanted, found = 8 * items, 8 * (items if first is None else first), 0
    for piece in _inflate(text):
        if found + len(piece) > size:
            raise FormatError(f"expected {items} numbers, found more")
        yield piece[: wanted - found]
        found += len(piece)
        if found >= wanted < size:
            return
    if found != size:
        raise FormatError(f"expected {items} numbers, found {_items(found)}")


def decode(text: memoryview, width: int) -> NDArray[np.uint8]:
    """(n, 8 width) bytes of a payload of records of ``width`` items each; errors as `decode_exactly`."""
    out = bytearray()
    for records in record_pieces(text, width):
        out += records
    return np.frombuffer(out, np.uint8).reshape(-1, 8 * width)


def record_pieces(text: memoryview, width: int) -> Iterator[bytes]:
    """The bytes of such a payload in pieces of whole records."""
    carry, found, limit = b"", 0, unpacked_limit(len(text))
    for piece in _inflate(text):
        carry += piece
        found += len(piece)
        if found > limit:
            raise FormatError(f"expected at most {limit} bytes in {len(text)} packed ones, found more")
        whole = len(carry) - len(carry) % (8 * width)
        yield carry[:whole]
        carry = carry[whole:]
    if carry:
        raise FormatError(f"expected records of {width} numbers, found {_items(found)} in all")


def possible_bytes(text: memoryview) -> int:
    """The most bytes that a payload of this many characters can hold."""
    return DEFLATE_RATIO * len(text)


def encode(arrays: Iterable[NDArray[np.generic]]) -> Iterator[bytes]:
    """Base64 of the zlib stream of the arrays' bytes, one after another, in pieces, on one line, without padding.

    The stream consists of chunks that threads pack independently, as pigz does: each ends at a whole byte, so the next
    can be appended (RFC 1950, 1951).  NUL bytes behind it bring its length to a multiple of three; readers ignore them.
    """
    checksum = 1

    def jobs() -> Iterator[Callable[[], bytes]]:
        nonlocal checksum
        for chunk in _chunks(arrays):
            checksum = zlib.adler32(chunk, checksum)
            yield partial(_packed, chunk)

    carry = _HEAD
    for packed in results(jobs()):
        carry += packed
        whole = len(carry) // 3 * 3
        yield binascii.b2a_base64(carry[:whole], newline=False)
        carry = carry[whole:]
    carry += _END + checksum.to_bytes(4, "big")
    yield binascii.b2a_base64(carry + b"\0" * (-len(carry) % 3), newline=False)


def _chunks(arrays: Iterable[NDArray[np.generic]]) -> Iterator[bytes]:
    """The arrays' bytes, one after another, `_CHUNK` at a time."""
    rest = b""
    for array in arrays:
        view = np.ascontiguousarray(array).reshape(-1).view(np.uint8).data
        for start in range(0, len(view), _CHUNK):
            rest += view[start : start + _CHUNK]
            if len(rest) >= _CHUNK:
                yield rest[:_CHUNK]
                rest = rest[_CHUNK:]
    if rest:
        yield rest


def _packed(chunk: bytes) -> bytes:
    """The bytes as blocks of a deflate stream; the last block ends at a whole byte.

    Uses the lowest level: the highest ones take two to eight times as long and save 2 % of the length of ids and
    coefficients.
    """
    compressor = zlib.compressobj(1, wbits=-zlib.MAX_WBITS)
    return compressor.compress(chunk) + compressor.flush(zlib.Z_SYNC_FLUSH)


def _items(size: int) -> str:
    return f"{size // 8}" if size % 8 == 0 else f"{size} bytes"


def _inflate(text: memoryview) -> Iterator[bytes]:
    """The bytes of the zlib stream, in pieces; what follows the stream is ignored."""
    decompressor = zlib.decompressobj()
    try:
        for block in _decode(text):
            rest = block
            while not decompressor.eof:
                piece = decompressor.decompress(rest, _STEP)
                rest = decompressor.unconsumed_tail
                if piece:
                    yield piece
                elif not rest:
                    break
    except zlib.error as error:
        raise FormatError(f"the zlib stream is damaged ({error})") from error
    if not decompressor.eof:
        raise FormatError("the zlib stream ends early")


def _decode(text: memoryview) -> Iterator[bytes]:
    """The bytes that are encoded in base64, in pieces; blanks are skipped, padding may be missing."""
    carry = b""
    for start in range(0, len(text), _STEP):
        carry += bytes(text[start : start + _STEP]).translate(None, _BLANKS)
        if start + _STEP >= len(text):
            carry = _without_padding(carry)
        if wrong := carry.translate(None, _ALPHABET):
            raise FormatError(f"expected base64, found the character {chr(wrong[0])!r}")
        whole = len(carry) // 4 * 4
        yield binascii.a2b_base64(carry[:whole])
        carry = carry[whole:]
    if len(carry) == 1:
        raise FormatError("the base64 text ends early")
    if carry:
        yield binascii.a2b_base64(carry + b"=" * (4 - len(carry)))


def _without_padding(tail: bytes) -> bytes:
    stripped = tail.rstrip(b"=")
    return stripped if len(tail) - len(stripped) < 3 else tail
