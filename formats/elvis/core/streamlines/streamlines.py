"""Streamlines of a dataset as numbers, in one call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_ints, starts_of
from elvis.core.base.errors import ElvisError
from elvis.core.base.rows import Rows
from elvis.core.files.columns import Columns
from elvis.core.quantities.expression import Expression, column_expressions
from elvis.core.streamlines.course import SPACING, Course, Flow, MakeTracer, components_of, positive
from elvis.core.streamlines.endings import CLIPPED, WORDS, End, end_names
from elvis.core.streamlines.flow_data import FlowSource, flow_data
from elvis.core.streamlines.lines.point_lines import PointLines
from elvis.core.streamlines.lines.steps import Piece, points_within
from elvis.core.streamlines.stretching import Stretching, slope_expressions
from elvis.core.streamlines.tracer import Tracer
from elvis.core.streamlines.velocity import Velocity

#: columns at every point
_AT_POINTS = ("time", "length", "element", "velocity")
#: names of columns and arrays, which no quantity may have
TAKEN = (
    *_AT_POINTS,
    "line",
    "seed",
    "offsets",
    "end",
    "ends",
    "ftle",
    "points",
    *(f"velocity_{axis}" for axis in "xyz"),
    *"xyz",
)
#: points of all lines at most
_MOST_POINTS = 20_000_000


@dataclass(frozen=True, eq=False)
class TracedLines(PointLines):
    """Lines along a velocity.

    offsets   (n+1,) line i has the points offsets[i] to offsets[i+1]; empty if its seed is outside
    seed      (n,)    the number of its seed
    end       (n,)    how it ends, an index into ``ends``
    ends      words for ends: the words of `endings`, then the names of boundaries by which lines left
    points    (m, 3)  world coordinates; the first of a line is its seed
    time      (m,)    since the seed, negative against the stream
    length    (m,)    along the line from the seed
    element   (m,)    ids of elements in the file
    velocity  (m, 3)
    values    further quantities (m,) by name
    ftle      (n,) finite-time Lyapunov exponents (`stretching`) over the duration of the lines, None if not requested
    """

    offsets: Ints
    seed: Ints
    end: Ints
    ends: tuple[str, ...]
    points: Floats
    time: Floats
    length: Floats
    element: Ints
    velocity: Floats
    values: Mapping[str, Floats]
    ftle: Floats | None = None

    MEANINGS: ClassVar = dict([*WORDS.values(), CLIPPED])
    AT_POINTS = _AT_POINTS

    def __repr__(self) -> str:
        found = ", ".join(f"{count} {name}" for name, count in self.counts().items())
        return f"<TracedLines: {len(self)} lines, {len(self.points)} points; {found or 'none'}>"

    def end_numbers(self) -> Ints:
        """(n,) one end a line."""
        return self.end

    def columns(self) -> Columns:
        """Arrays (m,) by name, one row per point.

        Names are line, seed, x, y, z, time, length, element, velocity_x, …, then quantities.
        """
        line = self.line_of_points()
        stretched = {} if self.ftle is None else {"ftle": self.ftle[line]}
        return {"line": line, "seed": self.seed[line], **self.coordinates(), **stretched, **self.values}

    def arrays(self) -> Columns:
        """Content of an archive: all arrays by name, the words for ends, and quantities by their names."""
        own = {name: getattr(self, name) for name in ("offsets", "seed", "end", "points")}
        stretched = {} if self.ftle is None else {"ftle": self.ftle}
        return {**own, **stretched, **self.at_points(), "ends": np.array(self.ends)}


def trace(
    data: FlowSource,
    seeds: Any,
    velocity: Sequence[str] | str | None = None,
    *,
    direction: str = "forward",
    length: float | None = None,
    duration: float | None = None,
    speed: float = 0.0,
    steps: int = 10_000,
    tolerance: float | None = None,
    spacing: float | None = None,
    fields: Sequence[str] = (),
    random: int = 0,
    wall: str | None = None,
    ftle: bool = False,
    make: MakeTracer = Tracer,
) -> TracedLines:
    """Streamlines through seeds, integrated exactly in the curved elements (see `tracer`).

    seeds      points (n, d), or texts as `seeds` describes them, such as ``line:0,0:0,1:20``
    velocity   its components, as texts or one text with commas; None for the usual names in the data: u, v, w or
               rhou/rho, …
    direction  forward, backward, or both: upstream lines then come after the others
    length     maximum length of lines in the world; None: ten diagonals of the box, unless a duration is given
    duration   maximum time
    speed      lines end below this speed
    steps      maximum number, each within one element
    tolerance  error of a step in the world; None: 1e-12 of the diagonal of the box
    spacing    maximum distance of points along a line; None: 1/200 of the diagonal
    fields     additional quantities at the points
    random     seed of the random number generator for random seeds
    wall       a boundary of 3D data: lines follow the shear on it, or the tangential part of ``velocity`` if given
    ftle       whether to compute each line's finite-time Lyapunov exponent; the velocity must be continuous
    make       constructor of the tracer, as in `Flow.tracers`

    Raises ElvisError for unknown quantities, missing components, 1D data, and limits that are not positive.

    >>> ds = elvis.read("wing.xml", "wing.fld")
    >>> elvis.trace(ds, [(-1.5, 0.5, 0.5)], tolerance=1e-4, length=1.0)
    <TracedLines: 1 lines, ... points; 1 length>
    """
    data = flow_data(data)
    others = column_expressions(fields, data.names, TAKEN)
    course = Course(seeds, components_of(velocity), direction, length, duration, speed, steps, tolerance, random, wall)
    slopes = slope_expressions(data, course) if ftle else []
    flow = Flow.of(data, course, [*others, *slopes])
    positive("spacing", spacing)
    apart = SPACING * flow.size if spacing is None else float(spacing)
    directions, exponents = [], []
    for tracer in flow.tracers(make):
        stretching = Stretching(flow.velocity, slopes, len(tracer.end), tracer.sign) if ftle else None
        inside = np.flatnonzero(tracer.end != End.OUTSIDE)
        points = collected(tracer, inside, apart, stretching)
        directions.append((tracer.end, [Along.of(points, flow.velocity, others)]))
        exponents += [] if stretching is None else [stretching.exponents()]
    return joined(directions, flow.neighbours.names, np.concatenate(exponents) if ftle else None)


@dataclass(frozen=True, eq=False)
class Points(Rows):
    """The points of lines: line (m,), patch (m,), row (m,), time (m,), state (m, s)."""

    line: Ints
    patch: Ints
    row: Ints
    time: Floats
    state: Floats

    @classmethod
    def joined(cls, several: Sequence[Points]) -> Points:
        """Several as one, each line's points after one another."""
        found = super().joined(several)
        return found.part(np.argsort(found.line, kind="stable"))


@dataclass(frozen=True, eq=False)
class Along:
    """Values at m points of lines: arrays as in `TracedLines`, except ``line``."""

    line: Ints
    points: Floats
    time: Floats
    length: Floats
    element: Ints
    velocity: Floats
    values: Mapping[str, Floats]

    @staticmethod
    def of(points: Points, moving: Velocity, others: Sequence[Expression]) -> Along:
        """The values at points of lines along a velocity, with additional quantities."""
        patch, row, reference = points.patch, points.row, points.state[:, :-1]
        ids = joined_ints(own.element_ids for own in moving.patches)
        starts = starts_of(moving.patches)
        return Along(
            points.line,
            moving.positions(patch, row, reference),
            points.time,
            points.state[:, -1],
            ids[starts[patch] + row],
            moving.vectors(patch, row, reference),
            {each.text: moving.values(each, patch, row, reference) for each in others},
        )


def collected(tracer: Tracer, starts: Ints, spacing: float, stretching: Stretching | None, count: int = 0) -> Points:
    """Run lines to their ends and collect their points, beginning with the current ones of ``starts`` (k,).

    count  number of points that exist already

    Raises ElvisError if that makes too many points.
    """
    time = tracer.sign * tracer.time[starts]
    parts = [Points(starts, tracer.patch[starts], tracer.row[starts], time, tracer.state[starts])]
    count += len(starts)
    for piece in tracer.run():
        parts.append(_points_of(piece, spacing, tracer.sign))
        if stretching is not None:
            stretching.follow(piece)
        count += len(parts[-1].line)
        if count > _MOST_POINTS:
            raise ElvisError(f"expected lines of {_MOST_POINTS} points in all at most; a greater spacing makes fewer")
    return Points.joined(parts)


def _points_of(piece: Piece, spacing: float, sign: int) -> Points:
    """The points of a step."""
    which, fraction, states = points_within(piece, spacing)
    time = sign * (piece.time[which] + fraction * piece.lasts[which])
    return Points(piece.line[which], piece.patch[which], piece.row[which], time, states)


def joined(
    directions: Sequence[tuple[Ints, Sequence[Along]]], names: Sequence[str], exponents: Floats | None = None
) -> TracedLines:
    """Lines of all directions, one direction after the other.

    directions  for each, the ends (n,) of its lines, and the values at their points, in consecutive parts
    names       of boundaries
    """
    firsts = np.cumsum([0, *(len(ends) for ends, _ in directions)])
    lines, parts = [], list[Along]()
    for first, (_, own) in zip(firsts, directions, strict=False):
        lines += [first + part.line for part in own]
        parts += own
    line = np.concatenate(lines)
    order = np.argsort(line, kind="stable")

    def column(name: str) -> Floats:
        return np.concatenate([getattr(part, name) for part in parts])[order]

    texts = parts[0].values
    values = {text: np.concatenate([part.values[text] for part in parts])[order] for text in texts}
    counts = np.bincount(line, minlength=firsts[-1])
    return TracedLines(
        np.concatenate([[0], np.cumsum(counts)]),
        np.concatenate([np.arange(len(ends)) for ends, _ in directions]),
        np.concatenate([ends for ends, _ in directions]),
        end_names(names),
        column("points"),
        column("time"),
        column("length"),
        np.asarray(column("element"), np.int64),
        column("velocity"),
        values,
        exponents,
    )
