"""Distances between triangulated surfaces, and their topology."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.reference.baseline.mesh import LinearMesh
from elvis.reference.extras import comparison_module

#: corners nearer than this part of the mesh's size are one
_ONE = 1e-9


@dataclass(frozen=True)
class SurfaceDistance:
    """Distances of a surface from the exact one, in world units, and the topology of both.

    hausdorff   largest distance of a point of either from the other
    chamfer     mean of the two mean distances
    components  connected components of the exact surface, of the other
    handles     of the exact surface, of the other; over all components
    """

    hausdorff: float
    chamfer: float
    components: tuple[int, int]
    handles: tuple[int, int]


def surface_distance(exact: LinearMesh, other: LinearMesh) -> SurfaceDistance | None:
    """Distances of two surfaces; None if one of them is empty."""
    if not len(exact) or not len(other):
        return None
    away, back = _distances(exact, other), _distances(other, exact)
    (components, handles), (own_components, own_handles) = topology(exact), topology(other)
    return SurfaceDistance(
        float(max(away.max(), back.max())),
        float(0.5 * (away.mean() + back.mean())),
        (components, own_components),
        (handles, own_handles),
    )


def _distances(source: LinearMesh, target: LinearMesh) -> Floats:
    """(n,) distances of the corners and middles of one surface's triangles from another surface."""
    triangles = source.points[source.simplices]
    points = np.concatenate([triangles.reshape(-1, 3), triangles.mean(axis=1)])
    igl = comparison_module("igl")
    corners = target.simplices.astype(np.int64)
    squared = igl.point_mesh_squared_distance(points, target.points, corners)[0]
    return np.asarray(np.sqrt(np.maximum(squared, 0.0)))


def topology(mesh: LinearMesh) -> tuple[int, int]:
    """Components and handles of a triangulated surface: genus = 1 - (chi + borders)/2 of each component, summed."""
    triangles = merged(mesh)
    if not len(triangles):
        return 0, 0
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    distinct, uses = np.unique(edges, axis=0, return_counts=True)
    labels = _components(distinct, int(triangles.max()) + 1)
    used = np.unique(triangles)
    components = len(np.unique(labels[used]))
    characteristic = len(used) - len(distinct) + len(triangles)
    rims = distinct[uses == 1]
    borders = len(np.unique(_components(rims, int(triangles.max()) + 1)[np.unique(rims)])) if len(rims) else 0
    return components, max(0, components - (characteristic + borders) // 2)


def merged(mesh: LinearMesh) -> Ints:
    """(m, 3) corners of the triangles after merging equal points; triangles without area are dropped."""
    pairs = (
        comparison_module("scipy.spatial")
        .cKDTree(mesh.points)
        .query_pairs(_ONE * (mesh.size or 1.0), output_type="ndarray")
    )
    index = _components(pairs, len(mesh.points))[mesh.simplices]
    whole = (index[:, 0] != index[:, 1]) & (index[:, 1] != index[:, 2]) & (index[:, 0] != index[:, 2])
    return np.asarray(np.unique(np.sort(index[whole], axis=1), axis=0))


def _components(edges: Ints, count: int) -> Ints:
    """(count,) number of the connected component of each point."""
    sparse, graphs = comparison_module("scipy.sparse"), comparison_module("scipy.sparse.csgraph")
    graph = sparse.coo_matrix((np.ones(len(edges), bool), tuple(edges.T)), shape=(count, count))
    return np.asarray(graphs.connected_components(graph, directed=False)[1])
