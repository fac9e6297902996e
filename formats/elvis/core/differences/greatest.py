"""The greatest magnitude of a difference: proved on one mesh, and from points that close in on it on two.

`overlaps` bounds what is found at points, and may find a greater difference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.core.extrema import Extreme, extrema_of_difference
from elvis.core.mapping import pointwise
from elvis.core.patch import Patch
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression

#: places each way in an element at least and at most, and of all elements together
_LEAST, _GREATEST, _MOST = 3, 12, 1 << 20
#: places that are closed in on, how often, with so many points each way, and by how much each time
_BEST, _ROUNDS, _AROUND, _CLOSER = 16, 8, 5, 0.5


def greatest_of_fields(dataset: Dataset, name: str, other: str) -> Extreme | None:
    """The greatest magnitude of the difference of two fields of a dataset; None with Fourier directions."""
    try:
        ends = extrema_of_difference(dataset, name, other)
    except ElvisError:
        return None
    most = max(ends, key=lambda end: abs(end.value))
    return replace(most, value=abs(most.value), bound=max(abs(end.bound) for end in ends))


@dataclass(frozen=True, eq=False)
class _Places:
    """Places eta (n, D) on rows (n,) of a patch, and magnitudes (n,) there."""

    patch: Patch
    rows: Ints
    eta: Floats
    values: Floats

    def best(self) -> _Places:
        """Those with the greatest values."""
        first = np.argsort(-self.values, kind="stable")[:_BEST]
        return _Places(self.patch, self.rows[first], self.eta[first], self.values[first])


def greatest_at_points(evaluator: Evaluator, held: Sequence[Patch], expression: Expression) -> Extreme:
    """The greatest magnitude of an expression, from points of a lattice in every element and around the best of these.

    held  the elements, of the evaluator's
    The lattice holds the elements' borders.  The bound is NaN: nothing is proved.
    """
    total = sum(map(len, held))
    found = Extreme(np.nan, np.nan, (np.nan,) * 3, -1)
    for patch in held:
        d = patch.dimension
        count = int(np.clip((_MOST / max(total, 1)) ** (1 / d), _LEAST, max(patch.geometry.modes) + 4))
        places = _searched(evaluator, expression, patch, min(count, _GREATEST))
        if len(places.values) and not places.values[0] <= found.value:
            x, y, z = map(float, pointwise.positions(patch, places.rows[:1], _points(patch, places.eta[:1]))[0])
            found = Extreme(float(places.values[0]), np.nan, (x, y, z), int(patch.element_ids[places.rows[0]]))
    return found


def _searched(evaluator: Evaluator, expression: Expression, patch: Patch, count: int) -> _Places:
    """The places of a patch with the greatest magnitudes, the first of all first."""
    line = np.cos(np.linspace(np.pi, 0.0, count))
    eta = np.stack(np.meshgrid(*[line] * patch.dimension, indexing="ij"), axis=-1).reshape(-1, patch.dimension)
    rows = np.arange(len(patch))
    places = _valued(evaluator, expression, patch, np.repeat(rows, len(eta)), np.tile(eta, (len(rows), 1))).best()
    steps = np.stack(np.meshgrid(*[np.linspace(-1, 1, _AROUND)] * patch.dimension, indexing="ij"), axis=-1)
    steps = steps.reshape(-1, patch.dimension)
    width = np.pi / (count - 1)
    for _ in range(_ROUNDS):
        around = np.clip(places.eta[:, None] + width * steps, -1.0, 1.0).reshape(-1, patch.dimension)
        places = _valued(evaluator, expression, patch, np.repeat(places.rows, len(steps)), around).best()
        width *= _CLOSER
    return places


def _valued(evaluator: Evaluator, expression: Expression, patch: Patch, rows: Ints, eta: Floats) -> _Places:
    """Magnitudes at places, without those that have no value."""
    values = np.abs(evaluator.values(expression, patch, rows, _points(patch, eta)))
    held = np.isfinite(values)
    return _Places(patch, rows[held], eta[held], values[held])


def _points(patch: Patch, eta: Floats) -> Floats:
    """Reference points at places eta; zeta of homogeneous directions is kept."""
    own = patch.shape.dimension
    return np.hstack([uncollapse(patch.shape, eta[:, :own]), eta[:, own:]])
