"""Sections, where elements may be seen, and the tiles that cover them: small squares of pixels, the unit of work.

The Tile records of all passes (pixels.slang) are made here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats
from elvis.scene.cameras.view import View

#: as in pixels.slang
TILE = 8
#: tiles before the picture's first, each way, that may have numbers
_BEFORE = 1 << 19


@dataclass(frozen=True, eq=False)
class Sections:
    """Ranges of pixels in which elements may be visible.

    element      (n,)    number in its part
    least, most  (n, 4)  bounds of x, y, x + y and x - y of their pixels, inclusive
    """

    element: NDArray[Any]
    least: NDArray[Any]
    most: NDArray[Any]

    def __len__(self) -> int:
        return len(self.element)

    def __getitem__(self, chosen: NDArray[Any]) -> Sections:
        return Sections(self.element[chosen], self.least[chosen], self.most[chosen])


@dataclass(frozen=True, eq=False)
class Tiles:
    """Pairs of a section and a tile, (n,) each: number of the section, column and row of the tile's first pixel."""

    section: NDArray[np.int64]
    x: NDArray[Any]
    y: NDArray[Any]

    def __len__(self) -> int:
        return len(self.section)

    def __getitem__(self, chosen: NDArray[Any]) -> Tiles:
        return Tiles(self.section[chosen], self.x[chosen], self.y[chosen])


def tiles_of(least: NDArray[Any], most: NDArray[Any]) -> Tiles:
    """Tiles of TILE x TILE pixels that cover the bounds (n, 4) of sections, including those of x + y and x - y."""
    low, high = (np.ascontiguousarray(some.T, np.int32) for some in (least, most))
    across = (high[0] - low[0]) // TILE + 1
    along = (high[1] - low[1]) // TILE + 1

    # number the tiles of every section; short numbers are sooner divided
    counts = across * along
    owner = np.repeat(np.arange(len(least)), counts)
    index = np.arange(len(owner), dtype=np.int32)
    index -= np.repeat((np.cumsum(counts) - counts).astype(np.int32), counts)
    wide = across[owner]
    row = index // wide
    x = low[0, owner] + TILE * (index - row * wide)
    y = low[1, owner] + TILE * row

    # keep tiles within the diagonal bounds
    last = TILE - 1
    kept = (x + y + 2 * last >= low[2, owner]) & (x + y <= high[2, owner])
    kept &= (x - y + last >= low[3, owner]) & (x - y - last <= high[3, owner])
    return Tiles(owner[kept], x[kept], y[kept])


def tiles_by_section(least: NDArray[Any], most: NDArray[Any], view: View, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Tile records of a view, each of a single section (see ``bin_sections``), at which it begins."""
    pairs = tiles_of(least, most)
    if view.part_of is not None:
        before, after = view.first - TILE, view.last
        is_there = (pairs.x > before[0]) & (pairs.y > before[1]) & (pairs.x <= after[0]) & (pairs.y <= after[1])
        pairs = pairs[is_there]
    return _records(pairs.x, pairs.y, pairs.section, pairs.section + 1, dtype)


def bin_sections(
    least: NDArray[Any],
    most: NDArray[Any],
    dtype: np.dtype[Any],
    view: View | None = None,
    beside: Floats | None = None,
) -> tuple[NDArray[Any], NDArray[np.uint32]]:
    """Tile records of a picture, row by row, and (m,) the visible sections of one tile after another.

    least, most  (n, 4)  bounds of x, y, x + y and x - y of the sections' pixels, inclusive
    dtype        of Tile records in a kernel's layout
    view         all of whose tiles are wanted; None for tiles with a section
    beside       (k, 3, n)  a, b and c of lines a x + b y = c, beyond which a section has no pixels, if there are any
    """
    aligned = least.copy()
    aligned[:, :2] = least[:, :2] // TILE * TILE
    pairs = tiles_of(aligned, most)
    for a, b, c in beside if beside is not None else ():
        # the minimum of a x + b y in a tile
        most_left = c + (TILE - 1) * (np.maximum(-a, 0.0) + np.maximum(-b, 0.0))
        pairs = pairs[~(a[pairs.section] * pairs.x + b[pairs.section] * pairs.y > most_left[pairs.section])]

    # sections by tile, in their own order within each
    left, top, columns, rows = _grid(pairs) if view is None else _grid_of(view)
    number = (pairs.y // TILE - top) * columns + (pairs.x // TILE - left)
    order = order_of(number)
    number = number[order]
    first = np.flatnonzero(np.diff(number, prepend=-1))
    end = np.append(first, len(number))[1:]
    seen, listed = number[first], pairs.section[order].astype(np.uint32)
    if view is None:
        return _records(TILE * (left + seen % columns), TILE * (top + seen // columns), first, end, dtype), listed

    # tiles without a section are included
    tiles = _all_tiles(left, top, columns, rows, dtype).copy()
    tiles["first"][seen], tiles["end"][seen] = first, end
    return tiles, listed


def order_of(keys: NDArray[Any]) -> NDArray[np.int64]:
    """(n,) the order of keys (n,), equal ones as they were: by digits, which is sooner done, where few differ."""
    least, most = (int(keys.min()), int(keys.max())) if len(keys) else (0, 0)
    if most - least < 1 << 16:
        keys = (keys - least).astype(np.uint16)
    elif most - least < 1 << 22:
        # numbers without gaps, which NumPy sorts by their digits where they have 16 bits
        is_there = np.zeros(most - least + 1, bool)
        is_there[keys - least] = True
        numbers = np.cumsum(is_there) - 1
        if numbers[-1] < 1 << 16:
            keys = numbers.astype(np.uint16)[keys - least]
    return np.argsort(keys, kind="stable")


def empty_tiles(places: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Tile records at places (n,) whose list is not examined."""
    zeros = np.zeros(len(places))
    return _records(*corners_of(places), zeros, zeros, dtype)


def places_of(x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.int64]:
    """(n,) numbers of the tiles with first pixels in columns x and rows y (n,), which ascend row by row."""
    return np.asarray(y.astype(np.int64) + _BEFORE << 20 | x + _BEFORE)


def corners_of(places: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Columns and rows (n,) of the first pixels of tiles with numbers (n,)."""
    return (places & 0xFFFFF) - _BEFORE, (places >> 20) - _BEFORE


def _grid(pairs: Tiles) -> tuple[int, int, int, int]:
    """The first column and row of aligned tiles, and how many columns and rows there are from there on."""
    if not len(pairs):
        return 0, 0, 0, 0
    left, top = int(pairs.x.min()) // TILE, int(pairs.y.min()) // TILE
    return left, top, int(pairs.x.max()) // TILE + 1 - left, int(pairs.y.max()) // TILE + 1 - top


def _grid_of(view: View) -> tuple[int, int, int, int]:
    """Grid of the tiles that cover a view."""
    left, top = (view.first // TILE).tolist()
    right, bottom = (view.last // TILE).tolist()
    return left, top, right + 1 - left, bottom + 1 - top


@lru_cache(maxsize=4)
def _all_tiles(left: int, top: int, columns: int, rows: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Records of all tiles of a grid, row by row, with nothing in them."""
    y, x = np.indices((rows, columns)).reshape(2, -1)
    zeros = np.zeros(len(x))
    return _records(TILE * (left + x), TILE * (top + y), zeros, zeros, dtype)


def _records(
    x: NDArray[Any], y: NDArray[Any], first: NDArray[Any], end: NDArray[Any], dtype: np.dtype[Any]
) -> NDArray[Any]:
    """Tile records (n,)."""
    tiles = np.zeros(len(x), dtype)
    tiles["x"], tiles["y"], tiles["first"], tiles["end"] = x, y, first, end
    return tiles
