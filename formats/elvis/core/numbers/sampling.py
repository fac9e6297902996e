"""Quantities at world points, in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints, concatenated
from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.base.needing import require_module
from elvis.core.base.ranks import Ranks
from elvis.core.data import describing
from elvis.core.data.conversion_errors import ConversionErrors, Loss
from elvis.core.data.dataset import Dataset
from elvis.core.files.columns import Columns
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Location, Locator
from elvis.core.mapping.patch import patches
from elvis.core.mapping.pointwise import gradients, values
from elvis.core.numbers.queries import points_on_line

#: points whose columns are found together
_POINTS_AT_ONCE = 1 << 18


@dataclass(frozen=True, eq=False)
class Samples:
    """Results at points: one for each point, or one for each element that contains it; sorted by point.

    ``found["speed"]`` is a column of ``values``.

    names     of the fields, or the texts of the quantities
    points    (k, 3)  world coordinates as requested
    location  (k,)    element, reference coordinates and status of each result
    values    (k, f)  one column per quantity; NaN outside the domain and in elements without the quantity
    errors    (k, f) estimated deviation of values from the source that the data were converted from; infinite if
              unknown, zero for a lossless conversion
    """

    names: tuple[str, ...]
    points: Floats
    location: Location
    values: Floats
    errors: Floats

    def __getitem__(self, name: str) -> Floats:
        """(k,) values of a quantity; raises KeyError if it was not requested."""
        if name not in self.names:
            hint = perhaps(name, self.names)
            raise KeyError(f"{name!r} was not requested{hint}: there are {', '.join(self.names) or 'no quantities'}")
        return np.asarray(self.values[:, self.names.index(name)])

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return describing.line_of_samples(self)

    def _repr_html_(self) -> str:
        """The first and last results as notebooks show them."""
        return describing.table_of_columns(self.columns(), repr(self))

    def columns(self) -> Columns:
        """Arrays (k,) by name: point (row of the input), x, y, z, element (id, -1 outside), status, the quantities."""
        places = dict(zip("xyz", self.points.T, strict=True))
        where = {"element": self.location.element_id, "status": self.location.status.astype(int)}
        return {"point": self.location.point, **places, **where, **dict(zip(self.names, self.values.T, strict=True))}

    def known(self) -> Samples:
        """The samples without points outside the domain."""
        here = self.location.status != Status.OUTSIDE
        return Samples(self.names, self.points[here], self.location.part(here), self.values[here], self.errors[here])

    def to_pandas(self) -> Any:
        """A pandas.DataFrame of `columns`; raises ElvisError if pandas is not installed."""
        return require_module("pandas", "a table", "notebook").DataFrame(self.columns())


class Sampler:
    """Fields of a dataset ready to be sampled, for many calls.

    names     of the fields; ElvisError where the dataset hasn't one of them
    patches   that hold them, as in `Location.patch`
    """

    def __init__(self, dataset: Dataset, names: Sequence[str]) -> None:
        self.names = tuple(names)
        errors = ConversionErrors.of(dataset.metadata).fields
        self._errors = np.array([errors.get(name, Loss()).value for name in self.names])
        self.patches = patches(dataset, self.names)
        self.locator = Locator(self.patches)

    def sample(self, points: Floats, all: bool = False) -> Samples:
        """Values at the world points (n, 3); with ``all`` from every element that holds a point."""
        location = self.locator.locate(points, all)
        found = np.full((len(location), len(self.names)), np.nan)
        for number, patch in enumerate(self.patches):
            here = self._inside(location, number)
            for field, expansion in enumerate(patch.fields):
                if expansion is not None:
                    found[here, field] = values(patch, field, location.row[here], location.reference[here])
        errors = np.where(np.isfinite(found), self._errors, 0.0)
        return Samples(self.names, np.asarray(points, np.float64)[location.point], location, found, errors)

    def gradients(self, location: Location) -> Floats:
        """(k, f, 3) world gradients of the fields where `locate` found the points; NaN elsewhere."""
        found = np.full((len(location), len(self.names), 3), np.nan)
        for number, patch in enumerate(self.patches):
            here = self._inside(location, number)
            for field, expansion in enumerate(patch.fields):
                if expansion is not None:
                    found[here, field] = gradients(patch, field, location.row[here], location.reference[here])
        return found

    def _inside(self, location: Location, number: int) -> Ints:
        return np.flatnonzero((location.status == Status.INSIDE) & (location.patch == number))


def sample(dataset: Dataset, quantities: str | Sequence[str] | None, points: Any, all: bool = False) -> Samples:
    """Exact values of quantities at world points, by the solver's own polynomials on the elements that hold them.

    quantities  a text or several: fields, expressions such as ``sqrt(u^2+v^2)``, predefined quantities such as
                ``speed``; None for all fields
    points      (n, d) or one point (d,): as many coordinates as the data have, or three
    all         whether to return a result for every element that contains a point, as on both sides of a jump

    Raises ElvisError for unknown quantities, and for points of another shape.

    >>> ds = elvis.read("wing.xml", "wing.fld")
    >>> found = elvis.sample(ds, ["p", "speed"], (0.4, 0.3, 0.2))
    >>> found["p"].round(6)
    array([-0.169383])
    """
    from elvis.core.quantities import Expression, Names, evaluator

    names = Names.of(dataset)
    texts = names.fields if quantities is None else [quantities] if isinstance(quantities, str) else quantities
    wanted = [Expression.parse(text, names) for text in texts]
    return evaluator.Sampler(dataset, wanted).sample(world_points(points, names.dimension), all)


def by_points(probe: Callable[[Floats], Columns], points: Floats, names: Sequence[str], ranks: Ranks) -> Columns:
    """The columns of quantities at points (n, 3), which ranks share; without rows but at the first rank.

    Points are evaluated in batches: the columns need a third of the memory of the intermediate results.
    """
    first, end = (number * len(points) // ranks.size for number in (ranks.rank, ranks.rank + 1))
    parts = []
    for start in range(first, max(end, first + 1), _POINTS_AT_ONCE):
        found = dict(probe(points[start : min(start + _POINTS_AT_ONCE, end)]))
        parts.append({**found, "point": found["point"] + start})
    own = {name: concatenated([part.pop(name) for part in parts]) for name in list(parts[0])}
    every = ranks.gather(own, f"{names} at {len(points)} points")
    if not every:
        return {name: column[:0] for name, column in own.items()}
    return {name: concatenated([part[name] for part in every]) for name in own}


def by_elements(own: Samples, points: Floats, all: bool, ranks: Ranks) -> Columns:
    """The columns of each rank's results at all points in its elements; ``all`` as in `sample`."""
    some = ranks.gather(own.known(), f"{own.names} at {len(points)} points")
    return columns_of_parts(some, points, all) if some else {name: x[:0] for name, x in own.columns().items()}


def columns_of_parts(some: Sequence[Samples], points: Floats, all: bool) -> Columns:
    """The columns of samples at points (n, 3) in all elements, merged from samples in parts, each reduced by `known`.

    all  as in `sample`
    """
    locations = [own.location for own in some]
    names = ("point", "element_id", "margin", "status", "is_late")
    point, element, margin, status, is_late = (np.concatenate([getattr(x, n) for x in locations]) for n in names)

    # the order of `locate`: late results count only for points without any other
    hits = np.flatnonzero(status == Status.INSIDE)
    hits = hits[np.lexsort((element[hits], -margin[hits], is_late[hits] & (not all), point[hits]))]
    if not all and len(hits):
        hits = hits[np.diff(point[hits], prepend=-1) != 0]
    missed = np.setdiff1d(np.arange(len(points)), point[hits])
    is_failed = np.isin(missed, point[status == Status.FAILED])
    asked = np.concatenate([point[hits], missed])
    order = np.argsort(asked, kind="stable")

    values = np.full((len(asked), len(some[0].names)), np.nan)
    values[: len(hits)] = np.concatenate([own.values for own in some])[hits]
    places = dict(zip("xyz", points[asked[order]].T, strict=True))
    elements = np.concatenate([element[hits], np.full(len(missed), -1)])
    statuses = np.concatenate([status[hits], np.where(is_failed, Status.FAILED, Status.OUTSIDE)])
    where = {"element": elements[order], "status": statuses[order].astype(int)}
    return {"point": asked[order], **places, **where, **dict(zip(some[0].names, values[order].T, strict=True))}


def line(
    dataset: Dataset,
    quantities: str | Sequence[str] | None,
    start: Sequence[float],
    end: Sequence[float],
    count: int = 101,
) -> Samples:
    """Quantities at evenly spaced points from ``start`` to ``end``, both included (see `sample`).

    >>> ds = elvis.read("wing.xml", "wing.fld")
    >>> elvis.line(ds, "p", (-1, 1, 0.5), (2, 1, 0.5), 50)
    <Samples of p at 50 points: 50 inside>
    """
    return sample(dataset, quantities, points_on_line(start, end, count))


def world_points(points: Any, dimension: int) -> Floats:
    """(n, 3) points; raises ElvisError unless they are (n, d) numbers, or one of d, with d from ``dimension`` to 3."""
    try:
        found = np.asarray(points, np.float64)
    except (TypeError, ValueError) as error:
        raise ElvisError(f"expected points as numbers (n, {dimension}), found {points!r:.60}") from error
    shape = found.shape
    found = found.reshape(0, 3) if not found.size else np.atleast_2d(found)
    if found.ndim != 2 or not dimension <= found.shape[1] <= 3:
        raise ElvisError(
            f"expected points (n, {dimension}), or one of {dimension} coordinates, found numbers of shape {shape}"
        )
    return np.pad(found, ((0, 0), (0, 3 - found.shape[1])))
