"""Orders chosen element by element: the lowest at which every field is within a tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.relative import error_limit
from elvis.core.base.terminal import track
from elvis.core.polynomials.evaluation import evaluate
from elvis.plugins.conversion.plugin import SourceField
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.checking import check_points
from elvis.plugins.projection.fitting import operator
from elvis.plugins.projection.sampling import Sampler
from elvis.plugins.projection.spaces import is_contained

#: points inside an element at which the error is measured
_INSIDE = 24

#: share of the tolerance that an element may use up: taking over a neighbour's trace may cost as much again
_SHARE = 0.4

#: further orders tried beyond the source's, for fields that no order represents exactly
ORDERS_BEYOND = 6


def adapt(
    sampler: Sampler,
    blocks: Sequence[NativeBlock],
    fields: Sequence[SourceField],
    bounds: Sequence[float],
    highest: int,
) -> list[NativeBlock]:
    """The blocks parted by the number of modes that their elements need, at most ``highest`` + 1.

    bounds  of the largest error of each field
    """
    modes = [_needed(sampler, block, fields, bounds, highest) for block in track(list(blocks), "choosing orders")]
    return _by_modes(blocks, modes)


def _by_modes(blocks: Sequence[NativeBlock], modes: Sequence[Ints]) -> list[NativeBlock]:
    """The blocks as parts of elements with one number of modes (n,) each."""
    return [
        block.select(np.flatnonzero(own == count), count)
        for block, own in zip(blocks, modes, strict=True)
        for count in np.unique(own).tolist()
    ]


def enrich(blocks: Sequence[NativeBlock], fields: Sequence[SourceField], ids: Ints, highest: int) -> list[NativeBlock]:
    """The blocks with one mode more for the elements ``ids``, and no fewer than theirs for all around them.

    Elements take the trace of their neighbour of lowest order, so an error may come from there.
    """
    count = 1 + max(int(block.vertices.max(initial=0)) for block in blocks)
    around = np.zeros(count, np.int64)
    marks = [np.isin(block.ids, ids) for block in blocks]
    for block, mark in zip(blocks, marks, strict=True):
        np.maximum.at(around, block.vertices[mark].reshape(-1), block.modes or 0)
    modes = []
    for block, mark in zip(blocks, marks, strict=True):
        own = np.maximum(block.modes or 0, around[block.vertices].max(axis=1))
        most = 1 + min(highest, _highest_order(block, fields))
        modes.append(np.minimum(own + mark, max(most, block.modes or 0)))
    return _by_modes(blocks, modes)


def bounds_of(
    sampler: Sampler, blocks: Sequence[NativeBlock], fields: Sequence[SourceField], tolerance: float
) -> list[float]:
    """The largest error that each field may have: ``tolerance`` of its range, or of the largest of its planes'."""
    precision, most = sampler.source.precision, dict[str, float]()
    for field, (low, high) in zip(fields, ranges(sampler, blocks, fields), strict=True):
        magnitude = max(abs(low), abs(high))
        bound = error_limit(tolerance, high - low, magnitude, precision) if magnitude > 0 else 0.0
        most[field.name] = max(most.get(field.name, 0.0), bound)
    return [most[field.name] for field in fields]


def ranges(
    sampler: Sampler, blocks: Sequence[NativeBlock], fields: Sequence[SourceField], inside: int = _INSIDE
) -> list[tuple[float, float]]:
    """Minimum and maximum finite value of each field; zeros where it has none.

    inside  points inside of each element at which values are taken
    """
    low, high = np.full(len(fields), np.inf), np.full(len(fields), -np.inf)
    for block in blocks:
        for rows, points in sampler.batches(block, check_points(block.shape, inside, block.is_collapsed)):
            for i, field in enumerate(fields):
                if not field.is_on(block.number):
                    continue
                values = sampler.values(block, rows, field, points)
                finite = values[np.isfinite(values)]
                low[i], high[i] = min(low[i], finite.min(initial=np.inf)), max(high[i], finite.max(initial=-np.inf))
    is_known = high >= low
    return list(zip(np.where(is_known, low, 0.0).tolist(), np.where(is_known, high, 0.0).tolist(), strict=True))


def _needed(
    sampler: Sampler, block: NativeBlock, fields: Sequence[SourceField], bounds: Sequence[float], highest: int
) -> Ints:
    """(n,) modes each way that the elements of a block need for every field."""
    last = min(highest, _highest_order(block, fields))
    modes = np.full(len(block), last + 1)
    left = np.arange(len(block))
    for order in range(1, last):
        part = replace(block.select(left), modes=order + 1)
        good = np.ones(len(left), bool)
        for field, bound in zip(fields, bounds, strict=True):
            if field.is_on(block.number):
                good &= errors_of(sampler, part, field) <= _SHARE * bound
        modes[left[good]] = order + 1
        left = left[~good]
        if not len(left):
            break
    return modes


def _highest_order(block: NativeBlock, fields: Sequence[SourceField]) -> int:
    """The order at which nothing is gained any more for any of the fields that a block has."""
    return max((_last_order(block, field) for field in fields if field.is_on(block.number)), default=1)


def _last_order(block: NativeBlock, field: SourceField) -> int:
    """The order at which nothing is gained any more."""
    order = field.order_on(block.number) or 0
    held = field.is_polynomial and is_contained(block.source, order, order, block.is_ortho, block.is_collapsed)
    return max(1, order if held else order + ORDERS_BEYOND)


def errors_of(sampler: Sampler, block: NativeBlock, field: SourceField) -> Floats:
    """(n,) largest difference on each element; values that are not finite make none."""
    assert block.modes is not None
    which, own = operator(block, field, block.modes), check_points(block.shape, _INSIDE, block.is_collapsed)
    coefficients = np.empty((len(block), which.matrix.shape[1]))
    for rows, points in sampler.batches(block, which.points):
        coefficients[rows] = sampler.values(block, rows, field, points) @ which.matrix
    errors = np.empty(len(block))
    for rows, points in sampler.batches(block, own):
        values = sampler.values(block, rows, field, points)
        differences = np.abs(evaluate(block.expansion(block.modes), coefficients[rows], own) - values)
        errors[rows] = np.where(np.isnan(differences), 0.0, differences).max(axis=1)
    return errors
