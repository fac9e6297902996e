"""Tiles: small squares of pixels, the unit of work of a plane cut."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

TILE = 8


def tiles_of(sections: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Tiles of TILE x TILE pixels that cover the bounds of all sections, those cut off by x + y and x - y left out."""
    least, most = sections["least"], sections["most"]
    across = (most[:, 0] - least[:, 0]) // TILE + 1
    along = (most[:, 1] - least[:, 1]) // TILE + 1

    # number the tiles of every section
    counts = across * along
    owner = np.repeat(np.arange(len(sections)), counts)
    index = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    x = least[owner, 0] + TILE * (index % across[owner])
    y = least[owner, 1] + TILE * (index // across[owner])

    # keep those that the diagonal bounds touch
    reach = TILE - 1
    kept = (x + y + 2 * reach >= least[owner, 2]) & (x + y <= most[owner, 2])
    kept &= (x - y + reach >= least[owner, 3]) & (x - y - reach <= most[owner, 3])
    tiles = np.zeros(int(kept.sum()), dtype)
    tiles["element"], tiles["section"] = sections["element"][owner[kept]], owner[kept]
    tiles["x"], tiles["y"] = x[kept], y[kept]
    return tiles
