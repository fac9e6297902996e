"""Zeros of a linear function on simplices: cut surfaces, isosurfaces and contours of linear meshes.

Marching tetrahedra: the intersection with a tetrahedron is a triangle if one corner is on the other side, and a
quadrilateral if two are.  Signs are consistent, so neighbours share the same points.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.reference.baseline.mesh import LinearMesh, concatenate


def section(mesh: LinearMesh, levels: Floats) -> LinearMesh:
    """The triangles of a tetrahedral mesh in which the function with values ``levels`` (n,) at its points is zero.

    If a surface lies exactly on faces, the triangles of both sides are included, so that none at the border is lost.
    """
    sides = [levels >= 0, levels > 0] if (levels == 0).any() else [levels > 0]
    return concatenate([_march(mesh, levels, above) for above in sides])


def _march(mesh: LinearMesh, levels: Floats, above: np.ndarray) -> LinearMesh:
    """The section for one reading of zeros: ``above`` (n,) says which points are on the upper side."""
    count = above[mesh.simplices].sum(axis=1)
    ends, owner = [], []
    for corners in (1, 2, 3):
        which = np.flatnonzero(count == corners)
        tetrahedra = mesh.simplices[which].astype(np.int64)

        # corners above come first, each side in its own order
        order = np.argsort(~above[tetrahedra], axis=1, kind="stable")
        edges = _crossed_edges(np.take_along_axis(tetrahedra, order, axis=1), corners)
        ends.append(edges.reshape(-1, 3, 2))
        owner.append(np.repeat(which, edges.shape[1]))
    return _between(mesh, levels, np.concatenate(ends), np.concatenate(owner))


def _crossed_edges(sorted_corners: Ints, above: int) -> Ints:
    """(n, triangles, 3, 2) ends of the crossed edges of tetrahedra (n, 4) whose first ``above`` corners are above."""
    pairs = {
        1: [[(0, 1), (0, 2), (0, 3)]],
        2: [[(0, 2), (0, 3), (1, 3)], [(0, 2), (1, 3), (1, 2)]],
        3: [[(0, 3), (1, 3), (2, 3)]],
    }[above]
    return np.asarray(sorted_corners[:, np.array(pairs)])


def _between(mesh: LinearMesh, levels: Floats, ends: Ints, owner: Ints) -> LinearMesh:
    """Triangles whose corners are the zeros on edges (m, 3, 2), in the simplices ``owner`` (m,)."""
    pairs, index = np.unique(np.sort(ends.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    first, second = levels[pairs].T
    part = np.divide(first, first - second, out=np.zeros_like(first), where=first != second)[:, None]

    def blend(column: Floats) -> Floats:
        weight = part if column.ndim == 2 else part[:, 0]
        return np.asarray((1 - weight) * column[pairs[:, 0]] + weight * column[pairs[:, 1]])

    return LinearMesh(
        blend(mesh.points),
        {name: blend(values) for name, values in mesh.values.items()},
        blend(mesh.reference),
        index.reshape(-1, 3).astype(np.int32),
        mesh.element[owner],
    )


def boundary(mesh: LinearMesh, chosen: np.ndarray) -> LinearMesh:
    """The triangles of tetrahedra all of whose corners ``chosen`` (n, k) holds for one k.

    A column represents a set of faces: its points are those on them, so k separates faces of one element.
    """
    parts = []
    for column in chosen.T:
        on = column[mesh.simplices]
        which = np.flatnonzero(on.sum(axis=1) == 3)
        triangles = mesh.simplices[which][on[which]].reshape(-1, 3)
        parts.append(replace(mesh, simplices=triangles, element=mesh.element[which]))
    simplices = np.concatenate([part.simplices for part in parts])
    return replace(mesh, simplices=simplices, element=np.concatenate([part.element for part in parts]))
