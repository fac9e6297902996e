"""Boxes of elements with series of the map and of fields, and their parts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.chebyshev_models.series import to_half

#: the eight eighths of a box
_EIGHTHS = tuple((x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1))


@dataclass(frozen=True, eq=False)
class ModelBoxes:
    """Boxes of elements, in the coordinates of the cubes that hold them, with series in x = s / ROOM.

    element   (n,) rows of elements
    centre    (n, 3) and half (n,) half sides
    leaves    (n, 3 + fields, degree + 1 three times) series of the map and of fields
    off       (n, 3 + fields) maximum error of the series
    """

    element: Ints
    centre: Floats
    half: Floats
    leaves: Floats
    off: Floats

    def __len__(self) -> int:
        return len(self.element)

    def part(self, rows: Ints | Bools) -> ModelBoxes:
        """Some of the boxes."""
        return ModelBoxes(*(getattr(self, own.name)[rows] for own in fields(self)))

    @property
    def eighths(self) -> tuple[Ints, Floats, Floats]:
        """Elements, centres and half sides of the eighths of all boxes."""
        half = 0.5 * self.half
        centres = self.centre[:, None] + half[:, None, None] * np.array(_EIGHTHS)
        return np.repeat(self.element, 8), centres.reshape(-1, 3), np.repeat(half, 8)


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
