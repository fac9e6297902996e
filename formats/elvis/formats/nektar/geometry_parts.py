"""A part of a mesh, taken out of what files hold before a mesh is made of it.

Tables of the whole are looked at and not copied, so they may be mapped; of all their rows no more is kept than the
row of an id, the first vertex, and whether one is chosen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.arrays import Ints, distinct
from elvis.core.errors import FormatError
from elvis.core.portions.partition import cut_curve
from elvis.core.shapes import Shape
from elvis.formats.nektar.assembly import (
    AT_ONCE,
    Lookup,
    RawCurves,
    RawGeometry,
    check_elements,
    coordinates,
    lookups_of,
)
from elvis.formats.nektar.geometry_xml import owned

_NONE = np.empty(0, np.int64)


@dataclass(frozen=True, eq=False)
class RawPart:
    """Some elements of a mesh, and what they are made of; all else as in `elvis.core.portions.Portion`."""

    raw: RawGeometry
    rows: Mapping[Shape | None, Ints]
    edges: Ints
    faces: Ints
    sides: Ints
    elements: int
    triangles: int


def part_of(raw: RawGeometry, number: int, count: int, carriers: Ints | None) -> RawPart:
    """One of ``count`` parts of a mesh, which are ranges along a curve.

    carriers  ids of the elements between which sides are inner ones, None for all
    FormatError where what a part needs of the whole can't be.
    """
    try:
        return _Whole(raw).part(number, count, carriers)
    except FormatError as error:
        raise error.within(raw.file, "GEOMETRY") from error


class _Whole:
    """A mesh as files hold it, with the rows of all ids."""

    def __init__(self, raw: RawGeometry) -> None:
        check_elements(raw)
        self.raw, self._lookups = raw, lookups_of(raw)
        self._vertices = coordinates(raw.vertices, raw.space, "vertices")

    def part(self, number: int, count: int, carriers: Ints | None) -> RawPart:
        """See `part_of`."""
        raw, top = self.raw, self.raw.dimension
        rows = self._elements(number, count)
        used = {top: self._numbers(rows, top)}
        for dimension in range(top - 1, -1, -1):
            used[dimension] = self._used(rows, dimension + 1)
            rows |= self._split(used[dimension], dimension)
        edges, faces = self._curved(raw.edge_curves, used, 1), self._curved(raw.face_curves, used, 2)
        own = replace(
            raw,
            vertex_ids=raw.vertex_ids[rows[None]],
            vertices=self._vertices[rows[None]],
            tables={shape: (ids[rows[shape]], members[rows[shape]]) for shape, (ids, members) in raw.tables.items()},
            edge_curves=_some_curves(raw.edge_curves, edges),
            face_curves=_some_curves(raw.face_curves, faces),
        )
        sides = self._inner_sides(used[top - 1], carriers) if top > 1 else _NONE
        triangles = len(raw.tables[Shape.TRIANGLE][0]) if Shape.TRIANGLE in raw.tables else 0
        return RawPart(own, rows, edges, faces, sides, self._lookups[top].count, triangles)

    def _shapes(self, dimension: int) -> list[Shape]:
        return [shape for shape in Shape.of_dimension(dimension) if shape in self.raw.tables]

    def _elements(self, number: int, count: int) -> dict[Shape | None, Ints]:
        """(n,) rows of the elements of a part, by shape."""
        total = len(self._vertices)
        first: list[NDArray[Any]] = [np.arange(total, dtype=np.min_scalar_type(-total))]
        for dimension in range(1, self.raw.dimension + 1):
            below = np.concatenate(first)
            first = [below[self._members(shape, np.s_[:, 0])] for shape in self._shapes(dimension)]
        held = np.sum([np.bincount(own, minlength=total) for own in first], axis=0)
        is_own = cut_curve(self._vertices, held, count) == number
        return {
            shape: np.flatnonzero(is_own[own])
            for shape, own in zip(self._shapes(self.raw.dimension), first, strict=True)
        }

    def _members(self, shape: Shape, which: Any) -> Ints:
        """Numbers of what some entities are made of: rows, of faces triangles first."""
        return self._lookups[shape.dimension - 1].rows(self.raw.tables[shape][1][which], f"entries {shape.tag}")

    def _used(self, rows: Mapping[Shape | None, Ints], dimension: int) -> Ints:
        """(n,) numbers of what entities of a dimension with these rows are made of, ascending."""
        every = [self._members(shape, rows[shape]).reshape(-1) for shape in self._shapes(dimension)]
        return distinct(np.sort(np.concatenate([_NONE, *every])))

    def _starts(self, dimension: int) -> list[tuple[Shape, int]]:
        """The shapes of a dimension, and the number of the first entity of each."""
        shapes = self._shapes(dimension)
        counts = [len(self.raw.tables[shape][0]) for shape in shapes]
        return list(zip(shapes, [0, *np.cumsum(counts).tolist()], strict=False))

    def _numbers(self, rows: Mapping[Shape | None, Ints], dimension: int) -> Ints:
        """(n,) numbers of entities of a dimension with these rows, ascending."""
        return np.concatenate([_NONE, *(start + rows[shape] for shape, start in self._starts(dimension))])

    def _split(self, numbers: Ints, dimension: int) -> dict[Shape | None, Ints]:
        """The rows of entities of a dimension with these numbers, by shape."""
        if dimension == 0:
            return {None: numbers}
        starts = self._starts(dimension)
        places = np.searchsorted(numbers, [start for _, start in starts])
        own = np.split(numbers, places[1:])
        return {shape: some - start for (shape, start), some in zip(starts, own, strict=True)}

    def _curved(self, curves: RawCurves, used: Mapping[int, Ints], dimension: int) -> Ints:
        """(n,) numbers of the curves of entities of a dimension that are used."""
        if not len(curves.entities):
            return _NONE
        lookup = self._lookups[dimension]
        is_used = np.zeros(lookup.count, bool)
        is_used[used.get(dimension, _NONE)] = True
        return np.flatnonzero(is_used[lookup.rows(curves.entities, "curves")])

    def _inner_sides(self, own: Ints, carriers: Ints | None) -> Ints:
        """Those of the own sides (n,) that have elements on both sides."""
        dimension = self.raw.dimension
        is_own = np.zeros(self._lookups[dimension - 1].count, bool)
        is_own[own] = True
        carrier = None if carriers is None else Lookup(carriers, "element")
        counts = np.zeros(len(own), np.int64)
        for shape in self._shapes(dimension):
            ids = self.raw.tables[shape][0]
            for start in range(0, len(ids), AT_ONCE):
                some: Any = slice(start, start + AT_ONCE)
                if carrier is not None:
                    some = start + np.flatnonzero(carrier.present(ids[some]))
                sides = self._members(shape, some)
                np.add.at(counts, np.searchsorted(own, sides[is_own[sides]]), 1)
        return own[counts > 1]


def _some_curves(curves: RawCurves, which: Ints) -> RawCurves:
    """Some of the curves."""
    starts = np.cumsum(curves.counts) - curves.counts
    points = curves.points[owned(curves.counts[which], starts[which], len(curves.points))]
    return RawCurves(curves.entities[which], curves.kinds[which], curves.counts[which], points)
