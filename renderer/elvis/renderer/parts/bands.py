"""Bands of rows of a picture, one for each of several ranks: where they end, and which elements reach into them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Ints
from elvis.core.mapping.boxes import Boxes
from elvis.core.mapping.orientation import chunks
from elvis.renderer.raster.tiles import TILE
from elvis.scene.cameras.view import View

#: enlargement of boxes on all sides, relative to the maximum coordinate: more than any rounding of their contents
_SLACK = 1e-8
#: boxes that are projected at once
_AT_ONCE = 1 << 18
#: pixels that cost as much as an element that reaches into a row of tiles
_PIXELS_OF_AN_ELEMENT = 64


@dataclass(frozen=True, eq=False)
class Bands:
    """Assignment of rows of a picture to ranks.

    view     of the picture
    borders  (ranks + 1,) rows: the rank with number k draws those from borders[k] to before borders[k + 1]
    """

    view: View
    borders: Ints

    @staticmethod
    def even(view: View, count: int) -> Bands:
        """Bands with about the same number of rows.

        If there are more bands than rows of tiles, some are empty, but never the first.
        """
        return Bands.sharing(view, np.zeros(_tiles(view), np.int64), count)

    @staticmethod
    def sharing(view: View, elements: Ints, count: int) -> Bands:
        """Bands with about the same work.

        elements  (n,) number of elements that reach into each row of tiles
        """
        work = elements + TILE * view.width / _PIXELS_OF_AN_ELEMENT
        done = np.append(0.0, np.cumsum(work))
        shares = done[-1] * np.arange(count + 1) / count
        # each border is the one between two rows of tiles that comes nearest to its share
        borders = np.searchsorted(0.5 * (done[1:] + done[:-1]), shares)
        # the first rank has some rows: its own drawing determines its colour bars
        borders[1:] = np.maximum(borders[1:], 1)
        return Bands(view, np.minimum(TILE * borders, view.height))

    def reached(self, rows: Ints, number: int) -> Bools:
        """(n,) which elements that reach rows of tiles (n, 2) reach a band."""
        first, last = self.borders[number : number + 2]
        meets: Bools = (rows[:, 0] * TILE < last) & ((rows[:, 1] + 1) * TILE > first)
        return meets if first < last else np.zeros(len(rows), bool)


def counts_by_row(view: View, rows: Ints) -> Ints:
    """(n,) how many elements that reach rows of tiles (m, 2) reach each row of tiles of a picture."""
    steps = np.zeros(_tiles(view) + 1, np.int64)
    seen = rows[rows[:, 0] <= rows[:, 1]]
    np.add.at(steps, seen[:, 0], 1)
    np.add.at(steps, seen[:, 1] + 1, -1)
    return np.cumsum(steps[:-1])


def rows_reached(view: View, boxes: Boxes, around: int, extent: float) -> Ints:
    """(n, 2) first and last row of tiles of a picture in which something of what boxes (n, 6) hold may be seen; the
    last is before the first where nothing is.

    around  pixels around one, in each direction, that it depends on
    extent  the largest coordinate of all data, in magnitude
    """
    every = [_rows_reached(view, boxes[some], around, extent) for some in chunks(len(boxes), _AT_ONCE)]
    return np.concatenate([np.empty((0, 2), np.int64), *every])


def _rows_reached(view: View, boxes: Boxes, around: int, extent: float) -> Ints:
    """The same of few boxes.  A box that isn't finite, or that the plane of the eye cuts, reaches everywhere."""
    wide = boxes.astype(np.float64) + _SLACK * extent * np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0])
    corners = np.stack([wide[:, [3 * (k >> axis & 1) + axis for axis in range(3)]] for k in range(8)], axis=1)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        placed = view.projected(corners)
        weight = placed[..., 2]
        pixels = placed[..., :2] / weight[..., None]
    # a tile more, as drawing works on complete tiles
    low, high = pixels.min(axis=1) - (around + TILE), pixels.max(axis=1) + (around + TILE)
    is_everywhere = ~(weight > 0.0).all(axis=1) | ~np.isfinite(low + high).all(axis=1)
    is_seen = ((high >= 0.0) & (low <= [view.width - 1, view.height - 1])).all(axis=1) | is_everywhere
    is_seen &= ~(weight < 0.0).all(axis=1)
    rows = np.stack([low[:, 1], high[:, 1]], axis=1)
    rows[is_everywhere] = [0.0, view.height - 1.0]
    rows = np.clip(np.nan_to_num(rows), 0.0, view.height - 1.0)
    rows[~is_seen] = [TILE, 0.0]
    return np.asarray(np.floor(rows / TILE).astype(np.int64))


def _tiles(view: View) -> int:
    """Rows of tiles of a picture."""
    return -(-view.height // TILE)
