"""Colours of pixels from hits of their rays, in NumPy: the colour map, light, lines, opacity.

Only the colour map and the definition of scenes are shared with the renderer, and no code that computes with them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.reference.hits import Hits
from elvis.reference.record import Record
from elvis.scene import Scene, Style, Transfer
from elvis.scene.cameras.view import View
from elvis.scene.flow.streaks import toned
from elvis.scene.record.palette import Palette


@dataclass(frozen=True, eq=False)
class SurfaceHits:
    """The hits of one object, nearest first: one set for each surface that a ray may meet, fewer where it is opaque.

    quantity  the name of the values that colour it
    lit       whether lights shade it
    lines     (n,) coverage of its contours, then of its mesh lines, of each set
    tones     (n,) of its streaks
    """

    hits: Hits
    style: Style
    quantity: str
    lit: bool
    lines: tuple[tuple[Floats, tuple[float, float, float]], ...] = ()
    tones: Floats | None = None


@dataclass(frozen=True, eq=False)
class Fragments:
    """Colours along rays: from surfaces, and from volumes between surfaces.

    pixel  (k,)
    depth  (k,)    of a surface, or of the middle of a segment
    color  (k, 3)  times alpha
    alpha  (k,) share in [0, 1] of the light from behind that is absorbed
    """

    pixel: Ints
    depth: Floats
    color: Floats
    alpha: Floats


def record(
    surfaces: Sequence[SurfaceHits],
    scene: Scene,
    view: View,
    ends: tuple[float, float],
    volumes: Sequence[Fragments] = (),
) -> Record:
    """The picture of surfaces and volumes over the background.

    The channels belong to the nearest of the most opaque surfaces.
    """
    shape = (view.height, view.width)
    nearest, opacity = Hits.none(view.count, ("shown",)), np.zeros(view.count)
    for surface in surfaces:
        more = surface.style.opacity > opacity
        better = surface.hits.seen & (more | ((surface.style.opacity == opacity) & nearest.nearer(surface.hits)))
        named = Hits(**{**vars(surface.hits), "values": {"shown": surface.hits.values[surface.quantity]}})
        nearest.put(better, named, better)
        opacity[better] = surface.style.opacity
    fragments = [_fragments_of(surface, *painted(surface, scene, view, ends)) for surface in surfaces]
    colors = blended([*fragments, *volumes], scene, view)
    return Record(
        colors.reshape(*shape, 3),
        nearest.depth.reshape(shape),
        nearest.values["shown"].reshape(shape),
        nearest.element.reshape(shape),
        nearest.position.reshape(*shape, 3),
        nearest.reference.reshape(*shape, 3),
        nearest.normal.reshape(*shape, 3),
        nearest.status.reshape(shape).astype(np.int64),
        nearest.uncertainty.reshape(shape),
    )


def painted(surface: SurfaceHits, scene: Scene, view: View, ends: tuple[float, float]) -> tuple[Floats, Floats]:
    """Colours (n, 3) and opacities (n,) of a surface's hits; values where nothing is hit have no meaning."""
    hits, style = surface.hits, surface.style
    low, high = style.range or ends
    bar = style.bar or (scene.bar if surface.quantity == scene.field else None)
    palette = Palette.of_name(style.palette or scene.palette, low, high).over_range(bar)
    flat = style.color is not None
    colors = (
        np.tile(style.color or (0.0,) * 3, (view.count, 1)) if flat else palette.colors(hits.values[surface.quantity])
    )
    if style.lic is not None and surface.tones is not None:
        colors = toned(colors, surface.tones, style.lic.contrast)
    if surface.lit:
        colors = colors * _light(hits, scene, view, scene.ambient_on(style))[:, None]

    # lines lie on the surface, mesh lines under contours
    opacity = np.full(view.count, style.opacity)
    for coverage, color in surface.lines:
        colors = colors + coverage[:, None] * (np.asarray(color) - colors)
        opacity = opacity + coverage * (1 - opacity)
    return colors, opacity


def _light(hits: Hits, scene: Scene, view: View, ambient: float) -> Floats:
    """(n,) factors of light on the visible side: the ambient part, plus Lambert's cosine for each light; at most 1."""
    rays = view.every_ray()[1]
    factor = np.full(view.count, ambient)
    for light in scene.lights:
        directions = -rays if light.direction is None else np.broadcast_to(np.asarray(light.direction), rays.shape)
        directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        factor += light.intensity * np.nan_to_num(np.maximum(np.einsum("ni,ni->n", directions, hits.normal), 0.0))
    return np.asarray(np.minimum(factor, 1.0))


def _fragments_of(surface: SurfaceHits, colors: Floats, opacity: Floats) -> Fragments:
    """A surface's hits as fragments."""
    here = np.flatnonzero(surface.hits.seen)
    return Fragments(here, surface.hits.depth[here], opacity[here, None] * colors[here], opacity[here])


def blended(fragments: Sequence[Fragments], scene: Scene, view: View) -> Floats:
    """(n, 3) colours of fragments over one another by depth, over the background."""
    result = np.tile(np.asarray(scene.backdrop, np.float64), (view.count, 1))
    if not fragments:
        return result
    pixel = np.concatenate([own.pixel for own in fragments])
    depth = np.concatenate([own.depth for own in fragments])
    color = np.concatenate([own.color for own in fragments])
    alpha = np.concatenate([own.alpha for own in fragments])
    order = np.lexsort([-depth, pixel])
    pixel, color, alpha = pixel[order], color[order], alpha[order]
    rank = np.arange(len(pixel)) - np.searchsorted(pixel, pixel)
    for number in range(int(rank.max(initial=-1)) + 1):
        here = rank == number
        result[pixel[here]] = color[here] + (1 - alpha[here, None]) * result[pixel[here]]
    return result


def is_lit(style: Style, surface: bool) -> bool:
    """Whether lights shade an object: as its style says, else faces and isosurfaces are."""
    return surface if style.lit is None else style.lit


def colored(transfer: Transfer, scene: Scene, ends: tuple[float, float] | None) -> Transfer:
    """The transfer function with colours: its own, or the colour map's at its values.

    ends  ends of the colour map, from surfaces or the scene; None takes the ends of the function
    """
    if transfer.colors:
        return transfer
    low, high = ends or (transfer.values[0], transfer.values[-1])
    colors = Palette.of_name(scene.palette, low, high).colors(np.asarray(transfer.values, np.float64))
    return replace(transfer, colors=tuple((float(r), float(g), float(b)) for r, g, b in colors))
