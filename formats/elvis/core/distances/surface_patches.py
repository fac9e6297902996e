"""Parts of faces as polynomials of two coordinates, over a line, a triangle or a square.

kind      corners  points
line      2        (-1, 0), (1, 0)
triangle  3        (-1, -1), (1, -1), (-1, 1)
square    4        (-1, -1), (1, -1), (1, 1), (-1, 1)

Side k runs from corner k to the next one; a line's sides are its two ends.  A part of a domain lies at a + h s, with s
a point of the whole.  Three of a triangle's four parts have the size h = 1/2 and one has -1/2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import comb, perm

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.rows import Rows
from elvis.core.mapping.orientation import chunks

CORNERS: Mapping[int, Floats] = {
    2: frozen_floats([[-1, 0], [1, 0]]),
    3: frozen_floats([[-1, -1], [1, -1], [-1, 1]]),
    4: frozen_floats([[-1, -1], [1, -1], [1, 1], [-1, 1]]),
}
#: `SurfacePatches.outer` of whole faces
WHOLE: Mapping[int, int] = {corners: 17 * ((1 << corners) - 1) for corners in CORNERS}
#: derivatives that `SurfacePatches.bounds` has bounds of: how often along the first and along the second coordinate
BOUNDED = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2), (3, 0), (2, 1), (1, 2), (0, 3))
#: parts that a patch may bend by and still count as nearly flat
_FLAT = 0.04
_DEEPEST, _MOST = 7, 1 << 18
#: patches that are processed together
AT_ONCE = 1 << 15


@dataclass(frozen=True, eq=False)
class SurfacePatches(Rows):
    """Surface patches of one kind and degree.

    corners       2, 3 or 4, see the head of this module
    coefficients  (n, m, k, 3) of the powers s^i t^j, i < k and j < m: [.., j, i, :]
    face          (n,) number of the face that each is a part of
    outer         (n,) bits: whether side k (bit k) and corner k (bit 4 + k) lie on the border of the face
    """

    corners: int
    coefficients: Floats
    face: Ints
    outer: Ints

    @property
    def is_flat(self) -> bool:
        """Whether the patches are lines and triangles, straight ones."""
        return self.corners < 4 and self.coefficients.shape[2] == 2

    def at(self, points: Floats, rows: Ints) -> Floats:
        """(n, 3) positions at points (n, 2) of patches ``rows`` (n,)."""
        return np.asarray(self.derivatives(points, rows, 0)[:, 0, 0])

    def derivatives(self, points: Floats, rows: Ints, most: int) -> Floats:
        """(n, most + 1, most + 1, 3) derivatives there: [i, b, a] a times along s and b times along t."""
        m, k = self.coefficients.shape[1:3]
        powers_s, powers_t = _powers(points[:, 0], k, most), _powers(points[:, 1], m, most)
        # sums over i, then over j, of c_ji s^i t^j: products of small matrices, which don't depend on each other
        along = np.matmul(powers_s[:, None], self.coefficients[rows])
        across = np.matmul(powers_t, along.reshape(len(rows), m, 3 * (most + 1)))
        return np.asarray(across.reshape(len(rows), most + 1, most + 1, 3))

    def normals(self, points: Floats, rows: Ints) -> Floats:
        """(n, 3) normals there, of curves those in the plane, to the right of the direction of the curve."""
        derivatives = self.derivatives(points, rows, 1)
        s, t = derivatives[:, 0, 1], derivatives[:, 1, 0]
        return np.cross(s, t) if self.corners > 2 else s[:, [1, 0, 2]] * (1, -1, 0)

    @property
    def vertices(self) -> Floats:
        """(n, corners, 3) where the corners lie."""
        return self._by_part(SurfacePatches._vertices, self.corners, 3)

    @property
    def bounds(self) -> Floats:
        """(n, 10) largest lengths of the derivatives `BOUNDED`, and how far the patch may be from its linear part."""
        return self._by_part(SurfacePatches._bounds, 10)

    @property
    def boxes(self) -> Floats:
        """(n, 6) low and high corners of boxes that hold the patches."""
        return self._by_part(SurfacePatches._boxes, 6)

    def _by_part(self, compute: Callable[[SurfacePatches], Floats], *shape: int) -> Floats:
        """(n, …) results for all patches; they are computed for a few at a time to keep intermediate arrays small."""
        found = np.empty((len(self), *shape))
        for part in chunks(len(self), AT_ONCE):
            found[part] = compute(self.part(part))
        return found

    def _vertices(self) -> Floats:
        rows = np.arange(len(self))
        return np.stack([self.at(np.tile(corner, (len(self), 1)), rows) for corner in CORNERS[self.corners]], axis=1)

    def _bounds(self) -> Floats:
        size = np.linalg.norm(self.coefficients, axis=3)
        m, k = size.shape[1:]
        columns = []
        for a, b in BOUNDED:
            rows_scale, columns_scale = _falling_factorials(m, b), _falling_factorials(k, a)
            columns.append(np.einsum("nji,j,i->n", size, rows_scale, columns_scale))
        return np.stack([*columns, np.where(self._linear, 0.0, size).sum(axis=(1, 2))], axis=1)

    def _boxes(self) -> Floats:
        bend = np.abs(self.coefficients[:, ~self._linear]).sum(axis=1)
        origin, along = self.coefficients[:, 0, 0], self.coefficients[:, 0, 1]
        across = self.coefficients[:, 1, 0] if self.corners > 2 else 0.0
        # the corners of the linear part
        points = [origin + s * along + t * across for s, t in CORNERS[self.corners].tolist()]
        low, high = points[0], points[0]
        for point in points[1:]:
            low, high = np.minimum(low, point), np.maximum(high, point)
        return np.concatenate([low - bend, high + bend], axis=1)

    @property
    def _linear(self) -> Bools:
        """(m, k) which powers are at most linear."""
        m, k = self.coefficients.shape[1:3]
        return np.asarray(np.add.outer(np.arange(m), np.arange(k)) < 2)

    def flatten(self, first: int = 0) -> SurfacePatches:
        """The patches, cut until each is nearly flat; faces are numbered from ``first``."""
        done: list[SurfacePatches] = []
        rest = SurfacePatches(self.corners, self.coefficients, self.face + first, self.outer)
        for _ in range(_DEEPEST):
            bend = rest.bounds[:, 9]
            linear = np.linalg.norm(rest.coefficients[:, 0, 1], axis=1)
            if self.corners > 2:
                linear += np.linalg.norm(rest.coefficients[:, 1, 0], axis=1)
            bent = bend > _FLAT * linear
            if not bent.any():
                return SurfacePatches.joined([*done, rest])
            done.append(rest.part(np.flatnonzero(~bent)))
            if sum(map(len, done)) + 4 * bent.sum() > _MOST:
                return SurfacePatches.joined([*done, rest.part(np.flatnonzero(bent))])
            rest = rest.part(np.flatnonzero(bent)).parts()
        return SurfacePatches.joined([*done, rest])

    def parts(self) -> SurfacePatches:
        """The parts of all patches."""
        m, k = self.coefficients.shape[1:3]
        made = []
        for number, (middle, half) in enumerate(divided(self.corners)):
            s, t = _shift_matrix(k, middle[0], half), _shift_matrix(m, middle[1], half)
            coefficients = np.einsum("njix,ia,jb->nbax", self.coefficients, s, t, optimize=True)
            made.append(SurfacePatches(self.corners, coefficients, self.face, self._outer_of(number)))
        return SurfacePatches.joined(made)

    def _outer_of(self, number: int) -> Ints:
        """(n,) `outer` of a part: parts at a corner of the whole keep it and half of its sides.

        New corners lie on sides.
        """
        n = self.corners
        side, corner = ([self.outer >> (shift + k) & 1 for k in range(n)] for shift in (0, 4))
        if n == 2:
            return np.asarray((side[number] | corner[number] << 4) << number)
        if number == n:
            return np.asarray(sum(side[(k + 1) % n] << (4 + k) for k in range(n)))
        ahead, back = (number + 1) % n, (number - 1) % n
        sides = side[number] << number | side[back] << back
        return np.asarray(sides | (corner[number] << number | side[number] << ahead | side[back] << back) << 4)


@bounded_cache
def divided(corners: int) -> tuple[tuple[Floats, float], ...]:
    """The parts of a domain: middle (2,) and size of each, as a and h at the head of this module."""
    found = [(0.5 * corner, 0.5) for corner in CORNERS[corners]]
    return (*found, (np.array([-0.5, -0.5]), -0.5)) if corners == 3 else tuple(found)


@bounded_cache
def _shift_matrix(count: int, middle: float, half: float) -> Floats:
    """(count, count) matrix from coefficients of powers of s to coefficients of powers of r, s = middle + half r.

    Multiply from the right.
    """
    return frozen_floats(
        [[comb(i, a) * middle ** (i - a) * half**a if a <= i else 0.0 for a in range(count)] for i in range(count)]
    )


def _powers(points: Floats, count: int, most: int) -> Floats:
    """(n, most + 1, count) the powers of points (n,), differentiated up to ``most`` times."""
    powers = np.ones((count, len(points)))
    for i in range(1, count):
        np.multiply(powers[i - 1], points, out=powers[i])
    found = np.zeros((len(points), most + 1, count))
    for times in range(min(most + 1, count)):
        # s^i, differentiated k times, is i (i - 1) … s^(i - k)
        found[:, times, times:] = powers[: count - times].T * _falling_factorials(count, times)[times:]
    return found


def _falling_factorials(count: int, times: int) -> Floats:
    """i (i - 1) … for every power i."""
    return np.array([perm(i, times) for i in range(count)], np.float64)
