"""The search of whole elements for a point: it finds the root, or proves that there is none.

The map minus the point is kept as a tensor Bernstein net over boxes of the reference element, which are cut to where a
root can be and halved where that doesn't help (the box consistency of Bezier clipping: Mourrain and Pavone, Subdivision
methods for solving polynomial equations, 2009).  Boxes live in s = (1 + xi)/2; on pyramids, whose maps aren't
polynomials in xi, in s = (1 + eta)/2.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints, frozen_floats
from elvis.core.dataset import Expansion
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.newton import Targets, newton
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.tangents import duals
from elvis.core.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_space, bernstein_values, to_bernstein
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.shapes import Shape

_ROUNDS = 200
_BATCH = 1 << 21
_MOST_CELLS = 1 << 12
_SMALLEST = 1e-13
#: roundings of world coordinates across the image of a cell whose points are not told apart
_ONE_POINT = 16

#: directions whose s add up to at most 1
_SIMPLEX = {Shape.TRIANGLE: [0, 1], Shape.TETRAHEDRON: [0, 1, 2], Shape.PRISM: [0, 2]}


def search(targets: Targets) -> tuple[Floats, Bools, Bools]:
    """Reference points (n, d), whether they are roots inside (n,), and whether nothing could be decided (n,).

    Where neither holds the element has no root with a margin of -1e-10 or more, whatever rounding did.
    """
    reference = np.full((len(targets), targets.patch.shape.dimension), np.nan)
    found, undecided = np.zeros((2, len(targets)), bool)
    step = max(64, _BATCH // (24 * _matrix(targets.patch.geometry)[0].shape[1]))
    for part in chunks(len(targets), step):
        run = _Search(targets.part(np.arange(part.start, part.stop)))
        reference[part], found[part], undecided[part] = run.reference, run.found, run.undecided
    return reference, found, undecided


def hulls(patch: Patch, row: int, count: int) -> tuple[Floats, Floats]:
    """Low and high corners (k, 3) of boxes that together hold an element, in ``count`` parts in each direction."""
    matrix, degrees = _matrix(patch.geometry)
    nets = (patch.geometry_coefficients[[row]] @ matrix).reshape(1, 3, *(degree + 1 for degree in degrees[::-1]))
    ends = np.linspace(-TOLERANCE, 1 + TOLERANCE, count + 1)
    low = np.empty((1, 0))
    for i, degree in enumerate(degrees):
        own = np.tile(np.eye(degree + 1), (count, 1, 1))
        own = _left_of(_right_of(own, -1, ends[:-1]), -1, np.diff(ends) / (1 - ends[:-1]))
        parts = np.einsum("...i,sij->s...j", np.moveaxis(nets, -1 - i, -1), own, optimize=True)
        nets = np.moveaxis(parts, -1, -1 - i).reshape(-1, *nets.shape[1:])
        low = np.column_stack([np.tile(low, (count, 1)), np.repeat(ends[:-1], len(low))])
    if patch.shape in _SIMPLEX:
        nets = nets[low[:, _SIMPLEX[patch.shape]].sum(axis=1) <= 1 + 1e-9]
    axes = tuple(range(2, nets.ndim))
    return nets.min(axis=axes), nets.max(axis=axes)


@dataclass(frozen=True, eq=False)
class _Cells:
    """Boxes that may hold roots.

    pair       (c,)         number of the target
    low, high  (c, d)       corners in s
    net        (c, 3, ...)  Bernstein coefficients of map minus point, direction i along axis -1 - i
    """

    pair: Ints
    low: Floats
    high: Floats
    net: Floats

    def __len__(self) -> int:
        return len(self.pair)

    def part(self, chosen: Ints | Bools) -> _Cells:
        return _Cells(self.pair[chosen], self.low[chosen], self.high[chosen], self.net[chosen])


class _Search:
    """One batch of targets and the results for them."""

    def __init__(self, targets: Targets) -> None:
        self.targets, self.shape = targets, targets.patch.shape
        self.reference = np.full((len(targets), self.shape.dimension), np.nan)
        self.found, self.undecided = np.zeros((2, len(targets)), bool)
        cells = self._whole()
        for _ in range(_ROUNDS):
            if not len(cells):
                return
            cells = self._given_up(self._round(cells))
        self.undecided[cells.pair] = True

    def _whole(self) -> _Cells:
        """Every element as one cell, larger by the tolerance."""
        targets = self.targets
        matrix, degrees = _matrix(targets.patch.geometry)
        net = (targets.patch.geometry_coefficients[targets.rows] @ matrix) - targets.points[:, :, None]
        net = net.reshape(len(targets), 3, *(degree + 1 for degree in degrees[::-1]))
        low, high = np.zeros((2, len(targets), len(degrees)))
        cells = _Cells(np.arange(len(targets)), low, high + 1, net)
        return _cut(cells, low - TOLERANCE, high + 1 + TOLERANCE)

    def _round(self, cells: _Cells) -> _Cells:
        """Cut all cells to where roots can be, seek roots from nearly linear ones, halve those still as large."""
        lower, upper, linear = _contraction(cells, self._slack(cells))
        possible = np.asarray((lower <= upper).all(axis=1))
        if self.shape in _SIMPLEX:
            ends = cells.low + lower * (cells.high - cells.low)
            possible &= ends[:, _SIMPLEX[self.shape]].sum(axis=1) <= 1 + TOLERANCE
        large: Bools = ((upper - lower).max(axis=1) > 0.5)[possible]
        cells = _cut(cells.part(possible), lower[possible], upper[possible])
        going = self._seek(cells, linear[possible])
        return _join(cells.part(going & ~large), *_halves(cells.part(going & large), self.shape))

    def _slack(self, cells: _Cells) -> Floats:
        """(c,) distance from zero within which the net may be at a root."""
        return np.maximum(self.targets.precision, self.targets.distance)[cells.pair]

    def _seek(self, cells: _Cells, linear: Bools) -> Bools:
        """(c,) whether cells are still in question after Newton's method from the small, nearly linear ones."""
        width = (cells.high - cells.low).max(axis=1, initial=0)
        ready = np.flatnonzero(linear & (width < 0.1))
        middles = cells.low[ready] + cells.high[ready] - 1
        starts = uncollapse(self.shape, middles) if self.shape is Shape.PYRAMID else middles
        feet = newton(self.targets.part(cells.pair[ready]), starts)
        self.reference[cells.pair[ready[feet.inside]]] = feet.reference[feet.inside]
        self.found[cells.pair[ready[feet.inside]]] = True

        # cells cannot shrink below rounding: all their points are one, and what is found from there decides on it
        going = ~self.found[cells.pair]
        spans = np.ptp(cells.net[ready], axis=tuple(range(2, cells.net.ndim))).max(axis=1, initial=0)
        going[ready[feet.converged & (spans <= _ONE_POINT * self.targets.rounding[cells.pair[ready]])]] = False

        # on curves and surfaces a foot near a tiny cell is the result for it: cells cannot shrink below the distance
        if self.shape.dimension < 3:
            near = np.abs(feet.reference - starts).max(axis=1, initial=0) < 0.01
            going[ready[feet.converged & near & (width[ready] < 1e-3)]] = False
        return going

    def _given_up(self, cells: _Cells) -> _Cells:
        """Leave out pairs with cells too small or too many to go on."""
        small = (cells.high - cells.low).max(axis=1, initial=0) < _SMALLEST
        many = np.bincount(cells.pair, minlength=len(self.targets)) > _MOST_CELLS
        self.undecided[cells.pair[small]] = True
        self.undecided |= many & ~self.found
        return cells.part(~self.undecided[cells.pair])


def _contraction(cells: _Cells, slack: Floats) -> tuple[Floats, Floats, Bools]:
    """Where in each cell, from 0 to 1 in each direction, roots can be: ``lower`` to ``upper`` (c, d), none if reversed.

    With the inverse A of the mean Jacobian, A times the net is t + e(t); a root has t = -e(t), in the range of -e.  The
    map is called nearly linear, the third result (c,), where e varies by half the cell at most.
    """
    axes = tuple(range(2, cells.net.ndim))
    jacobians = np.stack([span.mean(axis=axes[:-1]) for span in _spans(cells)], axis=2)
    inverse = duals(jacobians)
    with np.errstate(invalid="ignore", over="ignore"):
        rest = np.einsum("cai,ca...->ci...", inverse, cells.net)
        for i in range(len(axes)):
            rest[:, i] -= np.linspace(0, 1, rest.shape[-1 - i]).reshape(-1, *[1] * i)
        least, most = rest.min(axis=axes), rest.max(axis=axes)
        linear = (most - least <= 0.5).all(axis=1)
        allowance = slack[:, None] * np.abs(inverse).sum(axis=1)
        lower, upper = -most - allowance, -least + allowance
    lower, upper = np.where(np.isfinite(lower), lower, 0.0), np.where(np.isfinite(upper), upper, 1.0)
    away = (cells.net.min(axis=axes) > slack[:, None]) | (cells.net.max(axis=axes) < -slack[:, None])
    empty = away.any(axis=1, keepdims=True) | (lower > 1) | (upper < 0)
    lower, upper = np.clip(lower, 0.0, 1 - _SMALLEST), np.clip(upper, _SMALLEST, 1.0)
    return np.where(empty, 1.0, lower), np.where(empty, 0.0, upper), linear


def _spans(cells: _Cells) -> list[Floats]:
    """For each direction the difference of the net's last and first layers."""
    axes = [-1 - i for i in range(cells.low.shape[1])]
    return [np.asarray(cells.net.take(-1, axis) - cells.net.take(0, axis)) for axis in axes]


def _cut(cells: _Cells, lower: Floats, upper: Floats) -> _Cells:
    """The cells between ``lower`` and ``upper`` (c, d), in parts of each cell, by de Casteljau's scheme."""
    net = cells.net
    for i in range(lower.shape[1]):
        net = _right_of(net, -1 - i, lower[:, i])
        net = _left_of(net, -1 - i, (upper[:, i] - lower[:, i]) / (1 - lower[:, i]))
    width = cells.high - cells.low
    return _Cells(cells.pair, cells.low + lower * width, cells.low + upper * width, net)


def _right_of(net: Floats, axis: int, t: Floats) -> Floats:
    """Bernstein coefficients over [t, 1] of one direction."""
    points = np.moveaxis(net, axis, 1).copy()
    t = t.reshape(-1, *[1] * (net.ndim - 1))
    for level in range(1, points.shape[1]):
        points[:, :-level] += t * (points[:, 1 : points.shape[1] - level + 1] - points[:, :-level])
    return np.moveaxis(points, 1, axis)


def _left_of(net: Floats, axis: int, t: Floats) -> Floats:
    """Bernstein coefficients over [0, t] of one direction."""
    return np.flip(_right_of(np.flip(net, axis), axis, 1 - t), axis)


def _halves(cells: _Cells, shape: Shape) -> tuple[_Cells, _Cells]:
    """Both halves of the cells, cut where their image is longest; at the apex of a pyramid, across its axis."""
    dimension = cells.low.shape[1]
    axes = tuple(range(1, dimension + 1))
    lengths = np.stack([np.ptp(cells.net, axis=-1 - i).max(axis=axes) for i in range(dimension)], axis=1)
    longest = np.argmax(lengths, axis=1)
    if shape is Shape.PYRAMID:
        longest = np.where(cells.high[:, 2] >= 1, 2, longest)
    across = np.arange(dimension) == longest[:, None]
    zero, one = np.zeros_like(cells.low), np.ones_like(cells.low)
    return _cut(cells, zero, np.where(across, 0.5, one)), _cut(cells, np.where(across, 0.5, zero), one)


def _join(*several: _Cells) -> _Cells:
    return _Cells(
        np.concatenate([cells.pair for cells in several]),
        np.concatenate([cells.low for cells in several]),
        np.concatenate([cells.high for cells in several]),
        np.concatenate([cells.net for cells in several]),
    )


@lru_cache(maxsize=64)
def _matrix(expansion: Expansion) -> tuple[Floats, tuple[int, ...]]:
    """Matrix (m, count) from modes to a tensor Bernstein net over the whole box, and the degree in each direction."""
    space = bernstein_space(expansion)
    matrix, degrees = to_bernstein(expansion, space), space.degrees
    if expansion.shape in _SIMPLEX:
        degrees = _tensor_degrees(space)
        matrix = matrix @ _tensor(space, degrees)
    return frozen_floats(matrix), degrees


def _tensor_degrees(space: BernsteinSpace) -> tuple[int, ...]:
    first, *rest = space.degrees
    return (first, rest[0], first) if space.shape is Shape.PRISM else (first,) * space.shape.dimension


def _tensor(space: BernsteinSpace, degrees: tuple[int, ...]) -> Floats:
    """(count, tensor count) functions of a simplex or prism as tensor nets, by interpolation at Chebyshev points."""
    lines = [np.cos((2 * np.arange(degree, -1, -1) + 1) * np.pi / (2 * degree + 2)) for degree in degrees]
    points = np.stack(np.meshgrid(*lines[::-1], indexing="ij")[::-1], axis=-1).reshape(-1, len(degrees))
    result = bernstein_values(space, points).T.reshape(-1, *(degree + 1 for degree in degrees[::-1]))
    for i, (line, degree) in enumerate(zip(lines, degrees, strict=True)):
        inverse = np.linalg.inv(bernstein_values(BernsteinSpace(Shape.SEGMENT, (degree,)), line[:, None]))
        result = np.moveaxis(np.moveaxis(result, -1 - i, -1) @ inverse.T, -1, -1 - i)
    return np.ascontiguousarray(result.reshape(len(result), -1))
