"""Cuts by spheres, cylinders, cones and triangles: rays meet the surface, then points are looked up in the volume."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.renderer.device.memory import Buffer
from elvis.renderer.passes.solids.hits import Hits, hits
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.renderer.volume.probing import Finder, Places
from elvis.scene.cameras.view import View
from elvis.scene.model.surfaces import Solid
from elvis.scene.record.conditioning import MOST, doubt, uncertainties
from elvis.scene.record.frame import Status

#: part of the largest coordinate by which places may be outside of the box of the volume and yet matter
CLOSE = 1e-9


class SolidDrawer:
    """A loaded volume, ready to be cut by any surface that rays meet without its data."""

    def __init__(self, loaded: DeviceVolume, finder: Finder) -> None:
        self.loaded, self.finder = loaded, finder
        self._key: tuple[View, Hashable] | None = None
        self._met, self._places, self._asked = Hits.none(), Places.none(0), np.zeros(0, bool)

    def draw(self, view: View, surface: Solid, beyond: Floats | None = None, quantity: str | None = None) -> HitBuffer:
        """The nearest point of the surface that some element holds, behind the depths ``beyond`` (n,) where given."""
        found = self.looked_up(view, surface, partial(hits, surface), beyond)
        return found if quantity is None else found.showing(values_at_hits(self.loaded, found, quantity))

    def looked_up(
        self, view: View, surface: Hashable, meet: Callable[[View], Hits], beyond: Floats | None = None
    ) -> HitBuffer:
        """The hit buffer of any object with a function for its intersections; queried once per view and surface."""
        if self._key is None or self._key[0] is not view or self._key[1] != surface:
            self._key, self._met = (view, surface), self._near(meet(view), view)
            self._places, self._asked = Places.none(len(self._met.pixel)), np.zeros(len(self._met.pixel), bool)
        met, places = self._met, self._places
        behind = met.depth > (0.0 if beyond is None else beyond[met.pixel])

        # of each pixel the first hit that isn't known to lie outside is looked up, until all of these lie inside
        while True:
            chosen = np.flatnonzero(behind & ~(self._asked & (places.owner == NOBODY)))
            chosen = chosen[np.unique(met.pixel[chosen], return_index=True)[1]]
            new = chosen[~self._asked[chosen]]
            if not len(new):
                break
            places.put(new, self.finder.find(_points(view, met.pixel[new], met.depth[new])))
            self._asked[new] = True
        found = _hits_of(view, met, places, chosen)
        _weigh(found, view, met, chosen, self.loaded.extent)
        if met.doubt is not None:
            found.doubt = met.doubt if beyond is None else np.where(met.doubt > beyond, met.doubt, np.inf)
            doubtful = np.isfinite(found.doubt) & (found.doubt <= found.depth) & (found.status != Status.FAILED)
            found.status[doubtful] = Status.AMBIGUOUS
        failed = met.pixel[behind & (places.status == Status.FAILED)]
        found.status[failed[found.owner[failed] == NOBODY]] = Status.FAILED
        return found

    def _near(self, met: Hits, view: View) -> Hits:
        """The hits within the box of the volume, and doubts that begin near it."""
        low, high = self.loaded.box
        near = _between(view, met.pixel, met.depth, low, high)
        doubt, uncertainty = met.doubt, met.uncertainty
        if doubt is not None:
            pixel, room = np.flatnonzero(np.isfinite(doubt)), CLOSE * self.loaded.extent
            outside = ~_between(view, pixel, doubt[pixel], low - room, high + room)
            doubt = doubt.copy()
            doubt[pixel[outside]] = np.inf
        uncertainty = None if uncertainty is None else uncertainty[near]
        return Hits(met.pixel[near], met.depth[near], met.normal[near], uncertainty, doubt)


def _between(view: View, pixel: Ints, depth: Floats, low: Floats, high: Floats) -> Bools:
    """(n,) whether places on rays lie in a box."""
    points = _points(view, pixel, depth)
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def _points(view: View, pixel: Ints, depth: Floats) -> Floats:
    origins, directions = view.rays_of(pixel)
    return np.asarray(origins + depth[:, None] * directions)


def _weigh(found: HitBuffer, view: View, met: Hits, chosen: Ints, extent: float) -> None:
    """Set the uncertainty of the chosen hits; hits with too uncertain depths are no longer certain."""
    pixel, depth = met.pixel[chosen], met.depth[chosen]
    if met.uncertainty is None:
        uncertainty = uncertainties(view, pixel, depth, met.normal[chosen], extent)
    else:
        uncertainty = met.uncertainty[chosen]
    found.uncertainty = np.full(view.count, np.nan)
    found.uncertainty[pixel] = np.where(found.owner[pixel] == NOBODY, np.nan, uncertainty)
    found.status[pixel] = doubt(found.status[pixel], ~(uncertainty <= MOST * np.maximum(depth, extent)))


def _hits_of(view: View, met: Hits, places: Places, chosen: Ints) -> HitBuffer:
    """The hit buffer of some hits, one a pixel at most."""
    found, pixel = HitBuffer.empty(view.count), met.pixel[chosen]
    directions = view.rays_of(pixel)[1]
    away = np.einsum("ni,ni->n", directions, met.normal[chosen]) > 0.0
    found.owner[pixel], found.field[pixel] = places.owner[chosen], places.field[chosen]
    found.reference[pixel], found.depth[pixel] = places.reference[chosen], met.depth[chosen]
    found.normal[pixel] = np.where(away, -1.0, 1.0)[:, None] * met.normal[chosen]
    found.status[pixel] = places.status[chosen]
    return found


def values_at_hits(loaded: DeviceVolume, found: HitBuffer, quantity: str | None) -> Floats:
    """(n,) a quantity (None: the parts' own field) at the hits of a hit buffer, NaN elsewhere."""
    count, is_missing = len(found.owner), found.owner == NOBODY
    values = np.full(count, np.nan)
    if not is_missing.all():
        held = held_at_hits(loaded, found, quantity)
        np.copyto(values, loaded.device.read(held, np.float64)[:count], where=~is_missing)
    return values


def held_at_hits(loaded: DeviceVolume, found: HitBuffer, quantity: str | None) -> Buffer:
    """(n,) the same on the device, where all else means nothing (sample.slang)."""
    device, count = loaded.device, len(found.owner)
    places = {name: found.on(device, name) for name in ("owner", "reference")}
    held = device.empty(np.float64, count)
    for number, part in enumerate(loaded.parts):
        kernel = device.kernel("sample", part, quantity)
        span = np.zeros(1, kernel.dtype("span"))
        span["first"], span["end"] = loaded.first[number : number + 2]
        buffers = {**loaded.bindings(number, quantity), **places, "span": device.buffer(span), "values": held}
        kernel(count, buffers)
    return held
