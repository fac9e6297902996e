"""Sides of broken meshes that overlap very many others, found by a quick comparison with their neighbours."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.interfaces.side_groups import SideSet
from elvis.core.mapping.boxes import Boxes, BoxTree
from elvis.core.mapping.orientation import chunks

#: distance, relative to a side's size, up to which it is unclear whether a side lies on another
NEAR = 0.06
#: sides whose boxes hold a point of a side, in the mean, from which on it is not examined: it may lie on any of them
HOPELESS = 32
#: points of sides that are compared with others together
POINTS_AT_ONCE = 1 << 13
#: sides with which many others are compared together, and how often at most
OTHERS_AT_ONCE = 64
MOST_BLOCKS = 8
#: part of the examined sides that must be hopeless for the search to go on
WORTHWHILE = 0.25
#: room for the rounding of cosines between normals in single precision
COSINE_ROUNDING = 1e-6
#: room for the rounding of sizes and boxes in single precision, in sizes
SIZE_ROUNDING = 1e-6


def shares(chosen: Ints, count: int) -> Iterator[Ints]:
    """The sides ``chosen`` (k,), as many at a time as have `POINTS_AT_ONCE` points; count as in `SideSet.samples`."""
    most = max(1, count * count, 5)
    for part in chunks(len(chosen), max(1, POINTS_AT_ONCE // most)):
        yield chosen[part]


def surplus(sizes: NDArray[Any], others: NDArray[Any]) -> NDArray[Any]:
    """The excess of the enlarged boxes of ``others`` over the reach of sides of some sizes.

    Boxes are enlarged by `NEAR` of their own side's size, but sides are near one another by the smaller of both sizes:
    faces of a mesh that is one element deep would else be near all narrow faces of a wall.
    """
    return np.asarray(np.maximum(NEAR * np.maximum(others - sizes, 0) - SIZE_ROUNDING * others, 0))


def hopeless_sides(
    sides: SideSet, candidates: Ints, tree: BoxTree, normals: NDArray[Any], sizes: NDArray[Any], facing: float | None
) -> Bools:
    """(n,) sides for certain that have too many others at their points to be examined.

    candidates  (m,) the sides that are compared
    tree        over their boxes
    normals     (n, 3) into the elements, at the centres of all sides
    sizes       (n,) the diagonals of the boxes of all sides, before these were enlarged
    facing      cosine of the angle between normals below which two sides may coincide; None for all pairs

    A side is compared only with those next to it in the order of the tree.  The search ends as soon as few sides are
    found: it costs little if the mesh is sound, and almost nothing else is left to do if it is broken everywhere.
    """
    found = np.zeros(len(sides), bool)
    parts = list(shares(tree.order.astype(np.int64), 0))
    examined = 0
    for number in np.random.default_rng(0).permutation(len(parts)).tolist():
        own = candidates[parts[number]]
        found[own] = _are_hopeless(sides, own, tree.boxes[parts[number]], normals[own], sizes[own], facing)
        examined += len(own)
        if found.sum() < WORTHWHILE * examined:
            break
    return found


def _are_hopeless(
    sides: SideSet, own: Ints, boxes: Boxes, normals: NDArray[Any], sizes: NDArray[Any], facing: float | None
) -> Bools:
    """(k,) which of the sides ``own`` (k,) are hopeless for others of these."""
    which, points = sides.samples(own, 0)
    world = sides.at(points, own[which])
    most = HOPELESS * np.bincount(which, minlength=len(own))
    counts = np.zeros(len(own), np.int64)
    blocks = -(-len(own) // OTHERS_AT_ONCE)
    for number in range(min(blocks, MOST_BLOCKS)):
        others = np.arange(number, len(own), blocks)
        left = np.flatnonzero((counts <= most)[which])
        excess = surplus(sizes[which[left]], sizes[others, None])
        is_hit = _are_in(boxes[others], world[left], excess)
        is_hit &= _are_facing(normals, others, facing)[:, which[left]]
        # fewer than 256 others: their number fits into a byte
        hits = is_hit.view(np.uint8).sum(axis=0, dtype=np.uint8)
        counts += np.bincount(which[left], hits, len(own)).astype(np.int64)
    return counts > most


def _are_facing(normals: NDArray[Any], others: Ints, facing: float | None) -> Bools:
    """(m, k) whether sides ``others`` (m,) may coincide with sides that have the ``normals`` (k, 3)."""
    found = np.ones((len(others), len(normals)), bool)
    if facing is not None:
        found = normals[others] @ normals.T < facing - COSINE_ROUNDING
    found[np.arange(len(others)), others] = False
    return found


def _are_in(boxes: Boxes, points: Floats, excess: NDArray[Any]) -> Bools:
    """(m, k) whether boxes (m, 6), smaller by ``excess`` (m, k) at each side, hold points (k, 3)."""
    low, high = np.split(boxes.T.astype(np.float64)[:, :, None], 2)
    found = np.ones((len(boxes), len(points)), bool)
    for axis, place in enumerate(points.T.copy()):
        found &= low[axis] + excess <= place
        found &= place <= high[axis] - excess
    return found
