"""Certified minimum and maximum of a field over all elements, with their positions, by branch and bound.

On a box, a field lies below the largest coefficient of its Bernstein net, and attains the net's values at the corners.
Boxes whose bound is not above the best value found so far are discarded; the others are bisected.  Near an extremum the
bound converges with the square of the box size, so few boxes remain at each level.  Bounds include the rounding errors
of the nets (`polynomials.rounding`): from the coefficients, and from each bisection.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.rows import Rows
from elvis.core.data.dataset import Dataset, Expansion
from elvis.core.mapping import pointwise
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch, patches
from elvis.core.polynomials.bernstein import bernstein_coefficients, bernstein_space
from elvis.core.polynomials.boxnets import all_half_boxes, all_halves, box_nets, corners, difference
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.rounding import (
    UNIT,
    box_roundings,
    coefficient_rounding,
    gamma,
    halving_roundings,
    raising_roundings,
)

#: maximum bisections, boxes at once, and the tolerated gap to the bound, relative to the field's magnitude
_ROUNDS, _MANY, _CLOSE = 30, 1 << 12, 1e-13
#: number of elements whose nets are examined together, and of coefficients in these
_AT_ONCE, _NUMBERS = 1 << 12, 1 << 20


@dataclass(frozen=True)
class Extremum:
    """The smallest or largest value of a quantity.

    value    at the position
    bound    certified bound of the quantity; NaN if unknown
    position  (x, y, z) of the value
    element  id of an element that contains the position
    """

    value: float
    bound: float
    position: tuple[float, float, float]
    element: int


def extrema(dataset: Dataset, name: str) -> tuple[Extremum, Extremum]:
    """The smallest and the largest value of a field.

    Raises ElvisError if no element has it, or with Fourier directions.
    """
    held = _patches(dataset, name)
    if not held:
        raise ElvisError(f"expected elements of the domain under {name}, found none")
    return _ends(held, [_chosen_of_field(patch) for patch in held])


def deciding_extrema(dataset: Dataset, name: str) -> Ints:
    """(n,) ids of elements that determine `extrema`: the extrema over these elements equal the extrema over all.

    Raises ElvisError with Fourier directions.
    """
    held = _patches(dataset, name)
    return ids_of(held, [_chosen_of_field(patch).rows for patch in held])


def ids_of(held: Sequence[Patch], rows: Sequence[Ints]) -> Ints:
    """(n,) ids, ascending, of rows (m,) of patches, and of the first element of each, so that these come in one order
    whatever is left of them.
    """
    found = [patch.element_ids[np.append(0, own)] for patch, own in zip(held, rows, strict=True)]
    return np.unique(joined_ints(found))


def _chosen_of_field(patch: Patch) -> Chosen:
    """The elements of a patch that determine the extrema of its first field."""
    return chosen(len(patch), partial(_nets, patch, 0))


def _patches(dataset: Dataset, name: str) -> list[Patch]:
    """The patches that hold a field; raises ElvisError with Fourier directions."""
    held = [patch for patch in patches(dataset, [name]) if patch.fields[0] is not None and len(patch)]
    if any(patch.homogeneous for patch in held):
        raise ElvisError(f"{name}: expected a field without Fourier directions, to bound it")
    return held


def extrema_of_difference(dataset: Dataset, name: str, other: str) -> tuple[Extremum, Extremum]:
    """The extrema of the difference of two fields, on elements that have both.

    Raises ElvisError if no element has both, or with Fourier directions.
    """
    held = [patch for patch in patches(dataset, [name, other]) if None not in patch.fields]
    if not held or any(patch.homogeneous for patch in held):
        raise ElvisError(f"{name}: expected elements with both fields and without Fourier directions, to bound them")

    def nets(patch: Patch, rows: Ints) -> Nets:
        return _nets(patch, 0, rows).minus(_nets(patch, 1, rows))

    return _ends(held, [chosen(len(patch), partial(nets, patch)) for patch in held])


@dataclass(frozen=True, eq=False)
class Chosen:
    """Elements that determine extrema: ascending rows (n,) of a patch, and their nets."""

    rows: Ints
    nets: Nets


def chosen(count: int, nets_on: Callable[[Ints], Nets], numbers: int = 0) -> Chosen:
    """The elements among ``count`` of a patch that determine extrema, with nets built batch by batch.

    Memory therefore never holds the nets of all elements.

    numbers  maximum count of coefficients in an element's nets, if known: the larger it is, the fewer elements are
             examined together
    """
    rows, nets = [], []
    for some in chunks(count, max(1, min(_AT_ONCE, _NUMBERS // max(numbers, 1)))):
        own = nets_on(np.arange(count)[some])
        deciding = np.unique(np.concatenate([_deciding(own.times(sign)) for sign in (-1, 1)]))
        rows.append(some.start + deciding)
        nets.append(own.part(deciding))
    return Chosen(np.concatenate(rows), Nets.joined(nets))


@dataclass(frozen=True, eq=False)
class Nets(Rows):
    """Nets (n, D, …) with errors of at most ``error`` (n,)."""

    values: Floats
    error: Floats

    def times(self, sign: int) -> Nets:
        """The nets; their negatives for -1."""
        return Nets(sign * self.values, self.error)

    def minus(self, other: Nets) -> Nets:
        """The nets of the difference: of the greater degree each way, and rounded once more."""
        error = self.error + other.error
        for own in (self, other):
            error = error + (gamma(raising_roundings(own.values.shape[1:])) + UNIT) * own.size
        return Nets(difference(self.values, other.values), error)

    @property
    def size(self) -> Floats:
        """(n,) their largest magnitudes."""
        return np.asarray(np.abs(self.values).max(axis=tuple(range(1, self.values.ndim))))


def _nets(patch: Patch, number: int, rows: Ints) -> Nets:
    """The nets of a field on elements (n,) of a patch."""
    expansion, every = _held(patch, number)
    coefficients = every[rows]
    space, net = bernstein_space(expansion), bernstein_coefficients(expansion, coefficients)
    own = coefficient_rounding(expansion, coefficients)
    error = own + gamma(box_roundings(space)) * np.abs(net).max(axis=1)
    return Nets(box_nets(space, net), error)


def _held(patch: Patch, number: int) -> tuple[Expansion, Floats]:
    expansion, coefficients = patch.fields[number], patch.coefficients[number]
    assert expansion is not None
    assert coefficients is not None
    return expansion, coefficients


def _ends(held: Sequence[Patch], some: Sequence[Chosen]) -> tuple[Extremum, Extremum]:
    """Minimum and maximum of a function with nets on elements of patches."""
    return _extreme(held, some, -1), _extreme(held, some, 1)


def _extreme(held: Sequence[Patch], some: Sequence[Chosen], sign: int) -> Extremum:
    """The maximum of ``sign`` times a function with nets on elements of patches."""
    best = greatest_of(some, sign)
    patch = held[best.number]
    place = pointwise.positions(patch, np.array([best.row]), uncollapse(patch.shape, best.eta[None]))[0]
    x, y, z = map(float, place)
    return Extremum(sign * best.value, sign * best.bound, (x, y, z), int(patch.element_ids[best.row]))


def greatest_of(some: Sequence[Chosen], sign: int) -> Best:
    """The maximum of ``sign`` times a function with nets on elements of several patches."""
    found = [_greatest(own.nets.times(sign)) for own in some]
    number = max(range(len(some)), key=lambda number: found[number].value)
    row = int(some[number].rows[found[number].row])
    return replace(found[number], bound=max(own.bound for own in found), number=number, row=row)


@dataclass
class Best:
    """The best value so far, and an upper bound for all other values.

    number  of the patch, row of it, and place eta (d,) there
    """

    value: float
    bound: float
    row: int
    eta: Floats
    number: int = 0


def _deciding(nets: Nets) -> Ints:
    """(n,) rows of the elements that determine `_greatest`.

    These are the elements bisected, the one with the best value so far, and the discarded one with the largest bound.

    A subset of the elements leads to at least the same bisections: its best value is not larger and its tolerance not
    wider.
    """
    boxes = _whole(nets)
    best = _none_of(nets)
    boxes.improve(best)
    upper = boxes.highest()
    halved = _open(upper, best, nets)
    bounds = upper + nets.error
    bounds[halved] = -np.inf
    return np.array([*halved, best.row, bounds.argmax()], np.int64)


def _none_of(nets: Nets) -> Best:
    """The initial state, without any value."""
    return Best(-np.inf, -np.inf, 0, np.zeros(nets.values.ndim - 1))


def _open(upper: Floats, best: Best, nets: Nets) -> Ints:
    """(m,) boxes that may hold a larger value than the best, the most promising first, at most as many as are bisected.

    upper  (n,) their largest coefficients
    nets   of all elements
    """
    close = _CLOSE * float(nets.size.max())
    found = np.flatnonzero(upper > best.value + close)
    return found[np.argsort(-upper[found], kind="stable")][:_MANY]


def _greatest(nets: Nets) -> Best:
    """The maximum of a function with these nets."""
    boxes, best = _whole(nets), _none_of(nets)
    for _ in range(_ROUNDS):
        boxes.improve(best)
        upper = boxes.highest()
        open_boxes = _open(upper, best, nets)
        closed = np.delete(upper + boxes.nets.error, open_boxes)
        best.bound = max(best.bound, float(closed.max(initial=-np.inf)))
        if not len(open_boxes):
            break
        boxes = boxes.part(open_boxes).halved()
    else:
        best.bound = max(best.bound, float((boxes.highest() + boxes.nets.error).max()))
    best.bound = max(best.bound, best.value)
    return best


@dataclass(frozen=True, eq=False)
class _Boxes(Rows):
    """Boxes of eta: rows (n,) of the patch, ends (n, d) each, nets."""

    rows: Ints
    low: Floats
    high: Floats
    nets: Nets

    def halved(self) -> _Boxes:
        """Both halves in every direction."""
        low, high = all_half_boxes(self.low, self.high)
        nets, count = self.nets.values, 2 ** low.shape[1]
        error = self.nets.error + gamma(halving_roundings(nets.shape[1:])) * self.nets.size
        return _Boxes(np.tile(self.rows, count), low, high, Nets(all_halves(nets), np.tile(error, count)))

    def highest(self) -> Floats:
        """(n,) the largest coefficient of each."""
        return np.asarray(self.nets.values.max(axis=tuple(range(1, self.nets.values.ndim))))

    def improve(self, best: Best) -> None:
        """Update the best value if a corner of a box has a larger one."""
        values = corners(self.nets.values)
        box, corner = np.unravel_index(int(values.argmax()), values.shape)
        if values[box, corner] > best.value:
            d = self.low.shape[1]
            is_high = [corner >> (d - 1 - axis) & 1 for axis in range(d)]
            best.value, best.row = float(values[box, corner]), int(self.rows[box])
            best.eta = np.where(is_high, self.high[box], self.low[box])


def _whole(nets: Nets) -> _Boxes:
    """The boxes of all elements."""
    count, dimension = len(nets.error), nets.values.ndim - 1
    low = np.full((count, dimension), -1.0)
    return _Boxes(np.arange(count), low, -low, nets)
