"""Directions in which surfaces g = 0 are graphs over boxes, and how far rounding moves these, from Bernstein nets."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import permutations

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, rows_by_number

#: minimum derivative along the height of a graph, relative to the others
_STEEP = 0.1
#: the same for graphs that are not bisected along their height
_UPRIGHT = 0.65


def orders(nets: Floats, are_ends_free: bool) -> tuple[Ints, Bools]:
    """For each net (n, D, D, D) the axes i, j, k in which g = 0 is a graph with such ends, and whether there are."""
    steepness = _steepness_by_axis(nets)
    order = np.tile(np.arange(3), (len(nets), 1))
    best = np.full(len(nets), _STEEP)
    for axes in _candidates(nets):
        score = steepness[axes[-1]]
        better = np.flatnonzero(score > best)
        if not are_ends_free:
            turned_nets = nets[better].transpose(0, *(1 + axis for axis in axes))
            better = better[_are_ends_graphs(turned_nets)]
        best[better], order[better] = score[better], axes
    return order, best > _STEEP


def _candidates(nets: Floats) -> Iterator[tuple[int, ...]]:
    """Orders of the axes: without a first direction that stays the first."""
    return (axes for axes in permutations(range(3)) if nets.shape[1] > 1 or axes[0] == 0)


def _steepness_by_axis(nets: Floats, sizes: Floats | None = None) -> Floats:
    """(d, n) lower bounds of the derivatives along each axis, relative to the largest of all.

    sizes  (n, d) of the units of the axes, 1 if not given

    At most 0 if the sign is unknown, and along an axis with one coefficient.

    If it is small, the surface is steep and rules converge slowly.
    """
    axes = tuple(range(1, nets.ndim))
    least, most = np.zeros((len(axes), len(nets))), np.zeros(len(nets))
    for axis in axes:
        if nets.shape[axis] > 1:
            slopes = np.diff(nets, axis=axis)
            low, high = slopes.min(axis=axes), slopes.max(axis=axes)
            unit = 1.0 if sizes is None else sizes[:, axis - 1]
            scale = (nets.shape[axis] - 1) / unit
            least[axis - 1] = scale * np.maximum(low, -high)
            most = np.maximum(most, scale * np.maximum(-low, high))
    return np.asarray(least / np.where(most > 0, most, 1.0))


def are_upright(nets: Floats, sizes: Floats) -> Bools:
    """(n,) whether g = 0 is nowhere much inclined to the last axis of boxes with sizes (n, 3) and nets (n, D, D, D)."""
    return np.asarray(_steepness_by_axis(nets, sizes)[-1] > _UPRIGHT)


def _steepness(nets: Floats) -> Floats:
    """(n,) the same along the last axis."""
    return np.asarray(_steepness_by_axis(nets)[-1])


def _are_ends_graphs(nets: Floats) -> Bools:
    """(n,) whether on both faces across the last axis g has no zeros, or they are a graph with single ends."""
    found = np.ones(len(nets), bool)
    for face in (nets[:, :, :, 0], nets[:, :, :, -1]):
        is_free = (face.min(axis=(1, 2)) > 0) | (face.max(axis=(1, 2)) < 0)
        has_single_ends = (_changes(face[:, :, 0]) <= 1) & (_changes(face[:, :, -1]) <= 1)
        found &= is_free | ((_steepness(face) > _STEEP) & has_single_ends)
    return found


def _changes(coefficients: Floats) -> Ints:
    """(n,) how often the sign changes along coefficients (n, D): by Descartes' rule the roots, where that is 0 or 1."""
    is_positive = coefficients >= 0
    return np.asarray((is_positive[:, 1:] != is_positive[:, :-1]).sum(axis=1))


def shifts(nets: Floats, band: Floats) -> tuple[Floats, Floats]:
    """(n,) how far moving g by the band moves its graph along the last axis; (n,) how much the area changes, in parts.

    With r = g_i / g_k and |g_k| >= m: |dr/dk| <= (|g_ik| m + |g_i| |g_kk|) / m^2.
    """
    axes = tuple(range(1, nets.ndim))
    slopes = [np.diff(nets, axis=axis) * (nets.shape[axis] - 1) for axis in axes]
    last = slopes[-1]
    steepness = np.maximum(last.min(axis=axes), -last.max(axis=axes))
    shift = band / steepness
    bend = greatest(np.diff(last, axis=3) * (nets.shape[3] - 2))
    change = np.zeros(len(nets))
    for slope in slopes[:-1]:
        mixed = greatest(np.diff(slope, axis=3) * (nets.shape[3] - 1))
        change += shift * (mixed / steepness + greatest(slope) * bend / steepness**2)
    return shift, change


def shares_of_ends(nets: Floats, band: Floats) -> Floats:
    """(n,) bounds of the shares of (i, j) in [0, 1]^2 over which the ends of graphs move, where these are graphs."""
    found = np.zeros(len(nets))
    for face in (nets[:, :, :, 0], nets[:, :, :, -1]):
        is_met = (face.min(axis=(1, 2)) <= 0) & (face.max(axis=(1, 2)) >= 0) & (_steepness(face) > _STEEP)
        slopes = np.diff(face[is_met], axis=2) * (face.shape[2] - 1)
        found[is_met] += 2 * band[is_met] / np.abs(slopes).min(axis=(1, 2), initial=np.inf)
    return found


def greatest(nets: Floats) -> Floats:
    """(n,) largest magnitudes of coefficients; 0 for none."""
    return np.asarray(np.abs(nets).max(axis=tuple(range(1, nets.ndim)), initial=0.0))


def turned(nets: Floats, orders: Ints) -> Floats:
    """Nets (n, D, D, D), in two dimensions (n, 1, D, D), with axes in the given orders (n, 3)."""
    found = np.empty_like(nets)
    codes = orders @ (1, 3, 9)
    for _, here in rows_by_number(codes):
        found[here] = nets[here].transpose(0, *(1 + orders[here[0]]))
    return found
