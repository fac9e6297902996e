"""Coefficients of a section ELEMENTS that stay packed until the elements they are needed for are known."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.formats.nektar.payload import numbers_exactly
from elvis.formats.nektar.xml import Element, format_errors_at


@dataclass(frozen=True, eq=False)
class Packed:
    """Coefficients, field by field, element by element.

    element  that holds them
    counts   (n,) number of coefficients of each field on each element of the section
    fields   number of fields
    rows     ascending numbers of the requested fields
    """

    element: Element
    counts: Ints
    fields: int
    rows: tuple[int, ...]

    @property
    def nbytes(self) -> int:
        """Memory of all requested coefficients, in bytes."""
        return 8 * len(self.rows) * int(self.counts.sum())

    def of_fields(self, rows: Sequence[int]) -> Packed:
        """The coefficients of some of the requested fields."""
        return replace(self, rows=tuple(self.rows[row] for row in rows))

    def of(self, is_wanted: Bools) -> Floats:
        """(f, m) coefficients of the requested elements (n,), one row per field.

        All others are skipped while they are unpacked.

        Raises FormatError if any are damaged.
        """
        ends = np.cumsum(self.counts)
        found = np.empty((len(self.rows), int(self.counts[is_wanted].sum())))
        filled = [0] * len(self.rows)
        for field, start, numbers in self._pieces():
            if field in self.rows:
                row = self.rows.index(field)
                own = numbers[self._of_elements(is_wanted, ends, start, len(numbers))]
                found[row, filled[row] : filled[row] + len(own)] = own
                filled[row] += len(own)
        return found

    def _pieces(self) -> Iterator[tuple[int, int, Floats]]:
        """A field, the place in it, and numbers from there on, one piece after another."""
        total, place = int(self.counts.sum()), 0
        with format_errors_at(self.element):
            for piece in numbers_exactly(self.element.content, total * self.fields, total * (self.rows[-1] + 1)):
                rest = piece
                while len(rest):
                    field, start = divmod(place, total)
                    here, rest = rest[: total - start], rest[total - start :]
                    yield field, start, here
                    place += len(here)

    def _of_elements(self, is_wanted: Bools, ends: Ints, start: int, count: int) -> Bools:
        """(count,) whether the numbers of a field, from ``start`` on, are on requested elements.

        ends  (n,) end of the numbers of each element
        """
        first = int(np.searchsorted(ends, start, side="right"))
        some = slice(first, int(np.searchsorted(ends, start + count - 1, side="right")) + 1)
        skipped = start - int(ends[first] - self.counts[first])
        return np.repeat(is_wanted[some], self.counts[some])[skipped : skipped + count]
