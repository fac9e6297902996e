"""A proved bound of the difference of two fields on pairs of elements of which neither has an affine map.

Both elements are cut into boxes of eta.  On a box the nets of the coordinates and of the field bound where it is in the
world and which values it has, roundings included.  At a point of both elements the difference is at most that of the
values in two boxes which meet in the world.  Pairs of boxes that don't meet, or whose bound isn't more than what is
found, are left out; one box after the other is halved in the others.  The bound closes in as the size of boxes.
"""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.differences.compositions import PairBoxes
from elvis.core.differences.prepared import Side
from elvis.core.polynomials.boxnets import corners
from elvis.core.polynomials.rounding import UNIT

#: world points of open boxes that are noted at most
DOUBTFUL = 256
#: pairs of boxes at a time at most, and numbers in the nets of one element's boxes
_MOST_PAIRS = 1 << 19
_MOST_NUMBERS = 1 << 23
#: rounds at most, in each of which one element's boxes are halved
_ROUNDS = 40
#: part of the greatest difference found by which the bound may be more
_CLOSE = 1e-4


def bound_of_bent_pairs(one: Side, two: Side, rows: Ints, others: Ints, found: float) -> tuple[float, Floats]:
    """What differences on pairs of elements (n,) don't exceed, and world points (k, 3) where they may be so great.

    found  a difference that there is somewhere
    """
    boxes, other_boxes = (_boxes(side, which) for side, which in ((one, rows), (two, others)))
    pairs = np.arange(len(rows))
    first, second = pairs, pairs
    limit = _limits(boxes, other_boxes, first, second)
    bound = found
    for _ in range(_ROUNDS):
        is_open = limit > found * (1 + _CLOSE)
        bound = max(bound, float(limit[~is_open].max(initial=0.0)))
        first, second, limit = first[is_open], second[is_open], limit[is_open]
        count = 2 ** (boxes.places.ndim - 2)
        used, which = np.unique(first, return_inverse=True)
        is_full = count * len(first) > _MOST_PAIRS or count * len(used) * boxes.places[0].size > _MOST_NUMBERS
        if not len(first) or is_full:
            break

        # halves of box i are i, i + n, i + 2 n, …
        boxes = boxes.part(used).halved()
        first = (which[None] + len(used) * np.arange(count)[:, None]).reshape(-1)
        second, limit = np.tile(second, count), np.tile(limit, count)
        own = _limits(boxes, other_boxes, first, second)
        meets = own >= 0
        first, second, limit = first[meets], second[meets], np.minimum(limit, own)[meets]
        boxes, other_boxes, first, second = other_boxes, boxes, second, first
    highest = np.argsort(-limit, kind="stable")[:DOUBTFUL]
    points = middles(boxes.part(first[highest]).places)
    return max(bound, float(limit.max(initial=0.0))), np.pad(points, ((0, 0), (0, 3 - points.shape[1])))


def middles(places: Floats) -> Floats:
    """(n, d) means of the corners of boxes with nets (n, d, D, …) of coordinates."""
    axes = range(places.shape[1])
    return np.stack([corners(np.ascontiguousarray(places[:, axis])).mean(axis=1) for axis in axes], axis=1)


def _boxes(side: Side, rows: Ints) -> PairBoxes:
    """The whole boxes of elements (n,)."""
    places, place_error = side.places[rows], side.place_error[rows]
    return PairBoxes(rows, rows, places, place_error, side.box[rows], side.box_error[rows])


def _limits(boxes: PairBoxes, others: PairBoxes, first: Ints, second: Ints) -> Floats:
    """(n,) what differences on pairs of boxes don't exceed, -1 where these don't meet."""
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
