"""Line integral convolution on what surfaces show: streaks along the velocity at each pixel's hit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools
from elvis.renderer.device.memory import Buffer
from elvis.renderer.passes.solids.solids import held_at_hits
from elvis.renderer.raster.camera import record_of
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.raster.pixels import NOBODY
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene import Lic
from elvis.scene.cameras.view import View
from elvis.scene.flow.streaks import cells, middle, noise, scale_of, spread, weights

#: what of a hit buffer holds the tones
TONES = "tones"


class Convolver:
    """Convolves noise along velocities in a loaded volume; the noise of the last view is retained."""

    def __init__(self, loaded: DeviceVolume) -> None:
        self.loaded = loaded
        self._noise: tuple[object, Buffer] | None = None

    def tones(self, view: View, hits: HitBuffer, lic: Lic, velocity: Sequence[str | None], rest: float) -> Buffer:
        """Tones (n,) from -1 to 1 on the device, NaN where nothing moves; the hit buffer stores them.

        velocity  its components, quantities of the parts
        rest      speeds along the surface up to this one count as zero
        """
        if TONES not in hits.held:
            motion, links = self._project(view, hits, velocity, rest)
            hits.held = {**hits.held, TONES: self._convolve(view, lic, motion, links)}
        return hits.held[TONES]

    def still(self, hits: HitBuffer) -> Bools:
        """Hits (n,) without a tone, among the hits that were processed."""
        tones = self.loaded.device.read(hits.held[TONES], np.float64)[: len(hits.owner)]
        return np.asarray(np.isnan(tones) & (hits.owner != NOBODY))

    def _project(
        self, view: View, hits: HitBuffer, velocity: Sequence[str | None], rest: float
    ) -> tuple[Buffer, Buffer]:
        """How hits move in the picture, and which pixels show the same surface (lic_project.slang)."""
        device = self.loaded.device
        kernel = device.kernel("lic_project")
        along = [held_at_hits(self.loaded, hits, name) for name in velocity]
        facts = {"count": view.count, "rest": rest, "components": len(along), "flat": hits.flat is not None}
        motion, links = device.empty(np.float64, 2 * view.count), device.empty(np.uint32, view.count)
        given: dict[str, Buffer | NDArray[Any]] = {
            **hits.bindings(device, "owner", "depth", "normal"),
            **dict(zip(("velocity_x", "velocity_y", "velocity_z"), (*along, along[0]), strict=False)),
            "view": record_of(kernel, "view", view, **facts),
            "motion": motion,
            "links": links,
        }
        kernel(view.count, given)
        return motion, links

    def _convolve(self, view: View, lic: Lic, motion: Buffer, links: Buffer) -> Buffer:
        """The tones of noise along what moves (lic_convolve.slang)."""
        device = self.loaded.device
        kernel = device.kernel("lic_convolve")
        step, weighed = weights(lic.length)
        first, shape = cells(view.whole, lic.width)
        record = np.zeros(1, kernel.dtype("streaks"))
        record["origin"], record["first"], record["scale"] = middle(view), first, scale_of(lic.width)
        record["variance"], record["integral"] = spread(lic.width)
        record["step"], record["steps"] = step, len(weighed) - 1
        record["left"], record["top"], record["width"] = view.left, view.top, view.width
        record["cells"], record["count"] = shape[1], view.count
        tones = device.empty(np.float64, view.count)
        given: dict[str, Buffer | NDArray[Any]] = {
            "streaks": record,
            "motion": motion,
            "links": links,
            "noise": self._noise_of(tuple(first.tolist()), shape),
            "weights": device.buffer(weighed),
            TONES: tones,
        }
        kernel(view.count, given)
        return tones

    def _noise_of(self, first: tuple[int, int], shape: tuple[int, int]) -> Buffer:
        """The noise of some cells on the device."""
        if self._noise is None or self._noise[0] != (first, shape):
            self._noise = (first, shape), self.loaded.device.buffer(noise(first, shape))
        return self._noise[1]
