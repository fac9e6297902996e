"""Bernstein nets of face maps: how they are found, bounded, differentiated and subdivided.

A net holds homogeneous control points (w x, w y, w z, w) in the order of `elvis.core.polynomials.bernstein`, over
the reference triangle or the reference square.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, rows_by_number
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values, gradient_nets
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape

#: rows (n,) of elements and reference points (k, 3) to homogeneous world points (n, k, 4): w x, w y, w z, w
Images: TypeAlias = Callable[[Ints, Floats], Floats]

#: halves of a triangle, cut from a vertex to the middle of the opposite edge: along s, along t, and between the two
_HALVES = [
    [[(-1, -1), (0, -1), (-1, 1)], [(0, -1), (1, -1), (-1, 1)]],
    [[(-1, -1), (1, -1), (-1, 0)], [(-1, 0), (1, -1), (-1, 1)]],
    [[(-1, -1), (1, -1), (0, 0)], [(-1, -1), (0, 0), (-1, 1)]],
]


@dataclass(frozen=True)
class FaceSpace:
    """Maps of faces: of total degree ``degree`` on triangles, of that degree in each direction on squares."""

    shape: Shape
    degree: int

    @property
    def space(self) -> BernsteinSpace:
        """The Bernstein functions."""
        return BernsteinSpace(self.shape, (self.degree,) * (1 if self.shape is Shape.TRIANGLE else 2))

    @property
    def count(self) -> int:
        """Number of control points."""
        return self.space.count

    @cached_property
    def points(self) -> Floats:
        """(k, 2) points of the face whose images determine a net."""
        nodes = gauss(self.degree + 1)[0]
        grid = np.stack(np.meshgrid(nodes, nodes), axis=-1).reshape(-1, 2)
        return frozen_floats(uncollapse(self.shape, grid))

    @cached_property
    def fit(self) -> Floats:
        """(count, k) matrix from values at `points` to a net."""
        return frozen_floats(np.linalg.pinv(bernstein_values(self.space, self.points)))

    @cached_property
    def halves(self) -> Floats:
        """(k, 2, 3, 2) the halves of a face for each of k ways to cut it: along s, along t, on triangles also between.

        A half has an origin and two axes: its point u is origin + u_1 axis_1 + u_2 axis_2.
        """
        if self.shape is Shape.TRIANGLE:
            corners = np.array(_HALVES, np.float64)
            axes = (corners[:, :, 1:] - corners[:, :, :1]) / 2
            return frozen_floats(np.concatenate([corners[:, :, :1] + axes.sum(axis=2, keepdims=True), axes], axis=2))
        s, t = np.diag([0.5, 1.0]), np.diag([1.0, 0.5])
        return frozen_floats([[[-s[0], *s], [s[0], *s]], [[-t[1], *t], [t[1], *t]]])

    @cached_property
    def cuts(self) -> Floats:
        """Matrices (k, 2, count, count) from the net of a face to the nets of its `halves`."""
        origin, axes = self.halves[:, :, :1], self.halves[:, :, 1:]
        images = origin + self.points @ axes
        basis = bernstein_values(self.space, images.reshape(-1, 2)).reshape(*images.shape[:3], self.count)
        return frozen_floats(self.fit @ basis)

    @cached_property
    def derivatives(self) -> Floats:
        """Matrices (2, count', count) from a net to the nets of its derivatives along the two coordinates."""
        return frozen_floats([matrix.T for _, matrix in gradient_nets(self.space)])


@bounded_cache
def symmetries(shape: Shape) -> Floats:
    """(k, 3, 2) the symmetries of a reference shape: the point u goes to turn_0 + u_1 turn_1 + u_2 turn_2."""
    if shape is Shape.TRIANGLE:
        corners = np.array(list(permutations([(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0)])))
        axes = (corners[:, 1:] - corners[:, :1]) / 2
        return frozen_floats(np.concatenate([corners[:, :1] + axes.sum(axis=1, keepdims=True), axes], axis=1))
    signs = [(a, b) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]
    axes = np.array([np.diag(sign)[list(order)] for sign in signs for order in ((0, 1), (1, 0))])
    return frozen_floats(np.concatenate([np.zeros((len(axes), 1, 2)), axes], axis=1))


@bounded_cache
def face_space(shape: Shape, degree: int) -> FaceSpace:
    """The one space of its kind, with its matrices."""
    return FaceSpace(shape, degree)


def sampled_nets(space: FaceSpace, rows: Ints, local: Ints, frames: Floats, images: Images) -> Callable[[Ints], Floats]:
    """The ``nets`` of a FaceBlock whose faces' maps are found from points of their elements.

    rows    (n,) of the elements, as ``images`` knows them
    local   (n,) and frames (k, 3, 3) as in FaceBlock
    images  what the elements' maps do; on each face it must lie in ``space``
    """

    def nets(chosen: Ints) -> Floats:
        result = np.empty((len(chosen), space.count, 4))
        for side, here in rows_by_number(local[chosen]):
            points = frames[side, 0] + space.points @ frames[side, 1:]
            result[here] = space.fit @ images(rows[chosen[here]], points)
        return result

    return nets


def polynomial(positions: Callable[[Ints, Floats], Floats]) -> Images:
    """Images from world positions (n, k, 3): maps without weights."""

    def images(rows: Ints, points: Floats) -> Floats:
        found = positions(rows, points)
        return np.concatenate([found, np.ones((*found.shape[:2], 1))], axis=2)

    return images
