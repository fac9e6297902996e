"""The least and the greatest value of any quantity over all elements, with their places, by branch and bound.

What is a polynomial on elements is bounded by its own Bernstein nets, as a field is; so is what grows with one, as a
root does with what is below it.  Everything else is bounded by interval arithmetic on boxes, which are halved: these
bounds come down with the size of the boxes, not with its square, so that a wider gap may be left.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.core.extrema import Extreme, Nets, deciding_extrema, extrema, greatest_of_nets
from elvis.core.integrals.reference_cells import Piece
from elvis.core.mapping import pointwise
from elvis.core.mapping.orientation import chunks
from elvis.core.patch import Patch
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.portions.portion import Portion, unite
from elvis.core.quantities.cells import Cells
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.expression_nets import degree_on, lattice_of, rounded_nets
from elvis.core.quantities.functions import function
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import Node, negative
from elvis.core.ranks import Ranks

#: functions that grow with their operand
_GROWING = ("sqrt", "exp", "log", "sinh", "tanh", "atan")
#: numbers in nets at most
_MOST = 1 << 27
#: halvings at most, boxes and elements at once, and the gap that is small enough, in parts of the value
_ROUNDS, _MANY, _ELEMENTS, _CLOSE = 16, 1 << 8, 1 << 10, 1e-12
#: halvings after which bounds that are still infinite are given up
_HOPEFUL = 3


def quantity_extrema(dataset: Dataset, expression: Expression) -> tuple[Extreme, Extreme]:
    """The least and the greatest value of a quantity; bounds are infinite where nothing is known.

    ElvisError where no element has a value, and for data with Fourier directions.
    """
    if expression.is_field:
        return extrema(dataset, expression.root.name)
    evaluator = Evaluator(dataset, [expression])
    held = [patch for patch in evaluator.patches if None not in patch.fields and len(patch)]
    if any(patch.homogeneous for patch in held):
        raise ElvisError(f"{expression.text}: expected data without Fourier directions, to bound it")
    found = _of_polynomial(evaluator, expression, held)
    return found or (_Search(evaluator, expression, held, -1).found(), _Search(evaluator, expression, held, 1).found())


def shared_extrema(part: Portion, fields: Sequence[Expression], ranks: Ranks) -> list[tuple[Extreme, Extreme]]:
    """The same of fields of which each of several ranks has a part; none elsewhere than at the first rank.

    Those elements of all parts that may decide them go there.
    """
    ids = [deciding_extrema(part.dataset, each.root.name) for each in fields]
    own = part.of(np.unique(np.concatenate(ids))).alone
    every = ranks.gather(own, f"extremes of {', '.join(each.text for each in fields)}")
    if not every:
        return []
    dataset = unite(every).dataset
    return [extrema(dataset, each.root.name) for each in fields]


def _of_polynomial(
    evaluator: Evaluator, expression: Expression, held: Sequence[Patch]
) -> tuple[Extreme, Extreme] | None:
    """Those of a polynomial, or of functions that grow with one; None where it is neither, or not everywhere."""
    outer: list[Node] = []
    root = expression.root
    while root.op in _GROWING:
        outer.append(root)
        root = root.operands[0]
    inner = Expression(expression.text, root)
    degrees = [degree_on(inner, evaluator, patch, _is_affine(patch)) for patch in held]
    known = [max(degree, 1) for degree in degrees if degree is not None]
    sizes = [len(patch) * (degree + 1) ** patch.shape.dimension for patch, degree in zip(held, known, strict=False)]
    if not held or len(known) < len(held) or sum(sizes) > _MOST:
        return None
    bounded = [rounded_nets(inner, evaluator, patch) for patch in held]
    nets = [Nets(own.nets, np.full(len(own.nets), own.slack)) for own in bounded]
    if not all(np.isfinite(own.values).all() for own in nets):
        return None
    least, greatest = (greatest_of_nets(nets, sign) for sign in (-1, 1))
    interval: Interval = (np.array([-least.bound]), np.array([greatest.bound]))
    with np.errstate(all="ignore"):
        for node in outer[::-1]:
            interval = function(node).interval(interval)
    found = []
    for best, sign, bound in ((least, -1, interval[0]), (greatest, 1, interval[1])):
        patch, row = held[best.number], np.array([best.row])
        reference = uncollapse(patch.shape, best.eta[None])
        value = float(evaluator.values(expression, patch, row, reference)[0])
        found.append(_extreme(patch, best.row, reference, sign * value, sign * float(bound[0]), sign))
    return (found[0], found[1]) if all(np.isfinite(end.value) for end in found) else None


def _extreme(patch: Patch, row: int, reference: Floats, value: float, bound: float, sign: int) -> Extreme:
    """The extreme of a quantity of which ``sign`` times it has a greatest value, at a reference point (1, d)."""
    x, y, z = map(float, pointwise.positions(patch, np.array([row]), reference)[0])
    return Extreme(sign * value, sign * max(bound, value), (x, y, z), int(patch.element_ids[row]))


@dataclass(frozen=True, eq=False)
class _Part:
    """Boxes of elements of a patch, with what no value on them exceeds (n,)."""

    patch: Patch
    cells: Cells
    upper: Floats


class _Search:
    """The greatest value of ``sign`` times a quantity, by interval arithmetic."""

    def __init__(self, evaluator: Evaluator, expression: Expression, held: Sequence[Patch], sign: int) -> None:
        self._evaluator, self._held, self._sign = evaluator, held, sign
        self._expression = expression
        self._root = expression.root if sign > 0 else negative(expression.root)
        self._value, self._bound = -np.inf, -np.inf
        self._place: tuple[Patch, int, Floats] | None = None

    def found(self) -> Extreme:
        """The extreme; ElvisError where there is no value."""
        open_parts = self._kept([part for patch in self._held for part in self._whole(patch)])
        for depth in range(_ROUNDS):
            if not open_parts or (depth > _HOPEFUL and any(np.isinf(part.upper).any() for part in open_parts)):
                break
            open_parts = self._kept([self._halved(part) for part in open_parts])
        bound = max([self._bound, *(float(part.upper.max()) for part in open_parts)])
        if self._place is None:
            raise ElvisError(f"expected elements of the domain with a value of {self._expression.text}, found none")
        patch, row, reference = self._place
        return _extreme(patch, row, reference, self._value, bound, self._sign)

    def _whole(self, patch: Patch) -> Iterator[_Part]:
        """All elements of a patch."""
        corners = np.vstack([patch.shape.vertices, patch.shape.vertices.mean(axis=0)])
        derivatives = self._expression.order > 0 or any("jacobian" in name for name in self._expression.attributes)
        for part in chunks(len(patch), _ELEMENTS):
            rows = np.arange(len(patch))[part]
            for corner in corners:
                self._attain(patch, rows, np.tile(corner, (len(rows), 1)))
            cells = Cells.of(patch, self._evaluator.names, self._evaluator.attributes, rows, derivatives)
            upper = self._upper(cells)
            is_open = ~(upper <= self._value)
            yield _Part(patch, cells.part(is_open), upper[is_open])

    def _halved(self, part: _Part) -> _Part:
        """Halves of boxes, at whose middles and corners values are tried."""
        cells = part.cells.halves()
        for share in np.vstack(
            [np.full(cells.low.shape[1], 0.5), lattice_of(np.array([0.0, 1.0]), cells.low.shape[1])]
        ):
            eta = cells.low + share * (cells.high - cells.low)
            self._attain(part.patch, cells.rows, uncollapse(part.patch.shape, eta))
        return _Part(part.patch, cells, self._upper(cells))

    def _upper(self, cells: Cells) -> Floats:
        """(n,) what no value on boxes exceeds; -inf where there are none."""
        if self._expression.order > 1:
            return np.full(len(cells), np.inf)
        upper = cells.bounds(self._root)[1]
        return np.where(np.isnan(upper), -np.inf, upper)

    def _attain(self, patch: Patch, rows: Ints, reference: Floats) -> None:
        values = self._sign * self._evaluator.values(self._expression, patch, rows, reference)
        values = np.where(np.isfinite(values), values, -np.inf)
        best = int(values.argmax()) if len(values) else 0
        if len(values) and values[best] > self._value:
            self._value, self._place = float(values[best]), (patch, int(rows[best]), reference[best : best + 1])

    def _kept(self, parts: Sequence[_Part]) -> list[_Part]:
        """Boxes that may hold a greater value, the most promising; what is left out is bounded."""
        every = np.concatenate([np.empty(0), *(part.upper for part in parts)])
        least = self._value + _CLOSE * abs(self._value)
        if (every > least).sum() > _MANY:
            least = max(least, float(np.partition(every, -_MANY)[-_MANY]))
        self._bound = max(self._bound, float(every[every <= least].max(initial=-np.inf)))
        chosen = [(part, part.upper > least) for part in parts]
        return [_Part(part.patch, part.cells.part(own), part.upper[own]) for part, own in chosen if own.any()]


def _is_affine(patch: Patch) -> bool:
    """Whether the maps of all elements are."""
    return bool(Piece(patch, np.arange(len(patch)), patch.shape).is_affine.all())
