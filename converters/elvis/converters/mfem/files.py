"""Texts of MFEM: kinds of files, and checks that the library does not make.

The library reads on where numbers end, and past the end of its arrays where vertices are out of range; so the counts
and the ranges are checked before it reads.  Layout: MFEM documentation, mesh formats.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from elvis.converters.mfem.quadrature import QUADRATURE
from elvis.converters.shared.inputs import is_count
from elvis.core.base.arrays import Floats
from elvis.core.base.errors import FormatError
from elvis.core.files.plain import content, json_content, leading
from elvis.plugins.conversion.plugin import DOUBLE, EIGHT_DIGITS

#: number of vertices, and dimension, by the number of a geometry
_CORNERS = (1, 2, 3, 4, 4, 8, 6, 5)
_DIMENSIONS = (0, 1, 2, 2, 3, 3, 3, 3)

#: steps in which the library builds a space of order p, p⁹ in all, that it takes in a second at least; seconds at most
_PER_SECOND, _LONGEST = 10**9, 3600

#: numbers with as few digits as streams write by default, and how many of them are examined
_FEW_DIGITS, _LOOKED_AT = 9, 500


#: first lines of the descriptions of spaces
SPACES = ("FiniteElementSpace", "MFEM FiniteElementSpace v1.0", QUADRATURE)
#: beginnings of files of complex grid functions, in serial and of a process
COMPLEX = ("ComplexGridFunction", "ParComplexGridFunction")


def first_line(path: Path) -> str:
    """The first line of a file, shortened; empty if it can't be read."""
    return leading(path, 80).split(b"\n")[0].decode("ascii", "replace").strip()


#: beginnings of texts of other programs that the library reads: Netgen in two and three dimensions, and TrueGrid
#: a named set of attributes, their number first
_SET = re.compile(r'\s*"([^"]*)"([\s\d]+)')
#: digits of an attribute
_MOST_DIGITS = 10
_FOREIGN = {"areamesh2", "curved_areamesh2", "NETGEN", "NETGEN_Neutral_Format", "TrueGrid", "linemesh"}


def is_mesh(path: Path) -> bool:
    """Whether a file begins as meshes do."""
    line = first_line(path)
    return line in _FOREIGN or re.match(r"MFEM ([\w -]+ )?mesh v1\.", line) is not None


def is_field(path: Path) -> bool:
    """Whether a file begins as grid functions do."""
    return first_line(path) in (*SPACES, *COMPLEX)


def is_root(path: Path) -> bool:
    """Whether a file is the index of a collection for VisIt, by its name."""
    return path.suffix == ".mfem_root"


def read_root(path: Path) -> tuple[float | None, list[Path]]:
    """Time and files, of the mesh and of functions, that an index names; raises FormatError if it names none."""
    table = json_content(path)
    try:
        main = table["dsets"]["main"]
        names = [main["mesh"]["path"], *(field["path"] for field in main["fields"].values())]
        count, time = int(main["domains"]), main.get("time")
        found = [member for name in names for member in _members(path, str(name), count)]
        return None if time is None else float(time), found
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise FormatError(f"expected an index of MFEM's mesh and functions, found none: {error}", file=path) from error


def _members(path: Path, name: str, count: int) -> Iterator[Path]:
    """The files of all processes; raises FormatError if one is not there, or not below the index."""
    if Path(name).is_absolute() or ".." in Path(name).parts or name.count("%") != 1 or "%06d" not in name:
        raise FormatError(f"expected a name below the index with %06d in it, found {name!r:.80}", file=path)
    for number in range(count):
        member = path.parent / name.replace("%06d", f"{number:06d}")
        if not member.is_file():
            raise FormatError(f"expected {count} files {name!r:.80}, found none of number {number}", file=path)
        yield member


def load(path: Path) -> str:
    """The text of a file without comments; raises FormatError for other files."""
    try:
        text = content(path).decode("ascii")
    except UnicodeDecodeError as error:
        reason = " ".join(str(error).split())
        raise FormatError(f"expected a text, found: {reason}", file=path) from None
    return re.sub(r"(?m)^\s*#.*$", "", text)


def check_mesh(path: Path, text: str) -> None:
    """FormatError, naming ``path``, where elements are not of the mesh's dimension, or name vertices that it lacks."""
    if text.startswith(("areamesh2", "NETGEN")):
        _check_foreign(path, text)
    if not text.startswith(("MFEM mesh", "MFEM NURBS mesh")) or "\npatches" in text:
        return
    vertices = _words(text, "vertices")
    if not vertices or not is_count(vertices[0]):
        raise FormatError("expected a number of vertices, found none", file=path, place="vertices")
    dimension = (_words(text, "dimension") or ["none"])[0]
    if dimension not in ("1", "2", "3"):
        raise FormatError(f"expected a dimension from 1 to 3, found {dimension[:40]}", file=path, place="dimension")
    for section, own in (("elements", int(dimension)), ("boundary", int(dimension) - 1)):
        _check_elements(path, text, section, own, int(vertices[0]))
    if "FiniteElementCollection:" not in text and len(vertices) > 1 and is_count(vertices[1]):
        check_space(path, int(vertices[1]), int(dimension))
        count = int(vertices[0]) * int(vertices[1])
        _numbers(path, vertices[2 : 2 + count], count, "vertices")


def _check_foreign(path: Path, text: str) -> None:
    """Raise FormatError if a text of Netgen ends early, or names vertices that it lacks.

    In the plane come the segments of the boundary, the elements and the vertices; in space the vertices come first.
    """
    numbers = iter(text.split()[1:])
    try:
        if text.startswith("areamesh2"):
            named = [int(v) for _ in range(int(next(numbers))) for v in _taken(numbers, 1, 2)]
            for _ in range(int(next(numbers))):
                next(numbers)  # the attribute
                named += map(int, _taken(numbers, 0, int(next(numbers))))
            count = int(next(numbers))
            _taken(numbers, 0, 2 * count)
        else:
            count = int(next(numbers))
            _taken(numbers, 0, 3 * count)
            named = [int(v) for size in (4, 3) for _ in range(int(next(numbers))) for v in _taken(numbers, 1, size)]
    except (StopIteration, RuntimeError, ValueError):
        raise FormatError("expected as many numbers as declared, found fewer or others", file=path) from None
    if named and not 1 <= min(named) <= max(named) <= count:
        found = f"{min(named)} to {max(named)}"
        raise FormatError(f"expected vertices 1 to {count}, found {found}", file=path, place="elements")


def _taken(numbers: Iterator[str], skipped: int, count: int) -> list[str]:
    """The next ``count`` words after some that are skipped; raises ValueError if there are fewer."""
    found = list(islice(numbers, skipped, skipped + count))
    if len(found) != count:
        raise ValueError(f"expected {count} tokens, found {len(found)}")
    return found


def building_seconds(text: str) -> int:
    """Seconds that the library may take to build the spaces that a text names, beyond those for its size.

    A collection inverts a dense matrix for each shape: for pyramids of order p one of p³/3 rows, at a cost of p⁹.
    """
    orders = [int(order) for order in re.findall(r"FiniteElementCollection: \w*_P(\d{1,2})\b", text)]
    return min(_LONGEST, max(orders, default=0) ** 9 // _PER_SECOND)


def declared_elements(text: str) -> int | None:
    """The number of elements that a mesh declares; None for other forms than the plain one."""
    words = _words(text, "elements") if text.startswith("MFEM mesh") else []
    return int(words[0]) if words and is_count(words[0]) else None


def check_space(path: Path, space: int, dimension: int) -> None:
    """Raise FormatError if elements of this dimension have vertices with fewer coordinates, or with more than three."""
    if not dimension <= space <= 3:
        expected = "3" if dimension == 3 else f"{dimension} to 3"
        raise FormatError(f"expected vertices with {expected} coordinates, found {space}", file=path, place="vertices")


def values_after_header(path: Path, text: str, count: int, is_last: bool) -> Floats:
    """(count,) numbers that follow the last description of a space; raises FormatError if there are others or fewer.

    is_last  whether nothing may follow
    """
    words = text[header_end(path, text) :].split()
    return _numbers(path, words if is_last else words[:count], count, "values")


def header_end(path: Path, text: str) -> int:
    """End of the last description of a space in a text; raises FormatError without one."""
    ends = r"Ordering: *\d+|End: MFEM FiniteElementSpace v1\.0"
    if text.startswith(QUADRATURE):
        ends = r"VDim: *\d+"
    header = list(re.finditer(rf"(?m)^({ends}) *$", text))
    if not header:
        raise FormatError("expected the description of a space, found none that ends", file=path)
    return header[-1].end()


def header(path: Path) -> str:
    """The description of the space of a function in a file; raises FormatError if it is missing."""
    text = load(path)
    return text[: header_end(path, text)]


def named_attributes(text: str, section: str) -> dict[int, tuple[str, ...]]:
    """Names of attributes: of all sets that hold each, which version 1.3 lists, smaller sets first."""
    header = re.search(rf"(?m)^{section}\s+\d+", text)
    sets, at = [], header.end() if header else len(text)
    while found := _SET.match(text, at):
        sets.append((found[1], found[2]))
        at = found.end()
    names: dict[int, list[str]] = {}
    for name, numbers in sorted(sets, key=lambda own: len(own[1].split())):
        for word in set(numbers.split()[1:]):
            if len(word) <= _MOST_DIGITS:
                names.setdefault(int(word), []).append(name)
    return {number: tuple(own) for number, own in names.items()}


def rounding(text: str) -> float:
    """Relative precision of the numbers of a text: by the digits of the longest of the last ones."""
    numbers = re.findall(r"\d*\.\d+", text[-30 * _LOOKED_AT :])
    digits = max((len(number.replace(".", "").lstrip("0")) for number in numbers), default=_FEW_DIGITS + 1)
    return EIGHT_DIGITS if 5 < digits <= _FEW_DIGITS else DOUBLE


def _words(text: str, section: str) -> list[str]:
    """Words of a section and all that follow, on its line or below; empty without the section."""
    found = re.search(rf"(?m)^[ \t]*{section}(?!\S)", text)
    return text[found.end() :].split() if found else []


def _check_elements(path: Path, text: str, section: str, dimension: int, limit: int) -> None:
    """Raise FormatError if the elements of a section are not of this dimension, or name vertices from ``limit`` up."""
    words = _words(text, section)
    if not words or not is_count(words[0]):
        raise FormatError(f"expected a number of {section}, found none", file=path, place=section)
    at, named = 1, []
    for number in range(int(words[0])):
        kind = words[at + 1] if at + 1 < len(words) else "the end"
        corners = _CORNERS[int(kind)] if is_count(kind) and int(kind) < len(_CORNERS) else 0
        own = words[at + 2 : at + 2 + corners]
        if not corners or len(own) < corners or not all(is_count(word) for word in own):
            found = "unknown geometry " + kind if not corners else "an incomplete list of vertices"
            raise FormatError(f"expected an element, found {found}", file=path, place=f"{section} {number}")
        if _DIMENSIONS[int(kind)] != dimension:
            found = f"geometry {kind}, of dimension {_DIMENSIONS[int(kind)]}"
            sentence = f"expected a geometry of dimension {dimension}, found {found}"
            raise FormatError(sentence, file=path, place=f"{section} {number}")
        named += own
        at += 2 + corners
    highest = int(np.array(named, np.int64).max(initial=-1))
    if highest >= limit:
        raise FormatError(f"expected vertices 0 to {limit - 1}, found {highest}", file=path, place=section)


def _numbers(path: Path, words: Sequence[str], count: int, place: str) -> Floats:
    if len(words) != count:
        raise FormatError(f"expected {count} numbers, found {len(words)}", file=path, place=place)
    try:
        return np.array(words, np.float64)
    except ValueError:
        raise FormatError("expected numbers, found something else", file=path, place=place) from None
