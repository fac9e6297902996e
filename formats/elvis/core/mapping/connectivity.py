"""Meshes from the vertices of their elements: edges and faces are found, shared and numbered."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elvis.core.arrays import Floats, Ints, frozen_floats, frozen_ints
from elvis.core.mesh import Composite, Entities, Mesh
from elvis.core.shapes import Shape


def connected(vertices: Floats, elements: Mapping[Shape, Ints], space: int = 3) -> Mesh:
    """The mesh of straight elements on ``vertices`` (n, 3).

    elements  (k, n_vertices) vertex rows of each shape, all of one dimension, in the local order of `Shape`.  Elements
              that share a triangle must collapse it at the same vertex.
    Ids count from 0; elements in the order of the format.  One composite a shape makes the domain; a last one, named
    boundary, holds the edges (2D) or faces (3D) of single elements.
    """
    dimension = max(shape.dimension for shape in elements)
    shapes = [shape for shape in Shape.of_dimension(dimension) if len(elements.get(shape, ()))]
    own = {shape: np.asarray(elements[shape], np.int64) for shape in shapes}
    entities, boundary = _ASSEMBLED[dimension](own)
    ids = np.split(np.arange(sum(map(len, own.values()))), np.cumsum([len(rows) for rows in own.values()])[:-1])
    for shape, numbers in zip(shapes, ids, strict=True):
        entities[shape] = Entities(frozen_ints(numbers), entities[shape].members)
    domain = [Composite(i, ((s.tag, frozen_ints(ids[i])),), s.label.lower()) for i, s in enumerate(shapes)]
    border = Composite(len(shapes), (("VEF"[dimension - 1], boundary),), "boundary")
    return Mesh(
        dimension,
        space,
        frozen_ints(np.arange(len(vertices))),
        frozen_floats(vertices),
        entities,
        composites=(*domain, border),
        domains={0: tuple(range(len(shapes)))},
    )


def _line(elements: Mapping[Shape, Ints]) -> tuple[dict[Shape, Entities], Ints]:
    rows, counts = np.unique(elements[Shape.SEGMENT], return_counts=True)
    return {Shape.SEGMENT: _entities(elements[Shape.SEGMENT])}, frozen_ints(rows[counts == 1])


def _surface(elements: Mapping[Shape, Ints]) -> tuple[dict[Shape, Entities], Ints]:
    segments, members, uses = _edges(elements)
    entities = {shape: _entities(rows) for shape, rows in members.items()}
    return {Shape.SEGMENT: _entities(segments), **entities}, frozen_ints(np.flatnonzero(uses == 1))


def _volume(elements: Mapping[Shape, Ints]) -> tuple[dict[Shape, Entities], Ints]:
    """Faces as their first element sees them, triangles numbered before quadrilaterals; then edges of the faces."""
    faces: dict[Shape, Ints] = {}
    members = {shape: np.empty((len(rows), len(shape.faces)), np.int64) for shape, rows in elements.items()}
    single, offset = [], 0
    for kind in (Shape.TRIANGLE, Shape.QUADRILATERAL):
        places = [(s, i) for s in elements for i, face in enumerate(s.faces) if len(face) == len(kind.vertices)]
        if not places:
            continue
        stacked = np.concatenate([elements[s][:, list(s.faces[i])] for s, i in places])
        first, which = _distinct(stacked)
        faces[kind] = stacked[first]
        single.append(offset + np.flatnonzero(np.bincount(which) == 1))
        for (shape, i), part in zip(places, _parts(which, [len(elements[s]) for s, _ in places]), strict=True):
            members[shape][:, i] = part + offset
        offset += len(first)
    surface, _ = _surface(faces)
    numbered = {kind: Entities(ids, surface[kind].members) for kind, ids in _face_ids(faces).items()}
    solids = {shape: _entities(rows) for shape, rows in members.items()}
    return {**surface, **numbered, **solids}, frozen_ints(np.concatenate(single))


def _face_ids(faces: Mapping[Shape, Ints]) -> dict[Shape, Ints]:
    starts = np.cumsum([0] + [len(rows) for rows in faces.values()])
    return {
        kind: frozen_ints(start + np.arange(len(rows)))
        for start, (kind, rows) in zip(starts, faces.items(), strict=False)
    }


_ASSEMBLED = {1: _line, 2: _surface, 3: _volume}


def _edges(polygons: Mapping[Shape, Ints]) -> tuple[Ints, dict[Shape, Ints], Ints]:
    """Distinct edges (n, 2) from lower to higher vertex, the edges of each polygon, and how many polygons use each."""
    ends = [np.stack([rows, np.roll(rows, -1, axis=1)], axis=2).reshape(-1, 2) for rows in polygons.values()]
    stacked = np.sort(np.concatenate(ends), axis=1)
    first, which = _distinct(stacked)
    parts = _parts(which, [len(rows) for rows in ends])
    members = {s: part.reshape(rows.shape) for (s, rows), part in zip(polygons.items(), parts, strict=True)}
    return stacked[first], members, np.bincount(which)


def _distinct(rows: Ints) -> tuple[Ints, Ints]:
    """Rows (n, k) that hold the same numbers are the same: the first of each, and which of them every row is (n,)."""
    key = np.sort(rows, axis=1)
    order = np.lexsort(key.T[::-1])
    new = np.ones(len(rows), bool)
    new[1:] = (np.diff(key[order], axis=0) != 0).any(axis=1)
    which = np.empty(len(rows), np.int64)
    which[order] = np.cumsum(new) - 1
    return order[new], which


def _parts(rows: Ints, lengths: list[int]) -> list[Ints]:
    return np.split(rows, np.cumsum(lengths)[:-1])


def _entities(members: Ints) -> Entities:
    return Entities(frozen_ints(np.arange(len(members))), frozen_ints(members))
