"""A proved bound of the difference of two fields on pairs of elements without affine maps.

Both elements are cut into boxes of eta.  On a box, the nets of the coordinates and of the field bound its position in
the world and its values, roundings included.  The difference at a common point is at most the difference of the values
in two boxes that meet in the world.  Pairs of boxes that don't meet, or whose bound is below the maximum found, are
dropped; the boxes of the others are bisected alternately.  The bound converges with the size of boxes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.differences.compositions import PairBoxes
from elvis.core.differences.prepared import Side
from elvis.core.polynomials.boxnets import corners
from elvis.core.polynomials.rounding import UNIT

#: world points of open boxes that are noted at most
DOUBTFUL = 256
#: pairs of boxes at a time at most, and numbers in the nets of one element's boxes
_MOST_PAIRS = 1 << 19
_MOST_NUMBERS = 1 << 23
#: maximum number of rounds; each round bisects one element's boxes
_ROUNDS = 40
#: part of the largest difference found by which the bound may be more
_CLOSE = 1e-4


@dataclass(frozen=True, eq=False)
class _BoxPairs:
    """Pairs (n,) of boxes of either element, ``first`` and ``second``, and what differences there don't exceed."""

    boxes: PairBoxes
    others: PairBoxes
    first: Ints
    second: Ints
    limit: Floats

    def part(self, which: Bools | Ints) -> _BoxPairs:
        """Some of them."""
        return replace(self, first=self.first[which], second=self.second[which], limit=self.limit[which])

    @property
    def halves(self) -> int:
        """Number of the halves of a box in every direction."""
        return int(2 ** self.boxes.places.shape[1])

    def is_full(self) -> bool:
        """Whether there would be too many with halves."""
        numbers = len(np.unique(self.first)) * self.boxes.places[:1].size
        return self.halves * len(self.first) > _MOST_PAIRS or self.halves * numbers > _MOST_NUMBERS

    def halved(self) -> _BoxPairs:
        """The pairs with halves of the first boxes that meet the second ones; these come first now."""
        used, which = np.unique(self.first, return_inverse=True)
        boxes = self.boxes.part(used).halved()
        # halves of box i are i, i + n, i + 2 n, …
        first = (which[None] + len(used) * np.arange(self.halves)[:, None]).reshape(-1)
        second = np.tile(self.second, self.halves)
        limit = _limits(boxes, self.others, first, second)
        closer = np.minimum(limit, np.tile(self.limit, self.halves))
        return _BoxPairs(self.others, boxes, second, first, closer).part(limit >= 0)


def bound_of_bent_pairs(one: Side, two: Side, rows: Ints, others: Ints, found: float) -> tuple[float, Floats]:
    """An upper bound of differences on pairs of elements (n,), and world points (k, 3) where it may be attained.

    found  a difference attained somewhere
    """
    boxes, other_boxes = (_boxes(side, which) for side, which in ((one, rows), (two, others)))
    numbers = np.arange(len(rows))
    pairs = _BoxPairs(boxes, other_boxes, numbers, numbers, _limits(boxes, other_boxes, numbers, numbers))
    bound = found
    for _ in range(_ROUNDS):
        is_open = pairs.limit > found * (1 + _CLOSE)
        bound = max(bound, float(pairs.limit[~is_open].max(initial=0.0)))
        pairs = pairs.part(is_open)
        if not len(pairs.first) or pairs.is_full():
            break
        pairs = pairs.halved()
    highest = pairs.part(np.argsort(-pairs.limit, kind="stable")[:DOUBTFUL])
    points = middles(pairs.boxes.part(highest.first).places)
    return max(bound, float(pairs.limit.max(initial=0.0))), np.pad(points, ((0, 0), (0, 3 - points.shape[1])))


def middles(places: Floats) -> Floats:
    """(n, d) means of the corners of boxes with nets (n, d, D, …) of coordinates."""
    axes = range(places.shape[1])
    return np.stack([corners(np.ascontiguousarray(places[:, axis])).mean(axis=1) for axis in axes], axis=1)


def _boxes(side: Side, rows: Ints) -> PairBoxes:
    """The whole boxes of elements (n,)."""
    places, place_error = side.places[rows], side.place_error[rows]
    return PairBoxes(rows, rows, places, place_error, side.box[rows], side.box_error[rows])


def _limits(boxes: PairBoxes, others: PairBoxes, first: Ints, second: Ints) -> Floats:
    """(n,) what differences on pairs of boxes don't exceed, -1 if these don't meet."""
    low, high = _extent(boxes)
    other_low, other_high = _extent(others)
    meets = (low[first] <= other_high[second]).all(axis=1) & (other_low[second] <= high[first]).all(axis=1)
    least, greatest = _range(boxes)
    other_least, other_greatest = _range(others)
    above, below = greatest[first] - other_least[second], other_greatest[second] - least[first]
    return np.where(meets, np.maximum(above, below) * (1 + 4 * UNIT), -1.0)


def _extent(boxes: PairBoxes) -> tuple[Floats, Floats]:
    """(n, d) corners of boxes in the world."""
    axes = tuple(range(2, boxes.places.ndim))
    return boxes.places.min(axis=axes) - boxes.place_error, boxes.places.max(axis=axes) + boxes.place_error


def _range(boxes: PairBoxes) -> tuple[Floats, Floats]:
    """(n,) what fields aren't below and above of on boxes."""
    axes = tuple(range(1, boxes.own.ndim))
    return boxes.own.min(axis=axes) - boxes.own_error, boxes.own.max(axis=axes) + boxes.own_error
