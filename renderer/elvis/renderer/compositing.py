"""Coats of colour: what lies before over what lies behind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.formats.arrays import Floats

#: what lies behind surfaces that together let less than this part of the light through does not count
FAINT = 1e-3


@dataclass(frozen=True, eq=False)
class Coat:
    """What one layer adds to n pixels.

    depth  (n,)    of the layer, infinite where it has nothing
    color  (n, 3)  times alpha
    alpha  (n,)    part in [0, 1] of what lies behind that is hidden
    """

    depth: Floats
    color: Floats
    alpha: Floats


def composite(coats: Sequence[Coat], background: Floats | Sequence[float]) -> Floats:
    """Colours (n, 3) of n pixels: coats in any order, nearest over farther, equal depths in the order given.

    background  (3,) or (n, 3)
    """
    if len(coats) == 1:
        return np.asarray(coats[0].color + (1.0 - coats[0].alpha)[:, None] * np.asarray(background, dtype=np.float64))
    depth = np.stack([coat.depth for coat in coats])
    order = np.argsort(depth, axis=0, kind="stable")
    color = np.zeros((depth.shape[1], 3))
    through = np.ones(depth.shape[1])
    for rank in range(len(coats)):
        for number, coat in enumerate(coats):
            here = np.flatnonzero((order[rank] == number) & np.isfinite(coat.depth))
            color[here] += through[here, None] * coat.color[here]
            through[here] *= 1.0 - coat.alpha[here]
    return np.asarray(color + through[:, None] * np.asarray(background, dtype=np.float64))
