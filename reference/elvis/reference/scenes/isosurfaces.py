"""Rays against isosurfaces, and against implicit surfaces in general.

Elements are cut finely into tetrahedra, each made larger by how far the exact one may reach beyond it.  A ray is a
candidate where the values at both ends of its way through one, widened by how far the function bends within it, hold
the value that is looked for.  The exact function at three places of the way says where to start; Newton's method on the
exact map and function decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from elvis.formats.arrays import Floats, Ints
from elvis.formats.mapping.margins import TOLERANCE
from elvis.formats.patch import Patch
from elvis.reference.baseline.templates import pulling
from elvis.reference.quantities import Quantities
from elvis.reference.scenes.crossings import Crossings
from elvis.reference.scenes.newton import Constraint, Roots, solve
from elvis.reference.scenes.rasters import barycentric_gradients, boxed
from elvis.reference.solids import cells_of, margins_of, spread
from elvis.renderer.frame import Status
from elvis.renderer.view import View

#: cuts of each element; of those of degrees above
_LEVEL, _FINER, _HIGH = 3, 4, 7
#: how much wider values and tetrahedra are taken than what was measured at the middles of edges; least widening
_SAFETY, _WIDER = 2.0, 0.02
#: steps of Newton's method; starts are near
_STEPS = 12
#: extreme values of this part of the greatest one may be zero after all
_NEARLY = 0.3
#: elements that are cut together
_AT_ONCE = 128
_EDGES = np.array([(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])


@dataclass(frozen=True, eq=False)
class Cells:
    """Small tetrahedra that may hold the surface.

    rows       (m,)       of their elements
    corners    (m, 4, 3)  world coordinates
    reference  (m, 4, 3)  reference coordinates
    values     (m, 4)     of the function whose zeros are the surface
    bend       (m,)       how far the function may be from its linear interpolant
    slack      (m,)       barycentric coordinates of the exact tetrahedra are at least minus this
    """

    rows: Ints
    corners: Floats
    reference: Floats
    values: Floats
    bend: Floats
    slack: Floats


def iso_crossings(
    number: int, patch: Patch, quantities: Quantities, name: str, value: float, view: View, size: float
) -> Crossings:
    """All hits of rays with the surface in a patch on which a quantity has a value."""
    constraint, found = level_of(quantities, name, patch, value), [Crossings.none()]
    level = _FINER if max(max(own.modes) for own in patch.fields if own) > _HIGH else _LEVEL
    for rows in np.array_split(np.arange(len(patch)), -(-len(patch) // _AT_ONCE)):
        cells = _cells(patch, rows, quantities, name, value, level)
        function = partial(_function, quantities, name, value, patch, cells)
        for cell, pixel in boxed(view, _widened(cells)):
            search = partial(solve, constraint=constraint, size=size, reach=6.0 / (1 << level), steps=_STEPS)
            found.append(_decided(number, patch, cells, cell, pixel, function, search, view, size))
    return Crossings.joined(found).distinct(size)


def level_of(quantities: Quantities, name: str, patch: Patch, value: float) -> Constraint:
    """The function whose zeros are the surface."""

    def constraint(rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        values, slopes = quantities.values_and_slopes(name, patch, rows, points)
        return values - value, slopes

    return constraint


def _cells(patch: Patch, rows: Ints, quantities: Quantities, name: str, value: float, level: int) -> Cells:
    """The small tetrahedra of some elements that may hold the surface."""
    cut = cells_of(patch, level, layers=2)
    order = np.arange(8.0)
    tables = [pulling(kind, own, np.tile(order[: own.shape[1]], (len(own), 1))) for kind, own in cut.cells.items()]
    corners = np.concatenate(tables)
    middles = cut.points[corners][:, _EDGES].mean(axis=2)

    # values at the corners; at the middles of edges against the mean of their ends
    function = quantities.corners()[name]
    at_corners = function(patch, rows, cut.points)[:, corners] - value
    at_middles = function(patch, rows, middles.reshape(-1, 3)).reshape(len(rows), -1, 6) - value
    bend = _SAFETY * np.abs(at_middles - at_corners[:, :, _EDGES].mean(axis=3)).max(axis=2)
    holds = (at_corners.min(axis=2) - bend <= 0) & (at_corners.max(axis=2) + bend >= 0)
    element, cell = np.nonzero(holds)

    # the same for places
    world = spread(patch, rows, cut.points)[element[:, None], corners[cell]]
    bent = spread(patch, rows, middles.reshape(-1, 3)).reshape(len(rows), -1, 6, 3)[element, cell]
    away = np.linalg.norm(bent - world[:, _EDGES].mean(axis=2), axis=2).max(axis=1, initial=0.0)
    slack = _WIDER + _SAFETY * away / np.maximum(_height(world), 1e-300)
    reference = cut.points[corners][cell]
    return Cells(
        rows[element], world, reference, at_corners[element, cell], bend[element, cell], np.minimum(slack, 2.0)
    )


def _height(corners: Floats) -> Floats:
    """(m,) least height of tetrahedra (m, 4, 3)."""
    gradients = barycentric_gradients(corners)
    return np.asarray(1.0 / np.linalg.norm(gradients, axis=2).max(axis=1, initial=1e-300))


def _widened(cells: Cells) -> Floats:
    """(m, 4, 3) corners of tetrahedra that are larger by the slack of each."""
    middle = cells.corners.mean(axis=1, keepdims=True)
    return np.asarray(middle + (1 + 4 * cells.slack[:, None, None]) * (cells.corners - middle))


def _decided(
    number: int,
    patch: Patch,
    cells: Cells,
    cell: Ints,
    pixel: Ints,
    function: Callable[[Ints, Floats], Floats],
    search: Callable[..., Roots],
    view: View,
    size: float,
) -> Crossings:
    """The hits among pairs of a tetrahedron and a pixel."""
    row, column = np.divmod(pixel, view.width)
    origins, directions = view.rays(column.astype(np.float64), row.astype(np.float64))
    found = [Crossings.none()]
    for which, weights in _starts(cells, cell, origins, directions, function):
        own, start = cells.rows[cell[which]], np.einsum("nk,nki->ni", weights, cells.reference[cell[which]])
        roots = search(patch, own, start, origins[which], directions[which])
        margin = margins_of(patch, roots.reference)
        here = np.flatnonzero(roots.found & (margin >= -TOLERANCE) & (roots.depth > 0))
        status = np.where(margin[here] <= TOLERANCE, Status.AMBIGUOUS, Status.CERTAIN).astype(np.uint8)
        place, normal, patches = roots.reference[here], roots.normal[here], np.full(len(here), number)
        found.append(Crossings(pixel[which][here], roots.depth[here], patches, own[here], place, normal, status))
    return Crossings.joined(found).distinct(size)


def _function(
    quantities: Quantities, name: str, value: float, patch: Patch, cells: Cells, cell: Ints, weights: Floats
) -> Floats:
    """(n,) exact values at barycentric coordinates (n, 4) of tetrahedra (n,)."""
    points = np.einsum("nk,nki->ni", weights, cells.reference[cell])
    return quantities.values(name, patch, cells.rows[cell], points) - value


def _starts(
    cells: Cells, cell: Ints, origins: Floats, directions: Floats, function: Callable[[Ints, Floats], Floats]
) -> Iterator[tuple[Ints, Floats]]:
    """Pairs (k,) whose ray may meet the surface, and barycentric coordinates (k, 4) of where to start."""
    gradients = barycentric_gradients(cells.corners)[cell]
    base = 1.0 * (np.arange(4) == 0) + np.einsum("nki,ni->nk", gradients, origins - cells.corners[cell, 0])
    slope = np.einsum("nki,ni->nk", gradients, directions)

    # barycentric coordinates along the ray are base + depth slope, each at least -slack
    with np.errstate(invalid="ignore", divide="ignore"):
        bound = (-cells.slack[cell, None] - base) / slope
    near = np.where(slope > 0, bound, -np.inf).max(axis=1)
    far = np.where(slope < 0, bound, np.inf).min(axis=1)
    first, last = (np.einsum("nk,nk->n", base + end[:, None] * slope, cells.values[cell]) for end in (near, far))
    bend = cells.bend[cell]
    with np.errstate(invalid="ignore"):
        possible = (near <= far) & (np.minimum(first, last) - bend <= 0) & (np.maximum(first, last) + bend >= 0)
    pairs = np.flatnonzero(possible)
    base, slope, near, far = base[pairs], slope[pairs], near[pairs], far[pairs]
    for part, which in _zeros(lambda part: function(cell[pairs], base + (near + part * (far - near))[:, None] * slope)):
        yield pairs[which], base[which] + (near + part * (far - near))[which, None] * slope[which]


def _zeros(along: Callable[[float], Floats]) -> list[tuple[Floats, Ints]]:
    """Where parabolas through a function's values at 0, 1/2 and 1 are zero, or nearly so: places (n,), numbers (k,)."""
    first, middle, last = (along(part) for part in (0.0, 0.5, 1.0))
    bent, steep = 2 * (first - 2 * middle + last), -3 * first + 4 * middle - last
    with np.errstate(invalid="ignore", divide="ignore"):
        turn = -steep / (2 * bent)
        least = first + 0.5 * turn * steep
        early, late = 0.5 * first / (first - middle), 0.5 + 0.5 * middle / (middle - last)
        root = np.sqrt(np.maximum(-least / np.where(bent == 0, np.inf, bent), 0.0)) + 1e-3
    scale = np.maximum(np.maximum(np.abs(first), np.abs(middle)), np.abs(last))
    tangent = (turn > -0.5) & (turn < 1.5) & (np.abs(least) <= _NEARLY * scale)
    return [
        (early, np.flatnonzero((first < 0) != (middle < 0))),
        (late, np.flatnonzero((middle < 0) != (last < 0))),
        (turn - root, np.flatnonzero(tangent)),
        (turn + root, np.flatnonzero(tangent)),
    ]
