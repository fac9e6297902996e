"""Which element faces a scene's selection names."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from elvis.formats.arrays import Bools, Floats, Ints
from elvis.formats.margins import facets, heights
from elvis.formats.mesh import Composite, Mesh
from elvis.formats.orientation import first_face_row
from elvis.formats.patch import Patch
from elvis.formats.shapes import Shape
from elvis.renderer.errors import SceneError

_FACES = {"T": Shape.TRIANGLE, "Q": Shape.QUADRILATERAL}


def chosen_faces(mesh: Mesh, patch: Patch, select: Sequence[str]) -> Bools:
    """(e, local faces) of the faces of a patch of volume elements that a selection names; see scene.Faces.

    Raises SceneError for a name that the mesh doesn't know.
    """
    chosen = np.zeros((len(patch), len(patch.shape.faces)), bool)
    rows = _rows(mesh, patch)
    for name in select:
        kind, _, rest = name.partition(":")
        if name == "all":
            chosen |= _outer(mesh)[rows]
        elif kind == "element" and rest.isdecimal():
            chosen |= (patch.element_ids == int(rest))[:, None]
        elif kind == "shape" and rest:
            chosen |= patch.shape.label.lower() == rest.lower()
        elif kind == "region" and rest:
            chosen |= np.isin(patch.element_ids, _members(_composite(mesh, rest), patch.shape.tag))[:, None]
        else:
            chosen |= np.isin(rows, _face_rows(mesh, _composite(mesh, name)))
    return chosen


def _rows(mesh: Mesh, patch: Patch) -> Ints:
    """(e, local faces) rows of the mesh's faces."""
    entities = mesh.of(patch.shape)
    order = np.argsort(entities.ids)
    return np.asarray(entities.members[order[np.searchsorted(entities.ids, patch.element_ids, sorter=order)]])


def _outer(mesh: Mesh) -> Bools:
    """(faces,) those that only one element of the domain has."""
    count = np.zeros(sum(len(mesh.of(shape)) for shape in _FACES.values()), np.int64)
    ids = mesh.domain_ids()
    for entities in mesh.elements.values():
        np.add.at(count, entities.members[np.isin(entities.ids, ids)].reshape(-1), 1)
    return np.asarray(count == 1)


def _composite(mesh: Mesh, name: str) -> Composite:
    """The composite of this name or id; SceneError where there is none."""
    for composite in mesh.composites:
        if name in (composite.name, str(composite.id)):
            return composite
    known = ", ".join(composite.name or str(composite.id) for composite in mesh.composites) or "none"
    raise SceneError(f"select of faces: expected all or a composite of the mesh ({known}), found {name!r}")


def _members(composite: Composite, *tags: str) -> Ints:
    """Global ids of the entities with these tags."""
    return np.concatenate([np.empty(0, np.int64), *(ids for tag, ids in composite.parts if tag in tags)])


def _face_rows(mesh: Mesh, composite: Composite) -> Ints:
    """Rows of the faces of a composite, triangles first as in the mesh."""
    rows = []
    for tag, shape in _FACES.items():
        here = np.isin(mesh.of(shape).ids, _members(composite, tag, "F"))
        rows.append(first_face_row(mesh, shape) + np.flatnonzero(here))
    return np.concatenate(rows)


@cache
def face_heights(shape: Shape) -> Ints:
    """(local faces,) which of `margins.facets` each local face is."""
    normals, offsets = facets(shape)
    corners: list[Floats] = [shape.vertices[list(face)] for face in shape.faces]
    return np.array([int(np.abs(own @ normals.T + offsets).sum(axis=0).argmin()) for own in corners])


def on_faces(shape: Shape, points: Floats) -> Bools:
    """(k, local faces) whether reference points (k, d) lie on each face."""
    return np.asarray(heights(shape, points)[:, face_heights(shape)] == 0)
