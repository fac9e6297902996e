"""Vortex cores of a dataset as lines of points, in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, joined_columns
from elvis.core.base.rows import Rows
from elvis.core.base.terminal import Progress
from elvis.core.cores.finding import CoreArcs, CoreLimits, core_arcs
from elvis.core.cores.joining import Course, WorldArc
from elvis.core.cores.outer_sides import OuterSides
from elvis.core.cores.parallel import ParallelVectors, rotations
from elvis.core.data.dataset import Dataset
from elvis.core.files.columns import Columns
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.expression import Expression, column_expressions
from elvis.core.quantities.names import Names
from elvis.core.streamlines.lines.point_lines import PointLines
from elvis.core.streamlines.neighbours import Neighbours

#: kinds of ends of lines, with their meaning; names of boundaries follow
ENDS: Mapping[str, str] = {
    "closed": "return to their start",
    "faded": "the flow turns less than requested",
    "jump": "no core continues near enough beyond the border of an element",
    "left": "left the domain",
}
#: names of columns and arrays, which no quantity may have
_TAKEN = ("line", "offsets", "points", "length", "element", "velocity", "swirl", "ends", "first", "last", *"xyz")


@dataclass(frozen=True, eq=False)
class VortexCores(PointLines):
    """Core lines of vortices, each directed so that the flow turns right-handed about it.

    offsets    (n+1,)  line i has the points offsets[i] to offsets[i+1]; a closed one its first point twice
    first, last (n,)   how lines begin and end, indices into ``ends``
    ends       words of `ENDS`, then the names of boundaries
    points     (m, 3)  world coordinates
    length     (m,)    along the line from its first point
    element    (m,)    ids of elements in the file
    velocity   (m, 3)
    swirl      (m,)    imaginary part of the complex eigenvalues of the velocity's gradient, lambda_ci
    values     further quantities (m,) by name
    undecided  ids of elements in which it could not be decided whether there are more
    near_rest  ids of elements that are undecided only within 1/64 of a point at rest, such as edges of walls
    """

    offsets: Ints
    first: Ints
    last: Ints
    ends: tuple[str, ...]
    points: Floats
    length: Floats
    element: Ints
    velocity: Floats
    swirl: Floats
    values: Mapping[str, Floats]
    undecided: tuple[int, ...]
    near_rest: tuple[int, ...]

    MEANINGS = ENDS
    AT_POINTS = ("length", "element", "velocity", "swirl")

    def __repr__(self) -> str:
        left = f"; {len(self.undecided)} elements undecided" if self.undecided else ""
        return f"<VortexCores: {len(self)} lines, {len(self.points)} points{left}>"

    @property
    def closed(self) -> Bools:
        """(n,) which lines are closed."""
        return np.asarray(self.last == self.ends.index("closed"))

    @property
    def lengths(self) -> Floats:
        """(n,) of lines."""
        return np.asarray(self.length[self.offsets[1:] - 1])

    def end_numbers(self) -> Ints:
        """(k,) both ends of each line; closed lines count once."""
        return np.concatenate([self.last, self.first[~self.closed]])

    def columns(self) -> Columns:
        """Arrays (m,) by name, one row per point: line, x, y, z, length, element, velocity_x, …, swirl, quantities."""
        return {"line": self.line_of_points(), **self.coordinates(), **self.values}

    def of_lines(self) -> Columns:
        """Arrays (n,) by name: how lines begin and end."""
        return {"first": self.first, "last": self.last}

    def arrays(self) -> Columns:
        """Content of an archive: all arrays by name, the words for ends, ids of undecided elements."""
        rest = {"ends": np.array(self.ends), "undecided": np.array(self.undecided, np.int64)}
        return {"offsets": self.offsets, "points": self.points, **self.of_lines(), **self.at_points(), **rest}


def vortex_cores(
    dataset: Dataset,
    velocity: Sequence[str] | str | None = None,
    *,
    criterion: str = "acceleration",
    min_swirl: float = 0.0,
    only_q: bool = False,
    min_length: float = 0.0,
    spacing: float | None = None,
    fields: Sequence[str] = (),
    progress: Progress | None = None,
) -> VortexCores:
    """All lines inside 3D data along which the velocity is parallel to its acceleration or vorticity while it turns.

    velocity      its components, as texts or one text with commas; None for the usual names in the data
    criterion     acceleration: the convective derivative (grad v) v, as Sujudi and Haimes; or vorticity
    min_swirl   minimum imaginary part of the gradient's complex eigenvalues, a rate of rotation in radians per unit
                  of time
    only_q        only parts with positive Q = -tr((grad v)^2)/2
    min_length  minimum length of lines in the world
    spacing       maximum distance of points along a line; None: 1/200 of the size of the data
    fields        additional quantities at the points
    progress      receives the number of elements searched, and the total

    Turning below 1e-4 of the largest gradient in an element is ignored.  Raises ElvisError for data that aren't 3D or
    have Fourier directions, for components that are not quotients of polynomials, and for negative limits.

    >>> corners = [[-1, -1, -1], [3, -1, -1], [-1, 3, -1], [-1, -1, 3]]
    >>> ds = elvis.from_arrays({"tetrahedron": [corners]}, u=[[1, 1, -3, 1]], v=[[-1, 3, -1, -1]], w=[[1, 1, 1, 1]])
    >>> elvis.vortex_cores(ds, criterion="vorticity")
    <VortexCores: 1 lines, ... points>
    """
    names = Names.of(dataset)
    others = column_expressions(fields, names, _TAKEN)
    limits = CoreLimits(criterion, min_swirl, only_q, min_length, spacing)
    found = core_arcs(dataset, velocity, limits, others, progress)
    return _assembled(dataset, found, others, min_length)


def _assembled(dataset: Dataset, found: CoreArcs, others: Sequence[Expression], min_length: float) -> VortexCores:
    """Lines assembled from arcs, with values at their points."""
    arcs, parallel = found.arcs, found.parallel
    neighbours = Neighbours.of(dataset, parallel.evaluator.patches)
    outer = OuterSides(parallel.evaluator.patches, found.vertices, neighbours)
    words = (*ENDS, *neighbours.names)
    lines: list[_Line] = []
    for course in found.courses():
        line = _Line.of(course, arcs, parallel, others)
        if line.length[-1] >= min_length:
            lines.append(line.with_ends(course, arcs, outer, words))
    order = sorted(lines, key=lambda own: -own.length[-1])
    every = _Line.joined([_Line.none(len(others)), *order])
    return VortexCores(
        np.cumsum([0, *(len(own.length) for own in order)]),
        np.array([own.ends[0] for own in order], np.int64),
        np.array([own.ends[1] for own in order], np.int64),
        words,
        every.points,
        every.length,
        every.element,
        every.velocity,
        every.swirl,
        {each.text: every.values[:, column] for column, each in enumerate(others)},
        found.undecided,
        found.near_rest,
    )


@dataclass(frozen=True, eq=False)
class _Line(Rows):
    """A line with values at its points, as in `VortexCores`; and the kinds of its ends."""

    points: Floats
    length: Floats
    element: Ints
    velocity: Floats
    swirl: Floats
    values: Floats
    turned: bool
    ends: tuple[int, int]

    @staticmethod
    def none(count: int) -> _Line:
        """Without points."""
        no = np.empty(0)
        return _Line(
            np.empty((0, 3)), no, np.empty(0, np.int64), np.empty((0, 3)), no, np.empty((0, count)), False, (0, 0)
        )

    @staticmethod
    def of(course: Course, arcs: Sequence[WorldArc], parallel: ParallelVectors, others: Sequence[Expression]) -> _Line:
        """The line of the arcs of a course, in order."""
        parts = []
        for number, is_turned in zip(course.arcs, course.turned, strict=True):
            own = arcs[number]
            patch = parallel.evaluator.patches[own.patch]
            step = -1 if is_turned else 1
            rows = np.full(len(own.points), own.arc.row)
            places = ElementPoints(patch, rows, own.arc.xi[::step])
            motions = parallel.at(places)
            values = [np.broadcast_to(each, len(rows)) for each in parallel.evaluator.values_at(others, places)]
            table = np.stack(values, axis=1) if values else np.empty((len(rows), 0))
            turning = rotations(motions.gradient)
            parts.append((own.points[::step], patch.element_ids[rows], motions.velocity, motions.swirl, table, turning))
        points, element, velocity, swirl, table, turning = joined_columns(parts)
        if course.closed and not arcs[course.arcs[0]].arc.closed:
            points, element, velocity, swirl, table, turning = (
                np.concatenate([own, own[:1]]) for own in (points, element, velocity, swirl, table, turning)
            )
        middle = (turning[1:] + turning[:-1]) / 2
        is_turned = float(np.einsum("ni,ni->", middle, np.diff(points, axis=0))) < 0
        step = -1 if is_turned else 1
        points, velocity, swirl, table = (own[::step] for own in (points, velocity, swirl, table))
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        return _Line(points, length, element[::step], velocity, swirl, table, is_turned, (0, 0))

    def with_ends(self, course: Course, arcs: Sequence[WorldArc], outer: OuterSides, words: Sequence[str]) -> _Line:
        """With how it begins and ends."""
        found = []
        for number, end in ((course.arcs[0], int(course.turned[0])), (course.arcs[-1], 1 - int(course.turned[-1]))):
            found.append(0 if course.closed else words.index(_ending(arcs[number], end, outer)))
        first, last = found[::-1] if self.turned else found
        return replace(self, ends=(first, last))


def _ending(arc: WorldArc, end: int, outer: OuterSides) -> str:
    """The word for an end of an arc that is joined to none."""
    if not arc.on_side[end]:
        return "faded"
    return outer.boundary(arc.patch, arc.arc.row, arc.arc.xi[-end]) or "jump"
