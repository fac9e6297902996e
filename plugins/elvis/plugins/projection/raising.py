"""Higher orders for maps and fields that those of the source do not hold: rational ones, H(div) on curved elements.

A number of orders is added on all elements.  It is the lowest at which the elements with the largest errors are within
a goal; or that with the least error, if the error falls as it does for smooth functions.  Kinks and jumps stay at the
order of the source.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from elvis.core.arrays import Floats
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import mode_count
from elvis.core.relative import error_limit
from elvis.plugins.conversion import Elements, SourceField
from elvis.plugins.projection.adaptivity import errors_of
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.checking import check_points
from elvis.plugins.projection.fitting import position_operator
from elvis.plugins.projection.sampling import Sampler
from elvis.plugins.projection.verification import Tally

#: the relative error at which no more orders are added
GOAL = 1e-9

#: orders added at most
_MOST_ADDED = 6

#: the highest order that they lead to
_HIGHEST = 16

#: numbers that a field may have
_MOST_NUMBERS = 1 << 25

#: by how much the error falls, from one order to the next in the mean, where more orders are worth their cost
_FALL = 0.6

#: points inside an element at which the map's error is measured
_INSIDE = 24


def added_to_field(sampler: Sampler, blocks: Sequence[NativeBlock], field: SourceField, tally: Tally) -> int:
    """How many orders are added to a field whose errors are those of ``tally``."""
    smooth = replace(field, is_polynomial=False)
    blocks = [block for block in blocks if field.is_on(block.number)]

    def order(block: NativeBlock) -> int:
        return max(1, field.order_on(block.number) or 0)

    def error(added: int) -> float:
        worst = 0.0
        for block in _leading(blocks, tally):
            own = replace(block, modes=1 + added + order(block))
            worst = max(worst, float(errors_of(sampler, own, smooth).max(initial=0.0)))
        return worst

    return _added(error, order, blocks, _goal(tally, sampler.source.precision))


def added_to_map(sampler: Sampler, blocks: Sequence[NativeBlock], tally: Tally) -> int:
    """How many orders are added to the map, whose errors are those of ``tally``."""

    def error(added: int) -> float:
        own = [replace(block, source=raised(block.source, added)) for block in _leading(blocks, tally)]
        return max((float(_map_errors(sampler, block).max(initial=0.0)) for block in own), default=0.0)

    return _added(error, lambda block: block.source.order, blocks, _goal(tally, sampler.source.precision))


def raised(block: Elements, added: int) -> Elements:
    """A block of a source whose map is fitted with more orders."""
    return replace(block, order=block.order + added, is_polynomial=block.is_polynomial and not added)


def _goal(tally: Tally, precision: float) -> float:
    return error_limit(GOAL, tally.high - tally.low, max(abs(tally.low), abs(tally.high)), precision)


def added_orders(error: Callable[[int], float], goal: float, is_affordable: Callable[[int], bool]) -> int:
    """How many orders to add; ``error`` tells what is left with a number of them."""
    first = best = error(0)
    result = 0
    for added in range(1, _MOST_ADDED + 1):
        if best <= goal or not is_affordable(added):
            break
        now = error(added)
        if now < first * _FALL**added and now < best:
            best, result = now, added
    return result


def _added(
    error: Callable[[int], float], order: Callable[[NativeBlock], int], blocks: Sequence[NativeBlock], goal: float
) -> int:
    """How many orders to add on native blocks."""
    return added_orders(error, goal, lambda added: _is_affordable(blocks, [order(block) + added for block in blocks]))


def _is_affordable(blocks: Sequence[NativeBlock], orders: Sequence[int]) -> bool:
    """Whether elements of these orders are few enough, and the orders themselves reasonable."""
    numbers = sum(len(b) * mode_count(b.expansion(order + 1)) for b, order in zip(blocks, orders, strict=True))
    return max(orders) <= _HIGHEST and numbers <= _MOST_NUMBERS


def _leading(blocks: Sequence[NativeBlock], tally: Tally) -> list[NativeBlock]:
    """The parts of blocks with the largest errors."""
    rows = [np.flatnonzero(np.isin(block.ids, tally.leaders[0])) for block in blocks]
    return [block.select(own, block.modes) for block, own in zip(blocks, rows, strict=True) if len(own)]


def _map_errors(sampler: Sampler, block: NativeBlock) -> Floats:
    """(n,) largest distance between a map fitted on each element and the source's."""
    which, own = position_operator(block, True), check_points(block.shape, _INSIDE, block.is_collapsed)
    expansion = block.expansion(block.source.order + 1)
    coefficients = np.empty((len(block), 3, which.matrix.shape[1]))
    for rows, points in sampler.batches(block, which.points):
        coefficients[rows] = sampler.positions(block, rows, points).transpose(0, 2, 1) @ which.matrix
    errors = np.empty(len(block))
    for rows, points in sampler.batches(block, own):
        ours = evaluate(expansion, coefficients[rows], own).transpose(0, 2, 1)
        errors[rows] = np.linalg.norm(ours - sampler.positions(block, rows, points), axis=2).max(axis=1)
    return errors
