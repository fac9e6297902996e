"""Parts of patches, and the squared distance from a point to them.

With X a patch and p a point, D = |X - p|^2 / 2 has the derivatives D_a = (X - p) .  X_a and D_ab = X_a .  X_b + (X - p)
.  X_ab.  The derivative of D_ab along c is X_ac .  X_b + X_a .  X_bc + X_c .  X_ab + (X - p) .  X_abc.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.distances.quadratic import least
from elvis.core.distances.surface_patches import CORNERS, SurfacePatches, divided

#: column of the bounds that belongs to how many derivatives along the second coordinate, by order
_COLUMNS = (np.array([0, 1]), np.array([2, 3, 4]), np.array([5, 6, 7, 8]))
#: a and b of the second derivatives ss, st and tt
_FIRSTS, _SECONDS = np.array([0, 0, 1]), np.array([0, 1, 1])


@dataclass(frozen=True, eq=False)
class Parts(Rows):
    """Parts of patches, or of their sides: points middle + frame r, with r in a domain of `surface_patches`.

    corners  of the domain, 2 for sides
    row      (n,) of the patches
    middle   (n, 2)
    frame    (n, 2, 2) columns along both coordinates of the domain
    depth    how often patches have been divided; sides count as divided once
    """

    corners: int
    row: Ints
    middle: Floats
    frame: Floats
    depth: int = 0

    @staticmethod
    def whole(corners: int, row: Ints) -> Parts:
        """Whole patches."""
        return Parts(corners, row, np.zeros((len(row), 2)), np.tile(np.eye(2), (len(row), 1, 1)))

    def places(self, points: Floats) -> Floats:
        """(n, 2) points (n, 2) of the parts as points of the patches."""
        return np.asarray(self.middle + self.frame[:, :, 0] * points[:, :1] + self.frame[:, :, 1] * points[:, 1:])

    def around(self, points: Floats) -> Parts:
        """Parts around other points."""
        return replace(self, middle=self.places(points))

    def divide(self) -> Parts:
        """The subdivisions of all parts, grouped by kind."""
        kinds = divided(self.corners)
        middle = np.concatenate([self.places(np.tile(way, (len(self), 1))) for way, _ in kinds])
        frame = np.concatenate([self.frame * size for _, size in kinds])
        return Parts(self.corners, np.tile(self.row, len(kinds)), middle, frame, self.depth + 1)

    def sides(self, patches: SurfacePatches) -> tuple[Parts, Ints]:
        """The sides of whole patches that lie on the border of their face, and which of these parts each belongs to."""
        corners = CORNERS[self.corners]
        following = np.roll(corners, -1, axis=0)
        owners, middles, frames = [], [], []
        for k, (first, last) in enumerate(zip(corners, following, strict=True)):
            is_outer = patches.outer[self.row] >> k & 1
            own = np.flatnonzero(is_outer)
            owners.append(own)

            # half the side is the one coordinate, the other stays where it is
            middle = (first + last) / 2
            frame = np.stack([(last - first) / 2, np.zeros(2)], axis=1)
            middles.append(np.tile(middle, (len(own), 1)))
            frames.append(np.tile(frame, (len(own), 1, 1)))
        owner = np.concatenate(owners)
        return Parts(2, self.row[owner], np.concatenate(middles), np.concatenate(frames), 1), owner


@dataclass(frozen=True, eq=False)
class Model:
    """D and its derivatives at the middles of parts, in their coordinates.

    goal   (n, 3) the points p
    gap    (n, 3) X - p
    first  (n, 2, 3) derivatives of X
    gradient (n, 2), bend (n, 3) derivatives of D, as `least` takes them
    """

    parts: Parts
    goal: Floats
    gap: Floats
    first: Floats
    gradient: Floats
    bend: Floats

    @staticmethod
    def of(patches: SurfacePatches, parts: Parts, goal: Floats) -> Model:
        """The model of each part, for a point of its own."""
        row, middle, frame = parts.row, parts.middle, parts.frame
        derivatives = patches.derivatives(middle, row, 2)
        gap = derivatives[:, 0, 0] - goal

        # X_a, brought to the coordinates of the part: sums over the rows of the frame
        along_s, along_t = derivatives[:, 0, 1, None], derivatives[:, 1, 0, None]
        row_s, row_t = frame[:, 0], frame[:, 1]
        first = row_s[:, :, None] * along_s + row_t[:, :, None] * along_t

        # (X - p) . X_ab, likewise, for ab = ss, st and tt
        ss, st, tt = (dot(gap, derivatives[:, b, a])[:, None] for b, a in ((0, 2), (1, 1), (2, 0)))
        turned_s, turned_t = ss * row_s + st * row_t, st * row_s + tt * row_t
        bend = row_s[:, _FIRSTS] * turned_s[:, _SECONDS] + row_t[:, _FIRSTS] * turned_t[:, _SECONDS]

        # X_a . X_b
        bend += dot(first[:, _FIRSTS], first[:, _SECONDS])
        gradient = dot(gap[:, None], first)
        return Model(parts, goal, gap, first, gradient, bend)

    def take(self, which: Ints) -> Model:
        """Some of the parts."""
        arrays = (self.goal, self.gap, self.first, self.gradient, self.bend)
        return Model(self.parts.part(which), *(array[which] for array in arrays))

    def nearest_linear(self, bounds: Floats) -> tuple[Floats, Floats]:
        """(n, 2) the point of each part where its linear part is nearest, and (n,) what its distance is not less than.

        bounds  of the patches, by row
        """
        s, t = self.first[:, 0], self.first[:, 1]
        where = least(self.parts.corners, _products(s, t), self.gradient)
        away = self.gap + where[:, :1] * s + where[:, 1:] * t
        linear = np.sqrt(dot(away, away))

        # maximum deviation of the part from its linear part: by Taylor's theorem, or known for whole patches
        deviation = bounds[self.parts.row, 9]
        if self.parts.depth > 0:
            deviation = self._bounds(bounds, 2).sum(axis=(1, 2)) / 2
        return where, linear - deviation

    def is_convex(self, change: Floats) -> Bools:
        """(n,) whether D is convex all over each part; the second derivatives change by `change` (n, 2, 2)."""
        ss = self.bend[:, 0] - change[:, 0, 0]
        if self.parts.corners == 2:
            return np.asarray(ss > 0)

        # all second derivatives within these bounds make a positive definite matrix
        tt = self.bend[:, 2] - change[:, 1, 1]
        st = np.abs(self.bend[:, 1]) + change[:, 0, 1]
        return np.asarray((ss > 0) & (tt > 0) & (ss * tt > st**2))

    def is_steady(self, change: Floats) -> Bools:
        """(n,) whether D is monotonic all over each part, along one of its coordinates."""
        second = np.abs(self.bend[:, [[0, 1], [1, 2]]]) + change

        # the most that a first derivative changes by, from the middle to a corner
        most = second[:, :, 0] + second[:, :, 1]
        return np.asarray((np.abs(self.gradient) > most).any(axis=1))

    def change(self, bounds: Floats) -> Floats:
        """(n, 2, 2) what the second derivatives of D change by at most between the middle and any point of a part."""
        one, two, three = (self._bounds(bounds, order) for order in (1, 2, 3))
        far = np.sqrt(dot(self.gap, self.gap)) + one[:, 0] + one[:, 1]

        # |X_ac| |X_b| + |X_a| |X_bc| + |X_c| |X_ab| + |X - p| |X_abc| (see above), by a, b and c
        ac_b = two[:, :, None, :] * one[:, None, :, None]
        bc_a = ac_b.transpose(0, 2, 1, 3)
        ab_c = two[:, :, :, None] * one[:, None, None, :]
        third = ac_b + bc_a + ab_c + far[:, None, None, None] * three
        return np.asarray(third[..., 0] + third[..., 1])

    def _bounds(self, bounds: Floats, order: int) -> Floats:
        """(n, 2, …) largest lengths of the derivatives of X of this order."""
        # bounds of the patch: the number of the directions (2, …) that are the second one gives the column
        seconds = np.indices((2,) * order).sum(axis=0)
        columns = _COLUMNS[order - 1][seconds]
        found = bounds[self.parts.row][:, columns]

        # of the part, direction by direction, by the chain rule
        size = np.abs(self.parts.frame)
        for axis in range(1, order + 1):
            leading = np.moveaxis(found, axis, 1)
            row_s, row_t = (size[:, i].reshape(-1, *(1,) * (order - 1), 2) for i in (0, 1))
            scaled = leading[:, 0, ..., None] * row_s + leading[:, 1, ..., None] * row_t
            found = np.moveaxis(scaled, -1, axis)
        return np.asarray(found)


def linear_distance(patches: SurfacePatches, row: Ints, goal: Floats) -> Floats:
    """(n,) distances from points (n, 3) to the linear parts of patches."""
    own = patches.coefficients
    gap = own[row, 0, 0] - goal
    s = own[row, 0, 1]
    t = own[row, 1, 0] if patches.corners > 2 else np.zeros_like(s)
    gradient = np.stack([dot(gap, s), dot(gap, t)], axis=1)
    where = least(patches.corners, _products(s, t), gradient)
    away = gap + where[:, :1] * s + where[:, 1:] * t
    return np.sqrt(dot(away, away))


def _products(s: Floats, t: Floats) -> Floats:
    """(n, 3) s . s, s . t and t . t, as `least` takes the second derivatives of linear parts."""
    return np.stack([dot(s, s), dot(s, t), dot(t, t)], axis=1)


def dot(a: Floats, b: Floats) -> Floats:
    """(…,) inner products of vectors (…, k), for few components faster than a sum over the last axis."""
    products = a * b
    total = products[..., 0]
    for i in range(1, products.shape[-1]):
        total = total + products[..., i]
    return np.asarray(total)
