"""Virtual datasets of HDF5, whose rows lie in other files of the same folder.

Neko stores the values of each step in a file of its own, and VTK the values of each part.  The library opens such files
on its own, even to determine a length, and waits forever if one is a pipe.  The table of sources is therefore read
here, each file is checked before it is opened, and rows without a file are an error instead of fill values.

Layout: HDF5 Reference Manual, H5Pset_virtual.  ``%b`` in a name represents the number of a block.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.converters.shared.hdf5 import reading, require
from elvis.core.base.errors import FormatError

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

#: blocks that one entry of a table of sources may have
_MOST_BLOCKS = 1 << 20


def dataset(file: h5py.Group, name: str) -> Any:
    """A dataset of the file or a virtual one; raises FormatError if it is missing, or larger than the stored data."""
    import h5py

    found = file.get(name)
    if isinstance(found, h5py.Dataset) and found.is_virtual:
        return VirtualDataset(found)
    return require(file, name)


def source_files(file: h5py.Group) -> list[Path]:
    """The files that hold rows of virtual datasets in a group and in the groups below it."""
    import h5py

    found: dict[Path, None] = {}

    def add(_: str, member: h5py.HLObject) -> None:
        if isinstance(member, h5py.Dataset) and member.is_virtual:
            found.update((source.path, None) for source in VirtualDataset(member).sources)

    file.visititems(add)
    return [path for path in found if path != Path(file.file.filename)]


@dataclass(frozen=True)
class _Source:
    """Source of rows ``first`` to ``first + count``: a dataset ``name`` in a file from its row ``start`` on."""

    first: int
    count: int
    path: Path
    name: str
    start: int


class VirtualDataset:
    """A dataset in whole rows of other files, with h5py's interface for slices of rows.

    Raises FormatError for sources outside the file's folder, and for sources that hold parts of rows.
    """

    def __init__(self, found: h5py.Dataset) -> None:
        self.dtype = found.dtype
        self._place = found.name
        self._file = Path(found.file.filename)
        #: description of the missing data if rows end early
        self.lack = ""
        table = found.id.get_create_plist()
        entries = range(table.get_virtual_count())
        self.sources = [source for entry in entries for source in self._of_entry(table, entry)]
        rows = max((source.first + source.count for source in self.sources), default=0)
        tails = {table.get_virtual_vspace(entry).get_simple_extent_dims()[1:] for entry in entries}
        if len(tails) != 1:
            raise self._unknown("rows of one width")
        self.shape: tuple[int, ...] = (rows, *tails.pop())
        self.ndim = len(self.shape)

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, rows: Any) -> Any:
        """Rows: a slice of them, one by its number, or all."""
        if isinstance(rows, slice):
            start, stop, _ = rows.indices(len(self))
            return self._read(start, stop)
        if isinstance(rows, tuple):
            return self._read(0, len(self))
        return self._read(int(rows), int(rows) + 1)[0]

    def _read(self, start: int, stop: int) -> Any:
        """The rows from ``start`` to before ``stop``."""
        parts, at = [np.zeros((0, *self.shape[1:]), self.dtype)], start
        while at < stop:
            source = next((each for each in self.sources if each.first <= at < each.first + each.count), None)
            if source is None:
                raise FormatError(f"expected rows {start} to {stop - 1}, found no file for row {at}", place=self._place)
            count = min(stop, source.first + source.count) - at
            parts.append(self._of_source(source, source.start + at - source.first, count))
            at += count
        return np.concatenate(parts)

    def _of_source(self, source: _Source, start: int, count: int) -> Any:
        """Rows of the file of a source."""
        with reading(source.path) as file:
            found = require(file, source.name)
            has_rows = found.ndim == self.ndim and len(found) >= start + count
            if not has_rows or found.shape[1:] != self.shape[1:] or found.dtype.kind != self.dtype.kind:
                expected = f"{start + count} rows of {math.prod(self.shape[1:])} as {self._file.name} declares"
                raise FormatError(f"expected {expected}, found {found.dtype} of shape {found.shape}", place=source.name)
            return found[start : start + count]

    def _of_entry(self, table: Any, entry: int) -> Iterator[_Source]:
        """The sources of an entry of the table: one of each block of rows."""
        from h5py import h5s

        name = table.get_virtual_dsetname(entry)
        pattern = table.get_virtual_filename(entry)
        first, stride, count, block = self._rows_of(table.get_virtual_vspace(entry))
        origin = table.get_virtual_srcspace(entry)
        # the library stores no extent of a source that is whole
        start = 0 if origin.get_select_type() == h5s.SEL_ALL else self._rows_of(origin)[0]
        for number in range(min(count, _MOST_BLOCKS)):
            path = self._path(pattern, number)
            if count > _MOST_BLOCKS and not path.exists():
                self.lack = f"no file {path.relative_to(self._file.parent)}"
                return
            begin = start if "%b" in pattern else start + number * block
            yield _Source(first + number * stride, block, path, name, begin)
            if count > _MOST_BLOCKS and "%b" not in pattern:
                raise self._unknown("a limited number of rows, or a name with %b")

    def _rows_of(self, space: h5py.h5s.SpaceID) -> tuple[int, int, int, int]:
        """First row, stride, number and length of the blocks of rows that a space selects."""
        import h5py

        extents = space.get_simple_extent_dims()
        if space.get_select_type() == h5py.h5s.SEL_ALL:
            return 0, extents[0], 1, extents[0]
        if space.get_select_type() != h5py.h5s.SEL_HYPERSLABS or not space.is_regular_hyperslab():
            raise self._unknown("rows in blocks")
        starts, strides, counts, blocks = space.get_regular_hyperslab()
        covered = [count * block for count, block in zip(counts[1:], blocks[1:], strict=True)]
        if any(starts[1:]) or covered != list(extents[1:]):
            raise self._unknown("whole rows")
        if counts[0] > 1 and strides[0] == blocks[0] and counts[0] <= _MOST_BLOCKS:
            return starts[0], counts[0] * blocks[0], 1, counts[0] * blocks[0]
        return starts[0], strides[0], counts[0], blocks[0]

    def _path(self, pattern: str, block: int) -> Path:
        """The file of a block; raises FormatError unless it is this file or lies below its folder.

        As in HDF5, only the name counts for an absolute path.
        """
        if pattern == ".":
            return self._file
        name = PurePosixPath(pattern.replace("%b", str(block)).replace("%%", "%"))
        if name.is_absolute():
            name = PurePosixPath(name.name)
        if ".." in name.parts or "\0" in str(name):
            expected = f"data in files below the folder of {self._file.name}"
            raise FormatError(f"expected {expected}, found references to {str(name)!r:.200}", place=self._place)
        return self._file.parent / name

    def _unknown(self, expected: str) -> FormatError:
        found = "a virtual dataset of another layout"
        return FormatError(f"expected {expected} in each source, found {found}", place=self._place)
