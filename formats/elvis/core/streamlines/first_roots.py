"""The first root in [0, 1] of polynomials in Bernstein form that begin at zero or above."""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Floats

_ROUNDS = 80
#: steps that are less than this don't bring a root nearer
_LEAST = 1e-16


def first_roots(nets: Floats) -> Floats:
    """(n,) where polynomials with Bernstein coefficients (n, degree + 1) first fall below zero; inf where they don't.

    A polynomial lies in the hull of its control points: up to where the lower side of the hull meets zero it has no
    root.  What lies beyond is taken for the whole, until nothing is left or the place moves no more; at a simple root
    that converges like Newton's method.  One that begins below zero begins at its root.
    """
    result = np.full(len(nets), np.inf)
    rows = np.flatnonzero((nets < 0).any(axis=1))
    own = nets[rows]
    low, width = np.zeros((2, len(rows)))
    width += 1
    for _ in range(_ROUNDS):
        if not len(rows):
            break
        ahead = _hull_crossing(own)
        moved = ahead * width
        none = ~np.isfinite(ahead)
        found = ~none & ((moved <= _LEAST) | (own[:, 0] <= 0))
        result[rows[found]] = low[found]
        left = ~none & ~found
        rows, own, low = rows[left], beyond(own[left], ahead[left]), low[left] + moved[left]
        width = width[left] * (1 - ahead[left])
    result[rows] = low
    return result


def bernstein_at(nets: Floats, places: Floats) -> Floats:
    """(n, …) values at places (n,) of polynomials with coefficients (n, degree + 1, …), by de Casteljau's rule."""
    t = places.reshape(-1, *(1,) * (nets.ndim - 1))
    for _ in range(nets.shape[1] - 1):
        nets = (1 - t) * nets[:, :-1] + t * nets[:, 1:]
    return np.asarray(nets[:, 0])


def _hull_crossing(nets: Floats) -> Floats:
    """(n,) where the hull of the control points first meets zero, if they begin above it; inf where it doesn't.

    Of all lines from a control point above zero to one below the hull has the first to meet it.
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
