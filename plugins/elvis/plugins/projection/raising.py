"""Higher orders for maps and fields beyond the source's: rational functions, H(div) on curved elements.

A number of orders is added on all elements.  It is the lowest at which the elements with the largest errors are within
a goal; or the one with the smallest error, if the error falls as it does for smooth functions.  Kinks and jumps stay at
the order of the source.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.relative import error_limit
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import mode_count
from elvis.core.polynomials.row_products import row_products
from elvis.plugins.conversion.plugin import Elements, SourceField
from elvis.plugins.conversion.report import rounding
from elvis.plugins.projection.adaptivity import errors_of
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.checking import check_points
from elvis.plugins.projection.fitting import field_modes, position_operator
from elvis.plugins.projection.sampling import Sampler
from elvis.plugins.projection.verification import Tally

#: relative error at which orders are no longer raised
GOAL = 1e-9

#: orders added at most
_MOST_ADDED = 6

#: the highest order that they lead to
_HIGHEST = 16

#: maximum number of modes of an element: a hexahedron of order 8; the time of a fit grows with its third power
_MOST_MODES = 729

#: numbers that a field may have
_MOST_NUMBERS = 1 << 25

#: by how much the error falls, from one order to the next in the mean, where more orders are worth their cost
_FALL = 0.6

#: points inside an element at which the map's error is measured
_INSIDE = 24

#: number of successive orders with too little gain after which the search stops
_PATIENCE = 2


@dataclass(frozen=True)
class Raise:
    """How many orders are added, and whether errors are then within the goal."""

    added: int = 0
    is_enough: bool = True


def added_to_field(
    sampler: Sampler, blocks: Sequence[NativeBlock], part: Sequence[NativeBlock], field: SourceField, goal: float
) -> Raise:
    """How many orders are added to a field, so that its errors on the elements ``part`` are within a goal.

    blocks  all elements, which are to have these orders
    """

    def error(added: int) -> float:
        return field_error(sampler, part, with_more(field, added))

    own = [block for block in blocks if field.is_on(block.number)]
    return _added(error, lambda block: max(1, field.order_on(block.number) or 0), own, goal)


def field_error(sampler: Sampler, part: Sequence[NativeBlock], field: SourceField) -> float:
    """The largest error of a field that is fitted separately on each element of some blocks."""
    own = [replace(block, modes=field_modes(block, field)) for block in part if field.is_on(block.number)]
    return _largest(errors_of(sampler, block, field) for block in own)


def added_to_map(sampler: Sampler, blocks: Sequence[NativeBlock], part: Sequence[NativeBlock], goal: float) -> Raise:
    """How many orders are added to the map, so that its errors on the elements ``part`` are within a goal."""

    def error(added: int) -> float:
        return _largest(_map_errors(sampler, replace(block, source=raised(block.source, added))) for block in part)

    return _added(error, lambda block: block.source.order, blocks, goal)


def _largest(errors: Iterable[Floats]) -> float:
    return max((float(own.max(initial=0.0)) for own in errors), default=0.0)


def with_more(field: SourceField, added: int) -> SourceField:
    """A field that is fitted with more orders."""
    if not added:
        return field
    if isinstance(field.order, int):
        return replace(field, order=field.order + added, is_polynomial=False)
    orders = [None if order is None else order + added for order in field.order]
    return replace(field, order=orders, is_polynomial=False)


def raised(block: Elements, added: int) -> Elements:
    """A block of a source whose map is fitted with more orders."""
    return replace(block, order=block.order + added, is_polynomial=block.is_polynomial and not added)


def goal_of(low: float, high: float, precision: float) -> float:
    """The error at which orders are no longer raised, for values between ``low`` and ``high``."""
    spread, magnitude = high - low, max(abs(low), abs(high))
    return max(error_limit(GOAL, spread, magnitude, precision), rounding(spread, magnitude, precision))


def added_orders(error: Callable[[int], float], goal: float, is_affordable: Callable[[int], bool]) -> Raise:
    """Number of orders to add; ``error`` returns the error that remains with a number of them."""
    first = best = error(0)
    result = 0
    for added in range(1, _MOST_ADDED + 1):
        if best <= goal or added > result + _PATIENCE or not is_affordable(added):
            break
        now = error(added)
        if now < first * _FALL**added and now < best:
            best, result = now, added
    return Raise(result, best <= goal)


def _added(
    error: Callable[[int], float], order: Callable[[NativeBlock], int], blocks: Sequence[NativeBlock], goal: float
) -> Raise:
    """How many orders to add on native blocks."""
    return added_orders(error, goal, lambda added: _is_affordable(blocks, [order(block) + added for block in blocks]))


def _is_affordable(blocks: Sequence[NativeBlock], orders: Sequence[int]) -> bool:
    """Whether elements of these orders are few enough, and the orders themselves reasonable."""
    modes = [mode_count(block.expansion(order + 1)) for block, order in zip(blocks, orders, strict=True)]
    numbers = sum(len(block) * count for block, count in zip(blocks, modes, strict=True))
    return max(orders) <= _HIGHEST and max(modes) <= _MOST_MODES and numbers <= _MOST_NUMBERS


def leading(blocks: Sequence[NativeBlock], tally: Tally) -> list[NativeBlock]:
    """The parts of blocks with the largest errors."""
    rows = [np.flatnonzero(np.isin(block.ids, tally.leaders[0])) for block in blocks]
    return [block.select(own, block.modes) for block, own in zip(blocks, rows, strict=True) if len(own)]


def _map_errors(sampler: Sampler, block: NativeBlock) -> Floats:
    """(n,) largest distance between a map fitted on each element and the source's."""
    which, own = position_operator(block, True), check_points(block.shape, _INSIDE, block.is_collapsed)
    expansion = block.expansion(block.source.order + 1)
    coefficients = np.empty((len(block), 3, which.matrix.shape[1]))
    for rows, points in sampler.batches(block, which.points):
        samples = sampler.positions(block, rows, points).transpose(0, 2, 1)
        coefficients[rows] = row_products(samples, which.matrix)
    errors = np.empty(len(block))
    for rows, points in sampler.batches(block, own):
        ours = evaluate(expansion, coefficients[rows], own).transpose(0, 2, 1)
        errors[rows] = np.linalg.norm(ours - sampler.positions(block, rows, points), axis=2).max(axis=1)
    return errors
