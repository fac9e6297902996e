"""Points and weights on surfaces k(i, j) in unit cubes, and below them, between breaks at which they end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.polynomials.bernstein import line_tables
from elvis.core.polynomials.quadrature import gauss

#: steps of Newton's method, with bisection where it leaves the bracket, and how short the last ones are
_STEPS, _SHORT = 64, 5e-16


@dataclass(frozen=True, eq=False)
class Graph:
    """Points on the surfaces.

    box      (n,)    number of the cube
    points   (n, 3)  coordinates i, j, k in [0, 1]
    weights  (n,)    for integrals over i and j
    slopes   (n, 3)  derivatives of g there
    """

    box: Ints
    points: Floats
    weights: Floats
    slopes: Floats


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines along k.

    box, i, j, weights  (n,) of each
    nets                (n, Dk) of g
    slopes              the same of its derivatives in i and in j, where they are requested
    """

    box: Ints
    i: Floats
    j: Floats
    weights: Floats
    nets: Floats
    slopes: tuple[Floats, ...] = ()


def on_graph(nets: Floats, counts: tuple[int, ...]) -> Graph:
    """Points on g = 0 with Bernstein nets (n, Di, Dj, Dk), ``counts`` between breaks in i (unless Di is 1) and j."""
    lines = _lines(nets, counts, True)
    met = np.flatnonzero((lines.nets[:, 0] >= 0) != (lines.nets[:, -1] >= 0))
    own = lines.nets[met]
    k = roots(own)
    values, derivatives = line_tables(own.shape[1] - 1, k, 1)
    slopes = [np.einsum("nc,nc->n", each[met], values) for each in lines.slopes]
    slopes.append(np.einsum("nc,nc->n", own, derivatives))
    points = np.stack([lines.i[met], lines.j[met], k], axis=1)
    return Graph(lines.box[met], points, lines.weights[met], np.stack(slopes, axis=1))


def below_graph(nets: Floats, counts: tuple[int, ...]) -> tuple[Ints, Floats, Floats]:
    """Box (n,), point (n, 3) and weight (n,) of a rule for where g < 0, ``counts`` between breaks each way."""
    lines = _lines(nets, counts[:-1])
    line, k, further = _between(roots(lines.nets)[:, None], counts[-1])
    values = np.einsum("nc,nc->n", line_tables(lines.nets.shape[1] - 1, k)[0], lines.nets[line])
    kept = np.flatnonzero(values < 0)
    line = line[kept]
    points = np.stack([lines.i[line], lines.j[line], k[kept]], axis=1)
    return lines.box[line], points, lines.weights[line] * further[kept]


def _lines(nets: Floats, counts: tuple[int, ...], are_sloped: bool = False) -> _Lines:
    """Lines along k at points of rules between breaks in i and j."""
    if nets.shape[1] > 1:
        corners = [nets[:, :, j, k] for j in (0, -1) for k in (0, -1)]
        box, i, weights = _between(np.stack([roots(corner) for corner in corners], axis=1), counts[0])
    else:
        box, i, weights = np.arange(len(nets)), np.full(len(nets), 0.5), np.ones(len(nets))
    along_i = line_tables(nets.shape[1] - 1, i, int(are_sloped))
    slices, *sloped = (np.einsum("na,nabc->nbc", table, nets[box]) for table in along_i)
    row, j, further = _between(np.stack([roots(slices[:, :, k]) for k in (0, -1)], axis=1), counts[-1])
    along_j = line_tables(nets.shape[2] - 1, j, int(are_sloped))
    own, *in_j = (np.einsum("nb,nbc->nc", table, slices[row]) for table in along_j)
    in_i = (np.einsum("nb,nbc->nc", along_j[0], each[row]) for each in sloped)
    return _Lines(box[row], i[row], j, weights[row] * further, own, (*in_i, *in_j))


def between(breaks: Floats) -> tuple[Ints, Floats, Floats]:
    """Intervals between 0, the breaks (n, b) and 1: number of the row, start and end of each."""
    ends = np.zeros((len(breaks), 1))
    ordered = np.sort(np.hstack([ends, breaks, ends + 1]), axis=1)
    row, number = np.nonzero(np.diff(ordered, axis=1) > 0)
    return row, ordered[row, number], ordered[row, number + 1]


def _between(breaks: Floats, count: int) -> tuple[Ints, Floats, Floats]:
    """Gauss points between 0, the breaks (n, b) and 1: number of the row, place and weight of each."""
    row, start, end = between(breaks)
    length = end - start
    nodes, weights = gauss(count)
    places = start[:, None] + length[:, None] * (1 + nodes) / 2
    return np.repeat(row, count), places.reshape(-1), (length[:, None] * weights / 2).reshape(-1)


def roots(coefficients: Floats) -> Floats:
    """(n,) roots in [0, 1] of polynomials with Bernstein coefficients (n, D) whose ends differ in sign; 1 for others.

    Newton's method in a bracket that shrinks, which is bisected where a step leaves it.
    """
    found = np.ones(len(coefficients))
    rest = np.flatnonzero((coefficients[:, 0] >= 0) != (coefficients[:, -1] >= 0))
    own = coefficients[rest].T * np.where(coefficients[rest, -1] >= 0, 1.0, -1.0)
    low, high = np.zeros(len(rest)), np.ones(len(rest))
    place = own[0] / (own[0] - own[-1])
    for _ in range(_STEPS):
        value, slope = _value_and_slope(own, place)
        low, high = np.where(value < 0, place, low), np.where(value < 0, high, place)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = place - value / slope
        after = np.where((step >= low) & (step <= high), step, (low + high) / 2)
        found[rest] = after

        # lines whose last step was long continue
        left = np.flatnonzero(np.abs(after - place) >= _SHORT)
        if not len(left):
            break
        rest, own, low, high, place = rest[left], own[:, left], low[left], high[left], after[left]
    return found


def _value_and_slope(coefficients: Floats, t: Floats) -> tuple[Floats, Floats]:
    """(n,) each of polynomials with Bernstein coefficients (D, n), D > 1, at t (n,): by de Casteljau's algorithm."""
    net, degree = coefficients, len(coefficients) - 1
    for _ in range(degree - 1):
        net = net[:-1] + t * (net[1:] - net[:-1])
    rise = net[1] - net[0]
    return net[0] + t * rise, degree * rise
