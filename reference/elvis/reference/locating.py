"""Elements that contain given world points, found by the reference's own inverse map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints, joined_ints
from elvis.core.mapping.boxes import MARGIN, BoxTree, outward
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Location
from elvis.core.mapping.margins import margins
from elvis.core.mapping.patch import Patch
from elvis.plugins.runtime.host.patch import HostPatch
from elvis.reference.inversion import Inverter

#: pairs of a point and an element that are treated together
_BATCH = {True: 1 << 13, False: 1 << 16}


class _Elements(Protocol):
    """Elements of a patch as the search sees them; points are (n, 3), rows (n,), results as in `Inverter`."""

    def invert(self, rows: Ints, points: Floats) -> tuple[Floats, NDArray[np.uint8]]: ...

    def search(self, rows: Ints, points: Floats) -> tuple[Floats, NDArray[np.uint8]]: ...


class Locator:
    """The elements of some patches, ready to be found.

    patches  in the order of `Location.patch`
    """

    def __init__(self, patches: Sequence[Patch]) -> None:
        self.patches = tuple(patches)
        self._elements: list[_Elements] = []
        self._trees: list[BoxTree] = []
        for patch in self.patches:
            if isinstance(patch, HostPatch):
                self._elements.append(patch)
                self._trees.append(BoxTree.build(patch.host.part.boxes))
            else:
                own = Inverter(patch)
                self._elements.append(own)
                self._trees.append(BoxTree.build(outward(own.low, own.high, MARGIN)))
        self._ids = [patch.element_ids for patch in self.patches]
        self._periods = next((patch.periods for patch in self.patches if patch.periods), ())
        self._dimension = max((patch.shape.dimension for patch in self.patches), default=3)

    def locate(self, points: Floats, all: bool = False) -> Location:
        """Locations of world points (n, 3): for each, the element with the largest margin, or every one that holds it.

        Coordinates along Fourier directions are taken modulo the period.
        """
        world, zeta = self._unroll(np.asarray(points, np.float64))
        point, patch, row = self._candidates(world)
        reference = np.full((len(point), self._dimension), np.nan)
        status = np.empty(len(point), np.uint8)
        self._answer("invert", np.arange(len(point)), world, (point, patch, row), reference, status)

        # an element in doubt matters unless another one holds the point
        held = np.zeros(len(world), bool)
        held[point[status == Status.INSIDE]] = not all
        doubtful = np.flatnonzero((status == Status.UNCERTAIN) & ~held[point])
        self._answer("search", doubtful, world, (point, patch, row), reference, status)
        return self._location(zeta, (point, patch, row), reference, status, all)

    def _unroll(self, points: Floats) -> tuple[Floats, Floats]:
        """The points with 0 along Fourier directions, and (n, p) their coordinates zeta there."""
        world, zeta = points.copy(), np.empty((len(points), len(self._periods)))
        for number, (axis, length) in enumerate(self._periods):
            along = points[:, axis]
            turns = np.where((along < 0) | (along > length), np.floor(along / length), 0.0)
            zeta[:, number] = 2 * (along - turns * length) / length - 1
            world[:, axis] = np.where(np.isfinite(along), 0.0, np.nan)
        return world, zeta

    def _candidates(self, world: Floats) -> tuple[Ints, Ints, Ints]:
        """Point, patch and row (k,) of all pairs of a point and an element whose box holds it."""
        found = [tree.candidates(world) for tree in self._trees]
        point = joined_ints(own[0] for own in found)
        row = joined_ints(own[1] for own in found)
        return point, np.repeat(np.arange(len(found)), [len(own[0]) for own in found]), row

    def _answer(
        self,
        how: str,
        chosen: Ints,
        world: Floats,
        pairs: tuple[Ints, Ints, Ints],
        reference: Floats,
        status: NDArray[np.uint8],
    ) -> None:
        """Write reference points and status of some pairs."""
        point, patch, row = pairs
        for number, elements in enumerate(self._elements):
            here = chosen[patch[chosen] == number]
            batch = _BATCH[isinstance(elements, HostPatch)]
            for first in range(0, len(here), batch):
                part = here[first : first + batch]
                places, status[part] = getattr(elements, how)(row[part], world[point[part]])
                reference[part, : places.shape[1]] = places

    def _location(
        self, zeta: Floats, pairs: tuple[Ints, Ints, Ints], reference: Floats, status: NDArray[np.uint8], every: bool
    ) -> Location:
        """The results sorted by point, for each point by margin, then by id."""
        point, patch, row = pairs
        margin, ids = np.full(len(point), np.nan), np.full(len(point), -1)
        for number, own in enumerate(self.patches):
            here = np.flatnonzero((patch == number) & (status == Status.INSIDE))
            margin[here] = margins(own.shape, reference[here, : own.shape.dimension])
            ids[here] = self._ids[number][row[here]]
        hits = np.flatnonzero(status == Status.INSIDE)
        hits = hits[np.lexsort((ids[hits], -margin[hits], point[hits]))]
        if not every and len(hits):
            hits = hits[np.diff(point[hits], prepend=-1) != 0]

        missed = np.setdiff1d(np.arange(len(zeta)), point[hits])
        doubtful = np.isin(missed, point[status == Status.FAILED])
        nowhere, nan = np.full(len(missed), -1), np.full((len(missed), 1), np.nan)
        where = np.column_stack([reference[hits], zeta[point[hits]]])
        columns = [
            np.concatenate([point[hits], missed]),
            *(np.concatenate([own[hits], nowhere]) for own in (patch, row, ids)),
            np.concatenate([where, np.tile(nan, where.shape[1])]),
            np.concatenate([margin[hits], nan[:, 0]]),
            np.concatenate([status[hits], _statuses(doubtful)]),
            np.zeros(len(hits) + len(missed), bool),
        ]
        order = np.argsort(columns[0], kind="stable")
        return Location(*(column[order] for column in columns))


def _statuses(doubtful: Bools) -> NDArray[np.uint8]:
    """(n,) of points that no element holds."""
    return np.where(doubtful, Status.FAILED, Status.OUTSIDE).astype(np.uint8)
