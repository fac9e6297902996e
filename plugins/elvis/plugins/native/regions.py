"""Regions for bounds of derivatives: around an element, or boxes of a pyramid's collapsed coordinates.

On a pyramid functions are polynomials of (a, b, c), which define reference coordinates (x, y, z) by z = c and, with the
share s = (1 - c) / 2, x = (1 + a) s - 1 and y = (1 + b) s - 1.  With a polynomial P this gives

    d/dx (P / s^k) = P_a / s^(k + 1)
    d/dz (P / s^k) = (s P_c + (1 + a) P_a / 2 + (1 + b) P_b / 2 + k P / 2) / s^(k + 1)

in which no degree grows: derivatives of every order are polynomials over powers of s, which is positive except at the
apex.  Such a quotient lies between quotients of Bernstein coefficients (Farin 2002, Curves and Surfaces for CAGD,
section 13.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values, gradient_nets
from elvis.core.quantities.intervals import Interval
from elvis.core.shapes import Shape
from elvis.plugins.native.bending import derived, net_of_xi

#: highest order of derivatives
_MOST_ORDER = 3


class Region(Protocol):
    """Bounds of derivatives in reference coordinates of polynomials with nets (n, ..., count), each in its place."""

    def ends(self, nets: Floats, directions: tuple[int, ...], less: float = 0.0) -> Interval:
        """Minimum and maximum value (n, ...) of a derivative, less a number; infinite where nothing is known."""


@dataclass(frozen=True)
class Neighbourhood:
    """Elements that are larger by a factor than the elements of a space."""

    space: BernsteinSpace
    beyond: float

    def ends(self, nets: Floats, directions: tuple[int, ...], less: float = 0.0) -> Interval:
        """As `Region.ends`."""
        found = derived(self.space, nets, directions, self.beyond) - less
        return found.min(axis=-1), found.max(axis=-1)


class PyramidBoxes:
    """Boxes in pyramids with polynomials of some space: by middles and half sides (n, 3), in collapsed coordinates."""

    def __init__(self, space: BernsteinSpace, middle: Floats, half: Floats) -> None:
        self._half = half
        self._given = space.degrees
        # powers of the share are polynomials of c as well
        self._degrees = (*space.degrees[:2], max(space.degrees[2], _MOST_ORDER))
        nodes = [middle[:, k, None] + half[:, k, None] * _line(degree)[0] for k, degree in enumerate(self._degrees)]
        self._from_net = [_values(degree, own) for degree, own in zip(space.degrees, nodes, strict=True)]

        # over the nodes (n, 1, c, b, a)
        a, b, c = nodes
        self._share = (1 - c)[:, None, :, None, None] / 2
        self._along_z = ((1 + a)[:, None, None, None, :] / 2, (1 + b)[:, None, None, :, None] / 2)
        self._is_regular = middle[:, 2] + half[:, 2] < 1

    def ends(self, nets: Floats, directions: tuple[int, ...], less: float = 0.0) -> Interval:
        """Bounds as `Region.ends`, for P / s^k."""
        values = nets.reshape(len(nets), -1, *(degree + 1 for degree in self._given[::-1]))
        for direction, matrix in enumerate(self._from_net):
            values = _applied(matrix, values, direction)
        for order, direction in enumerate(directions):
            values = self._derivative(values, direction, order)
        if less:
            values = values - less * self._share ** len(directions)
        for direction, degree in enumerate(self._degrees):
            values = _applied(_line(degree)[2], values, direction)

        # quotients with the coefficients of s^k, which are all positive
        power = _applied(_line(self._degrees[2])[2], self._share ** len(directions), 2)
        flat = (values / power).reshape(*values.shape[:2], -1)
        low, high = flat.min(axis=2), flat.max(axis=2)
        shape = nets.shape[:-1]
        is_known = np.isfinite(low) & np.isfinite(high) & self._is_regular[:, None]
        return np.where(is_known, low, -np.inf).reshape(shape), np.where(is_known, high, np.inf).reshape(shape)

    def _derivative(self, values: Floats, direction: int, power: int) -> Floats:
        """Values of the next P, from values of one over a power of the share."""
        if direction < 2:
            return self._collapsed(values, direction)
        found = self._share * self._collapsed(values, 2) + 0.5 * power * values
        for k, weight in enumerate(self._along_z):
            found = found + weight * self._collapsed(values, k)
        return found

    def _collapsed(self, values: Floats, direction: int) -> Floats:
        """Values of the derivative along a, b or c."""
        slope = _applied(_line(self._degrees[direction])[1], values, direction)
        return np.asarray(slope / self._half[:, direction, None, None, None, None])


def _applied(matrix: Floats, grid: Floats, direction: int) -> Floats:
    """A matrix, one or (n, m, m), to one direction of grids (n, k, c, b, a)."""
    moved = np.moveaxis(grid, -1 - direction, -1)
    if matrix.ndim == 3:
        matrix = matrix[:, None, None, None]
    found = (matrix @ moved[..., None])[..., 0]
    return np.moveaxis(found, -1, -1 - direction)


@bounded_cache
def _line(degree: int) -> tuple[Floats, Floats, Floats]:
    """Nodes of a line, and matrices from values there to values of the derivative, and to Bernstein coefficients."""
    line = BernsteinSpace(Shape.SEGMENT, (degree,))
    nodes = net_of_xi(line)
    to_net = np.linalg.inv(bernstein_values(line, nodes))
    lower, gradient = gradient_nets(line)[0]
    slope = bernstein_values(lower, nodes) @ gradient.T @ to_net
    return frozen_floats(nodes[:, 0]), frozen_floats(slope), frozen_floats(to_net)


def _values(degree: int, places: Floats) -> Floats:
    """(n, m, degree + 1) the functions of a line at places (n, m)."""
    line = BernsteinSpace(Shape.SEGMENT, (degree,))
    return bernstein_values(line, places.reshape(-1, 1)).reshape(*places.shape, degree + 1)
