"""The first root in [0, 1] of polynomials in Bernstein form that begin at zero or above."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats

#: rounds at most: each moves the place by a whole window, halves the value there, or makes the window shorter
_ROUNDS = 400
#: steps that are less than this don't bring a root nearer
_LEAST = 1e-16
#: a window's length after a round without progress, and the growth after a window without a root
_SHORTER = 0.25
_LONGER = 4.0


def first_roots(nets: Floats) -> Floats:
    """(n,) first places where polynomials with Bernstein coefficients (n, degree + 1) fall below zero.

    Inf if they don't.

    A polynomial lies in the hull of its control points on each window [low, low + width].  It has no root up to the
    point where the lower side of the hull meets zero, so ``low`` moves there, which converges like Newton's method at a
    simple root.  If the value at ``low`` doesn't fall, as after a place where the polynomial starts near zero and
    rises, the window is shortened.  A polynomial that starts below zero has its root at the start.
    """
    result = np.full(len(nets), np.inf)
    rows = np.flatnonzero((nets < 0).any(axis=1))
    low = np.zeros(len(rows))
    width = np.ones(len(rows))
    for _ in range(_ROUNDS):
        if not len(rows):
            break
        window = _window(nets[rows], low, width)
        ahead = _hull_crossing(window)
        is_free = ~np.isfinite(ahead)
        moved = np.where(is_free, 1.0, ahead) * width
        is_found = ~is_free & ((moved <= _LEAST) | (window[:, 0] <= 0))
        result[rows[is_found]] = low[is_found]

        # a window that has no root gives way to a longer one behind it; no progress needs a shorter one
        is_slow = ~is_free & (beyond(window, np.where(is_free, 0.0, ahead))[:, 0] > 0.5 * window[:, 0])
        low = low + moved
        rest = np.where(is_slow, _SHORTER * width, width - moved)
        width = np.minimum(np.where(is_free, _LONGER * width, rest), 1 - low)
        left = ~is_found & (low < 1)
        rows, low, width = rows[left], low[left], width[left]
    result[rows] = low
    return result


def _window(nets: Floats, low: Floats, width: Floats) -> Floats:
    """(n, degree + 1) polynomials with coefficients (n, degree + 1) on [low, low + width] (n,)."""
    with np.errstate(invalid="ignore"):
        part = np.minimum(width / (1 - low), 1.0)
    return before(beyond(nets, low), part)


def bernstein_at(nets: Floats, places: Floats) -> Floats:
    """(n, …) values at places (n,) of polynomials with coefficients (n, degree + 1, …), by de Casteljau's rule."""
    t = places.reshape(-1, *(1,) * (nets.ndim - 1))
    for _ in range(nets.shape[1] - 1):
        nets = (1 - t) * nets[:, :-1] + t * nets[:, 1:]
    return np.asarray(nets[:, 0])


def _hull_crossing(nets: Floats) -> Floats:
    """(n,) first place where the hull of the control points meets zero, if they begin above it; inf if it doesn't.

    The hull's crossing is the first among all lines from a control point above zero to one below.
    """
    places = np.linspace(0.0, 1.0, nets.shape[1])
    above = np.where(nets < 0, np.nan, nets)[:, :, None]
    above[:, 0] = np.maximum(nets[:, :1], 0.0)
    below = np.where(nets < 0, nets, np.nan)[:, None, :]
    part = above / (above - below)
    crossings = places[:, None] + part * (places - places[:, None])
    return np.asarray(np.where(np.isnan(crossings), np.inf, crossings).min(axis=(1, 2)))


def before(nets: Floats, places: Floats) -> Floats:
    """(n, degree + 1, …) the polynomials with coefficients (n, degree + 1, …) from 0 to ``places`` (n,)."""
    return beyond(nets[:, ::-1], 1 - places)[:, ::-1]


def beyond(nets: Floats, places: Floats) -> Floats:
    """(n, degree + 1, …) the polynomials with coefficients (n, degree + 1, …) from ``places`` (n,) to 1."""
    t = places.reshape(-1, *(1,) * (nets.ndim - 1))
    right = [nets[:, -1:]]
    for _ in range(nets.shape[1] - 1):
        nets = (1 - t) * nets[:, :-1] + t * nets[:, 1:]
        right.append(nets[:, -1:])
    return np.concatenate(right[::-1], axis=1)
