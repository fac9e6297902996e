"""Certified ranges of fields: Bernstein bounds, made tight by halving elements where the extrema are.

The gap between the bound and the values at the corners of the boxes (`elvis.core.polynomials.boxnets`) shrinks
fourfold with each halving.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.dataset import Block, Expansion
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


def value_range(blocks: Iterable[tuple[Expansion, Floats]]) -> Range | None:
    """The range over elements with ``coefficients`` (n, m); None without elements.

    Elements with coefficients that are not finite are skipped.  With Fourier directions ``lower`` and ``upper`` come
    from the sum of the amplitudes, without halving.
    """
    finite = [(expansion, c, finite_rows(c)) for expansion, c in blocks]
    present = [(expansion, c if rows.all() else c[rows]) for expansion, c, rows in finite if rows.any()]
    if not present:
        return None
    greatest, upper = _greatest(present, 1.0)
    least, lower = _greatest(present, -1.0)
    return Range(0.0 - lower, 0.0 + upper, 0.0 - least, 0.0 + greatest)


def field_range(blocks: Sequence[Block]) -> Range | None:
    """The range of a field given by its blocks."""
    return value_range((block.expansion, block.coefficients) for block in blocks)


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


def _greatest(blocks: Sequence[tuple[Expansion, Floats]], sign: float) -> tuple[float, float]:
    """The largest value that is known to be attained, and a bound that none exceeds; for -1 of the negative."""
    attained = max(_largest_sample(expansion, coefficients, sign) for expansion, coefficients in blocks)
    bound = attained
    for expansion, coefficients in blocks:
        bounds = _bounds(expansion, coefficients, sign)
        rivals = np.flatnonzero(bounds > attained)
        if expansion.homogeneous is not None:
            bound = max(bound, float(bounds.max()))
        elif len(rivals):
            attained, least_bound = _refine(expansion, coefficients, sign, rivals, bounds[rivals], attained)
            bound = max(bound, least_bound)
    return attained, max(bound, attained)


def _largest_sample(expansion: Expansion, coefficients: Floats, sign: float) -> float:
    """The largest of a few values of each element, or of their negatives (-1)."""
    samples = _samples(expansion)
    parts = even_chunks(len(coefficients), _ELEMENTS_AT_ONCE)
    return max(float(evaluate(expansion, sign * coefficients[part], samples).max()) for part in parts)


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


def _refine(
    expansion: Expansion, coefficients: Floats, sign: float, rivals: Ints, bounds: Floats, attained: float
) -> tuple[float, float]:
    """`_greatest` for elements ``rivals`` (n,) whose bound exceeds the attained value: bisect, and drop boxes."""
    space = bernstein_space(expansion)
    order, most = _descending(bounds), _most_boxes(expansion)
    forgotten = float(bounds[order[most]]) if len(order) > most else attained
    own = sign * coefficients[rivals[order[:most]]]
    nets = box_nets(space, bernstein_coefficients(expansion, own))

    for _ in range(_ROUNDS):
        attained = max(attained, float(corners(nets).max()))
        tops = nets.reshape(len(nets), -1).max(axis=1)
        order = np.argsort(tops)[::-1][:most]
        worth = order[tops[order] > attained + _TOLERANCE * abs(attained)]
        rest = np.delete(tops, worth)
        forgotten = max(forgotten, float(rest.max(initial=-np.inf)))
        if not len(worth):
            return attained, forgotten
        nets = all_halves(nets[worth])
    return max(attained, float(corners(nets).max())), max(forgotten, float(nets.max()))
