"""Boxes of elements with series for the map and a quantity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from elvis.core.arrays import Floats, Ints


@dataclass(frozen=True, eq=False)
class SeriesBoxes:
    """Boxes that may hold a level, with series of one degree for x, y, z and the quantity.

    element    (n,) rows of elements
    centre     (n, 3), half (n,) in the coordinates of the elements' cubes
    series     (n, 4, degree + 1 three times) Chebyshev coefficients in x = s / ROOM
    misfit     (n, ORDERS) bounds, for |s| <= REACH, of the error of the series of the quantity, and of its derivatives
               in s
    error      (n,) maximum error of computed values of the quantity
    summed     (n,) the part of it that is rounding in sums of the series
    places     (n,) maximum error of computed positions in the world
    world      (n, 6) low and high corner in the world of boxes that contain them
    condition  (n, 2) maximum error of computed values of the condition, and maximum sum of the magnitudes of its
               derivatives in s; -1 and 0 where the whole level counts
    unmodelled  (m,) rows of elements without a model
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
    unmodelled: Ints

    def __len__(self) -> int:
        return len(self.element)

    def by_element(self) -> dict[int, SeriesBoxes]:
        """The boxes of each element."""
        order = np.argsort(self.element, kind="stable")
        elements, first = np.unique(self.element[order], return_index=True)
        rows = np.split(order, first[1:]) if len(elements) else []
        return {int(element): self._part(own) for element, own in zip(elements, rows, strict=True)}

    def _part(self, rows: Ints) -> SeriesBoxes:
        """Some of the boxes."""
        numbers = {own.name: getattr(self, own.name)[rows] for own in fields(self) if own.name != "unmodelled"}
        return SeriesBoxes(**numbers, unmodelled=np.zeros(0, np.int64))

    @staticmethod
    def joined(parts: Sequence[SeriesBoxes]) -> SeriesBoxes:
        """The boxes of several searches."""
        numbers = {own.name: np.concatenate([getattr(part, own.name) for part in parts]) for own in fields(SeriesBoxes)}
        return SeriesBoxes(**{**numbers, "unmodelled": np.unique(numbers["unmodelled"])})


def world_boxes(series: Floats, errors: Floats) -> Floats:
    """(n, 6) low and high corner of boxes that contain the places of maps.

    series  (n, 3, count three times) Chebyshev coefficients of x, y and z
    errors  (n,) maximum error of places
    """
    middle = series[:, :, 0, 0, 0]
    extent = np.abs(series).sum(axis=(2, 3, 4)) - np.abs(middle) + errors[:, None]
    return np.concatenate([middle - extent, middle + extent], axis=1)
