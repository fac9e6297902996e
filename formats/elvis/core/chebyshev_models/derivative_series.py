"""Elements with models of the derivatives in expressions, made once on large boxes.

A derivative of a field on a curved element is a quotient of polynomials of high degree: most of the work for models of
products of derivatives.  It is smoother than these products, so its models suffice on larger boxes.  Restricting their
series to smaller boxes is exact but for rounding.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.chebyshev_models.expression_models import BoxLeaves, errors_in_eighths, models_of
from elvis.core.chebyshev_models.model_boxes import ElementSeries, ModelBoxes, eighths_of
from elvis.core.chebyshev_models.series import (
    ORDERS,
    PARTS_ROUNDING,
    along_axes,
    part_matrices,
    shells_of,
    tails_of,
)
from elvis.core.quantities.tree import Node, leaves


def derivatives_in(roots: Sequence[Node]) -> tuple[Node, ...]:
    """The derivatives of fields in expressions."""
    found = {leaf for leaf in leaves(*roots) if leaf.op == "field" and leaf.axes}
    return tuple(sorted(found, key=lambda leaf: (leaf.name, leaf.axes)))


@dataclass(frozen=True, eq=False)
class DerivativeSeries:
    """Some elements with models of derivatives on m large boxes.

    elements   all elements
    rows       (n,) those with models, ascending
    centres    (m, 3) and half side of the boxes, in the coordinates of the elements' cubes
    most       terms of a line of restricted series at most
    series     (n, m, derivatives, count three times) Chebyshev coefficients
    remainder  (n, m, ORDERS, derivatives) bounds of their errors, and of the errors' derivatives in x
    errors     (n, m, derivatives, 8) maximum errors of computed values in the eighths of the boxes
    """

    elements: ElementSeries
    rows: Ints
    centres: Floats
    half: float
    most: int
    series: Floats
    remainder: Floats
    errors: Floats

    @staticmethod
    def of(
        derivatives: Sequence[Node],
        leaves_on_boxes: Sequence[BoxLeaves],
        elements: ElementSeries,
        rows: Ints,
        centres: Floats,
        half: float,
        most: int,
    ) -> DerivativeSeries:
        """The models of derivatives from the leaves on each of the large boxes."""
        series, remainder, errors = [], [], []
        for own in leaves_on_boxes:
            models = models_of(derivatives, own)
            series.append(np.stack([model.coefficients for model in models], axis=1))
            remainder.append(np.stack([model.series_remainder.T for model in models], axis=2))
            errors.append(np.stack(errors_in_eighths(derivatives, own), axis=1))
        numbers = (np.stack(each, axis=1) for each in (series, remainder, errors))
        return DerivativeSeries(elements, rows, centres, half, most, *numbers)

    @property
    def finite(self) -> Bools:
        """(n,) which elements have only finite coefficients."""
        return self.elements.finite

    @property
    def maps(self) -> DerivativeSeries:
        """The elements without fields, but with the models of derivatives."""
        return replace(self, elements=self.elements.maps)

    def boxes(self, rows: Ints, centre: Floats, half: float) -> ModelBoxes:
        """The box with this centre (3,) and half side in some elements; derivatives follow the other leaves."""
        boxes = self.elements.boxes(rows, centre, half)
        number = int(np.abs(self.centres - centre).max(axis=1).argmin())
        own = np.searchsorted(self.rows, rows)
        found, lost, total = self._restricted(own, number, centre, half)
        # series of other leaves are padded, as all leaves have the same number of terms
        missing = found.shape[-1] - boxes.leaves.shape[-1]
        padded = np.pad(boxes.leaves, [(0, 0)] * 2 + [(0, missing)] * 3)
        return replace(
            boxes,
            leaves=np.concatenate([padded, found], axis=1),
            off=np.concatenate([boxes.off, PARTS_ROUNDING * total], axis=1),
            lost=np.concatenate([boxes.lost, lost], axis=2),
            errors=self._errors(own, number, centre, half),
        )

    def _errors(self, own: Ints, number: int, centre: Floats, half: float) -> Floats:
        """(n, derivatives) maximum errors of computed values in a part of a large box."""
        errors = self.errors[own, number]
        if half == self.half:
            return np.asarray(errors.max(axis=2))
        return np.asarray(errors[..., eighths_of(centre - self.centres[number])])

    def _restricted(self, own: Ints, number: int, centre: Floats, half: float) -> tuple[Floats, Floats, Floats]:
        """Series (n, derivatives, size three times) on a part of a large box, with their errors.

        The errors are bounds (n, ORDERS, derivatives) as ``remainder``, and sums of magnitudes (n, derivatives), for
        rounding.
        """
        coefficients = self.series[own, number]
        count, shape = coefficients.shape[-1], coefficients.shape[:2]
        ratio = half / self.half
        matrices = part_matrices(count, (centre - self.centres[number]) / self.half, np.array(ratio))
        found = along_axes(coefficients, *matrices)
        shells = shells_of(found.reshape(-1, count, count, count))
        # terms fade as boxes are bisected
        size = min(count - round(-np.log2(ratio)), self.most)
        lost = self.remainder[own, number] * ratio ** np.arange(ORDERS)[:, None]
        if size < count:
            lost = lost + np.moveaxis(tails_of(shells)[..., size].reshape(ORDERS, *shape), 0, 1)
        total = shells.sum(axis=1).reshape(shape)
        return np.ascontiguousarray(found[..., :size, :size, :size]), lost, total
