"""Faces that two elements share: results on one side hold for the other."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.polynomials.bernstein import bernstein_values
from elvis.plugins.faces.nets import FaceSpace, symmetries
from elvis.renderer.passes.faces.face_patches import FacePatches

#: part of the largest coordinate within which two maps are one
SAME = 1e-13


@dataclass(frozen=True, eq=False)
class Sides:
    """Pairs among n faces with one shape and degree.

    alone  (m,)       representative faces: faces without another side, and one side of each pair
    first  (p,)       rows of ``alone``
    other  (p,)       the corresponding other faces
    turn   (p, 3, 2)  point u of the first is point turn_0 + u_1 turn_1 + u_2 turn_2 of the other
    """

    alone: Ints
    first: Ints
    other: Ints
    turn: Floats

    @staticmethod
    def of(space: FaceSpace, entity: Ints, nets: Floats) -> Sides:
        """Faces (n,) of the mesh with their nets (n, count, 4): sides are one where their nets agree."""
        order = np.argsort(entity, kind="stable")
        at = np.flatnonzero(np.diff(entity[order]) == 0)
        first, other = order[at], order[at + 1]
        turns, matrices = _turns(space)
        which, scale = np.full(len(at), -1), np.abs(nets).max(initial=0.0)
        for number, matrix in enumerate(matrices):
            which[np.abs(matrix @ nets[other] - nets[first]).max(axis=(1, 2), initial=0.0) <= SAME * scale] = number
        found = which >= 0
        first, other = first[found], other[found]
        alone = np.setdiff1d(np.arange(len(entity)), other)
        return Sides(alone, np.searchsorted(alone, first), other, turns[which[found]])

    def both(self, patches: FacePatches) -> FacePatches:
        """The patches of all faces, from the patches of representative faces, by their rows."""
        pair = np.full(len(self.alone), -1)
        pair[self.first] = np.arange(len(self.first))
        again = np.flatnonzero(pair[patches.face] >= 0)
        pair = pair[patches.face[again]]
        place = patches.place[again] @ self.turn[pair, 1:]
        place[:, 0] += self.turn[pair, 0]
        return replace(
            patches,
            face=np.append(self.alone[patches.face], self.other[pair]),
            place=np.concatenate([patches.place, place]),
            bounds=np.concatenate([patches.bounds, patches.bounds[:, again]], axis=1),
            beside=np.concatenate([patches.beside, patches.beside[..., again]], axis=2),
            near=np.append(patches.near, patches.near[again]),
            noise=np.append(patches.noise, patches.noise[again]),
        )


@bounded_cache
def _turns(space: FaceSpace) -> tuple[Floats, Floats]:
    """(k, 3, 2) the symmetries of the reference shape, and (k, count, count) nets of maps that come after them."""
    turns = symmetries(space.shape)
    images = turns[:, :1] + space.points @ turns[:, 1:]
    return turns, np.array([space.fit @ bernstein_values(space.space, points) for points in images])
