"""Files of the GMF family: sections of rows under keywords, as text or as a chain of binary records.

Layout: LoicMarechal/libMeshb, documentation of version 7.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints, joined_floats
from elvis.core.base.errors import FormatError
from elvis.core.files.pieces import pieces, substituted
from elvis.core.files.plain import content, leading

#: kinds of elements: vertices, dimension, letter before the order, numbers of an entry of an ordering table
ELEMENTS: dict[str, tuple[int, int, str, int]] = {
    "Edges": (2, 1, "P", 1),
    "Triangles": (3, 2, "P", 3),
    "Quadrilaterals": (4, 2, "Q", 2),
    "Tetrahedra": (4, 3, "P", 4),
    "Pyramids": (5, 3, "P", 3),
    "Prisms": (6, 3, "P", 4),
    "Hexahedra": (8, 3, "Q", 3),
}

_HIGHEST = 4
_COMMENT = re.compile(rb"#[^\n]*")
_LINE_END = re.compile(rb"\n")
_SPACE = re.compile(rb"\s")
_KEYWORD = re.compile(rb"(?<!\S)[A-Za-z]\S*")
_WORD = re.compile(rb"\s*(\S+)")

#: numbers of nodes by order
_NODES: dict[str, tuple[int, ...]] = {
    "Edges": (2, 3, 4, 5),
    "Triangles": (3, 6, 10, 15),
    "Quadrilaterals": (4, 9, 16, 25),
    "Tetrahedra": (4, 10, 20, 35),
    "Pyramids": (5, 14, 30, 55),
    "Prisms": (6, 18, 40, 75),
    "Hexahedra": (8, 27, 64, 125),
}

#: numbers that binary files write for keywords, of each kind for the orders 1 to 4
_ELEMENT_CODES = {
    "Edges": (5, 25, 92, 93),
    "Triangles": (6, 24, 90, 91),
    "Quadrilaterals": (7, 27, 88, 89),
    "Tetrahedra": (8, 30, 96, 97),
    "Pyramids": (49, 87, 100, 101),
    "Prisms": (9, 86, 102, 103),
    "Hexahedra": (10, 33, 98, 99),
}
_CONSTANT_CODES = {"Edges": 63, "Triangles": 64, "Quadrilaterals": 65, "Tetrahedra": 66, "Prisms": 67, "Hexahedra": 68}

#: for keywords that exist for every kind in this order, the numbers of the first one for the orders 1 to 4
_ORDERING = (141, 127, 128, 142)


@dataclass(frozen=True)
class Keyword:
    """The data of a keyword: ``reals`` and then ``integers`` per row; ``solution`` gives the kind of a solution.

    reals     -1 for the dimension
    whether a single row follows, without a number of rows
    solution  "": none; "sol": one node per element; "ho": with degree and number of nodes
    """

    code: int
    reals: int = 0
    integers: int = 0
    is_single: bool = False
    solution: str = ""


@dataclass(frozen=True, eq=False)
class Section:
    """The rows of a keyword; for a solution also the types of its fields, its degree, and the nodes of an element."""

    reals: Floats
    integers: Ints
    types: tuple[int, ...] = ()
    degree: int = 0
    nodes: int = 1


def section_name(kind: str, order: int) -> str:
    """The keyword of elements, e.g. ``TetrahedraP3``, of order 1 ``Tetrahedra``."""
    return kind if order == 1 else f"{kind}{ELEMENTS[kind][2]}{order}"


def solution_name(kind: str, order: int) -> str:
    """The keyword of a high-order solution on elements of an order."""
    return f"HOSolAt{kind}{ELEMENTS[kind][2]}{order}"


def _keywords() -> dict[str, Keyword]:
    table = {
        "Vertices": Keyword(4, reals=-1, integers=1),
        "Time": Keyword(78, reals=1, is_single=True),
        "BezierBasis": Keyword(125, integers=1, is_single=True),
        "FloatingPointPrecision": Keyword(155, integers=1, is_single=True),
        "SolAtVertices": Keyword(62, solution="sol"),
        "SolAtPyramids": Keyword(26, solution="sol"),
    }
    for kind, code in _CONSTANT_CODES.items():
        table[f"SolAt{kind}"] = Keyword(code, solution="sol")
    for row, (kind, (_, _, letter, width)) in enumerate(ELEMENTS.items()):
        for i in range(_HIGHEST):
            table[section_name(kind, i + 1)] = Keyword(_ELEMENT_CODES[kind][i], integers=_NODES[kind][i] + 1)
            step = 1 if i == _HIGHEST - 1 else 3
            first = 156 if i == _HIGHEST - 1 else 104 + i
            table[solution_name(kind, i + 1)] = Keyword(first + step * row, solution="ho")
            name = f"{kind}{letter}{i + 1}Ordering"
            table[name] = Keyword(_ORDERING[i] + 2 * row, integers=width)
            reals = 2 if kind == "Edges" else width
            positions = f"{solution_name(kind, i + 1)}NodesPositions"
            table[positions] = Keyword(163 + _HIGHEST * row + i, reals=reals)
    return table


KEYWORDS = _keywords()
_NAMES = {keyword.code: name for name, keyword in KEYWORDS.items()}
_END = 54


def is_gmf(path: Path) -> bool:
    """Whether a file begins as text or binary files of this family do."""
    start = leading(path, 4096)
    if re.match(rb"(\s*#[^\n]*\n)*\s*MeshVersionFormatted\s+[1-4]\b", start):
        return True
    return any(len(start) > 12 and _is_header(start, order) for order in "<>")


def _is_header(start: bytes, order: str) -> bool:
    one, version, keyword = struct.unpack_from(order + "3i", start)
    return bool(one == 1 and 1 <= version <= 4 and keyword == 3)


class GmfFile:
    """The sections of a file, by keyword; the dimension; the relative size of its reals, in bytes; remarks."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.remarks: list[str] = []
        raw = content(path)
        self.sections: dict[str, Section] = {}
        if raw[:4] in (struct.pack("<i", 1), struct.pack(">i", 1)):
            _Binary(self, raw)
        else:
            _Text(self, raw)

    def value(self, name: str) -> float | None:
        """The number that follows a keyword, None if it isn't there."""
        section = self.sections.get(name)
        if section is None:
            return None
        return float(section.reals[0, 0] if section.reals.size else section.integers[0, 0])

    def row(self, name: str, following: Callable[[], int]) -> tuple[int, tuple[int, ...], int, int]:
        """Number of reals in a row of a section, types of its fields, degree and nodes, from integers that follow."""
        keyword, types = KEYWORDS[name], tuple[int, ...]()
        degree, nodes = 0, 1
        reals = self.dimension if keyword.reals < 0 else keyword.reals
        if keyword.solution:
            types = tuple(following() for _ in range(min(max(following(), 0), 1000)))
            if keyword.solution == "ho":
                degree, nodes = following(), following()
            reals = self.width(types, name) * nodes
        return reals, types, degree, nodes

    def width(self, types: Sequence[int], place: str) -> int:
        """Number of values of fields of some types at a node."""
        sizes = type_sizes(self.dimension)
        unknown = [kind for kind in types if kind not in sizes]
        if unknown or not types:
            found = f"type {unknown[0]}" if unknown else "none"
            raise FormatError(f"expected fields of the types 1 to 4, found {found}", file=self.path, place=place)
        return sum(sizes[kind] for kind in types)

    def declare(self, version: int, dimension: int) -> None:
        """Take in the header."""
        if dimension not in (2, 3):
            raise FormatError(f"expected dimension 2 or 3, found {dimension}", file=self.path)
        self.version, self.dimension, self.real_size = version, dimension, 4 if version == 1 else 8

    def add(self, name: str, section: Section) -> None:
        """Take in a section; raises FormatError if there are two of it."""
        if name in self.sections:
            raise FormatError("expected one section, found two", file=self.path, place=name)
        self.sections[name] = section
        if name == "FloatingPointPrecision" and section.integers[0, 0] in (32, 64):
            self.real_size = int(section.integers[0, 0]) // 8


def type_sizes(dimension: int) -> Mapping[int, int]:
    """Numbers at a node by the type of a field: scalar, vector, symmetric matrix, matrix."""
    return {1: 1, 2: dimension, 3: dimension * (dimension + 1) // 2, 4: dimension**2}


def _integers(table: NDArray[Any]) -> Ints:
    """Whole numbers as integers, of 32 bits where these are enough for all."""
    is_narrow = not table.size or -(1 << 31) < table.min() <= table.max() < 1 << 31
    return table.astype(np.int32 if is_narrow else np.int64)


class _Binary:
    """Sections that know where the next one begins."""

    def __init__(self, file: GmfFile, raw: bytes) -> None:
        self.file, self.raw, self.at = file, raw, 4
        self.order = "<" if raw[0] == 1 else ">"
        version = self._take("i", "version")
        if not 1 <= version <= 4:
            raise FormatError(f"expected version 1 to 4, found {version}", file=file.path)
        position, self.count = "q" if version >= 3 else "i", "q" if version == 4 else "i"
        code, following = self._take("i", "header"), self._take(position, "header")
        if code != 3:
            raise FormatError(f"expected the dimension first, found keyword {code}", file=file.path)
        file.declare(version, self._take("i", "dimension"))
        while following:
            if not self.at <= following < len(raw):
                expected = f"a section between bytes {self.at} and {len(raw)}"
                raise FormatError(f"expected {expected}, found one at {following}", file=file.path)
            self.at = following
            code, following = self._take("i", "keyword"), self._take(position, "keyword")
            if code == _END:
                return
            if code in _NAMES:
                self._read(_NAMES[code])
        raise FormatError("expected an end of the sections, found none", file=file.path)

    def _take(self, kind: str, place: str) -> int:
        if self.at + struct.calcsize(kind) > len(self.raw):
            raise FormatError("expected more bytes, found the end", file=self.file.path, place=place)
        (value,) = struct.unpack_from(self.order + kind, self.raw, self.at)
        self.at += struct.calcsize(kind)
        return int(value)

    def _read(self, name: str) -> None:
        keyword, file = KEYWORDS[name], self.file
        rows = 1 if keyword.is_single else self._take(self.count, name)
        reals, types, degree, nodes = file.row(name, partial(self._take, "i", name))
        if reals > len(self.raw):
            raise FormatError(f"expected {reals} numbers a row, found fewer", file=file.path, place=name)
        record = np.dtype(
            [
                ("reals", f"{self.order}f{file.real_size}", (max(reals, 0),)),
                ("integers", f"{self.order}{'i8' if file.version == 4 else 'i4'}", (keyword.integers,)),
            ]
        )
        if rows < 0 or reals < 0 or self.at + rows * record.itemsize > len(self.raw):
            raise FormatError(f"expected {rows} rows, found fewer", file=file.path, place=name)
        data = np.frombuffer(self.raw, record, rows, self.at)
        self.at += rows * record.itemsize
        table = np.asarray(data["reals"], np.float64), _integers(data["integers"])
        file.add(name, Section(*table, types, degree, nodes))


class _Text:
    """Keywords and numbers, apart by any space."""

    def __init__(self, file: GmfFile, raw: bytes) -> None:
        self.file, self.at, self.stop = file, 0, 0
        self.text = substituted(_COMMENT, b"", raw, _LINE_END)
        version, dimension = self._integer_after(b"MeshVersionFormatted"), self._integer_after(b"Dimension")
        file.declare(version, dimension)
        last = b""
        for section in self._sections():
            last, self.at, self.stop = section
            name = last.decode("ascii", "replace")
            if name in KEYWORDS:
                self._read(name)
        if last != b"End":
            self._end_early(last.decode("ascii", "replace"))

    def _end_early(self, last: str) -> None:
        """Take a file without End that ends with a complete line, as SfePy's do; one that was cut has no line end."""
        if not self.text.endswith((b"\n", b"\r")):
            found = f"the end of the file in a line of {last}"
            raise FormatError(f"expected the keyword End, found {found}", file=self.file.path)
        self.file.remarks.append(f"no keyword End: sections after {last} may be missing")

    def _sections(self) -> Iterator[tuple[bytes, int, int]]:
        """Each keyword, with the start and end of the text up to the next one."""
        name, start = b"", 0
        for word in _KEYWORD.finditer(self.text):
            if word[0].lower() in (b"nan", b"inf"):
                continue
            if name:
                yield name, start, word.start()
            name, start = word[0], word.end()
        if name:
            yield name, start, len(self.text)

    def _integer_after(self, name: bytes) -> int:
        """The integer that follows a keyword of the header."""
        found = re.search(rb"(?<!\S)" + name + rb"\s+(\S+)", self.text)
        try:
            return int(found[1]) if found else int("")
        except ValueError:
            expected = f"a number after {name.decode()}"
            raise FormatError(f"expected {expected}, found none", file=self.file.path) from None

    def _integer(self, place: str) -> int:
        word = _WORD.match(self.text, self.at, self.stop)
        try:
            value = int(word[1]) if word else None
        except ValueError:
            value = None
        if word is None or value is None:
            raise FormatError("expected an integer, found something else", file=self.file.path, place=place)
        self.at = word.end()
        return value

    def _read(self, name: str) -> None:
        keyword, file = KEYWORDS[name], self.file
        rows = 1 if keyword.is_single else self._integer(name)
        reals, types, degree, nodes = file.row(name, partial(self._integer, name))
        width = reals + keyword.integers
        numbers = self._numbers(name)
        if rows < 0 or len(numbers) != rows * width:
            expected = f"{rows} rows of {width} numbers"
            raise FormatError(f"expected {expected}, found {len(numbers)} numbers", file=file.path, place=name)
        table = numbers.reshape(rows, width)
        integers = _integers(table[:, reals:])
        # a copy, since an empty part of the table would keep all of it
        file.add(name, Section(table[:, :reals].copy(), integers, types, degree, nodes))

    def _numbers(self, name: str) -> Floats:
        """(n,) the numbers that are left of a section, read in pieces: words are objects, which take more memory."""
        rest = self.text[self.at : self.stop]
        try:
            found = [np.array(piece.split(), np.float64) for piece in pieces(rest, _SPACE)]
        except ValueError:
            raise FormatError("expected numbers, found something else", file=self.file.path, place=name) from None
        return joined_floats(found)
