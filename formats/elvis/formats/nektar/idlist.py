"""Lists of ids: ``3,5-9,12``, order significant, kept as ranges until it is known how much they may hold."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Ints
from elvis.core.errors import FormatError
from elvis.formats.nektar import numbers

_ALLOWED = b"0123456789,- \t\r\n"
_TO_BLANKS = bytes.maketrans(b",-", b"  ")


@dataclass(frozen=True, eq=False)
class IdList:
    """Ranges ``first[i]`` to ``last[i]``, both included, in order; nothing is expanded yet."""

    first: Ints
    last: Ints

    @property
    def count(self) -> int:
        """How many ids the list stands for."""
        return sum(map(int, (self.last - self.first).tolist())) + len(self.first)

    def expand(self, limit: int) -> Ints:
        """All ids, in order; FormatError where they are more than ``limit``."""
        if self.first is self.last and len(self.first) <= limit:
            return self.first
        if self.count > limit:
            raise FormatError(f"expected at most {limit} ids, found a list of {self.count}")
        return _ranges(self.first, self.last - self.first + 1)

    def existing(self, present: Ints) -> Ints:
        """The ids that are in ``present`` (sorted), in the order of the list, whatever its ranges claim.

        FormatError for a list that names the same ids over and over.
        """
        start = np.searchsorted(present, self.first, "left")
        lengths = np.searchsorted(present, self.last, "right") - start
        if lengths.sum() > 16 * (len(present) + len(self.first)):
            raise FormatError(f"expected a list of {len(present)} ids at most, found {lengths.sum()}")
        return present[_ranges(start[lengths > 0], lengths[lengths > 0])]


def parse(text: str | bytes) -> IdList:
    """The list in ``text``; FormatError for anything but ids, commas and ascending ranges."""
    raw = text.encode("utf-8", "replace") if isinstance(text, str) else text
    if wrong := raw.translate(None, _ALLOWED):
        raise FormatError(f"expected a list of ids, found the character {chr(wrong[0])!r}")
    values = numbers.ints(raw.translate(_TO_BLANKS))
    if len(values) != (raw.count(b",") + raw.count(b"-") + 1 if raw.strip() else 0):
        raise FormatError(f"expected ids separated by commas, found {_short(raw)}")
    if b"-" not in raw:
        return IdList(values, values)

    # between two numbers there is one separator, a dash for a range
    marks = np.frombuffer(raw, np.uint8)
    ends_range = np.append(False, marks[(marks == ord(",")) | (marks == ord("-"))] == ord("-"))
    is_first = ~ends_range
    first, last = values[is_first], values[is_first]
    last[np.cumsum(is_first)[ends_range] - 1] = values[ends_range]
    if np.any(ends_range[1:] & ends_range[:-1]) or np.any(last < first):
        raise FormatError(f"expected ascending ranges, found {_short(raw)}")
    return IdList(first, last)


def format_ids(ids: Ints) -> str:
    """The list as text, runs of consecutive ids as ranges."""
    if not len(ids):
        return ""
    breaks = np.flatnonzero(np.diff(ids) != 1) + 1
    first, last = ids[np.r_[0, breaks]].tolist(), ids[np.r_[breaks - 1, len(ids) - 1]].tolist()
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in zip(first, last, strict=True))


def _ranges(first: Ints, lengths: Ints) -> Ints:
    """The ranges one after another."""
    total = int(lengths.sum())
    if total == len(first):
        return first.copy()
    step = np.ones(total, np.int64)
    ends = np.cumsum(lengths)
    step[0] = first[0]
    step[ends[:-1]] = first[1:] - (first[:-1] + lengths[:-1] - 1)
    return np.cumsum(step)


def _short(raw: bytes) -> str:
    text = " ".join(raw.decode("ascii", "replace").split())
    return repr(text if len(text) < 40 else text[:37] + "…")
