"""Lines of points with values there: what streamlines and core lines have in common."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data import describing
from elvis.core.files.columns import Columns


class PointLines:
    """Base of lines of points, with how they end.

    offsets    (n+1,)  line i has the points offsets[i] to offsets[i+1]
    ends       words for ends, then the names of boundaries
    points     (m, 3)  world coordinates
    velocity   (m, 3)
    values     further quantities (m,) by name
    """

    #: meanings of words for ends, and names of columns at points other than ``values``
    MEANINGS: ClassVar[Mapping[str, str]]
    AT_POINTS: ClassVar[tuple[str, ...]]
    offsets: Ints
    ends: tuple[str, ...]
    points: Floats
    velocity: Floats
    values: Mapping[str, Floats]

    def __len__(self) -> int:
        return len(self.offsets) - 1

    def _repr_html_(self) -> str:
        """The points of the first and last lines as notebooks show them."""
        return describing.table_of_columns(self.columns(), repr(self))

    def __getitem__(self, line: int) -> Floats:
        """(k, 3) the points of a line."""
        if not -len(self) <= line < len(self):
            raise IndexError(f"expected the number of one of {len(self)} lines, found {line}")
        line %= len(self)
        return self.points[self.offsets[line] : self.offsets[line + 1]]

    def end_numbers(self) -> Ints:
        """(k,) the ends to be counted, indices into ``ends``."""
        raise NotImplementedError

    def columns(self) -> Columns:
        """Arrays (m,) by name, one row per point."""
        raise NotImplementedError

    def arrays(self) -> Columns:
        """Content of an archive: all arrays by name."""
        raise NotImplementedError

    def counts(self) -> dict[str, int]:
        """Number of ends of each kind that occurs."""
        numbers = np.bincount(self.end_numbers(), minlength=len(self.ends))
        return {name: int(number) for name, number in zip(self.ends, numbers, strict=True) if number}

    def table(self) -> Iterator[tuple[str, str, int]]:
        """The name, the meaning and the number of each kind of end."""
        for name, count in self.counts().items():
            yield name, self.MEANINGS.get(name, "left the domain through this boundary"), count

    def at_points(self) -> Columns:
        """Arrays (m,) and (m, 3) by name, at each point."""
        return {**{name: getattr(self, name) for name in self.AT_POINTS}, **self.values}

    def line_of_points(self) -> Ints:
        """(m,) the number of each point's line."""
        return np.repeat(np.arange(len(self)), np.diff(self.offsets))

    def coordinates(self) -> Columns:
        """Arrays (m,) by name: x, y, z and the columns `AT_POINTS`; a vector has a column for each component."""
        found = dict(zip("xyz", self.points.T, strict=True))
        for name in self.AT_POINTS:
            column = getattr(self, name)
            if column.ndim > 1:
                found |= {f"{name}_{axis}": own for axis, own in zip("xyz", column.T, strict=True)}
            else:
                found[name] = column
        return found
