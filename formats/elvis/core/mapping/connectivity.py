"""Meshes from the vertices of their elements: edges and faces are found, shared and numbered."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elvis.core.base.arrays import (
    Floats,
    Ints,
    distinct_sides,
    frozen_floats,
    frozen_ints,
    frozen_view,
    index_type,
    narrow_ints,
    rows_of_sides,
    uses_of,
)
from elvis.core.data.mesh import Composite, Entities, Mesh
from elvis.core.mapping.orientation import face_shape
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
    vertices_of = {shape: narrow_ints(elements[shape], len(vertices)) for shape in shapes}
    entities, outer = _SKELETONS[dimension](vertices_of)

    # elements are numbered through, shape after shape
    counts = [len(rows) for rows in vertices_of.values()]
    ids = _split(np.arange(sum(counts)), counts)
    domain = []
    for i, shape in enumerate(shapes):
        own_ids = frozen_ints(ids[i])
        entities[shape] = Entities(own_ids, entities[shape].members)
        domain.append(Composite(i, ((shape.tag, own_ids),), shape.label.lower()))
    tag = "VEF"[dimension - 1]
    boundary = Composite(len(shapes), ((tag, outer),), "boundary")
    return Mesh(
        dimension,
        space,
        frozen_ints(np.arange(len(vertices))),
        frozen_floats(vertices),
        entities,
        composites=(*domain, boundary),
        domains={0: tuple(range(len(shapes)))},
    )


def _from_segments(elements: Mapping[Shape, Ints]) -> tuple[dict[Shape, Entities], Ints]:
    """Entities of lines, and the vertices of single ones."""
    segments = elements[Shape.SEGMENT]
    vertices, uses = np.unique(segments, return_counts=True)
    return {Shape.SEGMENT: _entities(segments)}, frozen_ints(vertices[uses == 1])


def _from_polygons(elements: Mapping[Shape, Ints]) -> tuple[dict[Shape, Entities], Ints]:
    """Entities of plane elements: their edges, themselves as edges; and the edges of single elements."""
    edges, edges_of, uses = _edges(elements)
    entities = {Shape.SEGMENT: _entities(edges)}
    for shape, members in edges_of.items():
        entities[shape] = _entities(members)
    return entities, frozen_ints(np.flatnonzero(uses == 1))


def _from_solids(elements: Mapping[Shape, Ints]) -> tuple[dict[Shape, Entities], Ints]:
    """Entities of solids, and the faces of single elements.

    Faces as their first element sees them, triangles numbered before quadrilaterals; then edges of the faces.
    """
    faces: dict[Shape, Ints] = {}
    most = sum(len(rows) * len(shape.faces) for shape, rows in elements.items())
    faces_of = {shape: np.empty((len(rows), len(shape.faces)), index_type(most)) for shape, rows in elements.items()}
    outer = []
    offset = 0
    for kind in (Shape.TRIANGLE, Shape.QUADRILATERAL):
        sides = [
            (shape, i, face) for shape in elements for i, face in enumerate(shape.faces) if face_shape(face) is kind
        ]
        if not sides:
            continue
        views = [(elements[shape], face) for shape, _, face in sides]
        first, which = distinct_sides(views)
        faces[kind] = rows_of_sides(views, first)

        # faces of one element lie on the boundary
        uses = uses_of(which, len(first))
        outer.append(offset + np.flatnonzero(uses == 1))
        numbers = _split(which, [len(elements[shape]) for shape, _, _ in sides])
        for (shape, i, _), own in zip(sides, numbers, strict=True):
            np.add(own, offset, out=faces_of[shape][:, i])
        del which, numbers
        offset += len(first)

    entities, _ = _from_polygons(faces)
    for kind, ids in _face_ids(faces).items():
        entities[kind] = Entities(ids, entities[kind].members)
    for shape, members in faces_of.items():
        entities[shape] = _entities(members)
    return entities, frozen_ints(np.concatenate(outer))


def _face_ids(faces: Mapping[Shape, Ints]) -> dict[Shape, Ints]:
    """Ids of the faces of each kind: all are numbered through."""
    ids = {}
    first = 0
    for kind, rows in faces.items():
        ids[kind] = frozen_ints(first + np.arange(len(rows)))
        first += len(rows)
    return ids


#: how elements of a dimension get their edges and faces
_SKELETONS = {1: _from_segments, 2: _from_polygons, 3: _from_solids}


def _edges(polygons: Mapping[Shape, Ints]) -> tuple[Ints, dict[Shape, Ints], Ints]:
    """Distinct edges (n, 2) from lower to higher vertex, the edges of each polygon, and how many polygons use each."""
    sides = [(shape, i) for shape, rows in polygons.items() for i in range(rows.shape[1])]
    views = [(polygons[shape], (i, (i + 1) % polygons[shape].shape[1])) for shape, i in sides]
    first, which = distinct_sides(views)
    edges = rows_of_sides(views, first)
    edges.sort(axis=1)
    uses = uses_of(which, len(first))
    del first

    edges_of = {shape: np.empty(rows.shape, which.dtype) for shape, rows in polygons.items()}
    numbers = _split(which, [len(polygons[shape]) for shape, _ in sides])
    for (shape, i), own in zip(sides, numbers, strict=True):
        edges_of[shape][:, i] = own
    return edges, edges_of, uses


def _split(rows: Ints, lengths: list[int]) -> list[Ints]:
    """Parts of these lengths, one after the other."""
    return np.split(rows, np.cumsum(lengths)[:-1])


def _entities(members: Ints) -> Entities:
    """Entities with ids from 0."""
    return Entities(frozen_ints(np.arange(len(members))), frozen_view(np.ascontiguousarray(members)))
