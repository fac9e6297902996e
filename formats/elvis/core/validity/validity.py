"""Whether every element is valid: the sign of its Jacobian determinant, proved for the whole closed element.

An element whose Bernstein coefficients are all positive is done; the others are halved until the sign is certain, or is
not to be had because the determinant comes to zero as nearly as rounding can tell.  Where it comes near zero all along
a line or a surface, which takes too many halves, squares are subtracted instead.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from enum import IntEnum
from typing import Any

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.geometry import GeometryBlock, geometry
from elvis.core.polynomials.bernstein import bernstein_values
from elvis.core.polynomials.boxnets import box_nets
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate_at
from elvis.core.ranges import Range
from elvis.core.shapes import Shape
from elvis.core.validity.descent import TOLERANCE, Least, least
from elvis.core.validity.determinants import Polynomials, determinant
from elvis.core.validity.squares import descended, lower_bound

#: numbers in the nets made at once
_NUMBERS = 1 << 21
#: elements among which the extremes of all are sought, and from which squares are subtracted at most
_RIVALS, _VALLEYS = 1 << 10, 64


class ValidityStatus(IntEnum):
    """What is proved of an element's Jacobian determinant."""

    NOT_POSITIVE = -1
    UNDECIDED = 0
    POSITIVE = 1


@dataclass(frozen=True, eq=False)
class Validity:
    """The Jacobian determinants of n elements; in the order of `elvis.core.geometry`.

    status          (n,)    of `ValidityStatus`
    lower, upper    (n,)    certified bounds up to rounding; close unless the element is ``POSITIVE`` or the extreme is
                            taken all along a line or a surface; NaN where the map isn't finite
    least, greatest (n,)    values that are attained
    error           (n,)    what rounding may amount to
    reference       (n, 3)  where ``least`` is attained, in the coordinates xi of the element; zero beyond its dimension
    world           (n, 3)  the same place in the world
    """

    element_ids: Ints
    shapes: tuple[Shape, ...]
    status: Ints
    lower: Floats
    upper: Floats
    least: Floats
    greatest: Floats
    error: Floats
    reference: Floats
    world: Floats

    def __len__(self) -> int:
        return len(self.element_ids)

    def count(self, status: ValidityStatus) -> int:
        """Number of elements with a status."""
        return int((self.status == status).sum())

    def reason(self, row: int) -> str | None:
        """Why an element is undecided; None where it isn't."""
        if self.status[row] != ValidityStatus.UNDECIDED:
            return None
        if not np.isfinite(self.least[row]):
            return "its map is not finite"
        if self.least[row] <= 2 * self.error[row]:
            return "its Jacobian comes to zero within rounding"
        return "the search for its least Jacobian ended before it was bounded"

    @property
    def range(self) -> Range | None:
        """Of all elements together, close to what is attained; None where no map is finite."""
        if not np.isfinite(self.least).any():
            return None
        lower, least = (float(np.nanmin(values)) for values in (self.lower, self.least))
        upper, greatest = (float(np.nanmax(values)) for values in (self.upper, self.greatest))
        return Range(lower, upper, least, greatest)

    @property
    def failing_rows(self) -> Ints:
        """(k,) rows of the elements that aren't positive for certain: proved ones first, by value."""
        rows = np.flatnonzero(self.status != ValidityStatus.POSITIVE)
        return rows[np.lexsort((self.least[rows], self.status[rows]))]


def validity(dataset: Dataset, blocks: Sequence[GeometryBlock] | None = None) -> Validity:
    """The status of every element of the domain.

    blocks  the dataset's `geometry`, where it is at hand already
    Where space has more dimensions than the elements, the determinant is the factor of length or area, never negative.
    """
    blocks, space = geometry(dataset) if blocks is None else tuple(blocks), dataset.mesh.space
    parts = [_check(chunk, space) for block in blocks for chunk in _chunks(block, space)]
    if not parts:
        return _nothing()
    names = [name for name in Validity.__dataclass_fields__ if name != "shapes"]
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
    return Validity(**arrays, shapes=tuple(shape for part in parts for shape in part.shapes))


def validity_facts(found: Validity) -> dict[str, Any]:
    """What `validity` found as plain data that JSON can hold: counts, the range, and all about elements in doubt."""
    names = ("lower", "upper", "least", "greatest", "error")
    listed = [
        {
            "element": int(found.element_ids[row]),
            "shape": found.shapes[row].label.lower(),
            "verdict": ValidityStatus(found.status[row]).name.lower().replace("_", " "),
            "reason": found.reason(row),
            **{name: float(getattr(found, name)[row]) for name in names},
            "reference": found.reference[row, : found.shapes[row].dimension].tolist(),
            "world": found.world[row].tolist(),
        }
        for row in found.failing_rows
    ]
    return {
        "elements": len(found),
        "positive": found.count(ValidityStatus.POSITIVE),
        "not_positive": found.count(ValidityStatus.NOT_POSITIVE),
        "undecided": found.count(ValidityStatus.UNDECIDED),
        "range": None if found.range is None else asdict(found.range),
        "listed": listed,
    }


def _nothing() -> Validity:
    one, many, whole = np.empty(0), np.empty((0, 3)), np.empty(0, np.int64)
    return Validity(whole, (), whole, one, one, one, one, one, many, many)


def _chunks(block: GeometryBlock, space: int) -> Iterator[GeometryBlock]:
    """The block in batches whose determinants fit into memory."""
    if not len(block):
        return
    count = determinant(block.expansion, block.coefficients[:1], space).space.count
    step = max(1, _NUMBERS // count)
    for first in range(0, len(block), step):
        yield _rows(block, slice(first, first + step))


def _rows(block: GeometryBlock, rows: slice | Ints | Bools) -> GeometryBlock:
    return GeometryBlock(block.expansion, block.element_ids[rows], block.coefficients[rows])


def _check(block: GeometryBlock, space: int) -> Validity:
    """All about some elements; undecided are those with maps that aren't finite."""
    shape = block.expansion.shape
    with np.errstate(invalid="ignore", over="ignore"):
        found = determinant(block.expansion, block.coefficients, space)
    finite = np.isfinite(found.net).all(axis=0) & np.isfinite(found.error)
    facts = _first_bound_boxes(found, finite)

    # halve what the coefficients leave in doubt; once the sign is proved to be bad, find the extremes
    doubtful = np.flatnonzero(finite & ~(facts.lower > found.error))
    if len(doubtful):
        facts.decide(doubtful, found)
    facts.sharpen(found)
    status = np.where(facts.lower > found.error, ValidityStatus.POSITIVE, ValidityStatus.UNDECIDED)
    status[facts.least < -found.error] = ValidityStatus.NOT_POSITIVE

    world = evaluate_at(block.expansion, block.coefficients, np.arange(len(block)), facts.reference)
    reference = np.zeros((len(block), 3))
    reference[:, : shape.dimension] = facts.reference
    size = _length if space > shape.dimension else _same
    return Validity(
        element_ids=block.element_ids,
        shapes=(shape,) * len(block),
        status=status,
        lower=size(facts.lower),
        upper=size(facts.upper),
        least=size(facts.least),
        greatest=size(facts.greatest),
        error=size(found.error),
        reference=reference,
        world=world,
    )


def _same(values: Floats) -> Floats:
    return values


def _length(squares: Floats) -> Floats:
    """Lengths or areas of their squares; those that rounding made negative are zero."""
    return np.sqrt(np.maximum(squares, 0.0))


@dataclass(eq=False)
class _Facts:
    """As in `Validity`, but with as many reference coordinates as the shape has."""

    lower: Floats
    upper: Floats
    least: Floats
    greatest: Floats
    reference: Floats

    def decide(self, rows: Ints, found: Polynomials) -> None:
        """Halve the elements ``rows`` until their sign is certain; where it is bad, until the extremes are close."""
        nets, error, shape = box_nets(found.space, found.net[:, rows].T), found.error[rows], found.space.shape
        below = _subtracting_squares(nets, error, least(nets, error, goal=2 * error))
        self.lower[rows], self.least[rows] = below.lower, below.value
        self.reference[rows] = uncollapse(shape, below.place)

        bad = np.flatnonzero(~(below.lower > error))
        if len(bad):
            above = least(-nets[bad], error[bad])
            self.upper[rows[bad]], self.greatest[rows[bad]] = -above.lower, -above.value

    def sharpen(self, found: Polynomials) -> None:
        """Halve the elements that may hold the extremes of all."""
        rows, goal = _rivals(self.lower, self.least)
        if len(rows):
            below = least(box_nets(found.space, found.net[:, rows].T), found.error[rows], np.full(len(rows), goal))
            lower = below.value < self.least[rows]
            self.lower[rows] = np.maximum(self.lower[rows], below.lower)
            self.least[rows[lower]] = below.value[lower]
            self.reference[rows[lower]] = uncollapse(found.space.shape, below.place[lower])
        rows, goal = _rivals(-self.upper, -self.greatest)
        if len(rows):
            above = least(box_nets(found.space, -found.net[:, rows].T), found.error[rows], np.full(len(rows), goal))
            self.upper[rows] = np.minimum(self.upper[rows], -above.lower)
            self.greatest[rows] = np.maximum(self.greatest[rows], -above.value)


def _subtracting_squares(nets: Floats, error: Floats, below: Least) -> Least:
    """Least values of polynomials with box nets, closer where the sign of some was left open for want of boxes."""
    unknown = (below.lower <= error) & (below.value >= -error) & (below.value - below.lower > 4 * error)
    lower, value, place = (array.copy() for array in below)
    for row in np.flatnonzero(unknown)[:_VALLEYS]:
        known = descended(nets[row], (1 + place[row]) / 2)
        if known.value < value[row]:
            value[row], place[row] = known.value, 2 * known.place - 1
        goal = min(2 * error[row], value[row] - max(error[row], TOLERANCE * abs(value[row])))
        lower[row] = max(lower[row], lower_bound(nets[row], goal))
    return Least(lower, value, place)


def _rivals(lower: Floats, value: Floats) -> tuple[Ints, float]:
    """Elements whose bound is below the least value known of all, the lowest first, and what they'd have to beat."""
    known = float(np.nanmin(value, initial=np.inf))
    goal = known - TOLERANCE * abs(known)
    rows = np.flatnonzero(lower < goal)
    return rows[np.argsort(lower[rows], kind="stable")][:_RIVALS], goal


def _first_bound_boxes(found: Polynomials, finite: Bools) -> _Facts:
    """What coefficients tell: their extremes bound the determinant, and some are its values at the vertices."""
    shape, net = found.space.shape, np.where(finite, found.net, np.nan)
    at_vertices = net[np.argmax(bernstein_values(found.space, shape.vertices), axis=1)]
    reference = shape.vertices[np.argmin(at_vertices, axis=0)]
    return _Facts(net.min(axis=0), net.max(axis=0), at_vertices.min(axis=0), at_vertices.max(axis=0), reference)
