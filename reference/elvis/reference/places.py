"""Points among elements: one owner each, to the last digit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.inverse import Status as InverseStatus
from elvis.core.mapping.locate import Location
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.pointwise import positions_and_jacobians
from elvis.core.mapping.tangents import duals
from elvis.plugins.runtime.host.patch import HostPatch
from elvis.reference.locating import Locator
from elvis.scene.model.time_limit import check_time

#: number of points that are located together
_AT_ONCE = 1 << 12


def within_periods(patches: Sequence[Patch], points: Floats) -> Ints:
    """The points (n, 3) within one period of Fourier directions, borders included, where they are moved onto it."""
    possible = np.isfinite(points).all(axis=1)
    for axis, length in {period for patch in patches for period in patch.periods}:
        possible &= np.abs(points[:, axis] - length / 2) <= length * (0.5 + TOLERANCE)
        points[:, axis] = np.clip(points[:, axis], 0, length)
    return np.flatnonzero(possible)


def owners(locator: Locator, points: Floats) -> Location:
    """One result for each of the points (n, 3): the element it lies in; on borders the one of lowest id."""
    found = _locate(locator, points)
    border = np.flatnonzero((found.status == InverseStatus.INSIDE) & (found.margin <= TOLERANCE))
    every = _locate(locator, points[border], every=True)

    # the first result in order of points, then ids
    order = np.lexsort((every.element_id, every.point))
    first = order[np.diff(every.point[order], prepend=-1) != 0]
    columns = {name: getattr(found, name).copy() for name in Location.__dataclass_fields__}
    for name, column in columns.items():
        column[border] = border if name == "point" else getattr(every, name)[first]
    return replace(found, **columns)


def _locate(locator: Locator, points: Floats, every: bool = False) -> Location:
    """Locations of points (n, 3), or every element that holds them; in batches, since it may take long."""
    parts = []
    for first in range(0, max(1, len(points)), _AT_ONCE):
        check_time()
        part = locator.locate(points[first : first + _AT_ONCE], all=every)
        parts.append(replace(part, point=part.point + first))
    names = Location.__dataclass_fields__
    return Location(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def polish(patches: Sequence[Patch], found: Location, points: Floats) -> None:
    """Take one more step of Newton's method at the points (n, 3) that were found, to the last digit.

    The search in elements of runtime plugins ends there already.
    """
    for number, patch in enumerate(patches):
        here = np.flatnonzero(found.patch == number)
        if isinstance(patch, HostPatch):
            continue
        # at some points together: the Jacobians of all take far more memory than the picture
        for part in chunks(len(here), _AT_ONCE):
            own = here[part]
            world, jacobians = positions_and_jacobians(patch, found.row[own], found.reference[own])
            step = np.einsum("nci,nc->ni", duals(jacobians), points[own] - world)
            found.reference[own] += np.where(np.abs(step) < 1e-6, step, 0.0)
