"""Lines cut at a surface: the parts outside a plane, a sphere or a cylinder, or inside it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.coordinate_levels import coordinate_clip, heights
from elvis.core.quantities.tree import Node
from elvis.core.streamlines.endings import CLIPPED
from elvis.core.streamlines.streamlines import TracedLines

#: halvings in search of the place where a line meets the surface
_HALVINGS = 60


def clipped_lines(lines: TracedLines, dataset: Dataset, clip: str) -> TracedLines:
    """The parts of lines that a clip leaves; a line that returns into them becomes several, with the seed of the line.

    Parameters
    ----------
    lines : TracedLines
        Lines whose points are so near to one another that a cubic polynomial between two of them is the line.
    dataset : Dataset
        The data in which they were traced.
    clip : str
        ``plane:P:N``, ``sphere:C:R`` or ``cylinder:P:A:R``, with ``outside:`` in front to leave the inside.

    Raises
    ------
    ElvisError
        For other clips, and if nothing is left.

    Notes
    -----
    Between two points a line is the cubic with the velocities at its ends (Hermite), which deviates from the line in
    the fourth power of their distance.  Further values are linear between two points.
    """
    root = coordinate_clip(dataset, clip)
    is_left = heights(root, lines.points) < 0
    line = np.repeat(np.arange(len(lines)), np.diff(lines.offsets))
    within = np.flatnonzero(line[1:] == line[:-1])
    crossing = within[is_left[within] != is_left[within + 1]]
    share = _crossings(lines, root, crossing, is_left[crossing])

    # rows of points that stay, and halfway between two rows those at the surface
    own = np.flatnonzero(is_left)
    if not len(own):
        raise ElvisError(f"--clip {clip}: expected some of the lines to be left, found none")
    rows = np.concatenate([own.astype(np.float64), crossing + 0.5])
    order = np.argsort(rows, kind="stable")
    is_first = np.concatenate([_begins(own, line), ~is_left[crossing]])[order]
    is_cut = np.concatenate([np.zeros(len(own), bool), is_left[crossing]])[order]
    owner = line[np.concatenate([own, crossing])][order]
    starts = np.flatnonzero(is_first)
    lasts = np.append(starts[1:], len(order)) - 1

    found = _with_points(lines, own, crossing, share, order)
    return replace(
        found,
        offsets=np.append(starts, len(order)),
        seed=lines.seed[owner[starts]],
        end=np.where(is_cut[lasts], len(lines.ends), lines.end[owner[starts]]),
        ends=(*lines.ends, CLIPPED[0]),
        ftle=None if lines.ftle is None else lines.ftle[owner[starts]],
    )


def _begins(rows: Ints, line: Ints) -> Ints:
    """(n,) whether points, by their rows, are the first of their lines."""
    return np.asarray((rows == 0) | (line[rows] != line[np.maximum(rows - 1, 0)]))


def _crossings(lines: TracedLines, root: Node, first: Ints, is_left: Ints) -> Floats:
    """(n,) parts of the way from point ``first`` to the next one at which lines meet the surface, by bisection."""
    low, high = np.zeros(len(first)), np.ones(len(first))
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        is_before = (heights(root, _between(lines, first, middle)) < 0) == is_left
        low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
    return (low + high) / 2


def _between(lines: TracedLines, first: Ints, t: Floats) -> Floats:
    """(n, 3) points of cubics from points ``first`` to the next ones, at parts t (n,) of the time between both."""
    start, stop = lines.points[first], lines.points[first + 1]
    lasts = (lines.time[first + 1] - lines.time[first])[:, None]
    one, other = lasts * lines.velocity[first], lasts * lines.velocity[first + 1]
    t = t[:, None]
    chord = start + t * (stop - start)
    return np.asarray(chord + t * (1 - t) * ((1 - t) * (one - (stop - start)) - t * (other - (stop - start))))


def _with_points(lines: TracedLines, own: Ints, first: Ints, share: Floats, order: Ints) -> TracedLines:
    """The lines with points ``own`` and those at parts of the way after points ``first``, in an order."""

    def column(values: Floats) -> Floats:
        weight = share.reshape(-1, *(1,) * (values.ndim - 1))
        made = (1 - weight) * values[first] + weight * values[first + 1]
        return np.concatenate([values[own], made])[order]

    points = np.concatenate([lines.points[own], _between(lines, first, share)])[order]
    return replace(
        lines,
        points=points,
        time=column(lines.time),
        length=column(lines.length),
        element=np.concatenate([lines.element[own], lines.element[first]])[order],
        velocity=column(lines.velocity),
        values={name: column(values) for name, values in lines.values.items()},
    )
