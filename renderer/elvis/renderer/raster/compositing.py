"""Lists of coloured fragments on a device: compositing from front to back (fragments.slang, compose.slang)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats
from elvis.renderer.device.device import Device
from elvis.renderer.device.memory import Buffer
from elvis.scene import Vector

#: share of transmitted light below which hidden fragments are ignored
FAINT = 1e-3


class FragmentLists:
    """Contributions of hit buffers to n pixels, in any order, and the resulting picture over a background.

    After composition the buffers contain the picture, the contributions that volumes add (see RayIntegrals), and the
    depths beyond which nothing counts.

    whole  whether colours are wanted in steps of 1/255, as 8-bit integers
    """

    def __init__(self, device: Device, pixels: int, count: int, background: Vector, *, whole: bool = False) -> None:
        self.device, self.pixels, self.count, self.background, self.whole = device, pixels, count, background, whole
        self.buffers: dict[str, Buffer] = {}
        for name, size in (("fragment_depths", 1), ("fragment_colors", 4)):
            self.buffers[name] = device.empty(np.float64, size * pixels * count)

    @staticmethod
    def of(
        device: Device, pixels: int, fragments: Sequence[tuple[Floats, Floats, Floats]], background: Vector
    ) -> FragmentLists:
        """Fragments with depths (n,), infinite where there are none, colours (n, 3) times alpha, and alphas (n,)."""
        made = FragmentLists(device, pixels, len(fragments), background)
        if fragments:
            made.buffers["fragment_depths"] = device.buffer(np.concatenate([depth for depth, _, _ in fragments]))
            colors = [np.column_stack([color, alpha]) for _, color, alpha in fragments]
            made.buffers["fragment_colors"] = device.buffer(np.concatenate(colors))
        return made

    def compose(self) -> FragmentLists:
        """Make the picture, as far as there are no volumes in it."""
        kernel, device = self.device.kernel("compose"), self.device
        composition = np.zeros(1, kernel.dtype("composition"))
        composition["background"] = self.background
        composition["count"] = self.count
        composition["pixels"] = self.pixels
        composition["whole"] = self.whole
        made = {"picture": (np.float64, 0 if self.whole else 3), "packed": (np.uint32, int(self.whole))}
        made |= {"end": (np.float64, 1), "tally": (np.uint32, 2)}
        self.buffers |= {name: device.empty(dtype, size * self.pixels) for name, (dtype, size) in made.items()}
        self.buffers |= {"composition": device.buffer(composition), "faint": device.buffer(np.array([FAINT]))}
        kernel(self.pixels, self.buffers)
        return self

    def colors(self) -> Floats | NDArray[np.uint8]:
        """(n, 3) the picture's colours."""
        if self.whole:
            packed: NDArray[Any] = self.device.read(self.buffers["packed"], np.uint32)[: self.pixels]
            return packed.view(np.uint8).reshape(-1, 4)[:, :3]
        return self.device.read(self.buffers["picture"], np.float64)[: 3 * self.pixels].reshape(-1, 3)
