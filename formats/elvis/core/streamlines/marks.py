"""Marks along streamlines at even steps of their length or time, with the way that the flow goes there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.streamlines.flow_data import FlowSource, flow_data
from elvis.core.streamlines.lines.pieces import Pieces

#: halvings of a piece until a mark's place is known to rounding; marks of all lines at most
_HALVINGS, _MOST = 54, 1_000_000
#: part of a line's length that is rounding
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class Marks:
    """Places on lines.

    points     (n, 3)  in the world
    direction  (n, 3)  unit vectors with the flow, whichever way a line was followed
    reference  (n, 3)  in the element
    element    (n,)    ids in the file
    """

    points: Floats
    direction: Floats
    reference: Floats
    element: Ints

    def __len__(self) -> int:
        return len(self.element)


def marks(
    data: FlowSource,
    pieces: Pieces,
    spacing: float,
    by: str = "length",
    velocity: Sequence[str] | None = None,
    wall: str | None = None,
) -> Marks:
    """A mark at each multiple of a spacing along lines, from their seeds on, by ``length`` or by ``time``.

    velocity  its components as texts; None for the usual names in the data
    wall      a boundary that lines lie on: marks point along the lines there
    Raises ElvisError if the spacing gives too many marks.
    """
    pieces = pieces.along_lines()
    ends = np.abs(pieces.time) if by == "time" else pieces.length @ _at_ends()

    # a piece begins with as many marks behind it as the one before it ends with, whatever rounding does between them;
    # a mark at the end of a line is one
    after = np.floor(ends[:, 1] / spacing * (1.0 + _ROUNDING)).astype(np.int64)
    is_first = np.diff(pieces.line, prepend=-1) != 0
    before = np.where(is_first, 0, np.roll(after, 1))
    number = np.maximum(after - before, 0)
    if number.sum() > _MOST:
        raise ElvisError(f"marks along lines: expected {_MOST} at most, found {number.sum()}; take a greater spacing")
    which = np.repeat(np.arange(len(pieces)), number)
    order = np.arange(len(which)) - np.repeat(np.cumsum(number) - number, number)
    wanted = spacing * (before[which] + 1 + order)
    u = _places(pieces, which, ends, wanted, by)

    powers = u[:, None] ** np.arange(8)
    points, reference = (np.einsum("np,npd->nd", powers, nets[which]) for nets in (pieces.points, pieces.reference))
    if wall is None:
        own = flow_data(data)
        moving = own.velocity(own.components(velocity))
        vectors = moving.in_world(pieces.element[which], reference)
    else:
        slopes = np.arange(1, 8)[:, None] * pieces.points[which, 1:]
        lasts = pieces.time[which, 1] - pieces.time[which, 0]
        vectors = np.sign(lasts)[:, None] * np.einsum("np,npd->nd", powers[:, :-1], slopes)
    size = np.linalg.norm(vectors, axis=1)
    good = np.flatnonzero(size > 0.0)
    direction = vectors[good] / size[good, None]
    return Marks(points[good], direction, reference[good], pieces.element[which[good]])


def _at_ends() -> Floats:
    """(8, 2) powers of the parameters where pieces begin and end."""
    return np.stack([(-1.0) ** np.arange(8), np.ones(8)], axis=1)


def _places(pieces: Pieces, which: Ints, ends: Floats, wanted: Floats, by: str) -> Floats:
    """(n,) parameters of pieces (n,) at which lengths or times (n,) are reached: both grow along a line."""
    if by == "time":
        start, end = ends[which].T
        return np.asarray(2.0 * (wanted - start) / (end - start) - 1.0)
    low, high = np.full(len(which), -1.0), np.ones(len(which))
    length = pieces.length[which]
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        is_before = np.einsum("np,np->n", middle[:, None] ** np.arange(8), length) < wanted
        low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
    return np.asarray(0.5 * (low + high))
