"""Distribution of a quantity over the domain, from points of Gauss rules: the fewer elements, the more points each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, joined_floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.reference_cells import Piece, box_rule, whole_elements
from elvis.core.mapping.orientation import chunks
from elvis.core.quantities import Expression
from elvis.core.quantities.elements.points import Lattice
from elvis.core.quantities.evaluator import Evaluator

#: approximate number of sampled points
MOST = 100_000
#: maximum number of points per direction of an element, and number evaluated at once
_EACH, _BATCH = 64, 1 << 18


@dataclass(frozen=True, eq=False)
class Histogram:
    """Shares of the domain by value.

    ends      (n + 1,) ends of the bins: evenly from the smallest to the largest value at the points
    shares    (n,) parts of the volume (area, length) that the points in a bin stand for; their sum is 1
    points    how many there are with a finite value
    elements  on how many they lie
    total     elements of the domain
    """

    ends: Floats
    shares: Floats
    points: int
    elements: int
    total: int


def histogram(dataset: Dataset, expression: Expression, bins: int = 128, most: float = MOST) -> Histogram:
    """The histogram of an expression by volume.

    If elements are too many for ``most`` points, only every n-th element is sampled.

    Raises ElvisError if no element of the domain has a finite value of it.
    """
    evaluator = Evaluator(dataset, [expression])
    pieces = [piece for piece in whole_elements(evaluator.patches) if None not in piece.patch.fields]
    parts = list(_values(evaluator, expression, pieces, most))
    values = joined_floats(found for found, _ in parts)
    measures = joined_floats(measure for _, measure in parts)

    # derivatives have no value where the map is singular
    is_finite = np.isfinite(values)
    values, measures = values[is_finite], measures[is_finite]
    if not measures.sum() > 0.0:
        raise ElvisError(f"{expression.text}: there is no finite value to count")
    counts, ends = np.histogram(values, bins, weights=measures)
    every = _every(pieces, most)
    elements = sum(len(piece.rows[::every]) for piece in pieces)
    total = sum(map(len, evaluator.patches))
    return Histogram(ends, counts / measures.sum(), len(values), elements, total)


def _values(
    evaluator: Evaluator, expression: Expression, pieces: Sequence[Piece], most: float
) -> Iterator[tuple[Floats, Floats]]:
    """Values (n,) at points, and the measure of each (n,), some elements after the other."""
    every, count = _every(pieces, most), max(1, sum(map(len, pieces)))
    for piece in pieces:
        each = int((most / count) ** (1 / piece.dimension))
        nodes, weights = box_rule((int(np.clip(each, _least(piece), _EACH)),) * piece.dimension)
        chosen = piece.rows[::every]
        for part in chunks(len(chosen), max(1, _BATCH // len(nodes))):
            places = Lattice(piece.patch, chosen[part], piece.points(nodes))
            eta, shares = np.tile(nodes, (len(chosen[part]), 1)), np.tile(weights, len(chosen[part]))
            (values,) = evaluator.values_at([expression], places)
            yield np.broadcast_to(values, len(places)), piece.measures(places.jacobians, eta) * shares


def _least(piece: Piece) -> int:
    """Number of points per direction that determines a quantity on an element: one more than modes."""
    expansions = [own for own in (piece.patch.geometry, *piece.patch.fields) if own is not None]
    return 1 + max(max(own.modes) for own in expansions)


def _every(pieces: Sequence[Piece], most: float) -> int:
    """Stride through the elements that keeps the number of points below ``most``."""
    needed = sum(len(piece) * _least(piece) ** piece.dimension for piece in pieces)
    return max(1, int(np.ceil(needed / most)))
