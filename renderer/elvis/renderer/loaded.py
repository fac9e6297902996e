"""A volume on a device, which all stages share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from elvis.plugins.volume import Part, Volume
from elvis.renderer.device import Device

if TYPE_CHECKING:
    import slangpy


class Loaded:
    """A volume's parts and their buffers.

    first  (parts + 1,) running number of each part's first element: elements count through all parts
    ids    (elements + 1,) global ids by running number; NOBODY, which is beyond the end, takes the last one, -1
    reach  greatest finite coordinate of the elements' boxes, in magnitude
    bytes  of all buffers so far: those of quantities come when they are first asked for
    """

    def __init__(self, device: Device, volume: Volume) -> None:
        device.include(volume.shader_folder)
        self.device, self.parts, self.dimension = device, volume.parts, volume.dimension
        self.buffers = [{name: device.buffer(data) for name, data in part.buffers.items()} for part in self.parts]
        self.first = np.cumsum([0, *map(len, self.parts)])
        self.ids = np.concatenate([*(part.element_ids for part in self.parts), [-1]])
        self.reach = max(map(_reach, self.parts), default=0.0)
        self.bytes = sum(data.nbytes for part in self.parts for data in part.buffers.values())
        self._brought: dict[int, slangpy.Buffer] = {}

    def bound(self, number: int, quantity: str | None = None) -> dict[str, slangpy.Buffer]:
        """The buffers of a part, or of one of its quantities, by name; data that quantities share are there once."""
        if quantity is None:
            return self.buffers[number]
        own = self.parts[number].quantities[quantity].buffers
        for data in own.values():
            if id(data) not in self._brought:
                self._brought[id(data)] = self.device.buffer(data)
                self.bytes += data.nbytes
        return {**self.buffers[number], **{name: self._brought[id(data)] for name, data in own.items()}}


def _reach(part: Part) -> float:
    """The greatest finite coordinate of the part's boxes, in magnitude."""
    return float(np.abs(part.boxes).max(initial=0.0, where=np.isfinite(part.boxes)))
