"""Convert raw geometry, which names everything by id, to the mesh in memory, which names everything by row.

The codecs of geometry share `RawGeometry`; the pieces of a partitioned mesh become one; every entity that is referred
to must exist.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import (
    Bools,
    Floats,
    Ints,
    among,
    frozen_floats,
    frozen_ints,
    frozen_view,
    joined_columns,
    joined_ints,
    narrow_ints,
)
from elvis.core.base.errors import FormatError
from elvis.core.data.mesh import Composite, Counts, Curves, Entities, Mesh
from elvis.core.polynomials.points import PointsType
from elvis.core.shapes import Shape
from elvis.formats.nektar.numbers import IdList

#: a composite before its ids are compared with the mesh: id, tokens (tag letter, list), name
RawComposite = tuple[int, tuple[tuple[str, IdList], ...], str | None]


@dataclass(frozen=True, eq=False)
class RawCurves:
    """Curved edges or faces: ids of the entities, PointsType numbers, number of points of each, points (m, 3)."""

    entities: Ints
    kinds: Ints
    counts: Ints
    points: Floats

    @staticmethod
    def none() -> RawCurves:
        """Nothing is curved."""
        empty = np.empty(0, np.int64)
        return RawCurves(empty, empty, empty, np.empty((0, 3)))

    @staticmethod
    def joined(parts: Sequence[RawCurves]) -> RawCurves:
        """All curves of several parts; there may be none."""
        if not parts:
            return RawCurves.none()
        return RawCurves(*joined_columns((own.entities, own.kinds, own.counts, own.points) for own in parts))


@dataclass(frozen=True, eq=False)
class RawGeometry:
    """A mesh, or one piece of a partitioned one.

    tables  by shape: ids (n,) and members (n, k), the ids of vertices, edges or faces in file order
    """

    file: str
    dimension: int
    space: int
    vertex_ids: Ints
    vertices: Floats
    tables: Mapping[Shape, tuple[Ints, Ints]]
    edge_curves: RawCurves = field(default_factory=RawCurves.none)
    face_curves: RawCurves = field(default_factory=RawCurves.none)
    composites: tuple[RawComposite, ...] = ()
    domains: Mapping[int, IdList] = field(default_factory=dict)


#: rows examined together if there may be many
AT_ONCE = 1 << 17
#: ids up to this multiple of their number are found by a table, unless their runs average this many ids or more
_DENSE, _LONG = 4, 64


class Lookup:
    """Finds the row of each id in an array of distinct ids; ``what`` names the entities in messages.

    Ids that increase by one from row to row are a run.  Long runs are stored alone, so usual ids take no memory; other
    ids are stored as a table by id, or, if that were long, as all runs of any length.
    """

    def __init__(self, ids: Ints, what: str) -> None:
        self._what, self.count = what, len(ids)
        self._table: NDArray[Any] | None = None
        if len(ids) and ids.min() < 0:
            raise FormatError(f"expected {what} ids from 0 up, found {ids.min()}")
        is_dense = len(ids) > 0 and ids.max() < _DENSE * len(ids) + AT_ONCE
        starts = _starts_of_runs(ids, 1 + len(ids) // _LONG if is_dense else len(ids))
        if starts is None:
            self._table, again = _rows_by_id(ids)
        else:
            firsts = ids[starts].astype(np.int64)
            order = np.argsort(firsts, kind="stable")
            self._starts, self._firsts = starts[order], firsts[order]
            self._ends = self._firsts + np.diff(starts, append=len(ids))[order]
            again = self._firsts[1:][self._firsts[1:] < self._ends[:-1]]
        if len(again):
            raise FormatError(f"expected every {what} once, found {what} {again[0]} twice")

    @property
    def ids(self) -> Ints:
        """The ids, ascending."""
        if self._table is not None:
            return np.flatnonzero(self._table >= 0)
        counts = self._ends - self._firsts
        return np.repeat(self._ends - np.cumsum(counts), counts) + np.arange(self.count)

    def below(self, ids: Ints) -> Ints:
        """(n,) how many of its ids are less than each."""
        if self._table is not None:
            return np.searchsorted(self.ids, ids)
        counts = self._ends - self._firsts
        before = np.append(0, np.cumsum(counts))
        run = np.searchsorted(self._firsts, ids, side="right") - 1
        found = before[run] + np.minimum(ids - self._firsts[run], counts[run]) if len(counts) else np.zeros_like(ids)
        return np.where(run < 0, 0, found)

    def present(self, ids: Ints) -> Bools:
        """Whether each id (n,) is there."""
        found = np.empty(len(ids), bool)
        for start in range(0, len(ids), AT_ONCE):
            found[start : start + AT_ONCE] = self._find_rows(ids[start : start + AT_ONCE])[1]
        return found

    def rows(self, ids: Ints, user: str) -> Ints:
        """Rows of the ids, in their shape; raises FormatError if one is unknown, ``user`` says who names it."""
        return self.into_rows(np.array(ids), user)

    def into_rows(self, ids: Ints, user: str) -> Ints:
        """`rows` that overwrites the array if possible: no second one of its size is needed."""
        ids = np.ascontiguousarray(ids) if ids.flags.writeable else np.array(ids)
        flat = ids.reshape(-1)
        for start in range(0, len(flat), AT_ONCE):
            part = flat[start : start + AT_ONCE]
            rows, known = self._find_rows(part)
            if not known.all():
                wrong = part[~known][0]
                raise FormatError(f"expected {self._what} ids that exist in the {user}, found {self._what} {wrong}")
            part[:] = rows
        return ids

    def _find_rows(self, ids: Ints) -> tuple[Ints, Bools]:
        """Rows, and whether they are right."""
        if self._table is not None:
            rows = self._table[np.clip(ids, 0, len(self._table) - 1)]
            return rows, (rows >= 0) & (ids >= 0) & (ids < len(self._table))
        if not len(self._firsts):
            return np.zeros_like(ids), np.zeros(ids.shape, bool)
        run: Any = 0
        if len(self._firsts) > 1:
            run = np.maximum(np.searchsorted(self._firsts, ids, side="right") - 1, 0)
        rows = ids + (self._starts - self._firsts)[run]
        return rows, (ids >= self._firsts[run]) & (ids < self._ends[run])


def _starts_of_runs(ids: Ints, most: int) -> Ints | None:
    """(m,) rows where an id is not one more than before, first of all 0; None if these are more than ``most``."""
    found = [np.arange(min(len(ids), 1))]
    count = 1
    for start in range(1, len(ids), AT_ONCE):
        some = ids[start - 1 : start + AT_ONCE].astype(np.int64)
        found.append(start + np.flatnonzero(np.diff(some) != 1))
        count += len(found[-1])
        if count > most:
            return None
    return np.concatenate(found)


def _rows_by_id(ids: Ints) -> tuple[NDArray[Any], Ints]:
    """Row by id, -1 for missing ids, and the ids that occur twice."""
    table = np.full(int(ids.max()) + 1, -1, np.int32 if len(ids) < 1 << 31 else np.int64)
    spans = [(start, min(start + AT_ONCE, len(ids))) for start in range(0, len(ids), AT_ONCE)]
    for start, stop in spans:
        table[ids[start:stop]] = np.arange(start, stop)
    again = [ids[start:stop][table[ids[start:stop]] != np.arange(start, stop)] for start, stop in spans]
    return table, np.concatenate(again)


def unite(pieces: Sequence[RawGeometry]) -> RawGeometry:
    """One mesh of all pieces; entities keep the order of first appearance.

    Raises FormatError if pieces differ in dimension, or give one entity other members.
    """
    first = pieces[0]
    if len(pieces) == 1:
        return _with_each_vertex_once(first)
    for piece in pieces[1:]:
        if (piece.dimension, piece.space) != (first.dimension, first.space):
            expected = f"DIM {first.dimension} and SPACE {first.space} as in {first.file}"
            raise FormatError(f"expected {expected}, found {piece.dimension} and {piece.space}", file=piece.file)

    vertex_ids = np.concatenate([piece.vertex_ids for piece in pieces])
    kept = first_rows(vertex_ids)
    vertices = np.concatenate([piece.vertices for piece in pieces])
    return RawGeometry(
        first.file,
        first.dimension,
        first.space,
        vertex_ids[kept],
        vertices[kept],
        {shape: _unite_table(shape, pieces) for shape in Shape if any(shape in piece.tables for piece in pieces)},
        _unite_curves([piece.edge_curves for piece in pieces]),
        _unite_curves([piece.face_curves for piece in pieces]),
        _unite_composites(pieces),
        _unite_domains(pieces),
    )


def _with_each_vertex_once(raw: RawGeometry) -> RawGeometry:
    """The geometry without vertices that are repeated at the same place, which the solver skips."""
    ids = raw.vertex_ids
    if (ids[1:] > ids[:-1]).all():
        return raw
    _, first, which = np.unique(ids, return_index=True, return_inverse=True)
    if len(first) == len(ids) or not np.array_equal(raw.vertices, raw.vertices[first[which.reshape(-1)]]):
        return raw
    kept = np.sort(first)
    return replace(raw, vertex_ids=ids[kept], vertices=raw.vertices[kept])


def first_rows(ids: Ints) -> Ints:
    """(n,) rows where an id appears for the first time, ascending."""
    return np.sort(np.unique(ids, return_index=True)[1])


def _unite_table(shape: Shape, pieces: Sequence[RawGeometry]) -> tuple[Ints, Ints]:
    ids, members = joined_columns(piece.tables[shape] for piece in pieces if shape in piece.tables)
    _, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
    if not np.array_equal(members, members[first[inverse]]):
        wrong = int(np.flatnonzero((members != members[first[inverse]]).any(axis=1))[0])
        raise FormatError(
            f"expected the same members of {shape.label.lower()} {ids[wrong]} in all pieces, found others",
            file=pieces[0].file,
        )
    kept = np.sort(first)
    return ids[kept], members[kept]


def _unite_curves(parts: Sequence[RawCurves]) -> RawCurves:
    every = RawCurves.joined(parts)
    kept = first_rows(every.entities)
    is_kept = np.zeros(len(every.entities), bool)
    is_kept[kept] = True
    points = every.points[np.repeat(is_kept, every.counts)]
    return RawCurves(every.entities[kept], every.kinds[kept], every.counts[kept], points)


def _unite_composites(pieces: Sequence[RawGeometry]) -> tuple[RawComposite, ...]:
    """Composites by id, the tokens of all pieces put together tag by tag."""
    found: dict[int, dict[str, list[IdList]]] = {}
    names: dict[int, str | None] = {}
    for piece in pieces:
        for id, tokens, name in piece.composites:
            names[id] = names.get(id) or name
            for tag, ids in tokens:
                found.setdefault(id, {}).setdefault(tag, []).append(ids)
    return tuple(
        (id, tuple((tag, _unite_lists(lists)) for tag, lists in found.get(id, {}).items()), names[id]) for id in names
    )


def _unite_domains(pieces: Sequence[RawGeometry]) -> dict[int, IdList]:
    found: dict[int, list[IdList]] = {}
    for piece in pieces:
        for id, ids in piece.domains.items():
            found.setdefault(id, []).append(ids)
    return {id: _unite_lists(lists) for id, lists in found.items()}


def _unite_lists(lists: list[IdList]) -> IdList:
    """The ranges of all lists, each once; ids that several ranges hold come with the first."""
    ranges = np.stack([np.concatenate([ids.first for ids in lists]), np.concatenate([ids.last for ids in lists])])
    kept = np.sort(np.unique(ranges, axis=1, return_index=True)[1])
    return IdList(ranges[0, kept], ranges[1, kept])


def mesh_of_ids(raw: RawGeometry) -> Mesh:
    """A mesh that holds only the ids of the elements in ``raw`` that have the mesh's dimension."""
    ids = {
        shape: frozen_view(raw.tables[shape][0]) for shape in Shape.of_dimension(raw.dimension) if shape in raw.tables
    }
    entities = {shape: Entities(own, frozen_ints(np.empty((len(own), 0)))) for shape, own in ids.items()}
    return Mesh(raw.dimension, raw.space, frozen_ints(np.empty(0)), frozen_floats(np.empty((0, 3))), entities)


#: dimension of entities whose tags denote no single shape
_DIMENSIONS = {"V": 0, "E": 1, "F": 2}


def assemble(raw: RawGeometry, *, is_part: bool = False) -> Mesh:
    """The mesh; raises FormatError if an id is unknown or given twice, or a curve or coordinate can't be.

    The members in ``raw`` are overwritten, so that a mesh is never held twice.

    is_part  whether there may be no elements, as the mesh is a part of another
    """
    try:
        return _assemble(raw, is_part)
    except FormatError as error:
        raise error.within(raw.file, "GEOMETRY") from error


def _assemble(raw: RawGeometry, is_part: bool) -> Mesh:
    lookups = lookups_of(raw)
    if not is_part:
        check_elements(raw)
    composites = _composites(raw, lookups)
    return Mesh(
        raw.dimension,
        raw.space,
        frozen_ints(raw.vertex_ids),
        coordinates(raw.vertices, raw.space, "vertices"),
        {shape: _entities(shape, *table, lookups[shape.dimension - 1]) for shape, table in raw.tables.items()},
        _edge_curves(raw, lookups[1]),
        _face_curves(raw, lookups[2]),
        composites,
        _domains(raw, composites),
    )


def check_elements(raw: RawGeometry) -> None:
    """Raise FormatError if there are none."""
    if not any(len(_ids(raw, shape)) for shape in Shape.of_dimension(raw.dimension)):
        raise FormatError(f"expected elements of dimension {raw.dimension}, found none")


def lookups_of(raw: RawGeometry) -> list[Lookup]:
    """Vertices, edges, faces and volume elements by dimension; faces are the triangles, then the quadrilaterals."""
    names = ["vertex", "edge", "face", "element"]
    names[raw.dimension] = "element"
    tables = [[raw.tables[shape][0] for shape in Shape.of_dimension(d) if shape in raw.tables] for d in (1, 2, 3)]
    ids = [own[0] if len(own) == 1 else joined_ints(own) for own in tables]
    return [Lookup(numbers, name) for numbers, name in zip([raw.vertex_ids, *ids], names, strict=True)]


def _entities(shape: Shape, ids: Ints, members: Ints, lookup: Lookup) -> Entities:
    rows = lookup.into_rows(members, f"entries {shape.tag}")
    return Entities(frozen_ints(ids), narrow_ints(rows, lookup.count))


def _ids(raw: RawGeometry, shape: Shape) -> Ints:
    return raw.tables[shape][0] if shape in raw.tables else np.empty(0, np.int64)


def coordinates(points: Floats, space: int, what: str) -> Floats:
    """Finite points, with the coordinates beyond the space set to zero."""
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise FormatError(f"expected finite coordinates of {what}, found {points[row]} in row {row}")
    if space < 3 and points[:, space:].any():
        points = points.copy()
        points[:, space:] = 0.0
    return frozen_floats(points)


def _edge_curves(raw: RawGeometry, edges: Lookup) -> Curves:
    curves = raw.edge_curves
    _check_counts(curves, curves.counts >= 2, "at least 2 points on an edge")
    return _curves(raw, curves, edges, "curved edges")


def _face_curves(raw: RawGeometry, faces: Lookup) -> Curves:
    """Curved faces: this many points as a triangle or a square of them needs."""
    curves = raw.face_curves
    nodal = np.isin(curves.kinds, [kind for kind in PointsType if kind.is_triangular])
    on_triangle = among(curves.entities, _ids(raw, Shape.TRIANGLE))
    side = np.rint(np.sqrt(np.clip(curves.counts, 0, None).astype(float))).astype(np.int64)
    half = ((np.sqrt(8.0 * np.clip(curves.counts, 0, None) + 1) - 1) / 2 + 0.5).astype(np.int64)
    _check_counts(curves, nodal <= on_triangle, "nodes of a triangle on triangles only")
    _check_counts(curves, nodal | ((side * side == curves.counts) & (side > 1)), "a square number of points on a face")
    fits = (half * (half + 1) // 2 == curves.counts) & (half > 1)
    _check_counts(curves, ~nodal | fits, "n(n+1)/2 points on a face")
    return _curves(raw, curves, faces, "curved faces")


def _check_counts(curves: RawCurves, holds: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], expected: str) -> None:
    if not holds.all():
        first = int(np.flatnonzero(~holds)[0])
        label = _family(int(curves.kinds[first]))
        raise FormatError(f"expected {expected}, found {curves.counts[first]} {label} on {curves.entities[first]}")


def _family(kind: int) -> str:
    return PointsType(kind).label if kind in set(PointsType) else f"points of family {kind}"


def _curves(raw: RawGeometry, curves: RawCurves, lookup: Lookup, what: str) -> Curves:
    _check_counts(curves, np.isin(curves.kinds, [k for k in PointsType if k]), "a known family of points")
    Lookup(curves.entities, what[:-1])
    return Curves(
        frozen_ints(lookup.rows(curves.entities, what)),
        frozen_ints(curves.kinds),
        frozen_ints(np.append(0, np.cumsum(curves.counts))),
        coordinates(curves.points, raw.space, what),
    )


def _composites(raw: RawGeometry, lookups: list[Lookup]) -> tuple[Composite, ...]:
    """The composites, restricted to ids that exist; other ids are ignored, as the format requires."""
    Lookup(np.array([id for id, _, _ in raw.composites], np.int64), "composite")
    tags = {tag for _, tokens, _ in raw.composites for tag, _ in tokens}
    present = {tag: lookups[dimension].ids for tag, dimension in _DIMENSIONS.items() if tag in tags}
    present |= {shape.tag: np.sort(_ids(raw, shape)) for shape in Shape if shape.tag in tags}
    return tuple(
        Composite(id, tuple((tag, frozen_ints(ids.existing(present[tag]))) for tag, ids in tokens), name)
        for id, tokens, name in raw.composites
    )


def unknown_members(raw: RawGeometry, mesh: Mesh) -> list[str]:
    """Sentences on composites that name entities which the mesh lacks."""
    found = []
    for (id, tokens, _), composite in zip(raw.composites, mesh.composites, strict=True):
        declared = sum(ids.count for _, ids in tokens)
        missing = declared - sum(len(ids) for _, ids in composite.parts)
        if missing > 0:
            found.append(
                f"{missing} of the {declared} entities of composite {id} that are not in the mesh were skipped"
            )
    return found


def counts_of(raw: RawGeometry, lookups: Sequence[Lookup]) -> Counts:
    """Counts of the entities, curves and composites in ``raw``; see `lookups_of`."""
    entities = {shape: len(ids) for shape, (ids, _) in raw.tables.items()}
    edges, faces = ((len(curves.entities), len(curves.points)) for curves in (raw.edge_curves, raw.face_curves))
    known = {tag: lookups[dimension] for tag, dimension in _DIMENSIONS.items()}

    def count(tag: str, ids: IdList) -> int:
        if tag not in known:
            known[tag] = Lookup(_ids(raw, next(shape for shape in Shape if shape.tag == tag)), "entity")
        return int((known[tag].below(ids.last + 1) - known[tag].below(ids.first)).sum())

    composites = tuple(tuple(count(tag, ids) for tag, ids in tokens) for _, tokens, _ in raw.composites)
    return Counts(len(raw.vertex_ids), entities, (edges, faces), composites)


def _domains(raw: RawGeometry, composites: tuple[Composite, ...]) -> dict[int, tuple[int, ...]]:
    present = np.sort(np.array([composite.id for composite in composites], np.int64))
    domains = {id: tuple(ids.existing(present).tolist()) for id, ids in raw.domains.items()}
    if domains and not any(domains.values()):
        raise FormatError("expected a domain of composites that exist, found none of them")
    return domains
