"""Fields of Nek5000 and NekRS: values at the Gauss-Lobatto points of curved quadrilaterals and hexahedra.

A series often holds the points only in its first file, and a step may be spread over several files.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import nan
from os.path import isfile
from pathlib import Path

import numpy as np

from elvis.converters.nek.files import MAGIC, MESH_MAGIC, Piece, other_file, read_boundaries, read_header
from elvis.converters.shared.inputs import STEP, by_kind, step_number
from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.data.moments import checked_step
from elvis.core.files.plain import content, leading
from elvis.core.polynomials.quadrature import lobatto
from elvis.core.shapes import Shape
from elvis.plugins.conversion.declared import Declared
from elvis.plugins.conversion.nodal import (
    NodalBasis,
    NodalBlock,
    NodalConverter,
    NodalValues,
    component_names,
    tensor_nodes,
)
from elvis.plugins.conversion.plugin import DOUBLE, SINGLE, Boundary, Elements, Reads
from elvis.plugins.conversion.recognition import found_instead

#: our local side for each side of theirs, by dimension
_SIDES = {2: np.array([0, 1, 2, 3]), 3: np.array([1, 2, 3, 4, 0, 5])}

#: the name of a file of a series: what precedes, the number of the file in its step, the number of the step
_NAME = re.compile(r"(.*?)(\d+)(\.f)(\d{5})$", re.DOTALL)

#: steps that an index may name without any file, and more for each file in the folder
_MISSING_STEPS, _STEPS_OF_FILE = 10_000, 100

#: a number of a template that would have a hundred digits or more
_WIDE = re.compile(r"%[^A-Za-z]*[0-9]{3}")


class Nek(NodalConverter):
    """One step, with the file that holds its points and the boundaries of a .re2 file where they are given."""

    format = "Nek5000/NekRS field files (.f00001, .nek5000), boundaries from .re2"
    keeps = "curved quadrilaterals and hexahedra of any order, all fields, either precision, steps of many files, time"
    loses = "periodic links and curve descriptions of the .re2 file; pressure on a separate mesh"
    reads = Reads(
        "quadrilaterals, hexahedra",
        "any",
        "Gauss-Lobatto",
        "`.re2`, by code",
        "`.nek5000`, numbered files",
        "several files a step",
        "no",
        "no",
    )

    options = (STEP,)

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """Whether these are field files, with an index of a series and a .re2 file at most."""
        kinds = [_kind(path) for path in paths]
        return bool(paths) and all(kinds) and ("field" in kinds or "index" in kinds)

    @classmethod
    def hint(cls, path: Path) -> str:
        """The mesh, the partition and the case of a run, which hold no field."""
        return other_file(path)

    @classmethod
    def times(cls, paths: Sequence[Path]) -> Sequence[float]:
        """The times of the files that an index names, nan for missing ones; for field files, the time of the last."""
        indices = [path for path in paths if _kind(path) == "index"]
        if indices:
            count = _index(indices[0])[2]
            return [_time_of(indices[0], number) for number in range(count)]
        return [max(read_header(path).time for path in paths if _kind(path) == "field")]

    def __init__(self, paths: Sequence[Path], step: str | None = None) -> None:
        number = step_number(step, may_be_negative=False)
        roles = by_kind(paths, _kind)
        fields = roles["field"] + [_member(path, number) for path in roles["index"]]
        for path in roles[""]:
            raise FormatError(
                f"expected a Nek5000 field, .re2 or .nek5000 file, found {found_instead(path)}", file=path
            )
        points, values = _steps(fields)
        self.further_files = [*points, *values]
        self._points, self._values = Step(points), Step(values)
        self._check_match()
        head = self._values.head
        self.time, self.metadata = head.time, {"Step": str(head.step)}
        self.precision = SINGLE if 4 in (head.size, self._points.head.size) else DOUBLE
        self._read_blocks()
        self.declared = Declared(head.total)
        for path in roles["mesh"]:
            self._read_boundaries(path)

    def _check_match(self) -> None:
        points, values = self._points, self._values
        if points.dimension != values.dimension or len(points.numbers) != len(values.numbers):
            expected = f"a step on the {len(points.numbers)} elements of {points.file.name}"
            raise FormatError(f"expected {expected}, found one on {len(values.numbers)}", file=values.file)
        for step in dict.fromkeys((points, values)):
            step.number()
        if not np.array_equal(np.unique(points.stated), np.unique(values.stated)):
            expected = f"elements of the same numbers as in {points.file.name}"
            raise FormatError(f"expected {expected}, found others", file=values.file, place="element map")
        order = np.argsort(points.numbers)
        self._rows: Ints = order[values.numbers - 1]

    def _read_blocks(self) -> None:
        values, head = self._values, self._values.head
        none = np.empty((0, values.dimension))
        basis = _basis(values)
        is_alike = self._points.head.points == head.points
        of_points = basis if is_alike else _basis(self._points)
        geometry = _Records(none, of_points, step=self._points, name="position", rows=self._rows)
        count = len(values.numbers)
        self.blocks = [Elements(basis.shape, count, geometry.order, ids=values.numbers - 1, key=NodalBlock(geometry))]
        names = [(name, parts) for name, parts in head.channels if name != "position"]
        if head.pressure_apart and ("pressure", 1) in names:
            names.remove(("pressure", 1))
            self.notes = ["the pressure is on a separate mesh and was skipped"]
        for name, parts in names:
            records = _Records(np.empty((0, parts)), basis, step=values, name=name, rows=np.arange(count))
            self.add_field(name, component_names(name, parts), [records], is_continuous=True)

    def _read_boundaries(self, path: Path) -> None:
        count, found = read_boundaries(path)
        total, sides = len(self._values.numbers), _SIDES[self._values.dimension]
        if count != total:
            raise FormatError(f"expected {total} elements as in the fields, found {count}", file=path)
        known = np.isin(found.elements, np.arange(1, total + 1)) & np.isin(found.sides, np.arange(1, len(sides) + 1))
        if not known.all():
            raise FormatError(f"expected sides of elements 1 to {total}, found others", file=path, place="boundaries")
        rows, own = np.argsort(self._values.numbers)[found.elements - 1], sides[found.sides - 1]
        names = np.array(found.names)
        self.declared = replace(self.declared, sides=dict(Counter(found.names)))
        self.boundaries = [
            Boundary(name, sides=[(0, rows[names == name], own[names == name])]) for name in sorted(set(found.names))
        ]


class Step:
    """The files of one step as one; rows are counted through the files in order.

    stated   (n,) numbers of the elements as the files have them
    numbers  (n,) from 1 to n, in the order of those
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.pieces = [Piece(path) for path in paths]
        self.file, self.head, self.dimension = paths[0], self.pieces[0].header, self.pieces[0].header.dimension
        for piece in self.pieces[1:]:
            if (piece.header.points, piece.header.channels) != (self.head.points, self.head.channels):
                raise FormatError(f"expected points and contents as in {self.file.name}, found others", file=piece.path)
        self.stated: Ints = np.concatenate([piece.numbers for piece in self.pieces])
        self.numbers = self.stated
        self._ends = np.cumsum([len(piece.numbers) for piece in self.pieces])

    def number(self) -> None:
        """Number the elements from 1, in the order of the file if that numbers none of them.

        Raises FormatError if the files don't hold every element once.
        """
        count = self.head.total
        distinct, ranks = np.unique(self.stated, return_inverse=True)
        is_unnumbered = not self.stated.any()
        if len(self.stated) != count or not (is_unnumbered or len(distinct) == count):
            found = f"{len(self.stated)}, of which {len(distinct)} differ"
            expected = f"the elements 1 to {count}"
            raise FormatError(f"expected {expected}, found {found}", file=self.file, place="element map")
        self.numbers = 1 + (np.arange(count) if is_unnumbered else ranks.reshape(-1))

    def take(self, name: str, component: int, rows: Ints) -> Floats:
        """(n, points) values of elements ``rows`` (n,)."""
        result = np.empty((len(rows), int(np.prod(self.head.points))))
        which = np.searchsorted(self._ends, rows, side="right")
        for i in np.unique(which).tolist():
            here, piece = which == i, self.pieces[i]
            result[here] = piece.take(name, component, rows[here] - self._ends[i] + len(piece.numbers))
        return result


@dataclass(frozen=True, eq=False, kw_only=True)
class _Records(NodalValues):
    """Values of a record of a step, read on demand; ``rows`` (m,) of the elements in the step."""

    step: Step
    name: str
    rows: Ints

    def at_nodes(self, number: int, rows: slice | Ints) -> Floats:
        """(r, k) values of a component at the nodes of elements ``rows``."""
        return self.step.take(self.name, number, self.rows[rows])


def _basis(step: Step) -> NodalBasis:
    """The functions of the Gauss-Lobatto points of a step's elements."""
    shape = Shape.HEXAHEDRON if step.dimension == 3 else Shape.QUADRILATERAL
    count = step.head.points[0]
    return NodalBasis(shape, count - 1, tensor_nodes(shape, tuple(lobatto(count)[0].tolist())))


def _kind(path: Path) -> str:
    """``field``, ``mesh`` or ``index``, judged by the first bytes; empty for any other file."""
    start = leading(path, 512)
    if start.startswith(MAGIC):
        return "field"
    if start.startswith(MESH_MAGIC):
        return "mesh"
    return "index" if b"filetemplate:" in start else ""


def _index(path: Path) -> tuple[str, int, int]:
    """The template of the names of a series, the number of its first file, and how many there are."""
    words = dict(re.findall(r"(\w+):\s*(\S+)", content(path).decode("utf-8", "replace")))
    try:
        template, first, count = words["filetemplate"], int(words["firsttimestep"]), int(words["numtimesteps"])
        if _WIDE.search(template) or not template % (0, first):
            raise ValueError
    except (KeyError, ValueError, TypeError):
        raise FormatError("expected filetemplate, firsttimestep and numtimesteps", file=path) from None
    _check_step_count(path, template % (0, first), count)
    return template, first, count


def _check_step_count(index: Path, first_name: str, count: int) -> None:
    """Raise FormatError for an index of far more steps than there are files in the folder of the first one."""
    folder = (index.parent / first_name).parent
    files = len(os.listdir(folder)) if folder.is_dir() else 0
    most = _MISSING_STEPS + _STEPS_OF_FILE * files
    if count > most:
        raise FormatError(f"expected at most {most} steps next to {files} files, found {count}", file=index)


def _member(index: Path, step: int) -> Path:
    """The first file of a step of a series; for step -1, of the last step that exists."""
    template, first, count = _index(index)
    last = first + checked_step(step, count, index)
    paths = [
        Path(index.parent, template % (0, number)) for number in range(last, first - 1 if step < 0 else last - 1, -1)
    ]
    found = next(filter(isfile, paths), None)
    if found is None:
        raise FormatError(f"expected {paths[0].name} next to it, found none", file=index)
    return found


def _time_of(index: Path, step: int) -> float:
    """The time of a step of a series, nan if its file is missing or damaged."""
    try:
        return read_header(_member(index, step)).time
    except FormatError:
        return nan


def _steps(paths: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """The files that hold the points, and the files that hold the values, which may be the same."""
    if not paths:
        raise FormatError("expected at least one field file, found none")
    steps: dict[tuple[int, float], list[Path]] = {}
    heads = {path: read_header(path) for path in dict.fromkeys(paths)}
    for path, head in heads.items():
        steps.setdefault((head.step, head.time), []).append(path)
    ordered = [_whole(steps[key]) for key in sorted(steps, key=lambda key: (key[1], key[0]))]
    values = ordered[-1]
    if len(ordered) > 2:
        expected = "one step of the series, and at most another with its points"
        raise FormatError(
            f"expected {expected}, found {len(ordered)}: give one, or the .nek5000 file and --step (--reader step=N)"
        )
    if "X" in read_header(values[0]).contents:
        return values, values
    if len(ordered) == 2 and "X" in read_header(ordered[0][0]).contents:
        return ordered[0], values
    return _points_next_to(values[0]), values


def _whole(paths: Sequence[Path]) -> list[Path]:
    """All files of a step, given some of them; the others are sought next to them."""
    head = read_header(paths[0])
    if len(paths) > head.pieces:
        raise FormatError(f"expected {head.pieces} files of a step, found {len(paths)}", file=paths[0])
    if len(paths) == head.pieces or head.count == head.total:
        return sorted(paths, key=lambda path: read_header(path).piece)
    match = _NAME.fullmatch(paths[0].name)
    if match is None:
        raise FormatError(f"expected all {head.pieces} files of the step, found {len(paths)}", file=paths[0])
    digits = min(len(match[2]), len(str(head.pieces - 1)) if head.pieces > 1 else 1)
    stem = match[1] + match[2][:-digits]
    found = [paths[0].parent / f"{stem}{i:0{digits}d}{match[3]}{match[4]}" for i in range(head.pieces)]
    missing = [path.name for path in found if not path.is_file()]
    if missing:
        expected = f"all {head.pieces} files of the step"
        raise FormatError(f"expected {expected}, found no {', '.join(missing)}", file=paths[0])
    return found


def _points_next_to(path: Path) -> list[Path]:
    """The files of the last earlier step of the series, next to this one, that hold its points."""
    match = _NAME.fullmatch(path.name)
    if match is not None:
        stem = re.escape(match[1] + match[2] + match[3])
        earlier = [p for p in path.parent.iterdir() if re.fullmatch(stem + r"\d{5}", p.name) and p.name < path.name]
        for other in sorted(earlier, reverse=True):
            if _kind(other) == "field" and "X" in read_header(other).contents:
                return _whole([other])
    raise FormatError("expected points, or a file of the same series that has them; also give that", file=path)
