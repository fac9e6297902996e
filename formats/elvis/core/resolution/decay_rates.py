"""Decay rates of modal spectra, and the growth at the highest mode that aliasing leaves.

A spectrum holds the energies S_k^2 of the levels k = 0 … p of one factor of a basis (`modal_bases`).  If the amplitudes
fall like S_k = C e^(-σ k), σ is the decay rate (Mavriplis 1990, A posteriori error estimators for adaptive spectral
element techniques).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints

#: lowest order for which a rate is defined: level 0 is the mean, and a rate takes two more
LOWEST_ORDER = 2
#: order from which a single spectrum has enough levels to be continued
OWN_RATES_FROM = 5
#: highest levels that a rate is fitted to
_FITTED = 6
#: weights of four and six levels: those of the even and of the odd ones have the same centre
_BALANCED = {4: (1.0, 3.0, 3.0, 1.0), 6: (2.0, 5.0, 5.0, 5.0, 5.0, 2.0)}
#: Newton steps of a fit, the longest step in the rate, and the one at which a fit ends
_NEWTON_STEPS, _LONGEST_STEP, _LAST_STEP = 60, 1.0, 1e-9
#: logarithm of the ratio of two likelihoods beyond which one law is certain
_MOST_ADVANTAGE = 50.0
#: exponents of algebraic laws above this one are unlikely before anything is fitted: that of r^1.5 in the plane is 5.5
_TYPICAL_EXPONENT = 5.0
#: least factor by which the energy beyond the highest level is lowered where spectra fall ever faster
_LEAST_FACTOR = 0.25
#: rate that replaces lower ones when a spectrum is continued: for a rate of zero the sum diverges
LEAST_RATE = 0.1
#: exponent that replaces lower ones when an algebraic law is continued, for the same reason
_LEAST_EXPONENT = 0.75
#: order from which growth is distinguished from a field that is even or odd
_GROWTH_FROM = 3


def decay_rates(energies: Floats, floor: float) -> Floats:
    """(n,) decay rates of spectra.

    Energies scatter about their law, S_k^2 = C^2 e^(-2 σ k) X_k, as the phase of the field in the element changes: X_k
    is often near zero, and every second one is for even and odd functions.  A line through (k, log S_k) would follow
    the empty levels.  The rate is that of the most likely law for exponentially distributed X_k (Whittle 1953,
    Estimation and information in stationary time series), which minimises

        sum over k of w_k (log m_k + S_k^2 / m_k),      m_k = C^2 e^(-2 σ k).

    It is exact for an exponential law.  Weights are 1; those of four and of six levels are such that it is exact as
    well if the even or the odd levels are empty.  Up to six levels count, from the highest down, without level 0, the
    mean.

    Parameters
    ----------
    energies : (n, p + 1) array
        Energies of the levels.
    floor : float
        Amplitude that is rounding.  Levels below it are ignored, or the next one counts as the floor where only one
        level is above.

    Returns
    -------
    (n,) array
        Rates per level; NaN for orders below 2.  Where all levels are rounding, the rate is that from an amplitude of 1
        to the floor, relative to the largest level; where only the highest is not, the rate is zero.
    """
    order = energies.shape[1] - 1
    if order < LOWEST_ORDER:
        return np.full(len(energies), np.nan)
    spectra = _Fitted.of(energies, floor)
    rates = np.where(spectra.is_top_alone, 0.0, spectra.rates_of_levels)
    return np.where(spectra.is_known, rates, resolved_rate(floor))


@dataclass(frozen=True, eq=False)
class _Fitted:
    """The levels of spectra that a fit uses.

    levels        (j,) ascending
    energies      (n, j) of the levels, at least the floor
    weights       (n, j) of the levels in the fit
    is_known      (n,) whether any level is above the floor
    is_top_alone  (n,) whether only the highest level is
    """

    levels: Floats
    energies: Floats
    weights: Floats
    is_known: Bools
    is_top_alone: Bools

    @staticmethod
    def of(energies: Floats, floor: float) -> _Fitted:
        """The highest levels of spectra (n, p + 1)."""
        # the square of the floor must not underflow
        least = max(floor, np.sqrt(np.finfo(float).tiny)) ** 2
        order = energies.shape[1] - 1
        levels = np.arange(max(1, order - _FITTED + 1), order + 1)
        own = energies[:, levels]
        is_above = own > least
        weights = _used(is_above) * np.array(_BALANCED.get(len(levels), (1.0,) * len(levels)))
        is_top_alone = is_above[:, -1] & (is_above.sum(axis=1) == 1)
        return _Fitted(
            levels.astype(np.float64), np.maximum(own, least), weights, is_above.any(axis=1), np.asarray(is_top_alone)
        )

    @property
    def rates_of_levels(self) -> Floats:
        """(n,) rates per level."""
        return self.rates(self.levels)

    def rates(self, places: Floats) -> Floats:
        """(n,) rates of the most likely law that falls exponentially along places (j,) of the levels."""
        return _fitted(places, self.energies, self.weights)

    def losses(self, places: Floats, rates: Floats) -> Floats:
        """(n,) minus the logarithm of the likelihood of the laws of rates, up to a constant."""
        flat = self.energies * np.exp(2 * rates[:, None] * (places - places[-1]))
        counts = (self.weights > 0).sum(axis=1)
        share = self.weights / np.maximum(self.weights.sum(axis=1, keepdims=True), 1.0)
        mean = (share * flat).sum(axis=1)
        middle = (share * (places - places[-1])).sum(axis=1)
        return np.asarray(counts * (np.log(np.maximum(mean, np.finfo(float).tiny)) - 2 * rates * middle))


def _fitted(places: Floats, energies: Floats, weights: Floats) -> Floats:
    """(n,) most likely rates of energies (n, j) at places (j,), with weights (n, j).

    For a rate σ, the best C^2 is the weighted mean of E_k = S_k^2 e^(2 σ k).  What remains to be minimised is
    log sum w_k E_k - 2 σ k_mean, a convex function of σ.
    """
    share = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1.0)
    middle = (share * places).sum(axis=1, keepdims=True)
    distance = places - middle
    logarithms = np.log(energies)

    # a regression line is the start
    size = (share * distance**2).sum(axis=1)
    rates = -0.5 * (share * distance * logarithms).sum(axis=1) / np.where(size > 0, size, 1.0)
    for _ in range(_NEWTON_STEPS):
        exponents = logarithms + 2 * rates[:, None] * distance
        exponents -= np.where(share > 0, exponents, -np.inf).max(axis=1, initial=-np.inf, keepdims=True)
        parts = np.where(share > 0, share * np.exp(np.minimum(exponents, 0.0)), 0.0)
        parts /= np.maximum(parts.sum(axis=1, keepdims=True), np.finfo(float).tiny)
        slope = (parts * distance).sum(axis=1)
        curvature = 2 * ((parts * distance**2).sum(axis=1) - slope**2)
        step = np.clip(slope / np.where(curvature > 0, curvature, 1.0), -_LONGEST_STEP, _LONGEST_STEP)
        rates -= step
        if np.abs(step).max(initial=0.0) < _LAST_STEP:
            break
    return rates


def resolved_rate(floor: float) -> float:
    """The rate of a spectrum in which nothing but the mean is above rounding."""
    return float(-np.log(max(min(floor, 0.1), np.finfo(float).eps)))


def _used(is_above: Bools) -> Floats:
    """(n, j) 1 for the levels that a fit uses: those above the floor, and one below it where only one is above."""
    used = is_above.copy()
    rows = np.flatnonzero(is_above.sum(axis=1) == 1)
    # the next higher level; that of the highest one is the next lower level
    only = is_above[rows].argmax(axis=1)
    used[rows, np.where(only + 1 < is_above.shape[1], only + 1, only - 1)] = True
    return used.astype(np.float64)


def acceleration(energies: Floats) -> float:
    """Factor, at most 1, of the energy beyond the highest level where spectra (n, p + 1) fall ever faster.

    The rate of an entire function grows with the level: at the highest two it is larger than that of the fit.  Both are
    taken from the sum of the spectra, in which the phases of the field in the elements have averaged out; if they have
    not, as in a layer along a row of elements, the limit holds.
    """
    total = np.nansum(energies, axis=0, keepdims=True)
    fitted = np.exp(-4 * np.maximum(_Fitted.of(total, 0.0).rates_of_levels, LEAST_RATE))
    top = min(float(total[0, -1] / total[0, -2]) ** 2, float(fitted[0])) if total[0, -2] > 0 else float(fitted[0])
    return max(top / (1 - top) * (1 - float(fitted[0])) / float(fitted[0]), _LEAST_FACTOR)


def remainder_shares(energies: Floats, floor: float, factor: float = 1.0) -> Floats:
    """(n,) energy beyond the highest level p, relative to the levels p and p - 1, if the spectrum goes on as it fell.

    Two levels are continued, because the next ones are empty where these are.  Spectra of functions that are smooth on
    the element fall exponentially, others like k^-β (Gottlieb and Orszag 1977, Numerical Analysis of Spectral Methods,
    section 3).  Both laws are fitted; the result is their geometric mean, weighted by their likelihoods.

    Parameters
    ----------
    energies : (n, p + 1) array
        Energies of the levels, or their sums over neighbouring elements; p is at least 2.
    floor : float
        Amplitude that is rounding.
    factor : float
        `acceleration` of exponential laws.
    """
    order = energies.shape[1] - 1
    spectra = _Fitted.of(energies, floor)
    rates = spectra.rates_of_levels
    fourth = np.exp(-4 * np.maximum(rates, LEAST_RATE))
    shares = factor * fourth / (1 - fourth)
    # sum over k > p of k^-2β = (p + 1/2)^(1 - 2 β) / (2 β - 1), with k in the middle of its interval
    places = np.log(spectra.levels)
    exponents = spectra.rates(places)
    bounded = np.maximum(exponents, _LEAST_EXPONENT)
    slow = (order + 0.5) ** (1 - 2 * bounded) / (2 * bounded - 1)
    slow /= float(order) ** (-2 * bounded) + (order - 1.0) ** (-2 * bounded)
    advantage = spectra.losses(spectra.levels, rates) - spectra.losses(places, exponents)
    advantage -= (bounded / _TYPICAL_EXPONENT) ** 2
    part = 1 / (1 + np.exp(-np.clip(advantage, -_MOST_ADVANTAGE, _MOST_ADVANTAGE)))
    return np.asarray(slow**part * shares ** (1 - part))


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
