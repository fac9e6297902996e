"""Arcs of vortex cores in elements, joined to lines across the elements' borders.

The gradient of a continuous velocity still jumps at borders, and so do cores.  Ends on sides are joined to the nearest
end in an element that shares a vertex, within a fraction of the element's size, if both continue in about the same
direction.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.cores.tracing import Arc
from elvis.core.mapping import pointwise
from elvis.core.mapping.margins import heights
from elvis.core.mapping.patch import Patch

#: maximum distance of ends, relative to the size of the smaller element, and minimum cosine between their directions
APART, _ALIKE = 0.1, 0.5
#: tolerance for lying on a side of an element, and for arcs that are only a point, relative to the element's size
_ON_SIDE, _SHORT = 2e-6, 1e-5
#: maximum distance of the same place as seen from two elements, relative to their size
_SAME = 1e-7


@dataclass(frozen=True, eq=False)
class WorldArc:
    """An arc in the world.

    patch, arc  where it is
    points      (k, 3)
    outward     (2, 3) directions in which it goes on at its first and its last point
    on_side     (2,) whether these are on sides of the element
    runs_on_border  whether all of it is
    size        of the element
    """

    patch: int
    arc: Arc
    points: Floats
    outward: Floats
    on_side: tuple[bool, bool]
    runs_on_border: bool
    size: float

    @staticmethod
    def of(patch: Patch, number: int, arc: Arc) -> WorldArc:
        """An arc of a patch with its number."""
        rows = np.full(len(arc.xi), arc.row)
        points, jacobians = pointwise.positions_and_jacobians(patch, rows, arc.xi)
        along = np.einsum("nci,ni->nc", jacobians, arc.tangents)
        outward = np.stack([-along[0], along[-1]])
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        margin = heights(patch.shape, arc.xi).min(axis=1)
        size = float(np.linalg.norm(jacobians, axis=1).max())
        near = margin < _ON_SIDE
        return WorldArc(number, arc, points, outward, (bool(near[0]), bool(near[-1])), bool(near.all()), size)

    @property
    def is_point(self) -> bool:
        """Whether it has no length."""
        return bool(np.linalg.norm(np.diff(self.points, axis=0), axis=1).sum() < _SHORT * self.size)


@dataclass(frozen=True)
class Course:
    """A line: numbers of arcs, whether each is turned round, and whether the last one joins the first."""

    arcs: tuple[int, ...]
    turned: tuple[bool, ...]
    closed: bool


def distinct_arcs(arcs: Sequence[WorldArc]) -> list[WorldArc]:
    """The arcs without points, and without copies of arcs along borders that another element also has."""
    kept: list[WorldArc] = []
    borders: list[tuple[Floats, float]] = []
    for arc in arcs:
        if arc.is_point:
            continue
        if arc.runs_on_border:
            ends = np.concatenate([arc.points[[0, -1]], arc.points.mean(axis=0)[None]])
            ends = ends[:2][np.lexsort(ends[:2].round(9).T)]
            if any(np.abs(ends - other).max() < _SAME * max(arc.size, size) for other, size in borders):
                continue
            borders.append((ends, arc.size))
        kept.append(arc)
    return kept


def joined(arcs: Sequence[WorldArc], vertices: Sequence[Ints]) -> Iterator[Course]:
    """Lines of arcs; vertices (k,) of the mesh of each arc's element."""
    links = _links(arcs, vertices)
    done: set[int] = set()
    open_ends = [(number, end) for number in range(len(arcs)) for end in (0, 1) if (number, end) not in links]
    for number, end in [*open_ends, *((number, 0) for number in range(len(arcs)))]:
        if number in done:
            continue
        chain, turned = [], []
        is_closed = arcs[number].arc.closed
        while True:
            chain.append(number)
            turned.append(end == 1)
            done.add(number)
            beyond = links.get((number, 1 - end))
            if beyond is None:
                break
            if beyond[0] in done:
                is_closed = True
                break
            number, end = beyond
        yield Course(tuple(chain), tuple(turned), is_closed)


def _links(arcs: Sequence[WorldArc], vertices: Sequence[Ints]) -> dict[tuple[int, int], tuple[int, int]]:
    """Pairs of joined ends of arcs, each end as number and 0 or 1; the nearest pairs are joined first."""
    ends = [(i, end) for i, own in enumerate(arcs) for end in (0, 1) if own.on_side[end] and not own.arc.closed]
    if not ends:
        return {}
    width = max(APART * arcs[i].size for i, _ in ends)
    places = np.array([arcs[i].points[-end] for i, end in ends])
    cells = defaultdict(list)
    for number, cell in enumerate(map(tuple, np.floor(places / width).astype(int).tolist())):
        cells[cell].append(number)
    pairs = []
    for (x, y, z), inside in cells.items():
        around = [
            other for dx, dy, dz in product((-1, 0, 1), repeat=3) for other in cells.get((x + dx, y + dy, z + dz), ())
        ]
        for one, other in product(inside, around):
            if one < other:
                distance = float(np.linalg.norm(places[one] - places[other]))
                if _may_join(arcs, vertices, ends[one], ends[other], distance):
                    pairs.append((distance, one, other))
    links: dict[tuple[int, int], tuple[int, int]] = {}
    for _, one, other in sorted(pairs):
        first, second = ends[one], ends[other]
        if first not in links and second not in links:
            links[first], links[second] = second, first
    return links


def _may_join(
    arcs: Sequence[WorldArc], vertices: Sequence[Ints], first: tuple[int, int], second: tuple[int, int], distance: float
) -> bool:
    """Whether ends of different arcs are near enough, go on alike, and are in elements that touch."""
    (i, end), (j, other) = first, second
    if i == j or distance > APART * min(arcs[i].size, arcs[j].size):
        return False
    alike = -float(arcs[i].outward[end] @ arcs[j].outward[other])
    return alike > _ALIKE and bool(np.isin(vertices[i], vertices[j]).any())
