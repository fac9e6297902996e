"""Boxes of elements with series of the map and of fields, and their parts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.chebyshev_models.series import ORDERS, to_half

#: the eight eighths of a box
EIGHTHS = tuple((x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1))


def eighths_of(offset: Floats) -> Ints:
    """Numbers (...) in EIGHTHS of the eighths of boxes at offsets (..., 3) from their centres."""
    return np.asarray((offset > 0.0) @ np.array((1, 2, 4)))


@dataclass(frozen=True, eq=False)
class ModelBoxes(Rows):
    """Boxes of elements, in the coordinates of the cubes that hold them, with series in x = s / ROOM.

    element   (n,) rows of elements
    centre    (n, 3) and half (n,) half sides
    leaves    (n, leaves, degree + 1 three times) series of the map, of fields, and of what has models
    off       (n, leaves) maximum error of the series, by polynomials of their degree
    lost      (n, ORDERS, leaves) bounds of other errors of the series, and of the derivatives of these errors in x
    errors    (n, k) maximum error of computed values of the last k leaves, which are models
    """

    element: Ints
    centre: Floats
    half: Floats
    leaves: Floats
    off: Floats
    lost: Floats
    errors: Floats

    @staticmethod
    def of_polynomials(element: Ints, centre: Floats, half: Floats, leaves: Floats, off: Floats) -> ModelBoxes:
        """Boxes whose leaves are all polynomials."""
        none = np.zeros((len(element), ORDERS, leaves.shape[1]))
        return ModelBoxes(element, centre, half, leaves, off, none, np.zeros((len(element), 0)))


class ElementSeries(Protocol):
    """Elements whose maps and fields have series on any box of their cubes."""

    @property
    def finite(self) -> Bools:
        """(n,) which of them have only finite numbers."""

    @property
    def maps(self) -> ElementSeries:
        """The elements without fields."""

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
