"""The largest errors of quantities of converted data over the domain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.base.arrays import Floats, every_pair
from elvis.core.data.conversion_errors import ConversionErrors
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.cubature import field_cubature
from elvis.core.polynomials.interpolation import modified
from elvis.core.quantities.conversion_radius import loss_of
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression

#: modes of the rule at whose points the largest radius is sought, and points at once
_MODES, _BATCH = 3, 1 << 15

#: factor from the largest radius found at points to an estimate of the largest radius
_BETWEEN = 1.25


def largest_radii(dataset: Dataset, expressions: Sequence[Expression]) -> Floats:
    """(k,) estimated largest deviation of each expression from the source.

    Infinite if unknown, zero if no conversion was lossy.
    """
    errors = ConversionErrors.of(dataset.metadata)
    found = np.zeros(len(expressions))
    if not errors:
        return found
    for number, expression in enumerate(expressions):
        if expression.is_field:
            found[number] = loss_of(errors, expression.root.name).value
        else:
            found[number] = _BETWEEN * _largest(dataset, expression)
    return found


def _largest(dataset: Dataset, expression: Expression) -> float:
    """The largest radius of an expression at points inside of the elements."""
    evaluator, worst = Evaluator(dataset, [expression]), 0.0
    for patch in evaluator.patches:
        points = field_cubature(modified(patch.shape, (_MODES,) * patch.dimension)).points
        for some in chunks(len(patch), max(1, _BATCH // len(points))):
            rows = np.arange(len(patch))[some]
            places = ElementPoints(patch, *every_pair(rows, points))
            worst = max(worst, float(evaluator.radius_at(expression, places).max(initial=0.0)))
    return worst
