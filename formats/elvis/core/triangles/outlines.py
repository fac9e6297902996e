"""Outlines of surfaces: faces of elements at which their triangles end."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.base.arrays import Bools, Ints
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.patch import Patch
from elvis.core.streamlines.neighbours import Neighbours
from elvis.core.triangles.cell_places import Cells, Marched
from elvis.core.triangles.level_cells import faces_of_cells

#: distance from a face of a cell, whose length is 1, up to which points are on it
_ON_FACE = 1e-12


def outer_faces(dataset: Dataset, patches: Sequence[Patch]) -> list[Bools]:
    """By patch: (n, faces) which faces of elements nothing lies beyond."""
    neighbours = Neighbours.of(dataset, patches)
    found = []
    for number, patch in enumerate(patches):
        row, face = np.indices((len(patch), len(patch.shape.faces))).reshape(2, -1)
        is_outer = neighbours.is_outer(np.full(len(row), number), row, face)
        found.append(np.asarray(is_outer, bool).reshape(len(patch), -1))
    return found


def open_sides(triangles: Ints) -> tuple[Ints, Ints]:
    """Rows (k,) and slots (k,) of sides of triangles that no other triangle has."""
    sides = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    keys = np.sort(sides, axis=1) @ [int(triangles.max()) + 1, 1]
    _, first, count = np.unique(keys, return_index=True, return_counts=True)
    return np.divmod(first[count == 1], 3)


def with_ends(outlines: Sequence[Bools], cells: Cells, marched: Marched) -> list[Bools]:
    """Faces (n, faces) by patch, with those at which triangles end: where q jumps, also faces between elements."""
    found = [own.copy() for own in outlines]
    row, slot = open_sides(marched.triangles)
    ends = marched.places[row[:, None], np.stack([slot, (slot + 1) % 3], axis=1)]
    is_at = np.stack([np.abs(ends - end).max(axis=1) <= _ON_FACE for end in (0, 1)], axis=2)
    for group, own in enumerate(cells.boxes):
        faces = faces_of_cells(own.shape)[own.cell]
        side, axis, end = np.nonzero(is_at & (faces >= 0) & (marched.group[row] == group)[:, None, None])
        found[own.patch][marched.row[row[side]], faces[axis, end]] = True
    return found
