"""A part of a mesh, cut out of the raw geometry before a mesh is built.

Tables of the whole are read and not copied, so they may be mapped.  In memory are only the part of each element and, if
ids do not form long runs, the row of each.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Ints, distinct, narrow_ints
from elvis.core.base.errors import FormatError
from elvis.core.data.mesh import Counts
from elvis.core.mapping.orientation import chunks
from elvis.core.portions.partition import cut_curve
from elvis.core.shapes import Shape
from elvis.formats.nektar.assembly import (
    AT_ONCE,
    Lookup,
    RawCurves,
    RawGeometry,
    check_elements,
    coordinates,
    counts_of,
    lookups_of,
)
from elvis.formats.nektar.geometry.xml import owned

_NONE = np.empty(0, np.int64)


@dataclass(frozen=True, eq=False)
class RawPart:
    """Some elements of a mesh and the entities that they consist of.

    Everything else is as in `elvis.core.portions.Portion`.
    """

    raw: RawGeometry
    rows: Mapping[Shape | None, Ints]
    edges: Ints
    faces: Ints
    sides: Ints
    counts: Counts
    triangles: int


class RawParts:
    """A mesh as files hold it, cut into parts, which are ranges along a curve; see `RawParts.of`.

    numbers   for each shape of the elements (n,) which part each is in
    carriers  ids of the elements between which sides are inner ones, None for all
    Raises FormatError if there are no elements, or what parts need of the whole can't be.
    """

    def __init__(self, raw: RawGeometry, count: int, carriers: Ints | None) -> None:
        self.raw, self.count, self._carriers = raw, count, carriers
        with self._errors():
            check_elements(raw)
            self._lookups = lookups_of(raw)
            self._vertices = coordinates(raw.vertices, raw.space, "vertices")
            self.numbers = self._cut(count)
            self._counts = counts_of(raw, self._lookups)

    @contextmanager
    def _errors(self) -> Iterator[None]:
        """Errors of the block name the file."""
        try:
            yield
        except FormatError as error:
            raise error.within(self.raw.file, "GEOMETRY") from error

    def of(self, chosen: Bools) -> RawPart:
        """Several parts together; ``chosen`` (count,) selects them.

        Raises FormatError if they refer to entities that do not exist.
        """
        with self._errors():
            return self._of(chosen)

    def _of(self, chosen: Bools) -> RawPart:
        raw, top = self.raw, self.raw.dimension
        rows: dict[Shape | None, Ints] = {shape: np.flatnonzero(chosen[own]) for shape, own in self.numbers.items()}
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
        sides = used[top - 1][self._is_inner[used[top - 1]]] if top > 1 else _NONE
        triangles = len(raw.tables[Shape.TRIANGLE][0]) if Shape.TRIANGLE in raw.tables else 0
        numbers = {kind: narrow_ints(some, self._counts.total) for kind, some in rows.items()}
        sides = narrow_ints(sides, self._counts.total)
        return RawPart(own, numbers, edges, faces, sides, self._counts, triangles)

    def _shapes(self, dimension: int) -> list[Shape]:
        return [shape for shape in Shape.of_dimension(dimension) if shape in self.raw.tables]

    def _cut(self, count: int) -> dict[Shape, NDArray[Any]]:
        """(n,) part of each element, from 0 to ``count`` - 1, by shape: the part of its first vertex."""
        total = len(self._vertices)
        held = np.zeros(total, np.int64)
        first = {}
        for shape in self._shapes(self.raw.dimension):
            first[shape] = own = np.empty(len(self.raw.tables[shape][0]), np.min_scalar_type(-total))
            for some in chunks(len(own), AT_ONCE):
                own[some] = self._first_vertices(shape, some)
                np.add.at(held, own[some], 1)
        parts = cut_curve(self._vertices, held, count).astype(np.min_scalar_type(count))
        return {shape: parts[own] for shape, own in first.items()}

    def _first_vertices(self, shape: Shape, which: Any) -> Ints:
        """(n,) first vertex of each entity: the first vertex of its first edge or first face."""
        numbers = self._members(shape, (which, 0))
        if shape.dimension == 1:
            return numbers
        found = np.empty(len(numbers), np.int64)
        for own, start in self._starts(shape.dimension - 1):
            chosen = np.flatnonzero((numbers >= start) & (numbers < start + len(self.raw.tables[own][0])))
            found[chosen] = self._first_vertices(own, numbers[chosen] - start)
        return found

    def _members(self, shape: Shape, which: Any) -> Ints:
        """Members of some entities as rows; for faces, triangles are numbered first."""
        return self._lookups[shape.dimension - 1].rows(self.raw.tables[shape][1][which], f"entries {shape.tag}")

    def _used(self, rows: Mapping[Shape | None, Ints], dimension: int) -> Ints:
        """(n,) ascending numbers of the members of the entities of a dimension with these rows."""
        every = [self._members(shape, rows[shape]).reshape(-1) for shape in self._shapes(dimension)]
        return distinct(np.concatenate([_NONE, *every]))

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
        numbers = self._lookups[dimension].rows(curves.entities, "curves")
        return np.flatnonzero(np.isin(numbers, used.get(dimension, _NONE)))

    @cached_property
    def _is_inner(self) -> Bools:
        """(n,) whether sides, by their numbers, have elements on both sides; found once for all parts."""
        dimension = self.raw.dimension
        carrier = None if self._carriers is None else Lookup(self._carriers, "element")
        counts = np.zeros(self._lookups[dimension - 1].count, np.uint8)
        for shape in self._shapes(dimension):
            ids = self.raw.tables[shape][0]
            for span in chunks(len(ids), AT_ONCE):
                chosen = span if carrier is None else span.start + np.flatnonzero(carrier.present(ids[span]))
                # 1 of the type of the counts, otherwise it is forty times slower
                np.add.at(counts, self._members(shape, chosen).reshape(-1), np.uint8(1))
        return np.asarray(counts > 1)


def _some_curves(curves: RawCurves, which: Ints) -> RawCurves:
    """Some of the curves."""
    starts = np.cumsum(curves.counts) - curves.counts
    points = curves.points[owned(curves.counts[which], starts[which], len(curves.points))]
    return RawCurves(curves.entities[which], curves.kinds[which], curves.counts[which], points)
