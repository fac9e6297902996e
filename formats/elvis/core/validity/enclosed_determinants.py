"""Quick bounds of the Jacobian determinant of hexahedra: few Chebyshev terms in Bernstein form, the rest by its size.

The exact Bernstein net of a determinant (`determinants`) has (3 p)^3 coefficients, each a sum of up to 8 p^3 products.
Values at Chebyshev points take O(p^4) operations, one direction after the other.  The determinant has degree 3 p - 1
in every direction, so that many values give all its Chebyshev coefficients.  On most elements they decay fast:

1. the terms of degree below LOW in every direction become a small Bernstein net, whose extrema bound them;
2. |T_k| <= 1, so the other terms add at most the sum of their magnitudes;
3. rounding is bounded as in `_slack`.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import permutations
from math import comb

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.chebyshev_models.series import along_axes, amplification
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.polynomials.chebyshev_nodes import series
from elvis.core.polynomials.rounding import UNIT, gamma, value_roundings
from elvis.core.validity.determinants import Polynomials, tangents

#: terms in each direction that become a Bernstein net
LOW = 6
#: roundings of an entry of the transform to coefficients, and of a determinant from its nine entries
_ENTRY, _DETERMINANT = 8, 8


@dataclass(frozen=True, eq=False)
class Enclosures:
    """Bounds of n determinants on their elements.

    lower, upper    (n,)    bounds, rounding included; NaN or infinite where the map isn't finite
    minimum, maximum (n,)    minimum and maximum of the computed values at points
    reference       (n, 3)  coordinates of the minimum
    error           (n,)    how far computed values may be from the true ones
    """

    lower: Floats
    upper: Floats
    minimum: Floats
    maximum: Floats
    reference: Floats
    error: Floats


def enclosures(expansion: Expansion, coefficients: Floats) -> Enclosures:
    """Bounds of the Jacobian determinants of n hexahedra with ``coefficients`` (n, 3, m)."""
    columns = tangents(expansion, coefficients)
    degrees = [sum(column[0].space.degrees[axis] for column in columns) for axis in range(3)]
    points = [np.array([-1.0, *series(degree)[0], 1.0]) for degree in degrees]
    values = _determinants([[_values(own, points) for own in column] for column in columns])
    error = _error(columns)

    # the ends of the lines of points are no nodes
    inner = np.ascontiguousarray(values[:, 1:-1, 1:-1, 1:-1])
    terms = along_axes(inner, *(series(degree)[1] for degree in degrees))
    low = terms[:, :LOW, :LOW, :LOW]
    net = along_axes(np.ascontiguousarray(low), *(_to_bernstein(size) for size in low.shape[:0:-1]))
    flat, net = values.reshape(len(values), -1), net.reshape(len(net), -1)
    slack = _rest(terms) + _slack(np.abs(flat).max(axis=1), low, degrees, error)
    place = np.unravel_index(np.argmin(flat, axis=1), values.shape[1:])
    return Enclosures(
        lower=net.min(axis=1) - slack,
        upper=net.max(axis=1) + slack,
        minimum=flat.min(axis=1),
        maximum=flat.max(axis=1),
        reference=np.stack([line[rows] for line, rows in zip(points, place[::-1], strict=True)], axis=1),
        error=error,
    )


def _values(own: Polynomials, points: list[Floats]) -> Floats:
    """(n, c, b, a) values on the lattice of the points of each direction, the first direction last."""
    net = np.ascontiguousarray(own.net.T).reshape(-1, *(degree + 1 for degree in own.space.degrees[::-1]))
    tables = [line_tables(degree, (1 + x) / 2)[0] for degree, x in zip(own.space.degrees, points, strict=True)]
    return along_axes(net, *tables)


def _determinants(columns: list[list[Floats]]) -> Floats:
    """The determinants of matrices, given by their columns."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = columns
    return (ay * bz - az * by) * cx + (az * bx - ax * bz) * cy + (ax * by - ay * bx) * cz


def _error(columns: list[list[Polynomials]]) -> Floats:
    """(n,) how far computed determinants are from the true ones at any point of a lattice.

    With |a|, |a'| <= A and |a - a'| <= e, and b, c likewise, |a b c - a' b' c'| <= e_a B C + A e_b C + A B e_c.
    """
    found = np.zeros(columns[0][0].net.shape[1])
    sizes, errors = [], []
    for column in columns:
        roundings = gamma(value_roundings([degree + 1 for degree in column[0].space.degrees]))
        errors.append([own.error + roundings * own.magnitude for own in column])
        sizes.append([own.magnitude + error for own, error in zip(column, errors[-1], strict=True)])
    for i, j, k in permutations(range(3)):
        a, b, c = sizes[0][i], sizes[1][j], sizes[2][k]
        found += errors[0][i] * b * c + a * errors[1][j] * c + a * b * errors[2][k]
        found += gamma(_DETERMINANT) * a * b * c
    return found


def _rest(terms: Floats) -> Floats:
    """(n,) the sum of the magnitudes of the terms that aren't in the net."""
    sizes = np.abs(terms)
    sizes[:, :LOW, :LOW, :LOW] = 0.0
    return np.asarray(sizes.sum(axis=(1, 2, 3)))


def _slack(greatest: Floats, low: Floats, degrees: list[int], error: Floats) -> Floats:
    """(n,) how far rounding may move the polynomial that the coefficients describe, and its net.

    Errors of the values are amplified by at most the Lebesgue constant.  A pass of the transform has sums of n terms
    with factors of at most 2 / n, so it doubles magnitudes at most.  A net's coefficients are sums of three passes.
    """
    count = max(degrees) + 1
    passes = sum(degree + 1 + _ENTRY for degree in degrees)
    transformed = 8 * gamma(passes) * np.prod([degree + 1.0 for degree in degrees]) * greatest
    raised = along_axes(np.abs(low), *(np.abs(_to_bernstein(size)) for size in low.shape[:0:-1]))
    spread = gamma(3 * (LOW + _ENTRY)) * raised.reshape(len(low), -1).max(axis=1)
    return np.asarray((1 + 64 * UNIT) * (amplification(count) * error + transformed + spread))


@bounded_cache
def _to_bernstein(size: int) -> Floats:
    """(size, size) from the coefficients of T_0 to T_(size - 1) to Bernstein coefficients of degree size - 1.

    From the coefficients a_j of t^j, x = 2 t - 1, follow b_i = sum_j binom(i, j) / binom(size - 1, j) a_j; all are
    exact rationals, rounded once.
    """
    degree = size - 1
    zero, one = Fraction(0), Fraction(1)
    columns = [[one], [-one, 2 * one]]
    while len(columns) < size:
        last, before = columns[-1], [*columns[-2], zero, zero]
        # T_(k + 1) = 2 x T_k - T_(k - 1)
        doubled = [2 * (2 * up - own) for up, own in zip([zero, *last], [*last, zero], strict=True)]
        columns.append([own - old for own, old in zip(doubled, before, strict=True)])
    rows = [
        [sum(Fraction(comb(i, j), comb(degree, j)) * a for j, a in enumerate(column)) for column in columns[:size]]
        for i in range(size)
    ]
    return frozen_floats([[float(own) for own in row] for row in rows])
