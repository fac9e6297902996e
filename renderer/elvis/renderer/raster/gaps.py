"""Gaps: pixels that Newton's method may have missed in strongly curved elements.

In such an element the method can end at a root outside while there is one inside.  Its results inside are right, so
only pixels without an owner are in question, most of them next to the domain.  Pixels next to an owned pixel are
decided by proof, and so are the neighbours of all pixels found; if an element owns nothing at all, every pixel of its
section is decided by proof.  They are processed in bands of rows, which bounds the memory.  Drafts skip this.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Ints, Records, starts_of
from elvis.plugins.runtime.volume import Part
from elvis.renderer.device.drafts import is_draft
from elvis.renderer.raster.pixels import NOBODY, Pixels, resolve
from elvis.renderer.raster.proof import prove
from elvis.renderer.raster.tiles import TILE, tiles_of
from elvis.scene.cameras.view import PlaneView, View

_UNKNOWN = -1
#: candidates that are resolved together, so that memory does not grow with the picture
_MOST = 1 << 17


@dataclass(frozen=True, eq=False)
class _Asked:
    """Sections of elements of a part, and a mask (h, w) of pixels that may be theirs.

    first  index in the volume of the part's first element
    """

    first: int
    sections: Records
    mask: Bools

    def between_rows(self, start: int, stop: int) -> _Asked:
        """The same of rows from ``start`` to before ``stop``, which are the only ones that the sections have then."""
        return _Asked(self.first, _between_rows(self.sections, start, stop), self.mask)


class Gaps:
    """The parts of a volume, with the curvature classes of their elements."""

    def __init__(
        self,
        parts: Sequence[Part],
        candidates: Callable[[int], Records],
        bent: list[NDArray[np.int8]] | None = None,
    ) -> None:
        """Gaps of a volume's parts; ``candidates`` makes n empty ones, ``bent`` has known classes (see unknown)."""
        self._parts = parts
        self._empty = candidates
        self._first = starts_of(parts)
        self._bent = unknown(parts) if bent is None else bent

    def close(self, view: PlaneView, pixels: Pixels, sections: Sequence[Records]) -> None:
        """Find the missed pixels of a picture, except a draft; ``sections`` of each part are cut_cull's."""
        if is_draft():
            return
        free: Bools = np.asarray(pixels.owner == NOBODY).reshape(view.height, view.width)
        bent = [within(view, self._bent_ones(number, some)) for number, some in enumerate(sections)]
        if not sum(map(len, bent)) or not free.any():
            return

        # everywhere for elements that own nothing; for the others next to owned pixels
        due = free & beside(~free)
        is_owning = np.zeros(self._first[-1] + 1, bool)
        is_owning[np.minimum(pixels.owner, self._first[-1])] = True
        asked = []
        for some, first in zip(bent, self._first, strict=False):
            owns = is_owning[some["element"] + first]
            asked += [_Asked(first, some[~owns], free), _Asked(first, some[owns], due)]
        self._resolve(view, pixels, asked)

        # next to the pixels found, until no more are found
        while True:
            found = free & (pixels.owner != NOBODY).reshape(free.shape)
            free = free & ~found & ~due
            due = free & beside(found)
            if not due.any():
                return
            asked = [_Asked(first, some, due) for some, first in zip(bent, self._first, strict=False)]
            self._resolve(view, pixels, asked)

    def _resolve(self, view: PlaneView, pixels: Pixels, asked: Sequence[_Asked]) -> None:
        """Prove who of the elements, if any, owns the pixels, some rows at a time."""
        for start, stop in row_bands([(own.sections, own.mask) for own in asked]):
            candidates = [self._candidates(own.between_rows(start, stop)) for own in asked]
            every = np.concatenate(candidates) if candidates else self._empty(0)
            if len(every):
                resolve(pixels, [prove(self._parts, view, every)])

    def _candidates(self, asked: _Asked) -> Records:
        """Undecided candidates: elements by index in the volume, for pixels that may be theirs."""
        pixel, element = pairs(asked.sections, asked.mask)
        candidates = self._empty(len(pixel))
        candidates["pixel"] = pixel
        candidates["element"] = asked.first + element
        return candidates

    def _bent_ones(self, number: int, sections: Records) -> Records:
        """The sections of a part's strongly curved elements."""
        part = self._parts[number]
        if part.bends is None or part.solve is None or not len(sections):
            return sections[:0]
        elements = sections["element"].astype(np.int64)
        return sections[self._bends(number, elements)]

    def _bends(self, number: int, elements: Ints) -> Bools:
        """(n,) whether elements of a part bend strongly; asked once for each."""
        known = self._bent[number]
        bends = self._parts[number].bends
        assert bends is not None
        new = elements[known[elements] == _UNKNOWN]
        if len(new):
            known[new] = bends(new)
        return np.asarray(known[elements] == 1)


def unknown(parts: Sequence[Part]) -> list[NDArray[np.int8]]:
    """For each part whether elements bend strongly: nothing is known of any yet."""
    return [np.full(len(part), _UNKNOWN, np.int8) for part in parts]


def within(view: View, sections: Records) -> Records:
    """Sections in a view, in columns and rows relative to its first ones."""
    (left, top), size = view.first, view.last - view.first
    found: Records = sections.copy()
    for name in ("least", "most"):
        found[name] -= np.array([left, top, left + top, left - top], found[name].dtype)
    found["least"][:, :2] = np.maximum(found["least"][:, :2], 0)
    found["most"][:, :2] = np.minimum(found["most"][:, :2], size)
    return found[(found["least"][:, :2] <= found["most"][:, :2]).all(axis=1)]


def row_bands(asked: Sequence[tuple[Records, Bools]]) -> list[tuple[int, int]]:
    """First and last but one rows of bands in which masks (h, w) have at most n pixels of their sections' bounds.

    A row that exceeds n is a band of its own; rows without any are in no band.
    """
    candidates: Ints = np.asarray(sum(_most_in_rows(sections, mask) for sections, mask in asked))

    # as many rows together as there is room for
    bands = []
    start = 0
    total = 0
    for row in np.flatnonzero(candidates):
        if total and total + candidates[row] > _MOST:
            bands.append((start, int(row)))
            total = 0
        if not total:
            start = int(row)
        total += int(candidates[row])
    if total:
        bands.append((start, int(row) + 1))
    return bands


def _most_in_rows(sections: Records, mask: Bools) -> Ints:
    """Maximum number (h,) of pixels that each row of a mask (h, w) has within the bounds of each section."""
    height, width = mask.shape

    # how the number of sections, and of pixels within their bounds, changes from one row to the next
    count_steps = np.zeros(height + 1, np.int64)
    area_steps = np.zeros(height + 1, np.int64)
    left, top = np.clip(sections["least"][:, :2], 0, (width, height)).astype(np.int64).T
    right, bottom = np.clip(sections["most"][:, :2] + 1, 0, (width, height)).astype(np.int64).T
    for row, sign in ((top, 1), (bottom, -1)):
        np.add.at(count_steps, row, sign)
        np.add.at(area_steps, row, sign * (right - left))
    count = count_steps.cumsum()[:height]
    area = area_steps.cumsum()[:height]
    return np.asarray(np.minimum(area, count * mask.sum(axis=1)))


def _between_rows(sections: Records, start: int, stop: int) -> Records:
    """Sections with rows from ``start`` to before ``stop``, with bounds cut to these."""
    near = (sections["least"][:, 1] < stop) & (sections["most"][:, 1] >= start)
    found: Records = sections[near].copy()
    found["least"][:, 1] = np.maximum(found["least"][:, 1], start)
    found["most"][:, 1] = np.minimum(found["most"][:, 1], stop - 1)
    return found


def pairs(sections: Records, mask: Bools) -> tuple[Ints, NDArray[np.uint32]]:
    """The pixels (n,) of a mask (h, w) within the bounds of each section, and the section's element (n,)."""
    cells = _cells_with_any(mask)
    sections = sections[_any_within(cells, sections["least"][:, :2], sections["most"][:, :2])]
    tiles = tiles_of(sections["least"], sections["most"])
    tiles = tiles[_any_near(cells, tiles.x, tiles.y)]

    # all pixels of these tiles that the mask has; tiles may reach beyond its end
    width = mask.shape[1]
    steps = np.arange(TILE)[:, None] * width + np.arange(TILE)
    first_pixel = tiles.y.astype(np.int64) * width + tiles.x
    flat = np.append(mask, np.zeros((TILE + 1) * width, bool))
    held = np.flatnonzero(flat[first_pixel[:, None] + steps.reshape(-1)])
    tile = held // TILE**2
    row, column = np.divmod(held % TILE**2, TILE)
    x = tiles.x[tile] + column
    y = tiles.y[tile] + row

    # pixels within the bounds
    section = sections[tiles.section[tile]]
    place = np.stack([x, y, x + y, x - y], axis=1)
    is_within = ((section["least"] <= place) & (place <= section["most"])).all(axis=1)
    is_within &= x < width
    return y[is_within] * width + x[is_within], section["element"][is_within]


def beside(mask: Bools) -> Bools:
    """The pixels of the mask (h, w) and their neighbours, including diagonal ones."""
    wide = mask.copy()
    wide[1:] |= mask[:-1]
    wide[:-1] |= mask[1:]
    result = wide.copy()
    result[:, 1:] |= wide[:, :-1]
    result[:, :-1] |= wide[:, 1:]
    return result


def _cells_with_any(mask: Bools) -> Bools:
    """(h, w) which tiles of a grid have a pixel of the mask; there is one more of them than it takes each way."""
    height, width = mask.shape
    rows = height // TILE + 2
    columns = width // TILE + 2
    padded = np.zeros((rows * TILE, columns * TILE), bool)
    padded[:height, :width] = mask

    # axis by axis, which is sooner done than both
    strips = padded.reshape(rows, TILE, columns * TILE).any(axis=1)
    return np.asarray(strips.reshape(rows, columns, TILE).any(axis=2))


def _any_within(cells: Bools, least: Ints, most: Ints) -> Bools:
    """(n,) whether one of the cells (h, w) that bounds (n, 2) of columns and rows meet has any."""
    # sums up to each corner, which give the sum over any rectangle
    rows, columns = cells.shape
    sums = np.zeros((rows + 1, columns + 1), np.int64)
    sums[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)
    left, top = np.clip(least // TILE, 0, (columns, rows)).T
    right, bottom = np.clip(most // TILE + 1, 0, (columns, rows)).T
    return np.asarray(sums[bottom, right] - sums[bottom, left] - sums[top, right] + sums[top, left] > 0)


def _any_near(cells: Bools, x: Ints, y: Ints) -> Bools:
    """(n,) whether one of the cells (h, w) that tiles beginning at columns x and rows y (n,) meet has any."""
    # a tile meets four of the grid at most
    i = y // TILE
    j = x // TILE
    return np.asarray(cells[i, j] | cells[i + 1, j] | cells[i, j + 1] | cells[i + 1, j + 1])
