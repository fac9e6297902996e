"""What the elements of a volume answer at given reference points (examine.slang)."""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.plugins.volume_checks import Samples
from elvis.renderer.loaded import Loaded


def examine(loaded: Loaded, number: int, elements: Ints, offsets: Floats, quantity: str | None = None) -> Samples:
    """Samples in elements (n,) of part ``number`` at points given by their offsets (n, 3) from the type's centre."""
    device, part = loaded.device, loaded.parts[number]
    kernel = device.kernel("examine", part, quantity)
    questions = np.zeros(len(elements), kernel.dtype("questions"))
    questions["element"], questions["offset"] = elements, offsets
    answers = device.empty(kernel.dtype("answers"), len(elements))
    kernel(len(elements), {**loaded.bound(number, quantity), "questions": device.buffer(questions), "answers": answers})
    found = device.read(answers, kernel.dtype("answers"))[: len(elements)]
    jacobian = np.stack([found[name] for name in ("dx", "dy", "dz")], axis=2)
    return Samples(found["position"], jacobian, found["value"], found["slope"], found["margin"], found["center"])
