"""Contour lines and mesh lines on any layer: how much of each pixel they cover (stages: shaders/line_*.slang).

A line's coverage of a pixel follows from the distance, in pixels, of the pixel's centre from the middle of the line.
Contours are found in the square of every pixel, from the polynomials of each element that shows there and within that
element's own border; mesh lines are where the facets of an element's reference shape meet the surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Bools, Floats, Ints
from elvis.renderer.device import ROWS, Kernel
from elvis.renderer.errors import SceneError
from elvis.renderer.gaps import beside
from elvis.renderer.layer import Layer
from elvis.renderer.loaded import Loaded
from elvis.renderer.pixels import NOBODY
from elvis.renderer.view import View

if TYPE_CHECKING:
    import slangpy

#: most contour values, and greatest width in pixels, that a mark of line_draw.slang holds
MOST, WIDEST = 1024, 100.0
#: units of its distances
UNITS = 1 << 16
NOTHING = 0xFFFFFFFF
#: distance from a facet, in reference units, within which a hit lies on it
ON_FACE = 1e-9
#: hits that tell whether a layer consists of faces
_SAMPLES = 512
#: an element to be searched around a pixel, as in shaders/line.slang
PIECE = np.dtype([("pixel", np.uint32), ("base", np.uint32), ("whole", np.uint32)])
#: lines from the centre of a reference shape that look for its facets
_DIRECTIONS = 512


@dataclass(frozen=True, eq=False)
class Drawn:
    """Contour lines by pixel.

    coverage  (n,) part of the pixel that the nearest line covers
    number    (n,) of that line's value, among the values in ascending order; -1 where none is near
    """

    coverage: Floats
    number: Ints


class Lines:
    """A loaded volume, ready for lines on layers of it."""

    def __init__(self, loaded: Loaded) -> None:
        self._loaded, self._device = loaded, loaded.device
        self._facets: dict[int, Floats] = {}

    def contours(self, view: View, layer: Layer, values: Floats, width: float, quantity: str | None = None) -> Drawn:
        """Lines where a layer's field has one of the values (k,), which ascend.

        width     in pixels
        quantity  of the parts, whose values are the layer's field; None is the parts' own field
        """
        _check(len(values) <= MOST, f"at most {MOST} contour values are drawn at once, found {len(values)}")
        _check(width <= WIDEST, f"lines are at most {WIDEST:g} pixels wide, found {width:g}")
        levels = np.sort(np.asarray(values, dtype=np.float64))
        buffers = {
            "levels": self._device.buffer(levels),
            "owner": self._device.buffer(layer.owner),
            "depth": self._device.buffer(layer.depth),
            "nearest": self._device.buffer(np.full(view.count, NOTHING, np.uint32)),
        }
        pieces = self._found(view, layer, buffers, len(levels))
        size = {"reach": 0.5 * width + 0.5, "levels": len(levels)}
        self._run("line_draw", view, layer, pieces, buffers, quantity, **size)
        marks = self._device.read(buffers["nearest"], np.uint32)
        near = np.flatnonzero(marks != NOTHING)
        coverage, lines = np.zeros(view.count), np.full(view.count, -1)
        coverage[near] = covered((marks[near] >> 10) / UNITS, width)
        lines[near] = marks[near] & (MOST - 1)
        return Drawn(coverage, lines)

    def mesh(self, view: View, layer: Layer, width: float) -> Floats:
        """(n,) part of each pixel that lines along the borders of elements cover; width in pixels."""
        _check(width <= WIDEST, f"lines are at most {WIDEST:g} pixels wide, found {width:g}")
        reach = 0.5 * width + 0.5
        near = np.flatnonzero(_near_others(self._sides(layer).reshape(view.height, view.width), int(np.ceil(reach))))
        near = near[layer.owner[near] != NOBODY]
        pieces = np.zeros(len(near), PIECE)
        pieces["pixel"] = pieces["base"] = near
        buffers = {"owner": self._device.buffer(layer.owner), "distances": self._device.empty(np.float64, len(near))}
        self._run("line_border", view, layer, pieces, buffers, reach=reach)
        coverage = np.zeros(view.count)
        coverage[near] = covered(self._device.read(buffers["distances"], np.float64)[: len(near)], width)
        return coverage

    def _found(self, view: View, layer: Layer, buffers: dict[str, slangpy.Buffer], levels: int) -> NDArray[Any]:
        """The pieces that line_find.slang lists."""
        kernel = self._device.kernel("line_find", self._loaded.parts[0])
        strips = view.width * -(-view.height // ROWS[self._device.adapter.software])
        sight = self._sight(kernel, view, count=strips, levels=levels)
        sides, field = self._sides(layer), self._device.buffer(layer.field)
        side = buffers["owner"] if sides is layer.owner else self._device.buffer(sides)
        every = {**self._loaded.buffers[0], **buffers, "field": field, "side": side, "view": sight}
        return self._device.listed("found", kernel, lambda lists: kernel(strips, {**every, **lists}))

    def _run(
        self,
        stage: str,
        view: View,
        layer: Layer,
        pieces: NDArray[Any],
        buffers: dict[str, slangpy.Buffer],
        quantity: str | None = None,
        **size: float,
    ) -> None:
        """A stage over pieces, once for each part."""
        if not len(pieces):
            return
        base = pieces["base"]
        hits = {"pieces": pieces, "references": layer.reference[base], "normals": layer.normal[base]}
        shared = {**buffers, **{name: self._device.buffer(data) for name, data in hits.items()}}
        for number, part in enumerate(self._loaded.parts):
            kernel, facets = self._device.kernel(stage, part, quantity), self.facets(number)
            place = {"first": self._loaded.first[number], "elements": len(part), "facets": len(facets)}
            own = {
                "facets": self._device.buffer(facets),
                "view": self._sight(kernel, view, count=len(pieces), **place, **size),
            }
            kernel(len(pieces), {**self._loaded.bound(number, quantity), **shared, **own})

    def _sight(self, kernel: Kernel, view: View, **rest: float) -> slangpy.Buffer:
        """The Sight record of the stages (shaders/line.slang)."""
        record = np.zeros(1, kernel.dtype("view"))
        record["eye"], record["ahead"] = view.camera.eye, view.camera.basis()[2]
        record["corner"], record["column"], record["row"] = view.corner, view.column, view.row
        record["perspective"], record["width"], record["height"] = view.perspective, view.width, view.height
        for name, value in rest.items():
            record[name] = value
        return self._device.buffer(record)

    def _sides(self, layer: Layer) -> NDArray[np.uint32]:
        """(n,) numbers that tell elements apart, and the faces of each where the layer consists of faces."""
        hit = np.flatnonzero(layer.owner != NOBODY)
        if not self._faces(layer, hit[:: len(hit) // _SAMPLES + 1]).any():
            return layer.owner
        sides = layer.owner.copy()
        sides[hit] = 32 * sides[hit] + self._faces(layer, hit)
        return sides

    def _faces(self, layer: Layer, pixels: Ints) -> NDArray[np.uint32]:
        """(m,) the facet of its element on which the hit of a pixel lies, from 1; 0 where it lies inside."""
        part = np.searchsorted(self._loaded.first, layer.owner[pixels], side="right") - 1
        found = np.zeros(len(pixels), np.uint32)
        for number in np.unique(part):
            here, facets = np.flatnonzero(part == number), self.facets(int(number))
            margins = np.abs(layer.reference[pixels[here]] @ facets[:, :3].T + facets[:, 3])
            found[here] = np.where(margins.min(axis=1) < ON_FACE, margins.argmin(axis=1) + 1, 0)
        return found

    def facets(self, number: int) -> Floats:
        """(k, 4) facets of a part's reference shape, found once: the margin is the least of a x + b y + c z + d."""
        if number not in self._facets:
            kernel = self._device.kernel("line_shape", self._loaded.parts[number])
            directions, facets = _sphere(_DIRECTIONS), self._device.empty(kernel.dtype("facets"), _DIRECTIONS)
            buffers = {"directions": self._device.buffer(directions), "facets": facets}
            kernel(len(directions), {**self._loaded.buffers[number], **buffers})
            rows = self._device.read(facets, np.float64).reshape(-1, 4)
            rows = rows[np.abs(rows[:, :3]).max(axis=1) > 0.0]
            self._facets[number] = rows[np.unique(np.round(rows, 9), axis=0, return_index=True)[1]]
        return self._facets[number]


def covered(distance: Floats, width: float) -> Floats:
    """Part (n,) of a pixel that a line covers whose middle is this far from the pixel's centre; both in pixels."""
    return np.clip(0.5 * width + 0.5 - distance, 0.0, min(1.0, width))


def levels(low: float, high: float, count: int) -> Floats:
    """(count,) contour values that part the range from ``low`` to ``high`` evenly, none at its ends."""
    return np.linspace(low, high, count + 2)[1:-1]


def _check(holds: bool, otherwise: str) -> None:
    if not holds:
        raise SceneError(otherwise)


def _near_others(owner: NDArray[np.uint32], steps: int) -> Bools:
    """(h, w) pixels with another owner within so many columns and rows."""
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


def _sphere(count: int) -> Floats:
    """(count, 3) directions spread evenly: a spiral of golden angles."""
    k = np.arange(count) + 0.5
    height, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - height**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
