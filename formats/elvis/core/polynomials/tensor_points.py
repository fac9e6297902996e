"""Sum factorization at single points: tensor-product expansions contracted with one direction's factors after another.

An element with p^d modes takes about 2 p^d products for a value and all its derivatives.  A table of all modes and of
their gradients takes (d + 1) p^d and has to be built first (Orszag 1980, as `lattices`).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Expansion
from elvis.core.polynomials.expansion import product_plan
from elvis.core.polynomials.factors import Factors

#: numbers of coefficients that are contracted together: they stay in the processor's cache
_NUMBERS = 1 << 16
#: points whose factors are tabulated together
_TABULATED = 1 << 12


def values_at_points(expansion: Expansion, coefficients: Floats, rows: Ints, points: Floats) -> Floats:
    """(n, ...) values at the points xi (n, d), point i in element ``rows[i]`` of ``coefficients`` (e, ..., m)."""
    found = np.empty((len(points), *coefficients.shape[1:-1]))
    for some, tables, own in _batches(expansion, coefficients, rows, points, derivatives=False):
        found[some] = _contracted(own, tables).reshape(len(own), *found.shape[1:])
    return found


def values_and_gradients_at_points(
    expansion: Expansion, coefficients: Floats, rows: Ints, points: Floats
) -> tuple[Floats, Floats]:
    """`values_at_points`, and the gradients in xi (n, ..., d)."""
    dimension = expansion.shape.dimension
    values = np.empty((len(points), *coefficients.shape[1:-1]))
    gradients = np.empty((*values.shape, dimension))
    for some, tables, own in _batches(expansion, coefficients, rows, points, derivatives=True):
        found = _contracted(own, tables)
        values[some] = found[..., 0].reshape(len(own), *values.shape[1:])
        gradients[some] = found[..., 1 << np.arange(dimension)].reshape(len(own), *gradients.shape[1:])
    return values, gradients


def _batches(
    expansion: Expansion, coefficients: Floats, rows: Ints, points: Floats, derivatives: bool
) -> Iterator[tuple[slice, list[Floats], Floats]]:
    """Some of the points, their tables, the slowest direction first, and coefficients (n, c, k, …) at them."""
    counts = expansion.modes[::-1]
    components = int(np.prod(coefficients.shape[1:-1]))
    step = max(1, _NUMBERS // max(1, components * coefficients.shape[-1]))
    for first in range(0, len(points), _TABULATED):
        tables = _tables(expansion, points[first : first + _TABULATED], derivatives)[::-1]
        for start in range(first, min(first + _TABULATED, len(points)), step):
            some = slice(start, min(start + step, first + _TABULATED, len(points)))
            own = coefficients[rows[some]].reshape(-1, components, *counts)
            yield some, [table[some.start - first : some.stop - first] for table in tables], own


def _tables(expansion: Expansion, points: Floats, derivatives: bool) -> list[Floats]:
    """For each direction (n, 1 or 2, k) values of its factors, and derivatives where these are requested."""
    plan, count = product_plan(expansion), len(points)
    # directions with the same factors are tabulated together
    if len(set(zip(expansion.bases, expansion.modes, strict=True))) == 1:
        every = _table(plan.factors[0], plan.lines[0], points.T.reshape(-1), derivatives)
        return [every[direction * count : (direction + 1) * count] for direction in range(points.shape[1])]
    directions = zip(plan.factors, plan.lines, points.T, strict=True)
    return [_table(factors, lines, own, derivatives) for factors, lines, own in directions]


def _table(factors: Factors, lines: Ints, points: Floats, derivatives: bool) -> Floats:
    """(n, 1 or 2, k) values of the factors of a direction's modes, and derivatives where these are requested."""
    tables = factors.tables(points)[:2] if derivatives else (factors.values(points),)
    return np.stack([table[lines].T for table in tables], axis=1)


def _contracted(coefficients: Floats, tables: list[Floats]) -> Floats:
    """(n, c, t^d) coefficients (n, c, k, …) contracted with the t tables of all directions, the first the slowest."""
    count, components = coefficients.shape[:2]
    net, kinds = coefficients, 1
    for table in tables[:-1]:
        net = table[:, None, None] @ net.reshape(count, components, kinds, table.shape[2], -1)
        kinds *= table.shape[1]
    last = tables[-1]
    net = net.reshape(count, components, kinds, last.shape[2]) @ last[:, None].swapaxes(2, 3)
    return net.reshape(count, components, -1)
