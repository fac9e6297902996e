"""Boxes of elements with Bernstein nets of what tells vortex cores, which can be halved and widened."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.polynomials.boxnets import all_half_boxes, all_halves, nets_through
from elvis.core.polynomials.net_zeros import divided
from elvis.core.polynomials.quadrature import gauss

#: how far nets may be off, in parts of their greatest coefficients
_ROUNDING = 1e-13
#: what counts as zero on a side, in parts of the greatest coefficient
_ZERO, _AT_REST = 1e-11, 1e-7
#: how many floats of nets are worked on at once, about
_AT_ONCE = 1 << 19


@dataclass(frozen=True, eq=False)
class Boxes:
    """Boxes in [0, 1]^3 of one cell of elements: rows (k,), ends (k, 3), Bernstein nets on them.

    above     (k, 3, …)  the velocity, or what it is above the denominator
    gradient  (k, 9, …)  of it
    crossed   (k, 3, …)  velocity x acceleration or rotation
    turned    (k, 3, …)  gradient times velocity; nothing where that is not needed
    crossed_error, turned_error (k, 3)  rounding of both
    least     (k,)       turning that counts
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
    least: Floats

    def __len__(self) -> int:
        return len(self.rows)

    @staticmethod
    def whole(rows: Ints, above: Floats, gradient: Floats, least: Floats, is_turned: bool) -> Boxes:
        """All of the cell of elements, from nets of velocity and gradient; crossed with acceleration or rotation."""
        above = _without_walls(above)
        own, product = above.shape[2] - 1, above.shape[2] + gradient.shape[2] - 2
        if is_turned:
            turned = through(_turned(at_nodes(gradient, product), at_nodes(above, product)), product)
            total = own + product
            crossed = through(_cross(at_nodes(above, total), at_nodes(_without_walls(turned), total)), total)
        else:
            turned = np.empty((len(rows), 0, 1, 1, 1))
            crossed = through(_cross(at_nodes(above, product), _rotation(at_nodes(gradient, product))), product)
        errors = [_ROUNDING * np.abs(net).max(axis=(2, 3, 4), initial=0.0) for net in (crossed, turned)]
        low = np.zeros((len(rows), 3))
        return Boxes(rows, low, low + 1, above, gradient, crossed, turned, errors[0], errors[1], least)

    def part(self, chosen: Ints | Bools) -> Boxes:
        """Some of them."""
        return Boxes(*(getattr(self, own.name)[chosen] for own in fields(self)))

    def halved(self) -> Boxes:
        """Both halves in every direction."""
        low, high = all_half_boxes(self.low, self.high)
        return Boxes(
            np.tile(self.rows, 8),
            low,
            high,
            _halved(self.above),
            _halved(self.gradient),
            _halved(self.crossed),
            _halved(self.turned),
            np.tile(self.crossed_error, (8, 1)),
            np.tile(self.turned_error, (8, 1)),
            np.tile(self.least, 8),
        )

    def widened(self, axis: int) -> Boxes:
        """Three times as wide across an axis, which becomes the last one; ``low`` and ``high`` stay."""
        nets = [np.moveaxis(own, 2 + axis, 4) for own in (self.above, self.gradient, self.crossed, self.turned)]
        above, gradient, crossed, turned = (_widened(_widened(own, 2), 3) for own in nets)
        return replace(self, above=above, gradient=gradient, crossed=crossed, turned=turned)

    def rest_at_corners(self) -> Bools:
        """(k,) whether the velocity is zero, to rounding, at a corner, and not all over the box."""
        ends = np.ix_(range(len(self)), range(3), *[[0, -1]] * 3)
        speeds = np.abs(self.above[ends]).max(axis=1).reshape(len(self), 8)
        return np.asarray(speeds.min(axis=1) <= _AT_REST * np.abs(self.above).max(axis=(1, 2, 3, 4), initial=0.0))

    @property
    def at_once(self) -> int:
        """How many boxes like these are worked on at once."""
        sizes = (self.above, self.gradient, self.crossed, self.turned)
        return max(1, _AT_ONCE // sum(int(np.prod(own.shape[1:])) for own in sizes))


def nodes_of(degree: int) -> Floats:
    """(degree + 1,) places in [0, 1] that polynomials are known by."""
    return np.asarray((1 + gauss(degree + 1)[0]) / 2)


def lattice_of(degree: int) -> Floats:
    """((degree + 1)^3, 3) the same in the unit cube, the last direction fastest."""
    return np.stack(np.meshgrid(*[nodes_of(degree)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)


def at_nodes(nets: Floats, degree: int) -> Floats:
    """(k, c, D, D, D) values of nets (k, c, …) at the nodes of a degree."""
    for axis in (2, 3, 4):
        table = line_tables(nets.shape[axis] - 1, nodes_of(degree))[0]
        nets = np.moveaxis(np.moveaxis(nets, axis, -1) @ table.T, -1, axis)
    return nets


def through(values: Floats, degree: int) -> Floats:
    """Nets (k, c, D, D, D) with values (k, c, …) at the nodes of a degree."""
    shape = (*values.shape[:2], *(degree + 1,) * 3)
    return nets_through(values.reshape(-1, (degree + 1) ** 3), nodes_of(degree), 3).reshape(shape)


def flat(nets: Floats) -> Floats:
    """(k, c, D^3) coefficients of nets (k, c, …)."""
    return nets.reshape(*nets.shape[:2], int(np.prod(nets.shape[2:])))


def _without_walls(nets: Floats) -> Floats:
    """Nets of vectors divided by the heights over sides of boxes where these are zero, as on walls.

    Their directions are the same, and so are those of their products with the gradient.
    """
    nets = nets.copy()
    sizes = np.abs(nets).max(axis=(1, 2, 3, 4), initial=0.0)
    for axis in range(3):
        for end in (0, 1):
            moved = np.moveaxis(nets, 2 + axis, -1)
            moved = moved[..., ::-1] if end else moved
            rest = np.abs(moved[..., 0]).max(axis=(1, 2, 3), initial=0.0) <= _ZERO * sizes
            quotient = divided(moved[rest], moved.shape[-1] - 1)
            nets[rest] = np.moveaxis(quotient[..., ::-1] if end else quotient, -1, 2 + axis)
    return nets


def _halved(nets: Floats) -> Floats:
    if not nets.shape[1]:
        return np.tile(nets, (8, 1, 1, 1, 1))
    return all_halves(nets.reshape(-1, *nets.shape[2:])).reshape(-1, *nets.shape[1:])


def _widened(nets: Floats, axis: int) -> Floats:
    """Nets on [-1, 2] in one direction, of those on [0, 1]."""
    degree = nets.shape[axis] - 1
    nodes = nodes_of(degree)
    inverse = np.linalg.inv(line_tables(degree, nodes)[0])
    matrix = inverse @ line_tables(degree, 3 * nodes - 1)[0]
    return np.asarray(np.moveaxis(np.moveaxis(nets, axis, -1) @ matrix.T, -1, axis))


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
