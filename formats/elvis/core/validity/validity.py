"""Validity of every element: the sign of its Jacobian determinant, proved for the whole closed element.

An element whose Bernstein coefficients are all positive is proved; cheaper bounds prove most hexahedra of high order.
The others are bisected until the sign is certain, or undecidable because the determinant approaches zero within
rounding.  If it is near zero along a line or a surface, which would take too many bisections, squares are subtracted
instead.

The result of an element doesn't depend on the others in the batch, with two exceptions for few elements: subtracting
squares, and bisecting for the range of all.  These elements are selected after everything else is known, so parts of a
mesh on several ranks give the same result.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, astuple, dataclass, fields
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints, rows_of
from elvis.core.base.ranks import Ranks
from elvis.core.base.rows import Rows
from elvis.core.bounds.ranges import Range
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.geometry import GeometryBlock, geometry
from elvis.core.polynomials.bernstein import bernstein_values
from elvis.core.polynomials.boxnets import box_nets
from elvis.core.polynomials.collapse import collapse, uncollapse
from elvis.core.polynomials.evaluation import evaluate_at
from elvis.core.shapes import Shape
from elvis.core.validity.descent import TOLERANCE, least
from elvis.core.validity.determinants import Polynomials, determinant
from elvis.core.validity.enclosed_determinants import enclosures
from elvis.core.validity.regularity import are_regular
from elvis.core.validity.squares import descended, lower_bound

#: numbers in the nets built at once, and elements that are examined together
_NUMBERS, _TOGETHER = 1 << 21, 1 << 13
#: elements among which the extrema of all are sought, and from which squares are subtracted, at most
_RIVALS, _VALLEYS = 1 << 10, 64
_SHAPES = tuple(Shape)
#: modes in each direction from which hexahedra are bounded by `enclosures` first, and elements that these take at once
_QUICK, _AT_ONCE = 5, 16
#: lower bounds of the Jacobian, in units of the rounding error, that count as touching zero
TOUCHING = 4


class ValidityStatus(IntEnum):
    """The proved sign of an element's Jacobian determinant."""

    NOT_POSITIVE = -1
    UNDECIDED = 0
    POSITIVE = 1


@dataclass(frozen=True, eq=False)
class Validity:
    """The Jacobian determinants of n elements.

    status          (n,)    of `ValidityStatus`
    lower, upper    (n,) certified bounds up to rounding; close unless the element is ``POSITIVE`` or the extreme is
                    taken all along a line or a surface; NaN if the map isn't finite
    minimum, maximum (n,)    values that are attained
    error           (n,)    what rounding may amount to
    reference       (n, 3)  where ``minimum`` is attained, in coordinates xi of the element; zero beyond its dimension
    world           (n, 3)  the same place in the world
    others          how many further elements there are, all positive for certain
    ends            the range of these, None if there are none
    """

    element_ids: Ints
    shapes: tuple[Shape, ...]
    status: Ints
    lower: Floats
    upper: Floats
    minimum: Floats
    maximum: Floats
    error: Floats
    reference: Floats
    world: Floats
    others: int = 0
    ends: Range | None = None

    def __len__(self) -> int:
        return len(self.element_ids)

    def count(self, status: ValidityStatus) -> int:
        """Number of elements with a status."""
        return int((self.status == status).sum()) + (self.others if status == ValidityStatus.POSITIVE else 0)

    def reason(self, row: int) -> str | None:
        """Why an element is undecided; None if it isn't."""
        if self.status[row] != ValidityStatus.UNDECIDED:
            return None
        if not np.isfinite(self.minimum[row]):
            return "its map is not finite"
        if self.minimum[row] <= 2 * self.error[row]:
            return "its Jacobian is zero within rounding"
        return "the search for its minimum Jacobian ended before a bound was found"

    @property
    def range(self) -> Range | None:
        """The range over all elements, close to the attained values; None if no map is finite."""
        return _widest(_range_of(self), self.ends)

    @property
    def failing_rows(self) -> Ints:
        """(k,) rows of the elements that aren't positive for certain: proved ones first, by value."""
        rows = np.flatnonzero(self.status != ValidityStatus.POSITIVE)
        return rows[np.lexsort((self.element_ids[rows], self.minimum[rows], self.status[rows]))]


def validity(dataset: Dataset, blocks: Sequence[GeometryBlock] | None = None) -> Validity:
    """The status of every element of the domain, in the order of `elvis.core.mapping.geometry`.

    blocks  the dataset's `geometry`, if already available
    If space has more dimensions than the elements, the determinant is the factor of length or area, never negative.
    """
    blocks, space = geometry(dataset) if blocks is None else tuple(blocks), dataset.mesh.space
    found = _Facts.of(blocks, space)
    found.look_closer(blocks, space)
    return found.result(space > dataset.mesh.dimension)


def statuses(block: GeometryBlock, space: int) -> Ints:
    """(n,) of `ValidityStatus`: only the status of each element, without the other results of `validity`.

    space  dimension of the world
    Raises FormatError for maps that aren't polynomials.
    """
    is_passed, rest = _proved(block, space)
    found = np.full(len(block), int(ValidityStatus.POSITIVE))
    found[~is_passed] = rest.status
    return found


def are_never_negative(block: GeometryBlock, space: int) -> Bools:
    """(n,) whether the determinant of each element is proved to be at least zero, within rounding.

    This holds for collapsed hexahedra, which represent pyramids; see `statuses`.
    """
    found, rest = _proved(block, space)
    found[~found] = rest.lower >= -TOUCHING * rest.error
    return found


def _proved(block: GeometryBlock, space: int) -> tuple[Bools, _Facts]:
    """(n,) which elements pass the quick test, and the facts of the others."""
    is_passed = are_regular(block.expansion, block.coefficients, space)
    others = _rows(block, ~is_passed)
    rest = _Facts.of([others], space)
    rest.look_into_valleys([others], space)
    return is_passed, rest


def shared_validity(dataset: Dataset, ranks: Ranks) -> Validity | None:
    """`validity` of all elements if each of several ranks has a part of them, the dataset.

    None except at the first rank.

    Rows cover the elements that aren't certainly positive or may hold an end of the range.
    """
    blocks, space = geometry(dataset), dataset.mesh.space
    own = _Facts.of(blocks, space)
    close = np.concatenate([own.valleys(), own.rivals(1)[0], own.rivals(-1)[0]])
    is_told = own.status != ValidityStatus.POSITIVE
    is_told[close] = True
    maps = [_rows(block, np.isin(block.element_ids, own.element_ids[close])) for block in blocks]
    told = own.part(np.flatnonzero(is_told)), maps, int((~is_told).sum()), _range_of(own, ~is_told)
    every = ranks.gather(told, f"the Jacobian of {dataset.mesh.count} elements")
    if not every:
        return None
    facts = [facts for facts, *_ in every]
    found = _Facts.united(facts, sum(len(own.element_ids) for own in facts))
    ends = _widest(*(own for *_, own in every))
    found.look_closer([block for _, some, *_ in every for block in some], space, ends)
    return found.result(space > dataset.mesh.dimension, sum(count for *_, count, _ in every), ends)


def validity_facts(found: Validity) -> dict[str, Any]:
    """Results of `validity` as plain data that JSON can hold: counts, the range, and details of elements in doubt."""
    names = ("lower", "upper", "minimum", "maximum", "error")
    listed = [
        {
            "element": int(found.element_ids[row]),
            "shape": found.shapes[row].label.lower(),
            "status": ValidityStatus(found.status[row]).name.lower().replace("_", " "),
            "reason": found.reason(row),
            **{name: float(getattr(found, name)[row]) for name in names},
            "reference": found.reference[row, : found.shapes[row].dimension].tolist(),
            "world": found.world[row].tolist(),
        }
        for row in found.failing_rows
    ]
    return {
        "elements": len(found) + found.others,
        "positive": found.count(ValidityStatus.POSITIVE),
        "not_positive": found.count(ValidityStatus.NOT_POSITIVE),
        "undecided": found.count(ValidityStatus.UNDECIDED),
        "range": None if found.range is None else asdict(found.range),
        "listed": listed,
    }


def _chunks(block: GeometryBlock, space: int) -> Iterator[GeometryBlock]:
    """The block in batches whose determinants fit into memory."""
    if not len(block):
        return
    count = determinant(block.expansion, block.coefficients[:1], space).space.count
    step = min(max(1, _NUMBERS // count), _TOGETHER)
    for first in range(0, len(block), step):
        yield _rows(block, slice(first, first + step))


def _rows(block: GeometryBlock, rows: slice | Ints | Bools) -> GeometryBlock:
    return GeometryBlock(block.expansion, block.element_ids[rows], block.coefficients[rows])


def _check(block: GeometryBlock, space: int) -> _Facts:
    """Facts of some elements, independent of others."""
    if block.expansion.shape is not Shape.HEXAHEDRON or space < 3 or min(block.expansion.modes) < _QUICK:
        return _exact_facts(block, space)
    facts = _quick_facts(block)
    doubtful = np.flatnonzero(~(facts.lower > facts.error))
    facts.put(doubtful, _exact_facts(_rows(block, doubtful), space))
    return facts


def _quick_facts(block: GeometryBlock) -> _Facts:
    """Facts of hexahedra from bounds that cost little: nothing is decided where they leave the sign in doubt."""
    facts = _Facts.empty(len(block))
    facts.element_ids[:], facts.shapes[:] = block.element_ids, _SHAPES.index(block.expansion.shape)
    for first in range(0, len(block), _AT_ONCE):
        rows = slice(first, first + _AT_ONCE)
        with np.errstate(invalid="ignore", over="ignore"):
            found = enclosures(block.expansion, block.coefficients[rows])
        for own in fields(found):
            getattr(facts, own.name)[rows] = getattr(found, own.name)
    facts.is_open[:] = False
    facts.world[:] = evaluate_at(block.expansion, block.coefficients, np.arange(len(block)), facts.reference)
    return facts


def _exact_facts(block: GeometryBlock, space: int) -> _Facts:
    """Facts from the Bernstein coefficients of determinants, bisected where these leave the sign in doubt."""
    shape = block.expansion.shape
    with np.errstate(invalid="ignore", over="ignore"):
        found = determinant(block.expansion, block.coefficients, space)
    finite = np.isfinite(found.net).all(axis=0) & np.isfinite(found.error)
    facts = _first_facts(block, found, finite)

    # halve what the coefficients leave in doubt; once the sign is proved to be bad, find the extrema
    doubtful = np.flatnonzero(finite & ~(facts.lower > found.error))
    if len(doubtful):
        nets = box_nets(found.space, found.net[:, doubtful].T)
        facts.decide(doubtful, nets)
    facts.world[:] = evaluate_at(
        block.expansion, block.coefficients, np.arange(len(block)), facts.reference[:, : shape.dimension]
    )
    return facts


def _first_facts(block: GeometryBlock, found: Polynomials, finite: Bools) -> _Facts:
    """Facts from coefficients: their extrema bound the determinant, and some are its values at the vertices."""
    shape, net = found.space.shape, np.where(finite, found.net, np.nan)
    at_vertices = net[np.argmax(bernstein_values(found.space, shape.vertices), axis=1)]
    reference = np.zeros((len(block), 3))
    reference[:, : shape.dimension] = shape.vertices[np.argmin(at_vertices, axis=0)]
    return _Facts(
        element_ids=block.element_ids,
        shapes=np.full(len(block), _SHAPES.index(shape), np.int8),
        lower=net.min(axis=0),
        upper=net.max(axis=0),
        minimum=at_vertices.min(axis=0),
        maximum=at_vertices.max(axis=0),
        error=found.error,
        reference=reference,
        world=np.zeros((len(block), 3)),
        is_open=np.zeros(len(block), bool),
    )


@dataclass(eq=False)
class _Facts(Rows):
    """As in `Validity`, but where space has more dimensions than the elements of the squares of lengths and areas.

    shapes   (n,)  numbers in `Shape`, of one byte
    is_open  (n,)  whether the sign was left open for want of boxes
    """

    element_ids: Ints
    shapes: NDArray[np.int8]
    lower: Floats
    upper: Floats
    minimum: Floats
    maximum: Floats
    error: Floats
    reference: Floats
    world: Floats
    is_open: Bools

    @staticmethod
    def of(blocks: Sequence[GeometryBlock], space: int) -> _Facts:
        """Facts of elements, each independent of the others."""
        every = (_check(chunk, space) for block in blocks for chunk in _chunks(block, space))
        return _Facts.united(every, sum(map(len, blocks)))

    @staticmethod
    def united(parts: Iterable[_Facts], count: int) -> _Facts:
        """The facts of all parts, with ``count`` elements in total."""
        found = _Facts.empty(count)
        start = 0
        for part in parts:
            rows = slice(start, start + len(part.element_ids))
            found.put(rows, part)
            start = rows.stop
        return found

    @staticmethod
    def empty(count: int) -> _Facts:
        """Facts of ``count`` elements whose numbers are still unset."""
        ids, shapes = np.empty(count, np.int64), np.empty(count, np.int8)
        lower, upper, least, greatest, error = np.empty((5, count))
        reference, world = np.empty((2, count, 3))
        return _Facts(ids, shapes, lower, upper, least, greatest, error, reference, world, np.empty(count, bool))

    def put(self, rows: slice | Ints, part: _Facts) -> None:
        """Replace the facts of some elements."""
        for own in fields(_Facts):
            getattr(self, own.name)[rows] = getattr(part, own.name)

    @property
    def status(self) -> Ints:
        """(n,) of `ValidityStatus`; undecided are also those with maps that aren't finite."""
        status = np.where(self.lower > self.error, ValidityStatus.POSITIVE, ValidityStatus.UNDECIDED)
        status[self.minimum < -self.error] = ValidityStatus.NOT_POSITIVE
        return status

    def decide(self, rows: Ints, nets: Floats) -> None:
        """Halve elements with box nets until their sign is certain; where it is bad, until the extrema are close."""
        error, shape = self.error[rows], _SHAPES[self.shapes[rows[0]]]
        below = least(nets, error, goal=2 * error)
        self.lower[rows], self.minimum[rows] = below.lower, below.value
        self.reference[rows, : shape.dimension] = uncollapse(shape, below.place)
        self.is_open[rows] = (below.lower <= error) & (below.value >= -error) & (below.value - below.lower > 4 * error)
        bad = np.flatnonzero(~(below.lower > error))
        if len(bad):
            above = least(-nets[bad], error[bad])
            self.upper[rows[bad]], self.maximum[rows[bad]] = -above.lower, -above.value

    def valleys(self) -> Ints:
        """(k,) rows of the elements from which squares are subtracted: the first ones whose sign is open."""
        rows = np.flatnonzero(self.is_open)
        return rows[np.argsort(self.element_ids[rows])[:_VALLEYS]]

    def rivals(self, sign: int, ends: Range | None = None) -> tuple[Ints, float]:
        """(k,) rows of the elements whose bound is below the minimum known, ascending, and the value to undercut.

        Both refer to the determinant for ``sign`` 1, and to its negative for -1.

        ends  range of further elements
        """
        lower, value = (self.lower, self.minimum) if sign > 0 else (-self.upper, -self.maximum)
        further = np.inf if ends is None else ends.minimum if sign > 0 else -ends.maximum
        known = float(np.fmin.reduce(value, initial=further))
        goal = known - TOLERANCE * abs(known)
        rows = np.flatnonzero(lower < goal)
        return rows[np.lexsort((self.element_ids[rows], lower[rows]))][:_RIVALS], goal

    def look_closer(self, blocks: Sequence[GeometryBlock], space: int, ends: Range | None = None) -> None:
        """Refine few elements: subtract squares if the sign is open, bisect elements that may hold the extrema.

        blocks  the maps of at least these
        ends    of further elements
        """
        chosen = {sign: self.rivals(sign, ends) for sign in (1, -1)}
        self.look_into_valleys(blocks, space)
        for sign, (own, goal) in chosen.items():
            for rows, block, nets, error in self._nets(own, blocks, space):
                found = least(sign * nets, error, np.full(len(rows), goal))
                if sign < 0:
                    self.upper[rows] = np.minimum(self.upper[rows], -found.lower)
                    self.maximum[rows] = np.maximum(self.maximum[rows], -found.value)
                    continue
                self.lower[rows] = np.maximum(self.lower[rows], found.lower)
                self._attain(rows, block, found.value, found.place)

    def look_into_valleys(self, blocks: Sequence[GeometryBlock], space: int) -> None:
        """Subtract squares where the sign is open."""
        for rows, block, nets, error in self._nets(self.valleys(), blocks, space):
            for number, row in enumerate(rows.tolist()):
                self._subtract_squares(row, _rows(block, np.array([number])), nets[number], float(error[number]))

    def _nets(
        self, rows: Ints, blocks: Sequence[GeometryBlock], space: int
    ) -> Iterator[tuple[Ints, GeometryBlock, Floats, Floats]]:
        """Some of the rows, their maps, box nets and what rounding may amount to, one expansion after another."""
        ids = self.element_ids[rows]
        for block in blocks:
            own = _rows(block, np.isin(block.element_ids, ids))
            if len(own):
                found = determinant(own.expansion, own.coefficients, space)
                here = rows[rows_of(ids, own.element_ids)]
                yield here, own, box_nets(found.space, found.net.T), found.error

    def _subtract_squares(self, row: int, block: GeometryBlock, net: Floats, error: float) -> None:
        """Bound an element whose sign is open more closely."""
        shape = block.expansion.shape
        place = collapse(shape, self.reference[row : row + 1, : shape.dimension])[0]
        known = descended(net, np.clip((1 + place) / 2, 0.0, 1.0))
        self._attain(np.array([row]), block, np.array([known.value]), 2 * known.place[None] - 1)
        value = self.minimum[row]
        goal = min(2 * error, value - max(error, TOLERANCE * abs(value)))
        self.lower[row] = max(self.lower[row], lower_bound(net, goal))

    def _attain(self, rows: Ints, block: GeometryBlock, value: Floats, place: Floats) -> None:
        """Update the minima with values (k,) at places (k, d) in eta."""
        better = np.flatnonzero(value < self.minimum[rows])
        own, xi = rows[better], uncollapse(block.expansion.shape, place[better])
        self.minimum[own] = value[better]
        self.reference[own, : xi.shape[1]] = xi
        self.world[own] = evaluate_at(block.expansion, block.coefficients, better, xi)

    def result(self, has_squares: bool, others: int = 0, ends: Range | None = None) -> Validity:
        """All that was found.

        has_squares   whether space has more dimensions than the elements
        others, ends  of further elements, which are positive for certain
        """
        shapes = tuple(_SHAPES[number] for number in self.shapes.tolist())
        size = _length if has_squares else _same
        return Validity(
            element_ids=self.element_ids,
            shapes=shapes,
            status=self.status,
            lower=size(self.lower),
            upper=size(self.upper),
            minimum=size(self.minimum),
            maximum=size(self.maximum),
            error=size(self.error),
            reference=self.reference,
            world=self.world,
            others=others,
            ends=ends and Range(*size(np.array(astuple(ends))).tolist()),
        )


def _same(values: Floats) -> Floats:
    return values


def _length(squares: Floats) -> Floats:
    """Lengths or areas from their squares; squares made negative by rounding give zero."""
    return np.sqrt(np.maximum(squares, 0.0))


def _range_of(found: Validity | _Facts, chosen: Bools | slice = np.s_[:]) -> Range | None:
    """The range of elements, or of the chosen ones; None if no map is finite."""
    if not np.isfinite(found.minimum[chosen]).any():
        return None
    lower, least_value = (float(np.nanmin(values[chosen])) for values in (found.lower, found.minimum))
    upper, greatest = (float(np.nanmax(values[chosen])) for values in (found.upper, found.maximum))
    return Range(lower, upper, least_value, greatest)


def _widest(*ranges: Range | None) -> Range | None:
    """The union of several ranges; None without any."""
    known = [each for each in ranges if each is not None]
    if not known:
        return None
    lower, least_value = (min(getattr(each, name) for each in known) for name in ("lower", "minimum"))
    upper, greatest = (max(getattr(each, name) for each in known) for name in ("upper", "maximum"))
    return Range(lower, upper, least_value, greatest)
