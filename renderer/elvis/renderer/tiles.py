"""Sections, where elements may be seen, and the tiles that cover them: small squares of pixels, the unit of work."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: as in pixels.slang
TILE = 8


@dataclass(frozen=True, eq=False)
class Sections:
    """Where elements may be seen.

    element      (n,)    number in its part
    least, most  (n, 4)  bounds of x, y, x + y and x - y of their pixels, inclusive
    """

    element: NDArray[Any]
    least: NDArray[Any]
    most: NDArray[Any]

    def __len__(self) -> int:
        return len(self.element)

    def __getitem__(self, chosen: NDArray[Any]) -> Sections:
        return Sections(self.element[chosen], self.least[chosen], self.most[chosen])


@dataclass(frozen=True, eq=False)
class Tiles:
    """Tiles of sections, (n,) each: number of the section, column and row of the first pixel."""

    section: NDArray[np.int64]
    x: NDArray[Any]
    y: NDArray[Any]

    def __len__(self) -> int:
        return len(self.section)

    def __getitem__(self, chosen: NDArray[Any]) -> Tiles:
        return Tiles(self.section[chosen], self.x[chosen], self.y[chosen])


def tiles_of(least: NDArray[Any], most: NDArray[Any]) -> Tiles:
    """Tiles of TILE x TILE pixels that cover the bounds (n, 4) of sections, but those that x + y or x - y cut off."""
    across = (most[:, 0] - least[:, 0]) // TILE + 1
    along = (most[:, 1] - least[:, 1]) // TILE + 1

    # number the tiles of every section
    counts = across * along
    owner = np.repeat(np.arange(len(least)), counts)
    index = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    x = least[owner, 0] + TILE * (index % across[owner])
    y = least[owner, 1] + TILE * (index // across[owner])

    # keep those that the diagonal bounds touch
    reach = TILE - 1
    kept = (x + y + 2 * reach >= least[owner, 2]) & (x + y <= most[owner, 2])
    kept &= (x - y + reach >= least[owner, 3]) & (x - y - reach <= most[owner, 3])
    return Tiles(owner[kept], x[kept].astype(np.int32), y[kept].astype(np.int32))
