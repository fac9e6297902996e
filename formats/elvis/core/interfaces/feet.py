"""The point of a side that is nearest to a given point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.distances.surface_patches import SurfacePatches
from elvis.core.interfaces.side_groups import SideGroup, SideSet, is_within
from elvis.core.mapping.orientation import chunks

#: Gauss-Newton steps; convergence is quadratic where the point lies on the side
ITERATIONS = 16
#: coordinates beyond which no step goes, while the domain ends at 1
FARTHEST = 1.3
#: a step that changes nothing: distances have an error below its square if the point lies off the side, and below
#: rounding if it lies on it
STILL = 1e-13
#: part of its trace that is added to the matrix of a step, which is singular where a side is collapsed
DAMPING = 1e-14
#: pairs of a point and a side that are evaluated together
PAIRS = 1 << 13


@dataclass(frozen=True, eq=False)
class Feet:
    """For each pair of a point and a side the place of the side that is nearest.

    points    (n, 2) its coordinates on the side
    distance  (n,)
    inside    (n,) whether the place belongs to the side; else the search left its domain
    """

    points: Floats
    distance: Floats
    inside: Bools


def feet(sides: SideSet, which: Ints, world: Floats) -> Feet:
    """The places of the sides ``which`` (n,) that are nearest to the points ``world`` (n, 3)."""
    points = np.zeros((len(which), 2))
    distance = np.full(len(which), np.inf)
    inside = np.zeros(len(which), bool)
    for group, here, rows in sides.parted(which):
        for part in chunks(len(here), PAIRS):
            own = here[part]
            points[own], distance[own] = _on_group(group, rows[part], world[own])
            inside[own] = is_within(group.corners, points[own])
    return Feet(points, distance, inside)


def _on_group(group: SideGroup, rows: Ints, world: Floats) -> tuple[Floats, Floats]:
    """Coordinates (n, 2) and distances (n,) of the nearest places of sides ``rows`` (n,) of one group.

    Gauss-Newton on |x(t) - p|² from the nearest point of a lattice: t -= (JᵀJ)⁻¹ Jᵀ (x(t) - p) with J = dx/dt
    (Nocedal and Wright, Numerical Optimization, 10.3).
    """
    patches, places = group.distinct_patches(rows)
    points = _starts(patches, places, world)
    moving = np.arange(len(points))
    for _ in range(ITERATIONS):
        before = points[moving]
        points[moving] = _stepped(patches, places[moving], world[moving], before)
        moving = moving[np.abs(points[moving] - before).max(axis=1) > STILL]
        if not len(moving):
            break
    return points, np.linalg.norm(patches.at(points, places) - world, axis=1)


def _stepped(patches: SurfacePatches, rows: Ints, world: Floats, points: Floats) -> Floats:
    """(n, 2) coordinates after one step from ``points`` (n, 2)."""
    dimension = 1 if patches.corners == 2 else 2
    slopes = patches.derivatives(points, rows, 1)
    residual = slopes[:, 0, 0] - world
    tangents = np.stack([slopes[:, 0, 1], slopes[:, 1, 0]][:dimension], axis=2)
    matrix = np.einsum("nci,ncj->nij", tangents, tangents)
    trace = np.trace(matrix, axis1=1, axis2=2)
    damping = np.where(trace > 0, DAMPING * trace, 1.0)
    matrix = matrix + damping[:, None, None] * np.eye(dimension)
    right = np.einsum("nci,nc->ni", tangents, residual)
    step = np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    found = points.copy()
    found[:, :dimension] = np.clip(points[:, :dimension] - step, -FARTHEST, FARTHEST)
    return found


def _starts(patches: SurfacePatches, rows: Ints, world: Floats) -> Floats:
    """(n, 2) the points of a lattice on each of the patches ``rows`` (n,) that are nearest to the points (n, 3)."""
    grid = _grid(patches.corners)
    every = np.repeat(np.arange(len(patches)), len(grid))
    images = patches.at(np.tile(grid, (len(patches), 1)), every).reshape(len(patches), len(grid), 3)
    square = ((images[rows] - world[:, None]) ** 2).sum(axis=2)
    return grid[square.argmin(axis=1)].copy()


@bounded_cache
def _grid(corners: int) -> Floats:
    """(n, 2) points all over a domain."""
    line = np.linspace(-0.9, 0.9, 5)
    if corners == 2:
        return frozen_floats(np.stack([line, np.zeros(len(line))], axis=1))
    s, t = (part.reshape(-1) for part in np.meshgrid(line, line))
    points = np.stack([s, t], axis=1)
    return frozen_floats(points if corners == 4 else points[s + t <= 0])
