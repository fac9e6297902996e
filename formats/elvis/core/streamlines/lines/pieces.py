"""Streamlines as curves: polynomials of one parameter in the world and in the elements, for pictures of them.

A step's dense output is a polynomial of degree 7 in the reference coordinates.  Its image in the world is also one on
straight simplices.  In other elements the image is interpolated at Chebyshev points of a higher degree; the terms of
the series beyond degree 7 bound the error of the first 8 terms, and steps are bisected until it is small.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.polynomial import chebyshev

from elvis.core.base.arrays import Floats, Ints, rows_by_number
from elvis.core.base.errors import ElvisError
from elvis.core.base.rows import Rows
from elvis.core.polynomials.boxnets import power_net
from elvis.core.streamlines.course import Course, Flow, MakeTracer
from elvis.core.streamlines.dop853 import DEGREE
from elvis.core.streamlines.endings import End, end_names
from elvis.core.streamlines.first_roots import before, beyond
from elvis.core.streamlines.flow_data import FlowSource
from elvis.core.streamlines.lines.local_maps import positions_along, repeated
from elvis.core.streamlines.lines.steps import Piece
from elvis.core.streamlines.tracer import Tracer
from elvis.core.streamlines.velocity import Velocity

#: maximum deviation of curves from the map of a step, relative to the box's diagonal, before the step is bisected
DEVIATION = 1e-13
#: maximum number of bisections of a step
_HALVINGS = 8
#: number of points of the interpolation: its series is known to twice the degree that is retained, but one
_COUNT = 15
#: steps worked on at once
_AT_ONCE = 1 << 14
#: pieces of all curves at most
_MOST_PIECES = 5_000_000


def _to_powers() -> Floats:
    """(8, 8) from Bernstein coefficients on [0, 1] to coefficients of powers of u = 2 t - 1.

    Rows: Bernstein polynomials.

    Column j of the inverse has the Bernstein coefficients of u^j, which is (2 t - 1)^j.
    """
    nets = np.zeros((DEGREE + 1, DEGREE + 1))
    for power in range(DEGREE + 1):
        for k in range(power + 1):
            sign = (-1.0) ** (power - k)
            nets[:, power] += sign * 2.0**k * _binomial(power, k) * np.array(power_net(k, k, DEGREE))
    return np.asarray(np.linalg.inv(nets).T)


def _binomial(n: int, k: int) -> float:
    return float(np.prod([(n - i) / (k - i) for i in range(k)]))


#: Chebyshev points in [0, 1], (15, 8) values of Bernstein polynomials there, and (15, 15) from values to coefficients
NODES = 0.5 + 0.5 * chebyshev.chebpts1(_COUNT)
_VALUES = np.stack([_binomial(DEGREE, k) * NODES**k * (1 - NODES) ** (DEGREE - k) for k in range(DEGREE + 1)], axis=1)
_SERIES = np.linalg.inv(chebyshev.chebvander(2 * NODES - 1, _COUNT - 1))
#: (8, 8) from Chebyshev coefficients to coefficients of powers: rows are Chebyshev polynomials
_CHEBYSHEV = np.stack([np.pad(chebyshev.cheb2poly(np.eye(DEGREE + 1)[k]), (0, DEGREE))[: DEGREE + 1] for k in range(8)])
_BERNSTEIN = _to_powers()
_CONTROL = np.linalg.inv(_BERNSTEIN)
#: (8, 8) each, from coefficients of powers of u to powers of v, where u is (v - 1) / 2 or (v + 1) / 2
_HALVES = tuple(
    np.array([[_binomial(p, q) * shift ** (p - q) * 0.5**p if q <= p else 0.0 for q in range(8)] for p in range(8)])
    for shift in (-1.0, 1.0)
)


def bernstein_of(points: Floats) -> Floats:
    """(n, 8, 3) control points of curves, from coefficients of powers (n, 8, 3): their hull holds the curve."""
    return np.asarray(_CONTROL.T @ points)


def halved(points: Floats) -> Floats:
    """(2 n, 8, 3) coefficients of powers of the first halves of curves (n, 8, 3), then of the second ones."""
    return np.concatenate([half.T @ points for half in _HALVES])


@dataclass(frozen=True, eq=False)
class Pieces(Rows):
    """Pieces of curves, each within one element: polynomials of a parameter u in [-1, 1], as coefficients of powers.

    points     (n, 8, 3)  in the world
    reference  (n, 8, 3)  in the element, zero beyond its dimension
    element    (n,)       ids in the file
    deviation  (n,)       the curve is within this of the map of the polynomial in the element
    line       (n,) number of the line; the first direction's lines come first
    time       (n, 2)     since the seed at both ends, negative against the stream; linear in u
    length     (n, 8) of the line up to a point
    """

    points: Floats
    reference: Floats
    element: Ints
    deviation: Floats
    line: Ints
    time: Floats
    length: Floats

    @classmethod
    def joined(cls, several: Sequence[Pieces]) -> Pieces:
        """Several as one; there may be none."""
        nets, none, numbers = np.empty((0, 8, 3)), np.empty(0), np.empty(0, np.int64)
        empty = Pieces(nets, nets, numbers, none, numbers, np.empty((0, 2)), np.empty((0, 8)))
        return super().joined([empty, *several])

    def along_lines(self) -> Pieces:
        """The pieces sorted by line, each from its seed on."""
        return self.part(np.lexsort([np.abs(self.time[:, 0]), self.line]))


def halves(pieces: Pieces) -> Pieces:
    """The first halves of pieces, then the second ones."""
    middle = pieces.time.mean(axis=1)
    times = [np.stack([pieces.time[:, 0], middle], axis=1), np.stack([middle, pieces.time[:, 1]], axis=1)]
    return Pieces(
        halved(pieces.points),
        halved(pieces.reference),
        np.tile(pieces.element, 2),
        np.tile(pieces.deviation, 2),
        np.tile(pieces.line, 2),
        np.concatenate(times),
        halved(pieces.length[:, :, None])[:, :, 0],
    )


@dataclass(frozen=True, eq=False)
class Curves:
    """Lines as pieces of curves.

    pieces  of all lines
    lines   number of lines with pieces
    ends    number of lines for each kind of end that occurs
    size    diagonal of the box of all elements
    remarks about possible omissions
    """

    pieces: Pieces
    lines: int
    ends: Mapping[str, int]
    size: float
    remarks: tuple[str, ...] = ()


def curves(data: FlowSource, course: Course, make: MakeTracer = Tracer) -> Curves:
    """The lines of a course; raises ElvisError as `course.Flow.of`, and if there are too many pieces.

    make  as `Flow.tracers`
    """
    flow = Flow.of(data, course)
    names = end_names(flow.neighbours.names)
    found, count = [], 0
    ends = np.zeros(len(names), np.int64)
    for direction, tracer in enumerate(flow.tracers(make)):
        first = direction * len(flow.location)
        for part in pieces_of(tracer, first, flow.velocity, DEVIATION * flow.size):
            found.append(part)
            count += len(part)
            check_count(count)
        ends += np.bincount(tracer.end, minlength=len(names))
    counts = {name: int(number) for name, number in zip(names, ends, strict=True) if number}
    lines = int(ends.sum() - ends[End.OUTSIDE])
    return Curves(Pieces.joined(found), lines, counts, flow.size)


def check_count(pieces: int) -> None:
    """Raise ElvisError if there are too many pieces."""
    if pieces > _MOST_PIECES:
        raise ElvisError(f"expected curves of {_MOST_PIECES} pieces in all at most; a smaller length has fewer")


def resting(points: Floats, reference: Floats, element: Ints, line: Ints, time: Floats) -> Pieces:
    """Particles (n, 3) as curves that stay where they are: reference coordinates (n, D), ids, lines and times (n,)."""
    nets = np.zeros((2, len(points), DEGREE + 1, 3))
    nets[0, :, 0] = points
    nets[1, :, 0, : reference.shape[1]] = reference
    times = np.stack([time, time], axis=1)
    return Pieces(nets[0], nets[1], element, np.zeros(len(points)), line, times, np.zeros((len(points), DEGREE + 1)))


def pieces_of(tracer: Tracer, first: int, velocity: Velocity, most: float) -> Iterator[Pieces]:
    """The steps of all lines, many at a time, as curves that deviate by ``most`` at most, lines from ``first`` on."""
    kept: list[Piece] = []
    count = 0
    for piece in tracer.run():
        kept.append(piece)
        count += len(piece.line)
        if count >= _AT_ONCE:
            yield _curved(kept, first, tracer.sign, velocity, most)
            kept, count = [], 0
    if kept:
        yield _curved(kept, first, tracer.sign, velocity, most)


def _curved(steps: Sequence[Piece], first: int, sign: int, velocity: Velocity, most: float) -> Pieces:
    """Steps as curves."""
    joined = {name.name: np.concatenate([getattr(step, name.name) for step in steps]) for name in fields(Piece)}
    nets = before(joined["nets"], joined["part"])

    # a step that is cut short was integrated once more, to its end: the polynomial is brought there, as rounding and
    # the dense output's lower order leave it elsewhere
    apart = joined["end"][:, None] - nets[:, -1:]
    nets = nets + np.linspace(0.0, 1.0, DEGREE + 1)[None, :, None] * apart
    times = sign * np.stack([joined["time"], joined["time"] + joined["lasts"]], axis=1)
    found = []
    for number, here in rows_by_number(joined["patch"]):
        own = Steps(joined["row"][here], first + joined["line"][here], nets[here], times[here])
        found.append(in_patch(velocity, number, own, most))
    return Pieces.joined(found)


@dataclass(frozen=True, eq=False)
class Steps:
    """Steps in elements of one patch: rows (k,), lines (k,), Bernstein coefficients (k, 8, s), times at ends (k, 2).

    The last of s states is the length of the line up to there.
    """

    row: Ints
    line: Ints
    nets: Floats
    time: Floats

    def halved(self, chosen: Ints) -> Steps:
        """The first halves of some of them, then the second ones."""
        nets, (start, end) = self.nets[chosen], self.time[chosen].T
        half = np.full(len(chosen), 0.5)
        middle = 0.5 * (start + end)
        times = np.concatenate([np.stack([start, middle], axis=1), np.stack([middle, end], axis=1)])
        both = np.concatenate([before(nets, half), beyond(nets, half)])
        return Steps(np.tile(self.row[chosen], 2), np.tile(self.line[chosen], 2), both, times)


def in_patch(velocity: Velocity, number: int, steps: Steps, most: float) -> Pieces:
    """Steps in elements of one patch as curves that deviate by ``most`` at most."""
    patch = velocity.patches[number]
    found = []
    for halving in range(_HALVINGS + 1):
        if not len(steps.row):
            break
        nets = steps.nets[:, :, : patch.dimension + velocity.clocks]
        points, deviation = _image(velocity, number, steps.row, nets, most)
        is_done = (deviation <= most) | (halving == _HALVINGS)
        done = np.flatnonzero(is_done)
        reference = np.zeros((len(done), DEGREE + 1, 3))
        own = velocity.in_elements(number, nets[done])
        reference[:, :, : own.shape[2]] = _BERNSTEIN.T @ own
        length = steps.nets[done, :, -1] @ _BERNSTEIN
        ids = patch.element_ids[steps.row[done]]
        of_lines = steps.line[done], steps.time[done], length
        found.append(Pieces(points[done], reference, ids, deviation[done], *of_lines))
        steps = steps.halved(np.flatnonzero(~is_done))
    return Pieces.joined(found)


def _image(velocity: Velocity, number: int, rows: Ints, nets: Floats, most: float) -> tuple[Floats, Floats]:
    """(k, 8, 3) coefficients of powers of the curves in the world, and (k,) how far they may be from the maps."""
    count = len(rows)
    if velocity.is_straight(number):
        # an affine map takes control points to control points
        places = velocity.positions(*repeated(number, rows, nets)).reshape(count, -1, 3)
        return _BERNSTEIN.T @ places, np.zeros(count)
    states = _VALUES @ nets
    places, error = positions_along(velocity, number, rows, states, most)
    points, deviation = series_through(places)
    return points, deviation + error


def series_through(places: Floats) -> tuple[Floats, Floats]:
    """(k, 8, 3) coefficients of powers from values (k, 15, 3) at `NODES`, and (k,) how far off they may be."""
    series = _SERIES @ places
    # the dropped terms may be maximal everywhere; the factor 2 covers aliasing of terms beyond the series
    tail = np.linalg.norm(np.abs(series[:, DEGREE + 1 :]).sum(axis=1), axis=1)
    return _CHEBYSHEV.T @ series[:, : DEGREE + 1], 2.0 * tail
