"""Boxes of elements that may hold a level of a quantity, each with series of low degree for the map and the quantity.

1.  The boxes of all elements are bisected in each direction until the remainder of the quantity's model is small.
2.  Boxes whose model excludes the level are dropped.
3.  The others are bisected until the terms of the model beyond a low degree are also small, and dropped in the same
   way.

Restricting a series to an eighth of its box is exact but for rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.chebyshev_models.expression_models import BoxLeaves, models_of
from elvis.core.chebyshev_models.model import ChebyshevModel
from elvis.core.chebyshev_models.model_boxes import (
    ElementSeries,
    ModelBoxes,
    ShapeFacets,
    half_along,
    in_batches,
    joined,
)
from elvis.core.chebyshev_models.series import (
    ORDERS,
    ROOM,
    amplification,
    bounds_in_eighths,
    kernel_rounding,
    shells_of,
    sizes_of,
    steepness,
    sum_rounding,
    transform_rounding,
)
from elvis.core.chebyshev_models.series_boxes import SeriesBoxes, world_boxes
from elvis.core.quantities.tree import Node

#: bisections of elements' boxes and nodes per direction of the models tried first, in order of increasing cost
_PLANS = ((0, 12), (0, 16), (1, 10), (1, 12), (1, 14), (1, 16), (2, 12), (2, 14), (2, 16), (3, 12))
#: elements on which plans are tried, and the part of the most that any does for
_TRIED, _MOST_OF_THEM = 8, 0.75
#: more halvings of boxes whose models are not good enough, before these are given up
_MOST_MORE_HALVINGS = 2
#: degrees of local series that are tried, beyond the least
_MORE_DEGREES = (0, 2, 4)
#: half sides of boxes that are not bisected any more
_LEAST_HALF = 1 / 64
#: nodes per direction of models on parts of boxes
_NODES_OF_PARTS = 12
#: tolerated error of models, relative to their range
_MODEL_PART = 2e-4
#: the same tolerance for the smallest boxes, whose error is rounding
_FAIR_PART = 2e-3
#: the same tolerance, including terms that local series drop
_LOCAL_PART = 3e-4
#: both tolerances for products with a condition, which are small compared to their range over wide areas
_CONDITIONED_PART = 1e-4
#: degrees of local series that are tried for them, beyond the least
_CONDITIONED_DEGREES = (0, 2)
#: share of the tolerated error that plans for such products may use: parts of a box have smaller ranges
_OF_PLANS = 0.1
#: bytes of the series of all elements beyond which products with a condition are followed less closely
_MOST_BYTES = 8 << 30
#: pixels of a box of a picture; within one, the quantity changes by more than the error of its series
_PIXELS = 16.0
#: boxes whose models are built together: intermediate results stay in the processor's cache
_AT_ONCE = 16


@dataclass(frozen=True, eq=False)
class LevelSearch:
    """Settings of a search for a level of a quantity.

    elements  the elements
    root    the expression
    names   of the fields of the leaves
    errors  (elements, 3 + fields) maximum error of computed values of leaves
    inside  the shape
    degree  least degree of local series, at least the degree of the map
    tolerance  tolerated error of models with a condition, relative to their range
    condition  an expression that is positive where the level does not count, and negative where it does; None if all
            of it counts
    halvings  of elements' boxes before the first models
    count     nodes per direction of these models; 0 before they are planned
    """

    elements: ElementSeries
    root: Node
    names: tuple[str, ...]
    errors: Floats
    inside: ShapeFacets
    degree: int
    condition: Node | None = None
    tolerance: float = _CONDITIONED_PART
    halvings: int = 0
    count: int = 0

    def find(self, level: float) -> SeriesBoxes:
        """The boxes of elements that may hold a level."""
        search = self.planned(level, len(self.errors)) if self.count == 0 else self
        return search._find(level)

    def planned(self, level: float, total: int) -> LevelSearch:
        """The search with halvings, nodes, degree and tolerance that suit its elements, which stand for ``total``."""
        rows = np.flatnonzero(self.elements.finite)
        if not len(rows):
            return replace(self, count=_NODES_OF_PARTS)
        # infinite remainders become NaN when combined; neither ever counts as small
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            return self._affordable(rows, level, total)

    def _find(self, level: float) -> SeriesBoxes:
        """The boxes of a planned search."""
        finite = self.elements.finite
        rows = np.flatnonzero(finite)
        found = [self.none(np.flatnonzero(~finite))]
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            for some in np.array_split(rows, -(-len(rows) // _AT_ONCE)) if len(rows) else []:
                for boxes in self._boxes_of(some):
                    found.extend(self._search(boxes, level, self.count, _MOST_MORE_HALVINGS))
        return SeriesBoxes.joined(found)

    def _boxes_of(self, rows: Ints) -> Iterator[ModelBoxes]:
        """All boxes of some elements, in groups with several centres."""
        centres = self._centres(self.halvings)
        half = 0.5**self.halvings
        for some in np.array_split(centres, -(-len(centres) * len(rows) // _AT_ONCE)):
            yield joined([self.elements.boxes(rows, centre, half) for centre in some])

    def _affordable(self, rows: Ints, level: float, total: int) -> LevelSearch:
        """The closest search for all elements (``total``) whose series have room."""
        halvings, count = self._plan(rows)
        boxes = self.elements.boxes(some_of(rows), self._place(halvings), 0.5**halvings)
        search = replace(self._with_best_degree(boxes, level, count), halvings=halvings, count=count)
        if self.condition is not None and self.tolerance < _LOCAL_PART:
            times = total * len(self._centres(halvings)) / len(boxes)
            if 8 * times * search._terms(boxes, level, count) > _MOST_BYTES:
                return replace(self, tolerance=_LOCAL_PART)._affordable(rows, level, total)
        return search

    def _with_best_degree(self, boxes: ModelBoxes, level: float, count: int) -> LevelSearch:
        """The search with the degree for which series on some boxes take the least memory and time."""
        more_degrees = _MORE_DEGREES if self.condition is None else _CONDITIONED_DEGREES
        searches = [replace(self, degree=self.degree + more) for more in more_degrees]
        # kernels sum all terms of a box at each step of a ray; products with a condition need closeness above all
        weight = 3 if self.condition is None else 0
        return min(searches, key=lambda own: own._terms(boxes, level, count) * (own.degree + 1) ** weight)

    def _terms(self, boxes: ModelBoxes, level: float, count: int) -> int:
        """Terms of all series on some boxes."""
        return sum(own.series.size for own in self._search(boxes, level, count, 0))

    def _centres(self, halvings: int) -> Floats:
        """(m, 3) centres of the boxes of a bisected cube that may lie in the shape."""
        count = 2**halvings
        line = (2.0 * np.arange(count) + 1.0) / count - 1.0
        centres = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
        return centres[self.inside.holds(centres, np.full(len(centres), 1.0 / count))]

    def _plan(self, rows: Ints) -> tuple[int, int]:
        """Halvings of elements' boxes and nodes of a line with which most models of some elements are good enough."""
        good = []
        for halvings, count in _PLANS:
            boxes = self.elements.boxes(some_of(rows), self._place(halvings), 0.5**halvings)
            good.append(self._models(boxes, count).is_within(_OF_PLANS if self.condition is not None else 1.0).mean())
            if good[-1] == 1.0:
                break
        # no plan suits singular maps
        return _PLANS[int(np.argmax(np.array(good) >= _MOST_OF_THEM * max(good)))]

    def _place(self, halvings: int) -> Floats:
        """(3,) the centre of a box of a bisected cube.

        The first eighth is within all shapes, others meet them at least.
        """
        sides = np.random.default_rng(1).choice((-1, 1), size=(max(_PLANS)[0], 3))
        sides[0] = -1
        return np.asarray(0.5 ** np.arange(1, halvings + 1) @ sides[:halvings])

    def _search(self, boxes: ModelBoxes, level: float, count: int, halvings: int) -> Iterator[SeriesBoxes]:
        """The boxes that may hold the level among some of one size and their parts."""
        for some in in_batches(boxes, _AT_ONCE):
            models = self._models(some, count)
            taken = models.is_good if halvings else models.is_good | models.is_fair
            yield from self._local(models.part(taken), level, True)
            rest = some.part(~taken & models.may_hold(level))
            if halvings and len(rest):
                yield from self._search(self._afresh(rest.eighths(self.inside)), level, count, halvings - 1)
            elif len(rest):
                yield self.none(np.unique(rest.element))

    def _afresh(self, boxes: ModelBoxes) -> ModelBoxes:
        """The same boxes with series of their own, whose errors are smaller than those of larger boxes."""
        centres, number = np.unique(boxes.centre, axis=0, return_inverse=True)
        parts = [boxes.part(np.zeros(0, np.int64))]
        for k, centre in enumerate(centres):
            own = boxes.part(number.reshape(-1) == k)
            parts.append(self.elements.boxes(own.element, centre, float(own.half[0])))
        return joined(parts)

    def _models(self, boxes: ModelBoxes, count: int) -> _ModelledBoxes:
        """The models of the quantity on boxes of one size."""
        scale = 1.0 / (ROOM * boxes.half[0])
        errors = self.errors[boxes.element]
        narrow = boxes.half[0] / boxes.wide[0]
        leaves = BoxLeaves(self.names, boxes.leaves, errors, boxes.off, narrow, boxes.rounding, scale, count)
        roots = (self.root,) if self.condition is None else (self.root, self.condition)
        model, *conditions = models_of(roots, leaves)
        # values at the nodes are rounded, so the series has an error polynomial of its degree
        steep = np.array([steepness(count, order) for order in range(ORDERS)])
        off = amplification(count) * model.error + transform_rounding(count) * model.sizes[0]
        rounding = np.outer(steep, off)
        condition = _Condition.of(conditions[0], self.tolerance) if conditions else None
        return _ModelledBoxes(boxes, model.coefficients, model.remainder + rounding, model.error, condition)

    def _local(self, models: _ModelledBoxes, level: float, is_whole: bool) -> Iterator[SeriesBoxes]:
        """Series of low degree on the parts of models that may hold the level; ``is_whole`` for whole boxes of models.

        Terms beyond the low degree fade as boxes are bisected, but the error of a model does not.  Parts whose range is
        small compared to this error get models of their own.
        """
        models = models.part(models.may_hold(level))
        models = models.part(models.may_hold_in_parts(level))
        if not len(models.boxes):
            return
        part = _LOCAL_PART if self.condition is None else self.tolerance
        misfit, tolerance = models.misfit(self.degree), part * models.range
        smallest = models.boxes.half[0] <= _LEAST_HALF
        is_vague = _lacking(models.remainder) > tolerance
        done = (_lacking(misfit) <= tolerance) | smallest | (is_vague & is_whole)
        if done.any():
            yield models.part(done).as_series_boxes(self.degree, misfit[:, done])
        vague = models.boxes.part(is_vague & ~done)
        if len(vague):
            yield from self._search(vague, level, _NODES_OF_PARTS, 0)
        rest = models.part(~done & ~is_vague)
        if len(rest.boxes):
            yield from self._local(rest.eighths(self.inside, level), level, False)

    def none(self, unmodelled: Ints | None = None) -> SeriesBoxes:
        """No boxes, and elements without models."""
        size = self.degree + 1
        return SeriesBoxes(
            np.zeros(0, np.int64),
            np.zeros((0, 3)),
            np.zeros(0),
            np.zeros((0, 4, size, size, size)),
            np.zeros((0, ORDERS)),
            np.zeros(0),
            np.zeros(0),
            np.zeros(0),
            np.zeros((0, 6)),
            np.zeros((0, 2)),
            np.zeros(0, np.int64) if unmodelled is None else unmodelled,
        )


@dataclass(frozen=True, eq=False)
class _ModelledBoxes:
    """Boxes with the series of a quantity.

    coefficients  (n, count, count, count) of the quantity's series
    remainder     (ORDERS, n) bounds of its error, and of the error's derivatives in x
    error         (n,) maximum error of computed values of the quantity
    condition     optional: where the level counts
    """

    boxes: ModelBoxes
    coefficients: Floats
    remainder: Floats
    error: Floats
    condition: _Condition | None

    def part(self, rows: Ints | Bools) -> _ModelledBoxes:
        """Some of the boxes."""
        condition = None if self.condition is None else self.condition.part(rows)
        own = self.coefficients[rows], self.remainder[:, rows], self.error[rows], condition
        return _ModelledBoxes(self.boxes.part(rows), *own)

    @property
    def range(self) -> Floats:
        """(n,) how far the series goes from its mean."""
        return _range_of(self.coefficients)

    @property
    def is_good(self) -> Bools:
        """(n,) whether the error of the series is small compared to its range, or is rounding."""
        return self.is_within(1.0)

    def is_within(self, share: float) -> Bools:
        """(n,) whether it is at most this share of the tolerated error, or rounding."""
        lacking = _lacking(self.remainder)
        count = self.coefficients.shape[-1]
        rounding = amplification(count) * self.error * max(_PIXELS, steepness(count, 1))
        part = _MODEL_PART if self.condition is None else self.condition.tolerance
        return np.asarray(lacking <= np.maximum(share * part * self.range, 2.0 * rounding))

    @property
    def is_fair(self) -> Bools:
        """(n,) whether the error of the series suffices for boxes that are not bisected any more."""
        return np.asarray(_lacking(self.remainder) <= _FAIR_PART * self.range)

    def may_hold(self, level: float) -> Bools:
        """(n,) whether the quantity may have the level in a box."""
        mean = self.coefficients[:, 0, 0, 0]
        meets = ~(np.abs(mean - level) > self.range + self.remainder[0] + self.error)
        return np.asarray(meets if self.condition is None else meets & ~self.condition.is_positive)

    def may_hold_in_parts(self, level: float) -> Bools:
        """(n,) whether the quantity may have the level in an eighth of a box: the series excludes more there."""
        mean, reach = bounds_in_eighths(self.coefficients)
        room = (self.remainder[0] + self.error)[:, None]
        meets = ~(np.abs(mean - level) > reach + room)
        if self.condition is not None:
            meets &= ~self.condition.is_positive_in_eighths
        return np.asarray(meets.any(axis=1))

    def misfit(self, degree: int) -> Floats:
        """(ORDERS, n) the remainders with the terms beyond a degree."""
        shells = shells_of(self.coefficients)
        shells[:, : degree + 1] = 0.0
        return np.asarray(self.remainder + sizes_of(shells))

    def eighths(self, inside: ShapeFacets, level: float) -> _ModelledBoxes:
        """Eighths of all boxes that may hold a level and lie in their elements; derivatives are half as great."""
        found = self
        for axis in range(3):
            found = found._halves(axis, level)
        boxes = replace(found.boxes, half=0.5 * found.boxes.half)
        remainder = found.remainder * (0.5 ** np.arange(ORDERS))[:, None]
        condition = None if found.condition is None else found.condition.halved()
        found = _ModelledBoxes(boxes, found.coefficients, remainder, found.error, condition)
        return found.part(inside.holds(boxes.centre, boxes.half))

    def _halves(self, axis: int, level: float) -> _ModelledBoxes:
        """Halves along an axis that may hold a level; the sizes are not updated."""
        total = self.range + np.abs(self.coefficients[:, 0, 0, 0])
        error = self.error + 2.0 * sum_rounding(self.coefficients.shape[-1]) * total
        parts = []
        for side in (-1, 1):
            condition = None if self.condition is None else self.condition.on_side(axis, side)
            coefficients = half_along(self.coefficients, axis, side)
            half = _ModelledBoxes(self.boxes, coefficients, self.remainder, error, condition)
            half = half.part(half.may_hold(level))
            parts.append(replace(half, boxes=half.boxes.moved(axis, side)))
        return _ModelledBoxes(
            joined([part.boxes for part in parts]),
            np.concatenate([part.coefficients for part in parts]),
            np.concatenate([part.remainder for part in parts], axis=1),
            np.concatenate([part.error for part in parts]),
            _Condition.joined([part.condition for part in parts if part.condition is not None]),
        )

    def as_series_boxes(self, degree: int, misfit: Floats) -> SeriesBoxes:
        """The boxes with series of a degree, and what those lack (ORDERS, n), in x."""
        size = degree + 1
        series = np.zeros((len(self.boxes), 4, size, size, size))
        boxes = self.boxes
        # fields may have higher degrees than the map: the map's series contain only rounding there, which is dropped
        own = min(size, boxes.leaves.shape[-1])
        series[:, :3, :own, :own, :own] = boxes.leaves[:, :3, :own, :own, :own]
        shells = shells_of(boxes.leaves[:, :3].reshape(-1, *boxes.leaves.shape[2:]))
        left_out = shells[:, own:].sum(axis=1).reshape(-1, 3)
        count = min(size, self.coefficients.shape[-1])
        series[:, 3, :count, :count, :count] = self.coefficients[:, :count, :count, :count]
        in_box = misfit.T / ROOM ** np.arange(ORDERS)
        # kernels sum these series: the rounding of that counts as well
        summed = kernel_rounding(size) * np.abs(series).sum(axis=(2, 3, 4))
        places = (boxes.error[:, :3] + left_out + summed[:, :3]).sum(axis=1)
        error = self.error + summed[:, 3]
        whole = np.tile((-1.0, 0.0), (len(boxes), 1))
        condition = whole if self.condition is None else self.condition.in_kernels
        return SeriesBoxes(
            boxes.element,
            boxes.centre,
            boxes.half,
            series,
            in_box,
            error,
            summed[:, 3],
            places,
            world_boxes(series[:, :3], places),
            condition,
            np.zeros(0, np.int64),
        )


@dataclass(frozen=True, eq=False)
class _Condition:
    """A condition on boxes, which is positive where a level does not count.

    coefficients  (n, count, count, count) of its series
    remainder     (n,) bounds of the error of the series
    steepness     (n,) bounds of the sum of the magnitudes of its derivatives in x
    error         (n,) maximum error of computed values
    tolerance     (n,) tolerated error of the models of the quantity, relative to their range
    """

    coefficients: Floats
    remainder: Floats
    steepness: Floats
    error: Floats
    tolerance: Floats

    @staticmethod
    def of(model: ChebyshevModel, tolerance: float) -> _Condition:
        """A condition with a model."""
        count = model.values.shape[-1]
        off = amplification(count) * model.error + transform_rounding(count) * model.sizes[0]
        steep = 3.0 * (model.sizes[1] + model.remainder[1] + steepness(count, 1) * off)
        tolerances = np.full(len(off), tolerance)
        return _Condition(model.coefficients, model.remainder[0] + off, steep, model.error, tolerances)

    @staticmethod
    def joined(parts: list[_Condition]) -> _Condition | None:
        """The conditions of several lists of boxes; None if there are none."""
        if not parts:
            return None
        return _Condition(*(np.concatenate([getattr(part, own.name) for part in parts]) for own in fields(_Condition)))

    def part(self, rows: Ints | Bools) -> _Condition:
        """Those of some boxes."""
        return _Condition(*(getattr(self, own.name)[rows] for own in fields(self)))

    def on_side(self, axis: int, side: int) -> _Condition:
        """Those of halves along an axis on one side."""
        total = np.abs(self.coefficients).sum(axis=(1, 2, 3))
        remainder = self.remainder + 2.0 * sum_rounding(self.coefficients.shape[-1]) * total
        return replace(self, coefficients=half_along(self.coefficients, axis, side), remainder=remainder)

    def halved(self) -> _Condition:
        """The same in the coordinates of boxes of half the size."""
        return replace(self, steepness=0.5 * self.steepness)

    @property
    def _room(self) -> Floats:
        """(n,) how far values may be from the mean of the series."""
        return np.asarray(_range_of(self.coefficients) + self.remainder + self.error)

    @property
    def is_positive(self) -> Bools:
        """(n,) whether the level counts nowhere in a box."""
        return np.asarray(self.coefficients[:, 0, 0, 0] > self._room)

    @property
    def is_positive_in_eighths(self) -> Bools:
        """(n, 8) whether the level counts nowhere in an eighth of a box."""
        mean, reach = bounds_in_eighths(self.coefficients)
        return np.asarray(mean > reach + (self.remainder + self.error)[:, None])

    @property
    def in_kernels(self) -> Floats:
        """(n, 2) as in SeriesBoxes."""
        counts = self.coefficients[:, 0, 0, 0] < -self._room
        open_ends = np.stack([self.error, self.steepness / ROOM], axis=1)
        return np.where(counts[:, None], (-1.0, 0.0), open_ends)


def some_of(rows: Ints) -> Ints:
    """Some of all elements, on which plans are tried."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(_TRIED, len(rows))).astype(np.int64))]


def _lacking(bounds: Floats) -> Floats:
    """(n,) errors (ORDERS, n) of quantities in a box of a picture, relative to which their range must be large."""
    return np.asarray(np.maximum(_PIXELS * bounds[0], bounds[1]))


def _range_of(coefficients: Floats) -> Floats:
    """(n,) how far series (n, count, count, count) go from their means."""
    flat = np.abs(coefficients).reshape(len(coefficients), coefficients.shape[-1] ** 3)
    return np.asarray(flat[:, 1:].sum(axis=1))
