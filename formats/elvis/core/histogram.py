"""How much of the domain has which values of a quantity, from the points of the quadrature that norms use."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Floats
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.core.norms import integration_points
from elvis.core.patch import patches
from elvis.core.quantities import Expression

#: points that are looked at, about, where a dataset has more
MOST = 100_000


@dataclass(frozen=True, eq=False)
class Histogram:
    """Shares of the domain by value.

    ends      (n + 1,) ends of the bins: evenly from the least to the greatest value at the points
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
    """The histogram of an expression by volume; of more points than ``most``, on each n-th element of each patch.

    ElvisError where no element of the domain has a finite value of it.
    """
    parts = list(integration_points(dataset, expression, most))
    values = np.concatenate([np.empty(0), *(found.reshape(-1) for found, _ in parts)])
    measures = np.concatenate([np.empty(0), *(measure.reshape(-1) for _, measure in parts)])

    # derivatives have no value where the map is singular
    is_finite = np.isfinite(values)
    values, measures = values[is_finite], measures[is_finite]
    if not measures.sum() > 0.0:
        raise ElvisError(f"{expression.text}: there is no finite value to count")
    counts, ends = np.histogram(values, bins, weights=measures)
    elements = sum(len(found) for found, _ in parts)
    total = sum(map(len, patches(dataset, expression.fields)))
    return Histogram(ends, counts / measures.sum(), len(values), elements, total)
