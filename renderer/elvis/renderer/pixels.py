"""The pixels of a plane cut while it is drawn: who owns them, and how claims to them are settled."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Floats
from elvis.renderer.frame import Status

NOBODY = 0xFFFFFFFF
#: verdicts, as in shaders/invert.slang
INSIDE, UNKNOWN = 1, 2
#: reference units within which a point counts as on an element's border, as in shaders/invert.slang
BORDER = 1e-10


@dataclass
class Pixels:
    """What the stages leave behind, by pixel.

    owner      running element numbers over all parts, NOBODY where nothing is seen
    reference  (n, 3), None where it was not asked for
    """

    field: Floats
    owner: NDArray[np.uint32]
    reference: Floats | None
    status: NDArray[np.uint8]


def settle(pixels: Pixels, claims: list[NDArray[Any]]) -> None:
    """Give disputed pixels to one element each: what is well inside comes first, then the lowest number.

    A pixel that only borders claim is ambiguous; one that nobody owns but a search could not decide has failed.
    """
    if not claims:
        return
    every = np.concatenate(claims)
    border = every["margin"] <= BORDER
    every = every[np.lexsort([every["element"], border, every["pixel"]])]

    inside = every[every["verdict"] == INSIDE]
    _, first = np.unique(inside["pixel"], return_index=True)
    chosen = inside[first]
    certain = chosen["margin"] > BORDER
    owner = pixels.owner[chosen["pixel"]]
    better = (owner == NOBODY) | (certain & (chosen["element"] < owner))
    chosen, certain = chosen[better], certain[better]
    pixels.owner[chosen["pixel"]] = chosen["element"]
    pixels.field[chosen["pixel"]] = chosen["field"]
    if pixels.reference is not None:
        pixels.reference[chosen["pixel"]] = chosen["reference"]
    pixels.status[chosen["pixel"]] = np.where(certain, Status.CERTAIN, Status.AMBIGUOUS)

    unknown = every["pixel"][every["verdict"] == UNKNOWN]
    pixels.status[unknown[pixels.owner[unknown] == NOBODY]] = Status.FAILED
