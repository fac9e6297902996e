"""Regular grids of values in NRRD files (teem's format, version 5): a text header, followed by the raw numbers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.files.output import replacing


@dataclass(frozen=True)
class Grid:
    """Points low + i (high - low)/(counts - 1) in each direction; a single one lies in the middle.

    low, high  ends of the box
    counts     points along x, y and z
    """

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    counts: tuple[int, int, int]

    def along(self, axis: int) -> Floats:
        """(n,) coordinates of the points along an axis."""
        low, high, count = self.low[axis], self.high[axis], self.counts[axis]
        return np.linspace(low, high, count) if count > 1 else np.array([0.5 * (low + high)])

    def spacing(self, axis: int) -> float:
        """Distance between points; for a single point the length of the box, or 1 if it is zero."""
        return (self.high[axis] - self.low[axis]) / max(1, self.counts[axis] - 1) or 1.0

    def planes(self, first: int, last: int) -> Floats:
        """(n, 3) the points of some planes of constant z, x running fastest, then y."""
        z, y, x = np.meshgrid(self.along(2)[first:last], self.along(1), self.along(0), indexing="ij")
        return np.column_stack([x.ravel(), y.ravel(), z.ravel()])


def write_nrrd(path: str | Path, grid: Grid, names: Sequence[str], parts: Iterable[Floats]) -> None:
    """Write the values of quantities at the points of a grid.

    parts  (n, f) values of the names, part after part, the points in the order of `Grid.planes`
    Several quantities are the components of vectors, whose names the key ``fields`` lists.
    """
    with replacing(path) as temporary, temporary.open("wb") as file:
        file.write(_header(grid, names).encode())
        for values in parts:
            file.write(np.ascontiguousarray(values, "<f8").tobytes())


def _header(grid: Grid, names: Sequence[str]) -> str:
    """The text before the numbers, with the blank line that ends it."""
    several, origin = len(names) > 1, ",".join(repr(float(grid.along(axis)[0])) for axis in range(3))
    steps = np.diag([grid.spacing(axis) for axis in range(3)])
    directions = " ".join(f"({','.join(repr(float(part)) for part in row)})" for row in steps)
    listed = " ".join(name.replace("\\", "\\\\").replace("\n", "\\n") for name in names)
    lines = [
        "NRRD0005",
        "type: double",
        f"dimension: {4 if several else 3}",
        "space dimension: 3",
        f"sizes: {f'{len(names)} ' if several else ''}{' '.join(map(str, grid.counts))}",
        f"space directions: {'none ' if several else ''}{directions}",
        f"kinds: {'vector ' if several else ''}domain domain domain",
        "endian: little",
        "encoding: raw",
        f"space origin: ({origin})",
        f"fields:={listed}",
    ]
    return "\n".join([*lines, "", ""])
