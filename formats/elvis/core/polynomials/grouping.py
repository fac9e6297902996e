"""Coefficients of the same elements from several lists of blocks, brought together by expansion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Expansion


class Coefficients(Protocol):
    """Elements of one expansion: blocks of fields and of the geometry."""

    @property
    def expansion(self) -> Expansion:
        """The space all elements share."""

    @property
    def element_ids(self) -> Ints:
        """(n,) ids in the file."""

    @property
    def coefficients(self) -> Floats:
        """(n, …, m) with one row an element."""


@dataclass(frozen=True, eq=False)
class Group:
    """Elements with one expansion in each source, None if a source lacks them.

    element_ids   (n,)
    coefficients  (n, …, m) for each source
    """

    element_ids: Ints
    expansions: tuple[Expansion | None, ...]
    coefficients: tuple[Floats | None, ...]


def grouped(element_ids: Ints, sources: Sequence[Sequence[Coefficients]]) -> Iterator[Group]:
    """The elements ``element_ids``, grouped by their expansion in each of the ``sources``.

    Order is preserved within a group; blocks that coincide with a group are passed on without a copy.  If a source
    holds an element twice, the first one counts.
    """
    only = [blocks[0] for blocks in sources if len(blocks) == 1]
    is_one = len(only) == len(sources) and all(np.array_equal(own.element_ids, element_ids) for own in only)
    if is_one and len(element_ids):
        yield Group(element_ids, tuple(own.expansion for own in only), tuple(own.coefficients for own in only))
        return
    places = [_Places(element_ids, blocks) for blocks in sources]
    keys = np.stack([place.expansion for place in places], axis=1)
    distinct, first, index = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    for number in np.argsort(first):
        here = np.flatnonzero(index.reshape(-1) == number)
        expansions = tuple(p.expansions[k] if k >= 0 else None for p, k in zip(places, distinct[number], strict=True))
        gathered = tuple(p.gather(here) if e is not None else None for p, e in zip(places, expansions, strict=True))
        whole = len(here) == len(element_ids)
        yield Group(element_ids if whole else element_ids[here], expansions, gathered)


class _Places:
    """Positions of the elements ``wanted`` (n,) in a list of blocks.

    block, row  (n,) number of the block, -1 if none holds the element, and row in it
    expansion   (n,) number of the element's expansion among ``expansions``, -1 if it has none
    """

    def __init__(self, wanted: Ints, blocks: Sequence[Coefficients]) -> None:
        self.blocks = blocks
        self.expansions = list(dict.fromkeys(block.expansion for block in blocks))
        self.block, self.row = np.full(len(wanted), -1), np.zeros(len(wanted), np.int64)
        order = np.argsort(wanted, kind="stable")
        for number in reversed(range(len(blocks))):
            self._find(wanted, order, number)
        numbers = np.array([self.expansions.index(block.expansion) for block in blocks] + [-1])
        self.expansion: Ints = numbers[self.block]

    def _find(self, wanted: Ints, order: Ints, number: int) -> None:
        ids = self.blocks[number].element_ids
        if np.array_equal(ids, wanted):
            self.block[:], self.row[:] = number, np.arange(len(ids))
            return

        # seek each id among the requested ones; the first of a repeated id is written last
        place = np.minimum(np.searchsorted(wanted, ids, sorter=order), len(wanted) - 1)
        found = order[place] if len(wanted) else place[:0]
        rows = np.flatnonzero(wanted[found] == ids)[::-1] if len(wanted) else place[:0]
        self.block[found[rows]], self.row[found[rows]] = number, rows

    def gather(self, here: Ints) -> Floats:
        """Coefficients of the requested elements ``here``, all of one expansion; a whole block without a copy."""
        blocks, rows = self.block[here], self.row[here]
        first: Floats = self.blocks[blocks[0]].coefficients
        if len(here) == len(first) and _is_range(rows) and (blocks == blocks[0]).all():
            return first
        result = np.empty((len(here), *first.shape[1:]))
        for number in np.unique(blocks):
            mine = blocks == number
            result[mine] = self.blocks[number].coefficients[rows[mine]]
        return result


def _is_range(rows: Ints) -> bool:
    return bool((rows == np.arange(len(rows))).all())
