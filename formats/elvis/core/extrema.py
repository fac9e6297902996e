"""The least and the greatest value of a field over all elements, with their places: certified, by branch and bound.

A field lies below the greatest coefficient of its Bernstein net on a box, and has the values at the box's corners.
Boxes whose bound is not above the best value found so far are done with; the others are halved.  Near an extreme the
bound comes down with the square of the size of boxes, so that few are left each time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Dataset, Expansion
from elvis.core.errors import ElvisError
from elvis.core.mapping import pointwise
from elvis.core.patch import Patch, patches
from elvis.core.polynomials.bernstein import bernstein_coefficients, bernstein_space
from elvis.core.polynomials.boxnets import all_half_boxes, all_halves, box_nets, corners, difference
from elvis.core.polynomials.collapse import uncollapse

#: halvings at most, boxes at once, and the gap to the bound that is small enough, in parts of the field's magnitude
_ROUNDS, _MANY, _CLOSE = 30, 1 << 12, 1e-13
#: rounding of nets, in parts of their coefficients
_ROUNDING = 256 * float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class Extreme:
    """The least or greatest value of a quantity.

    value    which it has
    bound    which it doesn't exceed anywhere; NaN where that is not known
    place    (x, y, z) where it has the value
    element  id of an element that holds the place
    """

    value: float
    bound: float
    place: tuple[float, float, float]
    element: int


def extrema(dataset: Dataset, name: str) -> tuple[Extreme, Extreme]:
    """The least and the greatest value of a field; ElvisError where no element has it, or with Fourier directions."""
    held = [patch for patch in patches(dataset, [name]) if patch.fields[0] is not None]
    if not held:
        raise ElvisError(f"expected elements of the domain under {name}, found none")
    if any(patch.homogeneous for patch in held):
        raise ElvisError(f"{name}: expected a field without Fourier directions, to bound it")
    nets = [_nets(patch, 0) for patch in held]
    return _extreme(held, nets, -1), _extreme(held, nets, 1)


def extrema_of_difference(dataset: Dataset, name: str, other: str) -> tuple[Extreme, Extreme]:
    """The same of the difference of two fields, on elements that have both; bounds hold rounding of the coefficients.

    ElvisError where no element has both, or with Fourier directions.
    """
    held = [patch for patch in patches(dataset, [name, other]) if None not in patch.fields]
    if not held or any(patch.homogeneous for patch in held):
        raise ElvisError(f"{name}: expected elements with both fields and without Fourier directions, to bound them")
    both = [(_nets(patch, 0), _nets(patch, 1)) for patch in held]
    nets = [difference(one, other) for one, other in both]
    slack = _ROUNDING * max(float(np.abs(own).max()) for pair in both for own in pair)
    found = _extreme(held, nets, -1), _extreme(held, nets, 1)
    least, most = (replace(own, bound=own.bound + sign * slack) for own, sign in zip(found, (-1, 1), strict=True))
    return least, most


def _nets(patch: Patch, number: int) -> Floats:
    """Nets (n, D, …) of a field of a patch."""
    expansion, coefficients = _held(patch, number)
    return box_nets(bernstein_space(expansion), bernstein_coefficients(expansion, coefficients))


def _held(patch: Patch, number: int) -> tuple[Expansion, Floats]:
    expansion, coefficients = patch.fields[number], patch.coefficients[number]
    assert expansion is not None
    assert coefficients is not None
    return expansion, coefficients


def _extreme(held: Sequence[Patch], nets: Sequence[Floats], sign: int) -> Extreme:
    """The greatest value of ``sign`` times what has nets (n, D, …) on the elements of patches."""
    found = [_greatest(sign * own) for own in nets]
    first = max(range(len(held)), key=lambda number: found[number].value)
    best, patch = found[first], held[first]
    row = np.array([best.row])
    place = pointwise.positions(patch, row, uncollapse(patch.shape, best.eta[None]))[0]
    bound = max(own.bound for own in found)
    x, y, z = map(float, place)
    return Extreme(sign * best.value, sign * bound, (x, y, z), int(patch.element_ids[best.row]))


@dataclass
class _Best:
    """The greatest value so far and where it is; what no other exceeds."""

    value: float
    bound: float
    row: int
    eta: Floats


def _greatest(nets: Floats) -> _Best:
    """Of what has nets (n, D, …) on elements."""
    boxes = _whole(nets)
    best = _Best(-np.inf, -np.inf, 0, np.zeros(nets.ndim - 1))
    close = _CLOSE * float(np.abs(boxes.nets).max())
    for _ in range(_ROUNDS):
        boxes.improve(best)
        upper = boxes.nets.max(axis=tuple(range(1, boxes.nets.ndim)))
        open_boxes = np.flatnonzero(upper > best.value + close)
        open_boxes = open_boxes[np.argsort(-upper[open_boxes])][:_MANY]
        closed = np.delete(upper, open_boxes)
        best.bound = max(best.bound, float(closed.max(initial=-np.inf)))
        if not len(open_boxes):
            break
        boxes = boxes.part(open_boxes).halved()
    else:
        best.bound = max(best.bound, float(boxes.nets.max()))
    best.bound = max(best.bound, best.value)
    return best


@dataclass(frozen=True, eq=False)
class _Boxes:
    """Boxes of eta: rows (n,) of the patch, ends (n, d) each, nets (n, D, …)."""

    rows: Ints
    low: Floats
    high: Floats
    nets: Floats

    def part(self, chosen: Ints) -> _Boxes:
        """Some of them."""
        return _Boxes(self.rows[chosen], self.low[chosen], self.high[chosen], self.nets[chosen])

    def halved(self) -> _Boxes:
        """Both halves in every direction."""
        low, high = all_half_boxes(self.low, self.high)
        return _Boxes(np.tile(self.rows, 2 ** low.shape[1]), low, high, all_halves(self.nets))

    def improve(self, best: _Best) -> None:
        """Let the best value be that of a corner, where one has a greater."""
        values = corners(self.nets)
        box, corner = np.unravel_index(int(values.argmax()), values.shape)
        if values[box, corner] > best.value:
            d = self.low.shape[1]
            is_high = [corner >> (d - 1 - axis) & 1 for axis in range(d)]
            best.value, best.row = float(values[box, corner]), int(self.rows[box])
            best.eta = np.where(is_high, self.high[box], self.low[box])


def _whole(nets: Floats) -> _Boxes:
    """The boxes of all elements with nets (n, D, …)."""
    low = np.full((len(nets), nets.ndim - 1), -1.0)
    return _Boxes(np.arange(len(nets)), low, -low, nets)
