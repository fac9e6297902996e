"""Subdivision of boxes until at most one polynomial changes its sign in each, for regions by signs of several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.polynomials.boxnets import halves
from elvis.core.quantities.regions import Region
from elvis.core.quantities.tree import Node

#: halvings of boxes in which several polynomials change their signs, and how many such boxes may be bisected: at least,
#: and for each box at first
_DEPTH = 16
_MOST = 1 << 10
_MOST_OF_ONE = 8


@dataclass(frozen=True, eq=False)
class CellBoxes(Rows):
    """Boxes in cells of elements.

    index      (n,)          numbers of elements
    low, high  (n, 3)        corners in the cell's coordinates in [0, 1]^3
    nets       (n, D, D, D)  of each polynomial on the boxes
    band       (n,)          magnitudes below which the sign of each polynomial is unknown
    """

    index: Ints
    low: Floats
    high: Floats
    nets: Mapping[Node, Floats]
    band: Mapping[Node, Floats]

    @staticmethod
    def whole(nets: Mapping[Node, Floats], band: Mapping[Node, Floats]) -> CellBoxes:
        """Whole cells of as many elements as nets are of."""
        count = len(next(iter(nets.values())))
        low = np.zeros((count, 3))
        return CellBoxes(np.arange(count), low, low + 1, nets, band)

    def halved(self) -> CellBoxes:
        """Both halves in every direction that polynomials depend on."""
        boxes = self
        for axis in range(3):
            if all(own.shape[1 + axis] == 1 for own in boxes.nets.values()):
                continue
            nets = {node: np.concatenate(halves(own, axis)) for node, own in boxes.nets.items()}
            middle = (boxes.low[:, axis] + boxes.high[:, axis]) / 2
            boxes = boxes.part(np.tile(np.arange(len(boxes)), 2))
            boxes.low[len(middle) :, axis] = middle
            boxes.high[: len(middle), axis] = middle
            boxes = replace(boxes, nets=nets)
        return boxes

    def signs(self) -> dict[Node, Ints]:
        """(n,) of each polynomial: 1, -1, or 0 if unknown."""
        found = {}
        for node, own in self.nets.items():
            axes, band = tuple(range(1, own.ndim)), self.band[node]
            found[node] = (own.min(axis=axes) > band).astype(np.int64) - (own.max(axis=axes) < -band)
        return found


@dataclass(frozen=True, eq=False)
class Separated:
    """Boxes inside of regions and at their borders.

    single  number of a region, a polynomial, and boxes with only its net, which is negative inside
    whole   number of a region, and boxes inside
    left    boxes in which several polynomials may be zero
    """

    single: tuple[tuple[int, Node, CellBoxes], ...]
    whole: tuple[tuple[int, CellBoxes], ...]
    left: CellBoxes


def separated(regions: Sequence[Region], boxes: CellBoxes) -> Separated:
    """Boxes bisected until one polynomial at most changes its sign in each, or they are too many.

    regions  that have no part in common
    """
    single: list[tuple[int, Node, CellBoxes]] = []
    whole: list[tuple[int, CellBoxes]] = []
    most = max(_MOST, _MOST_OF_ONE * len(boxes))
    for depth in range(_DEPTH + 1):
        signs = boxes.signs()
        states = np.stack([np.broadcast_to(region.holds(signs), len(boxes)) for region in regions])
        is_open = (states <= 0).all(axis=0) & (states == 0).any(axis=0)
        is_single = is_open & (np.sum([own == 0 for own in signs.values()], axis=0) == 1)
        for number, (region, state) in enumerate(zip(regions, states, strict=True)):
            turning, same = _oriented(region, boxes.part(is_single & (state == 0)))
            single += [(number, *each) for each in turning]
            whole += [(number, each) for each in (boxes.part(state > 0), *same)]
        boxes = boxes.part(is_open & ~is_single)
        if not len(boxes) or depth == _DEPTH or len(boxes) > most:
            break
        boxes = boxes.halved()
    return Separated(tuple(single), tuple(whole), boxes)


def _oriented(region: Region, boxes: CellBoxes) -> tuple[list[tuple[Node, CellBoxes]], list[CellBoxes]]:
    """Boxes by the only polynomial of unknown sign, with nets that are negative inside; boxes inside for both signs."""
    signs, turning, same = boxes.signs(), [], []
    for node, own in signs.items():
        if_less, if_greater = (region.holds({**signs, node: np.where(own == 0, sign, own)}) for sign in (-1, 1))
        same.append(boxes.part((own == 0) & (if_less > 0) & (if_greater > 0)))
        for sign in (1, -1):
            part = boxes.part((own == 0) & (if_less == sign) & (if_greater == -sign))
            if len(part):
                turning.append((node, replace(part, nets={node: sign * part.nets[node]}, band={node: part.band[node]})))
    return turning, same
