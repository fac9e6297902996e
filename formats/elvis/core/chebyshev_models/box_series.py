"""Series of one quantity on boxes, and on parts of these boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.rows import Rows
from elvis.core.chebyshev_models.model_boxes import half_along
from elvis.core.chebyshev_models.series import bounds_in_eighths, magnitudes_of, sum_rounding


@dataclass(frozen=True, eq=False)
class BoxSeries(Rows):
    """Series of a quantity on n boxes.

    coefficients  (n, count, count, count)
    range         (n,) how far the series go from their means: sums of the magnitudes of all other coefficients
    """

    coefficients: Floats
    range: Floats

    @staticmethod
    def of(coefficients: Floats) -> BoxSeries:
        """Series with these coefficients."""
        return BoxSeries(coefficients, magnitudes_of(coefficients, 1))

    @property
    def count(self) -> int:
        """Terms in each direction."""
        return int(self.coefficients.shape[-1])

    @property
    def mean(self) -> Floats:
        """(n,) the constant terms."""
        return self.coefficients[:, 0, 0, 0]

    @property
    def total(self) -> Floats:
        """(n,) sums of the magnitudes of all coefficients."""
        return np.asarray(np.abs(self.mean) + self.range)

    @property
    def rounding(self) -> Floats:
        """(n,) bounds of the rounding of `on_side`."""
        return 2.0 * sum_rounding(self.count) * self.total

    def on_side(self, axis: int, side: int) -> BoxSeries:
        """The series on the halves of the boxes along an axis on one side."""
        return BoxSeries.of(half_along(self.coefficients, axis, side))

    def in_eighths(self) -> tuple[Floats, Floats]:
        """Means (n, 8) on the eighths of the boxes, and maximum distances from them (n, 8)."""
        return bounds_in_eighths(self.coefficients, self.total)

    def shortened(self, count: int) -> BoxSeries:
        """The series without terms of the degree ``count`` and beyond."""
        return BoxSeries.of(np.ascontiguousarray(self.coefficients[:, :count, :count, :count]))
