"""Boundaries as triangles: sides of elements, cut into parts that are flat to a tolerance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.reference_cells import Piece
from elvis.core.integrals.subcells import corners, subcell_map
from elvis.core.integrals.targets import Places
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import all_halves, box_degrees, nets_through
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.expression_nets import lattice_of, places_of
from elvis.core.streamlines.walls import outward
from elvis.core.triangles.distance_bounds import grown, middle_gradient, second_derivatives
from elvis.core.triangles.level_cells import first_halvings
from elvis.core.triangles.surface_triangles import SurfaceTriangles, default_tolerance
from elvis.core.wall_curves.chains import places_by_number

#: halvings of a side at most, and triangles
_MOST_HALVINGS, _MOST_TRIANGLES = 10, 1 << 24
#: by how much of a side points of quantities are moved inwards, off edges, where several sides are as near, and tips
_INWARDS = 1e-12


def boundary_triangles(
    dataset: Dataset, boundary: str, quantities: Sequence[str] = (), tolerance: float | None = None
) -> SurfaceTriangles:
    """The triangles of a boundary of 3D data, or of all outer faces (``all``), counter-clockwise from outside.

    quantities  whose values are requested at the corners, from the elements behind the boundary
    tolerance   distance from the exact boundary, in units of the data; by default 1/1000 of the size of the data

    Raises ElvisError for unknown boundaries, for data of other dimensions, and for tolerances that need too many
    triangles.

    >>> ds = elvis.read("wing.xml", "wing.fld")
    >>> wall = elvis.boundary_triangles(ds, "wing", ["p"], tolerance=0.05)
    >>> len(wall.triangles)
    160
    """
    if dataset.mesh.dimension != 3:
        raise ElvisError(f"{boundary}: expected 3D data, found {dataset.mesh.dimension}D data")
    wanted = default_tolerance(dataset, tolerance)
    evaluator = Evaluator(dataset, [Expression.of(dataset, text) for text in quantities])
    pieces = [piece for _, piece in boundary_pieces(dataset, evaluator.patches, boundary)]
    shapes = {piece.shape for piece in pieces}
    firsts = [first_halvings(piece.shape, len(shapes) > 1)[0] for piece in pieces]
    needed = [_halvings_needed(piece, first, wanted) for piece, first in zip(pieces, firsts, strict=True)]
    depth = max(own - first for (own, _), first in zip(needed, firsts, strict=True))
    count = sum(len(p) * len(corners(p.shape)) * 2 << 2 * (depth + f) for p, f in zip(pieces, firsts, strict=True))
    if count > _MOST_TRIANGLES:
        raise ElvisError(f"expected a tolerance that some millions of triangles reach, found {wanted:g}")
    tiles = [tile for p, f in zip(pieces, firsts, strict=True) for tile in _tiles(evaluator, p, depth + f)]
    return _joined(tiles, quantities, max(distance for _, distance in needed))


def boundary_pieces(dataset: Dataset, patches: tuple[Patch, ...], boundary: str) -> list[tuple[str, Piece]]:
    """The sides of elements on a boundary, with its name; raises ElvisError for other names, and if there are none."""
    rows = Places(dataset, patches, {}).named(boundary).rows
    found = [(row.name, piece) for row in rows for piece in row.pieces if isinstance(piece, Piece)]
    if not all(piece.is_side for _, piece in found):
        raise ElvisError(f"{boundary}: expected a boundary, found elements")
    if not found:
        raise ElvisError(f"{boundary}: expected a boundary, found none, as the data are closed or periodic")
    return found


def _halvings_needed(piece: Piece, first: int, tolerance: float) -> tuple[int, float]:
    """How many halvings of the cells of sides make their parts flat, and how flat they are then."""
    degree = max(1, *box_degrees(bernstein_space(piece.patch.geometry)))
    places = places_of(degree)
    lattice = lattice_of(places, 2)
    nets = []
    for cell in range(len(corners(piece.shape))):
        xi = piece.places(subcell_map(piece.shape, np.full(len(lattice), cell), lattice)[0])
        rows = np.repeat(piece.rows, len(lattice))
        world = ElementPoints(piece.patch, rows, np.tile(xi, (len(piece), 1))).positions
        values = world.reshape(len(piece), len(lattice), 3).transpose(2, 0, 1).reshape(-1, len(lattice))
        nets.append(nets_through(values, places, 2).reshape(3, len(piece), len(places), len(places)))
    parts = np.concatenate(nets, axis=1)
    for depth in range(_MOST_HALVINGS + 1):
        distance = _distances(parts)
        if depth >= first and distance.max() <= tolerance:
            return depth, float(distance.max())
        is_far = (distance > tolerance) | (depth < first)
        chosen = parts[:, is_far]
        parts = all_halves(chosen.reshape(-1, *chosen.shape[2:])).reshape(4, 3, -1, *chosen.shape[2:])
        parts = parts.transpose(1, 0, 2, 3, 4).reshape(3, -1, *chosen.shape[2:])
    raise ElvisError(f"expected a tolerance that some millions of triangles reach, found {tolerance:g}")


def _distances(parts: Floats) -> Floats:
    """(n,) how far flat triangles are from sides whose parts have nets (3, n, D, D), at most.

    Linear functions on a triangle of extents 1 differ from the map by at most 1/8 of its second derivatives.  Across
    the side that is a distance; along it, it moves the foot, where the side is less steep than second derivatives say.
    """
    tangents = np.stack([middle_gradient(own) for own in parts], axis=2)
    with np.errstate(all="ignore"):
        normal = np.cross(tangents[:, 0], tangents[:, 1])
        unit = normal / np.linalg.norm(normal, axis=1, keepdims=True)
        # rows that take the tangents to the unit matrix, and the normal to nothing
        duals = np.cross(np.stack([tangents[:, 1], -tangents[:, 0]], axis=1), unit[:, None])
        duals /= np.linalg.norm(normal, axis=1)[:, None, None]
    across = np.abs(second_derivatives(np.einsum("nc,cnij->nij", np.nan_to_num(unit), parts)))
    along = np.einsum("nkc,cnij->knij", np.nan_to_num(duals, posinf=0, neginf=0), parts)
    bends = np.stack([second_derivatives(own) for own in along], axis=1)
    turn = bends.sum(axis=(2, 3)).max(axis=1) / 2
    with np.errstate(all="ignore"):
        more = np.where(turn < 1, turn / (1 - turn), np.inf)
        shift = grown(bends.sum(axis=(2, 3)) / 8, more)
        height = across.sum(axis=(1, 2)) / 8 + (across.sum(axis=2) / 2 * shift).sum(axis=1)
    # nothing is farther than a chord is from its arc
    chord = np.linalg.norm([second_derivatives(own).sum(axis=(1, 2)) / 8 for own in parts], axis=0)
    return np.fmin(height, chord)


@dataclass(frozen=True, eq=False)
class _Tile:
    """A cell of each of some sides: points (n, 3), normals (n, 3), values (k, n), triangles (m, 3)."""

    points: Floats
    normals: Floats
    values: Floats
    triangles: Ints


def _tiles(evaluator: Evaluator, piece: Piece, depth: int) -> Iterator[_Tile]:
    """The cells of sides as lattices of points, and triangles between these."""
    count = (1 << depth) + 1
    lattice = lattice_of(np.linspace(0.0, 1.0, count), 2)
    offsets = len(lattice) * np.arange(len(piece))
    triangles = (_halves_of_squares(count) + offsets[:, None, None]).reshape(-1, 3)
    for cell in range(len(corners(piece.shape))):
        own = subcell_map(piece.shape, np.full(len(lattice), cell), lattice)[0]
        points = _points(piece, own).positions
        inner = _points(piece, own + _INWARDS * (piece.shape.centre - own))
        normals = outward(piece, inner.jacobians)
        places = ElementPoints(piece.patch, inner.rows, inner.points, normals)
        found = [np.broadcast_to(own, len(places)) for own in evaluator.values_at(evaluator.expressions, places)]
        values = np.array(found).reshape(-1, len(places))
        yield _Tile(points, normals, values, _outwards(points, normals, triangles))


def _points(piece: Piece, xi: Floats) -> ElementPoints:
    """Points (k, 2) repeated on each of some sides."""
    return ElementPoints(piece.patch, np.repeat(piece.rows, len(xi)), np.tile(piece.places(xi), (len(piece), 1)))


def _halves_of_squares(count: int) -> Ints:
    """(m, 3) the triangles of a lattice of ``count`` x ``count`` points, the last direction fastest."""
    corner = np.arange(count * count).reshape(count, count)
    a, b, c, d = corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]
    return np.concatenate([np.stack(own, axis=-1).reshape(-1, 3) for own in ((a, b, c), (a, c, d))])


def _outwards(points: Floats, normals: Floats, triangles: Ints) -> Ints:
    """Triangles, reversed if they are clockwise as seen from outside."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    way = normals[triangles].sum(axis=1)
    is_wrong = np.einsum("ni,ni->n", np.cross(b - a, c - a), way) < 0
    turned = triangles.copy()
    turned[is_wrong] = triangles[is_wrong][:, ::-1]
    return turned


def _joined(tiles: Sequence[_Tile], quantities: Sequence[str], distance: float) -> SurfaceTriangles:
    """All tiles with one point at each place, whose normal is the mean of those there."""
    offsets = np.cumsum([0, *(len(tile.points) for tile in tiles[:-1])])
    points = np.concatenate([tile.points for tile in tiles])
    triangles = np.concatenate([tile.triangles + offset for tile, offset in zip(tiles, offsets, strict=True)])
    _, first, which = np.unique(places_by_number(points), return_index=True, return_inverse=True)
    normals = np.zeros((len(first), 3))
    np.add.at(normals, which, np.concatenate([tile.normals for tile in tiles]))
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    triangles = which[triangles]
    distinct = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    values = np.concatenate([tile.values for tile in tiles], axis=1)[:, first]
    named = dict(zip(quantities, values, strict=True))
    return SurfaceTriangles(points[first], triangles[distinct], normals, named, distance)
