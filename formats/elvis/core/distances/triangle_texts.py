"""Triangles of text files: OBJ, and the text forms of PLY and STL.

A file may hold one face of a million corners, or a million solids; no corner becomes an object of Python.  Polygons are
fans from their first corner.
"""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.files.pieces import substituted

#: vertices (n, 3), and triangles (m, 3) of them
Indexed = tuple[Floats, Ints]

_OBJ_LINE = re.compile(rb"^[ \t]*([vf])[ \t]+([^\r\n#]*)", re.MULTILINE)
_OBJ_CONTINUED = re.compile(rb"\\\r?\n")
#: indices of texture coordinates and normals
_OBJ_OTHERS = re.compile(rb"/[^ \t\n]*")
_BLANK = re.compile(rb"[ \t\n]")

_STL_NAME = re.compile(rb"^[ \t]*(?:end)?solid\b[^\n]*", re.MULTILINE | re.IGNORECASE)
_STL_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)

_PLY_TEXT = re.compile(rb"ply\s+format\s+ascii\b")
_PLY_END = re.compile(rb"^end_header[^\n]*\n", re.MULTILINE)
#: names of the property with the corners of a face
_PLY_CORNERS = ("vertex_indices", "vertex_index")
_LINES = bytes.maketrans(b" \t\r", b"\n\n\n")


def triangles_in_text(raw: bytes, suffix: str) -> Indexed | None:
    """Vertices and triangles, without those that name a vertex twice; None if the file is not one of these texts.

    suffix  in lower case
    Raises FormatError without the file's name.
    """
    if suffix == ".obj":
        found = _obj(raw)
    elif suffix == ".ply" and _PLY_TEXT.match(raw):
        found = _ply(raw)
    elif suffix == ".stl" and not _is_binary_stl(raw):
        found = _stl(raw)
    else:
        return None
    vertices, triangles = found
    distinct = triangles[:, 0] != triangles[:, 1]
    for i, j in ((1, 2), (2, 0)):
        distinct &= triangles[:, i] != triangles[:, j]
    return vertices, triangles[distinct]


def _obj(raw: bytes) -> Indexed:
    """Lines ``v X Y Z`` and ``f I/…/… J/…/… K/…/…``; indices count from 1, negative ones back from the line."""
    raw = _OBJ_CONTINUED.sub(b" ", raw) if b"\\" in raw else raw
    vertices = _vertices(found[2] for found in _OBJ_LINE.finditer(raw) if found[1] == b"v")
    text = b"".join(found[2] + b"\n" for found in _OBJ_LINE.finditer(raw) if found[1] == b"f")
    text = substituted(_OBJ_OTHERS, b"", text, _BLANK) if b"/" in text else text
    indices, counts = _rows(text)
    if indices.size and indices.min() < 0:
        kinds = np.frombuffer(b"".join(found[1] for found in _OBJ_LINE.finditer(raw)), np.uint8)
        before = np.cumsum(kinds == ord("v"))[kinds == ord("f")]
        indices = np.where(indices < 0, np.repeat(before, counts) + indices + 1, indices)
    return vertices, _fans(indices - 1, np.cumsum(counts) - counts, counts, len(vertices))


def _is_binary_stl(raw: bytes) -> bool:
    """Whether the number of triangles, 50 bytes each after a header of 84, fits the size, or there is no text."""
    count = int.from_bytes(raw[80:84], "little")
    return len(raw) == 84 + 50 * count or not _STL_NAME.match(raw)


def _stl(raw: bytes) -> Indexed:
    """Words ``vertex X Y Z``, three for each triangle, of all solids."""
    text = _STL_NAME.sub(b"", raw)
    vertices = _vertices(b" ".join(found.groups()) for found in _STL_VERTEX.finditer(text))
    if len(vertices) % 3:
        raise FormatError(f"expected three vertices for each facet, found {len(vertices)} vertices")
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


@dataclass
class _Element:
    """An element of a PLY header: rows, and properties by name, each with whether it is a list."""

    name: str
    rows: int
    properties: list[tuple[str, bool]]


def _ply(raw: bytes) -> Indexed:
    """Numbers, element after element as the header declares."""
    end = _PLY_END.search(raw)
    if end is None:
        raise FormatError("expected a header with an end, found none")
    numbers = _numbers(raw[end.end() :].translate(_LINES))
    vertices, triangles, at = np.zeros((0, 3)), np.zeros((0, 3), np.int64), 0
    for element in _ply_elements(raw[: end.start()]):
        starts, counts, at = _ply_rows(element, numbers, at)
        if element.name == "vertex":
            columns = _ply_columns(element, ("x", "y", "z"))
            vertices = numbers[starts[:, None] + columns]
        elif element.name == "face" and len(counts):
            triangles = _fans(numbers, starts, counts, len(vertices))
    return vertices, triangles


def _ply_elements(header: bytes) -> list[_Element]:
    """The elements that a header declares."""
    found: list[_Element] = []
    for line in io.BytesIO(header):
        words = line.decode("latin-1").split()
        if len(words) == 3 and words[0] == "element" and words[2].isdecimal() and len(words[2]) < 18:
            found.append(_Element(words[1], int(words[2]), []))
        elif words[:1] == ["property"] and found and len(words) in (3, 5):
            found[-1].properties.append((words[-1], words[1] == "list"))
        elif words[:1] in (["element"], ["property"]):
            raise FormatError(f"expected an element or a property, found {' '.join(words)[:60]!r}")
    return found


def _ply_columns(element: _Element, names: Iterable[str]) -> Ints:
    """Columns of properties of an element without lists."""
    own = [name for name, is_list in element.properties if not is_list]
    missing = [name for name in names if name not in own]
    if missing or len(own) < len(element.properties):
        raise FormatError("expected vertices with numbers x, y and z, found others", place="header")
    return np.array([own.index(name) for name in names])


def _ply_rows(element: _Element, numbers: Floats, at: int) -> tuple[Ints, Ints, int]:
    """Starts (n,) of the rows of an element, of the corners in faces, their counts (n,), and the end of all."""
    is_list = [own for _, own in element.properties]
    if element.rows > len(numbers) - at and is_list:
        raise FormatError(f"expected {element.rows} rows, found fewer numbers", place=element.name)
    if not any(is_list):
        width = len(is_list)
        end = at + element.rows * width
        _check_end(end, numbers, element.name)
        return at + width * np.arange(element.rows if width else 0), np.zeros(0, np.int64), end
    chosen = next((i for i, (name, own) in enumerate(element.properties) if own and name in _PLY_CORNERS), None)
    # rows with one list of as many numbers as the first one's, as of triangles alone
    width = 1 + int(_entry(numbers, at))
    end = at + element.rows * width
    if is_list == [True] and chosen == 0 and end <= len(numbers):
        starts = at + width * np.arange(element.rows)
        if (numbers[starts] == width - 1).all():
            return starts + 1, np.full(len(starts), width - 1), end
    return _ply_lists(element, chosen, numbers, at)


def _ply_lists(element: _Element, chosen: int | None, numbers: Floats, at: int) -> tuple[Ints, Ints, int]:
    """`_ply_rows` of rows that differ in length."""
    found = np.zeros((element.rows if chosen is not None else 0, 2), np.int64)
    for row in range(element.rows):
        for column, (_, is_list) in enumerate(element.properties):
            count = int(_entry(numbers, at)) if is_list else 0
            if is_list and column == chosen:
                found[row] = at + 1, count
            at += 1 + count
    _check_end(at, numbers, element.name)
    return found[:, 0], found[:, 1], at


def _entry(numbers: Floats, at: int) -> float:
    """A length of a list; 0 behind the end, which `_check_end` finds out."""
    value = float(numbers[at]) if at < len(numbers) else 0.0
    if not 0 <= value <= len(numbers):
        raise FormatError("expected lengths of lists, found other numbers")
    return value


def _check_end(end: int, numbers: Floats, name: str) -> None:
    if end > len(numbers):
        raise FormatError(f"expected {end} numbers, found {len(numbers)}", place=name)


def _vertices(lines: Iterable[bytes]) -> Floats:
    """(n, 3) the first three numbers of each line."""
    texts = _Counted(lines)
    first = next(texts, None)
    if first is None:
        return np.zeros((0, 3))
    try:
        found = np.loadtxt(itertools.chain([first], texts), usecols=(0, 1, 2), comments=None, ndmin=2)
    except ValueError:
        found = np.zeros((0, 3))
    # NumPy skips blank lines
    if len(found) < texts.count:
        raise FormatError("expected three coordinates for each vertex, found something else")
    return found


class _Counted:
    """Lines as text, and how many there were."""

    def __init__(self, lines: Iterable[bytes]) -> None:
        self._lines, self.count = iter(lines), 0

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        self.count += 1
        try:
            return next(self._lines).decode("latin-1")
        except StopIteration:
            self.count -= 1
            raise


def _numbers(text: bytes, kind: type = np.float64) -> Any:
    """(n,) numbers, one a line; blank lines are skipped."""
    if not text.strip():
        return np.zeros(0, kind)
    try:
        return np.loadtxt(io.BytesIO(text), kind, comments=None, ndmin=1)
    except ValueError as error:
        raise FormatError("expected numbers, found something else") from error


def _rows(text: bytes) -> tuple[Ints, Ints]:
    """The whole numbers of all lines, one after another, and how many each line holds."""
    marks = np.frombuffer(text, np.uint8)
    is_word = marks > ord(" ")
    is_begin = is_word.copy()
    is_begin[1:] &= ~is_word[:-1]
    ends = np.flatnonzero(marks == ord("\n"))
    words = np.cumsum(is_begin, dtype=np.int32)[ends]
    numbers = _numbers(text.translate(_LINES), np.int64)
    if len(words) and len(numbers) != words[-1]:
        raise FormatError("expected whole numbers, found something else")
    return numbers, np.diff(words, prepend=0).astype(np.int64)


def _fans(indices: Ints | Floats, starts: Ints, counts: Ints, vertices: int) -> Ints:
    """(m, 3) triangles of polygons.  The corners of each are ``counts`` indices, the first one at ``starts``.

    Raises FormatError if a polygon has fewer than three corners, or a corner that is no vertex.
    """
    if not len(counts):
        return np.zeros((0, 3), np.int64)
    if counts.min() < 3:
        raise FormatError(f"expected three corners or more, found {counts.min()}", place="face")
    _check_corners(indices, starts, counts, vertices)
    kind = np.int32 if max(vertices, len(indices)) < 1 << 31 else np.int64
    first = np.repeat(starts.astype(kind), counts - 2)
    # the second corner of the triangle: its position is that of the first, and the number within its fan
    begins = np.cumsum(counts - 2) - (counts - 2)
    second = np.arange(len(first), dtype=kind) - np.repeat(begins.astype(kind), counts - 2) + first + 1
    found = np.empty((len(first), 3), kind)
    for column, position in enumerate((first, second, second + 1)):
        found[:, column] = indices[position]
    return found


def _check_corners(indices: Ints | Floats, starts: Ints, counts: Ints, vertices: int) -> None:
    """Raise FormatError if a corner of a polygon is no vertex."""
    change = np.zeros(len(indices) + 1, np.int8)
    change[starts] += 1
    change[starts + counts] -= 1
    corners = indices[np.cumsum(change[:-1], dtype=np.int8) > 0]
    if not ((corners >= 0) & (corners < vertices) & (corners == np.floor(corners))).all():
        raise FormatError(f"expected corners among {vertices} vertices, found others", place="face")
