"""Rows of one picture that ranks draw, each its own, and what they tell each other about them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from elvis.core.ranks import ALONE, Ranks
from elvis.renderer.tiles import TILE
from elvis.scene.view import View

T = TypeVar("T")


@dataclass(eq=False)
class RankRows:
    """The ranks of one picture.

    A picture that is begun again, on a device that is opened again, goes on where the ranks are: what they have told
    each other is known already.
    """

    ranks: Ranks = ALONE
    _told: list[Any] = field(default_factory=list)

    @property
    def is_alone(self) -> bool:
        """Whether one process draws all."""
        return self.ranks.size == 1

    def of(self, view: View) -> tuple[int, int]:
        """This rank's rows of a picture, from one to before another; where there are more ranks than tiles, the last
        ones have none."""
        if self.is_alone:
            return 0, view.height
        tiles = -(-view.height // TILE)
        count = min(tiles, self.ranks.size)
        first, last = (tiles * min(number, count) // count for number in (self.ranks.rank, self.ranks.rank + 1))
        return min(TILE * first, view.height), min(TILE * last, view.height)

    def together(self, found: T) -> list[T]:
        """What all ranks have found of the picture before it is coloured, for each of them."""
        if not self._told:
            self._told = self.ranks.exchange(found, "a picture's ranges")
        return list(self._told)

    def gathered(self, found: T) -> list[T]:
        """What all have found in the end, for the first one."""
        return self.ranks.gather(found, "a picture's rows")


def joined(parts: list[Mapping[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """Channels by name, of rows from the top that come one part after the other."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
