"""Boxes of elements with the Bernstein nets that locate vortex cores; they can be bisected and widened."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import comb

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats, grid_points
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.rows import Rows
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.polynomials.boxnets import nets_through
from elvis.core.polynomials.net_zeros import without_walls
from elvis.core.polynomials.quadrature import gauss

#: rounding of nets, relative to their largest coefficients
_ROUNDING = 1e-13
#: velocity relative to the largest coefficient that counts as rest
_AT_REST = 1e-7
#: approximate number of floats of nets processed at once
_AT_ONCE = 1 << 19


@dataclass(frozen=True, eq=False)
class Boxes(Rows):
    """Boxes in [0, 1]^3 of one cell of elements: rows (k,), ends (k, 3), Bernstein nets on them.

    above     (k, 3, …) the velocity, or its numerator if it is a quotient
    gradient  (k, 9, …)  of it
    crossed   (k, 3, …)  velocity x acceleration or rotation
    turned    (k, 3, …) gradient times velocity; empty if not needed
    crossed_error, turned_error (k, 3)  rounding of both
    square, cubic (k, 1, …)  y and r of the gradient, as in `turning`
    scale     (k,) the largest norm of the gradient in its element
    least     (k,) minimum turning that counts
    """

    rows: Ints
    low: Floats
    high: Floats
    above: Floats
    gradient: Floats
    crossed: Floats
    turned: Floats
    crossed_error: Floats
    turned_error: Floats
    square: Floats
    cubic: Floats
    scale: Floats
    least: Floats

    @staticmethod
    def whole(rows: Ints, above: Floats, gradient: Floats, least: Floats, is_turned: bool) -> Boxes:
        """All of the cell of elements, from nets of velocity and gradient; crossed with acceleration or rotation."""
        above = without_walls(above, _sizes(above))[0]
        turned = np.empty((len(rows), 0, 1, 1, 1))
        if is_turned:
            turned = combined(_turned, gradient, above)
            crossed = combined(_cross, above, without_walls(turned, _sizes(turned))[0])
        else:
            crossed = combined(_cross, above, _rotation(gradient))
        errors = [_ROUNDING * np.abs(net).max(axis=(2, 3, 4), initial=0.0) for net in (crossed, turned)]
        low = np.zeros((len(rows), 3))
        scale = np.linalg.norm(gradient, axis=1).max(axis=(1, 2, 3), initial=0.0)
        known = errors[0], errors[1], *invariants(gradient), scale
        return Boxes(rows, low, low + 1, above, gradient, crossed, turned, *known, least)

    def halved(self, axis: int) -> Boxes:
        """Both halves in one direction."""
        middle = (self.low[:, axis] + self.high[:, axis]) / 2
        upper, lower = self.low.copy(), self.high.copy()
        upper[:, axis], lower[:, axis] = middle, middle
        both = np.tile(np.arange(len(self)), 2)
        return Boxes(
            self.rows[both],
            np.concatenate([self.low, upper]),
            np.concatenate([lower, self.high]),
            _halved(self.above, axis),
            _halved(self.gradient, axis),
            _halved(self.crossed, axis),
            _halved(self.turned, axis),
            self.crossed_error[both],
            self.turned_error[both],
            _halved(self.square, axis),
            _halved(self.cubic, axis),
            self.scale[both],
            self.least[both],
        )

    def widened(self, axis: int) -> Boxes:
        """Three times as wide across an axis, which becomes the last one; ``low`` and ``high`` stay."""
        nets = [np.moveaxis(own, 2 + axis, 4) for own in (self.above, self.gradient, self.crossed, self.turned)]
        above, gradient, crossed, turned = map(_widened, nets)
        return replace(self, above=above, gradient=gradient, crossed=crossed, turned=turned)

    def rest_at_corners(self) -> Bools:
        """(k,) whether the velocity is zero, to rounding, at a corner, and not all over the box."""
        ends = np.ix_(range(len(self)), range(3), *[[0, -1]] * 3)
        speeds = np.abs(self.above[ends]).max(axis=1).reshape(len(self), 8)
        return np.asarray(speeds.min(axis=1) <= _AT_REST * np.abs(self.above).max(axis=(1, 2, 3, 4), initial=0.0))

    @property
    def at_once(self) -> int:
        """Number of boxes of this kind that are processed at once."""
        sizes = (self.above, self.gradient, self.crossed, self.turned, self.square, self.cubic)
        return max(1, _AT_ONCE // sum(int(np.prod(own.shape[1:])) for own in sizes))


@bounded_cache
def nodes_of(degree: int) -> Floats:
    """(degree + 1,) places in [0, 1] that polynomials are known by."""
    return frozen_floats((1 + gauss(degree + 1)[0]) / 2)


@bounded_cache
def _evaluating(own: int, degree: int) -> Floats:
    """(own + 1, degree + 1) matrix from the right that takes coefficients of a degree to values at nodes of another."""
    return frozen_floats(line_tables(own, nodes_of(degree))[0].T)


@bounded_cache
def _stretching(degree: int, end: float) -> Floats:
    """(degree + 1, degree + 1) matrix from the right from coefficients on [0, 1] to those on [0, end]."""
    rows = [
        [comb(j, i) * end**i * (1 - end) ** (j - i) if i <= j else 0.0 for j in range(degree + 1)]
        for i in range(degree + 1)
    ]
    return frozen_floats(rows)


def lattice_of(degree: int) -> Floats:
    """((degree + 1)^3, 3) the nodes in the unit cube, the last direction fastest."""
    return grid_points(*[nodes_of(degree)] * 3)


def at_nodes(nets: Floats, degree: int) -> Floats:
    """(k, c, D, D, D) values of nets (k, c, …) at the nodes of a degree."""
    for axis in (2, 3, 4):
        nets = _along(nets, axis, _evaluating(nets.shape[axis] - 1, degree))
    return nets


def through(values: Floats, degree: int) -> Floats:
    """Nets (k, c, D, D, D) with values (k, c, …) at the nodes of a degree."""
    shape = (*values.shape[:2], *(degree + 1,) * 3)
    return nets_through(values.reshape(-1, (degree + 1) ** 3), nodes_of(degree), 3).reshape(shape)


def _along(nets: Floats, axis: int, matrix: Floats) -> Floats:
    """Nets times a matrix in one direction."""
    return np.asarray(np.moveaxis(np.moveaxis(nets, axis, -1) @ matrix, -1, axis))


def flat(nets: Floats) -> Floats:
    """(k, c, D^3) coefficients of nets (k, c, …)."""
    return nets.reshape(*nets.shape[:2], int(np.prod(nets.shape[2:])))


def _sizes(nets: Floats) -> Floats:
    """(k,) the largest coefficients of nets (k, c, …)."""
    return np.asarray(np.abs(nets).max(axis=(1, 2, 3, 4), initial=0.0))


def _halved(nets: Floats, axis: int) -> Floats:
    """Nets (2k, c, …) of lower halves, then of upper ones."""
    degree = nets.shape[2 + axis] - 1
    lower = _stretching(degree, 0.5)
    return np.concatenate([_along(nets, 2 + axis, own) for own in (lower, lower[::-1, ::-1])])


def _widened(nets: Floats) -> Floats:
    """Nets on [-1, 2] in the first two directions, of those on [0, 1]: by way of [0, 2]."""
    for axis in (2, 3):
        degree = nets.shape[axis] - 1
        matrix = _stretching(degree, 2.0) @ _stretching(degree, 1.5)[::-1, ::-1]
        nets = _along(nets, axis, matrix)
    return nets


def combined(function: Callable[..., Floats], *nets: Floats) -> Floats:
    """Nets of a function of values (k, c, …), linear in each, from nets of these: through its values at the nodes.

    Coefficients may have larger errors; the polynomial that they represent only has the rounding of values.
    """
    degree = sum(own.shape[2] - 1 for own in nets)
    return through(function(*(at_nodes(own, degree) for own in nets)), degree)


def _turned(gradient: Floats, above: Floats) -> Floats:
    """Matrices times vectors, as values (k, 9, …) and (k, 3, …)."""
    matrices = gradient.reshape(len(gradient), 3, 3, *gradient.shape[2:])
    return np.asarray(np.einsum("kij...,kj...->ki...", matrices, above))


def _rotation(gradient: Floats) -> Floats:
    """Rotations (k, 3, …) of gradients (k, 9, …)."""
    pairs = ((7, 5), (2, 6), (3, 1))
    return np.stack([gradient[:, i] - gradient[:, j] for i, j in pairs], axis=1)


def _cross(one: Floats, other: Floats) -> Floats:
    """Vector products of (k, 3, …)."""
    return np.cross(one, other, axis=1)


def invariants(gradient: Floats) -> tuple[Floats, Floats]:
    """Nets (k, 1, …) of tr A^2 / 2 and of det A, with A matrices (k, 9, …) less a third of their trace."""
    rows = gradient.copy()
    rows[:, ::4] -= gradient[:, ::4].sum(axis=1, keepdims=True) / 3
    return combined(_half_square, rows, rows), combined(_determinant, *[rows] * 3)


def _half_square(one: Floats, other: Floats) -> Floats:
    """(k, 1, …) half the traces of products of matrices (k, 9, …)."""
    return (one * other[:, [0, 3, 6, 1, 4, 7, 2, 5, 8]]).sum(axis=1, keepdims=True) / 2


def _determinant(*rows: Floats) -> Floats:
    """(k, 1, …) of matrices (k, 9, …), whose rows are of one each."""
    first, second, third = (own[:, 3 * k : 3 * k + 3] for k, own in enumerate(rows))
    return (first * _cross(second, third)).sum(axis=1, keepdims=True)
