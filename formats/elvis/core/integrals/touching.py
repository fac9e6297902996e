"""Sides of elements so near a surface g = 0 that rounding decides which element contains the surface.

If a surface touches a side, the two elements see its end at different lines: values that differ by delta move the end
by the root of delta.  The strip between these lines is counted twice or not at all.  The strip is part of the set |g|
<= delta on the side.  Its share of a box is at most 2 delta / m if a derivative is at least m, and 4 sqrt(delta / c) if
a second derivative is at least c (van der Corput's lemma on sets of small values).  Bernstein nets give m and c.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from elvis.core.base.arrays import Floats, Ints, grid_points
from elvis.core.integrals.reference_cells import Piece, side_numbers, side_shape
from elvis.core.integrals.subcells import corners, subcell_map
from elvis.core.mapping import pointwise, tangents
from elvis.core.polynomials.boxnets import all_halves

#: bisections of boxes on which no derivative keeps its sign, and the maximum number of boxes at once
_DEPTH, _MANY = 14, 1 << 14
#: shares that count: a surface that crosses a side leaves less, as much as moving it does elsewhere
_LEAST = 1e-12

#: nets (n, D, …) of g on rows (n,) of a patch, from the reference points (m, d) of a lattice
Nets = Callable[[Ints, Floats], Floats]


def touched(piece: Piece, nets: Nets, places: Floats, within: Floats) -> Floats:
    """(n,) area, in 2D length, of the sides of elements on which |g| may be ``within`` (n,) or less: as a rule at most.

    places  (m,) in [0, 1], from which nets are made each way
    """
    found, k = np.zeros(len(piece)), piece.patch.shape.dimension - 1
    lattice = grid_points(*[places] * k)
    for number in side_numbers(piece.patch.shape) if len(piece) else ():
        side = Piece(piece.patch, piece.rows, side_shape(piece.patch.shape, number), number)
        for cell in range(len(corners(side.shape))):
            xi, derivatives = subcell_map(side.shape, np.full(len(lattice), cell), lattice)
            reference = side.places(xi)
            shares = _shares(nets(piece.rows, reference), within)
            here = np.flatnonzero(shares > 0)
            if len(here):
                found[here] += _extents(side.part(here), reference, derivatives) * shares[here]
    return found


def _extents(side: Piece, reference: Floats, derivatives: Floats) -> Floats:
    """(n,) areas of parts of sides if they were everywhere as at the worst of some points (m, d)."""
    rows = np.repeat(side.rows, len(reference))
    jacobians = pointwise.jacobians(side.patch, rows, np.tile(reference, (len(side), 1)))
    along = side.along(jacobians) @ np.tile(derivatives, (len(side), 1, 1))
    measures = np.abs(tangents.determinants(along))
    return np.asarray(measures.reshape(len(side), -1).max(axis=1))


def _shares(nets: Floats, within: Floats) -> Floats:
    """(n,) bounds of the shares of [0, 1]^k where polynomials with nets (n, D, …) are within (n,) of zero."""
    k, row = nets.ndim - 1, np.arange(len(nets))
    found = np.zeros(len(nets))
    for depth in range(_DEPTH + 1):
        axes = tuple(range(1, nets.ndim))
        is_near = (nets.min(axis=axes) <= within[row]) & (nets.max(axis=axes) >= -within[row])
        nets, row = nets[is_near], row[is_near]
        if not len(nets):
            break
        by_slope, by_bend = _bounds(nets, within[row])
        is_last = depth == _DEPTH or len(row) << k > _MANY
        is_done = (by_slope <= by_bend) | is_last
        bound = np.minimum(by_slope, by_bend)[is_done]
        found += np.bincount(row[is_done], bound / 2 ** (k * depth), len(found))
        nets, row = all_halves(nets[~is_done]), np.tile(row[~is_done], 2**k)
    return np.where(found > _LEAST, found, 0.0)


def _bounds(nets: Floats, within: Floats) -> tuple[Floats, Floats]:
    """(n,) bounds of shares by the first, and by the second derivatives; 2 and 1 if these have no sign."""
    by_slope, by_bend = np.full(len(nets), 2.0), np.ones(len(nets))
    with np.errstate(divide="ignore"):
        for axis in range(1, nets.ndim):
            degree = nets.shape[axis] - 1
            slope = _least(np.diff(nets, axis=axis)) * degree
            by_slope = np.minimum(by_slope, 2 * within / slope)
            if degree > 1:
                bend = _least(np.diff(nets, 2, axis=axis)) * degree * (degree - 1)
                by_bend = np.minimum(by_bend, 4 * np.sqrt(within / bend))
    return by_slope, by_bend


def _least(nets: Floats) -> Floats:
    """(n,) lower bounds of the magnitudes of polynomials; 0 if they may vanish."""
    axes = tuple(range(1, nets.ndim))
    return np.asarray(np.maximum(np.maximum(nets.min(axis=axes), -nets.max(axis=axes)), 0.0))
