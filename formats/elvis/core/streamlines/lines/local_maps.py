"""World positions of short steps of lines, by local polynomials of the map (local re-expansion).

Lines that nearly come to rest take thousands of steps within a small part of an element.  On such a part few terms of
the map's Chebyshev series suffice.  They are interpolated once for all steps there; the other terms estimate their
error.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.polynomial import chebyshev

from elvis.core.base.arrays import Floats, Ints, grid_points
from elvis.core.polynomials import chebyshev_nodes
from elvis.core.streamlines.velocity import Velocity

#: half width of cells in the coordinates of an element, and distance of their centres
_HALF = 2.0**-10
#: more than twice the cells between the middle of an element and its sides, for keys of cells
_MOST_CELLS = 1 << 12
#: points of a line of a cell at which the map is evaluated, and total degree of the terms that are retained
_POINTS, _DEGREE = 5, 3
#: points of steps from which on a cell takes less time than the map, in parts of the cell's points
_LEAST_POINTS = 2.0
#: maximum error of local polynomials, in parts of the tolerance
_PART = 0.25
#: steps whose positions are computed together
_AT_ONCE = 1 << 10


def positions_along(
    velocity: Velocity, number: int, rows: Ints, states: Floats, tolerance: float
) -> tuple[Floats, Floats]:
    """World positions (k, m, 3) of points (k, m, D) of steps in elements (k,) of a patch, and their errors (k,).

    Errors are estimates, a part of the tolerance at most; they are 0 where the map itself is evaluated.
    """
    places = np.empty((*states.shape[:2], 3))
    errors = np.zeros(len(rows))
    short, cell_of, cells = _cells_of_steps(rows, states)
    coefficients, error = _series_of_cells(velocity, number, *cells)
    # positions that are not numbers have errors that are not
    is_local = error[cell_of] <= _PART * tolerance
    local, cell_of = short[is_local], cell_of[is_local]
    errors[local] = error[cell_of]
    for first in range(0, len(local), _AT_ONCE):
        some, own = local[first : first + _AT_ONCE], cell_of[first : first + _AT_ONCE]
        inside = (states[some] - cells[1][own][:, None]) / _HALF
        places[some] = _terms(inside) @ coefficients[own]
    rest = np.setdiff1d(np.arange(len(rows)), local, assume_unique=True)
    places[rest] = velocity.positions(*repeated(number, rows[rest], states[rest])).reshape(
        len(rest), states.shape[1], 3
    )
    return places, errors


def repeated(number: int, rows: Ints, states: Floats) -> tuple[Ints, Ints, Floats]:
    """Patches, rows and reference points (k m, D) of points (k, m, D) in elements (k,)."""
    every = np.repeat(rows, states.shape[1])
    return np.full(len(every), number), every, states.reshape(len(every), states.shape[2])


def _cells_of_steps(rows: Ints, states: Floats) -> tuple[Ints, Ints, tuple[Ints, Floats]]:
    """Steps (s,) in cells with many of them, their cells (s,), and elements (c,) and centres (c, D) of cells."""
    low, high = states.min(axis=1), states.max(axis=1)
    index = np.rint(0.5 * (low + high) / _HALF)
    # a clock may be far beyond the coordinates of the element
    is_short = (high - low <= _HALF) & (np.abs(index) < _MOST_CELLS / 2)
    short = np.flatnonzero(is_short.all(axis=1))
    index, key = index[short].astype(np.int64), rows[short]
    for axis in range(index.shape[1]):
        key = key * _MOST_CELLS + index[:, axis] + _MOST_CELLS // 2
    _, first, cell_of, counts = np.unique(key, return_index=True, return_inverse=True, return_counts=True)
    is_shared = states.shape[1] * counts >= _LEAST_POINTS * _POINTS ** states.shape[2]
    shared, chosen = np.flatnonzero(is_shared), np.flatnonzero(is_shared[cell_of])
    number = np.searchsorted(shared, cell_of[chosen])
    example = first[shared]
    return short[chosen], number, (rows[short[example]], _HALF * index[example])


def _series_of_cells(velocity: Velocity, number: int, rows: Ints, centres: Floats) -> tuple[Floats, Floats]:
    """(c, terms, 3) coefficients of local polynomials of the map on cells, and (c,) their errors."""
    dimension = centres.shape[1]
    nodes, to_series = chebyshev_nodes.series(_POINTS - 1)
    points = centres[:, None] + _HALF * grid_points(*[nodes] * dimension)
    values = velocity.positions(*repeated(number, rows, points)).reshape(len(rows), *[_POINTS] * dimension, 3)
    for axis in range(1, dimension + 1):
        values = np.moveaxis(np.tensordot(to_series, values, axes=(1, axis)), 0, axis)
    series = values.reshape(len(rows), _POINTS**dimension, 3)
    is_kept = _degrees(dimension).sum(axis=1) <= _DEGREE
    # the dropped terms may be maximal everywhere; the factor 2 covers aliasing of terms beyond the series
    error = 2.0 * np.linalg.norm(np.abs(series[:, ~is_kept]).sum(axis=1), axis=1)
    return series[:, is_kept], error


@cache
def _degrees(dimension: int) -> Ints:
    """(terms, D) degrees of all terms of a series."""
    return np.indices([_POINTS] * dimension).reshape(dimension, -1).T


def _terms(points: Floats) -> Floats:
    """(..., terms) the retained products of Chebyshev polynomials at points (..., D)."""
    degrees = _degrees(points.shape[-1])
    kept = degrees[degrees.sum(axis=1) <= _DEGREE]
    tables = chebyshev.chebvander(points, _DEGREE)
    found = tables[..., 0, kept[:, 0]]
    for axis in range(1, points.shape[-1]):
        found = found * tables[..., axis, kept[:, axis]]
    return np.asarray(found)
