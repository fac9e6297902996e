"""Samples of a source at native reference points: in its own frame, a batch at a time, checked."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.polynomials.kronecker import RowMap
from elvis.plugins.conversion.plugin import Converter, Elements, SourceField
from elvis.plugins.projection.blocks import NativeBlock

#: numbers in an array of samples of one field
BATCH = 1 << 18


class Sampler:
    """Asks a converter for samples; ElvisError where a result has the wrong shape."""

    def __init__(self, source: Converter) -> None:
        self.source = source
        self._last: tuple[NativeBlock, slice | Ints, Elements] | None = None

    def batches(
        self, block: NativeBlock, points: Floats, size: int = BATCH, only: Ints | None = None
    ) -> Iterator[tuple[slice | Ints, Floats]]:
        """Rows of the block in batches, each with the source's points for native ``points`` (n, d).

        size  numbers in an array of samples of one field
        only  ids of the elements that are meant; None for all
        """
        cache: dict[int, Floats] = {}
        for order, part in block.batches(size // max(1, len(points)), only):
            if order not in cache:
                cache[order] = np.ascontiguousarray(block.points(order, points))
            yield part, cache[order]

    def positions(self, block: NativeBlock, rows: slice | Ints, points: Floats) -> Floats:
        """(k, n, 3) world coordinates at the source's points (n, d) of elements ``rows`` of the block."""
        elements = self._elements(block, rows)
        found = np.asarray(self.source.positions(elements, points), np.float64)
        if found.ndim != 3 or found.shape[:2] != (len(elements), len(points)) or found.shape[2] not in (1, 2, 3):
            raise self._error("positions", f"({len(elements)}, {len(points)}, 3)", found)
        if found.shape[2] == 3:
            return found
        padded = np.zeros((*found.shape[:2], 3))
        padded[:, :, : found.shape[2]] = found
        return padded

    def values(self, block: NativeBlock, rows: slice | Ints, field: SourceField, points: Floats) -> Floats:
        """(k, n) values of a field at the source's points (n, d) of elements ``rows`` of the block."""
        elements = self._elements(block, rows)
        found = np.asarray(self.source.sample(elements, field, points), np.float64)
        if found.shape != (len(elements), len(points)):
            raise self._error(f"sample of {field.name}", f"({len(elements)}, {len(points)})", found)
        return found

    def fitted(
        self, block: NativeBlock, rows: slice | Ints, field: SourceField | None, points: Floats, fit: RowMap
    ) -> Floats:
        """Samples of a field (k, n), or of positions (k, 3, n) for None, times a map from these points to coefficients.

        Values at nodes are mapped directly to coefficients.
        """
        nodal = self.source.at_nodes(self._elements(block, rows), field)
        if nodal is not None:
            values, to_points = nodal
            return to_points(points).then(fit)(values)
        if field is None:
            return fit(self.positions(block, rows, points).transpose(0, 2, 1))
        return fit(self.values(block, rows, field, points))

    def _elements(self, block: NativeBlock, rows: slice | Ints) -> Elements:
        """The source's elements; kept until others are requested, as fields are sampled in turn on the same ones."""
        if self._last is None or self._last[0] is not block or self._last[1] is not rows:
            self._last = block, rows, block.take(rows)
        return self._last[2]

    def _error(self, method: str, expected: str, found: Floats) -> ElvisError:
        name = type(self.source).__name__
        return ElvisError(f"{name}: {method}: expected an array of shape {expected}, found {found.shape}")
