"""Fields and quantities of a dataset as functions of the coordinates: ``ds["p"](0.4, 0.3, 0.2)``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.bounds.bounding import quantity_range
from elvis.core.data.dataset import Dataset, Field
from elvis.core.quantities.evaluator import Sampler
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.names import Names
from elvis.core.quantities.tree import field


class DatasetFunction:
    """Common behaviour of a field and a quantity of a dataset: values, range and picture."""

    @cached_property
    def _function(self) -> tuple[Dataset, Expression]:
        """The data and the expression that are evaluated."""
        raise NotImplementedError

    @cached_property
    def _sampler(self) -> Sampler:
        """The search structure, which later calls use again."""
        dataset, expression = self._function
        return Sampler(dataset, [expression])

    def __call__(self, x: Any, y: Any = None, z: Any = None) -> Any:
        """Exact values at points, as `sample` finds them.

        Parameters
        ----------
        x, y, z : numbers or arrays of numbers
            World coordinates, as many as the data have or three.  Arrays are broadcast against one another.  ``x``
            alone may be an array of points, with the coordinates along its last axis.

        Returns
        -------
        float or ndarray
            The values, in the common shape of the coordinates; NaN outside the domain.

        Raises
        ------
        ElvisError
            If there are too few coordinates, or these are no numbers.
        """
        dimension = Names.of(self._function[0]).dimension
        places = [each for each in (x, y, z) if each is not None]
        if len(places) == 1 and np.ndim(x) and np.shape(x)[-1] in {2, 3, dimension} and dimension > 1:
            places = list(np.moveaxis(np.asarray(x), -1, 0))
        if len(places) < dimension or (y is None and z is not None):
            needed = ", ".join("xyz"[:dimension])
            raise ElvisError(f"expected the coordinates {needed}, found {len(places)} of them")
        try:
            columns = np.broadcast_arrays(*(np.asarray(each, np.float64) for each in places))
        except (TypeError, ValueError) as error:
            raise ElvisError(f"expected coordinates as numbers that can be broadcast, found {places!r:.60}") from error
        points = np.zeros((columns[0].size, 3))
        for axis, column in enumerate(columns):
            points[:, axis] = column.ravel()
        values: Floats = self._sampler.sample(points).values[:, 0].reshape(columns[0].shape)
        return float(values) if values.ndim == 0 else values

    @property
    def range(self) -> tuple[float, float] | None:
        """Certified lower and upper bound of the values, as ``elvis info`` prints them; None without values."""
        found = quantity_range(*self._function)
        return None if found is None else (found.lower, found.upper)

    def plot(self, **keywords: Any) -> Any:
        """A picture that this colours, as `Dataset.plot` makes it."""
        dataset, expression = self._function
        return dataset.plot(expression.text, **keywords)


@dataclass(frozen=True, eq=False)
class DatasetField(DatasetFunction, Field):
    """A field that knows its dataset."""

    dataset: Dataset | None = None

    @cached_property
    def _function(self) -> tuple[Dataset, Expression]:
        """The coefficients of this field on the dataset's map, independent of its name there."""
        assert self.dataset is not None
        own = Field(self.name, self.blocks, self.continuous)
        given = tuple(each for each in self.dataset.fields if each.name in self.dataset.map_names)
        return replace(self.dataset, fields=(*given, own), rates=None), Expression(self.name, field(self.name))

    def __repr__(self) -> str:
        return Field.__repr__(self)


@dataclass(frozen=True, eq=False)
class Quantity(DatasetFunction):
    """A quantity of a dataset other than a field: an expression, or a predefined quantity such as ``vorticity``."""

    dataset: Dataset
    name: str

    @cached_property
    def _function(self) -> tuple[Dataset, Expression]:
        return self.dataset, Expression.of(self.dataset, self.name)

    def __repr__(self) -> str:
        return f"<Quantity {self.name} of {self.dataset!r}>"


def function_of(dataset: Dataset, text: str) -> DatasetField | Quantity:
    """The field of this name, else the quantity; KeyError, with near names, where there is neither."""
    try:
        found = dataset.field(text)
    except KeyError as error:
        quantity = Quantity(dataset, text)
        try:
            _ = quantity._function
        except ElvisError as fault:
            # a bare name is more likely a misspelt field than a broken expression
            raise (error if str(text).isidentifier() else KeyError(str(fault))) from None
        return quantity
    return DatasetField(found.name, found.blocks, found.continuous, dataset)


def names_of_functions(dataset: Dataset) -> list[str]:
    """Names for completion: the fields, then the predefined quantities that can be computed from them."""
    return [*dataset, *(name for name in Names.of(dataset).flow.available if name not in dataset)]
