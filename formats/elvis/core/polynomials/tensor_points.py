"""Sum factorization at single points: tensor-product expansions contracted with one direction's factors after another.

An element with p^d modes takes about 2 p^d products for a value and all its derivatives.  A table of all modes and of
their gradients takes (d + 1) p^d and has to be built first (Orszag 1980, as `lattices`).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.expansion import product_plan
from elvis.core.polynomials.factors import Factors

#: numbers of coefficients that are contracted together: they stay in the processor's cache
_NUMBERS = 1 << 16
#: points whose factors are tabulated together
_TABULATED = 1 << 12
#: points of an element, on average, from which their first contraction is one product
_SHARED = 4


def values_at_points(expansion: Expansion, coefficients: Floats, rows: Ints, points: Floats) -> Floats:
    """(n, ...) values at the points xi (n, d), point i in element ``rows[i]`` of ``coefficients`` (e, ..., m)."""
    found = np.empty((len(points), *coefficients.shape[1:-1]))
    for some, sums in _contracted(expansion, coefficients, rows, points, derivatives=False):
        found[some] = sums.reshape(len(sums), *found.shape[1:])
    return found


def values_and_gradients_at_points(
    expansion: Expansion, coefficients: Floats, rows: Ints, points: Floats
) -> tuple[Floats, Floats]:
    """`values_at_points`, and the gradients in xi (n, ..., d)."""
    dimension = expansion.shape.dimension
    values = np.empty((len(points), *coefficients.shape[1:-1]))
    gradients = np.empty((*values.shape, dimension))
    for some, sums in _contracted(expansion, coefficients, rows, points, derivatives=True):
        values[some] = sums[..., 0].reshape(len(sums), *values.shape[1:])
        gradients[some] = sums[..., 1 << np.arange(dimension)].reshape(len(sums), *gradients.shape[1:])
    return values, gradients


def _contracted(
    expansion: Expansion, coefficients: Floats, rows: Ints, points: Floats, derivatives: bool
) -> Iterator[tuple[Ints, Floats]]:
    """Some of the points, and the sums (k, c, t^d) of c components there with t tables a direction, the first slowest.

    The tables are a direction's values, and its derivatives where these are requested.
    """
    components = int(np.prod(coefficients.shape[1:-1]))
    slowest = expansion.modes[-1]
    nets = coefficients.reshape(len(coefficients), components, slowest, coefficients.shape[-1] // slowest)
    for first in range(0, len(points), _TABULATED):
        own = rows[first : first + _TABULATED]
        is_shared = len(own) >= _SHARED * len(np.unique(own))
        order = np.argsort(own, kind="stable") if is_shared else np.arange(len(own))
        tables = _tables(expansion, points[first + order], derivatives)[::-1]
        # numbers of a point: its element's net, or what is left of it where points share the net
        width = components * coefficients.shape[-1]
        if is_shared:
            width = width * tables[0].shape[1] // tables[0].shape[2]
        contract = _slowest_of_shared if is_shared else _slowest
        step = max(1, _NUMBERS // max(1, width))
        for start in range(0, len(own), step):
            part = slice(start, start + step)
            net = contract(nets, own[order[part]], tables[0][part])
            yield first + order[part], _others(net, [table[part] for table in tables[1:]])


def _slowest(nets: Floats, rows: Ints, table: Floats) -> Floats:
    """(c, n, t, r) nets (e, c, k, r) of elements (n,), contracted with tables (n, t, k) of the slowest direction."""
    return np.asarray(table @ nets[rows].swapaxes(0, 1))


def _slowest_of_shared(nets: Floats, rows: Ints, table: Floats) -> Floats:
    """`_slowest` for ascending rows: all points of an element in one product, which reads its net once."""
    count, kinds, width = table.shape
    found = np.empty((nets.shape[1], count * kinds, nets.shape[3]))
    flat = table.reshape(-1, width)
    starts = np.flatnonzero(np.diff(rows, prepend=-1)).tolist()
    # infinite coefficients give values that are not numbers
    with np.errstate(invalid="ignore"):
        for first, end in zip(starts, [*starts[1:], count], strict=True):
            own = slice(kinds * first, kinds * end)
            np.matmul(flat[own], nets[rows[first]], out=found[:, own])
    return found.reshape(-1, count, kinds, nets.shape[3])


def _others(net: Floats, tables: list[Floats]) -> Floats:
    """(n, c, t^d) nets (c, n, t, r) contracted with the tables (n, t, k) of the other directions."""
    components, count, kinds = net.shape[:3]
    for table in tables[:-1]:
        net = table[:, None] @ net.reshape(components, count, kinds, table.shape[2], -1)
        kinds *= table.shape[1]
    if tables:
        net = net.reshape(components, count, kinds, tables[-1].shape[2]) @ tables[-1].swapaxes(1, 2)
    return net.reshape(components, count, -1).swapaxes(0, 1)


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
