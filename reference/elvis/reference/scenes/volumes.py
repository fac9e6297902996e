"""Light along rays through the volume: what elements send out and take up, by fine quadrature in every element.

Along a ray the colour is the integral of T s c, T = exp(-integral of s), with density s and colour c piecewise
linear in the quantity; of several volumes s c and s are sums.  Each segment in an element is parted where these have
kinks, then evenly; within a part s is integrated by Gauss's rule and c is its mean weighted by s (Max, Optical Models
for Direct Volume Rendering, 1995, section 4).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeAlias

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.patch import Patch
from elvis.core.polynomials.quadrature import gauss
from elvis.reference.clipping import is_clipped
from elvis.reference.quantities import Quantities
from elvis.reference.scenes.cuts import surface_hits
from elvis.reference.scenes.segments import Segments, places
from elvis.scene import Clip, Implicit, Transfer
from elvis.scene.view import View

#: parts of a segment as long as the scene; how many parts a segment in an element may have; Gauss points in each
ALONG, PARTS, POINTS = 256, (4, 8, 16, 32, 64, 128), 2
#: segments that are summed together
_AT_ONCE = 1 << 13
#: places along a segment between which an expression of a clip, or a quantity less a kink's value, changes sign once
_SIGNS = 33
#: name of a quantity, and its transfer function with colours
Medium: TypeAlias = tuple[str, Transfer]


def visible(
    segments: Segments, patch: Patch, quantities: Quantities, clips: Sequence[Clip], view: View, size: float
) -> Segments:
    """What clips leave: segments are parted where rays meet the surfaces, and the middle of each part decides."""
    for clip in clips:
        own = clip.surface
        if isinstance(own, Implicit):
            segments = _split_at_levels(
                segments, partial(_values, patch=patch, quantities=quantities, name=own.expression, view=view)
            )
        else:
            segments = segments.between(depths_by_pixel(*surface_hits(own, view)[:2], view.count))
    middle = np.full(len(segments.pixel), 0.5)
    reference, points = places(segments, patch, view, middle[:, None])
    gone = is_clipped(clips, points, lambda name: quantities.values(name, patch, segments.row, reference), size)
    return segments.part(~gone)


def depths_by_pixel(pixel: Ints, depth: Floats, count: int) -> Floats:
    """(k, count) depths by pixel, infinite where a pixel has fewer than others."""
    order = np.argsort(pixel, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(pixel)) - np.searchsorted(pixel[order], pixel[order])
    depths = np.full((int(rank.max(initial=-1)) + 1, count), np.inf)
    depths[rank, pixel] = depth
    return depths


def between_kinks(
    segments: Segments, patch: Patch, quantities: Quantities, media: Sequence[Medium], view: View
) -> Segments:
    """Segments parted at the kinks of densities and colours, so that no thin layer falls between places."""
    for name, transfer in media:
        along = partial(_values, patch=patch, quantities=quantities, name=name, view=view)
        segments = _split_at_levels(segments, along, transfer.values)
    return segments


def _split_at_levels(
    segments: Segments, along: Callable[[Segments, Floats], Floats], levels: Sequence[float] = (0.0,)
) -> Segments:
    """Segments parted where a function along them, of segments and shares (k, m), passes one of some levels."""
    segment, share, value = _sample(segments, along)
    same = segment[1:] == segment[:-1]
    owners, shares = [np.repeat(np.arange(len(segments)), 2)], [np.tile([0.0, 1.0], len(segments))]
    for level in levels:
        sides = np.sign(value - level)
        place = np.flatnonzero(same & (sides[1:] * sides[:-1] < 0.0))
        some, low, high = segments.part(segment[place]), share[place], share[place + 1]
        for _ in range(52):
            middle = 0.5 * (low + high)
            before = np.sign(along(some, middle[:, None])[:, 0] - level) == sides[place]
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        owners.append(segment[place])
        shares.append(low)

    # the ends of all parts: those of the segments and the places between
    owner, at = np.concatenate(owners), np.concatenate(shares)
    order = np.lexsort([at, owner])
    owner, at = owner[order], at[order]
    first = np.flatnonzero(owner[1:] == owner[:-1])
    return segments.cut(owner[first], at[first], at[first + 1])


def _sample(segments: Segments, along: Callable[[Segments, Floats], Floats]) -> tuple[Ints, Floats, Floats]:
    """Places along segments, in order: numbers of the segments, shares and values, all (m,).

    Even places and the vertices of the parabolas through three of them that turn: what is touched in between.
    """
    even = np.linspace(0.0, 1.0, _SIGNS)
    values = along(segments, np.tile(even, (len(segments), 1)))
    differences = np.diff(values, axis=1)
    segment, place = np.nonzero(differences[:, 1:] * differences[:, :-1] < 0.0)
    before, after = differences[segment, place], differences[segment, place + 1]
    turn = even[place + 1] + 0.5 * (before + after) / (before - after) / (_SIGNS - 1)
    peaks = along(segments.part(segment), turn[:, None])[:, 0]

    owner = np.concatenate([np.repeat(np.arange(len(segments)), _SIGNS), segment])
    share, value = np.concatenate([np.tile(even, len(segments)), turn]), np.concatenate([values.ravel(), peaks])
    order = np.lexsort([share, owner])
    return owner[order], share[order], value[order]


def ray_integrals(
    segments: Segments, patch: Patch, quantities: Quantities, media: Sequence[Medium], view: View, size: float
) -> tuple[Floats, Floats]:
    """Colours (k, 3) times alpha, and alphas (k,), of each segment; ``size`` of the scene in world units."""
    colors, alphas = np.zeros((len(segments.pixel), 3)), np.zeros(len(segments.pixel))
    needed = np.ceil(ALONG * lengths(segments, view) / size)
    parts = np.array(PARTS)[np.searchsorted(PARTS, needed).clip(0, len(PARTS) - 1)]
    for count in PARTS:
        here = np.flatnonzero(parts == count)
        for chunk in np.array_split(here, -(-len(here) // _AT_ONCE)) if len(here) else ():
            some = segments.part(chunk)
            shares = np.tile(points_along(count), (len(chunk), 1))
            values = [_values(some, shares, patch, quantities, name, view) for name, _ in media]
            transfers = [transfer for _, transfer in media]
            colors[chunk], alphas[chunk] = integrated(values, lengths(some, view), transfers)
    return colors, alphas


def points_along(parts: int) -> Floats:
    """(parts * POINTS,) Gauss points of equal parts of the unit interval."""
    return np.asarray(((np.arange(parts)[:, None] + (1 + gauss(POINTS)[0]) / 2) / parts).ravel())


def _values(segments: Segments, shares: Floats, patch: Patch, quantities: Quantities, name: str, view: View) -> Floats:
    """(k, m) a quantity at shares (k, m) of segments."""
    reference, _ = places(segments, patch, view, shares)
    rows = np.repeat(segments.row, shares.shape[1])
    return np.asarray(quantities.values(name, patch, rows, reference).reshape(shares.shape))


def lengths(segments: Segments, view: View) -> Floats:
    """(k,) lengths of segments in world units."""
    row, column = np.divmod(segments.pixel, view.width)
    directions = view.rays(column.astype(np.float64), row.astype(np.float64))[1]
    return np.asarray(np.linalg.norm(directions, axis=1) * (segments.far - segments.near))


def integrated(values: Sequence[Floats], length: Floats, transfers: Sequence[Transfer]) -> tuple[Floats, Floats]:
    """Colours (k, 3) times alpha, and alphas (k,), of segments of some length (k,).

    values  for each volume (k, parts * POINTS) of its quantity at Gauss points of equal parts; beyond the ends of the
            transfer function it stays as it is there, and what is no number sends out and takes up nothing
    """
    density = np.zeros((len(length), values[0].shape[1]))
    light = np.zeros((*density.shape, 3))
    for own, transfer in zip(values, transfers, strict=True):
        known = np.isfinite(own)
        part = np.where(known, np.interp(own, transfer.values, transfer.densities), 0.0)
        tables = np.asarray(transfer.colors, np.float64)
        hue = np.stack([np.interp(own, transfer.values, tables[:, axis]) for axis in range(3)], axis=-1)
        density += part
        light += part[..., None] * np.where(known[..., None], hue, 0.0)
    color = light / np.where(density > 0, density, 1.0)[..., None]

    # optical depths of the parts, mean colours in them, what of them reaches the beginning
    parts, weights = density.shape[1] // POINTS, gauss(POINTS)[1]
    taken = (0.5 * length[:, None, None] / parts * weights) * density.reshape(-1, parts, POINTS)
    depths = taken.sum(axis=2)
    mean = np.einsum("kpg,kpgc->kpc", taken, color.reshape(-1, parts, POINTS, 3))
    mean /= np.where(depths > 0, depths, 1.0)[..., None]
    before = np.cumsum(depths, axis=1) - depths
    sent = np.exp(-before) * -np.expm1(-depths)
    return np.einsum("kp,kpc->kc", sent, mean), -np.expm1(-depths.sum(axis=1))
