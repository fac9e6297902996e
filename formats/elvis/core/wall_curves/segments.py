"""Parts of curves on sides of elements, in the sides' reference coordinates.

A segment has a parameter t from 0 to 1.  It is straight in reference coordinates, or it is the graph v(u) of the zeros
of a polynomial g on a convex part of a side, where dg/dv has one sign.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.rows import Rows

#: Newton steps for a point of a graph, and the change relative to a side at which they end: one more step follows on
#: the elements' own map (`wall_curve`)
_STEPS, _SHORT = 60, 1e-9


class Segments(Protocol):
    """Segments of one kind.

    piece  (n,) numbers of the pieces that hold their sides
    row    (n,) rows of these pieces
    """

    @property
    def piece(self) -> Ints: ...  # noqa: D102

    @property
    def row(self) -> Ints: ...  # noqa: D102

    def at(self, which: Ints, t: Floats) -> tuple[Floats, Floats]:
        """(m, k) reference points of sides at parameters t (m,) of segments (m,), and their derivatives (m, k)."""


@dataclass(frozen=True, eq=False)
class Straight(Rows):
    """Segments that are straight in reference coordinates.

    first, last  (n, k) reference points of the ends
    """

    piece: Ints
    row: Ints
    first: Floats
    last: Floats

    def at(self, which: Ints, t: Floats) -> tuple[Floats, Floats]:
        """As `Segments.at`."""
        slope = self.last[which] - self.first[which]
        return self.first[which] + t[:, None] * slope, slope


@dataclass(frozen=True, eq=False)
class Parts(Rows):
    """Convex parts of sides with a polynomial g of coordinates s on each: reference points are middle + size s.

    corners       3 for triangles with -1 <= s, s_0 + s_1 <= 0; 4 for squares with -1 <= s <= 1
    middle        (n, 2)
    size          (n,)    negative for the middle part of a triangle
    coefficients  (n, m, k) of the powers s_0^i s_1^j of g: [.., j, i]
    piece, row    (n,) as in `Segments`
    """

    corners: int
    middle: Floats
    size: Floats
    coefficients: Floats
    piece: Ints
    row: Ints

    def values(self, which: Ints, points: Floats) -> tuple[Floats, Floats]:
        """(n,) g and (n, 2) its gradient at points s (n, 2) of parts ``which`` (n,)."""
        table = self.coefficients[which]
        powers, slopes = zip(
            *(_powers(own, count) for own, count in zip(points.T, table.shape[:0:-1], strict=True)), strict=True
        )
        value, along, across = (
            np.einsum("nji,ni,nj->n", table, first, second)
            for first, second in ((powers[0], powers[1]), (slopes[0], powers[1]), (powers[0], slopes[1]))
        )
        return value, np.stack([along, across], axis=1)

    def chords(self, which: Ints, base: Floats, direction: Floats) -> tuple[Floats, Floats]:
        """(n,) smallest and largest v with base + v direction in the domain, all (n, 2).

        Smallest > largest for none.
        """
        normals, offsets = _HALF_PLANES[self.corners]
        rate, height = direction @ normals.T, base @ normals.T + offsets
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = -height / rate
        low = np.where(rate > 0, crossing, -np.inf).max(axis=1)
        high = np.where(rate < 0, crossing, np.inf).min(axis=1)
        is_beside = ((rate == 0) & (height < 0)).any(axis=1)
        return np.where(is_beside, np.inf, low), high


#: the domains of `Parts`: s is inside where normals @ s + offsets >= 0
_HALF_PLANES = {
    3: (np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, -1.0]]), np.array([1.0, 1.0, 0.0])),
    4: (np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]]), np.ones(4)),
}


@dataclass(frozen=True, eq=False)
class Graphs:
    """Segments v(u) with g(u along + v up) = 0 in the coordinates s of parts.

    parts      that they are in
    part       (n,) the part of each
    along, up  (n, 2) unit vectors at right angles; the derivative of g along ``up`` has one sign in the part
    ends       (n, 2) values of u at t = 0 and t = 1
    """

    parts: Parts
    part: Ints
    along: Floats
    up: Floats
    ends: Floats

    @property
    def piece(self) -> Ints:
        """As in `Segments`."""
        return self.parts.piece[self.part]

    @property
    def row(self) -> Ints:
        """As in `Segments`."""
        return self.parts.row[self.part]

    def at(self, which: Ints, t: Floats) -> tuple[Floats, Floats]:
        """As `Segments.at`; dv/du = -(dg/du) / (dg/dv)."""
        part, along, up = self.part[which], self.along[which], self.up[which]
        run = self.ends[which, 1] - self.ends[which, 0]
        u = self.ends[which, 0] + t * run
        points = u[:, None] * along + self._heights(part, u, along, up)[:, None] * up
        gradients = self.parts.values(part, points)[1]
        with np.errstate(divide="ignore", invalid="ignore"):
            rise = -np.einsum("nc,nc->n", gradients, along) / np.einsum("nc,nc->n", gradients, up)
        size = self.parts.size[part][:, None]
        return self.parts.middle[part] + size * points, size * run[:, None] * (along + rise[:, None] * up)

    def _heights(self, part: Ints, u: Floats, along: Floats, up: Floats) -> Floats:
        """(n,) v of the zeros: Newton's method in a bracket, which is bisected where a step leaves it."""
        base = u[:, None] * along
        low, high = self.parts.chords(part, base, up)
        v = (low + high) / 2
        # next to a corner the chord may be empty by rounding
        high = np.maximum(low, high)
        first, last = (self.parts.values(part, base + end[:, None] * up)[0] for end in (low, high))
        sign = np.where(last >= first, 1.0, -1.0)
        for _ in range(_STEPS):
            value, gradient = self.parts.values(part, base + v[:, None] * up)
            low, high = np.where(sign * value < 0, v, low), np.where(sign * value < 0, high, v)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = v - value / np.einsum("nc,nc->n", gradient, up)
            after = np.where((step >= low) & (step <= high), step, (low + high) / 2)
            is_done = np.abs(after - v).max(initial=0.0) <= _SHORT
            v = after
            if is_done:
                break
        return np.asarray(v)


def _powers(places: Floats, count: int) -> tuple[Floats, Floats]:
    """(n, count) powers of places (n,), and their derivatives."""
    exponents = np.arange(count)
    powers = places[:, None] ** exponents
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = exponents[1:] * powers[:, :-1]
    return powers, slopes
