"""Arrows and cones: solids are drawn into the tiles of the picture that they reach into."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.renderer.ball_bounds import bounds_of_balls, is_in_picture, pixels_within
from elvis.renderer.camera import record_of
from elvis.renderer.device_volume import DeviceVolume
from elvis.renderer.hit_buffer import HitBuffer, arrays_to_write, new_arrays
from elvis.renderer.memory import Buffer
from elvis.renderer.passes.solids.solids import values_at_hits
from elvis.renderer.tiles import bin_sections
from elvis.scene.conditioning import misplaced
from elvis.scene.frusta import Frusta
from elvis.scene.view import View

#: what of the hit buffer the device holds
_HELD = ("owner", "status", "reference", "depth", "normal", "uncertainty", "doubt")
#: part of the greatest coordinate by which solids count as nearer than they are, so that rounding hides none
_NEARER = 1e-12


@dataclass(frozen=True, eq=False)
class _Prepared:
    """What a view sees of solids on the device, and how much each tile has to do."""

    view: View
    buffers: dict[str, Buffer]
    work: Ints


class GlyphDrawer:
    """Arrows and cones in a loaded volume; what the last view saw of each object is kept."""

    def __init__(self, loaded: DeviceVolume) -> None:
        self.loaded = loaded
        self._known: WeakKeyDictionary[Frusta, _Prepared] = WeakKeyDictionary()

    def draw(self, view: View, solids: Frusta, beyond: Floats | None = None, quantity: str | None = None) -> HitBuffer:
        """Where rays first enter or leave solids, behind the depths ``beyond`` (n,) where given.

        A hit's element, reference coordinates and value are those of the glyph's anchor.
        """
        device = self.loaded.device
        kernel = device.kernel("glyph_draw")
        own = self._known.get(solids)
        if own is None or own.view != view:
            # what was there is given back before more is taken
            self._known.pop(solids, None)
            self._known[solids] = own = self._prepared(view, solids)
        facts = {"misplaced": misplaced(view, self.loaded.extent)}
        facts |= {"count": len(own.work), "has_beyond": beyond is not None}
        after = np.zeros(1) if beyond is None else np.ascontiguousarray(beyond, np.float64)
        held = new_arrays(device, view.count, _HELD)
        record = device.buffer(record_of(kernel, "view", view, **facts))
        output = {**arrays_to_write(device, held), "after": device.buffer(after), "view": record}
        kernel(len(own.work), {**own.buffers, **output}, groups=True, work=own.work)
        hits = HitBuffer.on_device(device, held, field=np.empty(0))
        return hits.showing(values_at_hits(self.loaded, hits, quantity))

    def _prepared(self, view: View, solids: Frusta) -> _Prepared:
        """The kernel's records of what a view sees."""
        device = self.loaded.device
        kernel = device.kernel("glyph_draw")
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
        least, most = pixels_within(view, low[seen], high[seen])
        tiles, listed = bin_sections(least, most, kernel.dtype("tiles"), (view.width, view.height))
        work = (tiles["end"] - tiles["first"]).astype(np.int64)
        data = {"solids": records, "listed": listed, "tiles": tiles}
        return _Prepared(view, {name: device.buffer(array) for name, array in data.items()}, work)
