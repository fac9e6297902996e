"""Intervals of rays within many solids, joined: where rays enter or leave all of them together."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elvis.core.base.arrays import Ints
from elvis.reference.quantities import Quantities
from elvis.reference.scenes.crossings import Crossings
from elvis.scene.record.frame import Status

#: an interval of a ray within a solid: depths, places in the element of that id, and normals outwards at both ends
INTERVAL = np.dtype(
    [("pixel", "i8"), ("element", "i8")]
    + [(name, "f8") for name in ("enters", "leaves")]
    + [(name, "f8", 3) for name in ("first", "last", "entrance", "exit")]
)


def union(rows: np.ndarray, quantities: Quantities) -> Crossings:
    """Ends in front of the eye of the unions of rows of ``INTERVAL``; rows of unknown elements are dropped."""
    places = places_of(quantities)
    rows = rows[np.isin(rows["element"], list(places))]
    rows = rows[np.lexsort([rows["enters"], rows["pixel"]])]
    kept: list[tuple[int, str]] = []
    for start, end in _runs(rows["pixel"]):
        reach = -np.inf
        last = -1
        for k in range(start, end):
            if rows["enters"][k] > reach:
                kept += [(last, "leaves")] if last >= 0 else []
                kept.append((k, "enters"))
            if rows["leaves"][k] > reach:
                reach, last = rows["leaves"][k], k
        kept.append((last, "leaves"))
    row = np.array([k for k, _ in kept], np.int64)
    is_entrance = np.array([name == "enters" for _, name in kept], bool)
    own = rows[row]
    depth = np.where(is_entrance, own["enters"], own["leaves"])
    reference = np.where(is_entrance[:, None], own["first"], own["last"])
    normal = np.where(is_entrance[:, None], own["entrance"], own["exit"])
    pair = np.array([places[int(element)] for element in own["element"]], np.int64).reshape(-1, 2)
    status = np.full(len(row), Status.CERTAIN, np.uint8)
    pixel, unknown = own["pixel"].astype(np.int64), np.full(len(row), np.nan)
    found = Crossings(pixel, depth, pair[:, 0], pair[:, 1], reference, normal, status, unknown)
    return Crossings.concatenate([found.part(depth > 0)])


def places_of(quantities: Quantities) -> dict[int, tuple[int, int]]:
    """The patch of each element, and its row in that, by its id."""
    return {
        int(element): (number, row)
        for number, patch in enumerate(quantities.patches)
        for row, element in enumerate(patch.element_ids)
    }


def _runs(pixel: Ints) -> Iterator[tuple[int, int]]:
    """Starts and ends of runs of equal numbers (n,)."""
    starts = np.flatnonzero(np.diff(pixel, prepend=-1))
    yield from zip(starts, [*starts, len(pixel)][1:], strict=True)
