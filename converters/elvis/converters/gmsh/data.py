"""Data sections of Gmsh files: values at nodes, on elements, at nodes of elements, and interpolation schemes.

They are read here, for the library gives no access to schemes and gives up on some files that it wrote itself.
Layout: Gmsh reference manual, chapter "MSH file format".
"""

from __future__ import annotations

import mmap
import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.shapes import Shape

MAGIC = b"$MeshFormat"

#: the time of data without a time: one object, so that keys with it are equal
UNKNOWN = float("nan")

#: beginning of files of version 1, and the ends of their sections
MAGIC_1, _SECTIONS_1 = b"$NOD", (b"$ENDNOD", b"$ELM", b"$ENDELM")

_DATA = (b"InterpolationScheme", b"NodeData", b"ElementNodeData", b"ElementData")
_MESH = (b"MeshFormat", b"PhysicalNames", b"Entities", b"PartitionedEntities", b"Nodes", b"Elements", b"Periodic",
         b"GhostElements", b"Parametrizations", b"ParametricNodes")  # fmt: skip
_OPENING = re.compile(rb"(?m)^\$(\w+)[ \t\r]*\n")

#: content allowed before the format: blank lines, and sections of any other name with comments
_BEFORE = re.compile(rb"\s*\$(\w+)[ \t\r]*\n")

#: tags (n,), values (n,) of each, and all values (sum, components)
Values: TypeAlias = tuple[Ints, Ints, Floats]

#: bytes of a section of elements that hold the first of them
_FIRST_ELEMENT = 400
_VERSION_2 = re.compile(rb"\$MeshFormat\s*\n2")
#: tags of an element of version 2 whose file has no partitions: physical group, entity, and a 0 of some writers
_TAGS_WITHOUT_PARTITIONS = 3

#: numbers of shapes in schemes
_TOPOLOGIES = {
    2: Shape.SEGMENT,
    3: Shape.TRIANGLE,
    4: Shape.QUADRILATERAL,
    5: Shape.TETRAHEDRON,
    6: Shape.PYRAMID,
    7: Shape.PRISM,
    8: Shape.HEXAHEDRON,
}


@dataclass(frozen=True, eq=False)
class Scheme:
    """Functions phi_i = sum_j coefficients[i, j] u^a v^b w^c, (a, b, c) = exponents[j]."""

    coefficients: Floats
    exponents: Floats

    def values(self, points: Floats, shape: Shape) -> Floats:
        """(n, functions) values at points (n, 3) of the reference element of the library.

        On pyramids a monomial is (u/(1-w))^a (v/(1-w))^b (1-w)^max(a, b) w^c.
        """
        columns = points[:, : self.exponents.shape[1]]
        if shape is not Shape.PYRAMID:
            return np.asarray(_monomials(columns, self.exponents) @ self.coefficients.T)
        c = np.maximum(1 - points[:, 2:], 1e-15)
        plane = _monomials(points[:, :2] / c, self.exponents[:, :2]) * c ** self.exponents[:, :2].max(axis=1)
        return np.asarray(plane * points[:, 2:] ** self.exponents[:, 2] @ self.coefficients.T)


def _monomials(points: Floats, exponents: Floats) -> Floats:
    """(n, m) product over the directions d of points[:, d]^exponents[:, d]."""
    return np.asarray(np.prod(points[:, None, :] ** exponents[None, :], axis=2))


class _Text:
    """Lines of a text, as the numbers that they hold."""

    def __init__(self, numbers: Floats) -> None:
        self._numbers, self.length = numbers, len(numbers)

    def width(self, values: int) -> int:
        return 2 + values

    def number(self, at: int) -> int:
        found = self._numbers[at + 1] if at + 1 < self.length else -1
        return int(found) if np.isfinite(found) else -1

    def table(self, at: int, rows: int, values: int) -> Values:
        own = self._numbers[at : at + rows * (2 + values)].reshape(rows, 2 + values)
        return _integers(own[:, 0]), _integers(own[:, 1]), own[:, 2:]


class _Binary:
    """Lines of a binary file, as bytes."""

    def __init__(self, raw: bytes, order: str) -> None:
        self._raw, self._order, self.length = raw, order, len(raw)

    def width(self, values: int) -> int:
        return 8 + 8 * values

    def number(self, at: int) -> int:
        return int(np.frombuffer(self._raw, f"{self._order}i4", 1, at + 4)[0]) if at + 8 <= self.length else -1

    def table(self, at: int, rows: int, values: int) -> Values:
        kind = np.dtype([("head", f"{self._order}i4", (2,)), ("values", f"{self._order}f8", (values,))])
        own = np.frombuffer(self._raw, kind, rows, at)
        head = own["head"].astype(np.int64)
        return head[:, 0], head[:, 1], own["values"].astype(np.float64)


def _integers(values: Floats) -> Ints:
    """Numbers of a text that should be whole; -1 if they aren't finite."""
    return np.where(np.isfinite(values), values, -1).astype(np.int64)


@dataclass(frozen=True, eq=False)
class Section:
    """A data section; values are read on demand.

    kind     NodeData, ElementData or ElementNodeData
    schemes  by shape, the schemes that the section names; empty if it names none
    """

    path: Path
    kind: str
    name: str
    time: float
    step: int
    components: int
    count: int
    schemes: Mapping[Shape, Scheme]
    start: int
    end: int
    order: str

    def read(self) -> Values:
        """Tags (n,) of nodes or elements, values (n,) of each, and all values (sum, components) in that order."""
        with self.path.open("rb") as file:
            file.seek(self.start)
            raw = file.read(self.end - self.start)
        tags, counts, values = self._binary(raw) if self.order else self._text(raw)
        if len(tags) != self.count:
            raise self._error(f"values for {self.count} of them", f"values for {len(tags)}")
        return tags, counts, values

    def _text(self, raw: bytes) -> Values:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                numbers = np.fromstring(raw.decode("ascii", "replace"), sep=" ")
            except (DeprecationWarning, ValueError):
                raise self._error("numbers", "something else") from None
        if self.kind == "ElementNodeData":
            return self._lines(_Text(numbers), self.components)
        if numbers.size != self.count * (1 + self.components):
            raise self._error(f"{self.count} lines of a tag and {self.components} values", "others")
        table = numbers.reshape(-1, 1 + self.components)
        return _integers(table[:, 0]), np.ones(len(table), np.int64), table[:, 1:]

    def _binary(self, raw: bytes) -> Values:
        if self.kind == "ElementNodeData":
            return self._lines(_Binary(raw, self.order), self.components)
        kind = np.dtype([("tag", f"{self.order}i4"), ("values", f"{self.order}f8", (self.components,))])
        if len(raw) < self.count * kind.itemsize:
            raise self._error(f"{self.count * kind.itemsize} bytes", f"{len(raw)}")
        table = np.frombuffer(raw, kind, self.count)
        return table["tag"].astype(np.int64), np.ones(self.count, np.int64), table["values"].astype(np.float64)

    def _lines(self, lines: _Text | _Binary, components: int) -> Values:
        """Lines of a tag, a number n and n values a component, many of equal n at once."""
        tags, counts, values = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros((0, components))]
        at, found, ahead = 0, 0, 64
        while found < self.count and at < lines.length:
            number = lines.number(at)
            width = lines.width(number * components)
            if number < 0 or at + width > lines.length:
                raise self._error("as many values as declared", "fewer")
            rows = min((lines.length - at) // width, self.count - found, ahead)
            own, each, table = lines.table(at, rows, number * components)
            differing = np.flatnonzero(each != number)
            same = int(differing[0]) if len(differing) else rows
            ahead = max(1, same) * (1 if len(differing) else 2)
            tags.append(own[:same])
            counts.append(each[:same])
            values.append(table[:same].reshape(-1, components))
            at, found = at + same * width, found + same
        return np.concatenate(tags), np.concatenate(counts), np.concatenate(values)

    def _error(self, expected: str, found: str) -> FormatError:
        return FormatError(f"expected {expected}, found {found}", file=self.path, place=f"${self.kind} {self.name!r}")


@dataclass(frozen=True, eq=False)
class Contents:
    """The content of a file in addition to its mesh; ``mesh`` holds its ranges of bytes if it comes first.

    The library writes the mesh again with each set of data that it appends.

    is_plain  whether the file begins with its format and contains only a mesh
    is_partition  whether the mesh is divided into partitions
    """

    path: Path
    has_mesh: bool
    is_plain: bool
    sections: tuple[Section, ...]
    mesh: tuple[tuple[int, int], ...]
    is_partition: bool = False


def scan(path: Path) -> Contents:
    """The data sections of a file; raises FormatError if one is damaged."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        start = beginning(data)
        if data[start : start + len(MAGIC_1)] == MAGIC_1:
            return _of_version_1(path, data, start)
        order = _byte_order(path, data, start)
        schemes: dict[str, dict[Shape, Scheme]] = {}
        sections: list[Section] = []
        kept: dict[bytes, tuple[int, int]] = {}
        end, is_plain = start, start == 0
        while (found := _OPENING.search(data, end)) is not None:
            if found[1] not in _DATA + _MESH:
                end = _after(data, found)
                continue
            stop, end = _closing(path, data, found)
            if found[1] in _MESH and found[1] not in kept:
                kept[found[1]] = (found.start(), end)
                continue
            is_plain = False
            if found[1] == b"InterpolationScheme":
                name, own = _scheme(path, data[found.end() : stop])
                schemes[name] = own
            elif found[1] in _DATA:
                sections.append(_section(path, data, found, stop, order, schemes))
        first = kept.get(b"Elements", (0, 0))[0]
        elements = data[first : first + _FIRST_ELEMENT]
        is_partition = b"PartitionedEntities" in kept or _has_partition_tags(elements, data[start : start + 64], order)
        has_mesh = b"Nodes" in kept or b"ParametricNodes" in kept
        return Contents(path, has_mesh, is_plain, tuple(sections), tuple(kept.values()), is_partition)


def _has_partition_tags(section: bytes, head: bytes, order: str) -> bool:
    """Whether the first element of version 2 names partitions.

    Behind its number, type and number of tags come the tags: physical group, entity, number of partitions, partitions.
    In binary files a type, how many elements follow and their number of tags come first.
    """
    if _VERSION_2.match(head) is None:
        return False
    lines = section.split(b"\n", 2)
    if len(lines) < 3:
        return False
    if order:
        first = np.frombuffer(lines[2][: 4 * 7], f"{order}i4").tolist()
        tags, count = first[4:], first[2] if len(first) == 7 else 0
    else:
        words = lines[2].split(b"\n", 1)[0].split()
        first = [int(word) for word in words if word.isdigit()]
        tags, count = first[3:6], first[2] if len(first) > 2 else 0
    return count > _TAGS_WITHOUT_PARTITIONS and len(tags) == 3 and tags[2] > 0


def beginning(data: bytes | mmap.mmap) -> int:
    """The position of the format section in a file, or its first bytes, possibly after comments; -1 without one."""
    at = 0
    while (found := _BEFORE.match(data, at)) is not None:
        name = b"$" + found[1]
        if name in (MAGIC, MAGIC_1):
            return found.start(1) - 1
        at = _after(data, found)
        if at == found.end():
            return -1
    return -1


def _after(data: bytes | mmap.mmap, found: re.Match[bytes]) -> int:
    """The end of a section without meaning; the end of its first line if it is not closed."""
    stop = data.find(b"\n$End" + found[1], found.end() - 1)
    if stop < 0:
        return found.end()
    line = data.find(b"\n", stop + 1)
    return len(data) if line < 0 else line + 1


def _of_version_1(path: Path, data: mmap.mmap, start: int) -> Contents:
    """A file with only a mesh, from ``start`` on; raises FormatError if one of its sections is missing."""
    for name in _SECTIONS_1:
        if data.find(name, start) < 0:
            raise FormatError(f"expected {name.decode()}, found the end", file=path)
    return Contents(path, True, start == 0, (), ((start, len(data)),))


def _closing(path: Path, data: mmap.mmap, found: re.Match[bytes]) -> tuple[int, int]:
    """The ends of a section's contents, and of the section."""
    closing = b"$End" + found[1]
    stop = data.find(closing, found.end())
    if stop < 0:
        raise FormatError(f"expected {closing.decode()}, found the end", file=path)
    line = data.find(b"\n", stop)
    return stop, len(data) if line < 0 else line + 1


def _byte_order(path: Path, data: mmap.mmap, start: int) -> str:
    """``<`` or ``>`` for a binary file, empty for a text; the format begins at ``start``."""
    head = data[start : start + 200]
    found = re.match(rb"\$MeshFormat\s*\n(\S+)\s+(\d)\s+(\d+)[ \t\r]*\n", head)
    if found is None:
        raise FormatError("expected version, type and size after $MeshFormat, found something else", file=path)
    if found[2] == b"0":
        return ""
    one = head[found.end() : found.end() + 4]
    if one not in (b"\1\0\0\0", b"\0\0\0\1"):
        raise FormatError("expected a 1 in either byte order after the format, found other bytes", file=path)
    return "<" if one[0] else ">"


def _scheme(path: Path, raw: bytes) -> tuple[str, dict[Shape, Scheme]]:
    """Name and functions by shape of a section of schemes."""
    head, _, rest = raw.partition(b"\n")
    words, at = rest.split(), 0

    def number() -> int:
        nonlocal at
        at += 1
        return int(words[at - 1])

    def matrix() -> Floats:
        nonlocal at
        rows, columns = number(), number()
        values = np.array(words[at : at + rows * columns], np.float64).reshape(rows, columns)
        at += rows * columns
        return values

    found = {}
    try:
        for _ in range(number()):
            topology, matrices = number(), number()
            own = [matrix() for _ in range(matrices)]
            if topology in _TOPOLOGIES and len(own) > 1:
                if own[0].shape[1] != len(own[1]) or own[1].shape[1] < _TOPOLOGIES[topology].dimension:
                    raise ValueError
                found[_TOPOLOGIES[topology]] = Scheme(own[0], own[1])
    except (ValueError, IndexError):
        raise FormatError(
            "expected matrices of coefficients and exponents, found others", file=path, place="$InterpolationScheme"
        ) from None
    return head.decode("utf-8", "replace").strip().strip('"'), found


def _section(
    path: Path,
    data: mmap.mmap,
    found: re.Match[bytes],
    stop: int,
    order: str,
    schemes: Mapping[str, Mapping[Shape, Scheme]],
) -> Section:
    """The head of a data section: tags that are text, real numbers, integers."""
    kind, at = found[1].decode(), found.end()
    groups: list[list[str]] = []
    try:
        for _ in range(3):
            line, at = _line(data, at, stop)
            own = []
            for _ in range(int(line)):
                text, at = _line(data, at, stop)
                own.append(text)
            groups.append(own)
        names, times, (step, components, count) = groups[0], groups[1], (int(text) for text in groups[2][:3])
        time = float(times[0]) if times else UNKNOWN
    except (ValueError, IndexError):
        raise FormatError(
            "expected tags before the values, found something else", file=path, place=f"${kind}"
        ) from None
    if components < 1 or count < 0:
        found_text = f"{components} and {count}"
        raise FormatError(f"expected numbers of components and values, found {found_text}", file=path, place=f"${kind}")
    titles = [name.strip('"') for name in names]
    named = schemes.get(titles[1], {}) if len(titles) > 1 else {}
    if len(titles) > 1 and not named:
        raise FormatError(f"expected an interpolation scheme {titles[1]!r}, found none", file=path, place=f"${kind}")
    title = titles[0] if titles and titles[0] else kind
    return Section(path, kind, title, time, step, components, count, named, at, stop, order)


def _line(data: mmap.mmap, at: int, stop: int) -> tuple[str, int]:
    """The text up to the end of the line, and where the next begins."""
    end = data.find(b"\n", at, stop)
    if end < 0:
        raise ValueError
    return data[at:end].decode("utf-8", "replace").strip(), end + 1
