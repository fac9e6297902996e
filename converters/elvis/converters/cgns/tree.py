"""The tree of nodes that a CGNS file is, in either container.

Each node has a name, a label for its type, children, and an array.  Arrays are laid out as in Fortran; here they come
with their dimensions reversed, so that the first index of the standard is the last one.  Mapping to HDF5: CGNS
documentation, "CGNS/HDF5 - An HPC implementation".
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.converters.shared.hdf5 import attribute, checked_numbers, holds, reading, require, text
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.files.plain import leading

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

#: first bytes of files of the older container; newer libraries set the highest bit of the first four bytes
ADF_START = b"@(#)ADF Database"
_ADF_MASK = bytes([0x7F] * 4 + [0xFF] * 12)

#: characters of the longest name or value of a node that is a text
_LONGEST_TEXT = 1 << 12

#: links that lead to links
_MOST_LINKS = 16


class Node(ABC):
    """A node: ``place`` is the path of its names."""

    def __init__(self, name: str, label: str, place: str) -> None:
        self.name, self.label, self.place = name, label, place

    @property
    @abstractmethod
    def children(self) -> Sequence[Node]:
        """Nodes below, in the order of the file."""

    @abstractmethod
    def array(self) -> Any:
        """The array of the node with its dimensions reversed; None if it has none."""

    def child(self, name: str) -> Node | None:
        """The node below with this name; None if it does not exist."""
        return next((each for each in self.children if each.name == name), None)

    def labelled(self, label: str) -> list[Node]:
        """The nodes below with this label."""
        return [each for each in self.children if each.label == label]

    def required(self, name: str) -> Node:
        """The node below with this name; raises FormatError if it does not exist."""
        found = self.child(name)
        if found is None:
            raise FormatError(f"expected a node {name}, found none", place=self.place)
        return found

    def text(self) -> str:
        """The array as characters, empty if the node has none."""
        rows = self.texts()
        return rows[0] if rows else ""

    def texts(self) -> list[str]:
        """The array as rows of characters, all but the last of its dimensions taken together."""
        found = self.array()
        if found is None or not found.size:
            return []
        if found.dtype.kind not in "iuS" or found.dtype.itemsize > 1 or found.shape[-1] > _LONGEST_TEXT:
            raise FormatError(f"expected characters, found {found.dtype} of shape {found.shape}", place=self.place)
        rows = np.ascontiguousarray(found).reshape(-1, found.shape[-1])
        return [text(row.tobytes().split(b"\0")[0]) for row in rows]

    def ints(self, *shape: int | None) -> Ints:
        """Whole numbers in an array of this shape, None for any length; raises FormatError for other data."""
        found = self._numbers("iu", shape)
        if found.dtype.kind == "u" and found.size and found.max() > np.iinfo(np.int64).max:
            raise FormatError(f"expected whole numbers of 64 bits, found {found.max()}", place=self.place)
        return np.asarray(found, np.int64)

    def flat_ints(self) -> Ints:
        """Whole numbers in an array of any shape, one after another."""
        found = self.array()
        return self.ints(*(() if found is None else found.shape)).reshape(-1)

    def floats(self, *shape: int | None) -> Floats:
        """Numbers in an array of this shape, of their own precision."""
        return np.asarray(self._numbers("iuf", shape))

    def _numbers(self, kinds: str, shape: tuple[int | None, ...]) -> Any:
        found = checked_numbers(self.array(), kinds, shape, self.place)
        return found.astype(found.dtype.newbyteorder("="), copy=False)


class Hdf5Node(Node):
    """A group of an HDF5 file; names that begin with a blank are the container's own."""

    def __init__(self, group: h5py.Group, name: str, place: str, links: int = 0) -> None:
        kind = text(attribute(group, "type")) if "type" in group.attrs else ""
        if kind == "LK":
            group = _target(group, place, links)
        label = text(attribute(group, "label")) if "label" in group.attrs else ""
        super().__init__(name, label, place)
        self._group = group

    @cached_property
    def children(self) -> Sequence[Node]:
        """Groups below."""
        import h5py

        found: list[Node] = []
        links = self._group.id.links
        for name in self._group:
            if name.startswith(" "):
                continue
            if links.get_info(name.encode("utf-8", "surrogateescape")).type != h5py.h5l.TYPE_HARD:
                raise FormatError("expected data in the file itself, found a link", place=f"{self.place}/{name}")
            member = self._group[name]
            if isinstance(member, h5py.Group):
                found.append(Hdf5Node(member, name, f"{self.place}/{name}"))
        return found

    def array(self) -> Any:
        """The dataset of the group."""
        if " data" not in self._group:
            return None
        try:
            return require(self._group, " data")[()]
        except FormatError as error:
            raise FormatError(error.message, place=self.place) from error


def _target(group: h5py.Group, place: str, links: int) -> h5py.Group:
    """The group of the same file to which a link of CGNS leads."""
    import h5py

    names = {}
    for key in (" path", " file"):
        raw = require(group, key)[()] if key in group else np.zeros(0, np.int8)
        names[key] = text(np.asarray(raw).tobytes().split(b"\0")[0])
    if names[" file"] and Path(names[" file"]).name != Path(group.file.filename).name:
        expected = "data in the file itself"
        raise FormatError(f"expected {expected}, found a link to {names[' file'][:80]!r}", place=place)
    found: Any = group.file
    for name in names[" path"].strip("/").split("/"):
        is_hard = isinstance(found, h5py.Group) and isinstance(found.get(name, getlink=True), h5py.HardLink)
        found = found[name] if is_hard else None
    if not isinstance(found, h5py.Group) or links >= _MOST_LINKS:
        raise FormatError(f"expected a node {names[' path'][:80]!r}, found none", place=place)
    kind = text(attribute(found, "type")) if "type" in found.attrs else ""
    return _target(found, place, links + 1) if kind == "LK" else found


def is_adf(path: Path) -> bool:
    """Whether a file is in the older container."""
    start = leading(path, len(ADF_START))
    return bytes(byte & mask for byte, mask in zip(start, _ADF_MASK, strict=False)) == ADF_START


def is_cgns(path: Path) -> bool:
    """Whether a file is CGNS, in either container."""
    return is_adf(path) or holds(path, "CGNSLibraryVersion")


@contextmanager
def opened(path: Path) -> Iterator[Node]:
    """The root of a file, whose nodes can be read inside the block.

    Raises FormatError with the file in all that it raises.
    """
    from elvis.converters.cgns.adf import read_adf

    if is_adf(path):
        try:
            with read_adf(path) as root:
                yield root
        except FormatError as error:
            raise error.within(path) from error
    else:
        with reading(path) as file:
            yield Hdf5Node(file, "", "")
