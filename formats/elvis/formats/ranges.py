"""Certified ranges of fields: Bernstein bounds, made tight by halving elements where the extremes are.

On every shape a polynomial of the format is a polynomial in the collapsed coordinates eta, so a tensor Bernstein net on
the box of eta bounds it, and de Casteljau's rule splits that box.  The gap between the bound and the values at the
corners of the boxes shrinks fourfold with each halving.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import comb

import numpy as np

from elvis.formats.arrays import Bools, Floats, frozen_floats
from elvis.formats.bernstein import BernsteinSpace, bernstein_coefficients, bernstein_space
from elvis.formats.dataset import Block, Expansion
from elvis.formats.evaluation import evaluate
from elvis.formats.shapes import Shape

_ROUNDS = 15
_TOLERANCE = 1e-9
_ELEMENTS_AT_ONCE = 1 << 15
_NUMBERS_AT_ONCE = 1 << 19


@dataclass(frozen=True)
class Range:
    """lower <= value <= upper everywhere, to rounding; ``least`` and ``greatest`` are values that are attained."""

    lower: float
    upper: float
    least: float
    greatest: float


def value_range(blocks: Iterable[tuple[Expansion, Floats]]) -> Range | None:
    """The range over elements with ``coefficients`` (n, m); None where there are none.

    Elements with coefficients that are not finite are left out.  With Fourier directions ``lower`` and ``upper`` come
    from the sum of the amplitudes, without halving.
    """
    finite = [(expansion, c[finite_rows(c)]) for expansion, c in blocks]
    present = [(expansion, c) for expansion, c in finite if len(c)]
    if not present:
        return None
    greatest, upper = _greatest(present)
    least, lower = _greatest([(expansion, -c) for expansion, c in present])
    return Range(0.0 - lower, 0.0 + upper, 0.0 - least, 0.0 + greatest)


def field_range(blocks: Sequence[Block]) -> Range | None:
    """The range of a field given by its blocks."""
    return value_range((block.expansion, block.coefficients) for block in blocks)


def finite_rows(coefficients: Floats) -> Bools:
    """(n,) elements all of whose coefficients are finite."""
    return np.asarray(np.isfinite(coefficients).all(axis=1))


def _greatest(blocks: Sequence[tuple[Expansion, Floats]]) -> tuple[float, float]:
    """The greatest value that is known to be attained, and a bound that none exceeds."""
    attained = max(float(evaluate(e, c, _samples(e)).max()) for e, c in blocks)
    bound = attained
    for expansion, coefficients in blocks:
        bounds = _bounds(expansion, coefficients)
        rivals = np.flatnonzero(bounds > attained)
        if expansion.homogeneous is not None:
            bound = max(bound, float(bounds.max()))
        elif len(rivals):
            attained, least_bound = _refined(expansion, coefficients[rivals], bounds[rivals], attained)
            bound = max(bound, least_bound)
    return attained, max(bound, attained)


def _samples(expansion: Expansion) -> Floats:
    """(n, d) the vertices; with Fourier directions, in each of a few planes."""
    points = expansion.shape.vertices
    planes = expansion.homogeneous
    for numbers in (planes.y_ids, planes.z_ids) if planes else ():
        if numbers:
            zeta = np.linspace(-1, 1, 2 * max(numbers) + 3)
            points = np.column_stack([np.tile(points, (len(zeta), 1)), np.repeat(zeta, len(points))])
    return points


def _bounds(expansion: Expansion, coefficients: Floats) -> Floats:
    """(n,) the greatest Bernstein coefficient of each element."""
    bounds = np.empty(len(coefficients))
    for first in range(0, len(coefficients), _ELEMENTS_AT_ONCE):
        chunk = slice(first, first + _ELEMENTS_AT_ONCE)
        if expansion.homogeneous is None:
            bounds[chunk] = bernstein_coefficients(expansion, coefficients[chunk]).max(axis=1)
        else:
            bounds[chunk] = _wave_bounds(expansion, coefficients[chunk])
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


def _refined(expansion: Expansion, coefficients: Floats, bounds: Floats, attained: float) -> tuple[float, float]:
    """As `_greatest`, for elements whose bound exceeds what is attained: halve, forget boxes that can't win."""
    space = bernstein_space(expansion)
    order = np.argsort(bounds)[::-1]
    size = np.prod([degree + 1 for degree in _degrees(space)])
    most = max(1, int(_NUMBERS_AT_ONCE / (size << space.shape.dimension)))
    forgotten = float(bounds[order[most]]) if len(order) > most else attained
    nets = _boxes(space, bernstein_coefficients(expansion, coefficients[order[:most]]))

    for _ in range(_ROUNDS):
        attained = max(attained, _corners(nets))
        tops = nets.reshape(len(nets), -1).max(axis=1)
        order = np.argsort(tops)[::-1][:most]
        worth = order[tops[order] > attained + _TOLERANCE * abs(attained)]
        rest = np.delete(tops, worth)
        forgotten = max(forgotten, float(rest.max(initial=-np.inf)))
        if not len(worth):
            return attained, forgotten
        nets = _halved(nets[worth])
    return max(attained, _corners(nets)), max(forgotten, float(nets.max()))


def _corners(nets: Floats) -> float:
    """The greatest value at the corners of the boxes, where the net is the polynomial."""
    ends = [[0, -1]] * (nets.ndim - 1)
    return float(nets[np.ix_(range(len(nets)), *ends)].max())


def _halved(nets: Floats) -> Floats:
    """(2^d n, D1, …, Dd) nets of the halves in every direction."""
    for axis in range(1, nets.ndim):
        lower, upper = _splitters(nets.shape[axis] - 1)
        moved = np.moveaxis(nets, axis, -1)
        halves = np.concatenate([moved @ lower, moved @ upper])
        nets = np.moveaxis(halves, -1, axis)
    return nets


@lru_cache(maxsize=64)
def _splitters(degree: int) -> tuple[Floats, Floats]:
    """(D, D) matrices from the right that give the nets of the lower and of the upper half; entries are exact."""
    n = degree + 1
    lower = np.array([[comb(i, j) / 2**i for i in range(n)] for j in range(n)])
    return frozen_floats(lower), frozen_floats(lower[::-1, ::-1])


def _degrees(space: BernsteinSpace) -> tuple[int, ...]:
    """Degree of the space in each direction of eta."""
    d = space.degrees
    if space.shape is Shape.PRISM:
        return d[0], d[1], d[0]
    return d * space.shape.dimension if len(d) < space.shape.dimension else d


def _boxes(space: BernsteinSpace, coefficients: Floats) -> Floats:
    """(n, D1, …, Dd) tensor Bernstein nets on the box of eta, from Bernstein coefficients (n, count)."""
    net = coefficients @ _to_box(space)
    return net.reshape(len(net), *(degree + 1 for degree in _degrees(space)))


@lru_cache(maxsize=32)
def _to_box(space: BernsteinSpace) -> Floats:
    """(count, D1 … Dd) every function of the space as a tensor net: its factors, raised to the full degrees."""
    matrix = np.ones((space.count, 1))
    for raised in _raised_factors(space):
        matrix = (matrix[:, :, None] * raised[:, None, :]).reshape(space.count, -1)
    return frozen_floats(matrix)


def _raised_factors(space: BernsteinSpace) -> Iterator[Floats]:
    """For each direction of eta the (count, D) net of the factor of each function.

    On a tetrahedron b_k^p(t3) b_j^(p-k)(s2) b_i^(p-j-k)(s1): the powers of the later directions lower the degree.
    """
    later = {Shape.TRIANGLE: ((1,), ()), Shape.TETRAHEDRON: ((1, 2), (2,), ()), Shape.PRISM: ((2,), (), ())}
    lowering = later.get(space.shape, ((),) * space.shape.dimension)
    for direction, degree in enumerate(_degrees(space)):
        powers = space.powers[:, direction]
        lowered = degree - space.powers[:, list(lowering[direction])].sum(axis=1)
        yield np.array([_raised(int(i), int(q), degree) for i, q in zip(powers, lowered, strict=True)])


def _raised(power: int, degree: int, target: int) -> list[float]:
    """b_power^degree in the Bernstein basis of degree ``target``."""
    steps = target - degree
    return [
        comb(degree, power) * comb(steps, k - power) / comb(target, k) if 0 <= k - power <= steps else 0.0
        for k in range(target + 1)
    ]
