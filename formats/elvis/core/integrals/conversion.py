"""What the errors of a conversion do to integrals: a term of their error.

At points of every element the leaves of an integrand become intervals: a field f lies in f +- its error, a derivative
in that of the error's derivative, a coordinate in that of the map.  Interval arithmetic makes of these the radius of
the integrand.  Where the map's error e has the derivative |grad e| <= s, lengths are wrong by the share s at most, and
measures of k dimensions by (1 + s)^k - 1.  The term is the integral of both, by a Gauss rule of a few points:

    integral of radius(q) + |q| ((1 + s)^k - 1)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.arrays import Floats
from elvis.core.conversion_errors import ConversionErrors, Loss
from elvis.core.dataset import Dataset
from elvis.core.integrals.reference_cells import Piece, box_rule
from elvis.core.integrals.targets import Part
from elvis.core.quantities.element_points import ElementPoints
from elvis.core.quantities.element_sides import SIDES
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.functions import function
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import Node, fold

#: Gauss points each way, and points at once
_COUNT, _BATCH = 3, 1 << 15

#: how much more than what the rule finds the term is
_SAFETY = 1.25


class ConversionTerms:
    """The terms of expressions, which an evaluator knows, for pieces of its dataset."""

    def __init__(self, dataset: Dataset, evaluator: Evaluator, expressions: Sequence[Expression]) -> None:
        self.errors = ConversionErrors.of(dataset.metadata)
        self._evaluator, self._expressions = evaluator, tuple(expressions)

    def over(self, pieces: Sequence[Part]) -> Floats:
        """(k,) terms for pieces together; infinite where they are not known, such as on surfaces and curves that move.

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
                off = self._radius(expression, places) + stretch * np.abs(np.nan_to_num(value))
                total[number] += float(np.sum(shares * off))
        return total

    def _radius(self, expression: Expression, places: ElementPoints) -> Floats:
        """(n,) how far the values of an expression at points are from those of the source; infinite if not known."""
        leaf = self._evaluator.leaves_at(places)

        def interval(node: Node) -> Interval:
            value, radius = leaf(node), self._radius_of(node, places)
            return value - radius, value + radius

        def inner(node: Node, parts: list[Interval]) -> Interval:
            return function(node).interval(*parts)

        with np.errstate(all="ignore"):
            low, high = fold(expression.root, interval, inner)
            (value,) = self._evaluator.values_at([expression], places)
            radius = np.maximum(high - value, value - low)
        # what has no value at a point has no error there
        return np.where(np.isfinite(value), np.nan_to_num(radius, nan=np.inf, posinf=np.inf), 0.0)

    def _radius_of(self, node: Node, places: ElementPoints) -> Floats | float:
        """The error of a field, of a derivative, of a coordinate; infinite for others that are not exact."""
        place = self.errors.place
        if node.op == "coordinate":
            return place.value
        if node.op == "field":
            own = self.errors.fields.get(node.name, Loss())
            if len(node.axes) == 1 and place.slope < 1:
                # the map's error turns the gradient g into (1 + grad e)^-T g
                gradients = places.derivative(self._evaluator.names.index(node.name), 1)
                turned = place.slope / (1 - place.slope)
                return np.asarray(own.slope * (1 + turned) + turned * np.linalg.norm(gradients, axis=-1))
            return own.value if not node.axes else np.inf
        if node.op == "attribute":
            # a unit normal turns by as much as tangents do
            return 2 * place.slope if node.name in SIDES[:3] else np.inf if self.errors.place.value else 0.0
        return 0.0
