"""Values of another dataset at places of this one: on another mesh, of other orders, located exactly at every point."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Location, Locator
from elvis.core.mapping.patch import patches
from elvis.core.quantities.attributes import Attributes
from elvis.core.quantities.evaluator import reference_values
from elvis.core.quantities.expression import Expression


class Elsewhere:
    """A dataset that is asked at world points; on borders of its elements the one counts that holds the point best."""

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset
        # derivatives before a deformation also need the coordinates there
        before = () if dataset.deformation is None else dataset.deformation.coordinates
        self._fields = (*(one.name for one in dataset.solution), *before)
        self._patches = patches(dataset, self._fields)
        self._locator = Locator(self._patches)
        self._attributes = Attributes(dataset)
        self._expressions: dict[str, Expression] = {}
        self._points, self._location = np.empty((0, 3)), self._locator.locate(np.empty((0, 3)))

    def values(self, text: str, points: Floats) -> Floats:
        """(n,) values of an expression at world points (n, 3); NaN at points without a value."""
        if text not in self._expressions:
            self._expressions[text] = Expression.of(self._dataset, text)
        location, found = self._locate(points), np.full(len(points), np.nan)
        for number, patch in enumerate(self._patches):
            here = np.flatnonzero((location.status == Status.INSIDE) & (location.patch == number))
            rows, reference = self._places(location, here, patch.dimension)
            expression = self._expressions[text]
            found[here] = reference_values(expression, self._fields, self._attributes, patch, rows, reference)
        return found

    def _locate(self, points: Floats) -> Location:
        """Positions of points, shared by several quantities."""
        if not np.array_equal(points, self._points):
            self._points, self._location = points, self._locator.locate(points)
        return self._location

    @staticmethod
    def _places(location: Location, here: Ints, dimension: int) -> tuple[Ints, Floats]:
        return location.row[here], location.reference[here, :dimension]
