"""Contours in records, located between neighbouring pixels, and distances between contours of two records."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.reference.extras import comparison_module
from elvis.reference.record import Record

#: neighbouring pixels that lie this many times farther apart than is usual are on different surfaces
_JUMP = 16.0


@dataclass(frozen=True)
class Displacement:
    """Distances of a contour of one picture from the same contour of another, in pixels.

    value     of the field
    greatest  largest distance of a point of either from the other (Hausdorff); None if only one of them has the contour
    mean      of the distances of all points
    worst     row and column of the point farthest from the other contour
    points    number of points of the exact contour and of the other one, where it passes between two pixels
    """

    value: float
    maximum: float | None
    mean: float | None
    worst: tuple[float, float] | None
    points: tuple[int, int]


def crossings(record: Record, value: float) -> Floats:
    """(k, 2) rows and columns at which the field takes a value between two neighbouring pixels, linearly between them.

    If the field jumps across the value between elements, the contour runs along the jump; no contour runs between
    surfaces that lie behind one another.
    """
    field, found, apart = record.field, [], _apart(record)
    for axis in (0, 1):
        before, after = (field[:-1], field[1:]) if axis == 0 else (field[:, :-1], field[:, 1:])
        with np.errstate(invalid="ignore"):
            rows, columns = np.nonzero((before < value) != (after < value))
        a, b = before[rows, columns], after[rows, columns]
        known = np.isfinite(a) & np.isfinite(b)
        known &= ~apart[axis][rows, columns]
        points = np.column_stack([rows, columns])[known].astype(np.float64)
        points[:, axis] += (value - a[known]) / (b[known] - a[known])
        found.append(points)
    return np.concatenate(found)


def _apart(record: Record) -> tuple[Bools, Bools]:
    """Neighbours below (h - 1, w) and to the right (h, w - 1) that lie far apart: one surface ends before another."""
    down, right = (np.linalg.norm(np.diff(record.position, axis=axis), axis=2) for axis in (0, 1))
    steps = np.concatenate([down.ravel(), right.ravel()])
    usual = float(np.median(steps[np.isfinite(steps)])) if np.isfinite(steps).any() else 0.0
    return down > _JUMP * usual, right > _JUMP * usual


def displacement(exact: Record, other: Record, value: float) -> Displacement:
    """The displacement of the contour at ``value``."""
    first, second = crossings(exact, value), crossings(other, value)
    counts = (len(first), len(second))
    if not all(counts):
        return Displacement(value, None if any(counts) else 0.0, None if any(counts) else 0.0, None, counts)
    tree = comparison_module("scipy.spatial").cKDTree
    away, back = tree(second).query(first)[0], tree(first).query(second)[0]
    far = first[away.argmax()] if away.max() >= back.max() else second[back.argmax()]
    both = np.concatenate([away, back])
    return Displacement(value, float(both.max()), float(both.mean()), (float(far[0]), float(far[1])), counts)
