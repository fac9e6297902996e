"""The integrals of rays through volumes, as volume_march.slang leaves them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Ints
from elvis.scene.record.frame import Status


class RayIntegrals:
    """The integrals of n rays through volumes and the surfaces between.

    color      (n, 3) times alpha
    alpha      (n,)   share in [0, 1] of the background that is hidden
    coverage   (n,)   the same for the volumes only
    length     (n,)   of the segments in elements, as far as light comes from them, in units of length
    error      (n,)   of the colour: estimate of the quadrature, and effect of errors of quantities
    segments   (n,)   their number; without any, all other values are zero
    undefined  (n,)   segments skipped because their field is not a number
    lost       (n,)   positions in curved elements, and ends of segments, that were not found
    """

    def __init__(self, tally: NDArray[np.uint32], lost: Ints, integrals: Callable[[], NDArray[Any]]) -> None:
        """Integrals from the counts of volume_march.slang, and a function that reads them."""
        self.segments, self.undefined, self.lost = tally[:, 0], tally[:, 1] >> 2, lost
        self._covers, self._is_open, self._read = tally[:, 1] & 1, tally[:, 1] & 2, integrals

    @cached_property
    def _lights(self) -> NDArray[Any]:
        integrals = self._read().copy()
        integrals[self.segments == 0] = 0
        return integrals

    def __getattr__(self, name: str) -> Any:
        """Arrays that are read from the device when they are first used."""
        if name not in ("color", "alpha", "coverage", "length", "error"):
            raise AttributeError(name)
        return self._lights[name]

    def status(self) -> NDArray[np.uint8]:
        """Status (n,) of the volumes (see frame.Status).

        Failed if something was not found, ambiguous if elements without numbers are skipped, or if less is proved than
        the requested error.
        """
        known = np.where(self._covers, Status.CERTAIN, Status.MISS)
        known[self._is_open > 0] = Status.AMBIGUOUS
        known[self.undefined > 0] = Status.AMBIGUOUS
        known[self.lost > 0] = Status.FAILED
        return known.astype(np.uint8)

    def counts(self) -> Counter[str]:
        """Segments, those whose field is not a number, and places that were not found, on all rays together."""
        return Counter({name: int(getattr(self, name).sum()) for name in ("segments", "undefined", "lost")})
