"""Certified ranges of fields: Bernstein bounds, made tight by halving elements where the extrema are.

The gap between the bound and the values at the corners of the boxes (`elvis.core.polynomials.boxnets`) shrinks
fourfold with each halving.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, concatenated
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.data.dataset import Block, Expansion
from elvis.core.mapping.orientation import even_chunks
from elvis.core.polynomials.bernstein import bernstein_coefficients, bernstein_space
from elvis.core.polynomials.boxnets import all_halves, box_degrees, box_nets, corners
from elvis.core.polynomials.evaluation import evaluate

_ROUNDS = 15
_TOLERANCE = 1e-9
_ELEMENTS_AT_ONCE = 1 << 15
_NUMBERS_AT_ONCE = 1 << 19


@dataclass(frozen=True)
class Range:
    """lower <= value <= upper everywhere, to rounding; ``minimum`` and ``maximum`` are values that are attained."""

    lower: float
    upper: float
    minimum: float
    maximum: float

    def widened(self, radius: float) -> Range:
        """The range whose ends hold for values with an error of at most the radius; itself where that is not known."""
        return replace(self, lower=self.lower - radius, upper=self.upper + radius) if np.isfinite(radius) else self


#: expansions and coefficients (n, m) of a field's elements
Blocks = Sequence[tuple[Expansion, Floats]]


@dataclass(frozen=True, eq=False)
class _Stack:
    """Elements of one expansion, of several fields.

    owners        (n,) the number of each element's field
    coefficients  (n, m)
    """

    expansion: Expansion
    owners: Ints
    coefficients: Floats


def value_range(blocks: Iterable[tuple[Expansion, Floats]]) -> Range | None:
    """The range over elements with ``coefficients`` (n, m); None without elements.

    Elements with coefficients that are not finite are skipped.  With Fourier directions ``lower`` and ``upper`` come
    from the sum of the amplitudes, without halving.
    """
    return value_ranges([blocks])[0]


def value_ranges(fields: Iterable[Iterable[tuple[Expansion, Floats]]]) -> list[Range | None]:
    """`value_range` of many fields; small ones of equal expansions are examined together, which costs less."""
    every = [_finite(blocks) for blocks in fields]
    found: list[Range | None] = [None] * len(every)
    for numbers in _batches(every):
        stacks = _stacked([every[number] for number in numbers])
        greatest, upper = _greatest(stacks, len(numbers), 1.0)
        least, lower = _greatest(stacks, len(numbers), -1.0)
        ends = np.stack([0.0 - lower, 0.0 + upper, 0.0 - least, 0.0 + greatest], axis=1).tolist()
        for number, own in zip(numbers, ends, strict=True):
            found[number] = Range(*own)
    return found


def field_range(blocks: Sequence[Block]) -> Range | None:
    """The range of a field given by its blocks."""
    return field_ranges([blocks])[0]


def field_ranges(fields: Sequence[Sequence[Block]]) -> list[Range | None]:
    """The ranges of many fields given by their blocks."""
    return value_ranges([(block.expansion, block.coefficients) for block in blocks] for blocks in fields)


def _finite(blocks: Iterable[tuple[Expansion, Floats]]) -> Blocks:
    """Blocks without elements that have coefficients that are not finite, and without empty blocks."""
    found = [(expansion, c, finite_rows(c)) for expansion, c in blocks]
    return [(expansion, c if rows.all() else c[rows]) for expansion, c, rows in found if rows.any()]


def _batches(fields: Sequence[Blocks]) -> Iterator[list[int]]:
    """Batches of fields with equal expansions: one field, or several with few enough elements to bisect at once."""
    waiting: dict[tuple[Expansion, ...], list[int]] = {}
    filled: dict[tuple[Expansion, ...], int] = {}
    for number, blocks in enumerate(fields):
        key = tuple(expansion for expansion, _ in blocks)
        if not key:
            continue
        count = sum(len(coefficients) for _, coefficients in blocks)
        if key in waiting and filled[key] + count > _room(key):
            yield waiting.pop(key)
        filled[key] = count + (filled[key] if key in waiting else 0)
        waiting.setdefault(key, []).append(number)
    yield from waiting.values()


@bounded_cache
def _room(expansions: tuple[Expansion, ...]) -> int:
    """Number of elements that are examined together; waves are taken by themselves."""
    if any(expansion.homogeneous is not None for expansion in expansions):
        return 0
    return min(map(_most_boxes, expansions))


def _stacked(fields: Sequence[Blocks]) -> list[_Stack]:
    """The elements of fields of equal expansions, block by block."""
    found = []
    for blocks in zip(*fields, strict=True):
        expansion = blocks[0][0]
        counts = [len(coefficients) for _, coefficients in blocks]
        every = [coefficients for _, coefficients in blocks]
        coefficients = concatenated(every)
        found.append(_Stack(expansion, np.repeat(np.arange(len(blocks)), counts), coefficients))
    return found


def deciding(blocks: Sequence[Block]) -> Ints:
    """(n,) ids of elements that may hold an end of the range: the range over these elements equals the range over all.

    These are the elements with bounds beyond the attained value, up to one more than are examined closely (its bound
    covers all others), and an element that attains it; with Fourier directions, the elements with the largest bounds.
    """
    found = [np.empty(0, np.int64)]
    present = [(block, np.flatnonzero(finite_rows(block.coefficients))) for block in blocks]
    present = [(block, rows) for block, rows in present if len(rows)]
    for sign in (1.0, -1.0):
        ends = [_ends(block, rows, sign) for block, rows in present]
        attained = max((float(values.max()) for values, _ in ends), default=np.inf)
        for (block, rows), (values, bounds) in zip(present, ends, strict=True):
            ids = block.element_ids[rows]
            if block.expansion.homogeneous is not None:
                found.append(ids[np.argmax(bounds)][None])
            else:
                beyond = np.flatnonzero(bounds > attained)
                found.append(ids[beyond[_descending(bounds[beyond])[: _most_boxes(block.expansion) + 1]]])
            # one of the elements that attain it is enough
            found.append(ids[np.flatnonzero(values == attained)[:1]])
    return np.unique(np.concatenate(found))


def _ends(block: Block, rows: Ints, sign: float) -> tuple[Floats, Floats]:
    """For some elements (n,) the largest of a few values of a field, or of its negative (-1), and a bound of all."""
    values, bounds = np.empty(len(rows)), np.empty(len(rows))
    samples = _samples(block.expansion)
    for first in range(0, len(rows), _ELEMENTS_AT_ONCE):
        chunk = slice(first, first + _ELEMENTS_AT_ONCE)
        own = sign * block.coefficients[rows[chunk]]
        values[chunk] = evaluate(block.expansion, own, samples).max(axis=1)
        bounds[chunk] = _bounds(block.expansion, own)
    return values, bounds


def finite_rows(coefficients: Floats) -> Bools:
    """(n,) elements all of whose coefficients are finite."""
    return np.asarray(np.isfinite(coefficients).all(axis=1))


def _greatest(stacks: Sequence[_Stack], count: int, sign: float) -> tuple[Floats, Floats]:
    """(count,) the largest value of each field that is known to be attained, and bounds; for -1 of the negatives."""
    attained = np.full(count, -np.inf)
    for stack in stacks:
        _raise_to_samples(stack, sign, attained)
    bound = attained.copy()
    for stack in stacks:
        bounds = _bounds(stack.expansion, stack.coefficients, sign)
        rivals = np.flatnonzero(bounds > attained[stack.owners])
        if stack.expansion.homogeneous is not None:
            np.maximum.at(bound, stack.owners, bounds)
        elif len(rivals):
            _refine(stack, sign, rivals, bounds[rivals], attained, bound)
    return attained, np.maximum(bound, attained)


def _raise_to_samples(stack: _Stack, sign: float, attained: Floats) -> None:
    """Raise the attained values of fields to those at a few points of each element."""
    samples = _samples(stack.expansion)
    for part in even_chunks(len(stack.owners), _ELEMENTS_AT_ONCE):
        values = evaluate(stack.expansion, sign * stack.coefficients[part], samples)
        np.maximum.at(attained, stack.owners[part], values.max(axis=1))


def _samples(expansion: Expansion) -> Floats:
    """(n, d) the vertices; with Fourier directions, in each of a few planes."""
    points = expansion.shape.vertices
    planes = expansion.homogeneous
    for numbers in (planes.y_ids, planes.z_ids) if planes else ():
        if numbers:
            zeta = np.linspace(-1, 1, 2 * max(numbers) + 3)
            points = np.column_stack([np.tile(points, (len(zeta), 1)), np.repeat(zeta, len(points))])
    return points


def _bounds(expansion: Expansion, coefficients: Floats, sign: float = 1.0) -> Floats:
    """(n,) the largest Bernstein coefficient of each element, of its negative for -1."""
    bounds = np.empty(len(coefficients))
    for first in range(0, len(coefficients), _ELEMENTS_AT_ONCE):
        chunk = slice(first, first + _ELEMENTS_AT_ONCE)
        own = sign * coefficients[chunk]
        if expansion.homogeneous is None:
            bounds[chunk] = bernstein_coefficients(expansion, own).max(axis=1)
        else:
            bounds[chunk] = _wave_bounds(expansion, own)
    return bounds


def _wave_bounds(expansion: Expansion, coefficients: Floats) -> Floats:
    """(n,) bound of a sum of planes, each a polynomial times a wave: 1 for the mean, else within [-1, 1]."""
    planes = expansion.homogeneous
    assert planes is not None
    spatial = replace(expansion, homogeneous=None)
    nets = bernstein_coefficients(spatial, coefficients.reshape(len(coefficients), len(planes.z_ids), -1))
    waves = np.array([*zip(planes.z_ids, planes.y_ids or planes.z_ids, strict=True)]).any(axis=1)
    amplitudes = np.where(waves, np.abs(nets).max(axis=2), nets.max(axis=2))
    bounds: Floats = amplitudes.sum(axis=1)
    return bounds


def _descending(bounds: Floats) -> Ints:
    """(n,) the order of bounds from the largest down, of equal ones as they stand."""
    return np.argsort(-bounds, kind="stable")


def _most_boxes(expansion: Expansion) -> int:
    """Number of boxes that are examined closely."""
    space = bernstein_space(expansion)
    size = np.prod([degree + 1 for degree in box_degrees(space)])
    return max(1, int(_NUMBERS_AT_ONCE / (size << space.shape.dimension)))


def _refine(stack: _Stack, sign: float, rivals: Ints, bounds: Floats, attained: Floats, bound: Floats) -> None:
    """Raise attained values and bounds (count,) for elements ``rivals`` (n,) whose bounds exceed the attained ones."""
    space = bernstein_space(stack.expansion)
    most = _most_boxes(stack.expansion)
    # of one field alone there may be more
    order = _descending(bounds)
    np.maximum.at(bound, stack.owners[rivals[order[most:]]], bounds[order[most:]])
    chosen = rivals[order[:most]]
    nets = box_nets(space, bernstein_coefficients(stack.expansion, sign * stack.coefficients[chosen]))
    _bisect(nets, stack.owners[chosen], attained, bound, most, _ROUNDS)


def _bisect(nets: Floats, owners: Ints, attained: Floats, bound: Floats, most: int, rounds: int) -> None:
    """Bisect boxes (n, …) of fields ``owners`` (n,); drop those that can't contain the largest value of their field."""
    for number in range(rounds):
        np.maximum.at(attained, owners, corners(nets).max(axis=1))
        tops = nets.reshape(len(nets), -1).max(axis=1)
        order = np.argsort(tops)[::-1]
        enough = attained + _TOLERANCE * np.abs(attained)
        worth = order[tops[order] > enough[owners[order]]]
        middle = _middle(owners[worth]) if len(worth) > most else None
        worth = worth if middle is not None else worth[:most]
        rest = np.delete(np.arange(len(tops)), worth)
        np.maximum.at(bound, owners[rest], tops[rest])
        if middle is not None:
            # each part of the fields goes on by itself, so that memory doesn't grow with their number
            for is_in in (owners[worth] < middle, owners[worth] >= middle):
                part = worth[is_in]
                _bisect(nets[part], owners[part], attained, bound, most, rounds - number)
            return
        if not len(worth):
            return
        nets = all_halves(nets[worth])
        owners = np.tile(owners[worth], 2 ** (nets.ndim - 1))
    np.maximum.at(attained, owners, corners(nets).max(axis=1))
    np.maximum.at(bound, owners, nets.reshape(len(nets), -1).max(axis=1))


def _middle(owners: Ints) -> int | None:
    """The median of the fields' numbers, which divides them in two; None for one field."""
    distinct = np.unique(owners)
    return int(distinct[len(distinct) // 2]) if len(distinct) > 1 else None
