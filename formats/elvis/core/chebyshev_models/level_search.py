"""Boxes of elements that may hold a level of a quantity, each with series of low degree for the map and the quantity.

1.  The boxes of all elements are bisected in each direction until the remainder of the quantity's model is small.
2.  Boxes whose model excludes the level are dropped.
3.  The others are bisected until the terms of the model beyond a low degree are also small, and dropped in the same
   way.

Restricting a series to an eighth of its box is exact but for rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.chebyshev_models.expression_models import BoxLeaves, models_of
from elvis.core.chebyshev_models.model_boxes import (
    ElementSeries,
    ModelBoxes,
    ShapeFacets,
    in_batches,
    joined,
)
from elvis.core.chebyshev_models.modelled_boxes import Condition, ModelledBoxes, lacking
from elvis.core.chebyshev_models.series import (
    ORDERS,
    ROOM,
    amplification,
    steepness,
    transform_rounding,
)
from elvis.core.chebyshev_models.series_boxes import SeriesBoxes
from elvis.core.quantities.tree import Node

#: bisections of elements' boxes and nodes per direction of the models tried first, in order of increasing cost
_PLANS = ((0, 12), (0, 16), (1, 10), (1, 12), (1, 14), (1, 16), (2, 12), (2, 14), (2, 16), (3, 12))
#: elements on which plans are tried, and the part of the most that any does for
_TRIED, _MOST_OF_THEM = 8, 0.75
#: more halvings of boxes whose models are not good enough, before these are given up
_MOST_MORE_HALVINGS = 2
#: half sides of boxes that are not bisected any more
_LEAST_HALF = 1 / 64
#: nodes per direction of models on parts of boxes
_NODES_OF_PARTS = 12
#: tolerated error of series, including terms that local ones drop, relative to their range
_LOCAL_PART = 5e-4
#: share of that in terms that are dropped while boxes are bisected
_OF_DROPPED = 0.05
#: both tolerances for products with a condition, which are small compared to their range over wide areas
_CONDITIONED_PART = 1e-4
#: share of the tolerated error that plans for such products may use: parts of a box have smaller ranges
_OF_PLANS = 0.1
#: bytes of the series of all elements beyond which products with a condition are followed less closely
_MOST_BYTES = 8 << 30
#: boxes whose models are built together: intermediate results stay in the processor's cache
_AT_ONCE = 32


@dataclass(frozen=True, eq=False)
class LevelSearch:
    """Settings of a search for a level of a quantity.

    elements  the elements
    root    the expression
    names   of the fields of the leaves
    errors  (elements, 3 + fields) maximum error of computed values of leaves
    inside  the shape
    degree  of local series, at least the degree of the map
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
        """The search with halvings, nodes and tolerance that suit its elements, which stand for ``total``."""
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
        search = replace(self, halvings=halvings, count=count)
        if self.condition is not None and self.tolerance < _LOCAL_PART:
            boxes = self.elements.boxes(some_of(rows), self._place(halvings), 0.5**halvings)
            times = total * len(self._centres(halvings)) / len(boxes)
            if 8 * times * search._terms(boxes, level, count) > _MOST_BYTES:
                return replace(self, tolerance=_LOCAL_PART)._affordable(rows, level, total)
        return search

    def _terms(self, boxes: ModelBoxes, level: float, count: int) -> int:
        """Terms of all series on some boxes."""
        return sum(own.series.size + own.maps.size for own in self._search(boxes, level, count, 0))

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
                yield from self._search(self._afresh(*rest.eighths), level, count, halvings - 1)
            elif len(rest):
                yield self.none(np.unique(rest.element))

    def _afresh(self, element: Ints, centre: Floats, half: Floats) -> ModelBoxes:
        """Boxes (n,) of one size that may lie in their elements, with series."""
        inside = self.inside.holds(centre, half)
        element, centre = element[inside], centre[inside]
        centres, number = np.unique(centre, axis=0, return_inverse=True)
        order = np.argsort(number.reshape(-1), kind="stable")
        rows = np.split(element[order], np.cumsum(np.bincount(number.reshape(-1)))[:-1])
        none = self.elements.boxes(element[:0], np.zeros(3), 1.0)
        return joined([none, *(self.elements.boxes(*own, half[0]) for own in zip(rows, centres, strict=True))])

    def _models(self, boxes: ModelBoxes, count: int) -> ModelledBoxes:
        """The models of the quantity on boxes of one size."""
        scale = 1.0 / (ROOM * boxes.half[0])
        leaves = BoxLeaves(self.names, boxes.leaves, self.errors[boxes.element], boxes.off, scale, count)
        roots = (self.root,) if self.condition is None else (self.root, self.condition)
        model, *conditions = models_of(roots, leaves)
        # values at the nodes are rounded, so the series has an error polynomial of its degree
        steep = np.array([steepness(count, order) for order in range(ORDERS)])
        off = amplification(count) * model.error + transform_rounding(count) * model.sizes[0]
        remainder = model.remainder + np.outer(steep, off)
        condition = Condition.of(conditions[0], self.tolerance) if conditions else None
        places = boxes, np.arange(len(boxes)), boxes.centre, boxes.half
        return ModelledBoxes(*places, model.coefficients, remainder, model.error, condition)

    def _local(self, models: ModelledBoxes, level: float, is_whole: bool) -> Iterator[SeriesBoxes]:
        """Series of low degree on the parts of models that may hold the level; ``is_whole`` for whole boxes of models.

        Terms beyond the low degree fade as boxes are bisected, but the error of a model does not.  Parts whose range is
        small compared to this error get models of their own.
        """
        models = models.part(models.may_hold(level))
        models = models.part(models.may_hold_in_parts(level))
        if not len(models):
            return
        part = _LOCAL_PART if self.condition is None else self.tolerance
        misfit, tolerance = models.misfit(self.degree), part * models.range
        smallest = models.half[0] <= _LEAST_HALF
        is_vague = lacking(models.remainder) > tolerance
        done = (lacking(misfit) <= tolerance) | smallest | (is_vague & is_whole)
        if done.any():
            yield models.part(done).as_series_boxes(self.degree, misfit[:, done])
        vague = models.part(is_vague & ~done)
        if len(vague):
            again = self._afresh(vague.element, vague.centre, vague.half)
            yield from self._search(again, level, _NODES_OF_PARTS, 0)
        rest = models.part(~done & ~is_vague)
        if len(rest):
            short = rest.shortened(self.degree + 1, _OF_DROPPED * part)
            yield from self._local(short.eighths(self.inside, level), level, False)

    def none(self, unmodelled: Ints | None = None) -> SeriesBoxes:
        """No boxes, and elements without models."""
        size = 3 * (self.degree + 1,)
        none, no_rows = np.zeros(0), np.zeros(0, np.int64)
        return SeriesBoxes(
            element=no_rows,
            centre=np.zeros((0, 3)),
            half=none,
            series=np.zeros((0, *size)),
            misfit=np.zeros((0, ORDERS)),
            error=none,
            summed=none,
            places=none,
            world=np.zeros((0, 6)),
            condition=np.zeros((0, 2)),
            map_of=no_rows,
            unmodelled=no_rows if unmodelled is None else unmodelled,
            map_centre=np.zeros((0, 3)),
            map_half=none,
            maps=np.zeros((0, 3, *size)),
        )


def some_of(rows: Ints) -> Ints:
    """Some of all elements, on which plans are tried."""
    return rows[np.unique(np.linspace(0, len(rows) - 1, min(_TRIED, len(rows))).astype(np.int64))]
