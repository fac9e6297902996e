"""Proofs about the contours in each pixel's square: that a value is taken there, or that it is not.

Each square is tested with every element that may lie in it, by bounds of the element's derivatives; see
`elvis.renderer.passes.lines.contours.squares`.
"""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, rows_by_number
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.bernstein import BernsteinSpace
from elvis.core.shapes import Shape
from elvis.renderer.passes.lines.contours.cuts import CutChart
from elvis.renderer.passes.lines.contours.faces import FaceContours
from elvis.renderer.passes.lines.contours.pyramids import PyramidChart
from elvis.renderer.passes.lines.contours.squares import AT_ONCE, Items, Squares, facet_distances
from elvis.renderer.raster.gaps import beside, pairs, within
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View
from elvis.scene.record.frame import Status

if TYPE_CHECKING:
    from elvis.renderer.passes.lines.lines import Lines

#: squares looked at at once
_SQUARES = AT_ONCE // 16


class ContourProof:
    """The proofs of one hit buffer's contours.

    status  (n,) of frame.Status by pixel: CERTAIN if every level is proved to be taken in the square or not to be, else
            AMBIGUOUS; MISS without a hit
    taken   (n,) whether one of the levels is proved to be taken there
    is_single  (n,) whether there is one line of each level in each element: two may be closer than is drawn
    """

    def coverage(self, width: float) -> NDArray[np.uint8]:
        """Status (n,) of the coverage of each pixel by lines of a width in pixels, from all squares near enough."""
        is_open = (self.status == Status.AMBIGUOUS) | ~self.is_single
        near = is_open.reshape(self._view.height, self._view.width)
        for _ in range(int(np.ceil(0.5 * width))):
            near = beside(near)
        is_doubtful = near.reshape(-1) & (self.status != Status.MISS)
        return np.where(is_doubtful, np.uint8(Status.AMBIGUOUS), self.status)

    def __init__(
        self,
        loaded: DeviceVolume,
        lines: Lines,
        view: View,
        hits: HitBuffer,
        levels: Floats,
        quantity: str | None = None,
    ) -> None:
        self._loaded = loaded
        self._lines = lines
        self._view = view
        self._hits = hits
        self._levels = levels
        self._quantity = quantity
        self._charts: dict[int, CutChart] = {}
        is_hit = hits.owner != NOBODY
        self.taken = np.zeros(view.count, bool)
        self.is_single = np.ones(view.count, bool)
        self.status = np.where(is_hit, np.uint8(Status.CERTAIN), np.uint8(Status.MISS))

        # by element, whether it may have one of the values
        low, high = loaded.every(quantity)[0].astype(np.float64).T
        self._holds = ~(np.searchsorted(levels, low) >= np.searchsorted(levels, high, "right"))
        self._holds |= np.isnan(low) | np.isnan(high)
        self._decide()
        if hits.clear is not None:
            self._doubt_beside_clips(hits.clear)
        self.status[~is_hit] = Status.MISS

    def _decide(self) -> None:
        """Set the statuses of all pixels in whose squares an element that may have one of the values may be."""
        hits = self._hits
        shape = (self._view.height, self._view.width)
        is_hit = hits.owner != NOBODY
        if hits.near_squares is not None:
            faces = FaceContours(self._loaded, self._view, hits, self._levels, self._quantity)
            self.status[faces.is_open] = Status.AMBIGUOUS
            self.taken |= faces.taken
            return
        if hits.sections is None or hits.flat is None:
            owner = np.minimum(hits.owner, len(self._holds))
            holds = np.append(self._holds, False)[owner]
            near = beside(holds.reshape(shape)).reshape(-1)
            self.status[near & is_hit] = Status.AMBIGUOUS
            return

        # the owners of pixels first, then the other elements in squares that these don't fill
        pixel = np.flatnonzero(is_hit)
        owners = Items(pixel, hits.owner[pixel].astype(np.int64), hits.reference[pixel])
        is_alone = self._decide_items(owners)
        is_shared = np.zeros(self._view.count, bool)
        is_shared[pixel[~is_alone]] = True
        self._decide_items(self._others(is_shared.reshape(shape)))

    def _doubt_beside_clips(self, clear: Floats) -> None:
        """Leave squares open in which clips may remove the part that takes a level."""
        pixel = np.flatnonzero(self.taken)
        if not len(pixel):
            return
        chart = next(iter(self._charts.values()))
        column, line = self._view.places(pixel)
        middle, _ = chart.targets(column, line)
        reach = np.zeros(len(pixel))
        for x, y in product((-0.5, 0.5), repeat=2):
            corner, _ = chart.targets(np.add(column, x, dtype=np.float64), np.add(line, y, dtype=np.float64))
            reach = np.maximum(reach, np.linalg.norm(corner - middle, axis=1))
        beside_clip = pixel[~(1.001 * reach < clear[pixel])]
        self.taken[beside_clip] = False
        self.status[beside_clip] = Status.AMBIGUOUS

    def _others(self, mask: Bools) -> Items:
        """The elements, other than the own ones, that may be in the squares of the pixels of a mask (h, w)."""
        assert self._hits.sections is not None
        holds = self._holds[self._hits.sections["element"]]
        sections = self._hits.sections[holds].copy()

        # squares reach half a pixel beyond the centres that sections bound
        sections["least"] -= 1
        sections["most"] += 1
        pixel, element = pairs(within(self._view, sections), mask)
        is_other = self._hits.owner[pixel] != element
        pixel = pixel[is_other]
        element = element[is_other].astype(np.int64)
        return Items(pixel, element, np.full((len(pixel), 3), np.nan))

    def _decide_items(self, items: Items) -> Bools:
        """Statuses of the pixels of some items; (n,) whether each square lies in its element all over."""
        is_alone = np.zeros(len(items.pixel), bool)
        number = np.searchsorted(self._loaded.first, items.element, side="right") - 1
        for part, rows in rows_by_number(number):
            if not self._is_known(part):
                holds = self._holds[items.element[rows]]
                self.status[items.pixel[rows[holds]]] = Status.AMBIGUOUS
                continue

            elements = np.unique(items.element[rows])
            chart = self._chart(part)
            bounds = chart.bounds(elements)
            for some in chunks(len(rows), _SQUARES):
                chosen = items.part(rows[some])
                own_bounds = bounds.part(np.searchsorted(elements, chosen.element))
                column, line = self._view.places(chosen.pixel)
                squares = Squares(chart, column.astype(float), line.astype(float), chosen, own_bounds)
                is_alone[rows[some]] = squares.is_inside
                self._decide_squares(squares, chosen)
        return is_alone

    def _decide_squares(self, squares: Squares, items: Items) -> None:
        """Statuses of the pixels of some items with their squares."""
        is_due = self._holds[items.element] & ~squares.is_outside
        squares.decide(self._levels)
        is_taken = is_due & squares.takes(self._levels)
        self.taken[items.pixel[is_taken]] = True
        self.is_single[items.pixel[is_taken & ~squares.is_monotone]] = False
        self.status[items.pixel[is_due & squares.in_doubt(self._levels)]] = Status.AMBIGUOUS

    def _is_known(self, number: int) -> bool:
        """Whether the map of a part is a polynomial in coordinates from -1 to 1, and its slopes are known."""
        part = self._loaded.parts[number]
        own = self._loaded.quantity(number, self._quantity)
        return (own.degree > 0 or own.slopes is not None) and not part.unit

    def _space(self, number: int) -> BernsteinSpace:
        """The polynomials of a part's map and field: on the cube, where they are not on the shape itself."""
        part = self._loaded.parts[number]
        own = self._loaded.quantity(number, self._quantity)
        degree = own.degree if own.slopes is None else own.slopes.map_degree
        facets = np.zeros((0, 4)) if part.affine else self._lines.facets(number)
        for shape, degrees in ((Shape.TETRAHEDRON, (degree,)), (Shape.PRISM, (degree, degree))):
            margins = facet_distances(facets, shape.vertices)
            if len(facets) == len(shape.faces) and np.abs(margins.min(axis=1)).max() < 1e-9:
                return BernsteinSpace(shape, degrees)
        return BernsteinSpace(Shape.HEXAHEDRON, (degree,) * 3)

    def _chart(self, number: int) -> CutChart:
        """The plane in a part's elements."""
        if number not in self._charts:
            kind = PyramidChart if self._loaded.parts[number].collapsed else CutChart
            space = self._space(number)
            self._charts[number] = kind(
                self._loaded, number, self._quantity, self._lines, self._view, self._hits, space
            )
        return self._charts[number]
