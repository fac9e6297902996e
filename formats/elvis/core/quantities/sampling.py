"""Quantities at world points, and at known places in elements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Location, Locator
from elvis.core.patch import Patch, patches
from elvis.core.quantities import pointwise
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.expression import Expression
from elvis.core.sampling import Samples


class Evaluator:
    """Expressions of one dataset, ready to be evaluated.

    expressions  as given
    names        of the fields that they are made of, each once
    patches      the elements of the domain, with these fields
    """

    def __init__(self, dataset: Dataset, expressions: Sequence[Expression]) -> None:
        self.expressions = tuple(expressions)
        self.names = tuple(dict.fromkeys(name for each in expressions for name in each.fields))
        self.patches = patches(dataset, self.names)
        self.attributes = Attributes(dataset)

    def values(self, expression: Expression, patch: Patch, rows: Ints, points: Floats) -> Floats:
        """(n,) values on elements ``rows`` (n,) of a patch at reference points (n, D); NaN where there are none."""
        return pointwise.values(expression, self.names, self.attributes, patch, rows, points)

    def at(self, expression: Expression, element_ids: Ints, reference: Floats) -> Floats:
        """(n,) values in elements with these ids (n,) at reference points (n, 3); those of the element come first."""
        result = np.full(len(element_ids), np.nan)
        for patch in self.patches:
            order = np.argsort(patch.element_ids, kind="stable")
            place = np.searchsorted(patch.element_ids, element_ids, sorter=order).clip(0, len(patch) - 1)
            rows = order[place]
            here = np.flatnonzero(patch.element_ids[rows] == element_ids)
            result[here] = self.values(expression, patch, rows[here], reference[here, : patch.dimension])
        return result


class Sampler:
    """Expressions of a dataset ready to be sampled at world points, for many calls."""

    def __init__(self, dataset: Dataset, expressions: Sequence[Expression]) -> None:
        self.evaluator = Evaluator(dataset, expressions)
        self.locator = Locator(self.evaluator.patches)

    def sample(self, points: Floats, all: bool = False) -> Samples:
        """Values at the world points (n, 3); with ``all`` from every element that holds a point."""
        location = self.locator.locate(points, all)
        expressions = self.evaluator.expressions
        found = np.full((len(location), len(expressions)), np.nan)
        for number, patch in enumerate(self.evaluator.patches):
            here = np.flatnonzero((location.status == Status.INSIDE) & (location.patch == number))
            rows, reference = _places(location, here, patch)
            for column, expression in enumerate(expressions):
                found[here, column] = self.evaluator.values(expression, patch, rows, reference)
        names = tuple(expression.text for expression in expressions)
        return Samples(names, np.asarray(points, np.float64)[location.point], location, found)


def _places(location: Location, here: Ints, patch: Patch) -> tuple[Ints, Floats]:
    return location.row[here], location.reference[here, : patch.dimension]
