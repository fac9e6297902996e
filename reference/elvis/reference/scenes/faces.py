"""Rays against the curved faces of elements.

A face is cut into flat triangles until they stay within a part of a pixel of it on the screen; pixels within that
distance of a triangle are its candidates, and Newton's method on the exact face decides them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.mapping.cutting import template
from elvis.core.mapping.margins import TOLERANCE
from elvis.core.mapping.patch import Patch
from elvis.reference.baseline.templates import pulling
from elvis.reference.chebyshev import map_degrees
from elvis.reference.scenes.crossings import Crossings
from elvis.reference.scenes.newton import Constraint, Roots, solve
from elvis.reference.scenes.rasters import among, on_screen, pixels_near
from elvis.reference.solids import Face, faces_of, heights, map_lattice
from elvis.scene.cameras.view import View
from elvis.scene.record.frame import Status

#: pixels by which a triangle may be off its face, and cuts after which it may be off by any
_FLAT, _DEEPEST = 0.25, 6
#: factor for the widening of candidates relative to the measured distance at the centres of sides
_SAFETY = 2.0
#: cosine below which a hit is at a silhouette, as certain as rounding allows
_GRAZING = 1e-6


def face_crossings(
    number: int, patch: Patch, chosen: Bools, view: View, size: float, wanted: Ints | None = None
) -> Crossings:
    """All hits of rays with the chosen faces (e, local faces) of a patch; see `elvis.reference.solids`.

    wanted  (n,) sorted numbers row * pixels + pixel of pairs of an element and a pixel; only these are examined
    """
    found = []
    for local, face in enumerate(faces_of(patch)):
        rows = np.flatnonzero(chosen[:, local])
        for some in _triangles(patch, face, rows, view):
            for triangle, pixel in pixels_near(view, some.corners, some.slack):
                if wanted is not None:
                    known = among(wanted, some.rows[triangle] * view.count + pixel)
                    triangle, pixel = triangle[known], pixel[known]
                found += _decide(number, patch, face, some.part(triangle), pixel, view, size)
    return Crossings.concatenate(found).distinct(size)


@dataclass(frozen=True, eq=False)
class _Triangles(Rows):
    """Flat triangles in the place of curved faces.

    rows     (m,)       of their elements
    corners  (m, 3, 3)  in the world
    starts   (m, 3, 3)  reference coordinates of the corners
    slack    (m,)       how far faces may be from them, in the world
    folded   (m,)       whether a ray may meet the face more than once next to them, as far as is proved
    """

    rows: Ints
    corners: Floats
    starts: Floats
    slack: Floats
    folded: Bools


def _triangles(patch: Patch, face: Face, rows: Ints, view: View) -> Iterator[_Triangles]:
    """Flat triangles of faces, grouped by level of subdivision.

    The distance of a face from its triangles is measured at the centres of sides.  These are differences of second
    order along a line: a polynomial of degree p needs p - 1 of them to exclude any other, so the first subdivision is
    that fine.
    """
    base, first = face.frame, max(max(map_degrees(patch)) - 2, 0).bit_length()
    deepest = max(first, _DEEPEST)
    for level in range(first, deepest + 1):
        if not len(rows):
            return
        cut = template(face.kind, level)
        cells = np.concatenate([pulling(kind, own, np.tile(np.arange(own.shape[1]) * 1.0, (len(own), 1)))
                                for kind, own in cut.cells.items()])  # fmt: skip
        corners = base[0] + cut.points[cells] @ base[1:]
        middles = 0.5 * (corners + np.roll(corners, -1, axis=1))
        world, bent = (_place(patch, rows, points) for points in (corners, middles))

        # distance of the curved face from its straight sides, on the screen
        flat = 0.5 * (world + np.roll(world, -1, axis=2))
        (at, ahead), (off, _) = on_screen(view, flat), on_screen(view, bent)
        away = np.where(ahead, np.linalg.norm(at - off, axis=-1), 0.0).max(axis=2)
        furthest = away.max(axis=1)
        ready = (furthest <= _FLAT) | (level == deepest)
        count = int(ready.sum())
        if count:
            off_by = np.linalg.norm(bent - flat, axis=-1).max(axis=(1, 2))
            slack = np.repeat(_SAFETY * off_by[ready], len(cells))
            folded = _is_folded(view, world[ready].reshape(-1, 3, 3), away[ready].ravel())
            starts = np.tile(corners, (count, 1, 1))
            yield _Triangles(np.repeat(rows[ready], len(cells)), world[ready].reshape(-1, 3, 3), starts, slack, folded)
        rows = rows[~ready]


def _is_folded(view: View, corners: Floats, away: Floats) -> Bools:
    """(m,) which triangles (m, 3, 3) may have a point of the screen twice, with faces ``away`` (m,) pixels from them.

    In barycentric coordinates l, the face is the triangle plus 4 d_ij l_i l_j, with d_ij at the centres of sides, plus
    terms of higher order.  This changes along a direction v by at most 8 |d| max |v|, and the triangle by at least its
    smallest height times max |v|.  If the latter is larger, no place is met twice.
    """
    screen, front = on_screen(view, corners)
    sides = np.roll(screen, -1, axis=1) - screen
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    area = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    with np.errstate(invalid="ignore"):
        return np.asarray(~front.all(axis=1) | ~(8 * _SAFETY * away * longest < area))


def _place(patch: Patch, rows: Ints, points: Floats) -> Floats:
    """(e, c, k, 3) world coordinates of reference points (c, k, 3) in all elements."""
    return map_lattice(patch, rows, points.reshape(-1, 3)).reshape(len(rows), *points.shape[:2], 3)


def _decide(
    number: int, patch: Patch, face: Face, triangles: _Triangles, pixel: Ints, view: View, size: float
) -> list[Crossings]:
    """The hits among candidate pairs of a triangle and a pixel: from the middle of each, and where rays may meet the
    face more than once, also from its corners."""
    origins, directions = view.rays_of(pixel)
    found = []
    for start, which in _starts(triangles, origins, directions):
        own = triangles.rows[which]
        roots = solve(patch, own, start, origins[which], directions[which], _on_face(face), size)
        found.append(_hits(number, face, own, pixel[which], roots, directions[which]))
    return found


def _starts(triangles: _Triangles, origins: Floats, directions: Floats) -> Iterator[tuple[Floats, Ints]]:
    """Starting points (k, 3) and the candidates (k,) that they are for."""
    reference, every = triangles.starts, np.arange(len(triangles.rows))
    yield np.einsum("nk,nki->ni", weights(triangles.corners, origins, directions), reference), every
    which = np.flatnonzero(triangles.folded)
    for corner in range(3) if len(which) else ():
        yield reference[which, corner], which


def weights(corners: Floats, origins: Floats, directions: Floats) -> Floats:
    """(n, 3) weights of the corners where rays pass the planes of triangles (n, 3, 3), drawn into the triangle."""
    a, b, c = (corners[:, i] for i in range(3))
    normal = np.cross(b - a, c - a)
    with np.errstate(invalid="ignore", divide="ignore"):
        depth = np.einsum("ni,ni->n", normal, a - origins) / np.einsum("ni,ni->n", normal, directions)
        point, area = origins + depth[:, None] * directions, np.einsum("ni,ni->n", normal, normal)
        second = np.einsum("ni,ni->n", np.cross(point - a, c - a), normal) / area
        third = np.einsum("ni,ni->n", np.cross(b - a, point - a), normal) / area
    found = np.nan_to_num(np.column_stack([1 - second - third, second, third]), nan=1 / 3, posinf=1, neginf=0)
    found = np.clip(found, 0, 1)
    return np.asarray(found / found.sum(axis=1, keepdims=True))


def _on_face(face: Face) -> Constraint:
    """The constraint of points on a face: its height is zero."""

    def constraint(rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        return heights(face.height[None], points)[:, 0], np.tile(face.height[:3], (len(points), 1))

    return constraint


def _hits(number: int, face: Face, rows: Ints, pixel: Ints, roots: Roots, directions: Floats) -> Crossings:
    """The roots that lie on the face, before the eye; those at its border and at silhouettes are ambiguous."""
    other = heights(face.others, roots.reference).min(axis=1)
    here = np.flatnonzero(roots.found & (other >= -TOLERANCE) & (roots.depth > 0))
    normal = roots.normal[here]
    with np.errstate(invalid="ignore"):
        cosine = np.abs(np.einsum("ni,ni->n", normal, directions[here]))
        cosine /= np.linalg.norm(normal, axis=1) * np.linalg.norm(directions[here], axis=1)
    doubt = (other[here] <= TOLERANCE) | ~(cosine > _GRAZING)
    status = np.where(doubt, Status.AMBIGUOUS, Status.CERTAIN).astype(np.uint8)
    patch = np.full(len(here), number)
    columns = (pixel[here], roots.depth[here], patch, rows[here], roots.reference[here], normal, status)
    return Crossings(*columns, np.full(len(here), np.nan))
