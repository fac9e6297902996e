"""The pixels of a plane cut while it is drawn: who owns them, and how candidates for them are resolved."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Records
from elvis.scene.record.frame import Status

NOBODY = 0xFFFFFFFF
#: statuses, as in invert.slang
INSIDE, UNKNOWN = 1, 2
#: reference units within which a point counts as on an element's border, as in invert.slang
BORDER = 1e-10


@dataclass
class Pixels:
    """Owners of pixels.

    owner      (n,) indices of elements in the volume, NOBODY for empty pixels
    status     (n,) see frame.Status
    committed  candidates that won since they were drawn; the last one for a pixel counts
    """

    owner: NDArray[np.uint32]
    status: NDArray[np.uint8]
    committed: list[Records] = field(default_factory=list)


def resolve(pixels: Pixels, candidates: list[Records]) -> None:
    """Assign disputed pixels to one element each: interior candidates first, then the lowest number.

    A pixel with candidates only on borders is ambiguous; one without an owner that no search could decide has failed.
    """
    if not candidates:
        return
    every = np.concatenate(candidates)
    border = every["margin"] <= BORDER
    every = every[np.lexsort([every["element"], border, every["pixel"]])]

    inside = every[every["status"] == INSIDE]
    _, first = np.unique(inside["pixel"], return_index=True)
    chosen = inside[first]
    certain = chosen["margin"] > BORDER
    owner = pixels.owner[chosen["pixel"]]
    better = (owner == NOBODY) | (certain & (chosen["element"] < owner))
    chosen, certain = chosen[better], certain[better]
    pixels.owner[chosen["pixel"]] = chosen["element"]
    pixels.committed.append(chosen)
    pixels.status[chosen["pixel"]] = np.where(certain, Status.CERTAIN, Status.AMBIGUOUS)

    unknown = every["pixel"][every["status"] == UNKNOWN]
    pixels.status[unknown[pixels.owner[unknown] == NOBODY]] = Status.FAILED
