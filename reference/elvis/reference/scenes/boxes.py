"""Boxes of elements' collapsed coordinates with Chebyshev series of fields and places; halves of them overlap a little.

A curve along the border between two halves is thus inside one of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from elvis.core.base.arrays import Floats, Ints, grid_points
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.rows import Rows
from elvis.reference.scenes.equations import Linear
from elvis.reference.scenes.zeros import transform

#: part of a series that rounding may change; by how much halves extend over the middle
_ROUNDING, OVER = 1e-13, 1 / 32


@dataclass(frozen=True, eq=False)
class Boxes(Rows):
    """k boxes, t in [-1, 1]^d, with n functions on each.

    series   (k, n, c)  coefficients of tensor products of Chebyshev polynomials
    sizes    (k, n)     sums of magnitudes of the coefficients on the whole element
    halved   (k, d)     how often in each direction
    degrees  (d,)       in each direction
    """

    series: Floats
    sizes: Floats
    halved: Ints
    degrees: tuple[int, ...]

    @staticmethod
    def through(values: Floats, degrees: tuple[int, ...]) -> Boxes:
        """Whole elements, by values (k, n, c) at the nodes (see `nodes`)."""
        shape = tuple(degree + 1 for degree in degrees)
        series = values.reshape(*values.shape[:2], *shape)
        for axis, degree in enumerate(degrees):
            series = _along(series, axis, transform(degree))
        series = series.reshape(values.shape)
        return Boxes(series, np.abs(series).sum(axis=2), np.zeros((len(values), len(degrees)), np.int64), degrees)

    def halves(self, axis: int) -> Boxes:
        """The first and the second halves of all, along one direction."""
        shape = (*self.series.shape[:2], *(degree + 1 for degree in self.degrees))
        whole, parts = self.series.reshape(shape), _halving(self.degrees[axis])
        series = np.concatenate([_along(whole, axis, matrix) for matrix in parts])
        series = series.reshape(-1, *self.series.shape[1:])
        halved = np.tile(self.halved + (np.arange(len(self.degrees)) == axis), (2, 1))
        return Boxes(series, np.tile(self.sizes, (2, 1)), halved, self.degrees)

    @property
    def powers(self) -> Ints:
        """(c, d) degrees of each product."""
        return _powers(self.degrees)

    def combined(self, weights: Floats, constant: Floats | float = 0.0) -> Linear:
        """A combination of the functions, with weights (n,) or (k, n), and a constant (k,)."""
        weights = np.broadcast_to(weights, self.sizes.shape)
        series = np.einsum("kn,knc->kc", weights, self.series)
        value = series @ _middle(self.degrees) + constant
        first = self.powers.sum(axis=1) == 1
        gradient = series[:, first] @ self.powers[first]
        rest = self.beyond_linear(series).sum(axis=1)
        noise = _ROUNDING * ((np.abs(weights) * self.sizes).sum(axis=1) + np.abs(constant))
        return Linear(value, gradient, rest + noise)

    def beyond_linear(self, series: Floats) -> Floats:
        """(…, c) magnitudes of the products that aren't linear.

        Products that don't vanish at the centre count twice.
        """
        powers = self.powers
        even = (powers % 2 == 0).all(axis=1) & (powers.sum(axis=1) > 0)
        return np.abs(series) * np.where(powers.sum(axis=1) < 2, 0.0, 1.0 + even)


def nodes(degrees: tuple[int, ...]) -> Floats:
    """(c, d) points of [-1, 1]^d, at which values determine the series."""
    lines = [chebyshev.chebpts1(degree + 1) for degree in degrees]
    return grid_points(*lines)


def _along(series: Floats, axis: int, matrix: Floats) -> Floats:
    """Series (k, n, …) times a matrix (from, to) along one direction."""
    return np.moveaxis(np.moveaxis(series, axis + 2, -1) @ matrix, -1, axis + 2)


@bounded_cache
def _powers(degrees: tuple[int, ...]) -> Ints:
    ranges = [np.arange(degree + 1) for degree in degrees]
    return grid_points(*ranges)


@bounded_cache
def _middle(degrees: tuple[int, ...]) -> Floats:
    """(c,) values of the products at the centre: even degrees alternate in sign, the others vanish."""
    powers = _powers(degrees)
    even = (powers % 2 == 0).all(axis=1)
    return np.where(even, (-1.0) ** (powers.sum(axis=1) // 2), 0.0)


@bounded_cache
def _halving(degree: int) -> tuple[Floats, Floats]:
    """(n, n) from coefficients to those on [-1, OVER] and on [-OVER, 1]."""
    points = 0.5 * (1 + OVER) * chebyshev.chebpts1(degree + 1)
    middle = 0.5 * (1 - OVER)
    first, second = (chebyshev.chebvander(points + end, degree).T @ transform(degree) for end in (-middle, middle))
    return np.asarray(first), np.asarray(second)
