"""Candidates for pixels that the kernels could not decide, decided by the plugins on the host."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.base.arrays import Records, starts_of
from elvis.plugins.runtime.volume import Part
from elvis.scene.cameras.view import PlaneView


def prove(parts: Sequence[Part], view: PlaneView, candidates: Records) -> Records:
    """The candidates, by index of the element in the volume, with the results of the parts that can give some."""
    candidates, first = candidates.copy(), starts_of(parts)
    pixel, element = candidates["pixel"].astype(np.int64), candidates["element"].astype(np.int64)
    points = view.points_of(*view.places(pixel))
    owner = np.searchsorted(first, element, side="right") - 1
    for number in np.unique(owner):
        solve, here = parts[number].solve, np.flatnonzero(owner == number)
        if solve is not None:
            solution = solve(element[here] - first[number], points[here])
            for name in ("status", "margin", "reference", "field"):
                candidates[name][here] = getattr(solution, name)
    return candidates
