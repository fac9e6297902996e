"""All crossings of rays with surfaces: any number for each pixel, with their data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.mapping.patch import Patch
from elvis.reference.hits import Hits, face_eye
from elvis.reference.quantities import Quantities
from elvis.scene.cameras.view import View
from elvis.scene.record.frame import Status

#: part of its depth to which a certain hit is known; units in the last place that coordinates may be wrong by
CERTAIN, _UNITS = 1e-8, 8
#: hits of one surface nearer to one another than this part of the scene's size are one hit
_ONE = 1e-10


@dataclass(frozen=True, eq=False)
class Crossings(Rows):
    """Hits, sorted by pixel, then by depth.

    pixel      (k,)    row by row from the top
    depth      (k,)    distance from the eye's plane along the view
    patch, row (k,)    the element
    reference  (k, 3)  reference coordinates
    normal     (k, 3)  normals of any length, towards either side
    status     (k,)    of `Status`; FAILED where a search did not converge: such a hit shows nothing
    uncertainty  (k,) the true depths are within this of the given ones; NaN if only places are rounded
    """

    pixel: Ints
    depth: Floats
    patch: Ints
    row: Ints
    reference: Floats
    normal: Floats
    status: NDArray[np.uint8]
    uncertainty: Floats

    @staticmethod
    def none() -> Crossings:
        """No hit."""
        whole, vectors = np.empty(0, np.int64), np.empty((0, 3))
        return Crossings(whole, np.empty(0), whole, whole, vectors, vectors, np.empty(0, np.uint8), np.empty(0))

    @staticmethod
    def concatenate(parts: Sequence[Crossings]) -> Crossings:
        """Several lists as one, in order."""
        found = Crossings.joined([Crossings.none(), *parts])
        return found.part(np.lexsort([found.depth, found.pixel]))

    def weighed(self, view: View, size: float) -> Crossings:
        """The hits with all uncertainties, none certain where its depth is known to less than `CERTAIN` of it.

        size  largest coordinate of the data and of the eye
        Coordinates that are rounded by some units in the last place make depths uncertain by that over the cosine
        between ray and normal.
        """
        directions = view.rays_of(self.pixel)[1]
        lengths = np.linalg.norm(directions, axis=1) * np.linalg.norm(self.normal, axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            cosine = np.abs(np.einsum("ni,ni->n", directions, self.normal)) / lengths
            rounded = _UNITS * np.spacing(size) / cosine
        uncertainty = np.fmax(np.nan_to_num(self.uncertainty, posinf=np.inf), rounded)
        known = uncertainty <= CERTAIN * self.depth
        status = np.where(~known & (self.status == Status.CERTAIN), Status.AMBIGUOUS, self.status).astype(np.uint8)
        return replace(self, status=status, uncertainty=uncertainty)

    def distinct(self, size: float) -> Crossings:
        """The hits without duplicates in one element at one place; ``size`` is the size of the scene."""
        order = np.lexsort([self.depth, self.row, self.patch, self.pixel])
        found = self.part(order)
        again = np.diff(found.depth, prepend=-np.inf) <= 1e-9 * size
        for column in (found.pixel, found.patch, found.row):
            again &= np.diff(column, prepend=-1) == 0
        return Crossings.concatenate([found.part(~again)])

    def once(self, patches: Sequence[Patch], size: float) -> Crossings:
        """The hits, where a hit that several elements share goes to the one with the lowest id.

        Such hits are ambiguous.

        size  of the scene, in world units
        """
        if not len(self):
            return self
        ids = self.ids(patches)
        new = (np.diff(self.pixel, prepend=-1) != 0) | (np.diff(self.depth, prepend=-np.inf) > _ONE * size)
        group = np.cumsum(new) - 1
        order = np.lexsort([ids, group])
        first = order[np.diff(group[order], prepend=-1) != 0]
        several = np.bincount(group, weights=None) > 1
        elements = np.zeros(len(first), np.int64)
        np.maximum.at(elements, group, ids)
        shared = several & (elements != ids[first])
        found = self.part(first)
        found.status[shared & (found.status == Status.CERTAIN)] = Status.AMBIGUOUS
        return found

    def ids(self, patches: Sequence[Patch]) -> Ints:
        """(k,) ids of the elements."""
        result = np.full(len(self), -1)
        for number, patch in enumerate(patches):
            here = self.patch == number
            result[here] = patch.element_ids[self.row[here]]
        return result

    def values(self, name: str, quantities: Quantities) -> Floats:
        """(k,) values of a quantity."""
        result = np.full(len(self), np.nan)
        for number, patch in enumerate(quantities.patches):
            here = np.flatnonzero(self.patch == number)
            own = self.reference[here, : patch.dimension]
            result[here] = quantities.values(name, patch, self.row[here], own)
        return result

    def in_order(self, view: View, quantities: Quantities, names: Sequence[str], most: int) -> Iterator[Hits]:
        """First, second and further hits of rays, up to ``most`` of them."""
        seen = self.part(self.status != Status.FAILED)
        rank = np.arange(len(seen)) - np.searchsorted(seen.pixel, seen.pixel)
        for number in range(min(most, int(rank.max(initial=-1)) + 1)):
            yield seen.part(rank == number).hits(view, quantities, names)

    def hits(self, view: View, quantities: Quantities, names: Sequence[str]) -> Hits:
        """These hits, one at most for each pixel, with the values of some quantities."""
        found, here = Hits.none(view.count, tuple(names)), self.pixel
        origins, directions = view.rays_of(here)
        found.element[here], found.depth[here] = self.ids(quantities.patches), self.depth
        found.reference[here], found.status[here] = self.reference, self.status
        found.uncertainty[here] = self.uncertainty
        found.position[here] = origins + self.depth[:, None] * directions
        found.normal[here] = face_eye(self.normal, directions)
        for name in names:
            found.values[name][here] = self.values(name, quantities)
        return found
