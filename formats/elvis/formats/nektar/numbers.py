"""Numbers and lists of ids in text, in bulk: whole sections are turned into arrays without a Python object a number.

Lists of ids (``3,5-9,12``, order significant) are stored as ranges until their maximum length is known.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.formats.nektar.xml import Buffer

Number = TypeVar("Number", np.float64, np.int64)

_CHUNK = 1 << 19
_EXACT = 2.0**53
_END_TAG = re.compile(rb"</[A-Z]\s*>")
_WORD = re.compile(rb"\S{1,40}")


def floats(text: bytes) -> Floats:
    """(n,) numbers separated by blanks; raises FormatError if one is malformed."""
    return _parse(text, np.float64)


def ints(text: bytes) -> Ints:
    """(n,) whole numbers separated by blanks; raises FormatError if one is malformed."""
    return _parse(text, np.int64)


def _parse(text: bytes, kind: type[Number]) -> NDArray[Number]:
    if not text.strip():
        return np.empty(0, kind)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", DeprecationWarning)
            return np.fromstring(text, kind, sep=" ")
    except (DeprecationWarning, ValueError):
        raise FormatError(f"expected a number, found {_first_bad(text, kind)!r}") from None


def _first_bad(text: bytes, kind: type[Number]) -> str:
    for word in _WORD.finditer(text):
        try:
            kind(word[0].decode("ascii", "replace"))
        except (ValueError, OverflowError):
            return word[0].decode("ascii", "replace")
    return text[:20].decode("ascii", "replace")


def rows(section: Buffer, start: int, stop: int, widths: Mapping[str, int]) -> dict[str, tuple[Ints, Ints]]:
    """Entries ``<T ID="4">0 1 2</T>`` of whole numbers: by tag ids (n,) and members (n, width).

    ``widths`` gives the number of members for each tag that may occur.  Raises FormatError for anything else in the
    section.
    """
    tables = {tag: _Table(section.count(b"</%s" % tag.encode(), start, stop), widths[tag]) for tag in widths}
    for chunk in chunks(section, start, stop):
        for code, tag in enumerate(widths, 1):
            chunk = _opening(tag).sub(b" -%d \\1 " % code, chunk)
        numbers = section_numbers(chunk, np.int64)
        starts = np.flatnonzero(numbers < 0)
        lengths = np.diff(starts, append=len(numbers))
        if len(numbers) and (not len(starts) or starts[0] != 0):
            raise FormatError(f"expected entries with an ID, found {numbers[0]}")
        if np.any(numbers[starts] < -len(widths)):
            raise FormatError(f"expected ids from 0 up, found {numbers.min()}")
        for code, (tag, width) in enumerate(widths.items(), 1):
            mine = numbers[starts] == -code
            _check_lengths(tag, width, numbers, starts[mine], lengths[mine])
            tables[tag].extend(numbers[starts[mine, None] + np.arange(1, width + 2)])
    return {tag: table.whole() for tag, table in tables.items()}


def vertex_rows(section: Buffer, start: int, stop: int) -> tuple[Ints, Floats]:
    """Entries ``<V ID="4">x y z</V>``: ids (n,) and points (n, 3); errors as `rows`."""
    count = section.count(b"</V", start, stop)
    ids, points, filled = np.empty(count, np.int64), np.empty((count, 3)), 0
    for chunk in chunks(section, start, stop):
        numbers = section_numbers(_opening("V").sub(rb" nan \1 ", chunk), np.float64)
        starts = np.flatnonzero(np.isnan(numbers))
        if len(numbers) and (not len(starts) or starts[0] != 0):
            raise FormatError(f"expected entries <V ID=…>, found {numbers[0]}")
        _check_lengths("V", 3, numbers, starts, np.diff(starts, append=len(numbers)))
        table = numbers.reshape(-1, 5)
        _check_ends(filled + len(table), count)
        if len(table) and table[:, 1].max() > _EXACT:
            raise FormatError(f"expected ids below 2^53, found {table[:, 1].max():.0f}")
        ids[filled : filled + len(table)] = table[:, 1]
        points[filled : filled + len(table)] = table[:, 2:]
        filled += len(table)
    return ids[:filled], points[:filled]


class _Table:
    """Ids and members of one tag, collected chunk by chunk in arrays allocated at full size.

    The arrays use 32 bits if that is enough for all numbers.
    """

    def __init__(self, capacity: int, width: int) -> None:
        self._ids: NDArray[Any] = np.empty(capacity, np.int32)
        self._members: NDArray[Any] = np.empty((capacity, width), np.int32)
        self._filled = 0

    def extend(self, rows: Ints) -> None:
        """Add (n, 1 + width) rows; raises FormatError if entries don't end as they begin."""
        stop = self._filled + len(rows)
        _check_ends(stop, len(self._ids))
        if len(rows) and rows.max() > np.iinfo(self._ids.dtype).max:
            self._ids, self._members = self._ids.astype(np.int64), self._members.astype(np.int64)
        self._ids[self._filled : stop], self._members[self._filled : stop] = rows[:, 0], rows[:, 1:]
        self._filled = stop

    def whole(self) -> tuple[Ints, Ints]:
        """Ids (n,) and members (n, width)."""
        return self._ids[: self._filled], self._members[: self._filled]


def _check_ends(entries: int, ends: int) -> None:
    if entries > ends:
        raise FormatError(f"expected every entry to end with its own tag, found {ends} that do")


def _opening(tag: str) -> re.Pattern[bytes]:
    return re.compile(rb"<%s\s[^<>]*?\bID\s*=\s*[\"']\s*([0-9]+)\s*[\"'][^<>]*>" % tag.encode())


def section_numbers(chunk: bytes, kind: type[Number]) -> NDArray[Number]:
    """Numbers of a piece of a section once its opening tags are replaced.

    Raises FormatError for any other tag.
    """
    text = _END_TAG.sub(b" ", chunk)
    if (wrong := text.find(b"<")) >= 0:
        raise FormatError(f"expected entries with an ID, found {text[wrong : wrong + 40].decode('ascii', 'replace')!r}")
    return _parse(text, kind)


def _check_lengths(tag: str, width: int, numbers: NDArray[Number], starts: Ints, lengths: Ints) -> None:
    wrong = np.flatnonzero(lengths != width + 2)
    if len(wrong):
        start, length = starts[wrong[0]], lengths[wrong[0]]
        entry = f"<{tag} ID={numbers[start + 1]:.0f}>" if length > 1 else f"<{tag}>"
        raise FormatError(f"expected {width} numbers in {entry}, found {max(length - 2, 0)}")


def chunks(section: Buffer, start: int, stop: int) -> Iterator[bytes]:
    """The section in pieces that end with an entry."""
    while start < stop:
        end = section.find(b"</", min(start + _CHUNK, stop), stop)
        end = section.find(b">", end, stop) + 1 if end >= 0 else stop
        yield bytes(memoryview(section)[start : end or stop])
        start = end or stop


_ALLOWED = b"0123456789,- \t\r\n"
#: digits of an id that surely fits into 64 bits
_SHORT_ID = 18
_TO_BLANKS = bytes.maketrans(b",-", b"  ")


@dataclass(frozen=True, eq=False, slots=True)
class IdList:
    """Ranges ``first[i]`` to ``last[i]``, both included, in order; nothing is expanded yet."""

    first: Ints
    last: Ints

    @property
    def count(self) -> int:
        """Number of ids in the list."""
        return sum(map(int, (self.last - self.first).tolist())) + len(self.first)

    def expand(self, limit: int) -> Ints:
        """All ids, in order; raises FormatError if they are more than ``limit``."""
        if self.first is self.last and len(self.first) <= limit:
            return self.first
        if self.count > limit:
            raise FormatError(f"expected at most {limit} ids, found a list of {self.count}")
        return _ranges(self.first, self.last - self.first + 1)

    def first_outside(self, present: Ints) -> int | None:
        """The first id of the list that is not in ``present`` (sorted, each once), None if there is none."""
        start = np.searchsorted(present, self.first, "left")
        stop = np.searchsorted(present, self.last, "right")
        gaps = np.flatnonzero(stop - start <= self.last - self.first)
        if not len(gaps):
            return None
        own = present[start[gaps[0]] : stop[gaps[0]]]
        first = int(self.first[gaps[0]])
        differ = np.flatnonzero(own - first != np.arange(len(own)))
        return first + int(differ[0] if len(differ) else len(own))

    def existing(self, present: Ints) -> Ints:
        """The ids that are in ``present`` (sorted), in the order of the list, for ranges of any length.

        Raises FormatError for a list that repeats the same ids many times.
        """
        start = np.searchsorted(present, self.first, "left")
        if self.first is self.last and start.max(initial=0) < len(present) and (present[start] == self.first).all():
            return self.first
        lengths = np.searchsorted(present, self.last, "right") - start
        if lengths.sum() > 16 * (len(present) + len(self.first)):
            raise FormatError(f"expected a list of {len(present)} ids at most, found {lengths.sum()}")
        return present[_ranges(start[lengths > 0], lengths[lengths > 0])]


def parse_ids(text: str | bytes) -> IdList:
    """The list in ``text``; raises FormatError for anything but ids, commas and ascending ranges."""
    raw = text.encode("utf-8", "replace") if isinstance(text, str) else text
    if raw.isdigit() and len(raw) <= _SHORT_ID:
        # most lists of a file with many composites have one id
        values = np.array([int(raw)])
        return IdList(values, values)
    if wrong := raw.translate(None, _ALLOWED):
        raise FormatError(f"expected a list of ids, found the character {chr(wrong[0])!r}")
    values = ints(raw.translate(_TO_BLANKS))
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


def split(text: str) -> tuple[str, ...]:
    """The parts of a comma-separated list, blanks stripped, none for an empty text."""
    return tuple(part.strip() for part in text.split(",")) if text.strip() else ()


def comma_list(values: Sequence[object]) -> str:
    """A comma-separated list."""
    return ",".join(map(str, values))


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
