"""Proofs about contours on faces, in each pixel's square: with every patch of a face that may lie in it.

A patch that covers a square, and is nearer than another one everywhere in it, hides the other.  If several remain, such
as on both sides of an edge, a level counts as taken on a patch only where the others are certainly absent: beyond a
facet of each.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.renderer.passes.faces.faces import SquarePatches, pixels_near
from elvis.renderer.passes.lines.contours.patches import PatchBounds, PatchChart
from elvis.renderer.passes.lines.contours.squares import AT_ONCE, Items, Squares, any_between
from elvis.renderer.raster.gaps import pairs, within
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View

if TYPE_CHECKING:
    from elvis.renderer.raster.hit_buffer import HitBuffer

#: squares looked at, at once
_SQUARES = AT_ONCE // 16
#: pixels from an edge up to which it may reach into a square
_CORNER = 0.75
#: maximum number of patches in a square that is examined, and of patches that may hide one with a level
_MOST, _OTHERS = 24, 7
#: part of the scene's size within which depths are one
_TIE = 1e-10
#: the centre and the corners of a square
_POINTS = np.array([(0.0, 0.0), *product((-0.5, 0.5), repeat=2)])


@dataclass(frozen=True, eq=False)
class _Block:
    """Patches of one part and shape."""

    view: View
    chart: PatchChart
    bounds: PatchBounds

    def pairs(self, chosen: Bools, mask: Bools) -> tuple[Ints, Ints]:
        """Pixels of a mask (h, w) whose squares the chosen patches (n,) may reach into, and the numbers of these."""
        sections = self.chart.records[chosen].copy()
        sections["element"] = np.flatnonzero(chosen)
        pixel, number = pairs(within(self.view, sections), mask)
        return pixel, number.astype(np.int64)


@dataclass(frozen=True, eq=False)
class _Pieces:
    """State of n patches in n squares, patches of one square together.

    pixel     (n,)
    is_there  (n,) whether they may be in the square
    is_known  (n,) whether the following values are valid
    is_whole  (n,) whether they cover it
    margins   (n, 4, 3) to facets: a x + b y + c for positions (x, y) from the square's centre, minus at most ``bulge``
    bulge     (n,)
    depth     (2, n) minimum and maximum in the square
    """

    pixel: Ints
    is_there: Bools
    is_known: Bools
    is_whole: Bools
    margins: Floats
    bulge: Floats
    depth: Floats


class FaceContours:
    """The proofs of the nearest hits on faces.

    is_open  (n,) pixels in which a level is proved neither to be taken nor not to be
    taken    (n,) whether one of the levels is proved to be taken there
    """

    def __init__(self, loaded: DeviceVolume, view: View, hits: HitBuffer, levels: Floats, quantity: str | None) -> None:
        assert hits.near_squares is not None
        self._view = view
        self._levels = levels
        self._tie = _TIE * (loaded.extent + float(np.abs(view.camera.eye).max()))
        self.is_open = np.zeros(view.count, bool)
        self.taken = np.zeros(view.count, bool)
        every = list(hits.near_squares())
        self._blocks = [self._block(loaded, quantity, patches) for patches in every if len(patches.records)]

        # squares that patches with one of the levels may reach into
        due = np.zeros(view.count, bool)
        is_hit = np.asarray(hits.owner != NOBODY).reshape(view.height, view.width)
        for block in self._blocks:
            pixel, _ = block.pairs(any_between(levels, *block.bounds.values), is_hit)
            due[pixel] = True

        # where edges and folds may be in the squares, and how deep
        self._edges = np.full((2, view.count), [[np.inf], [-np.inf]])
        for patches in every:
            for edge, pixel in pixels_near(view, patches.edges, _CORNER):
                near, far = patches.edges.depth[:, edge]
                np.minimum.at(self._edges[0], pixel, near)
                np.maximum.at(self._edges[1], pixel, far)
        self._decide(due)

    def _block(self, loaded: DeviceVolume, quantity: str | None, patches: SquarePatches) -> _Block:
        chart = PatchChart(loaded, quantity, self._view, patches)
        return _Block(self._view, chart, chart.bounds())

    def _decide(self, due: Bools) -> None:
        """Decide pixels (n,), some at a time with all their patches."""
        mask = due.reshape(self._view.height, self._view.width)
        found = [block.pairs(np.ones(len(block.chart.records), bool), mask) for block in self._blocks]
        edges = np.flatnonzero(due & np.isfinite(self._edges[0]))
        found.append((edges, edges))
        pixel = np.concatenate([pixel for pixel, _ in found])
        number = np.concatenate([number for _, number in found])
        block = np.repeat(np.arange(len(found)), [len(pixel) for pixel, _ in found])

        # squares with too many patches remain open
        counts = np.bincount(pixel, minlength=self._view.count)
        self.is_open |= counts > _MOST
        is_left = counts[pixel] <= _MOST
        pixel, number, block = pixel[is_left], number[is_left], block[is_left]

        order = np.argsort(pixel, kind="stable")
        pixel, number, block = pixel[order], number[order], block[order]
        starts = np.flatnonzero(np.diff(pixel, prepend=-1))
        cuts = starts[np.searchsorted(starts, np.arange(0, len(pixel), _SQUARES))[1:] - 1] if len(pixel) else starts
        for some in np.split(np.arange(len(pixel)), np.unique(cuts)):
            if len(some):
                self._decide_some(pixel[some], block[some], number[some])

    def _decide_some(self, pixel: Ints, block: Ints, number: Ints) -> None:
        """The same, of patches by block and number in the squares of pixels, all of a pixel together."""
        squares = []
        rows = [np.flatnonzero(block == own) for own in range(len(self._blocks))]
        for own, some in zip(self._blocks, rows, strict=True):
            column, line = self._view.places(pixel[some])
            start = np.full((len(some), 2), np.nan)
            items = Items(pixel[some], number[some], start)
            bounds = own.bounds.derivatives.part(number[some])
            with np.errstate(all="ignore"):
                squares.append(Squares(own.chart, column.astype(float), line.astype(float), items, bounds))

        pieces = self._pieces(pixel, number, rows, squares)
        is_edge = block == len(self._blocks)
        pieces.depth[:, is_edge] = self._edges[:, number[is_edge]]
        others = _others(pixel)
        is_left = pieces.is_there & ~_hidden(pieces, self._tie)
        walls = _walls(pieces, others, is_left, self._tie)
        nowhere = np.array([[np.inf], [-np.inf]])
        self.is_open[pixel[is_left & is_edge]] = True
        doubtful = np.tile(nowhere, (2, 1, len(pixel)))
        certain = np.tile(nowhere, (1, len(pixel)))
        for own, some, found in zip(self._blocks, rows, squares, strict=True):
            limits = np.where(is_left[some], own.bounds.values[:, number[some]], nowhere)
            with np.errstate(all="ignore"):
                found.decide(self._levels, walls[some], limits)
            doubtful[:, :, some] = found.doubtful
            certain[:, some] = found.certain
            self.taken[pixel[some[found.takes(self._levels)]]] = True
        for below, above in doubtful:
            self.is_open[pixel[self._in_doubt(below, above, certain, others)]] = True

    def _pieces(self, pixel: Ints, number: Ints, rows: list[Ints], squares: list[Squares]) -> _Pieces:
        """State of patches in squares (n,), from the squares of each block in its rows."""
        count = len(pixel)
        pieces = _Pieces(
            pixel,
            np.ones(count, bool),
            np.zeros(count, bool),
            np.zeros(count, bool),
            np.tile([0.0, 0.0, 1e9], (count, 4, 1)),
            np.zeros(count),
            np.full((2, count), [[-np.inf], [np.inf]]),
        )
        for own, some, found in zip(self._blocks, rows, squares, strict=True):
            margins = found.margins
            facets = margins.shape[1]
            bulge = found.bulge
            pieces.is_known[some] = found.is_good
            pieces.is_whole[some] = found.is_inside
            pieces.margins[some[:, None], np.arange(facets)] = margins
            pieces.bulge[some] = bulge

            # of squares in which all four corners are beyond one facet nothing is left
            corners = margins[:, :, :2] @ _POINTS.T + margins[:, :, 2:]
            is_beyond = (corners.max(axis=2) < -bulge[:, None]).any(axis=1)
            pieces.is_there[some] = ~(found.is_good & is_beyond)
            change = own.bounds.deepening[number[some]] * found.radius
            at_centre = own.chart.depth(found)
            depth = np.stack([at_centre - change, at_centre + change])
            on_patch = np.stack([own.chart.records["near"][number[some]], np.full(len(some), np.inf)])
            pieces.depth[:, some] = np.where(found.is_good & np.isfinite(depth).all(axis=0), depth, on_patch)
        return pieces

    def _in_doubt(self, low: Floats, high: Floats, certain: Floats, others: Ints) -> Bools:
        """(n,) whether a level in a range is proved to be taken on no other patch (n, m) of the square."""
        levels = self._levels
        first = np.searchsorted(levels, low)
        last = np.searchsorted(levels, high, "right") - 1
        in_doubt = first <= last
        padded = np.append(levels, np.inf)
        for other in others.T:
            least, most = certain[:, other]
            is_taken = (other >= 0) & (least <= padded[first]) & (padded[np.maximum(last, 0)] <= most)
            in_doubt &= ~is_taken
        return np.asarray(in_doubt)


def _others(pixel: Ints) -> Ints:
    """The other patches (n, m) in the same square, -1 for absent ones; pixels (n,) ascend."""
    count = len(pixel)
    starts = np.flatnonzero(np.diff(pixel, prepend=-1))
    lengths = np.diff(np.append(starts, count))
    start = np.repeat(starts, lengths)
    length = np.repeat(lengths, lengths)
    steps = np.arange(1, max(int(lengths.max(initial=1)), 2))
    turned = (np.arange(count) - start)[:, None] + steps
    found = start[:, None] + turned % length[:, None]
    return np.where(steps < length[:, None], found, -1)


def _hidden(pieces: _Pieces, tie: float) -> Bools:
    """(n,) patches behind one that covers the square."""
    starts = np.flatnonzero(np.diff(pieces.pixel, prepend=-1))
    covers = pieces.is_known & pieces.is_whole
    farthest = np.where(covers, pieces.depth[1], np.inf)
    nearest = np.minimum.reduceat(farthest, starts)
    lengths = np.diff(np.append(starts, len(farthest)))
    return np.asarray(pieces.depth[0] > np.repeat(nearest, lengths) + tie)


def _walls(pieces: _Pieces, others: Ints, is_left: Bools, tie: float) -> Floats:
    """(n, m, 3) beyond which facets of the others patches are certainly seen (see Squares.decide)."""
    count, most = others.shape
    none, all_over = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])
    walls = np.tile(all_over, (count, min(most, _OTHERS), 1))
    is_left_beside = (others >= 0) & is_left[others]

    # patches that may lie in front, up to the maximum number
    is_before = is_left_beside & ~(pieces.depth[0][others] > pieces.depth[1][:, None] + tie)
    order = np.argsort(~is_before, axis=1, kind="stable")[:, : walls.shape[1]]
    walls[is_before.sum(axis=1) > _OTHERS] = none
    every = np.arange(count)
    for k in range(walls.shape[1]):
        other = others[every, order[:, k]]
        is_meant = is_before[every, order[:, k]]
        own_wall = np.where(pieces.is_known[other][:, None], _wall(pieces, other), none)
        walls[is_meant, k] = own_wall[is_meant]
    return walls


def _wall(pieces: _Pieces, other: Ints) -> Floats:
    """(n, 3) the facet of other patches (n,) that is farthest before what of n patches is in the square."""
    own = pieces.margins[:, :, :2] @ _POINTS.T + pieces.margins[:, :, 2:]
    is_inside = (own > 0.0).all(axis=1)
    weight = is_inside / np.maximum(is_inside.sum(axis=1), 1)[:, None]
    margins = pieces.margins[other]
    there = margins[:, :, :2] @ _POINTS.T + margins[:, :, 2:]
    steepness = np.hypot(margins[..., 0], margins[..., 1])
    length = np.where(steepness > 0.0, steepness, 1.0)
    mean = np.einsum("nkp,np->nk", there, weight) / length
    chosen = np.argmin(mean, axis=1)
    wall: Floats = margins[np.arange(len(other)), chosen].copy()
    wall[:, 2] += pieces.bulge[other]
    return wall
