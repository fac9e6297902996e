"""Pieces of a partitioned mesh become one: entities that several pieces hold are united by their ids."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.arrays import Ints
from elvis.core.errors import FormatError
from elvis.core.shapes import Shape
from elvis.formats.nektar.idlist import IdList
from elvis.formats.nektar.raw import RawComposite, RawCurves, RawGeometry


def unite(pieces: Sequence[RawGeometry]) -> RawGeometry:
    """One mesh of all pieces; entities keep the order of first appearance.

    FormatError where pieces differ in dimension, or give one entity other members.
    """
    first = pieces[0]
    if len(pieces) == 1:
        return first
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
        {shape: _table(shape, pieces) for shape in Shape if any(shape in piece.tables for piece in pieces)},
        _curves([piece.edge_curves for piece in pieces]),
        _curves([piece.face_curves for piece in pieces]),
        _composites(pieces),
        _domains(pieces),
    )


def first_rows(ids: Ints) -> Ints:
    """(n,) rows where an id appears for the first time, ascending."""
    return np.sort(np.unique(ids, return_index=True)[1])


def _table(shape: Shape, pieces: Sequence[RawGeometry]) -> tuple[Ints, Ints]:
    tables = [piece.tables[shape] for piece in pieces if shape in piece.tables]
    ids, members = np.concatenate([table[0] for table in tables]), np.concatenate([table[1] for table in tables])
    _, first, inverse = np.unique(ids, return_index=True, return_inverse=True)
    if not np.array_equal(members, members[first[inverse]]):
        wrong = int(np.flatnonzero((members != members[first[inverse]]).any(axis=1))[0])
        raise FormatError(
            f"expected the same members of {shape.label.lower()} {ids[wrong]} in all pieces, found others",
            file=pieces[0].file,
        )
    kept = np.sort(first)
    return ids[kept], members[kept]


def _curves(parts: Sequence[RawCurves]) -> RawCurves:
    entities = np.concatenate([part.entities for part in parts])
    counts = np.concatenate([part.counts for part in parts])
    kept = first_rows(entities)
    is_kept = np.zeros(len(entities), bool)
    is_kept[kept] = True
    points = np.concatenate([part.points for part in parts])
    kinds = np.concatenate([part.kinds for part in parts])
    return RawCurves(entities[kept], kinds[kept], counts[kept], points[np.repeat(is_kept, counts)])


def _composites(pieces: Sequence[RawGeometry]) -> tuple[RawComposite, ...]:
    """Composites by id, the tokens of all pieces put together tag by tag."""
    found: dict[int, dict[str, list[IdList]]] = {}
    names: dict[int, str | None] = {}
    for piece in pieces:
        for id, tokens, name in piece.composites:
            names[id] = names.get(id) or name
            for tag, ids in tokens:
                found.setdefault(id, {}).setdefault(tag, []).append(ids)
    return tuple(
        (id, tuple((tag, _joined(lists)) for tag, lists in found.get(id, {}).items()), names[id]) for id in names
    )


def _domains(pieces: Sequence[RawGeometry]) -> dict[int, IdList]:
    found: dict[int, list[IdList]] = {}
    for piece in pieces:
        for id, ids in piece.domains.items():
            found.setdefault(id, []).append(ids)
    return {id: _joined(lists) for id, lists in found.items()}


def _joined(lists: list[IdList]) -> IdList:
    """The ranges of all lists, each once; ids that several ranges hold come with the first."""
    ranges = np.stack([np.concatenate([ids.first for ids in lists]), np.concatenate([ids.last for ids in lists])])
    kept = np.sort(np.unique(ranges, axis=1, return_index=True)[1])
    return IdList(ranges[0, kept], ranges[1, kept])
