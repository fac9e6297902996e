"""A proved upper bound of the difference of two fields on different meshes, over all pairs of elements that may meet.

If the map of one element of a pair is affine, its field is a polynomial in the other one's coordinates eta, even
outside the element.  The difference is then a polynomial on boxes of eta, and `compositions` bounds it, roundings
included.  Boxes are reduced to the region of the other element, boxes on the far side of a facet are dropped, and boxes
whose bound exceeds the maximum found are bisected.  If no map is affine, the ranges of both fields on boxes of either
element that may meet bound the difference (`bent_pairs`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.bounds.extrema import Extremum
from elvis.core.differences.bent_pairs import DOUBTFUL, bound_of_bent_pairs, middles
from elvis.core.differences.compositions import Composed, Composition, PairBoxes, degree_on
from elvis.core.differences.prepared import Side, sides
from elvis.core.mapping.margins import heights
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.boxnets import all_halves, corners
from elvis.core.polynomials.rounding import UNIT, gamma, halving_roundings

#: coefficients of differences that may be taken in all, and together; halvings of boxes, and of those before nets
_MOST, _BATCH, _ROUNDS, _BEFORE = 1 << 26, 1 << 17, 20, 8
#: part of the largest difference found by which the bound may be more
_CLOSE = 1e-4
#: relative rounding of values permitted without bisecting boxes, and growth above which boxes are bisected
_SMALL, _GROWN = 1e-12, 1.5
#: times that boxes are cut down
_CUTS = 2
#: largest degree of differences on boxes
_MOST_DEGREE = 30
#: maximum distance of a corner outside an element that still counts as inside, in the unit of `margins.facets`
_INSIDE = 8 * UNIT


@dataclass
class _Search:
    """The largest difference so far, how many coefficients may still be taken, and world points of open boxes."""

    best: Extremum
    budget: int = _MOST
    doubtful: list[Floats] = field(default_factory=list)


def bound_of_difference(
    first: Sequence[Patch], second: Sequence[Patch], found: Extremum
) -> tuple[Extremum, Floats] | None:
    """The maximum magnitude of the difference with an upper bound; None without a bound.

    Also world points (n, 3) near which a larger difference isn't excluded.

    first, second  elements of two datasets, each with the field to be compared as its only one
    found          the maximum magnitude at points, which is replaced if corners of boxes have a larger one
    """
    ours, theirs = sides(first), sides(second)
    if ours is None or theirs is None or len({own.patch.dimension for own in (*ours, *theirs)}) != 1:
        return None
    search = _Search(found)
    bounds = [_between(one, two, search) for one in ours for two in theirs]
    doubtful = np.concatenate([np.empty((0, 3)), *search.doubtful])
    return replace(search.best, bound=max((search.best.value, *bounds))), doubtful


def _between(one: Side, two: Side, search: _Search) -> float:
    """The bound over the elements of two patches that meet."""
    rows, others = two.tree.overlaps(one.boxes[:, :3], one.boxes[:, 3:])
    upper = _apart(one, two, rows, others)
    if not len(rows) or upper.max() <= search.best.value:
        return 0.0
    bound = 0.0
    for outer, inner, a, b, which in _roles(one, two, rows, others):
        bound = max(bound, _Pairs(outer, inner, outer is one, search).bound(a, b, upper[which]))
    return bound


def _roles(one: Side, two: Side, rows: Ints, others: Ints) -> Iterator[tuple[Side, Side, Ints, Ints, Bools]]:
    """Pairs of elements, the one with an affine map last where there is one."""
    is_last = two.affine.holds[others]
    if degree_on(two, one) < degree_on(one, two):
        is_last = is_last & ~one.affine.holds[rows]
    yield one, two, rows[is_last], others[is_last], is_last
    yield two, one, others[~is_last], rows[~is_last], ~is_last


def _apart(one: Side, two: Side, rows: Ints, others: Ints) -> Floats:
    """(n,) largest difference of values in the ranges of both fields on elements."""
    (low, high), (other_low, other_high) = one.ranges(), two.ranges()
    above, below = high[rows] - other_low[others], other_high[others] - low[rows]
    return np.asarray(np.maximum(above, below) * (1 + 4 * UNIT))


class _Pairs:
    """Elements of ``outer``, each with one of ``inner``, whose map is affine, that it may meet."""

    def __init__(self, outer: Side, inner: Side, is_ours: bool, search: _Search) -> None:
        self._outer, self._inner, self._is_ours, self._search = outer, inner, is_ours, search
        self._composition = Composition(outer, inner)

    def bound(self, rows: Ints, others: Ints, upper: Floats) -> float:
        """An upper bound of differences on pairs, for which the ranges of the fields give ``upper`` (n,)."""
        is_told = self._inner.affine.holds[others] & (self._composition.degree <= _MOST_DEGREE)
        bound = self._bent(rows[~is_told], others[~is_told], upper[~is_told])
        open_pairs = np.flatnonzero(is_told & (upper > self._search.best.value))
        open_pairs = open_pairs[np.argsort(-upper[open_pairs], kind="stable")]
        step = max(1, _BATCH // self._composition.count)
        for first in range(0, len(open_pairs), step):
            pairs = open_pairs[first : first + step]
            highest = float(upper[pairs[0]])
            if self._search.budget <= 0:
                return max(bound, highest)
            bound = max(bound, min(highest, self._bound_of(rows[pairs], others[pairs])))
        return bound

    def _bent(self, rows: Ints, others: Ints, upper: Floats) -> float:
        """The bound on those pairs of elements without an affine map that may exceed the largest difference found."""
        is_open = upper > self._search.best.value
        if not is_open.any():
            return 0.0
        limit, points = bound_of_bent_pairs(
            self._outer, self._inner, rows[is_open], others[is_open], self._search.best.value
        )
        self._search.doubtful.append(points)
        return limit

    def _bound_of(self, rows: Ints, others: Ints) -> float:
        """`bound` from nets of differences on boxes."""
        boxes = self._composition.whole(rows, others)
        boxes = boxes.part(self._composition.meet(boxes))
        for _ in range(_CUTS if len(boxes) else 0):
            boxes = self._composition.clipped(boxes)
        bound = 0.0
        for part in self._near(boxes):
            for group, composed in self._composition.compose(part, _CLOSE * self._search.best.value / 4):
                bound = max(bound, self._halved(group, composed))
        return bound

    def _near(self, boxes: PairBoxes) -> Iterator[PairBoxes]:
        """Boxes, bisected where they reach so far beyond the other element that values are rounded too much."""
        composition, step = self._composition, max(1, _BATCH // self._composition.count)
        size = np.abs(self._outer.net).max() + np.abs(self._inner.net).max()
        ready = []
        for _ in range(_BEFORE):
            if not len(boxes) or self._search.budget <= 0:
                break
            allowed = max(_CLOSE * self._search.best.value / 4, _SMALL * float(size))
            slack = composition.lebesgue * composition.rounding_of_values(boxes)
            is_far = (slack > allowed) & (composition.growth(boxes) > _GROWN)
            ready.append(boxes.part(~is_far))
            boxes = boxes.part(is_far).halved()
            boxes = boxes.part(composition.meet(boxes))
            self._search.budget -= len(boxes) * composition.count
        boxes = PairBoxes.joined([*ready, boxes])
        for first in range(0, len(boxes), step):
            yield boxes.part(np.arange(first, min(first + step, len(boxes))))

    def _halved(self, boxes: PairBoxes, composed: Composed) -> float:
        """The bound on boxes with nets of differences, which are bisected."""
        bound, nets, limit, slack = 0.0, composed.nets, composed.limit, composed.slack
        boxes = boxes.without_fields()
        self._search.budget -= nets.size
        for _ in range(_ROUNDS):
            meets = self._composition.meet(boxes)
            if not meets.any():
                return bound
            boxes, nets, limit, slack = boxes.part(meets), nets[meets], limit[meets], slack[meets]
            self._improve(boxes, nets, slack)
            is_open = limit > self._search.best.value * (1 + _CLOSE) + 4 * slack
            bound = max(bound, float(limit[~is_open].max(initial=0.0)))
            if not is_open.any():
                return bound
            if self._search.budget <= 0:
                self._note(boxes.part(is_open), limit[is_open])
                return max(bound, float(limit.max()))
            boxes, nets = boxes.part(is_open), nets[is_open]
            count = 2 ** (nets.ndim - 1)
            grown = slack[is_open] + gamma(halving_roundings(nets.shape[1:])) * _magnitudes(nets)
            slack, limit = np.tile(grown, count), np.tile(limit[is_open], count)
            boxes, nets = boxes.halved(), all_halves(nets)
            limit = np.minimum(limit, _magnitudes(nets) + slack)
            self._search.budget -= nets.size + boxes.places.size
        return max(bound, float(limit.max(initial=0.0)))

    def _note(self, boxes: PairBoxes, limit: Floats) -> None:
        """Note points of those boxes whose bounds are the largest."""
        chosen = boxes.part(np.argsort(-limit, kind="stable")[:DOUBTFUL])
        points = middles(chosen.places) + self._inner.affine.origin[chosen.others]
        self._search.doubtful.append(np.pad(points, ((0, 0), (0, 3 - points.shape[1]))))

    def _improve(self, boxes: PairBoxes, nets: Floats, slack: Floats) -> None:
        """Update the maximum difference if a corner in the other element has a larger one."""
        d, affine = boxes.places.shape[1], self._inner.affine
        ends = np.stack([corners(np.ascontiguousarray(boxes.places[:, axis])) for axis in range(d)], axis=2)
        xi = np.einsum("nqd,ndk->nqk", ends, affine.matrix[boxes.others])
        is_inside = heights(self._inner.patch.shape, xi).min(axis=2) >= -_INSIDE
        values = np.where(is_inside, np.abs(corners(nets)) - slack[:, None], 0.0)
        box, corner = np.unravel_index(int(values.argmax()), values.shape)
        if values[box, corner] <= self._search.best.value:
            return
        place = affine.origin[boxes.others[box]] + ends[box, corner]
        x, y, z = [*map(float, place), 0.0, 0.0][:3]
        side, row = (self._outer, boxes.rows[box]) if self._is_ours else (self._inner, boxes.others[box])
        element = int(side.patch.element_ids[row])
        self._search.best = Extremum(float(values[box, corner]), np.nan, (x, y, z), element)


def _magnitudes(nets: Floats) -> Floats:
    """(n,) the largest of nets (n, D, …)."""
    return np.asarray(np.abs(nets).max(axis=tuple(range(1, nets.ndim))))
