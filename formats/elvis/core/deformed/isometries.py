"""Isometries of space x -> R x + s: reflections, rotations, translations and what they compose to."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.data.complex_fields import cosine_and_sine

#: entries of R nearer to 0, 1 or -1 than this are these numbers
_ROUNDING = 4e-16

Row = tuple[float, float, float]


@dataclass(frozen=True)
class Isometry:
    """x -> R x + s.

    rotation  rows of the orthogonal matrix R; reflections have determinant -1
    shift     s, in world units
    """

    rotation: tuple[Row, Row, Row] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    shift: Row = (0.0, 0.0, 0.0)

    @staticmethod
    def of(matrix: ArrayLike, shift: ArrayLike) -> Isometry:
        """The isometry of a matrix (3, 3) and a vector (3,)."""
        rounded = np.array(matrix, np.float64)
        whole = np.rint(rounded)
        rounded = np.where(np.abs(rounded - whole) <= _ROUNDING, whole, rounded) + 0.0
        first, second, third = (tuple(row) for row in rounded.tolist())
        x, y, z = (np.asarray(shift, np.float64) + 0.0).tolist()
        return Isometry((first, second, third), (x, y, z))

    @staticmethod
    def mirror(point: ArrayLike, normal: ArrayLike) -> Isometry:
        """The reflection at a plane: x - 2 n (n · (x - p)), with the unit normal n."""
        n = np.asarray(normal, np.float64)
        n = n / np.linalg.norm(n)
        return Isometry.of(np.eye(3) - 2.0 * np.outer(n, n), 2.0 * (n @ np.asarray(point, np.float64)) * n)

    @staticmethod
    def turn(point: ArrayLike, axis: ArrayLike, degrees: float) -> Isometry:
        """The rotation about an axis through a point, by Rodrigues' formula R = c I + s [n]x + (1 - c) n n^T."""
        n = np.asarray(axis, np.float64)
        n = n / np.linalg.norm(n)
        cosine, sine = cosine_and_sine(degrees)
        cross = np.array([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
        matrix = cosine * np.eye(3) + sine * cross + (1.0 - cosine) * np.outer(n, n)
        turned = Isometry.of(matrix, np.zeros(3))
        middle = np.asarray(point, np.float64)
        return Isometry.of(turned.matrix, middle - turned.matrix @ middle)

    @staticmethod
    def translation(vector: ArrayLike) -> Isometry:
        """The translation by a vector."""
        return Isometry.of(np.eye(3), vector)

    @cached_property
    def matrix(self) -> Floats:
        """(3, 3) R."""
        return frozen_floats(np.array(self.rotation))

    @cached_property
    def vector(self) -> Floats:
        """(3,) s."""
        return frozen_floats(np.array(self.shift))

    @property
    def is_identity(self) -> bool:
        """Whether every point stays where it is."""
        return self == Isometry()

    @property
    def is_proper(self) -> bool:
        """Whether orientations stay as they are: rotations and translations."""
        return bool(np.linalg.det(self.matrix) > 0.0)

    def after(self, first: Isometry) -> Isometry:
        """This isometry, applied after another one."""
        return Isometry.of(self.matrix @ first.matrix, self.points(first.vector))

    def points(self, x: Floats) -> Floats:
        """Images (…, 3) of points (…, 3)."""
        return np.asarray(x @ self.matrix.T + self.vector)

    def directions(self, v: Floats) -> Floats:
        """Images (…, 3) of vectors (…, 3)."""
        return np.asarray(v @ self.matrix.T)

    def points_before(self, x: Floats) -> Floats:
        """Points (…, 3) whose images are given: R^T (x - s)."""
        return np.asarray((x - self.vector) @ self.matrix)

    def directions_before(self, v: Floats) -> Floats:
        """Vectors (…, 3) whose images are given."""
        return np.asarray(v @ self.matrix)

    def corners(self, box: Floats) -> Floats:
        """Images (8, 3) of the corners of a box (2, 3)."""
        corners = [[box[k, axis] for axis, k in enumerate(ends)] for ends in product((0, 1), repeat=3)]
        return self.points(np.array(corners))

    def box(self, box: Floats) -> Floats:
        """(2, 3) low and high corner of the box around the image of a box (2, 3)."""
        images = self.corners(box)
        return np.array([images.min(axis=0), images.max(axis=0)])
