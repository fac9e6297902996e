"""Isosurfaces of distances: rays meet them, then elements are looked up (stage: iso_distance)."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.renderer.passes.solids.hits import Hits
from elvis.renderer.passes.solids.solids import SolidDrawer
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.renderer.volume.traversal import Traversal
from elvis.scene.cameras.view import View

if TYPE_CHECKING:
    from elvis.renderer.device.device import Kernel
    from elvis.renderer.device.memory import Buffer


class DistanceDrawer:
    """A loaded volume, ready for the places at any distance from the surfaces that its quantities measure from."""

    def __init__(self, loaded: DeviceVolume, solids: SolidDrawer) -> None:
        self.loaded, self.solids, self.traversal = loaded, solids, Traversal(loaded)

    def knows(self, quantity: str | None) -> bool:
        """Whether a quantity is a distance, and nothing else."""
        return bool(self.loaded.parts) and self.loaded.quantity(0, quantity).is_distance

    def draw(self, view: View, quantity: str | None, value: float, beyond: Floats | None = None) -> HitBuffer:
        """The nearest point of the isosurface that some element holds, as IsosurfaceDrawer.draw.

        Status: ambiguous where the distance was not found on both sides of the value within 1.6e-10 of the largest
        coordinate, and behind places where rays may have touched the surface.  Within that, depths are uncertain.
        """
        key = (quantity, value)
        hits = self.solids.looked_up(view, key, partial(self._places_in_box, key=key), beyond)
        return hits.showing(np.where(hits.owner != NOBODY, value, np.nan))

    def _places_in_box(self, view: View, key: tuple[str | None, float]) -> Hits:
        """All places on rays through the box of the volume."""
        device = self.loaded.device
        kernel = device.kernel("iso_distance")
        low, high = self.loaded.box
        rays = self.traversal.rays(kernel, view, 0, view.count, key[1])
        buffers = {**self.loaded.bindings(0, key[0]), "rays": rays, "box": device.buffer(np.concatenate([low, high]))}
        found = device.appended("met", kernel, partial(_run, kernel, view.count, buffers))
        doubts = np.full(view.count, np.inf)
        doubtful = found[found["doubtful"] != 0]
        np.minimum.at(doubts, doubtful["pixel"], doubtful["depth"])
        found = found[found["unseen"] == 0]
        found = found[np.lexsort([found["depth"], found["pixel"]])]
        uncertainty = np.where(found["doubtful"] != 0, np.inf, found["uncertainty"])
        pixel = found["pixel"].astype(np.int64)
        return Hits(pixel, found["depth"].copy(), found["normal"].copy(), uncertainty, doubts)


def _run(kernel: Kernel, count: int, buffers: dict[str, Buffer], lists: dict[str, Buffer]) -> None:
    kernel(count, {**buffers, **lists})
