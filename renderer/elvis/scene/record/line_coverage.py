"""Parts of pixels that lines cover."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.scene.record.strokes import Segments

#: pixels between the points along a line around which pixels are covered
STEP = 1.0


def line_coverage(distance: Floats, width: float) -> Floats:
    """Part (n,) of a pixel that a line covers whose middle is this far from the pixel's centre; both in pixels."""
    return np.clip(0.5 * width + 0.5 - distance, 0.0, min(1.0, width))


def coverage(lines: Segments, shape: tuple[int, int]) -> tuple[Ints, Floats]:
    """Numbers (n,) of the pixels that lines touch, and the part of each that they cover.

    A pixel's part follows from the distance between its centre and the line; lines end about a pixel behind their ends.
    """
    height, width = shape
    places, across = _points_along(lines)
    nearest = np.rint(places).astype(np.int64)
    reach = int(np.ceil(0.5 * lines.width + 0.5))
    covered = np.zeros(height * width, np.float64)
    for shift in np.ndindex(2 * reach + 1, 2 * reach + 1):
        pixel = nearest + np.array(shift) - reach
        step = pixel - places
        aside = np.abs((step * across).sum(axis=1))
        beyond = np.abs(step[:, 0] * across[:, 1] - step[:, 1] * across[:, 0])
        ink = np.where(beyond <= STEP, line_coverage(aside, lines.width), 0.0)
        is_inside = ((pixel >= 0) & (pixel < [width, height])).all(axis=1) & (ink > 0.0)
        numbers = pixel[is_inside, 1] * width + pixel[is_inside, 0]
        np.maximum.at(covered, numbers, ink[is_inside])
    found = np.flatnonzero(covered)
    return found, covered[found]


def _points_along(lines: Segments) -> tuple[Floats, Floats]:
    """Points (n, 2) along lines, and unit vectors (n, 2) across them."""
    along = lines.ends - lines.starts
    length = np.linalg.norm(along, axis=1)
    count = np.ceil(length / STEP).astype(np.int64) + 1
    line = np.repeat(np.arange(len(along)), count)
    number = np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count)
    part = number / np.maximum(count[line] - 1, 1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(length, 1e-300)[:, None]
    return lines.starts[line] + part[:, None] * along[line], across[line]
