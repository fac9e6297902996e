"""The certified minima of many polynomials: boxes that may hold the minimum are bisected, others dropped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_columns
from elvis.core.base.rows import Rows
from elvis.core.polynomials.boxnets import corners, halves

#: the part of a smallest value to which it is found, where halving can do it
TOLERANCE = 1e-11
#: halvings in each direction of eta
_HALVINGS = 24
#: boxes of one polynomial beyond which its search ends
_MOST_BOXES = 1024
#: numbers in the nets of one search
_NUMBERS = 1 << 22


class Least(NamedTuple):
    """Bounds of the minimum of each of n polynomials: lower <= minimum <= value, up to rounding.

    lower, value  (n,)
    place         (n, d)  collapsed coordinates eta where ``value`` is attained
    """

    lower: Floats
    value: Floats
    place: Floats


def least(nets: Floats, error: Floats, goal: Floats | None = None) -> Least:
    """The smallest values of polynomials with box nets (n, D1, …, Dd); see `elvis.core.polynomials.boxnets`.

    error  (n,)  differences not worth a search
    goal   (n,)  polynomials all of whose values are found to exceed this need not be searched further
    """
    size = int(np.prod(nets.shape[1:]))
    step = max(1, _NUMBERS // (64 * size))
    goal = np.full(len(nets), np.inf) if goal is None else goal
    parts = [slice(first, first + step) for first in range(0, len(nets), step)]
    found = [_Descent(nets[part], error[part], goal[part]).result for part in parts]
    return Least(*joined_columns(found))


@dataclass(frozen=True, eq=False)
class _Boxes(Rows):
    """Boxes still in question: their polynomial (b,), corners in (1 + eta)/2 (b, d), net, smallest coefficient (b,)."""

    owner: Ints
    low: Floats
    high: Floats
    net: Floats
    bound: Floats

    @staticmethod
    def of(owner: Ints, low: Floats, high: Floats, net: Floats) -> _Boxes:
        return _Boxes(owner, low, high, net, net.min(axis=tuple(range(1, net.ndim))))

    def halves(self) -> _Boxes:
        """Both halves of every box, across the direction in which it is most nonlinear."""
        axes = self._axes()
        parts = [self.part(axes == axis)._halves(axis) for axis in range(self.low.shape[1])]
        return _Boxes(*(np.concatenate([getattr(p, name) for p in parts]) for name in self.__dataclass_fields__))

    def _axes(self) -> Ints:
        """(b,) direction with the largest second difference, times the degree: what bounds are off by, nearly."""
        bends = np.zeros((len(self.owner), self.low.shape[1]))
        for axis in range(self.low.shape[1]):
            if self.net.shape[1 + axis] > 2:
                second = np.abs(np.diff(self.net, 2, axis=1 + axis))
                bends[:, axis] = second.max(axis=tuple(range(1, second.ndim))) * self.net.shape[1 + axis]
        return np.asarray(bends.argmax(axis=1))

    def _halves(self, axis: int) -> _Boxes:
        low, high = np.tile(self.low, (2, 1)), np.tile(self.high, (2, 1))
        middle = (self.low[:, axis] + self.high[:, axis]) / 2
        high[: len(middle), axis], low[len(middle) :, axis] = middle, middle
        return _Boxes.of(np.tile(self.owner, 2), low, high, np.concatenate(halves(self.net, axis)))


class _Descent:
    """One batch of polynomials with the results so far."""

    def __init__(self, nets: Floats, error: Floats, goal: Floats) -> None:
        count, dimension = len(nets), nets.ndim - 1
        self._error, self._goal = error, goal
        self._sides = np.indices((2,) * dimension).reshape(dimension, -1).T
        self.result = Least(np.full(count, np.inf), np.full(count, np.inf), np.zeros((count, dimension)))
        zero = np.zeros((count, dimension))
        boxes = self._promising(_Boxes.of(np.arange(count), zero, zero + 1, nets))
        for _ in range(_HALVINGS * dimension):
            if not len(boxes.owner):
                break
            boxes = self._promising(boxes.halves())
        self._forget(boxes)

    def _promising(self, boxes: _Boxes) -> _Boxes:
        """The boxes that may still lower the result, after evaluation at their corners.

        The bounds of others are recorded.
        """
        self._bound_boxes(boxes)
        value = self.result.value
        aim = np.where(value > self._goal, self._goal, value - np.maximum(self._error, TOLERANCE * np.abs(value)))
        many = np.bincount(boxes.owner, minlength=len(aim)) > _MOST_BOXES
        kept = (boxes.bound < aim[boxes.owner]) & ~many[boxes.owner]
        self._forget(boxes.part(~kept))
        return boxes.part(kept)

    def _bound_boxes(self, boxes: _Boxes) -> None:
        """Take note of lower values at corners."""
        values = corners(boxes.net)
        best = np.argmin(values, axis=1)
        lowest = values[np.arange(len(values)), best]
        order = np.lexsort((lowest, boxes.owner))
        owner, first = np.unique(boxes.owner[order], return_index=True)
        better = lowest[order[first]] < self.result.value[owner]
        owner, chosen = owner[better], order[first][better]
        place = np.where(self._sides[best[chosen]], boxes.high[chosen], boxes.low[chosen])
        self.result.value[owner], self.result.place[owner] = lowest[chosen], 2 * place - 1

    def _forget(self, boxes: _Boxes) -> None:
        np.minimum.at(self.result.lower, boxes.owner, boxes.bound)
