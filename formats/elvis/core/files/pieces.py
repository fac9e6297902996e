"""Substitutions in long texts, piece by piece: a regular expression makes objects for each match of its text."""

from __future__ import annotations

import re
from collections.abc import Iterator

#: bytes of a piece
_PIECE = 1 << 18


def pieces(text: bytes, ends: re.Pattern[bytes]) -> Iterator[bytes]:
    """The text in pieces of about 256 KiB, each but the last of which ends with a match of ``ends``."""
    start = 0
    while start < len(text):
        found = ends.search(text, min(start + _PIECE, len(text)))
        stop = found.end() if found else len(text)
        yield text[start:stop]
        start = stop


def substituted(pattern: re.Pattern[bytes], by: bytes, text: bytes, ends: re.Pattern[bytes]) -> bytes:
    """The text with all matches replaced; no match may reach beyond a match of ``ends``."""
    return b"".join(pattern.sub(by, piece) for piece in pieces(text, ends))
