"""Light along rays through the volume: emission and absorption of elements, segment by segment.

Densities and colours are piecewise linear in their quantities.  Places where a quantity has the value of a kink of one
of these are found like an isosurface, by all zeros of its difference from the value along the ray (`zeros`); the
segments are split there.  Everything is smooth between these places, and integrated by Gauss's rule (`ray_integrals`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.patch import Patch
from elvis.reference.clipping import is_clipped
from elvis.reference.composing import Fragments
from elvis.reference.quantities import Quantities
from elvis.reference.scenes.bounding import degree_along
from elvis.reference.scenes.cuts import surface_hits
from elvis.reference.scenes.newton import inverses
from elvis.reference.scenes.ray_integrals import Light, RayIntegral
from elvis.reference.scenes.segment_curves import straighten
from elvis.reference.scenes.segments import Segments, lengths, places
from elvis.reference.scenes.zeros import zeros
from elvis.reference.solids import map_points
from elvis.scene import Clip, Implicit, Transfer
from elvis.scene.cameras.view import View

#: segments that are summed together
_AT_ONCE = 1 << 13
#: units in the last place that coordinates may be wrong by; part of their sizes that functions along rays are known to
_UNITS, _DIGITS = 8, 1e-14
#: relative tolerance for values at a kink
_ROUNDING = 4e-15
#: name of a quantity, and its transfer function with colours
Medium: TypeAlias = tuple[str, Transfer]


@dataclass(frozen=True, eq=False)
class VolumeRays:
    """Rays through the elements of a patch, with the quantities along them.

    size    of the scene, in world units
    extent  the largest coordinate of the elements and of the eye, in magnitude
    """

    patch: Patch
    quantities: Quantities
    view: View
    size: float
    extent: float

    def fragments(self, segments: Segments, clips: Sequence[Clip], media: Sequence[Medium]) -> tuple[Fragments, Floats]:
        """Fragments of blended volumes in segments outside clips, and their maximum errors (k,)."""
        parts = self._visible(straighten(segments, self.patch, self.view), clips)
        for name, transfer in media:
            parts = self._split_at_levels(parts, name, transfer.values)
        light = self._light(parts, media)
        middle = 0.5 * (parts.near + parts.far)
        return Fragments(parts.pixel, middle, light.color, light.alpha), light.error

    def _visible(self, segments: Segments, clips: Sequence[Clip]) -> Segments:
        """Visible parts of segments: they are split at the surfaces of clips, and the centre of each part decides."""
        for clip in clips:
            own = clip.surface
            if isinstance(own, Implicit):
                segments = self._split_at_levels(segments, own.expression, (0.0,))
            else:
                segments = segments.between(depths_by_pixel(*surface_hits(own, self.view)[:2], self.view.count))
        reference, points = self._middles(segments)

        def values(name: str) -> Floats:
            return self.quantities.values(name, self.patch, segments.row, reference)

        return segments.part(~is_clipped(clips, points, values, self.size))

    def _middles(self, segments: Segments) -> tuple[Floats, Floats]:
        """Reference coordinates and world points (k, 3) in the middles of segments."""
        return places(segments, self.patch, self.view, np.full((len(segments), 1), 0.5))

    def _values(self, name: str, segments: Segments, shares: Floats) -> Floats:
        """(k, m) a quantity at shares (k, m) of segments."""
        reference, _ = places(segments, self.patch, self.view, shares)
        rows = np.repeat(segments.row, shares.shape[1])
        return np.asarray(self.quantities.values(name, self.patch, rows, reference).reshape(shares.shape))

    def _split_at_levels(self, segments: Segments, name: str, levels: Sequence[float]) -> Segments:
        """Segments parted wherever a quantity has one of some values."""
        degree, rounding = degree_along(self.patch, self.quantities, name), _UNITS * np.spacing(self.extent)
        accuracy = np.maximum(_DIGITS, rounding / np.maximum(lengths(segments, self.view), rounding))
        noise = self.quantities.rounding(name, self.patch, segments.row)
        owners, shares = [np.repeat(np.arange(len(segments)), 2)], [np.tile([0.0, 1.0], len(segments))]
        for level in levels:

            def along(which: Ints, at: Floats, level: float = level) -> Floats:
                return self._values(name, segments.part(which), at) - level

            found = zeros(along, degree, accuracy, noise + _ROUNDING * abs(level))
            owners.append(found.which)
            shares.append(found.place)

        # the ends of all parts: the segments' ends and the places between
        owner, at = np.concatenate(owners), np.concatenate(shares)
        order = np.lexsort([at, owner])
        owner, at = owner[order], at[order]
        first = np.flatnonzero((owner[1:] == owner[:-1]) & (at[1:] > at[:-1]))
        return segments.cut(owner[first], at[first], at[first + 1])

    def _light(self, segments: Segments, media: Sequence[Medium]) -> Light:
        """The light of segments without kinks."""
        found = [Light(np.empty((0, 3)), np.empty(0), np.empty(0))]
        degree = max(degree_along(self.patch, self.quantities, name) for name, _ in media)
        for rows in np.array_split(np.arange(len(segments)), -(-len(segments) // _AT_ONCE) or 1):
            some = segments.part(rows)

            def values(which: Ints, shares: Floats, some: Segments = some) -> list[Floats]:
                return [self._values(name, some.part(which), shares) for name, _ in media]

            rounding = np.column_stack([self._rounding(name, some) for name, _ in media])
            transfers = [transfer for _, transfer in media]
            found.append(RayIntegral(values, transfers, lengths(some, self.view), rounding, degree).light())
        return Light.joined(found)

    def _rounding(self, name: str, segments: Segments) -> Floats:
        """(k,) maximum error of a quantity in segments: its rounding, plus rounding of positions times its gradient."""
        reference, _ = self._middles(segments)
        _, jacobians = map_points(self.patch, segments.row, reference)
        _, gradients = self.quantities.values_and_gradients(name, self.patch, segments.row, reference)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            steepness = np.linalg.norm(np.einsum("nij,ni->nj", inverses(jacobians), gradients), axis=1)
        evaluated = self.quantities.rounding(name, self.patch, segments.row)
        return np.asarray(evaluated + _UNITS * np.spacing(self.extent) * np.nan_to_num(steepness))


def depths_by_pixel(pixel: Ints, depth: Floats, count: int) -> Floats:
    """(k, count) depths by pixel, infinite if a pixel has fewer than others."""
    order = np.argsort(pixel, kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(pixel)) - np.searchsorted(pixel[order], pixel[order])
    depths = np.full((int(rank.max(initial=-1)) + 1, count), np.inf)
    depths[rank, pixel] = depth
    return depths
