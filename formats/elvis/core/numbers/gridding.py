"""Quantities on a regular grid, with names of axes: what xarray holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.base.needing import require_module
from elvis.core.data.dataset import Dataset
from elvis.core.files.nrrd import Grid
from elvis.core.mapping.geometry import geometry
from elvis.core.quantities import Expression, Names
from elvis.core.quantities.evaluator import Sampler
from elvis.core.summary.summary import box as box_of

#: points that are evaluated together
_TOGETHER = 1 << 18


def to_xarray(
    dataset: Dataset,
    quantities: str | Sequence[str] | None = None,
    counts: int | Sequence[int] = 64,
    box: tuple[Sequence[float], Sequence[float]] | None = None,
) -> Any:
    """An xarray.Dataset of exact values at the points of a regular grid, NaN outside the domain.

    quantities  as in `sample`; None for all fields
    counts      points along each axis of the data, or one number for all
    box         lower and upper ends of the grid; by default the ends of the data

    Dimensions are z, y and x, as many as the data have, x fastest; ``element`` is the id of the element, -1 outside.
    Raises ElvisError if counts or ends are invalid, or without xarray.

    >>> ds = elvis.read("wing.xml", "wing.fld")
    >>> elvis.to_xarray(ds, "p", counts=8)["p"].shape
    (8, 8, 8)
    """
    xarray = require_module("xarray", "to_xarray", "notebook")
    names = Names.of(dataset)
    texts = names.fields if quantities is None else [quantities] if isinstance(quantities, str) else list(quantities)
    grid = _grid(dataset, names.dimension, counts, box)
    axes = {name: grid.along(axis) for axis, name in enumerate("xyz"[: names.dimension])}
    shape = grid.counts[::-1][3 - names.dimension :]
    points = grid.planes(0, grid.counts[2])
    sampler = Sampler(dataset, [Expression.parse(text, names) for text in texts])
    parts = [sampler.sample(points[first : first + _TOGETHER]) for first in range(0, len(points), _TOGETHER)]
    columns = {text: np.concatenate([part[text] for part in parts]) for text in texts}
    columns["element"] = np.concatenate([part.location.element_id for part in parts])
    told = {} if dataset.time is None else {"time": dataset.time}
    tables = {name: (tuple(axes)[::-1], column.reshape(shape)) for name, column in columns.items()}
    return xarray.Dataset(tables, coords=axes, attrs=told)


def _grid(
    dataset: Dataset, dimension: int, counts: int | Sequence[int], box: tuple[Sequence[float], Sequence[float]] | None
) -> Grid:
    """The points, one along each axis that the data don't have."""
    numbers = np.full(dimension, counts) if np.ndim(counts) == 0 else np.asarray(counts)
    if numbers.shape != (dimension,) or numbers.dtype.kind != "i" or numbers.min() < 1:
        raise ElvisError(f"counts: expected {dimension} whole numbers of 1 or more, found {counts}")
    found = box_of(dataset, geometry(dataset))
    ends = np.array((found["lower"], found["upper"]) if box is None else box, np.float64)[:, :dimension]
    if ends.shape != (2, dimension) or not (ends[0] <= ends[1]).all():
        raise ElvisError(f"box: expected lower and upper ends of {dimension} coordinates, found {box}")
    low, high = np.pad(ends, ((0, 0), (0, 3 - dimension))).tolist()
    return Grid(tuple(low), tuple(high), (*numbers.tolist(), *(1,) * (3 - dimension)))
