"""From global ids to rows."""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Bools, Ints
from elvis.core.errors import FormatError

_AT_ONCE = 1 << 17

#: ids up to so many times their number are looked up in a table, sparser ones by bisection
_DENSE = 4


class Lookup:
    """Finds the row of each id in an array of distinct ids; ``what`` names the entities in messages."""

    def __init__(self, ids: Ints, what: str) -> None:
        self._what = what
        self._table: Ints | None = None
        if len(ids) and ids.min() < 0:
            raise FormatError(f"expected {what} ids from 0 up, found {ids.min()}")
        if len(ids) and ids.max() < _DENSE * len(ids) + _AT_ONCE:
            self._table, again = _table(ids)
        else:
            self._rows = np.argsort(ids, kind="stable")
            self._sorted = ids[self._rows]
            again = self._sorted[1:][self._sorted[1:] == self._sorted[:-1]]
        if len(again):
            raise FormatError(f"expected every {what} once, found {what} {again[0]} twice")

    @property
    def ids(self) -> Ints:
        """The ids, ascending."""
        return self._sorted if self._table is None else np.flatnonzero(self._table >= 0)

    def present(self, ids: Ints) -> Bools:
        """Whether each id is there."""
        return self._found(ids)[1]

    def rows(self, ids: Ints, user: str) -> Ints:
        """Rows of the ids, in their shape; FormatError where one is unknown, ``user`` says who names it."""
        return self.into_rows(ids.copy(), user)

    def into_rows(self, ids: Ints, user: str) -> Ints:
        """As `rows`, but the array itself is overwritten: no second one of its size is needed."""
        ids = np.ascontiguousarray(ids)
        flat = ids.reshape(-1)
        for start in range(0, len(flat), _AT_ONCE):
            part = flat[start : start + _AT_ONCE]
            rows, known = self._found(part)
            if not known.all():
                wrong = part[~known][0]
                raise FormatError(f"expected {self._what} ids that exist in the {user}, found {self._what} {wrong}")
            part[:] = rows
        return ids

    def _found(self, ids: Ints) -> tuple[Ints, Bools]:
        """Rows, and whether they are right."""
        if self._table is not None:
            rows = self._table[np.clip(ids, 0, len(self._table) - 1)]
            return rows, (rows >= 0) & (ids >= 0) & (ids < len(self._table))
        if not len(self._sorted):
            return np.zeros_like(ids), np.zeros(ids.shape, bool)
        places = np.minimum(np.searchsorted(self._sorted, ids), len(self._sorted) - 1)
        return self._rows[places], self._sorted[places] == ids


def _table(ids: Ints) -> tuple[Ints, Ints]:
    """Row by id, -1 where there is none, and the ids that are there twice."""
    table = np.full(int(ids.max()) + 1, -1)
    table[ids] = np.arange(len(ids))
    return table, ids[table[ids] != np.arange(len(ids))]
