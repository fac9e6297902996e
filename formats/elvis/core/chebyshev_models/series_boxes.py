"""Boxes of elements with series for the map and a quantity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from elvis.core.base.arrays import Floats, Ints


@dataclass(frozen=True, eq=False)
class SeriesBoxes:
    """Boxes that may hold a level, with series of the quantity, and larger boxes with series of the map.

    element    (n,) rows of elements
    centre     (n, 3), half (n,) in the coordinates of the elements' cubes
    series     (n, degree + 1 three times) Chebyshev coefficients in x = s / ROOM
    misfit     (n, ORDERS) bounds, for |s| <= REACH, of the error of the series of the quantity, and of its derivatives
               in s
    error      (n,) maximum error of computed values of the quantity
    summed     (n,) the part of it that is rounding in sums of the series
    places     (n,) maximum error of computed positions in the world
    world      (n, 6) low and high corner in the world of boxes that contain them
    condition  (n, 2) maximum error of computed values of the condition, and maximum sum of the magnitudes of its
               derivatives in s; -1 and 0 where the whole level counts
    map_of     (n,) number of the larger box
    unmodelled  (m,) rows of elements without a model
    map_centre (k, 3), map_half (k,) the larger boxes
    maps       (k, 3, degree + 1 three times) their series for x, y and z
    """

    element: Ints
    centre: Floats
    half: Floats
    series: Floats
    misfit: Floats
    error: Floats
    summed: Floats
    places: Floats
    world: Floats
    condition: Floats
    map_of: Ints
    unmodelled: Ints
    map_centre: Floats
    map_half: Floats
    maps: Floats

    def __len__(self) -> int:
        return len(self.element)

    @property
    def nbytes(self) -> int:
        """Bytes of all series."""
        return self.series.nbytes + self.maps.nbytes

    def by_element(self) -> dict[int, SeriesBoxes]:
        """The boxes of each element."""
        order = np.argsort(self.element, kind="stable")
        elements, first = np.unique(self.element[order], return_index=True)
        rows = np.split(order, first[1:]) if len(elements) else []
        return {int(element): self.part(own) for element, own in zip(elements, rows, strict=True)}

    def part(self, rows: Ints) -> SeriesBoxes:
        """Some of the boxes."""
        used, map_of = np.unique(self.map_of[rows], return_inverse=True)
        numbers = {name: getattr(self, name)[rows] for name in _OF_BOXES if name != "map_of"}
        maps = {name: getattr(self, name)[used] for name in _OF_MAPS}
        return SeriesBoxes(**numbers, **maps, map_of=map_of, unmodelled=np.zeros(0, np.int64))

    @staticmethod
    def joined(parts: Sequence[SeriesBoxes]) -> SeriesBoxes:
        """The boxes of several searches."""
        numbers = {own.name: np.concatenate([getattr(part, own.name) for part in parts]) for own in fields(SeriesBoxes)}
        before = np.cumsum([0, *(len(part.maps) for part in parts)])
        map_of = np.concatenate([part.map_of + first for part, first in zip(parts, before, strict=False)])
        return SeriesBoxes(**{**numbers, "map_of": map_of, "unmodelled": np.unique(numbers["unmodelled"])})


#: what is known of the larger boxes, and of the boxes
_OF_MAPS = ("map_centre", "map_half", "maps")
_OF_BOXES = tuple(own.name for own in fields(SeriesBoxes) if own.name not in (*_OF_MAPS, "unmodelled"))


def world_boxes(series: Floats, errors: Floats) -> Floats:
    """(n, 6) low and high corner of boxes that contain the places of maps.

    series  (n, 3, count three times) Chebyshev coefficients of x, y and z
    errors  (n,) maximum error of places
    """
    middle = series[:, :, 0, 0, 0]
    extent = np.abs(series).sum(axis=(2, 3, 4)) - np.abs(middle) + errors[:, None]
    return np.concatenate([middle - extent, middle + extent], axis=1)
