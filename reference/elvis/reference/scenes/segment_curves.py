"""Reference coordinates along the segments of rays, as polynomials of the depth that are near enough to start from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.patch import Patch
from elvis.reference.scenes.segments import Segments, followed, places, points_of
from elvis.reference.solids import margins_of
from elvis.scene.cameras.view import View

#: segments are longer than those through elements by this part, and by this part of the scene's size
_LONGER, _BEYOND = 1e-3, 1e-9
#: maximum deviation of a segment from the straight one, relative to its length; relative last coefficients; bisections
#: until then
_BENT, _REST, _HALVINGS = 0.1, 1e-7, 6
#: degree of the polynomials; last step of Newton's method on the way there; accuracy where nothing is lost but digits
_DEGREE, _STEP, _DIGITS = 6, 1e-5, 1e-14


@dataclass(frozen=True, eq=False)
class SegmentCurves:
    """Segments, slightly longer than their elements, as curves.

    series    (k, 3, n)  Chebyshev coefficients of the reference coordinates over the segment
    accuracy  (k,) of these, relative to a segment's length
    """

    segments: Segments
    series: Floats
    accuracy: Floats

    def at(self, which: Ints, shares: Floats) -> Floats:
        """(k * m, 3) reference coordinates of segments ``which`` (k,) at shares (k, m) of them."""
        modes = chebyshev.chebvander(2 * shares - 1, _DEGREE)
        return np.asarray((modes @ self.series[which].transpose(0, 2, 1)).reshape(-1, 3))


def followed_through(segments: Segments, patch: Patch, view: View, size: float) -> SegmentCurves:
    """Segments through elements of a patch and where they lead; bisected where they bend, longer at both ends."""
    left, nodes = _longer(straighten(segments, patch, view), size), 0.5 * (1 + chebyshev.chebpts1(_DEGREE + 1))
    transform, found = np.linalg.inv(chebyshev.chebvander(2 * nodes - 1, _DEGREE)), []
    for halving in range(_HALVINGS + 1):
        middle, _ = places(left, patch, view, np.full((len(left), 1), 0.5))
        series = np.einsum("dm,kmi->kid", transform, _at_nodes(left, middle, nodes, patch, view))
        length = np.maximum(np.linalg.norm(left.last - left.first, axis=1), 1e-300)
        rest = np.abs(series[:, :, -2:]).sum(axis=(1, 2)) / length
        done = (rest <= _REST) | (halving == _HALVINGS)
        found.append(SegmentCurves(left.part(done), series[done], np.maximum(_DEGREE * rest[done], _DIGITS)))
        left, middle = left.part(~done), middle[~done]
        if not len(left):
            break
        left = left.split_at(np.arange(len(left)), 0.5 * (left.near + left.far), middle)
    every = found[0].segments
    for own in found[1:]:
        every = every.and_also(own.segments)
    series, accuracy = (np.concatenate([getattr(own, name) for own in found]) for name in ("series", "accuracy"))
    return SegmentCurves(every, series, accuracy)


def _at_nodes(segments: Segments, middle: Floats, nodes: Floats, patch: Patch, view: View) -> Floats:
    """(k, m, 3) reference coordinates at shares (m,) of segments, found from parabolas through their middles (k, 3)."""
    x = nodes[:, None]
    tables = ((1 - x) * (1 - 2 * x), 4 * x * (1 - x), x * (2 * x - 1))
    start = sum(
        own[:, None] * table for own, table in zip((segments.first, middle, segments.last), tables, strict=True)
    )
    depths, count = segments.at(np.tile(nodes, (len(segments), 1))), len(nodes)
    points = points_of(view, np.repeat(segments.pixel, count), depths.ravel())
    rows = np.repeat(segments.row, count)
    return followed(patch, rows, np.reshape(start, (-1, 3)), points, _STEP).reshape(len(segments), count, 3)


def straighten(segments: Segments, patch: Patch, view: View) -> Segments:
    """The segments, bisected until each is almost straight in reference coordinates, so that places on it are found."""
    for _ in range(_HALVINGS):
        half = np.full((len(segments), 1), 0.5)
        middle, _ = places(segments, patch, view, half)
        bent = np.linalg.norm(middle - 0.5 * (segments.first + segments.last), axis=1)
        length = np.linalg.norm(segments.last - segments.first, axis=1)
        which = np.flatnonzero((bent > _BENT * length) & (margins_of(patch, middle) > -TOLERANCE))
        if not len(which):
            break
        segments = segments.split_at(which, segments.at(half)[which, 0], middle[which])
    return segments


def _longer(segments: Segments, size: float) -> Segments:
    """The segments, longer at both ends, so that no zero at the border of elements is lost."""
    more = _LONGER * (segments.far - segments.near) + _BEYOND * size
    part = (more / (segments.far - segments.near))[:, None] * (segments.last - segments.first)
    return Segments(
        segments.pixel,
        segments.row,
        segments.near - more,
        segments.far + more,
        segments.first - part,
        segments.last + part,
    )
