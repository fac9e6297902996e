"""Which side of a surface is inside: known where it is closed, so that two faces meet at each of their sides."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.distances.surface_patches import SurfacePatches
from elvis.core.mapping.orientation import chunks
from elvis.core.needing import needed

#: part of a triangle's size by which a point lies before it
_BEFORE = 1e-6


def is_closed(loops: Sequence[Ints]) -> bool:
    """Whether each side of faces, whose vertices are given in order (n, k), belongs to two faces."""
    if loops[0].shape[1] == 2:
        sides = np.concatenate([loop.reshape(-1, 1) for loop in loops])
    else:
        sides = np.concatenate([np.stack([loop, np.roll(loop, -1, axis=1)], axis=2).reshape(-1, 2) for loop in loops])
    counts = np.unique(np.sort(sides, axis=1), axis=0, return_counts=True)[1]
    return bool((counts == 2).all())


def sides_of_triangles(points: Floats, triangles: Ints) -> Ints:
    """(m, 2) the sign of distances before and behind triangles (m, 3) of a closed surface: -1 inside, 1 outside.

    A point is inside where the surface winds around it (Jacobson, Kavan and Sorkine-Hornung 2013).  The triangles turn
    as the file says, if they agree with their neighbours; else they are turned.
    """
    igl = needed("igl", "the distance to a surface", "distances")

    own = triangles if _agree(triangles) else np.asarray(igl.bfs_orient(triangles)[0], np.int64)
    turned = (own != triangles).any(axis=1)
    corners = points[own]
    winding = np.asarray(igl.winding_number(points, own, corners.mean(axis=1) + _ahead(corners)))
    inside = np.abs(np.stack([winding, winding + 1], axis=1)) > 0.5
    signs = np.where(inside, -1, 1)
    signs[turned] = signs[turned, ::-1]
    return np.asarray(signs)


def _agree(triangles: Ints) -> bool:
    """Whether neighbours run along their common side in opposite ways."""
    ways = np.stack([triangles, np.roll(triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    return len(np.unique(ways, axis=0)) == len(ways)


def sides_of_faces(loops: Sequence[Ints], patches: Sequence[SurfacePatches]) -> Ints:
    """(faces, 2) the sign of distances before and behind the faces of a closed surface: -1 inside, 1 outside.

    loops   for each kind of face the vertices (n, k) around them
    patches  for each kind of face their patches, nearly flat; faces are numbered through all kinds
    A point is inside where the surface winds around it an odd number of times, whichever way its parts turn.
    """
    if patches[0].corners == 2:
        ends = np.concatenate([each.vertices for each in patches])
        own = np.unique(np.concatenate([each.face for each in patches]), return_index=True)[1]
        way = ends[own, 1] - ends[own, 0]
        places = ends[own].mean(axis=1) + _BEFORE * way[:, [1, 0, 2]] * (1, -1, 0)
        odd = _crossings(ends, places) % 2 == 1
    else:
        turned, corners, face = _flips(loops), *map(np.concatenate, zip(*map(_fans, patches), strict=True))
        own = np.unique(face, return_index=True)[1]
        places = corners[own].mean(axis=1) + _ahead(corners[own])
        corners[turned[face]] = corners[turned[face]][:, ::-1]
        odd = np.rint(_winding(corners, places)).astype(np.int64) % 2 == 1
    return np.where(np.stack([odd, ~odd], axis=1), -1, 1)


def _flips(loops: Sequence[Ints]) -> Bools:
    """(faces,) which of the faces would have to run the other way round, so that neighbours agree."""
    igl = needed("igl", "the distance to a surface", "distances")

    fans = [np.stack([loop[:, [0, k, k + 1]] for k in range(1, loop.shape[1] - 1)], axis=1) for loop in loops]
    triangles = np.concatenate([fan.reshape(-1, 3) for fan in fans])
    face = np.repeat(np.arange(sum(map(len, loops))), np.concatenate([np.full(len(f), f.shape[1]) for f in fans]))
    ways = (np.asarray(igl.bfs_orient(triangles)[0]) != triangles).any(axis=1)
    found = np.zeros(sum(map(len, loops)), bool)
    found[face[ways]] = True
    return found


def _fans(patches: SurfacePatches) -> tuple[Floats, Ints]:
    """Triangles (n, 3, 3) between the corners of patches, and the face (n,) that each belongs to."""
    vertices = patches.vertices
    fans = [vertices[:, [0, k, k + 1]] for k in range(1, patches.corners - 1)]
    return np.concatenate(fans), np.tile(patches.face, len(fans))


def _ahead(corners: Floats) -> Floats:
    """(n, 3) short steps off triangles (n, 3, 3), to the side from which they are seen to turn left."""
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.sqrt(np.linalg.norm(normal, axis=1, keepdims=True))
    return np.asarray(_BEFORE * normal / np.where(size > 0, size, 1.0))


def _winding(corners: Floats, places: Floats) -> Floats:
    """(n,) how often triangles (m, 3, 3) wind around points (n, 3)."""
    igl = needed("igl", "the distance to a surface", "distances")

    triangles = np.arange(3 * len(corners)).reshape(-1, 3)
    return np.asarray(igl.winding_number(np.ascontiguousarray(corners.reshape(-1, 3)), triangles, places))


def _crossings(ends: Floats, places: Floats) -> Ints:
    """(n,) how many of the lines (m, 2, 3) in the plane a ray from points (n, 3) along x crosses."""
    found = np.zeros(len(places), np.int64)
    for part in chunks(len(places), max(1, (1 << 22) // len(ends))):
        x, y = places[part, 0, None], places[part, 1, None]
        (x0, y0), (x1, y1) = ends[:, 0, :2].T, ends[:, 1, :2].T
        across = (y0 > y) != (y1 > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            found[part] = (across & (x0 + (y - y0) / (y1 - y0) * (x1 - x0) > x)).sum(axis=1)
    return found
