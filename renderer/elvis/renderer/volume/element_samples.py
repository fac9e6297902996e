"""Samples of a volume's elements at given reference points (sample_elements.slang)."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.plugins.runtime.volume_checks import Samples
from elvis.renderer.volume.device_volume import DeviceVolume


def sample_elements(
    loaded: DeviceVolume, number: int, elements: Ints, offsets: Floats, quantity: str | None = None
) -> Samples:
    """Samples in elements (n,) of part ``number`` at points given by their offsets (n, 3) from the type's centre."""
    device = loaded.device
    kernel = device.kernel("sample_elements", loaded.parts[number], quantity)
    points = np.zeros(len(elements), kernel.dtype("points"))
    points["element"] = elements
    points["offset"] = offsets

    layout = kernel.dtype("samples")
    samples = device.empty(layout, len(elements))
    kernel(len(elements), {**loaded.bindings(number, quantity), "points": device.buffer(points), "samples": samples})
    read = device.read(samples, layout)[: len(elements)]
    jacobian = np.stack([read[name] for name in ("dx", "dy", "dz")], axis=2)
    return Samples(read["position"], jacobian, read["value"], read["gradient"], read["margin"], read["center"])
