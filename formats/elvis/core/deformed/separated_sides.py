"""Sides at which a map with jumps separates elements: each element gets a side of its own.

All commands find neighbours and boundaries by shared sides.  A side whose two images differ by more than rounding is
therefore replaced by two outer sides, once, in the mesh.  Composites that hold the side hold both.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_ints
from elvis.core.base.rows import Rows
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import NON_CONFORMING, Composite, Entities, Mesh
from elvis.core.distances.boundaries import joined_sides
from elvis.core.interfaces.hanging import SOURCE_ROUNDINGS, hanging
from elvis.core.interfaces.side_groups import side_set
from elvis.core.mapping.geometry import GeometryBlock, geometry
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.side_traces import SideTraces, ValuesAt, shared_pairs, side_traces
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.shapes import Shape

#: share of the largest coordinate within which two sides are one
CLOSE = 1e-10
#: sides that are compared together
_AT_ONCE = 1 << 14
_FACES = (Shape.TRIANGLE, Shape.QUADRILATERAL)
#: tags of composites that may hold sides, by the dimension of the elements
_TAGS = {2: ("E", "S"), 3: ("F", "T", "Q")}


def with_separated_sides(before: Dataset, after: Dataset, rounding: float) -> Mesh:
    """The mesh in which elements share only sides that have one image under the new map, or had two before.

    before, after  the data with the map that they had, and with the new one, on one mesh
    rounding       distance that is rounding of the new map, in addition to a share of the largest coordinate
    Lines are unchanged.
    """
    mesh = after.mesh
    if mesh.dimension < 2:
        return mesh
    size = max((float(np.abs(own.coefficients).max(initial=0.0)) for own in geometry(after)), default=0.0)
    room = CLOSE * size + rounding
    pairs = _separated(after, room)
    pairs = pairs.part(~np.isin(pairs.side, _separated(before, room).side)) if len(pairs.side) else pairs
    loose = np.setdiff1d(_joined_ids(before, room, size), _joined_ids(after, room, size))
    mesh = _split(mesh, pairs) if len(pairs.side) else mesh
    return _without_joined(mesh, loose) if len(loose) else mesh


@dataclass(frozen=True, eq=False)
class Separated(Rows):
    """Sides (n,), by rows in the mesh, and the shape and row of the second element of each."""

    side: Ints
    shape: Ints
    row: Ints


def _separated(dataset: Dataset, room: float) -> Separated:
    """Sides of two elements whose images differ by more than ``room``."""
    traces: dict[int, list[tuple[SideTraces, int, Ints]]] = {}
    blocks = geometry(dataset)
    along = max((max(block.expansion.modes) for block in blocks), default=2) + 2
    for block in blocks:
        shape = block.expansion.shape
        rows = dataset.mesh.of(shape).rows_of(block.element_ids)
        for own in side_traces(dataset.mesh, shape, block.element_ids, along, _positions(block)):
            traces.setdefault(own.corners, []).append((own, list(Shape).index(shape), rows[own.element]))
    found = [_pairs_apart(parts, room) for parts in traces.values()]
    columns = zip(*found, strict=True) if found else ([np.empty(0, np.int64)],) * 3
    return Separated(*(np.concatenate(own) for own in columns))


def _positions(block: GeometryBlock) -> ValuesAt:
    """Positions (n, q, 3) of elements in rows (n,) at reference points (q, d)."""

    def values_at(rows: Ints, points: Floats) -> Floats:
        return np.stack(
            [evaluate(block.expansion, block.coefficients[rows, axis], points) for axis in range(3)], axis=2
        )

    return values_at


def _pairs_apart(parts: list[tuple[SideTraces, int, Ints]], room: float) -> tuple[Ints, Ints, Ints]:
    """Sides whose images differ, with the shape and row of the second element; sides of three elements stay shared."""
    side = np.concatenate([own.side for own, _, _ in parts])
    shape = np.concatenate([np.full(len(rows), number) for _, number, rows in parts])
    row = np.concatenate([rows for _, _, rows in parts])
    places = np.concatenate([own.values for own, _, _ in parts])
    first, second = shared_pairs(side)
    is_pair = np.bincount(side)[side[first]] == 2
    first, second = first[is_pair], second[is_pair]
    is_apart = np.zeros(len(first), bool)
    for some in chunks(len(first), _AT_ONCE):
        distance = np.abs(places[first[some]] - places[second[some]]).max(axis=(1, 2), initial=0.0)
        is_apart[some] = distance > room
    chosen = second[is_apart]
    return side[chosen], shape[chosen], row[chosen]


@dataclass(frozen=True, eq=False)
class _Copies:
    """Copies of some sides of a mesh, and how rows of sides change by them.

    entities  the sides with the copies, by shape
    moved     (n,) new rows of the sides that there were: triangles count before quadrilaterals
    rows      (k,) rows of the copies
    old, new  (k,) ids of the sides and of their copies
    """

    entities: dict[Shape, Entities]
    moved: Ints
    rows: Ints
    old: Ints
    new: Ints

    @staticmethod
    def of(mesh: Mesh, sides: Ints) -> _Copies:
        """The copies of sides by their rows (k,)."""
        entities: dict[Shape, Entities] = {}
        every = np.concatenate([mesh.of(shape).ids for shape in _shapes(mesh)])
        new = 1 + int(every.max(initial=-1)) + np.arange(len(sides))
        moved, rows = np.arange(len(every)), np.empty(len(sides), np.int64)
        start = shift = 0
        for shape in _shapes(mesh):
            own = mesh.of(shape)
            end = start + len(own)
            moved[start:end] += shift
            here = np.flatnonzero((sides >= start) & (sides < end))
            rows[here] = end + shift + np.arange(len(here))
            ids = np.concatenate([own.ids, new[here]])
            members = np.concatenate([own.members, own.members[sides[here] - start]])
            entities[shape] = Entities(frozen_ints(ids), frozen_ints(members))
            start, shift = end, shift + len(here)
        return _Copies({shape: own for shape, own in entities.items() if len(own)}, moved, rows, every[sides], new)

    def composite(self, own: Composite, tags: tuple[str, ...]) -> Composite:
        """A composite that holds copies if it holds their sides."""
        parts = []
        for tag, ids in own.parts:
            more = self.new[np.isin(self.old, ids)] if tag in tags else self.new[:0]
            parts.append((tag, frozen_ints(np.concatenate([ids, more])) if len(more) else ids))
        return replace(own, parts=tuple(parts))


def _split(mesh: Mesh, pairs: Separated) -> Mesh:
    """The mesh with a new side for the second element of each pair."""
    copies = _Copies.of(mesh, pairs.side)
    entities = {**mesh.entities, **copies.entities}
    for number, shape in enumerate(Shape):
        if shape in mesh.elements:
            here = np.flatnonzero(pairs.shape == number)
            own = mesh.of(shape)
            members = copies.moved[own.members]
            column = (own.members[pairs.row[here]] == pairs.side[here, None]).argmax(axis=1)
            members[pairs.row[here], column] = copies.rows[here]
            entities[shape] = Entities(own.ids, frozen_ints(members))
    composites = tuple(copies.composite(own, _TAGS[mesh.dimension]) for own in mesh.composites)
    if mesh.dimension < 3:
        return replace(mesh, entities=entities, composites=composites)
    curves = replace(mesh.face_curves, rows=frozen_ints(copies.moved[mesh.face_curves.rows]))
    return replace(mesh, entities=entities, composites=composites, face_curves=curves)


def _shapes(mesh: Mesh) -> tuple[Shape, ...]:
    """The shapes of sides, in the order of their rows."""
    return (Shape.SEGMENT,) if mesh.dimension == 2 else _FACES


def _joined_ids(dataset: Dataset, room: float, size: float) -> Ints:
    """Ids (n,) of non-conforming sides that lie on other ones, up to a distance ``room``."""
    mesh = dataset.mesh
    joined = joined_sides(mesh).get(NON_CONFORMING)
    if joined is None or not len(joined):
        return np.empty(0, np.int64)
    ids = np.concatenate([mesh.of(shape).ids for shape in _shapes(mesh)])
    wanted = np.zeros(len(ids), bool)
    wanted[joined] = True
    sides = side_set(dataset, wanted)
    precision = room / (SOURCE_ROUNDINGS * (size or 1.0))
    found = hanging(sides, np.zeros(len(ids), bool)[sides.entity], mesh.space == mesh.dimension, precision)
    return np.asarray(ids[found.inner])


def _without_joined(mesh: Mesh, loose: Ints) -> Mesh:
    """The mesh whose composite of non-conforming sides lacks some ids."""
    composites = []
    for own in mesh.composites:
        if own.name == NON_CONFORMING:
            parts = tuple((tag, frozen_ints(ids[~np.isin(ids, loose)])) for tag, ids in own.parts)
            own = replace(own, parts=parts)
        composites.append(own)
    return replace(mesh, composites=tuple(composites))
