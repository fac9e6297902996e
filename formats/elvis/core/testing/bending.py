"""Turning and bending meshes, to put the rules of orientation and curvature to the test."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, frozen_ints
from elvis.core.data.mesh import Curves, Entities, Mesh
from elvis.core.mapping.orientation import polygon_vertices
from elvis.core.polynomials.points import PointsType, nodes, triangle_nodes
from elvis.core.shapes import Shape

Warp = Callable[[Floats], Floats]


def swirled(points: Floats) -> Floats:
    """A smooth map of points (n, 3) that elements with three nodes per edge cannot represent: they must be curved."""
    x, y, z = points.T
    shifts: Floats = np.stack([np.sin(4 * y), np.sin(5 * z), np.sin(3 * x + 2 * y)], axis=1)
    return points + 0.05 * shifts


def ripple(amplitude: float, seed: int = 0, waves: int = 3) -> Warp:
    """A smooth map of points (n, 3): each coordinate is shifted by up to ``amplitude`` along a few random waves."""
    rng = np.random.default_rng(seed)
    numbers, phases = rng.uniform(-3, 3, (waves, 3, 3)), rng.uniform(0, 2 * np.pi, (waves, 3))

    def warp(points: Floats) -> Floats:
        angles = np.einsum("nj,wij->nwi", points, numbers) + phases
        moved: Floats = points + amplitude / waves * np.sin(angles).sum(axis=1)
        return moved

    return warp


def shuffled(mesh: Mesh, seed: int) -> Mesh:
    """The mesh with edges and faces entered in another, equally valid orientation in the file.

    Edges change direction; quadrilateral faces begin at any vertex and run either way; triangular faces exchange the
    two vertices that aren't collapsed.  Elements keep their local vertices.
    """
    rng = np.random.default_rng(seed)
    entities = dict(mesh.entities)
    edges = mesh.of(Shape.SEGMENT)
    if mesh.dimension > 1:
        flipped = rng.random(len(edges)) < 0.5
        entities[Shape.SEGMENT] = _with(edges, np.where(flipped[:, None], edges.members[:, ::-1], edges.members))
    if mesh.dimension == 3:
        triangles, quadrilaterals = mesh.of(Shape.TRIANGLE), mesh.of(Shape.QUADRILATERAL)
        swapped = rng.random(len(triangles)) < 0.5
        members = np.where(swapped[:, None], triangles.members[:, [0, 2, 1]], triangles.members)
        entities[Shape.TRIANGLE] = _with(triangles, members)
        start, backwards = rng.integers(4, size=len(quadrilaterals)), rng.random(len(quadrilaterals)) < 0.5
        steps: Ints = (start[:, None] + np.arange(4) * np.where(backwards, 3, 1)[:, None]) % 4
        members = np.take_along_axis(quadrilaterals.members, steps, axis=1)
        entities[Shape.QUADRILATERAL] = _with(quadrilaterals, members)
    return replace(mesh, entities=entities)


def _with(entities: Entities, members: Ints) -> Entities:
    return Entities(entities.ids, frozen_ints(members))


def curved(
    mesh: Mesh,
    warp: Warp,
    n: int,
    line: PointsType = PointsType.LOBATTO_LEGENDRE,
    triangle: PointsType = PointsType.TRIANGLE_EVENLY_SPACED,
    faces: bool = True,
) -> Mesh:
    """A straight mesh moved by ``warp``, with ``n`` nodes along every edge and, on request, on every face.

    line      nodes of edges and of quadrilaterals
    triangle  nodes of triangles; a family on the line makes a lattice over the collapsed square
    In one dimension edges are the elements, in two faces are.
    """
    edges = mesh.of(Shape.SEGMENT)
    along = (1 + nodes(line, n)) / 2
    points = _blend(mesh.vertices[edges.members], np.stack([1 - along, along], axis=1))
    edge_curves = _curves(np.arange(len(edges)), line, warp(points), n)
    face_curves = Curves.none()
    if faces and mesh.dimension > 1:
        face_curves = _face_curves(mesh, warp, n, line, triangle)
    moved = frozen_floats(warp(mesh.vertices))
    return replace(mesh, vertices=moved, edge_curves=edge_curves, face_curves=face_curves)


def _face_curves(mesh: Mesh, warp: Warp, n: int, line: PointsType, triangle: PointsType) -> Curves:
    """Curves of all triangles, then of all quadrilaterals."""
    first, second = np.meshgrid((1 + nodes(line, n)) / 2, (1 + nodes(line, n)) / 2)
    square = _corner_weights(first.reshape(-1), second.reshape(-1))
    if triangle.is_triangular:
        x, y = ((1 + triangle_nodes(triangle, n)) / 2).T
        barycentric = np.stack([1 - x - y, x, y], axis=1)
    else:
        barycentric = np.stack([square[:, 0], square[:, 1], square[:, 2] + square[:, 3]], axis=1)
    parts = [(Shape.TRIANGLE, triangle, barycentric), (Shape.QUADRILATERAL, line, square)]
    points = [_blend(mesh.vertices[polygon_vertices(mesh, s)], weights) for s, _, weights in parts]
    kinds = [np.full(len(mesh.of(s)), family) for s, family, _ in parts]
    sizes = np.concatenate([np.full(len(mesh.of(s)), len(weights)) for s, _, weights in parts])
    offsets = np.concatenate([[0], np.cumsum(sizes)])
    rows = np.arange(len(sizes))
    return Curves(
        frozen_ints(rows),
        frozen_ints(np.concatenate(kinds)),
        frozen_ints(offsets),
        frozen_floats(warp(np.concatenate(points))),
    )


def _corner_weights(x: Floats, y: Floats) -> Floats:
    """(n, 4) bilinear weights of the corners of a quadrilateral, in [0, 1]^2."""
    return np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y], axis=1)


def _blend(corners: Floats, weights: Floats) -> Floats:
    """(k m, 3) points of k entities with ``corners`` (k, c, 3), at m nodes with ``weights`` (m, c)."""
    return np.asarray(np.einsum("kci,mc->kmi", corners, weights).reshape(-1, 3))


def _curves(rows: Ints, family: PointsType, points: Floats, n: int) -> Curves:
    offsets = n * np.arange(len(rows) + 1)
    return Curves(
        frozen_ints(rows), frozen_ints(np.full(len(rows), family)), frozen_ints(offsets), frozen_floats(points)
    )
