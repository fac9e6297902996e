"""The surface that counts at each pixel of a picture, among all that are drawn there."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.renderer.frame.draw_calls import DrawCall
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.raster.pixels import NOBODY
from elvis.scene.cameras.view import View
from elvis.scene.record.conditioning import uncertainties
from elvis.scene.record.frame import Status

#: part of a depth within which it is asked whether either of two hits may be the nearer one
NEAR = 2e-8
Drawn: TypeAlias = list[tuple[DrawCall, HitBuffer]]


def record_of(drawn: Drawn, view: View, extent: float, *, whole: bool = True) -> HitBuffer:
    """The surface that counts at each pixel: of the most opaque ones the nearest; failed searches anywhere show.

    extent  the largest coordinate of the data, in magnitude
    whole   whether to include reference coordinates, normals and uncertainties
    Pixels are ambiguous if another surface may be nearer or may have been overlooked.
    The undeformed geometry does not count.
    """
    drawn = [(call, call.in_world(hits)) for call, hits in drawn if call.ghost is None]
    if len(drawn) == 1:
        call, only = drawn[0]
        return only if call.copy is None else only.of_copies(np.where(only.owner == NOBODY, -1, call.copy.number))
    best, opacity, source = _nearest(drawn, view.count, whole)
    failed = np.zeros(view.count, bool)
    for draw_call, hits in drawn:
        failed |= hits.status == Status.FAILED
        counts = draw_call.style.opacity >= opacity
        best.status[_may_be_overlooked(hits, best, counts, draw_call.style.opacity > opacity)] = Status.AMBIGUOUS
        pixel = np.flatnonzero(_beside(hits, best) & counts)
        around = _uncertain(hits, view, pixel, extent)
        for other in np.unique(source[pixel]):
            here = source[pixel] == other
            around[here] += _uncertain(drawn[other][1], view, pixel[here], extent)
        close = np.abs(hits.depth[pixel] - best.depth[pixel]) <= around
        best.status[pixel[close]] = Status.AMBIGUOUS
    best.status[failed] = Status.FAILED
    if any(call.copy for call, _ in drawn):
        numbers = [-1 if call.copy is None else call.copy.number for call, _ in drawn]
        best.copies = np.array([*numbers, -1])[source]
    return best


def _nearest(drawn: Drawn, count: int, whole: bool) -> tuple[HitBuffer, Floats, Ints]:
    """The nearest hits of the most opaque surfaces, their opacities (n,), and the numbers (n,) of their surfaces.

    The number is -1 without a hit.
    """
    best, opacity = HitBuffer.empty(count), np.zeros(count)
    best.uncertainty = np.full(count, np.nan)
    source = np.full(count, -1)
    for number, (draw_call, hits) in enumerate(drawn):
        nearer = (draw_call.style.opacity == opacity) & (hits.depth < best.depth)
        better = np.flatnonzero((hits.owner != NOBODY) & (nearer | (draw_call.style.opacity > opacity)))
        opacity[better], source[better] = draw_call.style.opacity, number
        for name in ("owner", "field", "depth", "status", *(("reference", "normal") if whole else ())):
            getattr(best, name)[better] = getattr(hits, name)[better]
        best.uncertainty[better] = np.nan if hits.uncertainty is None else hits.uncertainty[better]
    return best, opacity, source


def _may_be_overlooked(hits: HitBuffer, best: HitBuffer, counts: Bools, more: Bools) -> Bools:
    """Flags (n,) whether a hit buffer may have missed a hit that would replace the best hits.

    counts, more  (n,) whether it is at least as opaque as these, and whether it is more opaque
    """
    missing = (hits.status == Status.AMBIGUOUS) & (hits.owner == NOBODY)
    doubt = np.where(missing, 0.0, np.inf) if hits.doubt is None else hits.doubt
    before = (best.owner == NOBODY) | more | counts & (doubt <= best.depth)
    return np.asarray(np.isfinite(doubt) & before)


def _beside(hits: HitBuffer, best: HitBuffer) -> Bools:
    """(n,) where a hit buffer's hit may be nearer than the best one; at the same depth the first object's counts."""
    with np.errstate(invalid="ignore"):
        apart = np.abs(hits.depth - best.depth)
    return np.asarray((apart > 0.0) & (apart <= NEAR * best.depth) & (hits.owner != NOBODY))


def _uncertain(hits: HitBuffer, view: View, pixel: Ints, extent: float) -> Floats:
    """Uncertainties (k,) of hits in pixels (k,); for analytic surfaces they follow from their normals.

    If they are infinite, there is also a doubt, which begins before the hit.
    """
    depth = hits.depth[pixel]
    known = np.full(len(pixel), np.nan) if hits.uncertainty is None else hits.uncertainty[pixel]
    rounded = uncertainties(view, pixel, depth, hits.normal[pixel], extent)
    return np.where(np.isnan(known), rounded, np.nan_to_num(known, posinf=0.0))
