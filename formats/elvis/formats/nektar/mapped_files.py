"""Files that are mapped rather than read: only parts that are accessed are in memory."""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

from elvis.core.base.memory import settle_free_memory

_IS_MAPPED = ContextVar("mapped", default=False)
#: bytes examined together
_STEP = 1 << 20


@contextmanager
def mapped(*, if_so: bool = True) -> Iterator[None]:
    """Map long arrays of floats, tables and text within the block.

    The files must not change while data read from them are in use.  Long arrays return to the system once freed.
    """
    if if_so:
        settle_free_memory()
    token = _IS_MAPPED.set(if_so)
    try:
        yield
    finally:
        _IS_MAPPED.reset(token)


def is_mapped() -> bool:
    """Whether this is such a block."""
    return _IS_MAPPED.get()


class MappedBytes(mmap.mmap):
    """The bytes of a file, with those methods of bytes that readers use."""

    @staticmethod
    def of(path: Path) -> MappedBytes:
        """A file that isn't empty; raises OSError if it can't be mapped."""
        with path.open("rb") as file:
            return MappedBytes(file.fileno(), 0, access=mmap.ACCESS_READ)

    def __contains__(self, part: object) -> bool:
        return self.find(part) >= 0  # type: ignore[arg-type]

    def startswith(self, part: bytes, start: int, stop: int) -> bool:
        """As of bytes."""
        return self[start : min(start + len(part), stop)] == part

    def count(self, part: bytes, start: int, stop: int) -> int:
        """`bytes.count` for parts that do not begin as they end."""
        more = len(part) - 1
        starts = range(start, stop, _STEP)
        return sum(self[first : min(first + _STEP + more, stop)].count(part) for first in starts)
