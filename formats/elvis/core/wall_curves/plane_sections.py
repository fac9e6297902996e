"""Segments where a plane meets the sides of elements; all are found, unless the plane touches a side.

On a side the signed distance to the plane is a polynomial g of the side's coordinates.  Sides are bisected until bounds
from the coefficients of g show that a part has no zero, or that the derivative of g along its gradient at the centre
has one sign there.  Zeros are then graphs over the line at right angles, whose ends lie on the part's border.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import EPS, Bools, Floats, Ints, joined_columns
from elvis.core.distances.boundaries import side_coefficients
from elvis.core.distances.surface_patches import CORNERS, SurfacePatches, divided
from elvis.core.integrals.graphs import roots
from elvis.core.integrals.reference_cells import Piece
from elvis.core.mapping import pointwise
from elvis.core.polynomials.boxnets import halves, nets_through
from elvis.core.wall_curves.segments import Graphs, Parts, Straight

#: bisections of sides, and tolerance for zero, relative to the largest coordinate
_DEPTH, _ZERO = 14, 256 * EPS
#: bisections of an edge on which zeros are isolated, and the minimum width of a graph, relative to a side
_HALVINGS, _NARROW = 30, 1e-13


@dataclass(frozen=True, eq=False)
class Section:
    """The intersection of a plane and sides of elements.

    graphs     segments inside of sides
    straight   segments along edges that lie in the plane
    in_plane   number of sides that lie in the plane as a whole
    touching   (n, 3) places of sides that the plane touches, or nearly
    """

    graphs: Sequence[Graphs]
    straight: Straight
    in_plane: int
    touching: Floats


def section(pieces: Sequence[Piece], point: Floats, normal: Floats) -> Section:
    """The section of pieces, sides of 3D elements, with the plane through a point (3,) at right angles to (3,)."""
    normal = normal / np.linalg.norm(normal)
    graphs, straight, touching, in_plane = [], [], [np.empty((0, 3))], 0
    for number, piece in enumerate(pieces):
        sides, scale = _distances(number, piece, point, normal)
        is_in_plane = np.abs(sides.coefficients).max(axis=(1, 2)) <= _ZERO * scale
        in_plane += int(is_in_plane.sum())
        straight.append(_flat_edges(sides.part(~is_in_plane), scale))
        found, rest = _graph_parts(sides.part(~is_in_plane))
        graphs.append(_graphs(found, scale))
        touching.append(_places(piece, rest))
    return Section(graphs, Straight.joined(straight), in_plane, np.concatenate(touching))


def _distances(number: int, piece: Piece, point: Floats, normal: Floats) -> tuple[Parts, float]:
    """The signed distances on the sides of a piece, and the largest coordinate."""
    patch = piece.patch
    assert piece.number is not None
    local = patch.shape.faces[piece.number]
    maps = side_coefficients(patch.geometry, patch.geometry_coefficients[piece.rows], local)
    table = maps @ normal
    table[:, 0, 0] -= point @ normal
    count, size = len(piece), float(np.abs(maps).max(initial=0.0) + np.abs(point).max())
    rows = np.arange(count)
    return Parts(len(local), np.zeros((count, 2)), np.ones(count), table, np.full(count, number), rows), size


def _graph_parts(sides: Parts) -> tuple[Parts, Parts]:
    """The parts of sides on which zeros are graphs, and the undecided parts after all bisections."""
    done, rest = [], sides
    for _ in range(_DEPTH):
        gradient, bend, is_free = _bounds(rest)
        is_graph = np.linalg.norm(gradient, axis=1) > bend
        done.append(rest.part(is_graph & ~is_free))
        rest = rest.part(~is_graph & ~is_free)
        if not len(rest):
            break
        rest = _halved(rest)
    return _joined(done), rest


def _bounds(parts: Parts) -> tuple[Floats, Floats, Bools]:
    """(n, 2) gradients of g in the middle, (n,) by how much these change at most, and whether g has no zero."""
    size = np.abs(parts.coefficients)
    m, k = size.shape[1:]
    gradient = np.stack(
        [
            parts.coefficients[:, 0, 1] if k > 1 else 0 * parts.size,
            parts.coefficients[:, 1, 0] if m > 1 else 0 * parts.size,
        ],
        axis=1,
    )
    # |s| <= 1, so that a coefficient bounds its term, and times the power the term's derivative
    along = np.einsum("nji,i->n", size, np.arange(k)) - np.abs(gradient[:, 0])
    across = np.einsum("nji,j->n", size, np.arange(m)) - np.abs(gradient[:, 1])
    rest = size.sum(axis=(1, 2)) - size[:, 0, 0]
    return gradient, np.hypot(along, across), size[:, 0, 0] > rest


def _halved(parts: Parts) -> Parts:
    """The four parts of each part."""
    m, k = parts.coefficients.shape[1:]
    nothing = np.zeros(len(parts), np.int64)
    flat = SurfacePatches(parts.corners, parts.coefficients[..., None], nothing, nothing)
    tables = flat.parts().coefficients[..., 0].reshape(-1, m, k)
    made = []
    for middle, half in divided(parts.corners):
        made.append((parts.middle + parts.size[:, None] * middle, parts.size * half, parts.piece, parts.row))
    middle, size, piece, row = joined_columns(made)
    return Parts(parts.corners, middle, size, tables, piece, row)


def _joined(several: Sequence[Parts]) -> Parts:
    arrays = zip(*((p.middle, p.size, p.coefficients, p.piece, p.row) for p in several), strict=True)
    return Parts(several[0].corners, *map(np.concatenate, arrays))


def _graphs(parts: Parts, scale: float) -> Graphs:
    """The graphs in parts: between neighbouring roots on the border those whose chords have a change of sign."""
    gradient = _bounds(parts)[0]
    up = gradient / np.linalg.norm(gradient, axis=1, keepdims=True)
    along = np.stack([up[:, 1], -up[:, 0]], axis=1)
    owner, places = _breaks(parts)
    heights = np.einsum("nc,nc->n", places, along[owner])
    order = np.lexsort([heights, owner])
    owner, heights = owner[order], heights[order]
    is_within = (owner[1:] == owner[:-1]) & (np.diff(heights) > _NARROW)
    part, spans = owner[:-1][is_within], np.stack([heights[:-1], heights[1:]], axis=1)[is_within]

    base = spans.mean(axis=1)[:, None] * along[part]
    low, high = parts.chords(part, base, up[part])
    first, last = (parts.values(part, base + v[:, None] * up[part])[0] for v in (low, high))
    is_kept = (low < high) & (first * last < 0) & (np.minimum(np.abs(first), np.abs(last)) > _ZERO * scale)
    chosen = part[is_kept]
    return Graphs(parts, chosen, along[chosen], up[chosen], spans[is_kept])


def _pairs(corners: Floats) -> list[tuple[Floats, Floats]]:
    return [(corners[k], corners[(k + 1) % len(corners)]) for k in range(len(corners))]


def _breaks(parts: Parts) -> tuple[Ints, Floats]:
    """Parts (n,) and points (n, 2) on their borders between which g has one sign: corners, and zeros on edges."""
    corners = CORNERS[parts.corners]
    owner, places = [np.repeat(np.arange(len(parts)), len(corners))], [np.tile(corners, (len(parts), 1))]
    for first, last in _pairs(corners):
        row, t = _zeros(_edge_nets(parts, first, last))
        owner.append(row)
        places.append(first + t[:, None] * (last - first))
    return np.concatenate(owner), np.concatenate(places)


def _edge_nets(parts: Parts, first: Floats, last: Floats) -> Floats:
    """(n, D) Bernstein coefficients of g from one point (2,) of parts to another."""
    count = sum(parts.coefficients.shape[1:]) - 1
    t = (1 - np.cos(np.pi * (np.arange(count) + 0.5) / count)) / 2
    points = np.tile(first + t[:, None] * (last - first), (len(parts), 1))
    values = parts.values(np.repeat(np.arange(len(parts)), count), points)[0].reshape(len(parts), count)
    return nets_through(values, t, 1)


def _zeros(nets: Floats) -> tuple[Ints, Floats]:
    """Rows (k,) and places (k,) in [0, 1] of the zeros of polynomials with Bernstein coefficients (n, D), D > 1.

    Coefficients with one change of sign have one zero (Descartes' rule); others are bisected.  A part that is left
    after all bisections is near a double zero, and its centre counts as one zero.
    """
    rows, low, size = np.arange(len(nets)), np.zeros(len(nets)), 1.0
    found_rows, found = [np.empty(0, np.int64)], [np.empty(0)]
    for _ in range(_HALVINGS):
        signs = nets > 0
        changes = (signs[:, 1:] != signs[:, :-1]).sum(axis=1)
        one, many = changes == 1, changes > 1
        found_rows.append(rows[one])
        found.append(low[one] + size * roots(nets[one]))
        rows, low, nets = rows[many], low[many], nets[many]
        size /= 2
        rows, low = np.concatenate([rows, rows]), np.concatenate([low, low + size])
        nets = np.concatenate(halves(nets, 0)) if len(nets) else nets
    return np.concatenate([*found_rows, rows]), np.concatenate([*found, low + size / 2])


def _flat_edges(sides: Parts, scale: float) -> Straight:
    """The edges of sides that lie in the plane."""
    found = []
    for first, last in _pairs(CORNERS[sides.corners]):
        t = np.linspace(0.0, 1.0, sum(sides.coefficients.shape[1:]))
        points = first + t[:, None] * (last - first)
        every = np.repeat(np.arange(len(sides)), len(t))
        values = sides.values(every, np.tile(points, (len(sides), 1)))[0].reshape(len(sides), len(t))
        rows = np.flatnonzero(np.abs(values).max(axis=1, initial=0.0) <= _ZERO * scale)
        ends = (np.tile(end, (len(rows), 1)) for end in (first, last))
        found.append(Straight(sides.piece[rows], sides.row[rows], *ends))
    return Straight.joined(found)


def _places(piece: Piece, parts: Parts) -> Floats:
    """(n, 3) where the middles of parts lie, one for each side."""
    row, first = np.unique(parts.row, return_index=True)
    if not len(row):
        return np.empty((0, 3))
    points = piece.places(parts.middle[first])
    return np.asarray(pointwise.positions(piece.patch, piece.rows[row], points))
