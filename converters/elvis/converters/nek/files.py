"""Files of Nek5000 and NekRS: headers, records of numbers in either byte order, the boundaries of a .re2 file.

Layout: Nek5000 documentation, "Field files" and "Mesh files"; core/prepost.f (mfo_write_hdr), core/reader_re2.f.
"""

from __future__ import annotations

import mmap
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.data.mesh import PERIODIC
from elvis.core.files.plain import leading

MAGIC, MESH_MAGIC, _HEADER, _MESH_HEADER = b"#std", b"#v00", 132, 80

#: the number that marks the byte order
_TAG = 6.54321

#: names of the fields for letters of the header, in the order of the file; scalars S01, S02, ... follow
_FIELDS = {"U": "velocity", "P": "pressure", "T": "temperature"}

#: codes of sides whose condition is given by a number of the mesh generator; and of sides inside the mesh
_NUMBERED, _INSIDE = ("MSH", "EXO"), ("E", "J", "SP", "")
#: codes of sides that the mesh identifies with others
_PERIODIC = ("P", "p")

#: bytes that are read before the pages of a file are released
_MOST_TAKEN = 1 << 24
#: more points along an edge are a slip
_MOST_POINTS = 64


def other_file(path: Path) -> str:
    """A description of a file of a run without a field, with advice.

    Empty for fields, and for other programs' files.
    """
    start = leading(path, 512)
    advice = "also give a field file (.f00001), which has the curved points"
    if start.startswith(MESH_MAGIC):
        what = "partition (.ma2)" if path.suffix == ".ma2" else "mesh (.re2)"
        return f"a Nek5000 {what} without a field: {advice}"
    if b"NEKTON" in start or b"PARAMETERS FOLLOW" in start:
        return f"a Nek5000 case (.rea) without a field: {advice}"
    return ""


@dataclass(frozen=True)
class Header:
    """The first line of a field file.

    size      bytes of a number, 4 or 8
    points    along each of the three directions, the last is 1 in 2D
    count     elements in this file; ``total`` of them in all files of the step
    piece, pieces  number of this file among the files of the step, and their total
    contents  letters for its content: X, U, P, T, then the number of scalars
    """

    size: int
    points: tuple[int, int, int]
    count: int
    total: int
    time: float
    step: int
    piece: int
    pieces: int
    contents: str
    scalars: int
    pressure_apart: bool

    @property
    def dimension(self) -> int:
        """2 or 3."""
        return 2 if self.points[2] == 1 else 3

    @property
    def channels(self) -> list[tuple[str, int]]:
        """Records of numbers by name, with the components of each, in the order of the file."""
        names = [("X", "position"), *((letter, name) for letter, name in _FIELDS.items())]
        found = [(name, self.dimension if letter in "XU" else 1) for letter, name in names if letter in self.contents]
        return [*found, *((f"s{i + 1:02d}", 1) for i in range(self.scalars))]


class Piece:
    """One field file, mapped into memory.

    numbers   (count,) ids of its elements, from 1
    """

    def __init__(self, path: Path) -> None:
        self.path, self.header = path, read_header(path)
        order = _byte_order(path, _HEADER)
        head, start = self.header, _HEADER + 4
        needed = start + 4 * head.count + head.size * int(np.prod(head.points)) * head.count * _width(head)
        if path.stat().st_size < needed:
            raise FormatError(f"expected {needed} bytes, found {path.stat().st_size}", file=path)
        self.numbers = np.fromfile(path, f"{order}i4", head.count, offset=start).astype(np.int64)
        with path.open("rb") as file:
            self._mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        self._taken = 0
        # (count, components, points) in the file's own type
        self._records: dict[str, Floats] = {}
        start += 4 * head.count
        for name, components in head.channels:
            shape = (head.count, components, int(np.prod(head.points)))
            flat = np.frombuffer(self._mapped, f"{order}f{head.size}", int(np.prod(shape)), start)
            self._records[name] = flat.reshape(shape)
            start += flat.nbytes

    def take(self, name: str, component: int, rows: Ints) -> Floats:
        """(n, points) values of a component of a record on elements ``rows`` (n,), in the file's own type.

        The pages of the file that were read don't stay in the memory of the process.
        """
        found: Floats = self._records[name][rows, component]
        self._taken += found.nbytes
        if self._taken > _MOST_TAKEN and hasattr(mmap, "MADV_DONTNEED"):
            self._mapped.madvise(mmap.MADV_DONTNEED)
            self._taken = 0
        return found


def _width(head: Header) -> int:
    return sum(components for _, components in head.channels)


def read_header(path: Path) -> Header:
    """The header of a field file; raises FormatError if it isn't one."""
    words = leading(path, _HEADER).decode("ascii", "replace").split()
    try:
        numbers = [int(word) for word in words[1:7]]
        time, step, piece, pieces = float(words[7]), int(words[8]), int(words[9]), int(words[10])
        contents, scalars, apart = _contents(words[11:])
    except (ValueError, IndexError):
        found = " ".join(words)
        raise FormatError(f"expected sizes, time and contents, found {found!r}", file=path, place="header") from None
    size, *points, count, total = numbers
    head = Header(
        size, (points[0], points[1], points[2]), count, total, time, step, piece, pieces, contents, scalars, apart
    )
    _check(head, path)
    return head


def _contents(words: Sequence[str]) -> tuple[str, int, bool]:
    """Letters, number of scalars, and whether the pressure has a mesh of its own, from the end of the header."""
    match = re.fullmatch(r"([XUPT]*)(?:S(\d*))?", words[0])
    if match is None:
        raise ValueError(words[0])
    return match[1], int(match[2] or 0), len(words) > 2 and words[2].upper() == "T"


def _check(head: Header, path: Path) -> None:
    """Raise FormatError for a header that no solver writes."""
    first, second, third = head.points
    if head.size not in (4, 8):
        raise FormatError(f"expected numbers of 4 or 8 bytes, found {head.size}", file=path, place="header")
    if first != second or third not in (1, first) or not 2 <= first <= _MOST_POINTS:
        found = f"{first} x {second} x {third}"
        raise FormatError(
            f"expected 2 to {_MOST_POINTS} points in each direction, found {found}", file=path, place="header"
        )
    if not 0 < head.count <= head.total:
        found = f"{head.count} of {head.total}"
        raise FormatError(f"expected at least one element, found {found}", file=path, place="header")


def _byte_order(path: Path, offset: int) -> str:
    """``<`` or ``>``, by a number that is known."""
    raw = np.fromfile(path, np.uint8, 4, offset=offset)
    for order in "<>":
        if len(raw) == 4 and abs(float(raw.view(f"{order}f4")[0]) - _TAG) < 1e-4:
            return order
    raise FormatError(f"expected {_TAG} after the header in either byte order, found other bytes", file=path)


@dataclass(frozen=True, eq=False)
class Sides:
    """Boundaries of a .re2 file: numbers of elements (n,) from 1, local sides (n,) from 1, and names (n,)."""

    elements: Ints
    sides: Ints
    names: Sequence[str]


def read_boundaries(path: Path) -> tuple[int, Sides]:
    """The number of elements of a .re2 file and its first set of boundary conditions, those inside left out."""
    words = leading(path, _MESH_HEADER).decode("ascii", "replace").split()
    try:
        count, dimension = int(words[1]), int(words[2])
    except (ValueError, IndexError):
        found = " ".join(words)
        raise FormatError(f"expected elements and dimension, found {found!r}", file=path, place="header") from None
    width = 4 if words[0] == "#v001" else 8
    order, data = _byte_order(path, _MESH_HEADER), path.read_bytes()[_MESH_HEADER + 4 :]
    start = width * count * (1 + dimension * 2**dimension)
    table, start = _table(path, data, start, order, width)
    table, start = _table(path, data, start, order, width)
    return count, _label(table, order, width)


def _table(path: Path, data: bytes, start: int, order: str, width: int) -> tuple[bytes, int]:
    """The bytes of the table of eight columns at ``start``, which its length precedes, and where it ends."""
    kind = np.dtype(f"{order}f{width}" if width == 8 else f"{order}i4")
    if start + width > len(data):
        raise FormatError(f"expected {start + width} bytes of numbers, found {len(data)}", file=path)
    rows = int(np.frombuffer(data, kind, 1, start)[0])
    end = start + width * (1 + 8 * rows)
    if rows < 0 or end > len(data):
        raise FormatError(f"expected {rows} entries of a table, found {len(data) - start} bytes", file=path)
    return data[start + width : end], end


def _name(label: str, number: float) -> str:
    """Names of sides with a code and a number of a mesh generator."""
    if label in _PERIODIC:
        return PERIODIC
    return f"{label}_{int(number)}" if number > 0 and label in _NUMBERED else label


def _label(table: bytes, order: str, width: int) -> Sides:
    """Sides with their names: the code of the condition, and the number that a mesh generator gave it."""
    kind = np.dtype(f"{order}f{width}" if width == 8 else f"{order}i4")
    numbers = np.frombuffer(table, kind).reshape(-1, 8)
    codes = np.frombuffer(table, f"S{width}").reshape(-1, 8)[:, 7]
    labels = np.array([code.decode("ascii", "replace").strip("\0 ") for code in codes.tolist()], dtype="U8")
    own = np.nan_to_num(np.frombuffer(table, f"{order}f{width}").reshape(-1, 8)[:, 6])
    kept = ~np.isin(labels, _INSIDE)
    pairs = zip(labels[kept].tolist(), own[kept].tolist(), strict=True)
    names = [_name(label, number) for label, number in pairs]
    places = numbers[kept, :2].astype(np.int64)
    return Sides(places[:, 0], places[:, 1], names)
