"""Boxes of cells, each bisected until its triangles are within a tolerance of the surface q = 0."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.rows import Rows
from elvis.core.mapping.orientation import chunks
from elvis.core.shapes import Shape
from elvis.core.triangles.distance_bounds import distance_bounds
from elvis.core.triangles.level_cells import CellBlock

#: halvings over which numbers of boxes without a bound are compared, and the ratios that they have at points or lines
_LEVELS_ALIKE, _LEAST_RATIO, _MOST_RATIO = 4, 0.6, 2.5
#: maximum number of boxes of a block that are examined together, and maximum bisections of cells
_MOST_BOXES, _MOST_HALVINGS = 1 << 17, 12
#: boxes that are bisected at a time
_AT_ONCE = 1 << 12
#: factor by which numbers of boxes may seem larger at first than in the end
_SLACK = 64


@dataclass(frozen=True, eq=False)
class Boxes(Rows):
    """Some boxes of a cell.

    rows      (n,) of the patch
    index     (n, d) counts boxes of their size from the cell's corner
    halvings  (n,) how often their cells were bisected
    bounds    (n,) how far triangles are from the surface there at most
    """

    rows: Ints
    index: Ints
    halvings: Ints
    bounds: Floats


@dataclass(frozen=True, eq=False)
class CellBoxes:
    """Boxes of one cell of elements of a patch that may have a zero.

    splits   halvings in each direction before all directions are bisected together
    leaves   boxes that are not bisected
    divided  boxes that are
    """

    patch: int
    shape: Shape
    cell: int
    splits: tuple[int, ...]
    leaves: Boxes
    divided: Boxes


def refined(blocks: Sequence[CellBlock], tolerance: float) -> list[CellBoxes]:
    """The boxes of cells whose triangles are within the tolerance, wherever bounds show that.

    Raises ElvisError if too many boxes are needed.
    """
    parts = [(block, *_refined(block, tolerance)) for block in blocks]
    parts.sort(key=lambda part: (part[0].patch, part[0].cell))
    found = []
    for _, same in groupby(parts, key=lambda part: (part[0].patch, part[0].cell)):
        block, *lists = zip(*same, strict=True)
        first = block[0]
        d = first.shape.dimension
        leaves, divided = (_joined([each for own in parts for each in own], d) for parts in lists)
        if len(leaves):
            found.append(CellBoxes(first.patch, first.shape, first.cell, first.splits, leaves, divided))
    return found


def _refined(block: CellBlock, tolerance: float) -> tuple[list[Boxes], list[Boxes]]:
    """Leaves and divided boxes of a block, by levels.

    Boxes at points where the gradient or the Jacobian vanishes stay without a bound but their size.  Where the limits
    do not let them become small enough, they are leaves as they are.
    """
    leaves, divided = list[Boxes](), list[Boxes]()
    counts = list[int]()
    for halvings in range(_MOST_HALVINGS + 1):
        if not len(block.rows):
            return leaves, divided
        bound, is_regular = distance_bounds(block)
        boxes = Boxes(block.rows, block.index, np.full(len(bound), halvings), bound)
        is_far = bound > tolerance
        counts.append(int((is_far & ~is_regular).sum()))
        is_last = halvings == _MOST_HALVINGS or _are_many(bound[is_far], tolerance)
        if not is_far.any() or (is_last and counts[-1] == is_far.sum() and _stay(counts)):
            leaves.append(boxes)
            return leaves, divided
        if is_last:
            break
        leaves.append(boxes.part(~is_far))
        divided.append(boxes.part(is_far))
        far = np.flatnonzero(is_far)
        block = CellBlock.joined([block.part(far[some]).halved() for some in chunks(len(far), _AT_ONCE)])
    raise ElvisError(f"expected a tolerance that some millions of triangles reach, found {tolerance:g}")


def _are_many(bounds: Floats, tolerance: float) -> bool:
    """Whether boxes with these bounds are too many to be bisected.

    Bounds decrease with the square of the size of boxes, and the number of boxes on a surface increases with it.
    """
    foreseen = float((bounds / tolerance).sum())
    return len(bounds) * 8 > _MOST_BOXES or foreseen > _SLACK * _MOST_BOXES


def _joined(parts: Sequence[Boxes], dimension: int) -> Boxes:
    """All boxes of several lists."""
    empty = Boxes(np.empty(0, np.int64), np.empty((0, dimension), np.int64), np.empty(0, np.int64), np.empty(0))
    names = ("rows", "index", "halvings", "bounds")
    return Boxes(*(np.concatenate([getattr(own, name) for own in (empty, *parts)]) for name in names))


def _stay(counts: Sequence[int]) -> bool:
    """Whether numbers of boxes without a bound, after each halving, are those at points or lines.

    Boxes at a surface become four times as many, or fewer once slopes have bounds; at a point they stay as many, at a
    line they become twice as many.
    """
    last = counts[-_LEVELS_ALIKE:]
    ratios = [after / before for before, after in pairwise(last) if before]
    return len(ratios) == _LEVELS_ALIKE - 1 and all(_LEAST_RATIO <= ratio <= _MOST_RATIO for ratio in ratios)
