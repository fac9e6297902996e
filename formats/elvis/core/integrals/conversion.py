"""Effect of the errors of a conversion on integrals: a term of their error.

The radius of the integrand comes from `quantities.conversion_radius`.  If the map's error e has the derivative |grad e|
<= s, lengths have a relative error of at most s, and measures of k dimensions of at most (1 + s)^k - 1.  The term
combines both, by a Gauss rule of a few points:

    integral of radius(q) + |q| ((1 + s)^k - 1)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.data.conversion_errors import ConversionErrors
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.reference_cells import Piece, box_rule
from elvis.core.integrals.targets import Part
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression

#: Gauss points each way, and points at once
_COUNT, _BATCH = 3, 1 << 15

#: factor from the rule's result to the term
_SAFETY = 1.25


class ConversionTerms:
    """The terms of expressions, which an evaluator knows, for pieces of its dataset."""

    def __init__(self, dataset: Dataset, evaluator: Evaluator, expressions: Sequence[Expression]) -> None:
        self.errors = ConversionErrors.of(dataset.metadata)
        self._evaluator, self._expressions = evaluator, tuple(expressions)

    def over(self, pieces: Sequence[Part]) -> Floats:
        """(k,) terms for pieces together; infinite if they are not known, such as on surfaces and curves that move.

        Zeros where no conversion lost anything.
        """
        total = np.zeros(len(self._expressions))
        if not self.errors:
            return total
        for piece in pieces:
            if not isinstance(piece, Piece):
                return np.full(len(total), np.inf)
            total += self._over(piece)
        return _SAFETY * total

    def _over(self, piece: Piece) -> Floats:
        nodes, weights = box_rule((_COUNT,) * piece.dimension)
        total, step = np.zeros(len(self._expressions)), max(1, _BATCH // len(nodes))
        stretch = (1 + self.errors.place.slope) ** piece.dimension - 1
        for first in range(0, len(piece), step):
            rows = piece.rows[first : first + step]
            eta = np.tile(nodes, (len(rows), 1))
            places = ElementPoints(piece.patch, np.repeat(rows, len(nodes)), piece.points(eta))
            shares = piece.measures(places.jacobians, eta) * np.tile(weights, len(rows))
            values = self._evaluator.values_at(self._expressions, places)
            for number, (expression, value) in enumerate(zip(self._expressions, values, strict=True)):
                off = self._evaluator.radius_at(expression, places) + stretch * np.abs(np.nan_to_num(value))
                total[number] += float(np.sum(shares * off))
        return total
