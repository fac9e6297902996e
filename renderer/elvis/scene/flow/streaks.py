"""Noise in the picture that line integral convolution averages along a velocity, and what a mean of it is to colours.

Cabral and Leedom, Imaging vector fields using line integral convolution, SIGGRAPH 1993.  The noise belongs to places of
the picture, from its middle, and to nothing in the data.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats
from elvis.scene.cameras.view import View

#: cells of the noise in the width of a streak: how wide its covariance is at half its height
CELLS = 2.75
#: what each cell takes of its neighbours, in each direction, so that streaks don't alias
_SMOOTH = (0.25, 0.5, 0.25)
#: places in pixels are rounded to this, so that bands and samples of a picture have the same noise
_ROUND = 6


def scale_of(width: float) -> float:
    """Cells of the noise in a pixel, for streaks of a width in pixels."""
    return CELLS / width


def middle(view: View) -> Floats:
    """(2,) column and row, not whole, where the noise of a view has its origin: the middle of the whole picture."""
    steps = np.stack([view.column, view.row])
    return np.asarray(np.round(-(steps @ view.corner) / (steps**2).sum(axis=1), _ROUND))


def cells(view: View, width: float) -> tuple[NDArray[np.int64], tuple[int, int]]:
    """(2,) the first cell, column and row, and the rows and columns of all that pixels of a view need."""
    scale, origin = scale_of(width), middle(view)
    first = np.floor(scale * (view.first - 0.5 - origin)).astype(np.int64) - 1
    last = np.floor(scale * (view.last + 0.5 - origin)).astype(np.int64) + 2
    columns, rows = (last - first + 1).tolist()
    return first, (rows, columns)


def noise(first: tuple[int, int], shape: tuple[int, int]) -> Floats:
    """(rows, columns) noise of cells from ``first``, column and row; between them it is bilinear."""
    column, row = (np.arange(start - 1, start + count + 1) for start, count in zip(first, shape[::-1], strict=True))
    white = _white(column, row)
    left, own, right = _SMOOTH
    across = left * white[:, :-2] + own * white[:, 1:-1] + right * white[:, 2:]
    return np.asarray(left * across[:-2] + own * across[1:-1] + right * across[2:])


def _white(column: NDArray[np.int64], row: NDArray[np.int64]) -> Floats:
    """(rows, columns) numbers from -1 to 1, evenly spread, that know nothing of one another."""
    with np.errstate(over="ignore"):
        mixed = _mixed(column.astype(np.uint32) + _mixed(row.astype(np.uint32))[:, None])
    return np.asarray(mixed * (2.0 / 0xFFFFFFFF) - 1.0)


def _mixed(values: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Each number's bits, mixed: Wellons' lowbias32."""
    for shift, factor in ((16, 0x7FEB352D), (15, 0x846CA68B)):
        values = (values ^ (values >> np.uint32(shift))) * np.uint32(factor)
    return values ^ (values >> np.uint32(16))


@lru_cache(maxsize=1)
def _covariance() -> tuple[float, float]:
    """Variance of the noise at a point, and the integral of its covariance along a line, in cells; means over both.

    In each direction the noise is white numbers times _SMOOTH times a hat function, so its covariance is their
    autocorrelation: the one of _SMOOTH between cubic B-splines.
    """
    weights = np.convolve(_SMOOTH, _SMOOTH)
    places = np.arange(len(weights)) - len(weights) // 2

    def along(apart: Floats) -> Floats:
        away = np.abs(apart[:, None] - places)
        inner, outer = 2.0 / 3.0 - away**2 + 0.5 * away**3, np.maximum(2.0 - away, 0.0) ** 3 / 6.0
        return np.asarray(np.where(away < 1.0, inner, outer) @ weights)

    apart, angles = np.linspace(-6.0, 6.0, 1201), np.linspace(0.0, np.pi / 2, 46)
    lines = [along(apart * np.cos(angle)) * along(apart * np.sin(angle)) for angle in angles]
    white = 1.0 / 3.0
    origin = np.zeros(1)
    return white * float(along(origin)[0]) ** 2, white * float(np.mean(lines)) * 12.0


def spread(width: float) -> tuple[float, float]:
    """Variance of the noise, and the integral of its covariance along a line in pixels, for streaks of a width."""
    variance, integral = _covariance()
    return variance, integral / scale_of(width)


def weights(length: float) -> tuple[float, Floats]:
    """A step, less than half a pixel, and (n + 1,) the weights of places 0 to n steps away: a raised cosine."""
    steps = int(length) + 1
    step = 0.5 * length / steps
    return step, 0.5 + 0.5 * np.cos(np.pi * np.arange(steps + 1) / steps)


def tones(mean: Floats, weight: Floats, squares: Floats, width: float) -> Floats:
    """Tones (n,) from -1 to 1, from means (n,) of the noise along lines, scaled to equal contrast.

    weight, squares  (n,) integrals of the weights, and of their squares, along the lines

    The variance of a mean is known: for long lines it is the integral of the covariance times squares over weight², for
    short ones the variance of the noise; in between, the squares of the inverses of both add up, exactly so if
    covariance and weights are Gaussian.
    """
    variance, integral = spread(width)
    measure = mean * np.sqrt(np.hypot(1.0 / variance, weight**2 / (integral * squares)))
    return np.asarray(measure / np.sqrt(1.0 + measure**2))


def toned(colors: Floats, tone: Floats, contrast: float) -> Floats:
    """(n, 3) colours, towards black where a tone (n,) is negative and towards white where it is positive."""
    change = contrast * np.nan_to_num(tone)[:, None]
    return np.where(change < 0.0, (1.0 + change) * colors, colors + change * (1.0 - colors))
