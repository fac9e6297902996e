"""Layers to colours: light, lines over colour, and what lies before over what lies behind.

Colours are those of the palette, sRGB values in [0, 1]; they are shaded and mixed as they are, so that an opaque unlit
surface has exactly the colours of its colour bar.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.formats.arrays import Floats
from elvis.renderer.layer import Layer
from elvis.renderer.scene import Light, unit
from elvis.renderer.view import View


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

    @staticmethod
    def of(
        layer: Layer, colors: Floats, opacity: float = 1.0, lines: Sequence[tuple[Floats, Sequence[float]]] = ()
    ) -> Coat:
        """A layer of colours (n, 3), under opaque lines: coverages (n,) and their colours, the later ones on top."""
        hit = np.isfinite(layer.depth)
        alpha = np.where(hit, opacity, 0.0)
        color = np.where(hit[:, None], opacity * colors, 0.0)
        for coverage, ink in lines:
            drawn = np.flatnonzero(hit & (coverage > 0.0))
            part = coverage[drawn]
            alpha[drawn] += part * (1.0 - alpha[drawn])
            color[drawn] += part[:, None] * (np.asarray(ink) - color[drawn])
        return Coat(layer.depth, color, alpha)


def lit(view: View, layer: Layer, colors: Floats, lights: Sequence[Light], ambient: float) -> Floats:
    """Colours (n, 3) of a layer by Lambert's law: their own times ambient + sum of intensity times cosine, at most 1.

    The side that the viewer sees is lit, whichever it is.
    """
    hit = np.flatnonzero(np.isfinite(layer.depth))
    normal = layer.normal[hit]
    shade = np.full(len(hit), ambient)
    for light in lights:
        if light.direction is not None:
            cosine = normal @ unit(light.direction, "the direction of a light")
        else:
            towards = view.rays(hit % view.width, hit // view.width)[1]
            cosine = -np.einsum("ij,ij->i", normal, towards) / np.linalg.norm(towards, axis=1)
        shade += light.intensity * np.maximum(cosine, 0.0)
    result = np.array(colors, dtype=np.float64)
    result[hit] *= np.minimum(shade, 1.0)[:, None]
    return result


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
