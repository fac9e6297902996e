"""Lower bounds of polynomials that are close to their minimum along a line or a surface: p = e + sum q_i^2 + rest.

Bisecting boxes cannot follow such valleys, since the boxes along them are too many.  For any polynomials q_i, p is
nowhere less than the smallest Bernstein coefficient of p - sum q_i^2.  They start as the square roots of the Taylor
polynomial of degree 2 at the smallest value known.  Gauss-Newton steps then fit them to p on the whole box (sums of
squares of low rank: Burer and Monteiro, Math.  Program. 95, 2003).  The bound is valid even if the fit is poor.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from heapq import heappop, heappush
from itertools import count
from math import comb
from typing import NamedTuple

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, grid_points
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.polynomials.boxnets import halves, power_net

#: largest degree of a square root in each direction, and points in each direction at which it is fitted
_DEGREE, _POINTS = 3, 7
#: curvatures that count, as a part of the largest one
_CURVED = 1e-4
#: distances beyond which points count less, for the Gauss-Newton steps of a fit
_RADII = (0.2, 0.2, 0.4, 0.4, 0.8, 0.8, *[np.inf] * 16)
#: Newton steps to a local minimum, and halvings of each
_STEPS, _HALVINGS = 16, 8
#: boxes of one polynomial that are tried
_MOST_BOXES = 16
_UNIT = np.finfo(np.float64).eps / 2


class Minimum(NamedTuple):
    """A value that a polynomial attains at a place (d,) of the box [0, 1]^d."""

    value: float
    place: Floats


def descended(net: Floats, start: Floats) -> Minimum:
    """The value at the end of a descent in the box from ``start`` (d,), at most the value there.

    Newton's method with the absolute values of the Hessian's eigenvalues, in the directions in which the box does not
    end there; a step is bisected until it descends.
    """
    place, (value, gradient, hessian) = start, _taylor(net, start)
    for _ in range(_STEPS):
        free = np.flatnonzero(~(((place <= 0.0) & (gradient >= 0.0)) | ((place >= 1.0) & (gradient <= 0.0))))
        step = np.zeros(len(place))
        step[free] = _downwards(gradient[free], hessian[np.ix_(free, free)])
        there = next((there for there in _shorten(place, step) if _value(net, there) < value), None)
        if there is None:
            break
        place, (value, gradient, hessian) = there, _taylor(net, there)
    return Minimum(value, place)


def _downwards(gradient: Floats, hessian: Floats) -> Floats:
    """(k,) Newton's step, along which the value decreases for any signs of the Hessian's eigenvalues."""
    curvature, axes = np.linalg.eigh(hessian)
    size = np.abs(curvature)
    size = np.maximum(size, 1e-12 * size.max(initial=0.0) + 1e-300)
    return np.asarray(-axes @ ((axes.T @ gradient) / size))


def _shorten(place: Floats, step: Floats) -> Iterator[Floats]:
    """Places in the box at the end of a step, of half the step, and so on."""
    for halving in range(_HALVINGS):
        yield np.clip(place + step / 2**halving, 0.0, 1.0)


def lower_bound(net: Floats, goal: float) -> float:
    """A lower bound of the polynomial with a box net (D1, …, Dd), at least ``goal`` if that can be shown.

    The box with the lowest bound is bisected, again and again.
    """
    number = count()  # the first of equal bounds, as arrays cannot be compared
    boxes = [(_bound(net, goal), next(number), net)]
    while boxes[0][0] < goal and len(boxes) < _MOST_BOXES:
        bound, _, box = heappop(boxes)
        for half in _halves(box):
            heappush(boxes, (max(bound, _bound(half, goal)), next(number), half))
    return boxes[0][0]


def _bound(net: Floats, goal: float) -> float:
    """The smallest coefficient, with squares subtracted where it is below the goal."""
    lowest = float(net.min())
    return lowest if lowest >= goal else max(lowest, _without_squares(net))


def _halves(net: Floats) -> list[Floats]:
    """Both halves of a box across the direction in which it is most nonlinear."""
    bends = [np.abs(np.diff(net, 2, axis=axis)).max(initial=0.0) * net.shape[axis] for axis in range(net.ndim)]
    return [half[0] for half in halves(net[None], int(np.argmax(bends)))]


def _without_squares(net: Floats) -> float:
    """The smallest coefficient of p minus fitted squares, reduced by rounding."""
    degrees = tuple(min((size - 1) // 2, _DEGREE) for size in net.shape)
    basis = _basis(degrees)
    values = _contract(net, [line_tables(size - 1, _nodes())[0] for size in net.shape]).reshape(-1)
    roots, near = _start(net, values)
    if not len(roots):
        return -np.inf

    coefficients = _fit_squares(values, basis, roots @ _elevated_linears(degrees), near)
    roots = coefficients.reshape(-1, *(degree + 1 for degree in degrees))
    rest, sizes = net.copy(), np.abs(net).max()
    for root in roots:
        square = _square(root)
        rest -= _enlarge(square, net.shape)
        sizes += np.abs(root).max() ** 2
    rounding = 4 * (basis.shape[1] + sum(net.shape)) * _UNIT * sizes
    return float(rest.min() - rounding)


def _fit_squares(values: Floats, basis: Floats, roots: Floats, near: Floats) -> Floats:
    """Coefficients (k, m) of polynomials q_i with p = e + sum q_i^2 at the nodes, as nearly as can be.

    Gauss-Newton steps for e and the coefficients; the nodes count all alike in the end, those nearby most at first.
    """
    least = values.min()
    for radius in _RADII:
        at_nodes = basis @ roots.T
        rest = values - least - (at_nodes**2).sum(axis=1)
        gradients = [2 * at_nodes[:, i, None] * basis for i in range(len(roots))]
        matrix = np.concatenate([np.ones((len(values), 1)), *gradients], axis=1)
        weights = 1 / (1 + (near / radius) ** 4)
        normal = matrix.T @ (weights[:, None] * matrix)
        ridge = 1e-13 * np.trace(normal) * np.eye(len(normal))
        change = np.linalg.solve(normal + ridge, matrix.T @ (weights * rest))
        least += change[0]
        roots = roots + change[1:].reshape(roots.shape)
    return roots


def _start(net: Floats, values: Floats) -> tuple[Floats, Floats]:
    """(k, 1 + d) linear polynomials c + g . t whose squares form the Taylor polynomial at the minimum of some values.

    The second result is the distances (n,) of the nodes from that place.
    """
    nodes = _nodes()
    best = np.unravel_index(int(values.argmin()), (len(nodes),) * net.ndim)
    place = descended(net, nodes[list(best)]).place
    curvature, axes = np.linalg.eigh(_taylor(net, place)[2])
    chosen = curvature > _CURVED * np.abs(curvature).max()
    gradients = np.sqrt(curvature[chosen] / 2)[:, None] * axes.T[chosen]
    grid = grid_points(*[nodes] * net.ndim)
    return np.concatenate([-gradients @ place[:, None], gradients], axis=1), np.linalg.norm(grid - place, axis=1)


def _taylor(net: Floats, place: Floats) -> tuple[float, Floats, Floats]:
    """Value, gradient (d,) and Hessian (d, d) at a place (d,)."""
    tables = _tables(net, place)
    unit = np.eye(net.ndim, dtype=np.int64)
    gradient = np.array([_derivative(net, tables, row) for row in unit])
    hessian = np.array([[_derivative(net, tables, row + other) for other in unit] for row in unit])
    return _derivative(net, tables, 0 * unit[0]), gradient, hessian


def _value(net: Floats, place: Floats) -> float:
    for size, t in zip(net.shape, place, strict=True):
        net = np.tensordot(line_tables(size - 1, t[None])[0, 0], net, axes=(0, 0))
    return float(net)


def _tables(net: Floats, place: Floats) -> list[Floats]:
    """For each direction the Bernstein polynomials and their derivatives (3, D) at a coordinate."""
    return [line_tables(size - 1, t[None], 2)[:, 0] for size, t in zip(net.shape, place, strict=True)]


def _derivative(net: Floats, tables: list[Floats], orders: Ints) -> float:
    """The derivative of these orders, at the place of the tables."""
    for table, order in zip(tables, orders, strict=True):
        net = np.tensordot(table[order], net, axes=(0, 0))
    return float(net)


def _nodes() -> Floats:
    """(n,) Chebyshev points of [0, 1]."""
    return (1 + np.cos(np.pi * (2 * np.arange(_POINTS) + 1) / (2 * _POINTS))) / 2


def _contract(net: Floats, matrices: list[Floats]) -> Floats:
    """A net with a matrix applied along each axis."""
    for axis, matrix in enumerate(matrices):
        net = np.moveaxis(np.tensordot(matrix, net, axes=(1, axis)), 0, axis)
    return net


@bounded_cache
def _basis(degrees: tuple[int, ...]) -> Floats:
    """(n, m) values of the tensor Bernstein polynomials at the grid of nodes."""
    tables = [line_tables(degree, _nodes())[0] for degree in degrees]
    return frozen_floats(reduce(np.kron, tables))


@bounded_cache
def _elevated_linears(degrees: tuple[int, ...]) -> Floats:
    """(1 + d, m) tensor Bernstein coefficients of 1, t1, …, td; a coordinate of degree 0 is taken at the middle."""
    lines = [np.arange(degree + 1) / degree if degree else np.array([0.5]) for degree in degrees]
    grids = np.meshgrid(*lines, indexing="ij")
    return frozen_floats([np.ones(grids[0].size), *(grid.reshape(-1) for grid in grids)])


def _square(net: Floats) -> Floats:
    """The net of the square of a polynomial: coefficients times binomials are convolved."""
    scaled = net * _binomials(net.shape)
    result = np.zeros([2 * size - 1 for size in net.shape])
    for index in np.ndindex(net.shape):
        place = tuple(slice(i, i + size) for i, size in zip(index, net.shape, strict=True))
        result[place] += scaled[index] * scaled
    return result / _binomials(result.shape)


@bounded_cache
def _binomials(shape: tuple[int, ...]) -> Floats:
    lines = [np.array([float(comb(size - 1, k)) for k in range(size)]) for size in shape]
    return frozen_floats(reduce(np.multiply.outer, lines))


def _enlarge(net: Floats, shape: tuple[int, ...]) -> Floats:
    """The polynomial with a net of a larger shape."""
    return _contract(net, [_raising(size, target) for size, target in zip(net.shape, shape, strict=True)])


@bounded_cache
def _raising(size: int, target: int) -> Floats:
    return frozen_floats(np.array([power_net(k, size - 1, target - 1) for k in range(size)]).T)
