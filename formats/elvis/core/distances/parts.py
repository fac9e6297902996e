"""Parts of patches, and the squared distance from a point to them.

With X a patch and p a point, D = |X - p|^2 / 2 has the derivatives D_a = (X - p) . X_a and D_ab = X_a . X_b +
(X - p) . X_ab, of which D_ab changes along c by X_ac . X_b + X_a . X_bc + X_c . X_ab + (X - p) . X_abc.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.distances.quadratic import least
from elvis.core.distances.surface_patches import CORNERS, SurfacePatches, divided

#: column of the bounds that belongs to how many derivatives along the second coordinate, by order
_COLUMNS = (np.array([0, 1]), np.array([2, 3, 4]), np.array([5, 6, 7, 8]))


@dataclass(frozen=True, eq=False)
class Parts:
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

    def __len__(self) -> int:
        return len(self.row)

    @staticmethod
    def whole(corners: int, row: Ints) -> Parts:
        """Whole patches."""
        return Parts(corners, row, np.zeros((len(row), 2)), np.tile(np.eye(2), (len(row), 1, 1)))

    def take(self, which: Ints) -> Parts:
        """Some of the parts."""
        return replace(self, row=self.row[which], middle=self.middle[which], frame=self.frame[which])

    def places(self, points: Floats) -> Floats:
        """(n, 2) points (n, 2) of the parts as points of the patches."""
        return np.asarray(self.middle + np.einsum("nij,nj->ni", self.frame, points))

    def moved(self, points: Floats) -> Parts:
        """Parts around other points."""
        return replace(self, middle=self.places(points))

    def divided(self) -> Parts:
        """The parts of all parts, those of one kind one after the other."""
        kinds = divided(self.corners)
        middle = np.concatenate([self.places(np.tile(way, (len(self), 1))) for way, _ in kinds])
        frame = np.concatenate([self.frame * size for _, size in kinds])
        return Parts(self.corners, np.tile(self.row, len(kinds)), middle, frame, self.depth + 1)

    def sides(self, patches: SurfacePatches) -> tuple[Parts, Ints]:
        """The sides of whole patches that lie on the border of their face, and which of these parts each belongs to."""
        corners, row, owner, middle, frame = CORNERS[self.corners], [], [], [], []
        for k, (first, last) in enumerate(zip(corners, np.roll(corners, -1, axis=0), strict=True)):
            own = np.flatnonzero(patches.outer[self.row] >> k & 1)
            row.append(self.row[own])
            owner.append(own)
            middle.append(np.tile((first + last) / 2, (len(own), 1)))
            frame.append(np.tile(np.stack([(last - first) / 2, np.zeros(2)], axis=1), (len(own), 1, 1)))
        made = Parts(2, np.concatenate(row), np.concatenate(middle), np.concatenate(frame), 1)
        return made, np.concatenate(owner)


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
        gap = patches.at(middle, row) - goal
        own = np.stack([patches.at(middle, row, *times) for times in ((1, 0), (0, 1))], axis=1)
        ss, st, tt = (_dot(gap, patches.at(middle, row, *times)) for times in ((2, 0), (1, 1), (0, 2)))
        first = np.einsum("nia,nix->nax", frame, own)
        bent = np.einsum("nia,nij,njb->nab", frame, np.array([[ss, st], [st, tt]]).transpose(2, 0, 1), frame)
        bent += np.einsum("nax,nbx->nab", first, first)
        gradient = np.einsum("nx,nax->na", gap, first)
        return Model(parts, goal, gap, first, gradient, bent[:, [0, 0, 1], [0, 1, 1]])

    def take(self, which: Ints) -> Model:
        """Some of the parts."""
        arrays = (self.goal, self.gap, self.first, self.gradient, self.bend)
        return Model(self.parts.take(which), *(array[which] for array in arrays))

    def nearest_linear(self, bounds: Floats) -> tuple[Floats, Floats]:
        """(n, 2) the point of each part where its linear part is nearest, and (n,) what its distance is not less than.

        bounds  of the patches, by row
        """
        s, t = self.first[:, 0], self.first[:, 1]
        where = least(self.parts.corners, np.stack([_dot(s, s), _dot(s, t), _dot(t, t)], axis=1), self.gradient)
        linear = np.linalg.norm(self.gap + np.einsum("nd,ndx->nx", where, self.first), axis=1)
        bent = bounds[self.parts.row, 9] if self.parts.depth == 0 else self._bounds(bounds, 2).sum(axis=(1, 2)) / 2
        return where, linear - bent

    def is_convex(self, bounds: Floats) -> Bools:
        """(n,) whether D is convex all over each part."""
        change = self._change(bounds)
        ss, tt = self.bend[:, 0] - change[:, 0, 0], self.bend[:, 2] - change[:, 1, 1]
        if self.parts.corners == 2:
            return np.asarray(ss > 0)
        st = np.abs(self.bend[:, 1]) + change[:, 0, 1]
        return np.asarray((ss > 0) & (tt > 0) & (ss * tt > st**2))

    def is_steady(self, bounds: Floats) -> Bools:
        """(n,) whether D is monotonic all over each part, along one of its coordinates."""
        most = np.abs(self.bend[:, [[0, 1], [1, 2]]]) + self._change(bounds)
        return np.asarray((np.abs(self.gradient) > most.sum(axis=2)).any(axis=1))

    def _change(self, bounds: Floats) -> Floats:
        """(n, 2, 2) what the second derivatives of D change by at most between the middle and any point of a part."""
        one, two, three = (self._bounds(bounds, order) for order in (1, 2, 3))
        far = np.linalg.norm(self.gap, axis=1) + one.sum(axis=1)
        mixed = two[:, :, None, :] * one[:, None, :, None]
        every = mixed + mixed.transpose(0, 2, 1, 3) + two[:, :, :, None] * one[:, None, None, :]
        return np.asarray((every + far[:, None, None, None] * three).sum(axis=3))

    def _bounds(self, bounds: Floats, order: int) -> Floats:
        """(n, 2, …) greatest lengths of the derivatives of X of this order."""
        which = np.indices((2,) * order).sum(axis=0)
        own, size = bounds[self.parts.row][:, _COLUMNS[order - 1][which]], np.abs(self.parts.frame)
        for axis in range(1, order + 1):
            own = np.moveaxis(np.einsum("ni...,nia->n...a", np.moveaxis(own, axis, 1), size), -1, axis)
        return np.asarray(own)


def linear_distance(patches: SurfacePatches, row: Ints, goal: Floats) -> Floats:
    """(n,) distances from points (n, 3) to the linear parts of patches."""
    own = patches.coefficients
    gap, s = own[row, 0, 0] - goal, own[row, 0, 1]
    t = own[row, 1, 0] if patches.corners > 2 else np.zeros_like(s)
    bend = np.stack([_dot(s, s), _dot(s, t), _dot(t, t)], axis=1)
    gradient = np.stack([_dot(gap, s), _dot(gap, t)], axis=1)
    where = least(patches.corners, bend, gradient)
    return np.asarray(np.linalg.norm(gap + where[:, :1] * s + where[:, 1:] * t, axis=1))


def _dot(a: Floats, b: Floats) -> Floats:
    return np.asarray((a * b).sum(axis=1))
