"""Boxes of elements that may hold a level of a quantity, each with series of low degree for the map and the quantity.

1.  The boxes of all elements are bisected in each direction until the remainder of the quantity's model is small.
2.  Boxes whose model excludes the level are dropped.
3.  The others are bisected until the terms of the model beyond a low degree are also small, and dropped in the same
   way.

Restricting a series to an eighth of its box is exact but for rounding.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_columns
from elvis.core.chebyshev_models.box_series import BoxSeries
from elvis.core.chebyshev_models.derivative_series import DerivativeSeries, derivatives_in
from elvis.core.chebyshev_models.expression_models import BoxLeaves, errors_in_eighths, models_of
from elvis.core.chebyshev_models.model_boxes import (
    ElementSeries,
    ModelBoxes,
    ShapeFacets,
)
from elvis.core.chebyshev_models.modelled_boxes import Condition, ModelledBoxes, lacking
from elvis.core.chebyshev_models.series import (
    ORDERS,
    ROOM,
)
from elvis.core.chebyshev_models.series_boxes import SeriesBoxes
from elvis.core.quantities.tree import Node, leaves

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
_LOCAL_PART = 1e-4
#: share of that in terms that are dropped while boxes are bisected
_OF_DROPPED = 0.05
#: share of the tolerated error that plans for products with a condition may use: parts of a box have smaller ranges
_OF_PLANS = 0.1
#: bisections of elements' boxes on which derivatives have models, and nodes of these models that are tried
_DERIVATIVES_AFTER, _NODES_OF_DERIVATIVES = 1, (12, 14, 16)
#: boxes whose models are built together: intermediate results stay in the processor's cache
_AT_ONCE = 32


#: elements (n,), and centres (n, 3) and half sides (n,) of boxes in them
Places = tuple[Ints, Floats, Floats]


@dataclass(frozen=True, eq=False)
class LevelSearch:
    """Settings of a search for a level of a quantity.

    elements  the elements
    root    the expression
    names   of the fields of the leaves
    errors  (elements, 3 + fields) maximum error of computed values of leaves
    inside  the shape
    degree  of local series, at least the degree of the map
    condition  an expression that is positive where the level does not count, and negative where it does; None if all
            of it counts
    halvings  of elements' boxes before the first models
    count     nodes per direction of these models; 0 before they are planned
    derivatives  of fields that have models of their own on larger boxes
    nodes_of_derivatives  of these models, per direction
    """

    elements: ElementSeries
    root: Node
    names: tuple[str, ...]
    errors: Floats
    inside: ShapeFacets
    degree: int
    condition: Node | None = None
    halvings: int = 0
    count: int = 0
    derivatives: tuple[Node, ...] = ()
    nodes_of_derivatives: int = 0

    def find(self, level: float) -> SeriesBoxes:
        """The boxes of elements that may hold a level."""
        search = self.planned() if self.count == 0 else self
        return search._find(level)

    @property
    def roots(self) -> tuple[Node, ...]:
        """The expression, and the condition if there is one."""
        return (self.root,) if self.condition is None else (self.root, self.condition)

    def planned(self) -> LevelSearch:
        """The search with halvings and nodes that suit its elements."""
        rows = np.flatnonzero(self.elements.finite)
        if not len(rows):
            return replace(self, count=_NODES_OF_PARTS)
        # infinite remainders become NaN when combined; neither ever counts as small
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            halvings, count = self._plan(rows)
            return replace(self, halvings=halvings, count=count)._with_models_of_derivatives(rows)

    def _find(self, level: float) -> SeriesBoxes:
        """The boxes of a planned search."""
        finite = self.elements.finite
        rows = np.flatnonzero(finite)
        found = [self.none(np.flatnonzero(~finite))]
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            for some in np.array_split(rows, -(-len(rows) // _AT_ONCE)) if len(rows) else []:
                search = self._on_rows(some)
                found.extend(search._search(search._boxes_of(some), level, self.count, _MOST_MORE_HALVINGS))
        return SeriesBoxes.joined(found)

    def _with_models_of_derivatives(self, rows: Ints) -> LevelSearch:
        """The search with models of derivatives on larger boxes if hardly any model on its boxes is worse for it."""
        derivatives = derivatives_in(self.roots)
        if not derivatives or self.halvings <= _DERIVATIVES_AFTER:
            return self
        direct = self._suitable(rows)
        for count in _NODES_OF_DERIVATIVES:
            search = replace(self, derivatives=derivatives, nodes_of_derivatives=count)
            if search._on_rows(some_of(rows))._suitable(rows) >= _MOST_OF_THEM * direct:
                return search
        return self

    def _suitable(self, rows: Ints) -> float:
        """The part of the models in a box of some elements that are good enough for plans."""
        boxes = self.elements.boxes(some_of(rows), self._place(self.halvings), 0.5**self.halvings)
        share = _OF_PLANS if self.condition is not None else 1.0
        return float(self._models(boxes, self.count).is_within(share).mean())

    def _on_rows(self, rows: Ints) -> LevelSearch:
        """The search in some elements only, with models of their derivatives."""
        if not self.derivatives:
            return self
        centres, half = self._centres(_DERIVATIVES_AFTER), 0.5**_DERIVATIVES_AFTER
        direct = replace(self, derivatives=())
        found = [
            direct._leaves(self.elements.boxes(rows, centre, half), self.nodes_of_derivatives) for centre in centres
        ]
        most = min(self.count, _NODES_OF_PARTS)
        # fields themselves are only used by some expressions
        used = set(leaves(*self.roots)) - set(self.derivatives)
        names = self.names if any(leaf.op == "field" for leaf in used) else ()
        elements = self.elements if names else self.elements.maps
        series = DerivativeSeries.of(self.derivatives, found, elements, rows, centres, half, most)
        return replace(self, elements=series, names=names, errors=self.errors[:, : 3 + len(names)])

    def _boxes_of(self, rows: Ints) -> Iterator[ModelBoxes]:
        """All boxes of some elements, in groups with several centres."""
        centres = self._centres(self.halvings)
        half = 0.5**self.halvings
        for some in np.array_split(centres, -(-len(centres) * len(rows) // _AT_ONCE)):
            yield ModelBoxes.joined([self.elements.boxes(rows, centre, half) for centre in some])

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
            good.append(replace(self, halvings=halvings, count=count)._suitable(rows))
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

    def _search(self, batches: Iterable[ModelBoxes], level: float, count: int, halvings: int) -> Iterator[SeriesBoxes]:
        """The boxes that may hold the level among boxes of one size and their parts."""
        coarse: list[Places] = []
        vague: list[Places] = []
        for boxes in batches:
            models = self._models(boxes, count)
            taken = models.is_good if halvings else models.is_good | models.is_fair
            yield from self._local(models.part(taken), level, vague)
            rest = models.part(~taken & models.may_hold(level))
            if halvings:
                coarse.append(rest.eighths_that_may_hold(level))
            elif len(rest):
                yield self.none(np.unique(rest.element))
        yield from self._search_again(coarse, level, count, halvings - 1)
        yield from self._search_again(vague, level, _NODES_OF_PARTS, 0)

    def _search_again(self, places: list[Places], level: float, count: int, halvings: int) -> Iterator[SeriesBoxes]:
        """The boxes that may hold the level among places, by models of their own."""
        if not places:
            return
        element, centre, half = joined_columns(places)
        for size in np.unique(half):
            rows = np.flatnonzero(half == size)
            yield from self._search(self._afresh(element[rows], centre[rows], size), level, count, halvings)

    def _afresh(self, element: Ints, centre: Floats, half: float) -> Iterator[ModelBoxes]:
        """Boxes (n,) of one size that may lie in their elements, with series; those with the same centre together."""
        inside = self.inside.holds(centre, np.full(len(centre), half))
        element, centre = element[inside], centre[inside]
        order = np.lexsort((element, *centre.T))
        for some in np.array_split(order, -(-len(order) // _AT_ONCE)) if len(order) else []:
            changes = np.flatnonzero((np.diff(centre[some], axis=0) != 0.0).any(axis=1)) + 1
            groups = np.split(some, changes)
            yield ModelBoxes.joined([self.elements.boxes(element[rows], centre[rows[0]], half) for rows in groups])

    def _leaves(self, boxes: ModelBoxes, count: int) -> BoxLeaves:
        """The leaves of the expression on boxes of one size."""
        scale = 1.0 / (ROOM * boxes.half[0])
        errors = np.concatenate([self.errors[boxes.element], boxes.errors], axis=1)
        return BoxLeaves(self.names, self.derivatives, boxes.leaves, errors, boxes.off, boxes.lost, scale, count)

    def _models(self, boxes: ModelBoxes, count: int) -> ModelledBoxes:
        """The models of the quantity on boxes of one size."""
        leaves = self._leaves(boxes, count)
        model, *conditions = models = models_of(self.roots, leaves)
        condition = Condition.of(conditions[0]) if conditions else None
        excess = np.zeros((len(boxes), len(models), 8))
        # products have large factors, whose bounds are much closer in eighths; others take less time as they are
        if conditions:
            in_eighths = np.stack(errors_in_eighths(self.roots, leaves), axis=1)
            excess = np.stack([own.error for own in models], axis=1)[..., None] - in_eighths
        places = boxes, np.arange(len(boxes)), boxes.centre, boxes.half
        series = BoxSeries.of(model.coefficients)
        return ModelledBoxes(*places, series, model.series_remainder, model.error, condition, excess)

    def _local(
        self, models: ModelledBoxes, level: float, vague: list[Places], is_whole: bool = True
    ) -> Iterator[SeriesBoxes]:
        """Series of low degree on the parts of models that may hold the level; ``is_whole`` for whole boxes of models.

        Terms beyond the low degree fade as boxes are bisected, but the error of a model does not.  Parts whose range is
        small compared to this error are appended to ``vague``: they need models of their own.
        """
        models = models.part(models.may_hold(level))
        models = models.part(models.may_hold_in_parts(level))
        if not len(models):
            return
        misfit, tolerance = models.misfit(self.degree), _LOCAL_PART * models.series.range
        smallest = models.half[0] <= _LEAST_HALF
        is_vague = lacking(models.remainder) > tolerance
        done = (lacking(misfit) <= tolerance) | smallest | (is_vague & is_whole)
        if done.any():
            yield models.part(done).as_series_boxes(self.degree, misfit[:, done])
        again = models.part(is_vague & ~done)
        if len(again):
            vague.append((again.element, again.centre, again.half))
        rest = models.part(~done & ~is_vague)
        if len(rest):
            short = rest.shortened(self.degree + 1, _OF_DROPPED * _LOCAL_PART)
            yield from self._local(short.eighths(self.inside, level), level, vague, False)

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
