"""Things that lie behind the hits of all pixels in which they may be visible.

Greene, Kass and Miller 1993, *Hierarchical Z-buffer visibility*: maxima of depths over squares of pixels of doubling
size, of which four cover any rectangle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.renderer.raster.pixels import NOBODY
from elvis.scene.cameras.view import View

#: pixels of a side of the smallest squares
SQUARE = 4


@dataclass(frozen=True, eq=False)
class Occlusion:
    """Depths at which squares of pixels are opaque: infinite if a pixel has no hit.

    first   (2,) column and row of the first pixel
    levels  arrays (rows, columns) of squares, whose sides double
    """

    first: Ints
    levels: tuple[Floats, ...]

    @staticmethod
    def of(view: View, owner: Ints, depth: Floats) -> Occlusion:
        """The occlusion by the hits of a view's pixels: owners and depths (n,)."""
        opaque = np.where(owner == NOBODY, np.inf, depth).reshape(view.height, view.width)
        levels = [_greatest(opaque, SQUARE)]
        while max(levels[-1].shape) > 1:
            levels.append(_greatest(levels[-1], 2))
        return Occlusion(view.first, tuple(levels))

    def hides(self, least: Ints, most: Ints, near: Floats) -> Bools:
        """(n,) whether things with depths of at least ``near`` (n,) are hidden.

        least, most  (n, 2) first and last column and row of the pixels in which they may be visible
        """
        rows, columns = self.levels[0].shape
        limit = np.array([columns, rows]) - 1
        low = np.clip((least - self.first) // SQUARE, 0, limit)
        high = np.clip((most - self.first) // SQUARE, 0, limit)
        # two squares of this level or fewer cover the range in each direction
        size = np.maximum((high - low).max(axis=1, initial=0), 1)
        level_of = np.ceil(np.log2(size)).astype(np.int64)
        farthest = np.empty(len(near))
        for number, squares in enumerate(self.levels):
            own = np.flatnonzero(level_of == number)
            (x0, y0), (x1, y1) = (low[own] >> number).T, (high[own] >> number).T
            corners = squares[y0, x0], squares[y0, x1], squares[y1, x0], squares[y1, x1]
            farthest[own] = np.maximum.reduce(corners)
        return np.asarray(near >= farthest)


def _greatest(depths: Floats, side: int) -> Floats:
    """Maxima over squares of an array; the last squares may be incomplete."""
    rows, columns = depths.shape
    room = ((0, -rows % side), (0, -columns % side))
    padded = np.pad(depths, room, constant_values=-np.inf)
    blocks = padded.reshape(padded.shape[0] // side, side, padded.shape[1] // side, side)
    return np.asarray(blocks.max(axis=(1, 3)))
