"""Minimum and maximum of any quantity over all elements, with their positions, by branch and bound.

A quantity that is a polynomial on elements is bounded by its own Bernstein nets, as a field is; monotone functions of a
polynomial, such as a root, use the nets of their argument.  Everything else is bounded by interval arithmetic on boxes,
which are bisected.  These bounds converge with the size of the boxes, not with its square, so the remaining gap may be
wider.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_floats
from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.bounds.extrema import Chosen, Extremum, Nets, chosen, deciding_extrema, extrema, greatest_of, ids_of
from elvis.core.bounds.single_field_extrema import best_argument, point_with_value, single_field, values
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.reference_cells import Piece
from elvis.core.mapping import pointwise
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.portions.portion import Portion, unite
from elvis.core.quantities.cells import Cells
from elvis.core.quantities.elements.points import ElementPoints, Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.expression_nets import degree_on, lattice_of, rounded_nets
from elvis.core.quantities.functions import function
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.largest_radii import largest_radii
from elvis.core.quantities.tree import Node, negative

#: functions that grow with their operand
_GROWING = ("sqrt", "exp", "log", "sinh", "tanh", "atan")
#: numbers in nets of all elements at most
_MOST = 1 << 27
#: maximum bisections, boxes and elements at once, and the tolerated gap relative to the value
_ROUNDS, _MANY, _ELEMENTS, _CLOSE = 16, 1 << 8, 1 << 10, 1e-12
#: halvings after which bounds that are still infinite are given up
_HOPEFUL = 3


def quantity_extrema(dataset: Dataset, expression: Expression) -> tuple[Extremum, Extremum]:
    """The smallest and the largest value of a quantity; bounds are infinite if nothing is known.

    Bounds of converted data include the error of the conversion, which is an estimate.  Raises ElvisError if no element
    has a value, and for data with Fourier directions.
    """
    return _widened(_extrema(dataset, expression), float(largest_radii(dataset, [expression])[0]))


def _widened(ends: tuple[Extremum, Extremum], radius: float) -> tuple[Extremum, Extremum]:
    """Extrema with bounds that hold for values with an error of at most the radius."""
    least, greatest = ends
    return replace(least, bound=least.bound - radius), replace(greatest, bound=greatest.bound + radius)


def _extrema(dataset: Dataset, expression: Expression) -> tuple[Extremum, Extremum]:
    """The extrema of a quantity of the data without widening for conversion errors."""
    if expression.is_field:
        return extrema(dataset, expression.root.name)
    own = _Quantity.of(dataset, expression)
    name = single_field(expression.root)
    if name is not None:
        found = _of_single_field(own, extrema(dataset, name.name), ALONE, expression.text)
        if found is not None:
            return found
    return (_of_polynomial(own) if _are_polynomials([own.numbers]) else None) or _of_any(own)


def shared_extrema(part: Portion, quantities: Sequence[Expression], ranks: Ranks) -> list[tuple[Extremum, Extremum]]:
    """The extrema of quantities on data divided among several ranks; empty except at the first rank.

    Elements of all parts that may determine the extrema are sent there.
    """
    radii = ranks.exchange(largest_radii(part.dataset, quantities), "errors of conversions")
    found = [_shared(part, each, ranks) for each in quantities]
    pairs = zip(found, np.max(radii, axis=0).tolist(), strict=True)
    return [_widened(each, radius) for each, radius in pairs if each is not None]


def _shared(part: Portion, expression: Expression, ranks: Ranks) -> tuple[Extremum, Extremum] | None:
    """The extrema of one quantity; None elsewhere than at the first rank."""
    task = f"extrema of {expression.text}"
    if expression.is_field:
        name = expression.root.name
        whole = _gathered(part, deciding_extrema(part.dataset, name), ranks, task)
        return None if whole is None else extrema(whole, name)
    own = _Quantity.of(part.dataset, expression)
    argument = single_field(expression.root)
    if argument is not None:
        whole = _gathered(part, deciding_extrema(part.dataset, argument.name), ranks, task)
        ends = ranks.exchange(None if whole is None else extrema(whole, argument.name), task)[0]
        assert ends is not None
        found = _of_single_field(own, ends, ranks, task)
        if found is not None:
            return None if ranks.rank else found
    if _are_polynomials(ranks.exchange(own.numbers, task)):
        ids = _deciding_polynomial(own)
        if all(ranks.exchange(ids is not None, task)) and ids is not None:
            whole = _gathered(part, ids, ranks, task)
            found = None if whole is None else _of_polynomial(_Quantity.of(whole, expression))
            if ranks.exchange(found is not None, task)[0]:
                return found
    whole = _gathered(part, _deciding_any(own), ranks, task)
    return None if whole is None else _of_any(_Quantity.of(whole, expression))


def _gathered(part: Portion, ids: Ints, ranks: Ranks, task: str) -> Dataset | None:
    """The elements (n,) of all parts, with what distances are measured to; None elsewhere than at the first rank."""
    every = ranks.gather(part.of(ids).alone, task)
    return replace(unite(every).dataset, surfaces=part.dataset.surfaces) if every else None


@dataclass(frozen=True, eq=False)
class _Quantity:
    """A quantity on those patches of a dataset that have all its fields."""

    expression: Expression
    evaluator: Evaluator
    held: tuple[Patch, ...]

    @staticmethod
    def of(dataset: Dataset, expression: Expression) -> _Quantity:
        """The quantity on a dataset; raises ElvisError with Fourier directions."""
        evaluator = Evaluator(dataset, [expression])
        held = tuple(patch for patch in evaluator.patches if None not in patch.fields and len(patch))
        if any(patch.homogeneous for patch in held):
            raise ElvisError(f"{expression.text}: expected data without Fourier directions, to bound it")
        return _Quantity(expression, evaluator, held)

    @cached_property
    def outer(self) -> tuple[Node, ...]:
        """The monotone functions around the inner expression, the outermost first."""
        found = [self.expression.root]
        while found[-1].op in _GROWING:
            found.append(found[-1].operands[0])
        return tuple(found[:-1])

    @cached_property
    def inner(self) -> Expression:
        """The argument of the innermost monotone function."""
        return Expression(self.expression.text, self.outer[-1].operands[0] if self.outer else self.expression.root)

    @cached_property
    def degrees(self) -> list[int | None]:
        """Degree of the inner expression on each patch, at least 1; None if it is not a polynomial."""
        has_slopes = self.inner.order > 0
        found = [
            degree_on(self.inner, self.evaluator, patch, not has_slopes or _is_affine(patch)) for patch in self.held
        ]
        return [degree if degree is None else max(degree, 1) for degree in found]

    @cached_property
    def numbers(self) -> int | None:
        """Number of coefficients in the nets of the inner expression, if it is a polynomial on all elements."""
        sizes = [
            None if degree is None else len(patch) * (degree + 1) ** patch.shape.dimension
            for patch, degree in zip(self.held, self.degrees, strict=True)
        ]
        known = [size for size in sizes if size is not None]
        return sum(known) if len(known) == len(sizes) else None

    @cached_property
    def chosen(self) -> list[Chosen]:
        """The elements that determine the extrema of the inner expression, with nets, which must be finite.

        Raises _NotFinite otherwise.
        """

        def nets_on(patch: Patch, rows: Ints) -> Nets:
            own = rounded_nets(self.inner, self.evaluator, patch, rows)
            if not np.isfinite(own.nets).all():
                raise _NotFiniteError
            return Nets(own.nets, own.slack)

        sizes = [(degree or 1) + 1 for degree in self.degrees]
        return [
            chosen(len(patch), partial(nets_on, patch), size**patch.shape.dimension)
            for patch, size in zip(self.held, sizes, strict=True)
        ]


class _NotFiniteError(Exception):
    """Nets are not finite."""


def _are_polynomials(numbers: Sequence[int | None]) -> bool:
    """Whether a quantity is a polynomial on the elements of all parts, with nets of these sizes."""
    known = [own for own in numbers if own is not None]
    return len(known) == len(numbers) and 0 < sum(known) <= _MOST


def _deciding_polynomial(own: _Quantity) -> Ints | None:
    """(n,) ids of elements that determine the extrema of a polynomial; None if nets are not finite."""
    try:
        return ids_of(own.held, [some.rows for some in own.chosen])
    except _NotFiniteError:
        return None


def _of_polynomial(own: _Quantity) -> tuple[Extremum, Extremum] | None:
    """The extrema of a polynomial, or of functions that grow with one; None if they have no values there."""
    try:
        least, greatest = (greatest_of(own.chosen, sign) for sign in (-1, 1))
    except _NotFiniteError:
        return None
    interval: Interval = (np.array([-least.bound]), np.array([greatest.bound]))
    with np.errstate(all="ignore"):
        for node in own.outer[::-1]:
            interval = function(node).interval(interval)
    found = []
    for best, sign, bound in ((least, -1, interval[0]), (greatest, 1, interval[1])):
        patch, row = own.held[best.number], np.array([best.row])
        reference = uncollapse(patch.shape, best.eta[None])
        value = float(own.evaluator.values(own.expression, patch, row, reference)[0])
        found.append(_extreme(patch, best.row, reference, sign * value, sign * float(bound[0]), sign))
    return (found[0], found[1]) if all(np.isfinite(end.value) for end in found) else None


def _extreme(patch: Patch, row: int, reference: Floats, value: float, bound: float, sign: int) -> Extremum:
    """The extremum of a quantity with ``sign`` times it maximal at a reference point (1, d)."""
    x, y, z = map(float, pointwise.positions(patch, np.array([row]), reference)[0])
    return Extremum(sign * value, sign * max(bound, value), (x, y, z), int(patch.element_ids[row]))


def _of_single_field(
    own: _Quantity, ends: tuple[Extremum, Extremum], ranks: Ranks, task: str
) -> tuple[Extremum, Extremum] | None:
    """The extrema of a function of one field with known extrema; None if a point with the best value isn't found."""
    least, greatest = (_of_argument(own, ends, sign, ranks, task) for sign in (-1, 1))
    return None if least is None or greatest is None else (least, greatest)


def _of_argument(
    own: _Quantity, ends: tuple[Extremum, Extremum], sign: int, ranks: Ranks, task: str
) -> Extremum | None:
    """The place of the maximum of ``sign`` times a function of one field, with the value there and the bound."""
    root = own.expression.root
    best = best_argument(root, ends, sign)
    if best is None:
        return None
    for end in ends:
        if best.argument == end.value:
            return replace(end, value=sign * best.value, bound=sign * best.bound)
    every = ranks.exchange(point_with_value(own.held, best.argument), task)
    points = [point for point in every if point is not None]
    if not points:
        return None
    point = min(points, key=lambda each: each.element)
    value = float(values(root, np.array([point.value]))[0])
    return Extremum(value, sign * max(best.bound, sign * value), point.position, point.element)


def _of_any(own: _Quantity) -> tuple[Extremum, Extremum]:
    """The extrema of any quantity; raises ElvisError without values."""
    least, greatest = (search.found() for search in _searches(own))
    return least, greatest


def _deciding_any(own: _Quantity) -> Ints:
    """(n,) ids of elements that determine these extrema."""
    searches = _searches(own)
    rows = [np.concatenate([search.rows_of(number) for search in searches]) for number in range(len(own.held))]
    return ids_of(own.held, rows)


def _searches(own: _Quantity) -> tuple[_Search, _Search]:
    """Searches for the smallest and the largest value that have seen all elements, batch by batch."""
    searches = _Search(own, -1), _Search(own, 1)
    for number, patch in enumerate(own.held):
        corners = np.vstack([patch.shape.vertices, patch.shape.centre])
        for part in chunks(len(patch), _ELEMENTS):
            rows = np.arange(len(patch))[part]
            places = Lattice(patch, rows, corners)
            (values,) = own.evaluator.values_at([own.expression], places)
            cells = _cells(own, patch, rows)
            for search in searches:
                search.attain(number, places, np.broadcast_to(values, len(places)))
                search.note(number, cells)
    return searches


def _cells(own: _Quantity, patch: Patch, rows: Ints) -> Cells:
    """Boxes of whole elements."""
    has_slopes = own.expression.order > 0 or any("jacobian" in name for name in own.expression.attributes)
    return Cells.of(patch, own.evaluator.names, own.evaluator.attributes, rows, has_slopes)


@dataclass(frozen=True, eq=False)
class _Part:
    """Boxes of elements of a patch, with upper bounds (n,) for the values on them."""

    number: int
    cells: Cells
    upper: Floats


class _Search:
    """The maximum of ``sign`` times a quantity, by interval arithmetic.

    The result depends on the element with the largest value at corners and centres, and on the elements with the
    largest bounds.  There is one more of these than are examined closely; its bound covers the elements not examined.
    If values are equal, the first element's counts, so the result does not depend on which elements are examined
    together.
    """

    def __init__(self, own: _Quantity, sign: int) -> None:
        self._own, self._sign = own, sign
        self._root = own.expression.root if sign > 0 else negative(own.expression.root)
        self._value, self._bound = -np.inf, -np.inf
        self._place: tuple[int, int, Floats] | None = None
        # of the elements with the largest bounds: these, the numbers of their patches, their rows
        self._upper, self._numbers, self._rows = np.empty(0), np.empty(0, np.int64), np.empty(0, np.int64)

    def attain(self, number: int, places: ElementPoints, values: Floats) -> None:
        """Update the best value and its position from values (n,) at points of a patch."""
        values = self._sign * values
        values = np.where(np.isfinite(values), values, -np.inf)
        best = int(values.argmax())
        if values[best] > self._value:
            self._value, row = float(values[best]), int(places.rows[best])
            self._place = number, row, places.points[best : best + 1]

    def note(self, number: int, cells: Cells) -> None:
        """Update the list of elements with the largest bounds from a patch."""
        upper = np.concatenate([self._upper, self._bounds(cells)])
        numbers = np.concatenate([self._numbers, np.full(len(cells), number)])
        rows = np.concatenate([self._rows, cells.rows])
        most = np.sort(np.argsort(-upper, kind="stable")[: _MANY + 1])
        self._upper, self._numbers, self._rows = upper[most], numbers[most], rows[most]

    def rows_of(self, number: int) -> Ints:
        """(n,) rows of a patch that it depends on."""
        rows = self._rows[self._numbers == number]
        is_here = self._place is not None and self._place[0] == number
        return np.append(rows, self._place[1]) if self._place is not None and is_here else rows

    def found(self) -> Extremum:
        """The extremum; raises ElvisError without values."""
        open_parts = self._kept(list(self._whole()))
        for depth in range(_ROUNDS):
            if not open_parts or (depth > _HOPEFUL and any(np.isinf(part.upper).any() for part in open_parts)):
                break
            open_parts = self._kept([self._halved(part) for part in open_parts])
        bound = max([self._bound, *(float(part.upper.max()) for part in open_parts)])
        if self._place is None:
            text = self._own.expression.text
            raise ElvisError(f"expected elements of the domain with a value of {text}, found none")
        number, row, reference = self._place
        return _extreme(self._own.held[number], row, reference, self._value, bound, self._sign)

    def _whole(self) -> Iterator[_Part]:
        """The elements with the largest bounds."""
        for number, patch in enumerate(self._own.held):
            here = self._numbers == number
            if here.any():
                yield _Part(number, _cells(self._own, patch, self._rows[here]), self._upper[here])

    def _halved(self, part: _Part) -> _Part:
        """Halves of boxes, at whose middles and corners values are tried."""
        cells, patch = part.cells.halves(), part.cells.patch
        for share in np.vstack(
            [np.full(cells.low.shape[1], 0.5), lattice_of(np.array([0.0, 1.0]), cells.low.shape[1])]
        ):
            eta = cells.low + share * (cells.high - cells.low)
            places = ElementPoints(patch, cells.rows, uncollapse(patch.shape, eta))
            values = self._own.evaluator.values(self._own.expression, patch, places.rows, places.points)
            self.attain(part.number, places, values)
        return _Part(part.number, cells, self._bounds(cells))

    def _bounds(self, cells: Cells) -> Floats:
        """(n,) upper bounds for the values on boxes; -inf if a box has no values."""
        if self._own.expression.order > 1:
            return np.full(len(cells), np.inf)
        upper = cells.bounds(self._root)[1]
        return np.where(np.isnan(upper), -np.inf, upper)

    def _kept(self, parts: Sequence[_Part]) -> list[_Part]:
        """Boxes that may hold a larger value, the most promising ones; the rest enters the bound."""
        every = joined_floats(part.upper for part in parts)
        least = self._value + _CLOSE * abs(self._value)
        if (every > least).sum() > _MANY:
            least = max(least, float(np.partition(every, -_MANY)[-_MANY]))
        self._bound = max(self._bound, float(every[every <= least].max(initial=-np.inf)))
        is_open = [(part, part.upper > least) for part in parts]
        return [_Part(part.number, part.cells.part(own), part.upper[own]) for part, own in is_open if own.any()]


def _is_affine(patch: Patch) -> bool:
    """Whether the maps of all elements are."""
    every = (Piece(patch, np.arange(len(patch))[some], patch.shape) for some in chunks(len(patch), _ELEMENTS))
    return all(bool(piece.is_affine.all()) for piece in every)
