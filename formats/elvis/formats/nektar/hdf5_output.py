"""HDF5 files to be written: a disk that is full is noticed by us, not by the library.

The library can't close a file that it can't write any more: it fails again at every attempt, the last time while the
process ends.  It also reads again what it has written.  So it writes to a stream that goes on in memory when the disk
is full, and remembers what the system has said.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO, FileIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]


@contextmanager
def created(path: Path) -> Iterator[h5py.File]:
    """A new HDF5 file, open for writing in the block; OSError at its end where not all of it could be written."""
    import h5py

    stream = _Stream(path)
    try:
        with h5py.File(stream, "w") as file:
            yield file
    finally:
        stream.content.close()
    if stream.failure:
        raise stream.failure


class _Stream:
    """A file that can always be written and read again; the first failure of the disk is kept.

    content  the file on the disk, after a failure the same in memory
    """

    def __init__(self, path: Path) -> None:
        self.content: FileIO | BytesIO = FileIO(path, "w+")
        self.failure: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of it."""
        start = self.content.tell()
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while rest:
                rest = rest[self.content.write(rest) or 0 :]
        except OSError as error:
            self._go_on_in_memory(error)
            self.content.seek(start)
            self.content.write(data)
        return size

    def truncate(self, size: int) -> int:
        """Make the file as long as said, which may need space, too."""
        try:
            return self.content.truncate(size)
        except OSError as error:
            self._go_on_in_memory(error)
            missing = size - self.content.seek(0, os.SEEK_END)
            self.content.write(bytes(max(missing, 0)))
            return self.content.truncate(size)

    def readinto(self, buffer: Any) -> int:
        """Fill the buffer with what comes next."""
        return self.content.readinto(buffer) or 0

    def read(self, size: int = -1) -> bytes:
        """What comes next."""
        return self.content.read(size) or b""

    def seek(self, position: int, start: int = os.SEEK_SET) -> int:
        """Go to a place."""
        return self.content.seek(position, start)

    def tell(self) -> int:
        """The place."""
        return self.content.tell()

    def flush(self) -> None:
        """There is no buffer."""

    def _go_on_in_memory(self, failure: OSError) -> None:
        self.failure = failure
        self.content.seek(0)
        written = self.content.read()
        self.content.close()
        self.content = BytesIO(written or b"")
