"""Arrows and cones: solids are drawn into the tiles of the picture that they reach into."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.renderer.device.memory import Buffer
from elvis.renderer.passes.pieces.tiled_hits import hits_in_tiles, listed_in_tiles
from elvis.renderer.raster.ball_bounds import bounds_of_balls, is_in_picture, pixels_within
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View
from elvis.scene.flow.frusta import Frusta

#: part of the largest coordinate by which solids count as nearer than they are, so that rounding hides none
_NEARER = 1e-12


@dataclass(frozen=True, eq=False)
class _Prepared:
    """Solids in a view on the device, and the work of each tile."""

    view: View
    buffers: dict[str, Buffer]
    work: Ints


class GlyphDrawer:
    """Arrows and cones in a loaded volume; what the last view saw of each object is retained."""

    def __init__(self, loaded: DeviceVolume) -> None:
        self.loaded = loaded
        self._known: WeakKeyDictionary[Frusta, _Prepared] = WeakKeyDictionary()

    def draw(self, view: View, solids: Frusta, beyond: Floats | None = None, quantity: str | None = None) -> HitBuffer:
        """First points where rays enter or leave solids, behind the depths ``beyond`` (n,) if given.

        A hit's element, reference coordinates and value belong to the glyph's anchor.
        """
        kernel = self.loaded.device.kernel("glyph_draw")
        own = self._known.get(solids)
        if own is None or own.view != view:
            # release previous buffers before allocating new ones
            self._known.pop(solids, None)
            self._known[solids] = own = self._prepared(view, solids)
        return hits_in_tiles(self.loaded, kernel, view, own.buffers, own.work, beyond, quantity)

    def _prepared(self, view: View, solids: Frusta) -> _Prepared:
        """The kernel's records of what a view sees."""
        kernel = self.loaded.device.kernel("glyph_draw")
        owner, known = self.loaded.owners_of(solids.element)
        centres = np.stack([solids.base, solids.base + solids.length[:, None] * solids.axis], axis=1)
        near, low, high, _ = bounds_of_balls(view, centres, solids.radii)
        seen = np.flatnonzero(known & is_in_picture(view, low, high))
        seen = seen[np.argsort(near[seen], kind="stable")]
        records = np.zeros(len(seen), kernel.dtype("solids"))
        for name in ("base", "axis", "reference", "length"):
            records[name] = getattr(solids, name)[seen]
        first, second = solids.radii[seen].T
        records["radius"], records["slope"] = first, (second - first) / solids.length[seen]
        greatest = max(self.loaded.extent, float(np.abs(view.camera.eye).max()))
        records["near"] = near[seen] - _NEARER * greatest
        records["owner"] = owner[seen]
        ends = pixels_within(view, low[seen], high[seen])
        return _Prepared(view, *listed_in_tiles(self.loaded, kernel, "solids", records, ends, view))
