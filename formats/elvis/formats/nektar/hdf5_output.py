"""HDF5 files to be written: a disk that is full is noticed by us, not by the library.

The library can't close a file that it can't write any more: it fails again at every attempt, the last time while the
process ends.  So it writes to a stream that takes everything, and remembers what the system has said.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from io import FileIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]


@contextmanager
def created(path: Path) -> Iterator[h5py.File]:
    """A new HDF5 file, open for writing in the block; OSError at its end where not all of it could be written."""
    import h5py

    with _Stream(path) as stream:
        with h5py.File(stream, "w") as file:
            yield file
        if stream.failure:
            raise stream.failure


class _Stream(FileIO):
    """A file without a buffer whose writes always succeed; the first failure is kept."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "w+")
        self.failure: OSError | None = None

    def write(self, content: Any) -> int:
        """Write all of it, as far as the system takes it."""
        rest = memoryview(content).cast("B")
        size = len(rest)
        try:
            while len(rest) and not self.failure:
                rest = rest[super().write(rest) or 0 :]
        except OSError as error:
            self.failure = error
            self.seek(len(rest), os.SEEK_CUR)
        return size

    def truncate(self, size: int | None = None) -> int:
        """Make the file as long as said, which may need space, too."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.failure = self.failure or error
            return size or 0
