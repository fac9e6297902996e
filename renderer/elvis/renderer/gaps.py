"""Gaps: pixels that Newton's method may have missed in elements that bend strongly.

In such an element the method can end at a root outside while there is one inside.  What it finds inside is right, so
only pixels that no element owns are in question, most of them next to the domain.  Those next to an owned pixel are
decided by proof, and so are the neighbours of all that are found; where an element owns nothing at all, every pixel
of its section is. They are looked at in bands of rows, which bounds the memory.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.arrays import Bools, Ints
from elvis.plugins.volume import Part
from elvis.renderer.pixels import NOBODY, Pixels, resolve
from elvis.renderer.proof import prove
from elvis.renderer.tiles import TILE, tiles_of
from elvis.scene.view import PlaneView

_UNKNOWN = -1
#: candidates that are resolved together, so that memory does not grow with the picture
_MOST = 1 << 17


class Gaps:
    """The parts of a volume, with what is known of their elements' bends."""

    def __init__(self, parts: Sequence[Part], candidates: Callable[[int], NDArray[Any]]) -> None:
        """Of a volume's parts; ``candidates`` makes n empty candidates."""
        self._parts, self._empty = parts, candidates
        self._first = np.cumsum([0, *map(len, parts)])
        self._bent = [np.full(len(part), _UNKNOWN, np.int8) for part in parts]

    def close(self, view: PlaneView, pixels: Pixels, sections: Sequence[NDArray[Any]]) -> None:
        """Find the missed pixels of a picture; ``sections`` are those of each part, as cut_cull lists them."""
        free: Bools = np.asarray(pixels.owner == NOBODY).reshape(view.height, view.width)
        bent = [self._bent_ones(number, some) for number, some in enumerate(sections)]
        if not sum(map(len, bent)) or not free.any():
            return

        # wherever an element that owns nothing may be, and beside what is owned
        owning = np.zeros(self._first[-1], bool)
        owning[pixels.owner[~free.reshape(-1)]] = True
        idle = [some[~owning[some["element"] + first]] for some, first in zip(bent, self._first, strict=False)]
        self._resolve(view, pixels, idle, free)
        due = free & beside(~free)
        while due.any():
            self._resolve(view, pixels, bent, due)
            found = free & (pixels.owner != NOBODY).reshape(free.shape)
            free = free & ~found & ~due
            due = free & beside(found)

    def _resolve(self, view: PlaneView, pixels: Pixels, sections: Sequence[NDArray[Any]], mask: Bools) -> None:
        """Prove who of the sections' elements, if any, owns the pixels of a mask (h, w), some rows at a time."""
        for start, stop in row_bands(sections, mask):
            own: Bools = np.zeros_like(mask)
            own[start:stop] = mask[start:stop]
            bands = [_between_rows(some, start, stop) for some in sections]
            candidates = [self._candidates(some, first, own) for some, first in zip(bands, self._first, strict=False)]
            resolve(pixels, [prove(self._parts, view, some) for some in candidates if len(some)])

    def _candidates(self, sections: NDArray[Any], first: int, mask: Bools) -> NDArray[Any]:
        """Undecided candidates: elements of a part's sections, by index in the volume, for the pixels of a mask."""
        pixel, element = pairs(sections, mask)
        candidates = self._empty(len(pixel))
        candidates["pixel"], candidates["element"] = pixel, first + element
        return candidates

    def _bent_ones(self, number: int, sections: NDArray[Any]) -> NDArray[Any]:
        """The sections of a part's strongly bent elements."""
        if self._parts[number].bends is None or self._parts[number].solve is None or not len(sections):
            return sections[:0]
        return sections[self._bends(number, sections["element"].astype(np.int64))]

    def _bends(self, number: int, elements: Ints) -> Bools:
        """(n,) whether elements of a part bend strongly; asked once for each."""
        known, bends = self._bent[number], self._parts[number].bends
        assert bends is not None
        new = elements[known[elements] == _UNKNOWN]
        if len(new):
            known[new] = bends(new)
        return np.asarray(known[elements] == 1)


def row_bands(sections: Sequence[NDArray[Any]], mask: Bools) -> list[tuple[int, int]]:
    """First and last but one rows of bands in which a mask (h, w) has at most n pixels of sections' bounds.

    A row that has more by itself is a band of its own; rows without any are in none.
    """
    # how many sections, and how many pixels within their bounds, each row has: from what begins and ends there
    height, width = mask.shape
    changes = np.zeros((2, height + 1), np.int64)
    for some in sections:
        least = np.clip(some["least"][:, :2], 0, (width, height)).astype(np.int64)
        most = np.clip(some["most"][:, :2] + 1, 0, (width, height)).astype(np.int64)
        for row, sign in ((least[:, 1], 1), (most[:, 1], -1)):
            np.add.at(changes[0], row, sign)
            np.add.at(changes[1], row, sign * (most[:, 0] - least[:, 0]))
    count, area = changes.cumsum(axis=1)[:, :height]
    candidates = np.minimum(area, count * mask.sum(axis=1))

    bands, start, total = [], 0, 0
    for row in np.flatnonzero(candidates):
        if total and total + candidates[row] > _MOST:
            bands.append((start, int(row)))
            total = 0
        start = start if total else int(row)
        total += int(candidates[row])
    return [*bands, (start, int(row) + 1)] if total else bands


def _between_rows(sections: NDArray[Any], start: int, stop: int) -> NDArray[Any]:
    """Those of the sections that have rows from ``start`` to before ``stop``, with bounds that have no others."""
    near = (sections["least"][:, 1] < stop) & (sections["most"][:, 1] >= start)
    found: NDArray[Any] = sections[near].copy()
    found["least"][:, 1] = np.maximum(found["least"][:, 1], start)
    found["most"][:, 1] = np.minimum(found["most"][:, 1], stop - 1)
    return found


def pairs(sections: NDArray[Any], mask: Bools) -> tuple[Ints, NDArray[np.uint32]]:
    """The pixels (n,) of a mask (h, w) within the bounds of each section, and the section's element (n,)."""
    tiles = tiles_of(sections["least"], sections["most"])
    tiles = tiles[_any_near(mask, tiles.x, tiles.y)]

    # all pixels of these tiles, then those that the bounds and the mask allow
    width = mask.shape[1]
    steps = np.arange(TILE)[:, None] * width + np.arange(TILE)
    flat = np.append(mask, np.zeros((TILE + 1) * width, bool))
    held = np.flatnonzero(flat[(tiles.y.astype(np.int64) * width + tiles.x)[:, None] + steps.reshape(-1)])
    tile, place = tiles[held // TILE**2], held % TILE**2
    x, y, section = tile.x + place % TILE, tile.y + place // TILE, sections[tile.section]
    place = np.stack([x, y, x + y, x - y], axis=1)
    within = ((section["least"] <= place) & (place <= section["most"])).all(axis=1) & (x < width)
    return y[within] * width + x[within], section["element"][within]


def beside(mask: Bools) -> Bools:
    """(h, w) pixels of the mask (h, w) and those that touch them, corners included."""
    wide = mask.copy()
    wide[1:] |= mask[:-1]
    wide[:-1] |= mask[1:]
    result = wide.copy()
    result[:, 1:] |= wide[:, :-1]
    result[:, :-1] |= wide[:, 1:]
    return result


def _any_near(mask: Bools, x: Ints, y: Ints) -> Bools:
    """(n,) whether there may be a pixel of the mask (h, w) in tiles that begin at columns x and rows y (n,)."""
    rows, columns = (side // TILE + 2 for side in mask.shape)
    padded = np.zeros((rows * TILE, columns * TILE), bool)
    padded[: mask.shape[0], : mask.shape[1]] = mask
    strips = padded.reshape(rows, TILE, columns * TILE).any(axis=1)  # axis by axis, which is sooner done than both
    cells: Bools = np.asarray(strips.reshape(rows, columns, TILE).any(axis=2))
    i, j = y // TILE, x // TILE
    return np.asarray(cells[i, j] | cells[i + 1, j] | cells[i, j + 1] | cells[i + 1, j + 1])
