"""Portions: some elements of a dataset, with their numbers in the whole.

A portion contains a dataset that has only these elements and the entities that they consist of.  Portions of one
dataset are united by numbers in the whole.  The order, and with it which element is first, is thus independent of how
the dataset was cut.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as default
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints, among, distinct, frozen_floats, frozen_ints, joined_ints, narrow_ints
from elvis.core.data.dataset import Block, Dataset, Field
from elvis.core.data.mesh import Composite, Counts, Curves, Entities, Excerpt, Mesh
from elvis.core.portions.partition import along_curve
from elvis.core.shapes import Shape

#: kinds of entities: vertices, then shapes
_Kind = Shape | None
_FACES = (Shape.TRIANGLE, Shape.QUADRILATERAL)
_TAGS: Mapping[str, tuple[_Kind, ...]] = {
    "V": (None,),
    "E": (Shape.SEGMENT,),
    "F": _FACES,
    **{shape.tag: (shape,) for shape in Shape},
}


@dataclass(frozen=True, eq=False)
class Portion:
    """Some elements of a dataset.  Rows and numbers have 32 bits if these are enough for the whole.

    dataset   with only these elements
    rows      (n,) rows in the whole, ascending: of vertices (None) and of entities by shape
    edges, faces  (n,) rows of the curves of edges and faces
    blocks    for each field and block, (n,) rows of its elements in the block of the whole
    sides     numbers in the whole of faces, of 2D meshes edges, that have elements on both sides in the whole
    counts    sizes of the whole
    triangles  number of triangles among the faces of the whole, whose numbers come first
    is_even   whether all fields have the same elements in the whole, so faces are inner ones of all fields or of none
    others    portions of the same rank of datasets that expressions may name
    """

    dataset: Dataset
    rows: Mapping[_Kind, Ints]
    edges: Ints
    faces: Ints
    blocks: Mapping[str, tuple[Ints, ...]]
    sides: Ints
    counts: Counts
    triangles: int
    is_even: bool
    others: Mapping[str, Portion] = default(default_factory=dict)

    @staticmethod
    def whole(dataset: Dataset) -> Portion:
        """All of a dataset, which may itself be the dataset of a portion."""
        mesh, sides = dataset.mesh, _inner_sides(dataset)
        below = mesh.counts.total
        rows: dict[_Kind, Ints] = {shape: _numbers(len(own), below) for shape, own in mesh.entities.items()}
        rows[None] = _numbers(len(mesh.vertices), below)
        blocks = {
            field.name: tuple(_numbers(len(block), len(block)) for block in field.blocks) for field in dataset.fields
        }
        if mesh.excerpt is not None:
            sides = np.union1d(sides, mesh.excerpt.sides)
        triangles = len(mesh.of(Shape.TRIANGLE))
        edges, faces = np.arange(len(mesh.edge_curves)), np.arange(len(mesh.face_curves))
        return Portion(
            *(without_beside(dataset), rows, edges, faces, blocks, narrow_ints(sides, below)),
            *(mesh.counts, triangles, is_even(dataset)),
        )

    @staticmethod
    def of_whole(dataset: Dataset, number: int, count: int) -> Portion:
        """One of ``count`` parts of a dataset, a range of elements along a curve."""
        return Portion.whole(dataset).of(along_curve(dataset, count)[number])

    def of(self, ids: Ints) -> Portion:
        """The elements among these that have one of the ids (n,)."""
        mesh = self.dataset.mesh
        kept = _kept_rows(mesh, ids)
        rows = {kind: self.rows[kind][own] for kind, own in kept.items()}
        curved_edges = np.flatnonzero(among(mesh.edge_curves.rows, kept[Shape.SEGMENT]))
        curved_faces = np.flatnonzero(among(mesh.face_curves.rows, _face_numbers(mesh, kept)))
        fields, blocks = [], {}
        for field in self.dataset.fields:
            chosen = [np.flatnonzero(np.isin(block.element_ids, ids)) for block in field.blocks]
            own = (block.of(some) for block, some in zip(field.blocks, chosen, strict=True))
            fields.append(replace(field, blocks=tuple(own)))
            old = zip(self.blocks[field.name], chosen, strict=True)
            blocks[field.name] = tuple(before[some] for before, some in old)
        cut = _cut_mesh(mesh, kept, curved_edges, curved_faces)
        portion = replace(
            self,
            dataset=replace(self.dataset, mesh=cut, fields=tuple(fields)),
            rows=rows,
            edges=self.edges[curved_edges],
            faces=self.faces[curved_faces],
            blocks=blocks,
        )
        numbers = portion.side_numbers
        return portion.with_sides(numbers[np.isin(numbers, self.sides)])

    @property
    def alone(self) -> Portion:
        """The portion without data on other meshes and derivatives in time, for sending to other ranks."""
        return replace(self, dataset=without_beside(self.dataset), others={})

    @property
    def bytes(self) -> int:
        """Memory of its arrays, in bytes."""
        mesh = self.dataset.mesh
        places = mesh.vertices.nbytes + mesh.edge_curves.points.nbytes + mesh.face_curves.points.nbytes
        entities = sum(own.ids.nbytes + own.members.nbytes for own in mesh.entities.values())
        return places + entities + sum(block.coefficients.nbytes for own in self.dataset.fields for block in own.blocks)

    def with_fields(self, names: Iterable[str]) -> Portion:
        """The portion with only the named fields and the fields that define the map."""
        kept = {*names, *self.dataset.map_names}
        dataset = self.dataset
        return replace(self, dataset=replace(dataset, fields=tuple(own for own in dataset.fields if own.name in kept)))

    @property
    def side_numbers(self) -> Ints:
        """(n,) numbers in the whole of its faces, triangles first; for 2D meshes edges, for lines vertices."""
        dimension = self.dataset.mesh.dimension
        if dimension == 3:
            return _faces_in_whole(self, self.rows)
        return self.rows[Shape.SEGMENT if dimension == 2 else None]

    def with_sides(self, sides: Ints) -> Portion:
        """The portion with inner sides by numbers in the whole, which its mesh receives with the sizes of the whole."""
        own = self.side_numbers
        excerpt = Excerpt(self.counts, narrow_ints(np.searchsorted(own, sides), len(own)))
        mesh = replace(self.dataset.mesh, excerpt=excerpt)
        return replace(self, dataset=replace(self.dataset, mesh=mesh), sides=sides)


def _numbers(count: int, below: int) -> Ints:
    """The numbers from 0 to ``count`` - 1; ``below`` exceeds all of them."""
    return narrow_ints(np.arange(count), below)


def without_beside(dataset: Dataset) -> Dataset:
    """A dataset without others that expressions may name, derivatives in time that are not found yet, and surfaces."""
    return replace(dataset, others={}, shared={}, rates=None, surfaces={})


def portions(dataset: Dataset, parts: Sequence[Ints]) -> list[Portion]:
    """A dataset cut into the elements with these ids, one array a part."""
    whole = Portion.whole(dataset)
    return [whole.of(ids) for ids in parts]


def unite(some: Sequence[Portion]) -> Portion:
    """The elements of portions of one dataset, which may have some in common, in the order of the whole."""
    first = some[0]
    if len(some) == 1:
        return first
    meshes = [portion.dataset.mesh for portion in some]
    rows: dict[_Kind, Ints] = {}
    places: dict[_Kind, Ints] = {}
    for kind in first.rows:
        rows[kind], places[kind] = _united([portion.rows[kind] for portion in some])
    vertex_ids = np.concatenate([mesh.vertex_ids for mesh in meshes])[places[None]]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])[places[None]]
    entities = {}
    for shape in (kind for kind in rows if kind is not None):
        ids = np.concatenate([mesh.of(shape).ids for mesh in meshes])[places[shape]]
        members = np.concatenate([members_in_whole(portion, shape) for portion in some])[places[shape]]
        own = _numbers_of_members(first, rows, shape)
        entities[shape] = Entities(frozen_ints(ids), narrow_ints(np.searchsorted(own, members), len(own)))
    edges, edge_places = _united([portion.edges for portion in some])
    faces, face_places = _united([portion.faces for portion in some])
    mesh = replace(
        meshes[0],
        vertex_ids=frozen_ints(vertex_ids),
        vertices=frozen_floats(vertices),
        entities=entities,
        edge_curves=_united_curves(some, edge_places, rows, on_edges=True),
        face_curves=_united_curves(some, face_places, rows, on_edges=False),
        composites=tuple(map(_united_composite, zip(*(mesh.composites for mesh in meshes), strict=True))),
    )
    fields, blocks = _united_fields(some)
    dataset = replace(first.dataset, mesh=mesh, fields=fields)
    united = replace(first, dataset=dataset, rows=rows, edges=edges, faces=faces, blocks=blocks)
    return united.with_sides(distinct(np.sort(np.concatenate([portion.sides for portion in some]))))


def is_even(dataset: Dataset) -> bool:
    """Whether all fields of a dataset have the same elements."""
    held = [[block.element_ids for block in own.blocks] for own in dataset.solution if own.blocks]
    others = [ids for ids in held if list(map(id, ids)) != list(map(id, held[0]))]
    if not others:
        return True
    first = np.sort(np.concatenate(held[0]))
    return all(np.array_equal(np.sort(np.concatenate(ids)), first) for ids in others)


def carriers(dataset: Dataset) -> Ints | None:
    """(n,) ids of the elements that have the first field; None without fields; all elements then count for sides."""
    blocks = dataset.solution[0].blocks if dataset.solution else ()
    every = [block.element_ids for block in blocks]
    return every[0] if len(every) == 1 else np.concatenate(every) if every else None


def knows_inner_sides(dataset: Dataset) -> bool:
    """Whether inner sides of a part equal inner sides of the mesh: if all its elements have the first field."""
    ids = carriers(dataset)
    return ids is None or all(np.isin(own.ids, ids).all() for own in dataset.mesh.elements.values())


def _inner_sides(dataset: Dataset) -> Ints:
    """Numbers of faces, of 2D meshes edges, that have elements on both sides, which have the first field if any has."""
    mesh, chosen_ids = dataset.mesh, carriers(dataset)
    members = []
    for entities in mesh.elements.values():
        chosen = np.ones(len(entities), bool) if chosen_ids is None else np.isin(entities.ids, chosen_ids)
        members.append(entities.members[chosen].reshape(-1))
    counts = np.bincount(joined_ints(members))
    return np.flatnonzero(counts > 1) if mesh.dimension > 1 else np.empty(0, np.int64)


def _kept_rows(mesh: Mesh, ids: Ints) -> dict[_Kind, Ints]:
    """Rows of the elements with these ids, and of their faces, edges and vertices."""
    elements = mesh.elements
    kept: dict[_Kind, Ints] = {shape: np.empty(0, np.int64) for shape in (*mesh.entities, Shape.SEGMENT)}
    for shape, own in elements.items():
        kept[shape] = np.flatnonzero(np.isin(own.ids, ids))
    triangles = len(mesh.of(Shape.TRIANGLE))
    if mesh.dimension == 3:
        faces = _used(mesh, kept, elements, triangles + len(mesh.of(Shape.QUADRILATERAL)))
        kept[Shape.TRIANGLE] = faces[faces < triangles]
        kept[Shape.QUADRILATERAL] = faces[faces >= triangles] - triangles
    if mesh.dimension > 1:
        kept[Shape.SEGMENT] = _used(mesh, kept, _FACES, len(mesh.of(Shape.SEGMENT)))
    kept[None] = _used(mesh, kept, (Shape.SEGMENT,), len(mesh.vertices))
    return {kind: own for kind, own in kept.items() if kind is None or kind in mesh.entities}


def _used(mesh: Mesh, kept: Mapping[_Kind, Ints], shapes: Iterable[Shape], count: int) -> Ints:
    """(n,) ascending rows of ``count`` entities that the kept entities of some shapes consist of."""
    is_used = np.zeros(count, bool)
    for shape in shapes:
        if len(mesh.of(shape)):
            is_used[mesh.of(shape).members[kept[shape]]] = True
    return np.flatnonzero(is_used)


def _renumbered(members: Ints, numbers: Ints) -> Ints:
    """(n, k) positions of members among ascending ``numbers``, which contain all of them."""
    place = np.zeros(int(numbers[-1]) + 1 if len(numbers) else 0, np.int64)
    place[numbers] = np.arange(len(numbers))
    return place[members]


def _face_numbers(mesh: Mesh, kept: Mapping[_Kind, Ints]) -> Ints:
    """(n,) numbers of kept faces: triangles first."""
    none = np.empty(0, np.int64)
    quadrilaterals = len(mesh.of(Shape.TRIANGLE)) + kept.get(Shape.QUADRILATERAL, none)
    return np.concatenate([kept.get(Shape.TRIANGLE, none), quadrilaterals])


def _numbers_of_members(portion: Portion, rows: Mapping[_Kind, Ints], shape: Shape) -> Ints:
    """(n,) numbers in the whole of the members of entities of a shape, in order of their rows."""
    if shape.dimension == 3:
        return _faces_in_whole(portion, rows)
    return rows[Shape.SEGMENT if shape.dimension == 2 else None]


def members_in_whole(portion: Portion, shape: Shape) -> Ints:
    """(n, k) members of entities by their numbers in the whole."""
    return _numbers_of_members(portion, portion.rows, shape)[portion.dataset.mesh.of(shape).members]


def _united(rows: Sequence[Ints]) -> tuple[Ints, Ints]:
    """(n,) rows of several lists, ascending, each once, and where in all lists together the first of each is."""
    united, place = np.unique(np.concatenate(rows), return_index=True)
    return united, place


def _cut_mesh(mesh: Mesh, kept: Mapping[_Kind, Ints], edges: Ints, faces: Ints) -> Mesh:
    """The mesh of the selected entities and curves."""
    entities = {}
    for shape, own in mesh.entities.items():
        if shape.dimension == 3:
            numbers = _face_numbers(mesh, kept)
        else:
            numbers = kept[Shape.SEGMENT if shape.dimension == 2 else None]
        members = _renumbered(own.members[kept[shape]], numbers)
        entities[shape] = Entities(frozen_ints(own.ids[kept[shape]]), narrow_ints(members, len(numbers)))
    segments = kept.get(Shape.SEGMENT, np.empty(0, np.int64))
    return replace(
        mesh,
        vertex_ids=frozen_ints(mesh.vertex_ids[kept[None]]),
        vertices=frozen_floats(mesh.vertices[kept[None]]),
        entities=entities,
        edge_curves=_some_curves(mesh.edge_curves, edges, segments),
        face_curves=_some_curves(mesh.face_curves, faces, _face_numbers(mesh, kept)),
        composites=tuple(_cut_composite(mesh, kept, composite) for composite in mesh.composites),
    )


def _some_curves(curves: Curves, which: Ints, numbers: Ints) -> Curves:
    """Some of the curves, on entities with new rows; ``numbers`` are the old ones of these, ascending."""
    rows = np.searchsorted(numbers, curves.rows[which])
    counts = np.diff(curves.offsets)[which]
    offsets = np.append(0, np.cumsum(counts))
    points = np.repeat(curves.offsets[which] - offsets[:-1], counts) + np.arange(offsets[-1])
    kinds = curves.kinds[which]
    return Curves(frozen_ints(rows), frozen_ints(kinds), frozen_ints(offsets), frozen_floats(curves.points[points]))


def _united_curves(some: Sequence[Portion], which: Ints, rows: Mapping[_Kind, Ints], *, on_edges: bool) -> Curves:
    """The curves of portions, of all in order those with numbers ``which``, on entities ``rows`` of the whole."""
    numbers = _edges_in_whole if on_edges else _faces_in_whole
    every = [one.dataset.mesh.edge_curves if on_edges else one.dataset.mesh.face_curves for one in some]
    owners = [numbers(one, one.rows)[curves.rows] for one, curves in zip(some, every, strict=True)]
    counts = np.concatenate([np.diff(curves.offsets) for curves in every])
    joined = Curves(
        frozen_ints(np.concatenate(owners)),
        frozen_ints(np.concatenate([curves.kinds for curves in every])),
        frozen_ints(np.append(0, np.cumsum(counts))),
        frozen_floats(np.concatenate([curves.points for curves in every])),
    )
    return _some_curves(joined, which, numbers(some[0], rows))


def _edges_in_whole(portion: Portion, rows: Mapping[_Kind, Ints]) -> Ints:
    """(n,) numbers in the whole of edges."""
    return rows.get(Shape.SEGMENT, np.empty(0, np.int32))


def _faces_in_whole(portion: Portion, rows: Mapping[_Kind, Ints]) -> Ints:
    """(n,) numbers in the whole of faces, triangles first."""
    none: Any = np.empty(0, np.int32)
    return np.concatenate([rows.get(Shape.TRIANGLE, none), portion.triangles + rows.get(Shape.QUADRILATERAL, none)])


def _cut_composite(mesh: Mesh, kept: Mapping[_Kind, Ints], composite: Composite) -> Composite:
    """A composite restricted to the selected entities."""
    parts = []
    for tag, ids in composite.parts:
        kinds = [kind for kind in _TAGS[tag] if kind in kept]
        own = [(mesh.vertex_ids if kind is None else mesh.of(kind).ids)[kept[kind]] for kind in kinds]
        parts.append((tag, ids[np.isin(ids, joined_ints(own))]))
    return replace(composite, parts=tuple(parts))


def _united_composite(some: Sequence[Composite]) -> Composite:
    """A composite that is in each of several meshes, with the entities of all."""
    tags = [tag for tag, _ in some[0].parts]
    ids = (np.unique(np.concatenate(own)) for own in zip(*([ids for _, ids in one.parts] for one in some), strict=True))
    return replace(some[0], parts=tuple(zip(tags, map(frozen_ints, ids), strict=True)))


def _united_fields(some: Sequence[Portion]) -> tuple[tuple[Field, ...], dict[str, tuple[Ints, ...]]]:
    """The fields of portions, and rows of their blocks in the blocks of the whole."""
    fields: list[Field] = []
    rows: dict[str, tuple[Ints, ...]] = {}
    for number, field in enumerate(some[0].dataset.fields):
        blocks: list[Block] = []
        found: list[Ints] = []
        for index, block in enumerate(field.blocks):
            own, place = _united([portion.blocks[field.name][index] for portion in some])
            every = [portion.dataset.fields[number].blocks[index] for portion in some]
            ids = np.concatenate([one.element_ids for one in every])[place]
            coefficients: Floats = np.concatenate([one.coefficients for one in every])[place]
            blocks.append(Block(block.expansion, frozen_ints(ids), frozen_floats(coefficients)))
            found.append(own)
        fields.append(replace(field, blocks=tuple(blocks)))
        rows[field.name] = tuple(found)
    return tuple(fields), rows
