"""The maximum magnitude of a difference: proved on one mesh, and from points that converge to it on two.

`overlaps` bounds the maximum at points, and returns positions where a larger difference may be; points are sought there
again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints, every_pair, grid_points
from elvis.core.base.errors import ElvisError
from elvis.core.base.rows import Rows
from elvis.core.bounds.extrema import Extremum, extrema_of_difference
from elvis.core.data.dataset import Dataset
from elvis.core.mapping import pointwise
from elvis.core.mapping.locate import Location, Locator
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.collapse import collapse, uncollapse
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression

#: places each way in an element at least and at most, and of all elements together
_LEAST, _GREATEST, _MOST = 3, 12, 1 << 20
#: points of the other mesh at most
_MOST_OTHERS = 1 << 15
#: parts of elements in which the best place is polished
_STARTS = 64
#: rounds after which only the best of them go on, and how many
_EARLY = 3
_LATE_STARTS = 12
#: rounds of polishing, points each way in a round, and the next round's width
_ROUNDS = 14
_AROUND = 5
_CLOSER = 0.4


def greatest_of_fields(dataset: Dataset, name: str, other: str) -> Extremum | None:
    """The largest magnitude of the difference of two fields of a dataset; None with Fourier directions."""
    try:
        ends = extrema_of_difference(dataset, name, other)
    except ElvisError:
        return None
    most = max(ends, key=lambda end: abs(end.value))
    return replace(most, value=abs(most.value), bound=max(abs(end.bound) for end in ends))


@dataclass(frozen=True, eq=False)
class _Places(Rows):
    """Positions eta (n, D) on rows (n,) of a patch, and magnitudes (n,) there, -inf without a value."""

    patch: Patch
    rows: Ints
    eta: Floats
    values: Floats

    def starts(self) -> _Places:
        """The best places of halves of elements in every direction, those with the largest values, largest first."""
        order = np.argsort(-self.values, kind="stable")
        halves = (self.eta > 0) @ 2 ** np.arange(self.eta.shape[1])
        parts = self.rows * 2 ** self.eta.shape[1] + halves
        firsts = np.unique(parts[order], return_index=True)[1]
        best = order[np.sort(firsts)[:_STARTS]]
        return self.part(best[np.isfinite(self.values[best])])


def greatest_at_points(evaluator: Evaluator, held: Sequence[Patch], expression: Expression) -> Extremum:
    """The largest magnitude of an expression, from points of a lattice in every element and around the best of these.

    held  the elements, of the evaluator's

    The lattice holds the elements' borders.  The bound is NaN: nothing is proved.
    """
    total = sum(map(len, held))
    found = []
    for patch in held:
        count = _count(patch, total)
        places = _on_lattice(evaluator, expression, patch, count)
        found.append(_polished(evaluator, expression, places.starts(), np.pi / (count - 1)))
    return _best(found)


def greatest_near(evaluator: Evaluator, held: Sequence[Patch], expression: Expression, points: Floats) -> Extremum:
    """The maximum magnitude as in `greatest`, from world points (n, 3) and around the best of these."""
    location = Locator(held).locate(points)
    found = []
    for number, patch in enumerate(held):
        places = _located(evaluator, expression, patch, location.part(np.flatnonzero(location.patch == number)))
        found.append(_polished(evaluator, expression, places.starts(), np.pi / (_count(patch, len(patch)) - 1)))
    return _best(found)


def lattice_points(held: Sequence[Patch]) -> Floats:
    """(n, 3) world points of lattices in elements, some of them where there are many."""
    total = sum(map(len, held))
    parts = [np.empty((0, 3))]
    for patch in held:
        eta = _lattice(_count(patch, 8 * total), patch.dimension)
        rows = np.arange(len(patch))[:: max(1, total * len(eta) // _MOST_OTHERS)]
        points = np.tile(_points(patch, eta), (len(rows), 1))
        parts.append(pointwise.positions(patch, np.repeat(rows, len(eta)), points))
    return np.concatenate(parts)


def _count(patch: Patch, total: int) -> int:
    """Number of points per direction in elements of a patch, from the total: more than degrees of maps and fields."""
    modes = [max(expansion.modes) for expansion in (patch.geometry, *patch.fields) if expansion is not None]
    room = (_MOST / max(total, 1)) ** (1 / patch.dimension)
    return int(np.clip(room, _LEAST, min(max(modes) + 4, _GREATEST)))


def _lattice(count: int, dimension: int) -> Floats:
    """(n, D) Chebyshev points of the second kind."""
    line = np.cos(np.linspace(np.pi, 0.0, count))
    return grid_points(*[line] * dimension)


def _on_lattice(evaluator: Evaluator, expression: Expression, patch: Patch, count: int) -> _Places:
    """The places of lattices in all elements of a patch."""
    eta = _lattice(count, patch.dimension)
    rows = np.arange(len(patch))
    return _valued(evaluator, expression, patch, *every_pair(rows, eta))


def _located(evaluator: Evaluator, expression: Expression, patch: Patch, location: Location) -> _Places:
    """The places of a patch at which points were found."""
    own = patch.shape.dimension
    eta = np.hstack([collapse(patch.shape, location.reference[:, :own]), location.reference[:, own:]])
    return _valued(evaluator, expression, patch, location.row, np.clip(eta, -1.0, 1.0))


def _polished(evaluator: Evaluator, expression: Expression, starts: _Places, width: float) -> _Places:
    """Places near starts with larger magnitudes, the largest first: each start has shrinking lattices of its own."""
    patch, places = starts.patch, starts
    steps = np.stack(np.meshgrid(*[np.linspace(-1, 1, _AROUND)] * patch.dimension, indexing="ij"), axis=-1)
    steps = steps.reshape(-1, patch.dimension)
    for round_number in range(_ROUNDS if len(starts.rows) else 0):
        if round_number == _EARLY:
            places = places.part(np.argsort(-places.values, kind="stable")[:_LATE_STARTS])
        around = np.clip(places.eta[:, None] + width * steps, -1.0, 1.0).reshape(-1, patch.dimension)
        found = _valued(evaluator, expression, patch, np.repeat(places.rows, len(steps)), around)
        firsts = np.arange(len(places.rows)) * len(steps)
        places = found.part(firsts + found.values.reshape(-1, len(steps)).argmax(axis=1))
        width *= _CLOSER
    return places.part(np.argsort(-places.values, kind="stable"))


def _best(found: Sequence[_Places]) -> Extremum:
    """The maximum of all places; the first of each set is its maximum."""
    known = [places for places in found if len(places.values)]
    if not known:
        return Extremum(np.nan, np.nan, (np.nan,) * 3, -1)
    best = max(known, key=lambda places: float(places.values[0]))
    patch, row = best.patch, best.rows[:1]
    x, y, z = map(float, pointwise.positions(patch, row, _points(patch, best.eta[:1]))[0])
    return Extremum(float(best.values[0]), np.nan, (x, y, z), int(patch.element_ids[row[0]]))


def _valued(evaluator: Evaluator, expression: Expression, patch: Patch, rows: Ints, eta: Floats) -> _Places:
    """Magnitudes at places."""
    values = np.abs(evaluator.values(expression, patch, rows, _points(patch, eta)))
    return _Places(patch, rows, eta, np.where(np.isfinite(values), values, -np.inf))


def _points(patch: Patch, eta: Floats) -> Floats:
    """Reference points at places eta; zeta of homogeneous directions is unchanged."""
    own = patch.shape.dimension
    return np.hstack([uncollapse(patch.shape, eta[:, :own]), eta[:, own:]])
