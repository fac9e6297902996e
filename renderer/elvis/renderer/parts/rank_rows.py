"""Rows of one picture that ranks draw, each its own, and their exchange of facts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Ints
from elvis.core.base.ranks import ALONE, Ranks
from elvis.renderer.parts.bands import Bands
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.scene.cameras.view import Shown, View

T = TypeVar("T")


@dataclass(eq=False)
class RankRows:
    """The ranks of one picture.

    A picture that is restarted, on a reopened device, continues with the facts that the ranks have already exchanged.
    """

    ranks: Ranks = ALONE
    bands: Bands | None = None  # of equally many rows each by default
    _told: list[Any] = field(default_factory=list)

    @property
    def is_alone(self) -> bool:
        """Whether one process draws all."""
        return self.ranks.size == 1

    def of(self, view: View) -> tuple[int, int]:
        """This rank's rows of a picture, from one to before another; some have none."""
        bands = self.bands or Bands.even(view, self.ranks.size)
        first, last = bands.borders[self.ranks.rank : self.ranks.rank + 2].tolist()
        return first, last

    def window(self, view: Shown, around: int) -> tuple[Shown, slice]:
        """A view of this rank's rows, one at least, and some around; which rows of that are its own."""
        first, last = self.of(view)
        window = view.rows(min(first, view.height - 1) - around, max(last, first + 1) + around)
        return window, slice(first - window.top, last - window.top)

    def together(self, found: T) -> list[T]:
        """Findings of all ranks on the picture before it is coloured, for each of them."""
        if not self._told:
            self._told = self.ranks.exchange(found, "a picture's ranges")
        return list(self._told)

    def gathered(self, found: T) -> list[T]:
        """Final findings of all ranks, for the first one."""
        return self.ranks.gather(found, "a picture's rows")


def joined(parts: list[Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Channels by name, of rows from the top that come one part after the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def channels(pixels: HitBuffer, view: View, ids: Ints, references: bool) -> dict[str, NDArray[Any]]:
    """Channels by name of a picture that records nothing else: owners become element ids (n,), pixels rows."""
    shape = view.height, view.width
    flat: dict[str, NDArray[Any]] = {
        "field": pixels.field,
        "element": ids.take(pixels.owner, mode="clip"),
        "status": pixels.status,
    }
    found: dict[str, NDArray[Any]] = {name: np.reshape(array, shape) for name, array in flat.items()}
    return found | ({"reference": pixels.reference.reshape(*shape, 3)} if references else {})
