"""Sum factorization: values of tensor-product expansions on a lattice, one direction after another.

On a lattice of q^d points, an element with p^d modes takes at most d p q^d products, while a table of all modes takes
p^d q^d (Orszag 1980, Spectral methods for problems in complex geometries).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.expansion import is_factored, product_plan
from elvis.core.polynomials.row_products import row_products

#: points of a direction from which factors pay
_LEAST = 2


class Line(NamedTuple):
    """One direction of a lattice.

    direction  of the element
    points     (q,) its coordinates
    """

    direction: int
    points: Floats


def lattice_lines(expansion: Expansion, points: Floats) -> list[Line] | None:
    """The lines of the lattice that reference points (n, d) form, the slowest first; None if they form no lattice.

    Also None for expansions that aren't tensor products.
    """
    count, dimension = points.shape
    if not is_factored(expansion) or count < _LEAST**dimension:
        return None
    steps = [_step(column) for column in points.T]
    lines, step = [], count
    for direction in sorted(range(dimension), key=lambda each: (-steps[each], each)):
        # a direction with one point has no step
        own = min(steps[direction], step)
        lines.append(Line(direction, points[:step:own, direction]))
        step = own
    found = np.meshgrid(*(line.points for line in lines), indexing="ij")
    if found[0].size != count:
        return None
    is_lattice = all(
        (points[:, line.direction] == own.reshape(-1)).all() for line, own in zip(lines, found, strict=True)
    )
    return lines if is_lattice else None


def _step(column: Floats) -> int:
    """Number of points at the beginning with the same coordinate (n,)."""
    others = np.flatnonzero(column != column[0])
    return int(others[0]) if len(others) else len(column)


def values_on_lattice(expansion: Expansion, coefficients: Floats, lines: Sequence[Line]) -> Floats:
    """(e, n) values of e elements with coefficients (e, m)."""
    factors = product_plan(expansion).factors
    tables = {line.direction: factors[line.direction].values(line.points) for line in lines}
    net, left = _net(expansion, coefficients)
    for line in lines:
        net = _contracted(expansion, net, left, line.direction, tables[line.direction])
        left = [direction for direction in left if direction != line.direction]
    return net.reshape(len(coefficients), -1)


def values_and_slopes_on_lattice(
    expansion: Expansion, coefficients: Floats, lines: Sequence[Line]
) -> tuple[Floats, Floats]:
    """(e, n) values and (d, e, n) derivatives in each direction of e elements with coefficients (e, m)."""
    factors = product_plan(expansion).factors
    net, left = _net(expansion, coefficients)
    # the partially contracted values, and derivatives in each direction contracted so far
    values, slopes = net, dict[int, Floats]()
    for line in lines:
        table = factors[line.direction].tables(line.points)
        slopes = {each: _contracted(expansion, own, left, line.direction, table[0]) for each, own in slopes.items()}
        slopes[line.direction] = _contracted(expansion, values, left, line.direction, table[1])
        values = _contracted(expansion, values, left, line.direction, table[0])
        left = [direction for direction in left if direction != line.direction]
    every = np.stack([slopes[i].reshape(len(net), -1) for i in range(len(lines))])
    return values.reshape(len(net), -1), every


def _net(expansion: Expansion, coefficients: Floats) -> tuple[Floats, list[int]]:
    """The coefficients, with an axis for each direction after the axis of elements, and these axes' directions."""
    return coefficients.reshape(-1, *expansion.modes[::-1]), list(range(len(expansion.modes)))[::-1]


def _contracted(expansion: Expansion, net: Floats, left: list[int], direction: int, table: Floats) -> Floats:
    """The net with the axis of modes of a direction, one of those ``left``, gone, and one of points as the last.

    table  (k, q) factors of the direction at its points
    """
    own = table[product_plan(expansion).lines[direction]]
    return row_products(np.moveaxis(net, 1 + left.index(direction), -1), own)
