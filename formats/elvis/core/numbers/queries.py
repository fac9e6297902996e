"""Sample points: from a table, along a line, over a plane."""

from __future__ import annotations

import csv
import io
import itertools
import re
import sys
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import FormatError
from elvis.core.files.plain import content

AXES = ("x", "y", "z")
#: columns of a table, at most: each cell of a line is a text
MAX_COLUMNS = 1_000_000
#: columns of tables by ``elvis probe`` that are no values
_BOOKKEEPING = ("point", "element", "status")
#: the points of Nektar++'s .pts files
_PTS = re.compile(r"<POINTS\b(?P<attributes>[^>]*)>(?P<numbers>.*?)</POINTS>", re.DOTALL)
_ATTRIBUTE = re.compile(r"""(\w+)\s*=\s*(?:"([^"]*)"|'([^']*)')""")


def points_on_line(start: Sequence[float], end: Sequence[float], count: int) -> Floats:
    """(count, 3) evenly spaced points from ``start`` to ``end``, both included.

    >>> elvis.points_on_line((0, 0, 0), (1, 0, 0), 3)[:, 0]
    array([0. , 0.5, 1. ])
    """
    fractions = np.linspace(0.0, 1.0, count)[:, None]
    points: Floats = (1 - fractions) * np.asarray(start) + fractions * np.asarray(end)
    return points


def points_on_plane(origin: Sequence[float], u: Sequence[float], v: Sequence[float], counts: tuple[int, int]) -> Floats:
    """(N M, 3) points of the parallelogram that ``u`` and ``v`` span from ``origin``, evenly spaced, borders included.

    counts  (N, M) points along u and along v; point i along u and j along v is row j N + i

    >>> elvis.points_on_plane((0, 0, 0), (1, 0, 0), (0, 1, 0), (3, 2)).shape
    (6, 3)
    """
    along_u, along_v = (np.linspace(0.0, 1.0, count) for count in counts)
    t, s = np.meshgrid(along_v, along_u, indexing="ij")
    points: Floats = np.asarray(origin) + s.reshape(-1, 1) * np.asarray(u) + t.reshape(-1, 1) * np.asarray(v)
    return points


def points_in_table(path: str | Path) -> Floats:
    """(n, 3) the points in a text table or a .pts file, ``-`` for standard input; missing coordinates are zero.

    A header may name the columns; x, y and z are used; without one there are at most three columns.  Commas, semicolons
    or blanks separate; blank lines and lines that begin with # are skipped.  Raises FormatError with the line if a
    number is missing, malformed or not finite.
    """
    text = _text(path)
    pts = _PTS.search(text)
    if pts is not None:
        names, rows_of_pts = _pts_columns(path, pts)
        count = sum(axis in names for axis in AXES)
        return np.pad(rows_of_pts[:, :count], ((0, 0), (0, 3 - count)))
    rows = _rows(path, text)
    first = next(rows, None)
    if first is None:
        raise FormatError("expected at least one point, found none", file=path)

    # A first line with a cell that is not a number is the header
    place, cells = first
    columns = {name: i for i, name in enumerate(AXES[: len(cells)])}
    points = array("d")
    is_headed = any(_number(cell) is None for cell in cells)
    if is_headed:
        columns = _columns(path, place, cells)
    else:
        if len(cells) > 3:
            raise FormatError(
                f"expected at most 3 columns without a header, found {len(cells)}", file=path, place=place
            )
        points.extend(_point(path, place, cells, columns, len(cells)))

    numbers = _plain_numbers(text, is_headed, len(cells))
    if numbers is None:
        for place, row in rows:
            points.extend(_point(path, place, row, columns, len(cells)))
        numbers = np.array(points).reshape(-1, len(columns))
    else:
        numbers = numbers[:, list(columns.values())]
    table = np.zeros((len(numbers), 3))
    table[:, [AXES.index(axis) for axis in columns]] = numbers
    return table


@dataclass(frozen=True, eq=False)
class PointValues:
    """Values at points of a table.

    axes    of the coordinates in the table, 0 to 2
    points  (n, axes)
    values  (n, names)
    """

    axes: tuple[int, ...]
    points: Floats
    names: tuple[str, ...]
    values: Floats


def values_in_table(path: str | Path) -> PointValues:
    """Values at points: a text table with a header, also behind #, or a .pts file of Nektar++.

    Columns x, y and z are coordinates, others values; rows with values that are not finite are skipped.  Raises
    FormatError if there are no coordinates, no values or no rows, and with the line of a malformed number.
    """
    text = _text(path)
    found = _PTS.search(text)
    names, rows = _header_and_rows(path, text) if found is None else _pts_columns(path, found)
    axes = [axis for axis in AXES if axis in names]
    fields = [i for i, name in enumerate(names) if name not in (*AXES, *_BOOKKEEPING)]
    if not axes or not fields or len(set(names)) < len(names):
        raise FormatError(
            f"expected columns x, y or z and values, each once, found {', '.join(names) or 'none'}", file=path
        )
    kept = np.isfinite(rows).all(axis=1)
    if not kept.any():
        raise FormatError("expected at least one row of finite numbers, found none", file=path)
    points = rows[np.ix_(kept, [names.index(axis) for axis in axes])]
    own = tuple(names[i] for i in fields)
    return PointValues(tuple(map(AXES.index, axes)), points, own, rows[np.ix_(kept, fields)])


def _header_and_rows(path: str | Path, text: str) -> tuple[list[str], Floats]:
    """The names of columns and all numbers of a text table."""
    lines = [line.strip() for line in io.StringIO(text, newline=None)]
    first = next((i for i, line in enumerate(lines) if line.lstrip("# ")), len(lines))
    if first == len(lines):
        raise FormatError("expected a header and rows of numbers, found an empty file", file=path)
    names = _cells(lines[first].lstrip("# "), path, f"line {first + 1}")
    names = [name.lower() if name.lower() in AXES else name for name in names]
    rows = array("d")
    for number, line in enumerate(lines[first + 1 :], first + 2):
        if not line or line.startswith("#"):
            continue
        cells = [_number(cell) for cell in _cells(line, path, f"line {number}")]
        if len(cells) != len(names) or None in cells:
            raise FormatError(f"expected {len(names)} numbers, found {line[:60]}", file=path, place=f"line {number}")
        rows.extend(cell for cell in cells if cell is not None)
    return names, np.array(rows, np.float64).reshape(-1, len(names))


def _pts_columns(path: str | Path, found: re.Match[str]) -> tuple[list[str], Floats]:
    """The names of columns and all numbers of a .pts file."""
    attributes = {name.upper(): a or b for name, a, b in _ATTRIBUTE.findall(found["attributes"])}
    dimension = attributes.get("DIM", "")
    if dimension not in ("1", "2", "3"):
        raise FormatError(f"expected DIM from 1 to 3, found {dimension!r}", file=path)
    fields = [name.strip() for name in attributes.get("FIELDS", "").split(",") if name.strip()]
    names = [*AXES[: int(dimension)], *fields]
    try:
        numbers = np.array(found["numbers"].split(), np.float64)
    except ValueError as error:
        raise FormatError(f"expected numbers in POINTS, found something else ({error})", file=path) from None
    if len(numbers) % len(names):
        raise FormatError(f"expected a multiple of {len(names)} numbers in POINTS, found {len(numbers)}", file=path)
    return names, numbers.reshape(-1, len(names))


def _plain_numbers(text: str, is_headed: bool, count: int) -> Floats | None:
    """(n, count) all numbers of a table; None if something else is in it, which has to be read line by line.

    NumPy's parser takes a quarter of the time.
    """
    stripped = (line.strip() for line in io.StringIO(text, newline=None))
    lines = (line for line in stripped if line and not line.startswith("#"))
    if is_headed:
        next(lines)
    first = next(lines, None)
    if first is None:
        return None
    try:
        numbers = np.loadtxt(itertools.chain([first], lines), delimiter=_separator(first), comments=None, ndmin=2)
    except ValueError:
        return None
    return numbers if numbers.shape[1] == count and np.isfinite(numbers).all() else None


def pairs_in_table(text: str) -> Floats:
    """(n, 2) two columns of a text table, given as FILE or FILE:X,Y with names or numbers of columns, 1 for the first.

    Raises FormatError with the line where a number is missing or malformed, and for columns that the table lacks.
    """
    path, colon, chosen = text.rpartition(":")
    if not colon or not path or "," not in chosen:
        path, chosen = text, "1,2"
    rows = _rows(path, _text(path))
    first = list(itertools.islice(rows, 1))
    is_headed = any(_number(cell) is None for _, cells in first for cell in cells)
    header = first.pop()[1] if is_headed else []
    columns = [_column(path, name.strip(), header) for name in chosen.split(",", 1)]
    found = array("d")
    for place, cells in itertools.chain(first, rows):
        numbers = [_number(cells[column]) if column < len(cells) else None for column in columns]
        if None in numbers:
            raise FormatError(f"expected numbers in columns {chosen}, found {', '.join(cells)}", file=path, place=place)
        found.extend(own for own in numbers if own is not None)
    if not found:
        raise FormatError("expected at least one row of numbers, found none", file=path)
    return np.array(found, np.float64).reshape(-1, 2)


def _column(path: str, name: str, header: list[str]) -> int:
    """Index of a column given by its name in a header or by its number."""
    if name in header:
        return header.index(name)
    if name.isdecimal() and int(name) > 0:
        return int(name) - 1
    raise FormatError(f"expected a column, one of {', '.join(header) or '1, 2'}, found {name!r}", file=path)


def _text(path: str | Path) -> str:
    """The text of a file, or of standard input for ``-``."""
    return sys.stdin.read() if str(path) == "-" else content(path).decode("utf-8-sig", "replace")


def _rows(path: str | Path, text: str) -> Iterator[tuple[str, list[str]]]:
    """The line number, in words, and the cells of each line that holds some."""
    for number, line in enumerate(io.StringIO(text, newline=None), 1):
        stripped = line.strip()
        if stripped and not stripped.startswith("#"):
            yield f"line {number}", _cells(stripped, path, f"line {number}")


def _cells(line: str, path: str | Path, place: str) -> list[str]:
    """The texts in a line."""
    separator = _separator(line)
    count = 1 + line.count(separator or " ")
    if count > MAX_COLUMNS:
        raise FormatError(f"expected at most {MAX_COLUMNS} columns, found {count}", file=path, place=place)
    if separator and '"' in line:
        return next(csv.reader([line], delimiter=separator, skipinitialspace=True))
    return [cell.strip() for cell in line.split(separator)]


def _separator(line: str) -> str | None:
    """The character that separates the cells of a line; None for blanks."""
    return next((separator for separator in ",;" if separator in line), None)


def _columns(path: str | Path, place: str, header: list[str]) -> dict[str, int]:
    """Column of each axis that the header names."""
    names = [name.lower() for name in header]
    for axis in AXES:
        if names.count(axis) > 1:
            raise FormatError(f"expected one column {axis}, found {names.count(axis)}", file=path, place=place)
    columns = {axis: names.index(axis) for axis in AXES if axis in names}
    if "x" not in columns:
        raise FormatError(f"expected columns x, y, z or numbers, found {', '.join(header)}", file=path, place=place)
    return columns


def _point(path: str | Path, place: str, cells: list[str], columns: dict[str, int], count: int) -> list[float]:
    """The coordinates in one line."""
    if len(cells) != count:
        raise FormatError(f"expected {count} columns, found {len(cells)}", file=path, place=place)
    point = []
    for axis, column in columns.items():
        number = _number(cells[column])
        if number is None or not np.isfinite(number):
            raise FormatError(f"expected a finite number for {axis}, found {cells[column]!r}", file=path, place=place)
        point.append(number)
    return point


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
