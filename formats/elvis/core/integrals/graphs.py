"""Points and weights on surfaces k(i, j) in unit cubes, and below them, between breaks at which they end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Floats, Ints
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


def on_graph(nets: Floats, counts: tuple[int, ...]) -> Graph:
    """Points on g = 0 with Bernstein nets (n, Di, Dj, Dk), ``counts`` between breaks in i (unless Di is 1) and j."""
    box, i, j, lines, weights = _lines(nets, counts)
    met = np.flatnonzero((lines[:, 0] >= 0) != (lines[:, -1] >= 0))
    points = np.stack([i[met], j[met], roots(lines[met])], axis=1)
    return Graph(box[met], points, weights[met], _slopes(nets, box[met], points))


def below_graph(nets: Floats, counts: tuple[int, ...]) -> tuple[Ints, Floats, Floats]:
    """Box (n,), point (n, 3) and weight (n,) of a rule for where g < 0, ``counts`` between breaks each way."""
    box, i, j, lines, weights = _lines(nets, counts[:-1])
    line, k, further = _between(roots(lines)[:, None], counts[-1])
    values = np.einsum("nc,nc->n", line_tables(lines.shape[1] - 1, k)[0], lines[line])
    kept = np.flatnonzero(values < 0)
    line = line[kept]
    return box[line], np.stack([i[line], j[line], k[kept]], axis=1), weights[line] * further[kept]


def _lines(nets: Floats, counts: tuple[int, ...]) -> tuple[Ints, Floats, Floats, Floats, Floats]:
    """Lines along k: box, i, j, nets (n, Dk) and weight of each."""
    if nets.shape[1] > 1:
        corners = [nets[:, :, j, k] for j in (0, -1) for k in (0, -1)]
        box, i, weights = _between(np.stack([roots(corner) for corner in corners], axis=1), counts[0])
    else:
        box, i, weights = np.arange(len(nets)), np.full(len(nets), 0.5), np.ones(len(nets))
    slices = np.einsum("na,nabc->nbc", line_tables(nets.shape[1] - 1, i)[0], nets[box])
    row, j, further = _between(np.stack([roots(slices[:, :, k]) for k in (0, -1)], axis=1), counts[-1])
    lines = np.einsum("nb,nbc->nc", line_tables(nets.shape[2] - 1, j)[0], slices[row])
    return box[row], i[row], j, lines, weights[row] * further


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

    Newton's method in a bracket that shrinks, which is halved where a step leaves it.
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

        # those whose last step was long go on
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


def _slopes(nets: Floats, box: Ints, points: Floats) -> Floats:
    """(n, 3) derivatives of polynomials with nets (m, Di, Dj, Dk) at points (n, 3), each of net ``box`` (n,)."""
    tables = [line_tables(size - 1, places, 1) for size, places in zip(nets.shape[1:], points.T, strict=True)]
    values, slopes = zip(*tables, strict=True)
    along_k = [np.einsum("nabc,nc->nab", nets[box], table[2]) for table in (values, slopes)]
    along_j = [np.einsum("nab,nb->na", along_k[0], table[1]) for table in (values, slopes)]
    last = np.einsum("nab,nb->na", along_k[1], values[1])
    parts = [(along_j[0], slopes[0]), (along_j[1], values[0]), (last, values[0])]
    return np.stack([np.einsum("na,na->n", part, table) for part, table in parts], axis=1)
