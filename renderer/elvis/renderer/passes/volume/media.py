"""What is seen of quantities in volumes: transfer functions, and the elements of each copy that have a part in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.renderer.device.device import STAND_IN
from elvis.renderer.frame.copied import Copy
from elvis.renderer.passes.volume.steepness import steepest
from elvis.renderer.volume.traversal import Traversal
from elvis.scene import Transfer

#: degree of quantities from which on polynomials along rays in curved elements have a higher one
_LEAST_DEGREE = 4


@dataclass(frozen=True)
class Medium:
    """How a quantity is seen: a volume; or, with a gate, the region where nothing of any volume is seen.

    transfer  with its colours
    quantity  one of the parts' quantities; None is their own field
    gate      the sign of the quantity where it hides all volumes; 0 for a volume
    """

    transfer: Transfer
    quantity: str | None = None
    gate: int = 0

    @staticmethod
    def clip(quantity: str | None, away: str) -> Medium:
        """A medium that hides where a quantity is negative (the inside) or positive."""
        return Medium(Transfer((0.0,), (0.0,), ((0.0, 0.0, 0.0),)), quantity, -1 if away == "inside" else 1)

    def counts(self, low: Floats, high: Floats) -> Bools:
        """(n,) whether something is seen, or hidden, of elements whose quantity is between bounds (n,), NaN or not."""
        if self.gate:
            return np.asarray(low < 0.0 if self.gate < 0 else high > 0.0)
        values, densities = np.asarray(self.transfer.values), np.asarray(self.transfer.densities)
        found = np.isnan(low) | (np.interp(low, values, densities) > 0.0) | (np.interp(high, values, densities) > 0.0)
        for value in values[densities > 0.0]:
            found |= (low <= value) & (value <= high)
        return np.asarray(found)

    def hides(self, low: Floats, high: Floats) -> Bools:
        """(n,) whether nothing of any volume is seen in elements whose quantity is between bounds (n,)."""
        return np.asarray((high < 0.0) & (self.gate < 0) | (low > 0.0) & (self.gate > 0))


class CopyMedia:
    """What one copy of the data contributes to volumes.

    names   quantities of the data, in the order of the lists of segments
    curved  for each of them the parts in which rays are not lines, or the quantity not a polynomial along them
    chosen  for each of them and each part the elements of which media show or hide something
    """

    def __init__(self, traversal: Traversal, media: Sequence[Medium], names: Mapping[str | None, str | None]) -> None:
        """For media whose quantities are others of the data: ``names`` has these."""
        self.names, self._names, self._media = list(names.values()), names, media
        self._loaded = traversal.loaded
        parts = range(len(self._loaded.parts))
        self.curved = [[n for n in parts if not traversal.is_straight(n, own)] for own in self.names]
        self.chosen = [[self._counts(quantity, n) for n in parts] for quantity in names]

    def _counts(self, quantity: str | None, number: int) -> Bools:
        """Elements (n,) of a part of which a quantity's media show or hide something."""
        low, high = self._loaded.bounds(number, self._names[quantity])
        found = np.zeros(len(low), bool)
        for medium in self._media:
            if medium.quantity == quantity:
                found |= medium.counts(low, high)
            found &= ~medium.hides(*self._loaded.bounds(number, self._names[medium.quantity]))
        return found


class Media:
    """Data that depend on the media of a picture, but not on its view.

    quantities  of which segments are listed
    copies      what each copy of the data contributes; one without copies
    march       the kernel that marches along rays
    rooms       sizes of tiles' lists in the last picture, by the numbers of their positions
    crowding    how much longer lists had to be than what was likely
    buffers     the media and their transfer functions
    """

    def __init__(self, traversal: Traversal, media: Sequence[Medium], copies: Sequence[Copy]) -> None:
        self.media, self.shown_copies = media, copies
        self._device = traversal.device
        self.quantities = list(dict.fromkeys(medium.quantity for medium in media))
        self.copies = self._copies(traversal)
        self.is_curved = any(any(own.curved) for own in self.copies)
        parts = range(len(traversal.loaded.parts))
        names = dict.fromkeys(name for own in self.copies for name in own.names)
        self.degree = max(self._line_degree(traversal, n, own) for n in parts for own in names)
        self.march = self._device.kernel("volume_march", line_degree=self.degree, media=len(media))
        self.buffers = self._buffers()
        self.rooms: dict[int, int] = {}
        self.crowding = 1.0

    @staticmethod
    def _line_degree(traversal: Traversal, number: int, quantity: str | None) -> int:
        """Degree of the polynomials along rays in a part.

        Along a curve, polynomials of three coordinates have a higher degree: longer parts then need fewer points.
        """
        degree = traversal.degree(number, quantity)
        if degree < _LEAST_DEGREE or traversal.is_straight(number, quantity):
            return degree or STAND_IN
        return degree + degree // 2

    def _copies(self, traversal: Traversal) -> list[CopyMedia]:
        """What each copy contributes: the same for copies whose quantities are the same."""
        known: dict[tuple[str | None, ...], CopyMedia] = {}
        found = []
        if not self.shown_copies:
            return [CopyMedia(traversal, self.media, {quantity: quantity for quantity in self.quantities})]
        for copy in self.shown_copies:
            own = {quantity: copy.on_device(quantity) for quantity in self.quantities}
            key = tuple(own.values())
            if key not in known:
                known[key] = CopyMedia(traversal, self.media, own)
            found.append(known[key])
        return found

    def _buffers(self) -> dict[str, Any]:
        """Buffers that all marches share."""
        device = self._device
        medium = np.zeros(len(self.media), self.march.dtype("medium"))
        counts = [len(own.transfer.values) for own in self.media]
        medium["list"] = [self.quantities.index(own.quantity) for own in self.media]
        medium["count"], medium["first"] = counts, np.cumsum(counts) - counts
        medium["gate"] = [own.gate for own in self.media]
        medium["steepest"] = [steepest(own.transfer) for own in self.media]
        densest = [max(own.transfer.densities) for own in self.media]
        medium["densest"] = [sum(densest) if own.gate else most for own, most in zip(self.media, densest, strict=True)]
        buffers = {"medium": device.buffer(medium)}
        for name in ("values", "densities", "colors"):
            numbers = [np.asarray(getattr(own.transfer, name), np.float64) for own in self.media]
            buffers[name] = device.buffer(np.concatenate(numbers))
        return buffers
