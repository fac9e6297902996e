"""Stored steps of lines, points along them, and their ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.streamlines.first_roots import bernstein_at


@dataclass(frozen=True)
class Limits:
    """Limits at which lines end.

    length, duration  in the world and in time, inf if they don't
    speed             a line that is slower ends
    rest              a speed that counts as none
    steps             at most, accepted ones
    tolerance         error of a step, in the world
    """

    length: float
    duration: float
    speed: float
    rest: float
    steps: int
    tolerance: float


@dataclass(frozen=True, eq=False)
class Piece:
    """A stored step of k lines.

    line         (k,)       its number
    patch, row   (k,)       the element
    time, lasts  (k,)       at the start, and how long it takes
    nets         (k, 8, s)  Bernstein coefficients of reference coordinates and length, to beyond the end
    part         (k,) share of the step that the line uses
    end          (k, s)     the state there
    """

    line: Ints
    patch: Ints
    row: Ints
    time: Floats
    lasts: Floats
    nets: Floats
    part: Floats
    end: Floats


def points_within(piece: Piece, spacing: float) -> tuple[Ints, Floats, Floats]:
    """Points of a piece's steps so close that no two are farther apart than the spacing along the line.

    The step of each point (m,), where in it, and the states there (m, s); ends of steps are among them, starts are not.
    """
    length = piece.end[:, -1] - piece.nets[:, 0, -1]
    counts = np.maximum(1, np.ceil(length / spacing)).astype(np.int64)
    which = np.repeat(np.arange(len(counts)), counts)
    order = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
    fraction = (order + 1) / counts[which]
    states = bernstein_at(piece.nets[which], fraction * piece.part[which])
    last = fraction == 1
    states[last] = piece.end[which[last]]
    return which, fraction, states
