"""What the elements of a volume answer at given reference points (shaders/examine.slang)."""

from __future__ import annotations

import numpy as np

from elvis.formats.arrays import Floats, Ints
from elvis.plugins.volume import Volume
from elvis.plugins.volume_checks import Samples, check_samples, notes, probes
from elvis.renderer.device import Device


def examine(
    device: Device, volume: Volume, number: int, elements: Ints, offsets: Floats, quantity: str | None = None
) -> Samples:
    """Samples in elements (n,) of part ``number`` at points given by their offsets (n, 3) from the type's centre."""
    device.include(volume.shader_folder)
    part = volume.parts[number]
    kernel = device.kernel("examine", part, quantity)
    questions = np.zeros(len(elements), kernel.dtype("questions"))
    questions["element"], questions["offset"] = elements, offsets
    other = {} if quantity is None else part.quantities[quantity].buffers
    buffers = {name: device.buffer(array) for name, array in {**part.buffers, **other}.items()}
    buffers["questions"] = device.buffer(questions)
    buffers["answers"] = device.empty(kernel.dtype("answers"), len(elements))
    kernel(len(elements), buffers)
    found = device.read(buffers["answers"], kernel.dtype("answers"))[: len(elements)]
    jacobian = np.stack([found[name] for name in ("dx", "dy", "dz")], axis=2)
    return Samples(found["position"], jacobian, found["value"], found["slope"], found["margin"], found["center"])


def check_on_device(device: Device, name: str, volume: Volume) -> list[str]:
    """Remarks on a volume; PluginError with the plugin's name where its maps are broken or leave their boxes."""
    remarks = []
    for number, part in enumerate(volume.parts):
        elements, offsets = probes(part, volume.dimension)
        samples = examine(device, volume, number, elements, offsets)
        check_samples(name, part, elements, samples)
        remarks += notes(name, part, elements, samples)
    return remarks
