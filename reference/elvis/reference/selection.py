"""The element faces that a scene selects."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, joined_ints
from elvis.core.data.mesh import Composite, Mesh
from elvis.core.mapping.orientation import first_face_row
from elvis.core.mapping.patch import Patch
from elvis.core.shapes import Shape
from elvis.reference.solids import faces_of, heights
from elvis.scene.model.errors import SceneError

_FACES = {"T": Shape.TRIANGLE, "Q": Shape.QUADRILATERAL}


def selected_faces(mesh: Mesh, patch: Patch, select: Sequence[str]) -> Bools:
    """(e, local faces) of the faces of a patch that a selection names; see scene.Faces.

    Raises SceneError for a name that the mesh doesn't know.
    """
    numbers = _numbers(mesh, patch)
    chosen = np.zeros(numbers.shape, bool)
    for name in select:
        kind, _, rest = name.partition(":")
        if name in ("all", "inner"):
            chosen |= (_counts(mesh, patch)[numbers] > 1) == (name == "inner")
        elif kind == "element" and rest.isdecimal():
            chosen |= (patch.element_ids == int(rest))[:, None]
        elif kind == "shape" and rest:
            label = patch.shape.label.lower()
            chosen |= rest.lower() == (f"extruded {label}" if patch.periods else label)
        elif kind == "region" and rest:
            chosen |= np.isin(patch.element_ids, _members(_composite(mesh, rest), patch.shape.tag))[:, None]
        else:
            chosen |= np.isin(numbers, _faces_of_composite(mesh, patch, _composite(mesh, name)))
    return chosen


def _numbers(mesh: Mesh, patch: Patch) -> Ints:
    """(e, local faces) numbers of the faces.

    Rows of the mesh's faces; for quasi-3D data edges, then two lids for each element; for surfaces elements, triangles
    first.
    """
    entities = mesh.of(patch.shape)
    rows = entities.rows_of(patch.element_ids)
    if patch.shape.dimension == 3:
        return np.asarray(entities.members[rows])
    own = rows[:, None] + first_face_row(mesh, patch.shape)
    if not patch.periods:
        return np.asarray(own)
    return np.column_stack([entities.members[rows], len(mesh.of(Shape.SEGMENT)) + 2 * own + np.arange(2)])


def _counts(mesh: Mesh, patch: Patch) -> Ints:
    """(faces,) how many elements of the domain have each face."""
    every = sum(len(mesh.of(shape)) for shape in _FACES.values())
    if patch.shape.dimension == 2 and not patch.periods:
        return np.ones(every, np.int64)
    borders = every if patch.shape.dimension == 3 else len(mesh.of(Shape.SEGMENT))
    count, ids = np.zeros(borders, np.int64), mesh.domain_ids()
    for entities in mesh.elements.values():
        np.add.at(count, entities.members[np.isin(entities.ids, ids)].reshape(-1), 1)
    return count if patch.shape.dimension == 3 else np.concatenate([count, np.ones(2 * every, np.int64)])


def _composite(mesh: Mesh, name: str) -> Composite:
    """The composite of this name or id; raises SceneError if it does not exist."""
    named = mesh.named_parts()
    if name in named:
        return Composite(-1, named[name])
    known = ", ".join(named) or "none"
    raise SceneError(f"select of faces: expected all, inner or a composite of the mesh ({known}), found {name!r}")


def _members(composite: Composite, *tags: str) -> Ints:
    """Ids of the entities with these tags."""
    return joined_ints(ids for tag, ids in composite.parts if tag in tags)


def _faces_of_composite(mesh: Mesh, patch: Patch, composite: Composite) -> Ints:
    """Numbers of the faces of a composite."""
    if patch.periods:
        return np.flatnonzero(np.isin(mesh.of(Shape.SEGMENT).ids, _members(composite, "E", "S")))
    rows = []
    for tag, shape in _FACES.items():
        here = np.isin(mesh.of(shape).ids, _members(composite, tag, "F"))
        rows.append(first_face_row(mesh, shape) + np.flatnonzero(here))
    return np.concatenate(rows)


def on_faces(patch: Patch, points: Floats) -> Bools:
    """(k, local faces) whether reference points (k, 3) lie on each face."""
    planes = np.stack([face.height for face in faces_of(patch)])
    return np.asarray(np.abs(heights(planes, points)) < 1e-14)
