"""From global ids to rows."""

from __future__ import annotations

import numpy as np

from elvis.formats.arrays import Bools, Ints
from elvis.formats.errors import FormatError


class Lookup:
    """Finds the row of each id in an array of distinct ids; ``what`` names the entities in messages."""

    def __init__(self, ids: Ints, what: str) -> None:
        self._what, self._count = what, len(ids)
        self._is_identity = bool(np.array_equal(ids, np.arange(len(ids))))
        if self._is_identity:
            self._sorted = self._rows = ids
            return
        self._rows = np.argsort(ids, kind="stable")
        self._sorted = ids[self._rows]
        self._check_distinct()

    def _check_distinct(self) -> None:
        if self._count and self._sorted[0] < 0:
            raise FormatError(f"expected {self._what} ids from 0 up, found {self._sorted[0]}")
        again = np.flatnonzero(self._sorted[1:] == self._sorted[:-1])
        if len(again):
            raise FormatError(f"expected every {self._what} once, found {self._what} {self._sorted[again[0]]} twice")

    @property
    def ids(self) -> Ints:
        """The ids, ascending."""
        return self._sorted

    def present(self, ids: Ints) -> Bools:
        """Whether each id is there."""
        if self._is_identity:
            return (ids >= 0) & (ids < self._count)
        return self._found(ids)[1]

    def rows(self, ids: Ints, user: str) -> Ints:
        """Rows of the ids, in their shape; FormatError where one is unknown, ``user`` says who names it."""
        if self._is_identity:
            places, known = ids, (ids >= 0) & (ids < self._count)
        else:
            places, known = self._found(ids)
        if not known.all():
            wrong = ids[~known].flat[0]
            raise FormatError(f"expected {self._what} ids that exist in the {user}, found {self._what} {wrong}")
        return places if self._is_identity else self._rows[places]

    def _found(self, ids: Ints) -> tuple[Ints, Bools]:
        places = np.searchsorted(self._sorted, ids)
        if not self._count:
            return places, np.zeros(ids.shape, bool)
        np.minimum(places, self._count - 1, out=places)
        return places, self._sorted[places] == ids
