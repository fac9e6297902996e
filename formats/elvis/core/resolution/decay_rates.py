"""Decay rates of modal spectra, and the growth at the highest mode that aliasing leaves.

A spectrum holds the energies S_k^2 of the levels k = 0 … p of one factor of a basis (`modal_bases`).  If the amplitudes
fall like S_k = C e^(-σ k), σ is the decay rate (Mavriplis 1990, A posteriori error estimators for adaptive spectral
element techniques).
"""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints

#: lowest order for which a rate is defined: level 0 is the mean, and a rate takes two more
LOWEST_ORDER = 2
#: order from which levels come in separate pairs
_PAIRED_FROM = 4
#: pairs of levels that a rate is fitted to, from the highest down
_PAIRS = 3
#: rate that replaces lower ones when a spectrum is continued: for a rate of zero the sum diverges
LEAST_RATE = 0.1
#: order from which growth is distinguished from a field that is even or odd
_GROWTH_FROM = 3


def decay_rates(energies: Floats, floor: float) -> Floats:
    """(n,) decay rates of spectra.

    Two neighbouring levels are taken together, because every second level of an even or odd function is empty:

        e_k^2 = S_k^2 + S_(k-1)^2 = C^2 (1 + e^(2 σ)) e^(-2 σ k)

    falls at the same rate as S_k.  The rate is minus the slope of the line through (k, log e_k), by least squares.
    Orders 4 and more use up to three disjoint pairs from the highest level down.  Lower orders have no two pairs: there
    the rate is the slope of an edge of the upper hull of the points (k, log S_k), which skips empty levels as well.
    Level 0, the mean, does not count.

    Parameters
    ----------
    energies : (n, p + 1) array
        Energies of the levels.
    floor : float
        Amplitude that is rounding.  Pairs below it are ignored, or count as the floor where only one pair is above.

    Returns
    -------
    (n,) array
        Rates per level; NaN for orders below 2.  Where all pairs are rounding, the rate is that from an amplitude of 1
        to the floor, relative to the largest level.
    """
    order = energies.shape[1] - 1
    if order < LOWEST_ORDER:
        return np.full(len(energies), np.nan)
    # its square must not underflow
    least = max(floor, np.sqrt(np.finfo(float).tiny))
    if order < _PAIRED_FROM:
        rates = _hull_slopes(0.5 * np.log(np.maximum(energies[:, 1:], least**2)))
        is_above = energies[:, 1:] > least**2
    else:
        tops = np.arange(order, 1, -2)[:_PAIRS]
        pairs = energies[:, tops] + energies[:, tops - 1]
        is_above = pairs > least**2
        rates = _fitted(tops, 0.5 * np.log(np.maximum(pairs, least**2)), _used(is_above))
    return np.where(is_above.any(axis=1), rates, resolved_rate(floor))


def _fitted(places: Ints, logarithms: Floats, used: Floats) -> Floats:
    """(n,) minus the slopes of the regression lines through (places (j,), logarithms (n, j)), with weights 0 or 1."""
    middle = (used * places).sum(axis=1) / used.sum(axis=1).clip(1)
    distance = used * (places - middle[:, None])
    size = (distance**2).sum(axis=1)
    return np.asarray(-(distance * logarithms).sum(axis=1) / np.where(size > 0, size, 1.0))


def _hull_slopes(logarithms: Floats) -> Floats:
    """(n,) minus the slopes of the upper hull of two or three points (n, j), one apart, over the middle.

    If the hull has a corner in the middle, the edge that falls less steeply counts: the other one leads to an
    empty level.
    """
    if logarithms.shape[1] == LOWEST_ORDER:
        return np.asarray(logarithms[:, 0] - logarithms[:, 1])
    first, second, third = logarithms.T
    rise, fall = first - second, second - third
    corner = np.where((rise > 0) & (rise < fall), rise, fall)
    is_corner = second > 0.5 * (first + third)
    return np.asarray(np.where(is_corner, corner, 0.5 * (first - third)))


def resolved_rate(floor: float) -> float:
    """The rate of a spectrum in which nothing but the mean is above rounding."""
    return float(-np.log(max(min(floor, 0.1), np.finfo(float).eps)))


def _used(is_above: Bools) -> Floats:
    """(n, j) 1 for the pairs that a fit uses: those above the floor, and one below it where only one is above."""
    used = is_above.copy()
    is_single = is_above.sum(axis=1) == 1
    first = is_above.argmax(axis=1)
    # the pair of the next higher levels; the pair of the highest levels has only lower ones next to it
    beside = np.where(first > 0, first - 1, 1)
    rows = np.flatnonzero(is_single)
    used[rows, beside[rows]] = True
    return used.astype(np.float64)


def highest_energies(energies: Floats) -> Floats:
    """(n, 3) energies of the level p, of p - 1, and of p - 2 and p - 3 together, from which `remainder_shares` goes on.

    Level 0 does not count; zero for orders below 2.
    """
    order = energies.shape[1] - 1
    found = np.zeros((len(energies), 3))
    if order >= LOWEST_ORDER:
        found[:, :2] = energies[:, [order, order - 1]]
        found[:, 2] = energies[:, max(1, order - 3) : order - 1].sum(axis=1)
    return found


def remainder_shares(highest: Floats, order: int) -> tuple[Floats, Floats]:
    """(n,) energy beyond the highest level p, relative to the levels p and p - 1, estimated in two ways.

    If the energies of levels fall by r, the share is r^2 / (1 - r^2).  The first estimate takes r^2 as the quotient of
    the two pairs of levels; for order 3 the lower pair is a level, and the quotient r + r^2; order 2 has no lower pair.
    It varies little from element to element, but is too large where levels fall ever faster.  The second takes
    r = S_p^2 / S_(p-1)^2, which is right on average, but varies with the phase of the field in an element.

    Parameters
    ----------
    highest : (n, 3) array
        Energies of `highest_energies`, or their sums over neighbouring elements.
    order : int
        Highest level p.
    """
    top, second, lower = highest.T
    ratio = _quotient(top, second)
    if order > LOWEST_ORDER:
        squares = _quotient(top + second, lower)
        if order < _PAIRED_FROM:
            squares = (0.5 * (np.sqrt(1 + 4 * squares) - 1)) ** 2
    else:
        squares = ratio**2
    return _geometric(squares), _geometric(ratio**2)


def _quotient(numerator: Floats, denominator: Floats) -> Floats:
    """(n,) quotients of energies; infinite for a positive number over zero, zero for zero over zero."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(denominator > 0, numerator / denominator, np.where(numerator > 0, np.inf, 0.0))


def _geometric(squares: Floats) -> Floats:
    """(n,) q / (1 - q), with q limited by the smallest rate."""
    bounded = np.minimum(squares, np.exp(-4 * LEAST_RATE))
    return np.asarray(bounded / (1 - bounded))


def grows_at_top(energies: Floats, counts: Ints, least: float) -> Bools:
    """(n,) whether a mode of the highest level holds more energy in the mean than one of the two levels below.

    Both levels below are compared, because every second one of an even or odd function is empty.  Orders below 3 have
    too few levels: False.

    Parameters
    ----------
    energies : (n, p + 1) array
        Energies of the levels.
    counts : (p + 1,) array
        Number of modes of each level.
    least : float
        Amplitude below which growth is not reported.
    """
    if energies.shape[1] - 1 < _GROWTH_FROM:
        return np.zeros(len(energies), bool)
    means = energies / counts
    grows = means[:, -1] > means[:, -3:-1].max(axis=1)
    return np.asarray(grows & (energies[:, -1] > least**2))
