"""Fields at world points, in one call."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Location, Locator
from elvis.core.mapping.pointwise import gradients, values
from elvis.core.patch import patches


@dataclass(frozen=True, eq=False)
class Samples:
    """What was found at points: one result for a point, or one for each element that holds it; sorted by point.

    names     of the fields
    points    (k, 3)  world coordinates as asked
    location  (k,)    element, reference coordinates and status of each result
    values    (k, f)  one column a field; NaN outside the domain and where the field hasn't the element
    """

    names: tuple[str, ...]
    points: Floats
    location: Location
    values: Floats


class Sampler:
    """Fields of a dataset ready to be sampled, for many calls.

    names     of the fields; ElvisError where the dataset hasn't one of them
    patches   that hold them, as in `Location.patch`
    """

    def __init__(self, dataset: Dataset, names: Sequence[str]) -> None:
        self.names = tuple(names)
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
        return Samples(self.names, np.asarray(points, np.float64)[location.point], location, found)

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


def sample(dataset: Dataset, names: Sequence[str], points: Floats, all: bool = False) -> Samples:
    """The named fields at the world points (n, 3); `Sampler` prepares this once for many calls.

    all  a result for every element that holds a point, both sides of a jump included, not just one for each point
    """
    return Sampler(dataset, names).sample(points, all)
