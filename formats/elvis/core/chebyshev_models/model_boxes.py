"""Boxes of elements with series of the map and of fields, and their parts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.chebyshev_models.series import along_axes, sum_rounding, to_half

#: the eight eighths of a box
_EIGHTHS = tuple((x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1))


@dataclass(frozen=True, eq=False)
class ModelBoxes:
    """Boxes of elements, in the coordinates of the cubes that hold them, with series in x = s / ROOM.

    element   (n,) rows of elements
    centre    (n, 3) and half (n,) half sides
    leaves    (n, 3 + fields, degree + 1 three times) series of the map and of fields
    off       (n, 3 + fields) maximum error of the series from which these were restricted
    wide      (n,) half sides of the boxes of those series: the error is a polynomial there
    rounding  (n, 3 + fields) maximum error that restrictions added
    """

    element: Ints
    centre: Floats
    half: Floats
    leaves: Floats
    off: Floats
    wide: Floats
    rounding: Floats

    @staticmethod
    def fresh(element: Ints, centre: Floats, half: Floats, leaves: Floats, off: Floats) -> ModelBoxes:
        """Boxes with series of their own."""
        return ModelBoxes(element, centre, half, leaves, off, half, np.zeros_like(off))

    def __len__(self) -> int:
        return len(self.element)

    def part(self, rows: Ints | Bools) -> ModelBoxes:
        """Some of the boxes."""
        return ModelBoxes(*(getattr(self, own.name)[rows] for own in fields(self)))

    def eighths(self, inside: ShapeFacets) -> ModelBoxes:
        """Eighths of all boxes that may lie in their elements."""
        parts = [self._eighth(sides) for sides in _EIGHTHS]
        found = joined(parts)
        return found.part(inside.holds(found.centre, found.half))

    @property
    def error(self) -> Floats:
        """(n, 3 + fields) maximum error of the series."""
        return self.off + self.rounding

    def moved(self, axis: int, side: int) -> ModelBoxes:
        """The halves along an axis on one side; the sizes are not updated."""
        centre = self.centre.copy()
        centre[:, axis] += 0.5 * side * self.half
        return replace(
            self, centre=centre, leaves=half_along(self.leaves, axis, side), rounding=self._rounding_of_parts
        )

    def _eighth(self, sides: tuple[int, int, int]) -> ModelBoxes:
        """The eighth of each box on these sides."""
        half = 0.5 * self.half
        centre = self.centre + half[:, None] * np.array(sides)
        leaves = restricted(self.leaves, sides)
        return replace(self, centre=centre, half=half, leaves=leaves, rounding=self._rounding_of_parts)

    @property
    def _rounding_of_parts(self) -> Floats:
        """The rounding of series on parts of the boxes."""
        totals = np.abs(self.leaves).sum(axis=(2, 3, 4))
        return np.asarray(self.rounding + 2.0 * sum_rounding(self.leaves.shape[-1]) * totals)


class ElementSeries(Protocol):
    """Elements whose maps and fields have series on any box of their cubes."""

    @property
    def finite(self) -> Bools:
        """(n,) which of them have only finite numbers."""

    def boxes(self, rows: Ints, centre: Floats, half: float) -> ModelBoxes:
        """The box with this centre (3,) and half side in some elements."""


@dataclass(frozen=True, eq=False)
class ShapeFacets:
    """The half spaces (k, 4) whose intersection is the shape of the elements in their cubes."""

    facets: Floats

    def holds(self, centre: Floats, half: Floats) -> Bools:
        """(n,) whether boxes may meet the shape."""
        normal, offset = self.facets[:, :3], self.facets[:, 3]
        farthest = centre @ normal.T + half[:, None] * np.abs(normal).sum(axis=1) + offset
        return np.asarray((farthest >= -1e-9).all(axis=1))


def in_batches(boxes: ModelBoxes, count: int) -> Iterator[ModelBoxes]:
    """Boxes, at most ``count`` at a time."""
    for first in range(0, len(boxes), count):
        yield boxes.part(np.arange(first, min(first + count, len(boxes))))


def joined(parts: list[ModelBoxes]) -> ModelBoxes:
    """The boxes of several."""
    return ModelBoxes(*(np.concatenate([getattr(part, own.name) for part in parts]) for own in fields(ModelBoxes)))


def half_along(series: Floats, axis: int, side: int) -> Floats:
    """Series (..., n, n, n) on the half of their boxes on one side along an axis."""
    matrix = to_half(series.shape[-1], side)
    if axis == 0:
        return np.asarray(np.matmul(series, matrix.T))
    if axis == 1:
        return np.asarray(np.matmul(matrix, series))
    # sizes in full, as there may be no series
    flat = np.matmul(matrix, series.reshape(*series.shape[:-2], series.shape[-2] * series.shape[-1]))
    return np.asarray(flat.reshape(series.shape))


def restricted(series: Floats, sides: tuple[int, int, int]) -> Floats:
    """Series (..., n, n, n) on one eighth of their boxes."""
    count = series.shape[-1]
    return along_axes(series, *(to_half(count, side) for side in sides))
