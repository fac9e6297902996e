"""Certified ranges of expressions: interval arithmetic on Bernstein bounds of fields, map and derivatives.

Elements that may hold an extreme are bisected, as in `elvis.core.bounds.ranges`; the gap shrinks
with the size of the boxes.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_floats
from elvis.core.bounds.ranges import Range, deciding, field_range, finite_rows
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.quantities.cells import Cells
from elvis.core.quantities.elements.sides import SIDES, places_on_sides
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.largest_radii import largest_radii
from elvis.core.quantities.tree import Node, negative
from elvis.core.shapes import Shape

_ROUNDS = 6
#: tolerance for an end of the range, relative to the known range
_TOLERANCE = 5e-3
_NUMBERS = 1 << 20
#: number of elements that are examined closely
_MOST = 1 << 9
#: sample points along each direction of an element if there are no values at its centre and corners
_CLOSER = 8


def quantity_range(dataset: Dataset, expression: Expression) -> Range | None:
    """lower <= value <= upper wherever there is a value, to rounding; None if there are no elements or no values.

    ``minimum`` and ``maximum`` are values that are attained.  Ends are infinite if nothing is known: for expressions
    with poles or second derivatives, and for derivatives on surfaces in space and in quasi-3D data.  Ends of converted
    data include the error of the conversion, an estimate, where it is known.
    """
    found = _own_range(dataset, expression)
    return found and found.widened(float(largest_radii(dataset, [expression])[0]))


def _own_range(dataset: Dataset, expression: Expression) -> Range | None:
    """The range of a quantity of the data without widening for conversion errors."""
    if expression.is_field:
        return field_range(dataset.field(expression.root.name).blocks)
    evaluator = Evaluator(dataset, [expression])
    if any(patch.homogeneous for patch in evaluator.patches):
        return _sampled(evaluator, expression)[0]
    search = _Search(evaluator, expression)
    if not np.isfinite(search.maximum):
        return None
    upper, lower = search.bound(1), 0.0 - search.bound(-1)
    return Range(min(lower, search.minimum), max(upper, search.maximum), search.minimum, search.maximum)


def is_between_values(dataset: Dataset, expression: Expression, value: float) -> bool:
    """Whether a value lies between two that a quantity attains at some points: much quicker than `quantity_range`."""
    evaluator = Evaluator(dataset, [expression])
    if expression.is_field or any(patch.homogeneous for patch in evaluator.patches):
        return False
    search = _Search(evaluator, expression)
    return bool(search.minimum <= value <= search.maximum)


def deciding_elements(dataset: Dataset, expression: Expression) -> Ints:
    """(n,) ids of elements that may hold an end of the range: these elements give the same `quantity_range` as all."""
    if expression.is_field:
        return deciding(dataset.field(expression.root.name).blocks)
    evaluator = Evaluator(dataset, [expression])
    # and the first of each patch, so that patches keep one order
    found = [np.empty(0, np.int64), *(patch.element_ids[:1] for patch in evaluator.patches)]
    if any(patch.homogeneous for patch in evaluator.patches):
        found.append(_sampled(evaluator, expression)[1])
    else:
        found.append(_Search(evaluator, expression).deciding())
    return np.unique(np.concatenate(found))


class _Search:
    """The elements that have an expression; extrema that are known to be attained."""

    def __init__(self, evaluator: Evaluator, expression: Expression) -> None:
        self.evaluator, self.expression = evaluator, expression
        self.with_gradients = expression.order > 0 or any("jacobian" in name for name in expression.attributes)
        self.minimum, self.maximum = np.inf, -np.inf
        self._holders: dict[int, int] = {}  # of the largest value, 1, and of the smallest, -1: ids of elements
        self.whole = [(patch, rows) for patch in evaluator.patches for rows in self._batches(patch)]
        for patch, rows in self.whole:
            for place in self._places(patch.shape):
                self._attain(patch, rows, np.tile(place, (len(rows), 1)))
        if not np.isfinite(self.maximum):
            self._look_closer()

    def _look_closer(self) -> None:
        """Sample many points, for expressions that have values only in a small part of the elements."""
        for patch, rows in self.whole:
            line = np.linspace(-0.9, 0.9, _CLOSER)
            eta = np.stack(np.meshgrid(*[line] * patch.shape.dimension, indexing="ij"), axis=-1)
            for place in uncollapse(patch.shape, eta.reshape(-1, patch.shape.dimension)):
                self._attain(patch, rows, np.tile(place, (len(rows), 1)))

    def _places(self, shape: Shape) -> Floats:
        """(k, d) reference points where values are tried first."""
        if set(SIDES) & set(self.expression.attributes):
            return places_on_sides(shape)
        middle = shape.vertices.mean(axis=0, keepdims=True)
        return np.concatenate([middle, middle + 0.999 * (shape.vertices - middle)])

    def _batches(self, patch: Patch) -> Iterator[Ints]:
        """Rows of elements with all fields, numbers in all, a batch at a time."""
        needed = [(e, c) for e, c in zip(patch.fields, patch.coefficients, strict=True)]
        if any(expansion is None for expansion, _ in needed):
            return
        good = finite_rows(patch.geometry_coefficients.reshape(len(patch), -1))
        for _, coefficients in needed:
            good &= finite_rows(coefficients) if coefficients is not None else True
        rows = np.flatnonzero(good)
        size = sum(np.prod([m + 1 for m in e.modes]) for e, _ in needed if e) + 3 * np.prod(
            np.add(patch.geometry.modes, 1)
        )
        for part in chunks(len(rows), max(1, int(_NUMBERS / (4 * size)))):
            yield rows[part]

    def _attain(self, patch: Patch, rows: Ints, reference: Floats) -> None:
        values = self.evaluator.values(self.expression, patch, rows, reference)
        finite = np.flatnonzero(np.isfinite(values))
        if not len(finite):
            return
        low, high = (finite[which(values[finite])] for which in (np.argmin, np.argmax))
        if values[low] < self.minimum:
            self.minimum, self._holders[-1] = float(values[low]), int(patch.element_ids[rows[low]])
        if values[high] > self.maximum:
            self.maximum, self._holders[1] = float(values[high]), int(patch.element_ids[rows[high]])

    def deciding(self) -> Ints:
        """See `deciding_elements`."""
        found = [np.array([*self._holders.values()], np.int64)]
        for sign in (1, -1) if self.expression.order < 2 else ():
            rivals = self._rivals(sign, self.maximum if sign > 0 else -self.minimum)
            ids = np.concatenate([found[0][:0], *(patch.element_ids[rows] for patch, rows, _ in rivals)])
            uppers = joined_floats(upper for _, _, upper in rivals)
            # up to one more than are examined closely, whose bound covers the others
            found.append(ids[np.argsort(-uppers, kind="stable")[: _MOST + 1]])
        return np.concatenate(found)

    def _rivals(self, sign: int, attained: float) -> list[tuple[Patch, Ints, Floats]]:
        """Elements whose bound of the expression (1) or its negative (-1) exceeds the attained value, with bounds."""
        rivals: list[tuple[Patch, Ints, Floats]] = []
        for patch, rows, (low, high) in self._first:
            upper = high if sign > 0 else -low
            rival = np.flatnonzero(~(upper <= attained) & ~np.isnan(upper))
            rivals.append((patch, rows[rival], upper[rival]))
        return rivals

    @cached_property
    def _first(self) -> list[tuple[Patch, Ints, Interval]]:
        """Bounds on whole elements."""
        root = self.expression.root
        return [(patch, rows, self._cells(patch, rows).bounds(root)) for patch, rows in self.whole]

    def bound(self, sign: int) -> float:
        """An upper bound of the expression (1) or of its negative (-1)."""
        if self.expression.order > 1:
            return np.inf
        root = self.expression.root if sign > 0 else negative(self.expression.root)
        attained = self.maximum if sign > 0 else -self.minimum
        rivals = self._rivals(sign, attained)
        tops = np.sort(joined_floats(upper for _, _, upper in rivals))[::-1]
        threshold = tops[_MOST] if len(tops) > _MOST else -np.inf
        forgotten = max(attained, threshold)
        # elements of a patch together, so that the result doesn't depend on batches
        for patch in self.evaluator.patches:
            own = [rows[upper > threshold] for other, rows, upper in rivals if other is patch]
            if sum(map(len, own)):
                forgotten = max(forgotten, self._refine(root, self._cells(patch, np.concatenate(own)), attained))
        return forgotten

    def _cells(self, patch: Patch, rows: Ints) -> Cells:
        return Cells.of(patch, self.evaluator.names, self.evaluator.attributes, rows, self.with_gradients)

    def _refine(self, root: Node, cells: Cells, attained: float) -> float:
        """The largest bound of boxes that are no longer worth halving."""
        forgotten = -np.inf
        for number in range(_ROUNDS):
            cells = cells.halves()
            upper = cells.bounds(root)[1]
            self._attain(cells.patch, cells.rows, uncollapse(cells.patch.shape, (cells.low + cells.high) / 2))
            best = self.maximum if root is self.expression.root else -self.minimum
            goal = max(best, attained) + _TOLERANCE * (self.maximum - self.minimum)
            order = np.argsort(-upper)
            most = max(16, _NUMBERS // (8 * sum(net[0].size for net in cells.nets.values())))
            worth = upper > goal
            worth[order[most:]] = False
            rest = upper[~worth]
            forgotten = max(forgotten, float(np.nanmax(rest, initial=-np.inf)))
            kept = np.flatnonzero(worth)
            if not len(kept) or (number > 1 and upper.max() == np.inf):
                return max(forgotten, float(upper[kept].max(initial=-np.inf)))
            cells = cells.part(kept)
        return max(forgotten, float(np.nanmax(cells.bounds(root)[1])))


def _sampled(evaluator: Evaluator, expression: Expression) -> tuple[Range | None, Ints]:
    """The range attained at some points, without bounds, and ids (n,) of elements that attain it."""
    values, owners = [np.empty(0)], [np.empty(0, np.int64)]
    for patch in evaluator.patches:
        rows = np.arange(len(patch))
        for zeta in np.linspace(-0.9, 0.9, 8):
            points = np.column_stack(
                [patch.shape.vertices * 0.9, np.full((len(patch.shape.vertices), len(patch.periods)), zeta)]
            )
            for point in points:
                own = evaluator.values(expression, patch, rows, np.tile(point, (len(rows), 1)))
                is_finite = np.isfinite(own)
                values.append(own[is_finite])
                owners.append(patch.element_ids[is_finite])
    every, ids = np.concatenate(values), np.concatenate(owners)
    if not len(every):
        return None, ids
    ends = np.array([every.argmin(), every.argmax()])
    least, greatest = every[ends].tolist()
    return Range(-np.inf, np.inf, least, greatest), ids[ends]
