"""Binary files of HORSES3D: meshes (.hmesh), solutions and statistics (.hsol), and lists of boundaries (.bmesh).

A header is followed by one array an element, each with its own numbers of nodes.  Layout: loganoz/horses3d,
`SolutionFile.f90` and `HexMesh_SaveSolution`.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from elvis.converters.shared.inputs import is_count
from elvis.core.base.arrays import Floats
from elvis.core.base.errors import FormatError
from elvis.core.files.plain import content, leading

#: bytes before the header, and the header: type, nodes, elements, iteration, time, six reference values, a mark
_NAME_BYTES = 128
_HEADER = struct.Struct("<4i7di")
_DATA = _NAME_BYTES + _HEADER.size

#: the mark after the header, and the one at the end
_BEGIN, _END = 88, 99

#: kinds of files: a mesh, solutions with and without gradients and a sensor, statistics with and without gradients
MESH = 1
SOLUTIONS = (2, 3, 9, 10)
STATISTICS = (4, 5)
WITH_GRADIENTS = (3, 5, 10)
WITH_SENSOR = (9, 10)

#: means and products of velocities in statistics, before the means of variables
MOMENTS = 9

#: the most nodes along a direction
_MOST_NODES = 31
#: the most variables of a node in statistics
_MOST_VARIABLES = 40

#: numbers before the array of an element: how many follow, variables, nodes along each direction
_RECORD = struct.Struct("<5i")


class Header(NamedTuple):
    """The header data of a file; ``nodes`` are 1 for Gauss and 2 for Gauss-Lobatto."""

    kind: int
    nodes: int
    elements: int
    iteration: int
    time: float
    references: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Record:
    """The arrays of an element.

    nodes    (nx, ny, nz)
    arrays   (nx ny nz, variables) one after another, the first direction fastest
    sensor   of the element, None if the file has none
    """

    nodes: tuple[int, int, int]
    arrays: tuple[Floats, ...]
    sensor: float | None = None


class Layout(NamedTuple):
    """Numbers of variables of the arrays of an element, before a sensor and after it, and whether there is one.

    The first number is that which the file states for each element.
    """

    before: tuple[int, ...]
    after: tuple[int, ...] = ()
    has_sensor: bool = False


def header_of(path: Path) -> Header | None:
    """The header of a file; None if the beginning shows that it is not from HORSES3D."""
    head = leading(path, _DATA)
    if len(head) < _DATA:
        return None
    kind, nodes, elements, iteration, *reals, mark = _HEADER.unpack_from(head, _NAME_BYTES)
    if mark != _BEGIN or nodes not in (1, 2) or kind not in range(1, 11) or elements < 0:
        return None
    return Header(kind, nodes, elements, iteration, reals[0], tuple(reals[1:]))


def read_records(path: Path, header: Header) -> tuple[Layout, list[Record]]:
    """The arrays of all elements, and how they are laid out; raises FormatError if the file is damaged."""
    data = content(path)
    for layout in _layouts(data, header):
        found = _records(data, header.elements, layout)
        if found is not None:
            return layout, found
    expected = f"arrays of {header.elements} elements up to the end of the file"
    raise FormatError(f"expected {expected}, found others", file=path)


def _layouts(data: bytes, header: Header) -> Iterator[Layout]:
    """The layouts that a file may have; only its size determines the numbers of some arrays."""
    if len(data) < _DATA + _RECORD.size:
        return
    first = _RECORD.unpack_from(data, _DATA)[1]
    gradients = 3 * (header.kind in WITH_GRADIENTS)
    if header.kind in STATISTICS:
        for variables in range(1, _MOST_VARIABLES + 1):
            yield Layout((first, *(variables,) * (1 + gradients)))
    else:
        # viscosities (total and eddy) and sources may follow
        for after in ((), (1, 1), (first,), (1, 1, first)):
            yield Layout((first,) * (1 + gradients), after, header.kind in WITH_SENSOR)


def _records(data: bytes, elements: int, layout: Layout) -> list[Record] | None:
    """The arrays of all elements; None if they don't end with the file."""
    place, found = _DATA, list[Record]()
    for _ in range(elements):
        if place + _RECORD.size > len(data):
            return None
        count, variables, *nodes = _RECORD.unpack_from(data, place)
        is_sound = count == 4 and variables == layout.before[0] and 0 < min(nodes) <= max(nodes) <= _MOST_NODES
        total = nodes[0] * nodes[1] * nodes[2]
        size = 8 * (total * (sum(layout.before) + sum(layout.after)) + layout.has_sensor)
        place += _RECORD.size
        if not is_sound or place + size > len(data):
            return None
        found.append(_record(data, place, (nodes[0], nodes[1], nodes[2]), layout))
        place += size
    rest = data[place:]
    return found if rest in (b"", struct.pack("<i", _END)) else None


def _record(data: bytes, place: int, nodes: tuple[int, int, int], layout: Layout) -> Record:
    """The arrays of an element, which begin at a byte."""
    total, arrays, sensor = nodes[0] * nodes[1] * nodes[2], [], None
    for part in (layout.before, layout.after):
        for width in part:
            arrays.append(np.frombuffer(data, "<f8", total * width, place).reshape(total, width))
            place += 8 * total * width
        if layout.has_sensor and part is layout.before:
            (sensor,) = struct.unpack_from("<d", data, place)
            place += 8
    return Record(nodes, tuple(arrays), sensor)


class Zone(NamedTuple):
    """A boundary: its name, and elements and sides from 1."""

    name: str
    elements: list[int]
    sides: list[int]


def read_zones(path: Path) -> list[Zone]:
    """The boundaries of a list; raises FormatError if it is damaged."""
    lines = [line for line in content(path).decode("utf-8", "replace").split("\n") if line.strip()]
    words = _Rows(path, lines)
    zones = []
    for _ in range(words.integer("the number of boundaries")):
        name = words.line("the name of a boundary")
        count = words.integer("the number of its sides")
        zones.append(Zone(name, words.integers(count), words.integers(count)))
    return zones


class _Rows:
    """The lines of a list of boundaries."""

    def __init__(self, path: Path, lines: list[str]) -> None:
        self._path, self._lines, self._next = path, lines, 0

    def line(self, what: str) -> str:
        """The next line."""
        if self._next == len(self._lines):
            raise FormatError(f"expected {what}, found the end of the file", file=self._path)
        self._next += 1
        return self._lines[self._next - 1].strip()

    def integer(self, what: str) -> int:
        """The only number of the next line."""
        line = self.line(what)
        if not is_count(line):
            raise FormatError(f"expected {what}, found {line[:40]!r}", file=self._path)
        return int(line)

    def integers(self, count: int) -> list[int]:
        """The next ``count`` numbers, possibly from several lines."""
        words: list[str] = []
        while len(words) < count:
            words += self.line(f"{count} numbers").split()
        if len(words) != count or not all(map(is_count, words)):
            raise FormatError(f"expected {count} whole numbers, found others", file=self._path)
        return [int(word) for word in words]
