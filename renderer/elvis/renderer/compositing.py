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
    depth, alpha, color = (np.array(values) for values in (coats[0].depth, coats[0].alpha, coats[0].color))
    layers = np.isfinite(depth).astype(np.uint8)
    for coat in coats[1:]:
        nearer = np.flatnonzero(coat.depth < depth)
        depth[nearer], alpha[nearer], color[nearer] = coat.depth[nearer], coat.alpha[nearer], coat.color[nearer]
        layers += np.isfinite(coat.depth)

    # the nearest coat is all there is, unless it lets others through
    mixed = np.flatnonzero((layers > 1) & (alpha < 1.0))
    if len(mixed):
        parts = [Coat(coat.depth[mixed], coat.color[mixed], coat.alpha[mixed]) for coat in coats]
        color[mixed], alpha[mixed] = _mixed(parts)
    clear = np.flatnonzero(alpha < 1.0)
    behind = np.broadcast_to(np.asarray(background, dtype=np.float64), color.shape)
    color[clear] += (1.0 - alpha[clear, None]) * behind[clear]
    return color


def _mixed(coats: Sequence[Coat]) -> tuple[Floats, Floats]:
    """Colours (n, 3) times alpha, and alphas (n,), of coats one over the other."""
    order = np.argsort(np.stack([coat.depth for coat in coats]), axis=0, kind="stable")
    color, through = np.zeros((order.shape[1], 3)), np.ones(order.shape[1])
    for rank in range(len(coats)):
        for number, coat in enumerate(coats):
            here = np.flatnonzero((order[rank] == number) & np.isfinite(coat.depth))
            color[here] += through[here, None] * coat.color[here]
            through[here] *= 1.0 - coat.alpha[here]
    return color, 1.0 - through
