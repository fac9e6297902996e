"""The search of whole elements for a point: it finds the root, or proves that there is none.

The map minus the point is a tensor Bernstein net over boxes of the reference element.  Boxes are cut to the region that
can contain a root, and bisected if that doesn't help (the box consistency of Bezier clipping: Mourrain and Pavone,
Subdivision methods for solving polynomial equations, 2009).  Boxes live in s = (1 + xi)/2; on pyramids, whose maps
aren't polynomials in xi, in s = (1 + eta)/2.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.data.dataset import Expansion
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.newton import Targets, newton
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.tangents import duals
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_space, bernstein_values, to_bernstein
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.kronecker import along_directions, product_points
from elvis.core.polynomials.row_products import row_products
from elvis.core.shapes import Shape

_ROUNDS = 200
#: rounds after which most cells without a root are excluded
_FEW_ROUNDS = 6
_BATCH = 1 << 21
_MOST_CELLS = 1 << 12
#: numbers in the nets of the cells that are cut together
_MOST_NUMBERS = 1 << 23
_SMALLEST = 1e-13
#: roundings of world coordinates across the image of a cell below which its points are not distinguished
_ONE_POINT = 16

#: directions whose s add up to at most 1
_SIMPLEX = {Shape.TRIANGLE: [0, 1], Shape.TETRAHEDRON: [0, 1, 2], Shape.PRISM: [0, 2]}


def search(targets: Targets) -> tuple[Floats, Bools, Bools]:
    """Reference points (n, d), whether they are roots inside (n,), and whether the search is undecided (n,).

    If neither holds, the element has no root with a margin of -1e-10 or more, independent of rounding.
    """
    count = len(targets)
    reference = np.full((count, targets.patch.shape.dimension), np.nan)
    found = np.zeros(count, bool)
    undecided = np.zeros(count, bool)
    for part in _batches(targets):
        batch = _Search(targets.part(np.arange(part.start, part.stop)))
        reference[part] = batch.reference
        found[part] = batch.found
        undecided[part] = batch.undecided
    return reference, found, undecided


def excluded(targets: Targets, reach: Floats) -> Bools:
    """(n,) targets that, as a few rounds prove, have no root in their element nor by ``reach`` (n,) of s beyond it."""
    result = np.zeros(len(targets), bool)
    for part in _batches(targets):
        some = targets.part(np.arange(part.start, part.stop))
        cells = _whole_elements(some, reach[part])
        for _ in range(_FEW_ROUNDS):
            if not len(cells):
                break
            cells, _, is_large = _contracted(cells, some, reach[part][cells.pair])
            cells = _concatenate(cells.part(~is_large), *_halves(cells.part(is_large), targets.patch.shape))
        result[part] = np.bincount(cells.pair, minlength=len(some)) == 0
    return result


def _batches(targets: Targets) -> Iterator[slice]:
    """Slices of targets whose nets are searched together."""
    net_size = _matrix(targets.patch.geometry)[0].shape[1]
    return chunks(len(targets), max(64, _BATCH // (24 * net_size)))


def hulls(patch: Patch, row: int, count: int) -> tuple[Floats, Floats]:
    """Low and high corners (k, 3) of boxes that together hold an element, in ``count`` parts in each direction."""
    nets = _nets(patch, np.array([row]))
    net_shape = nets.shape[1:]
    ends = np.linspace(-TOLERANCE, 1 + TOLERANCE, count + 1)
    first = ends[:-1]
    low = np.empty((1, 0))
    for i in range(patch.shape.dimension):
        # matrices from coefficients over [0, 1] to those over each part, by de Casteljau's scheme on unit vectors
        axis = -1 - i
        units = np.repeat(np.eye(nets.shape[axis])[..., None], count, axis=2)
        to_parts = _between(units, 1, first, ends[1:])

        # every net in every part of this direction: parts vary slowest
        parts = np.einsum("...i,ijs->s...j", np.moveaxis(nets, axis, -1), to_parts, optimize=True)
        nets = np.moveaxis(parts, -1, axis).reshape(-1, *net_shape)
        low = np.column_stack([np.tile(low, (count, 1)), np.repeat(first, len(low))])

    # beyond the face at which the s add up to 1 the element has no points
    if patch.shape in _SIMPLEX:
        sums = low[:, _SIMPLEX[patch.shape]].sum(axis=1)
        nets = nets[sums <= 1 + 1e-9]
    axes = tuple(range(2, nets.ndim))
    return nets.min(axis=axes), nets.max(axis=axes)


def hull_products(patch: Patch, count: int) -> float:
    """Number of multiplications for the boxes of an element in ``count`` parts in each direction."""
    net_shape = _net_shape(_matrix(patch.geometry)[1])
    return float(3 * count**patch.shape.dimension * np.prod(net_shape) * net_shape[0])


def _nets(patch: Patch, rows: Ints) -> Floats:
    """(n, 3, ...) tensor Bernstein nets of the maps of elements (n,), direction i along axis -1 - i."""
    matrix, degrees = _matrix(patch.geometry)
    nets = row_products(patch.geometry_coefficients[rows], matrix)
    return nets.reshape(len(rows), 3, *_net_shape(degrees))


@dataclass(frozen=True, eq=False)
class _Cells:
    """Boxes that may hold roots.

    pair       (c,)         number of the target
    low, high  (c, d)       corners in s
    net        (3, ..., c)  Bernstein coefficients of map minus point, direction i along axis -2 - i; cells run fastest,
                            since a step of the search does one and the same to all of them
    """

    pair: Ints
    low: Floats
    high: Floats
    net: Floats

    def __len__(self) -> int:
        return len(self.pair)

    @property
    def axes(self) -> tuple[int, ...]:
        """The axes of the net that number coefficients, the last direction first."""
        return tuple(range(1, self.net.ndim - 1))

    def part(self, chosen: Ints | Bools) -> _Cells:
        """Some of the cells."""
        rows = np.flatnonzero(chosen) if chosen.dtype == bool else chosen
        return _Cells(self.pair[rows], self.low[rows], self.high[rows], self.net.take(rows, axis=-1))


class _Search:
    """One batch of targets and the results for them."""

    def __init__(self, targets: Targets) -> None:
        self.targets = targets
        self.shape = targets.patch.shape
        self.reference = np.full((len(targets), self.shape.dimension), np.nan)
        self.found = np.zeros(len(targets), bool)
        self.undecided = np.zeros(len(targets), bool)
        waiting = [(0, _whole_elements(targets, np.full(len(targets), TOLERANCE)))]
        while waiting:
            rounds, cells = waiting.pop()
            while len(cells) and rounds < _ROUNDS:
                # the cells of some targets wait while all have too many numbers
                cells, others = _shared(cells)
                if len(others):
                    waiting.append((rounds, others))
                cells = self._give_up(self._contract(cells))
                rounds += 1
            self.undecided[cells.pair] = True

    def _contract(self, cells: _Cells) -> _Cells:
        """Cut all cells to where roots can be, seek roots from nearly linear ones, halve those still as large."""
        cells, is_linear, is_large = _contracted(cells, self.targets, np.full(len(cells), TOLERANCE))
        is_open = self._seek_roots(cells, is_linear)
        small = cells.part(is_open & ~is_large)
        large = cells.part(is_open & is_large)
        return _concatenate(small, *_halves(large, self.shape))

    def _seek_roots(self, cells: _Cells, is_linear: Bools) -> Bools:
        """(c,) whether cells are still in question after Newton's method from the small, nearly linear ones."""
        width = _widths(cells)
        ready = np.flatnonzero(is_linear & (width < 0.1))
        pair = cells.pair[ready]
        middles = cells.low[ready] + cells.high[ready] - 1
        starts = uncollapse(self.shape, middles) if self.shape is Shape.PYRAMID else middles
        feet = newton(self.targets.part(pair), starts)
        self.reference[pair[feet.inside]] = feet.reference[feet.inside]
        self.found[pair[feet.inside]] = True
        is_open = ~self.found[cells.pair]

        # cells cannot shrink below rounding: all their points then count as one, and Newton's result from there decides
        net = cells.net.take(ready, axis=-1)
        extent = np.ptp(net, axis=cells.axes).max(axis=0, initial=0)
        is_point = extent <= _ONE_POINT * self.targets.rounding[pair]
        is_open[ready[feet.converged & is_point]] = False

        # on curves and surfaces a foot near a tiny cell is the result for it: cells cannot shrink below the distance
        if self.shape.dimension < 3:
            is_near = np.abs(feet.reference - starts).max(axis=1, initial=0) < 0.01
            is_tiny = width[ready] < 1e-3
            is_open[ready[feet.converged & is_near & is_tiny]] = False
        return is_open

    def _give_up(self, cells: _Cells) -> _Cells:
        """Leave out pairs with cells too small or too many to go on."""
        is_small = _widths(cells) < _SMALLEST
        has_many = np.bincount(cells.pair, minlength=len(self.targets)) > _MOST_CELLS
        self.undecided[cells.pair[is_small]] = True
        self.undecided |= has_many & ~self.found
        return cells.part(~self.undecided[cells.pair])


def _shared(cells: _Cells) -> tuple[_Cells, _Cells]:
    """The cells of the first targets, as many as have at most `_MOST_NUMBERS` numbers, one at least; and the others."""
    pairs, counts = np.unique(cells.pair, return_counts=True)
    most = _MOST_NUMBERS * len(cells) // max(cells.net.size, 1)
    taken = max(1, int(np.searchsorted(np.cumsum(counts), most, side="right")))
    is_first = cells.pair <= pairs[min(taken, len(pairs)) - 1]
    return (cells, cells.part(~is_first)) if is_first.all() else (cells.part(is_first), cells.part(~is_first))


def _whole_elements(targets: Targets, reach: Floats) -> _Cells:
    """Every element as one cell, larger by ``reach`` (n,) all round."""
    maps = np.moveaxis(_nets(targets.patch, targets.rows), 0, -1)
    dimension = targets.patch.shape.dimension
    points = targets.points.T.reshape(3, *[1] * dimension, len(targets))
    low = np.zeros((len(targets), dimension))
    high = np.ones_like(low)
    cells = _Cells(np.arange(len(targets)), low, high, np.ascontiguousarray(maps) - points)
    return _cut(cells, low - reach[:, None], high + reach[:, None])


def _contracted(cells: _Cells, targets: Targets, reach: Floats) -> tuple[_Cells, Bools, Bools]:
    """Cells that may have a root, cut to the region that can contain it.

    Whether maps are nearly linear, and whether cells stay large.

    reach  (c,) of s beyond the face where the s add up to 1
    """
    slack = np.maximum(targets.precision, targets.distance)[cells.pair]
    lower, upper, is_linear = _root_bounds(cells, slack)
    possible = np.asarray((lower <= upper).all(axis=1))
    shape = targets.patch.shape
    if shape in _SIMPLEX:
        corner = cells.low + lower * (cells.high - cells.low)
        possible &= corner[:, _SIMPLEX[shape]].sum(axis=1) <= 1 + reach
    lower = lower[possible]
    upper = upper[possible]
    is_large = (upper - lower).max(axis=1) > 0.5
    return _cut(cells.part(possible), lower, upper), is_linear[possible], is_large


def _root_bounds(cells: _Cells, slack: Floats) -> tuple[Floats, Floats, Bools]:
    """The range of possible roots in each cell, from 0 to 1 in each direction.

    The range is ``lower`` to ``upper`` (c, d), empty if reversed.

    With the inverse A of the mean Jacobian, A times the net is t + e(t); a root has t = -e(t), in the range of -e.  The
    map is nearly linear, the third result (c,), if e varies by at most half the cell.
    """
    axes = cells.axes
    jacobians = np.stack([step.mean(axis=axes[:-1]).T for step in _steps_across(cells)], axis=2)
    inverse = duals(jacobians)
    with np.errstate(invalid="ignore", over="ignore"):
        # the net of e: A times the net, minus the net of t, whose coefficients in direction i are i/n
        rest = np.stack([_combined(inverse[:, :, i].T, cells.net) for i in range(len(axes))])
        for i in range(len(axes)):
            count = rest.shape[-2 - i]
            rest[i] -= np.linspace(0, 1, count).reshape(-1, *[1] * (i + 1))
        least = rest.min(axis=axes).T
        most = rest.max(axis=axes).T
        is_linear = (most - least <= 0.5).all(axis=1)
        allowance = slack[:, None] * np.abs(inverse).sum(axis=1)
        lower = -most - allowance
        upper = -least + allowance

    # a singular Jacobian says nothing
    lower = np.where(np.isfinite(lower), lower, 0.0)
    upper = np.where(np.isfinite(upper), upper, 1.0)

    # a root is excluded if a coordinate of the map has one sign everywhere, or if the range of -e is outside the cell
    has_one_sign = (cells.net.min(axis=axes) > slack) | (cells.net.max(axis=axes) < -slack)
    is_empty = has_one_sign.any(axis=0)[:, None] | (lower > 1) | (upper < 0)
    lower = np.clip(lower, 0.0, 1 - _SMALLEST)
    upper = np.clip(upper, _SMALLEST, 1.0)
    return np.where(is_empty, 1.0, lower), np.where(is_empty, 0.0, upper), is_linear


def _combined(weights: Floats, net: Floats) -> Floats:
    """(..., c) sums of the coordinates of a net (3, ..., c) with weights (3, c)."""
    total: Floats = weights[0] * net[0]
    for weight, coordinate in zip(weights[1:], net[1:], strict=True):
        total += weight * coordinate
    return total


def _steps_across(cells: _Cells) -> list[Floats]:
    """For each direction the difference of the net's last and first layers."""
    axes = [-2 - i for i in range(cells.low.shape[1])]
    return [np.asarray(cells.net.take(-1, axis) - cells.net.take(0, axis)) for axis in axes]


def _widths(cells: _Cells) -> Floats:
    """(c,) longest sides of the cells."""
    return np.asarray((cells.high - cells.low).max(axis=1, initial=0))


def _cut(cells: _Cells, lower: Floats, upper: Floats) -> _Cells:
    """The cells between ``lower`` and ``upper`` (c, d), relative to each cell."""
    net = cells.net
    for i in range(lower.shape[1]):
        net = _between(net, -2 - i, lower[:, i], upper[:, i])
    width = cells.high - cells.low
    return _Cells(cells.pair, cells.low + lower * width, cells.low + upper * width, net)


def _between(net: Floats, axis: int, lower: Floats, upper: Floats) -> Floats:
    """Bernstein coefficients over [lower, upper] (c,) of one direction of nets (..., c), by de Casteljau's scheme."""
    right = _right_of(net, axis, lower)
    return _left_of(right, axis, (upper - lower) / (1 - lower))


def _right_of(net: Floats, axis: int, t: Floats) -> Floats:
    """Bernstein coefficients over [t, 1] of one direction."""
    points = np.moveaxis(net, axis, 0).copy()
    count = len(points)
    for level in range(1, count):
        step = points[1 : count - level + 1] - points[:-level]
        points[:-level] += t * step
    return np.moveaxis(points, 0, axis)


def _left_of(net: Floats, axis: int, t: Floats) -> Floats:
    """Bernstein coefficients over [0, t] of one direction."""
    return np.flip(_right_of(np.flip(net, axis), axis, 1 - t), axis)


def _halves(cells: _Cells, shape: Shape) -> tuple[_Cells, _Cells]:
    """Both halves of the cells, cut where their image is longest; at the apex of a pyramid, across its axis."""
    dimension = cells.low.shape[1]
    axes = tuple(range(dimension))
    lengths = [np.ptp(cells.net, axis=-2 - i).max(axis=axes) for i in range(dimension)]
    longest = np.argmax(np.stack(lengths, axis=1), axis=1)
    if shape is Shape.PYRAMID:
        has_apex = cells.high[:, 2] >= 1
        longest = np.where(has_apex, 2, longest)

    is_halved = np.arange(dimension) == longest[:, None]
    width = cells.high - cells.low
    lower_end = cells.low + np.where(is_halved, 0.5, 1.0) * width
    upper_start = cells.low + np.where(is_halved, 0.5, 0.0) * width
    nets = np.stack([cells.net, cells.net])
    for direction in range(dimension):
        here = np.flatnonzero(longest == direction)
        net, half = cells.net[..., here], np.full(len(here), 0.5)
        nets[0][..., here] = _left_of(net, -2 - direction, half)
        nets[1][..., here] = _right_of(net, -2 - direction, half)
    lower_half = _Cells(cells.pair, cells.low, lower_end, nets[0])
    upper_half = _Cells(cells.pair, upper_start, cells.low + width, nets[1])
    return lower_half, upper_half


def _concatenate(*several: _Cells) -> _Cells:
    return _Cells(
        np.concatenate([cells.pair for cells in several]),
        np.concatenate([cells.low for cells in several]),
        np.concatenate([cells.high for cells in several]),
        np.concatenate([cells.net for cells in several], axis=-1),
    )


@bounded_cache
def _matrix(expansion: Expansion) -> tuple[Floats, tuple[int, ...]]:
    """Matrix (m, count) from modes to a tensor Bernstein net over the whole box, and the degree in each direction."""
    space = bernstein_space(expansion)
    matrix = to_bernstein(expansion, space)
    if expansion.shape not in _SIMPLEX:
        return frozen_floats(matrix), space.degrees
    degrees = _tensor_degrees(space)
    return frozen_floats(matrix @ _tensor(space, degrees)), degrees


def _net_shape(degrees: tuple[int, ...]) -> tuple[int, ...]:
    """Numbers of coefficients of a tensor net in each direction, the last direction first."""
    return tuple(degree + 1 for degree in degrees[::-1])


def _tensor_degrees(space: BernsteinSpace) -> tuple[int, ...]:
    """Degrees of a simplex or prism as a tensor net: the total degree of a simplex in each of its directions."""
    if space.shape is not Shape.PRISM:
        return (space.degrees[0],) * space.shape.dimension
    triangle, along = space.degrees
    return triangle, along, triangle


def _tensor(space: BernsteinSpace, degrees: tuple[int, ...]) -> Floats:
    """(count, tensor count) functions of a simplex or prism as tensor nets, by interpolation at Chebyshev points."""
    lines = [_chebyshev_points(degree) for degree in degrees]
    values = bernstein_values(space, product_points(lines)).T
    tables = (
        bernstein_values(BernsteinSpace(Shape.SEGMENT, (degree,)), line[:, None])
        for degree, line in zip(degrees, lines, strict=True)
    )
    return along_directions(np.ascontiguousarray(values), [np.linalg.inv(table).T for table in tables])


def _chebyshev_points(degree: int) -> Floats:
    """(degree + 1,) the zeros of the Chebyshev polynomial of the next degree, ascending."""
    odd = 2 * np.arange(degree, -1, -1) + 1
    return np.cos(odd * np.pi / (2 * degree + 2))
