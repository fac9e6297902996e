"""Values of a dataset, with quantities given as text."""

from __future__ import annotations

from elvis.core.bounds.extrema import Extremum
from elvis.core.bounds.quantity_extrema import quantity_extrema
from elvis.core.data.dataset import Dataset
from elvis.core.quantities import Expression


def extrema(dataset: Dataset, quantity: str) -> tuple[Extremum, Extremum]:
    """Minimum and maximum of a quantity over all elements, each with a certified bound.

    quantity  a field, or an expression such as ``sqrt(u^2+v^2)``

    Raises ElvisError for an invalid quantity, and for data with Fourier directions.

    >>> ds = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, u=[[0, 1, 0]], v=[[0, 0, 0]])
    >>> minimum, maximum = elvis.extrema(ds, "u")
    >>> round(maximum.value, 12)
    1.0
    """
    return quantity_extrema(dataset, Expression.of(dataset, quantity))
