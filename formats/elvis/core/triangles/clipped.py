"""Triangles cut along a surface, with the parts of intersected triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.coordinate_levels import coordinate_clip, heights
from elvis.core.quantities.tree import Node, world_derivative
from elvis.core.triangles.level_lines import LevelLines
from elvis.core.triangles.surface_triangles import SurfaceTriangles

#: halvings of an edge in search of where the surface cuts it, and of edges that it is not straight along
_HALVINGS, _DIVISIONS = 60, 24


def clipped(surface: SurfaceTriangles, dataset: Dataset, clip: str, tolerance: float) -> SurfaceTriangles:
    """The part inside ``plane:P:N``, ``sphere:C:R`` or ``cylinder:P:A:R``.

    With the prefix ``outside:``, the part outside.

    Triangles near the surface are subdivided until it is straight in each up to the tolerance.  Edges are cut at the
    surface, shared edges only once, so no gap opens.  Raises ElvisError for surfaces that depend on more than
    coordinates, and if the result is empty.
    """
    root = coordinate_clip(dataset, clip)
    surface = _divided(surface, root, tolerance)
    inside = heights(root, surface.points) < 0
    count = inside[surface.triangles].sum(axis=1)
    kept = [surface.triangles[count == 3]]
    cut = surface.triangles[(count > 0) & (count < 3)]
    if len(cut):
        surface, made = _cut(surface, root, inside, cut)
        kept.append(made)
    found = replace(surface, triangles=np.concatenate(kept))
    if not len(found.triangles):
        raise ElvisError(f"--clip {clip}: expected some of the surface to be left, found none")
    return found.compacted()


def _divided(surface: SurfaceTriangles, root: Node, tolerance: float) -> SurfaceTriangles:
    """The surface with those edges bisected that the clip may meet and along which it is not straight."""
    gradient = [world_derivative(root, axis) for axis in range(3)]
    for _ in range(_DIVISIONS):
        edges, number = _edges(surface.triangles)
        marked = _are_bent(root, gradient, surface.points[edges], tolerance)
        if not marked.any():
            break
        surface = _halved(surface, edges, number, marked)
    return surface


def _are_bent(root: Node, gradient: Sequence[Node], ends: Floats, tolerance: float) -> Bools:
    """(k,) whether the clip may meet edges with ends (k, 2, 3), and is not straight along them."""
    start, stop = ends[:, 0], ends[:, 1]
    middle, length = (start + stop) / 2, np.linalg.norm(stop - start, axis=1)
    height = heights(root, middle)
    bend = np.abs(height - (heights(root, start) + heights(root, stop)) / 2)
    slope = np.linalg.norm([heights(own, middle) for own in gradient], axis=0)
    is_near = np.abs(height) <= slope * length + 4 * bend
    return np.asarray(is_near & (bend > tolerance * slope))


def _edges(triangles: Ints) -> tuple[Ints, Ints]:
    """The edges (k, 2) of triangles, and the numbers (m, 3) of those from corner 0 to 1, 1 to 2 and 2 to 0."""
    pairs = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    edges, number = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True)
    return edges, number.reshape(-1, 3)


def _halved(surface: SurfaceTriangles, edges: Ints, number: Ints, marked: Bools) -> SurfaceTriangles:
    """The surface with marked edges (k,) bisected: triangles become as many as they have marked edges, and one more."""
    middles = np.full(len(edges), -1)
    middles[marked] = len(surface.points) + np.arange(int(marked.sum()))
    grown = _between(surface, edges[marked], np.full(int(marked.sum()), 0.5))
    own, halves = surface.triangles, middles[number]
    count = (halves >= 0).sum(axis=1)
    made = [own[count == 0]]
    for many in (1, 2, 3):
        here = count == many
        # turned so that marked edges come first
        is_marked = halves[here] >= 0
        first = np.where(is_marked[:, 0] & ~is_marked[:, 2], 0, np.where(is_marked[:, 1] & ~is_marked[:, 0], 1, 2))
        turn = (first[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(own[here], turn, axis=1).T
        x, y, z = np.take_along_axis(halves[here], turn, axis=1).T
        parts = {
            1: ((a, x, c), (x, b, c)),
            2: ((x, b, y), (a, x, c), (x, y, c)),
            3: ((a, x, z), (x, b, y), (z, y, c), (x, y, z)),
        }
        made += [np.stack(part, axis=1) for part in parts[many]]
    return replace(grown, triangles=np.concatenate(made))


def _cut(surface: SurfaceTriangles, root: Node, inside: Bools, cut: Ints) -> tuple[SurfaceTriangles, Ints]:
    """The surface with points on cut edges, and the remaining triangles (k, 3) of the triangles ``cut``."""
    # the corner that lies on its own side comes first
    own = inside[cut]
    first = np.where(own.sum(axis=1) == 1, own.argmax(axis=1), (~own).argmax(axis=1))
    a, b, c = (cut[np.arange(len(cut)), (first + k) % 3] for k in range(3))
    edges = np.sort(np.concatenate([np.stack([a, b], axis=1), np.stack([a, c], axis=1)]), axis=1)
    ends, number = np.unique(edges, axis=0, return_inverse=True)
    on_b, on_c = len(surface.points) + number.reshape(2, -1)
    grown = _with_points(surface, root, ends)

    is_tip = inside[a]
    tips = np.stack([a, on_b, on_c], axis=1)[is_tip]
    stumps = [np.stack(own, axis=1)[~is_tip] for own in ((on_b, b, c), (on_b, c, on_c))]
    return grown, np.concatenate([tips, *stumps])


def _with_points(surface: SurfaceTriangles, root: Node, ends: Ints) -> SurfaceTriangles:
    """The surface with a point on each edge from one of its points to another (k, 2), where the clip has its zero."""
    return _between(surface, ends, _zeros(root, surface.points[ends]))


def _zeros(root: Node, ends: Floats) -> Floats:
    """(k,) where the clip has its zero between ends (k, 2, 3), as a share of the way."""
    start, stop = ends[:, 0], ends[:, 1]
    low, high = np.zeros(len(ends)), np.ones(len(ends))
    sign = heights(root, start) < 0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        is_before = (heights(root, start + middle[:, None] * (stop - start)) < 0) == sign
        low, high = np.where(is_before, middle, low), np.where(is_before, high, middle)
    return np.asarray((low + high) / 2)


def _between(surface: SurfaceTriangles, ends: Ints, t: Floats) -> SurfaceTriangles:
    """The surface with a point on each edge (k, 2), at a share t (k,) of the way."""

    def extended(own: Floats) -> Floats:
        weight = t.reshape(-1, *(1,) * (own.ndim - 1))
        return np.concatenate([own, (1 - weight) * own[ends[:, 0]] + weight * own[ends[:, 1]]])

    normals = extended(surface.normals)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    values = {name: extended(own) for name, own in surface.values.items()}
    return replace(surface, points=extended(surface.points), normals=normals, values=values)


def clipped_lines_of_level(curve: LevelLines, dataset: Dataset, clip: str, tolerance: float) -> LevelLines:
    """The part of lines inside ``plane:P:N``, ``sphere:C:R`` or ``cylinder:P:A:R``; see `clipped`."""
    root = coordinate_clip(dataset, clip)
    gradient = [world_derivative(root, axis) for axis in range(3)]
    for _ in range(_DIVISIONS):
        marked = _are_bent(root, gradient, curve.points[curve.lines], tolerance)
        if not marked.any():
            break
        curve = _with_cuts(curve, marked, np.full(int(marked.sum()), 0.5))
    inside = heights(root, curve.points) < 0
    is_cut = inside[curve.lines[:, 0]] != inside[curve.lines[:, 1]]
    old = len(curve.points)
    curve = _with_cuts(curve, is_cut, _zeros(root, curve.points[curve.lines[is_cut]]))

    # points on the clip belong to both sides: the other end of a line decides
    is_left = np.append(inside, np.ones(len(curve.points) - old, bool))[curve.lines].all(axis=1)
    if not is_left.any():
        raise ElvisError(f"--clip {clip}: expected some of the lines to be left, found none")
    used, flat = np.unique(curve.lines[is_left], return_inverse=True)
    values = {name: own[used] for name, own in curve.values.items()}
    return replace(curve, points=curve.points[used], lines=flat.reshape(-1, 2), values=values)


def _with_cuts(curve: LevelLines, chosen: Bools, t: Floats) -> LevelLines:
    """The lines, with chosen ones (k,) divided in two at a share t (k,) of their length; values are linear."""
    start, stop = curve.lines[chosen].T
    middles = len(curve.points) + np.arange(len(start))
    halves = [curve.lines[~chosen], np.stack([start, middles], axis=1), np.stack([middles, stop], axis=1)]

    def extended(own: Floats) -> Floats:
        weight = t.reshape(-1, *(1,) * (own.ndim - 1))
        return np.concatenate([own, (1 - weight) * own[start] + weight * own[stop]])

    values = {name: extended(own) for name, own in curve.values.items()}
    return replace(curve, points=extended(curve.points), lines=np.concatenate(halves), values=values)
