"""Records of several items, such as boxes in a search: an array of rows for each property."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass, replace
from typing import Any, Self

import numpy as np

from elvis.core.base.arrays import Bools, Ints


class Rows:
    """Base of dataclasses whose arrays (n, …) have one row an item.

    Rows that a field contains, and mappings of arrays, also have one an item.  All else holds for every item.
    """

    def __len__(self) -> int:
        """Number of the items, n."""
        return len(next(value for _, value in self._columns() if not isinstance(value, Mapping)))

    def part(self, chosen: Ints | Bools | slice) -> Self:
        """Some of the items."""
        return self._with({name: _part(value, chosen) for name, value in self._columns()})

    @classmethod
    def joined(cls, several: Sequence[Self]) -> Self:
        """The items of several records in their order; other values come from the first record."""
        first = several[0]
        if len(several) == 1:
            return first
        names = [name for name, _ in first._columns()]
        return first._with({name: _joined([getattr(own, name) for own in several]) for name in names})

    def _columns(self) -> Iterator[tuple[str, Any]]:
        """Names and values of the fields that have one row an item."""
        assert is_dataclass(self)
        for own in fields(self):
            value = getattr(self, own.name)
            if isinstance(value, np.ndarray | Rows | Mapping):
                yield own.name, value

    def _with(self, columns: Mapping[str, Any]) -> Self:
        """The record with other rows."""
        assert is_dataclass(self)
        return replace(self, **columns)


def _part(value: Any, chosen: Ints | Bools | slice) -> Any:
    """Some rows of an array, of rows, or of each array of a mapping."""
    if isinstance(value, Rows):
        return value.part(chosen)
    if isinstance(value, Mapping):
        return {key: own[chosen] for key, own in value.items()}
    return value[chosen]


def _joined(values: Sequence[Any]) -> Any:
    """Rows of several arrays, of several rows, or of the arrays of several mappings."""
    first = values[0]
    if isinstance(first, Rows):
        return first.joined(values)
    if isinstance(first, Mapping):
        return {key: np.concatenate([own[key] for own in values]) for key in first}
    return np.concatenate(values)
