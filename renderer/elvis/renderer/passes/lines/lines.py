"""Contour lines and mesh lines on any hit buffer: how much of each pixel they cover (stages: line_*.slang).

A line's coverage of a pixel follows from the distance, in pixels, of the pixel's centre from the middle of the line.
Contours are found in the square of every pixel, from the polynomials of each element that shows there and within that
element's own border; mesh lines are where the facets of an element's reference shape meet the surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints, Records
from elvis.renderer.device.device import ROWS, Device
from elvis.renderer.device.drafts import is_draft
from elvis.renderer.device.memory import Buffer
from elvis.renderer.raster.camera import record_of
from elvis.renderer.raster.gaps import beside, pairs, within
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.raster.tiles import order_of
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View
from elvis.scene.model.errors import SceneError
from elvis.scene.record.line_coverage import line_coverage

#: most contour values, and largest width in pixels, that a mark holds
MOST, WIDEST = 1024, 100.0
#: a mark is a distance in these units of a pixel; a contour's mark has its number in the lowest bits
UNITS = 1 << 26
NOTHING = NOBODY
#: results of line_draw for squares, as in line.slang
_MANY, _POSSIBLE = 1, 2
#: how often the foot on a border is computed; on drafts once, as if the border were straight next to the pixel
FEET, FEET_OF_DRAFTS = 3, 1
#: number of squares with several elements above which possible contours are sifted first
_SIFTED = 1 << 12
#: lines from the centre of a reference shape that look for its facets
_DIRECTIONS = 512


@dataclass(frozen=True, eq=False)
class Marks:
    """Lines by pixel, on the device: how far the nearest one is from the pixel's centre.

    width  of the lines in pixels
    owner  (n,) of the hit buffer that they are on
    mask   the bits of a mark that are distance
    """

    device: Device
    held: Buffer
    width: float
    owner: NDArray[np.uint32]
    mask: int = NOTHING

    @cached_property
    def _read(self) -> NDArray[np.uint32]:
        """(n,) marks, NOTHING where no line is near or nothing is hit."""
        return np.where(self.owner == NOBODY, np.uint32(NOTHING), self.device.read(self.held, np.uint32))

    @cached_property
    def coverage(self) -> Floats:
        """(n,) part of each pixel that its nearest line covers."""
        return line_coverage(self.distance, self.width)

    @property
    def distance(self) -> Floats:
        """(n,) pixels from each pixel's centre to its nearest line, infinite where none is near."""
        return np.where(self._read == NOTHING, np.inf, (self._read & np.uint32(self.mask)) / UNITS)

    @cached_property
    def number(self) -> Ints:
        """(n,) number of that line's value, among the values in ascending order; -1 where none is near."""
        return np.where(self._read == NOTHING, -1, (self._read & (MOST - 1)).astype(np.int64))


@dataclass(frozen=True, eq=False)
class _Work:
    """A stage on a hit buffer, for the items of one part.

    buffers  what items of all parts share
    size     numbers of its record
    """

    stage: str
    view: View
    hits: HitBuffer
    number: int
    quantity: str | None
    buffers: dict[str, Buffer]
    size: dict[str, float]


class Lines:
    """A loaded volume, ready for lines on hit buffers of it."""

    def __init__(self, loaded: DeviceVolume) -> None:
        self._loaded, self._device = loaded, loaded.device

    def contours(self, view: View, hits: HitBuffer, values: Floats, width: float, quantity: str | None = None) -> Marks:
        """Lines where a hit buffer's field has one of the values (k,), which ascend.

        width     in pixels
        quantity  of the parts, whose values are the hit buffer's field; None is the parts' own field
        """
        buffers, items, size = self._prepare(view, hits, values, width, quantity)
        buffers |= {name: self._device.empty(np.uint32, 8) for name in ("strokes", "count")}
        self._run("line_draw", view, hits, items, buffers, quantity, **size)
        return Marks(self._device, buffers["marks"], width, hits.owner, NOTHING - MOST + 1)

    def strokes(self, view: View, hits: HitBuffer, values: Floats, quantity: str | None = None) -> Records:
        """Lines as short straight ones, the records Stroke of line.slang; including hidden ones."""
        buffers, items, size = self._prepare(view, hits, values, 1.0, quantity)
        kernel = self._device.kernel("line_draw", self._loaded.parts[0], quantity)
        kernel.capacity = max(kernel.capacity, 4 * len(items))

        def run(lists: dict[str, Buffer]) -> None:
            self._run("line_draw", view, hits, items, {**buffers, **lists}, quantity, **size, traced=1)

        return self._device.appended("strokes", kernel, run)

    def _prepare(
        self, view: View, hits: HitBuffer, values: Floats, width: float, quantity: str | None
    ) -> tuple[dict[str, Buffer], Records, dict[str, float]]:
        """Inputs of line_draw for contours: buffers, items to search, and numbers of its record."""
        _check(len(values) <= MOST, f"at most {MOST} contour values are drawn at once, found {len(values)}")
        levels = np.sort(np.asarray(values, dtype=np.float64))
        buffers = self._buffers(view, hits, width)
        buffers |= {"levels": self._device.buffer(levels), "bounds": self._loaded.every(quantity)[1]}
        buffers |= {"hit_depth": self._device.buffer(np.zeros(1))} if hits.flat is not None else {}
        smooth = all(self._is_polynomial(number, quantity) for number in range(len(self._loaded.parts)))
        items = self._find_items(view, hits, buffers, len(levels), smooth)
        if hits.sections is not None and len(levels):
            slivers = _work_items(*self._slivers(view, hits, levels, quantity), items.dtype, whole=2)
            items = np.concatenate([items, slivers])
        return buffers, items, {"half_width": 0.5 * width + 0.5, "levels": len(levels), "offset": hits.offset}

    def mesh(self, view: View, hits: HitBuffer, width: float) -> Marks:
        """Lines along the borders of elements; width in pixels."""
        buffers, half_width = self._buffers(view, hits, width), 0.5 * width + 0.5
        side = hits.owner if hits.side is None else hits.side
        near = np.flatnonzero(_near_others(side.reshape(view.height, view.width), int(np.ceil(half_width))))
        near = near[hits.owner[near] != NOBODY]
        dtype = self._device.kernel("line_border", self._loaded.parts[0]).dtype("items")
        items = _work_items(near, hits.owner[near], dtype)
        feet = FEET_OF_DRAFTS if is_draft() else FEET
        self._run("line_border", view, hits, items, buffers, half_width=half_width, feet=feet)
        return Marks(self._device, buffers["marks"], width, hits.owner)

    def _buffers(self, view: View, hits: HitBuffer, width: float) -> dict[str, Buffer]:
        """Inputs of both kinds of lines from a hit buffer, and empty marks."""
        _check(width <= WIDEST, f"lines are at most {WIDEST:g} pixels wide, found {width:g}")
        return {
            **hits.bindings(self._device, "owner", "normal", *(() if hits.flat is not None else ("depth",))),
            "marks": self._device.buffer(np.full(view.count, NOTHING, np.uint32)),
        }

    def _slivers(self, view: View, hits: HitBuffer, levels: Floats, quantity: str | None) -> tuple[Ints, Records]:
        """Pixels (n,), and elements (n,) whose thin sections may show in their squares but own none of nine around."""
        assert hits.sections is not None
        sections, (ends, _) = hits.sections, self._loaded.every(quantity)
        low, high = ends[sections["element"]].T
        sections = sections[np.searchsorted(levels, low) < np.searchsorted(levels, high, "right")]
        owner = hits.owner.reshape(view.height, view.width)
        sections = sections[_thin(sections, owner, len(ends))]
        sections["least"] -= 1
        sections["most"] += 1
        pixel, element = pairs(within(view, sections), _near_others(owner, 1))
        around = np.pad(owner, 1, constant_values=NOBODY).reshape(-1)
        corner, free = pixel + 2 * (pixel // view.width), np.ones(len(pixel), bool)
        for k in range(9):
            free &= around[corner + (k // 3 * (view.width + 2) + k % 3)] != element
        return pixel[free], element[free]

    def _is_polynomial(self, number: int, quantity: str | None) -> bool:
        """Whether a part's map and quantity are polynomials, which have neither poles nor jumps in an element."""
        return self._loaded.quantity(number, quantity).degree > 0

    def _find_items(
        self, view: View, hits: HitBuffer, buffers: dict[str, Buffer], levels: int, smooth: bool
    ) -> Records:
        """The items that line_find.slang lists."""
        kernel = self._device.kernel("line_find")
        strips = view.width * -(-view.height // ROWS[self._device.adapter.software])
        every = buffers | {
            **hits.bindings(self._device, "side", "field"),
            "view": self._device.buffer(record_of(kernel, "view", view, count=strips, levels=levels, smooth=smooth)),
        }
        return self._device.appended("found", kernel, lambda lists: kernel(strips, {**every, **lists}))

    def _run(
        self,
        stage: str,
        view: View,
        hits: HitBuffer,
        items: Records,
        buffers: dict[str, Buffer],
        quantity: str | None = None,
        **size: float,
    ) -> None:
        """A stage over the items of each part, sorted by element."""
        items = items.take(order_of(items["element"]))
        ends = np.searchsorted(items["element"], self._loaded.first)
        for number in range(len(self._loaded.parts)):
            work = _Work(stage, view, hits, number, quantity, buffers, size)
            own = items[ends[number] : ends[number + 1]]
            if stage == "line_draw":
                own = self._draw_first(work, own)
            self._run_part(work, own)

    def _draw_first(self, work: _Work, own: Records) -> Records:
        """Draws contours in squares that take few cells; returns the items of the rest, which keep others waiting."""
        unsure = np.flatnonzero(own["whole"] != 1)
        if len(unsure) > _SIFTED:
            # most of the squares that several elements have hold no contour
            possible = np.ones(len(own), bool)
            possible[unsure] = self._tell(work, own.take(unsure), _POSSIBLE)
            own = own.take(np.flatnonzero(possible))
        return own.take(np.flatnonzero(self._tell(work, own, _MANY)))

    def _tell(self, work: _Work, own: Records, what: int) -> NDArray[np.uint32]:
        """Results (n,) of line_draw for the items' squares, 1 for yes."""
        count = len(own)
        work.buffers["told"] = self._device.empty(np.uint32, count)
        self._run_part(replace(work, size={**work.size, "telling": what}), own)
        return self._device.read(work.buffers["told"], np.uint32, count)

    def _run_part(self, work: _Work, own: Records) -> None:
        """A stage over items of a part."""
        count = len(own)
        if not count:
            return
        number, hits = work.number, work.hits
        kernel = self._device.kernel(work.stage, self._loaded.parts[number], work.quantity)
        facets, packed = self.facets(number), "reference" not in hits.held
        facts = {
            "first": self._loaded.first[number],
            "count": count,
            "facets": len(facets),
            "packed": packed,
            "flat": hits.flat is not None,
            "smooth": self._is_polynomial(number, work.quantity),
        }
        data = {
            "items": own,
            "facets": facets,
            "view": record_of(kernel, "view", work.view, **facts, **work.size),
        }
        brought = {name: self._device.buffer(some) for name, some in data.items()}
        brought["references"] = self._device.buffer(hits.reference[own["base"]]) if packed else hits.held["reference"]
        kernel(count, {**self._loaded.bindings(number, work.quantity), **work.buffers, **brought})

    def facets(self, number: int) -> Floats:
        """(k, 4) facets of a part's reference shape, found once: the margin is the minimum of a x + b y + c z + d."""
        return self._loaded.once(("facets", number), lambda: self._find_facets(number))

    def _find_facets(self, number: int) -> Floats:
        """The same, as line_shape.slang finds them."""
        kernel = self._device.kernel("line_shape", self._loaded.parts[number])
        directions, facets = _sphere(_DIRECTIONS), self._device.empty(kernel.dtype("facets"), _DIRECTIONS)
        buffers = {"directions": self._device.buffer(directions), "facets": facets}
        kernel(len(directions), {**self._loaded.buffers[number], **buffers})
        rows = self._device.read(facets, np.float64).reshape(-1, 4)
        rows = rows[np.abs(rows[:, :3]).max(axis=1) > 0.0]
        return np.asarray(rows[np.unique(np.round(rows, 9), axis=0, return_index=True)[1]])


def _work_items(pixel: Ints, element: Records, dtype: np.dtype[Any], whole: int = 0) -> Records:
    """(n,) WorkItem records of line.slang: elements hit at pixels, to be searched around these."""
    items = np.zeros(len(pixel), dtype)
    items["pixel"] = items["base"] = pixel
    items["element"] = element
    items["whole"] = whole
    return items


def _check(holds: bool, otherwise: str) -> None:
    if not holds:
        raise SceneError(otherwise)


def _near_others(owner: NDArray[np.uint32], steps: int) -> Bools:
    """(h, w) pixels with another owner within n columns and rows."""
    near = np.zeros(owner.shape, bool)
    everything, earlier, later = slice(None), slice(None, -1), slice(1, None)
    for rows, columns in (
        ((everything, everything), (earlier, later)),
        ((earlier, later), (everything, everything)),
        ((earlier, later), (earlier, later)),
        ((earlier, later), (later, earlier)),
    ):
        differ = owner[rows[0], columns[0]] != owner[rows[1], columns[1]]
        near[rows[0], columns[0]] |= differ
        near[rows[1], columns[1]] |= differ
    for _ in range(steps - 1):
        near = beside(near)
    return near


def _thin(sections: Records, owner: NDArray[np.uint32], elements: int) -> Bools:
    """(n,) sections with few pixels for how long they are; their pixels are counted in every fourth row."""
    sides = sections["most"] - sections["least"] + 1
    length = np.maximum(sides[:, :2].max(axis=1), sides[:, 2:].max(axis=1) / np.sqrt(2))
    counts = np.bincount(np.minimum(owner[::4].reshape(-1), elements), minlength=elements)
    return np.asarray(4 * counts[sections["element"]] < 0.15 * np.maximum(length, 8.0) ** 2)


def _sphere(count: int) -> Floats:
    """(count, 3) directions spread evenly: a spiral of golden angles."""
    k = np.arange(count) + 0.5
    height, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - height**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
