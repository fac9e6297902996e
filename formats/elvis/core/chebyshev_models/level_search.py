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
from typing import Protocol

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.chebyshev_models.expression_models import BoxLeaves, model_of
from elvis.core.chebyshev_models.series import (
    ORDERS,
    ROOM,
    along_axes,
    amplification,
    kernel_rounding,
    shells_of,
    sizes_of,
    steepness,
    sum_rounding,
    to_half,
    transform_rounding,
)
from elvis.core.quantities.tree import Node

#: bisections of elements' boxes and nodes per direction of the models tried first, in order of increasing cost
_PLANS = ((0, 12), (0, 16), (1, 10), (1, 12), (1, 14), (1, 16), (2, 12), (2, 14), (3, 12))
#: elements on which plans are tried, and the part of the most that any does for
_TRIED, _MOST_OF_THEM = 8, 0.75
#: more halvings of boxes whose models are not good enough, before these are given up
_MOST_MORE_HALVINGS = 2
#: bisections of a model's box before its series are accepted
_MOST_LOCAL_HALVINGS = 4
#: tolerated error of models, relative to their range
_MODEL_PART = 2e-4
#: the same tolerance, including terms that local series drop
_LOCAL_PART = 3e-4
#: pixels of a box of a picture; within one, the quantity changes by more than the error of its series
_PIXELS = 16.0
#: boxes whose models are built together: intermediate results stay in the processor's cache
_AT_ONCE = 64
#: the eight eighths of a box
_EIGHTHS = tuple((x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1))


@dataclass(frozen=True, eq=False)
class ModelBoxes:
    """Boxes of elements, in the coordinates of the cubes that hold them, with series in x = s / ROOM.

    element   (n,) rows of elements
    centre    (n, 3) and half (n,) half sides
    leaves    (n, 3 + fields, degree + 1 three times) series of the map and of fields
    off       (n, 3 + fields) maximum error of the series from which these were restricted
    wide      (n,) half sides of the boxes of those series: the error is a polynomial there
    rounding  (n, 3 + fields) maximum error that restrictions added
    """

    element: Ints
    centre: Floats
    half: Floats
    leaves: Floats
    off: Floats
    wide: Floats
    rounding: Floats

    @staticmethod
    def fresh(element: Ints, centre: Floats, half: Floats, leaves: Floats, off: Floats) -> ModelBoxes:
        """Boxes with series of their own."""
        return ModelBoxes(element, centre, half, leaves, off, half, np.zeros_like(off))

    def __len__(self) -> int:
        return len(self.element)

    def part(self, rows: Ints | Bools) -> ModelBoxes:
        """Some of the boxes."""
        return ModelBoxes(*(getattr(self, own.name)[rows] for own in fields(self)))

    def eighths(self, inside: ShapeFacets) -> ModelBoxes:
        """Eighths of all boxes that may lie in their elements."""
        parts = [self._eighth(sides) for sides in _EIGHTHS]
        found = joined(parts)
        return found.part(inside.holds(found.centre, found.half))

    def of_map(self) -> ModelBoxes:
        """The boxes with only the map."""
        own = {name: getattr(self, name)[:, :3] for name in ("leaves", "off", "rounding")}
        return replace(self, **own)

    @property
    def error(self) -> Floats:
        """(n, 3 + fields) maximum error of the series."""
        return self.off + self.rounding

    def moved(self, axis: int, side: int) -> ModelBoxes:
        """The halves along an axis on one side; the sizes are not updated."""
        centre = self.centre.copy()
        centre[:, axis] += 0.5 * side * self.half
        return replace(
            self, centre=centre, leaves=half_along(self.leaves, axis, side), rounding=self._rounding_of_parts
        )

    def _eighth(self, sides: tuple[int, int, int]) -> ModelBoxes:
        """The eighth of each box on these sides."""
        half = 0.5 * self.half
        centre = self.centre + half[:, None] * np.array(sides)
        leaves = restricted(self.leaves, sides)
        return replace(self, centre=centre, half=half, leaves=leaves, rounding=self._rounding_of_parts)

    @property
    def _rounding_of_parts(self) -> Floats:
        """The rounding of series on parts of the boxes."""
        totals = np.abs(self.leaves).sum(axis=(2, 3, 4))
        return np.asarray(self.rounding + 2.0 * sum_rounding(self.leaves.shape[-1]) * totals)


class ElementSeries(Protocol):
    """Elements whose maps and fields have series on any box of their cubes."""

    @property
    def finite(self) -> Bools:
        """(n,) which of them have only finite numbers."""

    def boxes(self, rows: Ints, centre: Floats, half: float) -> ModelBoxes:
        """The box with this centre (3,) and half side in some elements."""


@dataclass(frozen=True, eq=False)
class ShapeFacets:
    """The half spaces (k, 4) whose intersection is the shape of the elements in their cubes."""

    facets: Floats

    def holds(self, centre: Floats, half: Floats) -> Bools:
        """(n,) whether boxes may meet the shape."""
        normal, offset = self.facets[:, :3], self.facets[:, 3]
        farthest = centre @ normal.T + half[:, None] * np.abs(normal).sum(axis=1) + offset
        return np.asarray((farthest >= -1e-9).all(axis=1))


@dataclass(frozen=True, eq=False)
class SeriesBoxes:
    """Boxes that may hold a level, with series of one degree for x, y, z and the quantity.

    element    (n,) rows of elements
    centre     (n, 3), half (n,) in the coordinates of the elements' cubes
    series     (n, 4, degree + 1 three times) Chebyshev coefficients in x = s / ROOM
    misfit     (n, ORDERS) bounds, for |s| <= REACH, of the error of the series of the quantity, and of its derivatives
               in s
    error      (n,) maximum error of computed values of the quantity
    places     (n,) maximum error of computed positions in the world
    (m,) rows of elements without a model
    """

    element: Ints
    centre: Floats
    half: Floats
    series: Floats
    misfit: Floats
    error: Floats
    places: Floats
    unmodelled: Ints

    def __len__(self) -> int:
        return len(self.element)


def in_batches(boxes: ModelBoxes, count: int) -> Iterator[ModelBoxes]:
    """Boxes, at most ``count`` at a time."""
    for first in range(0, len(boxes), count):
        yield boxes.part(np.arange(first, min(first + count, len(boxes))))


def joined(parts: list[ModelBoxes]) -> ModelBoxes:
    """The boxes of several."""
    return ModelBoxes(*(np.concatenate([getattr(part, own.name) for part in parts]) for own in fields(ModelBoxes)))


def half_along(series: Floats, axis: int, side: int) -> Floats:
    """Series (..., n, n, n) on the half of their boxes on one side along an axis."""
    matrix = to_half(series.shape[-1], side)
    if axis == 0:
        return np.asarray(np.matmul(series, matrix.T))
    if axis == 1:
        return np.asarray(np.matmul(matrix, series))
    # sizes in full, as there may be no series
    flat = np.matmul(matrix, series.reshape(*series.shape[:-2], series.shape[-2] * series.shape[-1]))
    return np.asarray(flat.reshape(series.shape))


def restricted(series: Floats, sides: tuple[int, int, int]) -> Floats:
    """Series (..., n, n, n) on one eighth of their boxes."""
    count = series.shape[-1]
    return along_axes(series, *(to_half(count, side) for side in sides))


@dataclass(frozen=True, eq=False)
class LevelSearch:
    """Settings of a search for a level of a quantity.

    root    the expression
    names   of the fields of the leaves
    errors  (elements, 3 + fields) maximum error of computed values of leaves
    inside  the shape
    degree  degree of local series, at least the degree of the map
    """

    root: Node
    names: tuple[str, ...]
    errors: Floats
    inside: ShapeFacets
    degree: int

    def find(self, elements: ElementSeries, level: float) -> SeriesBoxes:
        """The boxes of elements that may hold a level."""
        finite = elements.finite
        found = [self._none(np.flatnonzero(~finite))]
        rows = np.flatnonzero(finite)
        # infinite remainders become NaN when combined; neither ever counts as small
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            halvings, count = self._plan(elements, rows) if len(rows) else _PLANS[0]
            for some in np.array_split(rows, -(-len(rows) // _AT_ONCE)) if len(rows) else []:
                for centre in self._centres(halvings):
                    boxes = elements.boxes(some, centre, 0.5**halvings)
                    found.extend(self._search(boxes, level, count, _MOST_MORE_HALVINGS))
        return _together(found)

    def _centres(self, halvings: int) -> Floats:
        """(m, 3) centres of the boxes of a bisected cube that may lie in the shape."""
        count = 2**halvings
        line = (2.0 * np.arange(count) + 1.0) / count - 1.0
        centres = np.stack(np.meshgrid(line, line, line), axis=-1).reshape(-1, 3)
        return centres[self.inside.holds(centres, np.full(len(centres), 1.0 / count))]

    def _plan(self, elements: ElementSeries, rows: Ints) -> tuple[int, int]:
        """Halvings of elements' boxes and nodes of a line with which most models of some elements are good enough."""
        tried = rows[np.unique(np.linspace(0, len(rows) - 1, _TRIED).astype(np.int64))]
        # the first eighth is within all shapes, others meet them at least
        sides = np.random.default_rng(1).choice((-1, 1), size=(max(_PLANS)[0], 3))
        sides[0] = -1
        good = []
        for halvings, count in _PLANS:
            centre = 0.5 ** np.arange(1, halvings + 1) @ sides[:halvings]
            boxes = elements.boxes(tried, centre, 0.5**halvings)
            good.append(self._models(boxes, count).is_good.mean())
            if good[-1] == 1.0:
                break
        # no plan suits singular maps
        return _PLANS[int(np.argmax(np.array(good) >= _MOST_OF_THEM * max(good)))]

    def _search(self, boxes: ModelBoxes, level: float, count: int, halvings: int) -> Iterator[SeriesBoxes]:
        """The boxes that may hold the level among some of one size and their parts."""
        for some in in_batches(boxes, _AT_ONCE):
            models = self._models(some, count)
            yield from self._local(models.part(models.is_good), level, 0)
            rest = some.part(~models.is_good & models.may_hold(level))
            if halvings and len(rest):
                yield from self._search(rest.eighths(self.inside), level, count, halvings - 1)
            elif len(rest):
                yield self._none(np.unique(rest.element))

    def _models(self, boxes: ModelBoxes, count: int) -> _ModelledBoxes:
        """The models of the quantity on boxes of one size."""
        scale = 1.0 / (ROOM * boxes.half[0])
        errors = self.errors[boxes.element]
        narrow = boxes.half[0] / boxes.wide[0]
        leaves = BoxLeaves(self.names, boxes.leaves, errors, boxes.off, narrow, boxes.rounding, scale, count)
        model = model_of(self.root, leaves)
        # values at the nodes are rounded, so the series has an error polynomial of its degree
        steep = np.array([steepness(count, order) for order in range(ORDERS)])
        off = amplification(count) * model.error + transform_rounding(count) * model.sizes[0]
        rounding = np.outer(steep, off)
        return _ModelledBoxes(boxes.of_map(), model.coefficients, model.remainder + rounding, model.error)

    def _local(self, models: _ModelledBoxes, level: float, halvings: int) -> Iterator[SeriesBoxes]:
        """Series of low degree on the parts of models that may hold the level."""
        models = models.part(models.may_hold(level))
        if not len(models.boxes):
            return
        misfit = models.misfit(self.degree)
        small = np.maximum(_PIXELS * misfit[0], misfit[1]) <= _LOCAL_PART * models.range
        done = small if halvings < _MOST_LOCAL_HALVINGS else np.ones(len(small), bool)
        if done.any():
            yield models.part(done).as_series_boxes(self.degree, misfit[:, done])
        rest = models.part(~done)
        if len(rest.boxes):
            yield from self._local(rest.eighths(self.inside, level), level, halvings + 1)

    def _none(self, unmodelled: Ints | None = None) -> SeriesBoxes:
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
            np.zeros(0, np.int64) if unmodelled is None else unmodelled,
        )


@dataclass(frozen=True, eq=False)
class _ModelledBoxes:
    """Boxes with the series of a quantity.

    coefficients  (n, count, count, count) of the quantity's series
    remainder     (ORDERS, n) bounds of its error, and of the error's derivatives in x
    error         (n,) maximum error of computed values of the quantity
    """

    boxes: ModelBoxes
    coefficients: Floats
    remainder: Floats
    error: Floats

    def part(self, rows: Ints | Bools) -> _ModelledBoxes:
        """Some of the boxes."""
        return _ModelledBoxes(self.boxes.part(rows), self.coefficients[rows], self.remainder[:, rows], self.error[rows])

    @property
    def range(self) -> Floats:
        """(n,) how far the series goes from its mean."""
        flat = np.abs(self.coefficients).reshape(len(self.coefficients), self.coefficients.shape[-1] ** 3)
        return np.asarray(flat[:, 1:].sum(axis=1))

    @property
    def is_good(self) -> Bools:
        """(n,) whether the error of the series is small compared to its range, or is rounding."""
        lacking = np.maximum(_PIXELS * self.remainder[0], self.remainder[1])
        count = self.coefficients.shape[-1]
        rounding = amplification(count) * self.error * max(_PIXELS, steepness(count, 1))
        return np.asarray(lacking <= np.maximum(_MODEL_PART * self.range, 2.0 * rounding))

    def may_hold(self, level: float) -> Bools:
        """(n,) whether the quantity may have the level in a box."""
        mean = self.coefficients[:, 0, 0, 0]
        return np.asarray(~(np.abs(mean - level) > self.range + self.remainder[0] + self.error))

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
        found = _ModelledBoxes(boxes, found.coefficients, remainder, found.error)
        return found.part(inside.holds(boxes.centre, boxes.half))

    def _halves(self, axis: int, level: float) -> _ModelledBoxes:
        """Halves along an axis that may hold a level; the sizes are not updated."""
        total = self.range + np.abs(self.coefficients[:, 0, 0, 0])
        error = self.error + 2.0 * sum_rounding(self.coefficients.shape[-1]) * total
        parts = []
        for side in (-1, 1):
            half = _ModelledBoxes(self.boxes, half_along(self.coefficients, axis, side), self.remainder, error)
            half = half.part(half.may_hold(level))
            parts.append(replace(half, boxes=half.boxes.moved(axis, side)))
        return _ModelledBoxes(
            joined([part.boxes for part in parts]),
            np.concatenate([part.coefficients for part in parts]),
            np.concatenate([part.remainder for part in parts], axis=1),
            np.concatenate([part.error for part in parts]),
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
        return SeriesBoxes(
            boxes.element, boxes.centre, boxes.half, series, in_box, error, places, np.zeros(0, np.int64)
        )


def _together(found: list[SeriesBoxes]) -> SeriesBoxes:
    """The boxes of several searches."""
    return SeriesBoxes(
        np.concatenate([part.element for part in found]),
        np.concatenate([part.centre for part in found]),
        np.concatenate([part.half for part in found]),
        np.concatenate([part.series for part in found]),
        np.concatenate([part.misfit for part in found]),
        np.concatenate([part.error for part in found]),
        np.concatenate([part.places for part in found]),
        np.unique(np.concatenate([part.unmodelled for part in found])),
    )
