"""Rays against surfaces within elements: the exact map and the exact function, by Newton's method.

Unknown are the reference point r and the depth t: Phi(r) = o + t d and h(r) = 0, four equations for four unknowns.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import EPS, Bools, Floats, Ints
from elvis.core.mapping.patch import Patch
from elvis.reference.solids import map_points

#: a function of elements ``rows`` (n,) and reference points (n, 3): values (n,) and derivatives (n, 3)
Constraint = Callable[[Ints, Floats], tuple[Floats, Floats]]

#: longest step in reference coordinates, and number of consecutive steps of this length after which a search
#: oscillates: in one direction it would have left the neighbourhood of its start
_LONGEST, _ASTRAY = 0.5, 8
#: a step so short is the last one that changes anything: the next would be its square
_SHORT = 1e-9
#: residual of position, relative to the scene's size, at which a root is accepted; steps continue to the last digit
_SMALL = 1e-12
#: residual that rounding may leave, relative to the largest coordinate
_ROUNDING = 16 * EPS


@dataclass(frozen=True, eq=False)
class Roots:
    """Results of n searches.

    reference  (n, 3)
    depth      (n,)
    normal     (n, 3)  gradient of the constraint in world coordinates
    found      (n,)    whether the equations hold
    """

    reference: Floats
    depth: Floats
    normal: Floats
    found: Bools


def solve(
    patch: Patch,
    rows: Ints,
    start: Floats,
    origins: Floats,
    directions: Floats,
    constraint: Constraint,
    size: float,
    radius: float = 2.0,
    steps: int = 24,
) -> Roots:
    """Roots next to starting points (n, 3) for rays (n, 3) in elements ``rows`` (n,).

    size   of the scene in world units
    radius  maximum distance from the start along each reference coordinate; other starts are nearer to roots beyond
    steps  maximum number of Newton steps
    """
    reference, scale = start.copy(), None
    depth = np.zeros(len(rows))
    normal, error = np.full((len(rows), 3), np.nan), np.full(len(rows), np.inf)
    active, cuts = np.arange(len(rows)), np.zeros(len(rows), np.int64)
    for number in range(steps):
        own, ray = rows[active], directions[active]
        world, jacobians = map_points(patch, own, reference[active])
        held, gradient = constraint(own, reference[active])
        if number == 0:
            depth = np.einsum("ni,ni->n", world - origins, directions) / np.einsum("ni,ni->n", directions, directions)
            scale = np.maximum(np.abs(held), np.linalg.norm(gradient, axis=1))
        assert scale is not None
        away = world - origins[active] - depth[active, None] * ray
        step, deeper, normal[active] = _step(jacobians, gradient, ray, away, held)
        largest = np.maximum(np.abs(world), np.abs(origins[active])).max(axis=1)
        off = np.linalg.norm(away, axis=1) / (size + _ROUNDING / _SMALL * largest)
        error[active] = np.maximum(off, np.abs(held) / (scale[active] + 1e-300))

        # long steps are cut, searches that leave the element for good or go to and fro end
        length = np.linalg.norm(step, axis=1)
        cuts[active] = np.where(length > _LONGEST, cuts[active] + 1, 0)
        part = np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300))
        reference[active] += part[:, None] * step
        depth[active] += part * deeper
        alive = np.isfinite(length) & (np.abs(reference[active] - start[active]).max(axis=1) < radius)
        converged = (error[active] < _SMALL) & (length < _SHORT)
        active = active[alive & ~converged & (cuts[active] < _ASTRAY)]
        if not len(active):
            break
    inside = np.isfinite(reference).all(axis=1) & np.isfinite(depth)
    return Roots(reference, depth, normal, inside & (error < _SMALL))


def _step(
    jacobians: Floats, gradient: Floats, ray: Floats, away: Floats, held: Floats
) -> tuple[Floats, Floats, Floats]:
    """Steps of r (n, 3) and t (n,), and the constraint's gradient in the world (n, 3).

    With J = dPhi/dr and g = J^-T h': J dr = d dt - away, so that (g . d) dt = g . away - h.
    """
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        inverse = inverses(jacobians)
        world = np.einsum("nij,ni->nj", inverse, gradient)
        deeper = (np.einsum("ni,ni->n", world, away) - held) / np.einsum("ni,ni->n", world, ray)
        step = np.einsum("nij,nj->ni", inverse, deeper[:, None] * ray - away)
    return step, deeper, world


def inverses(matrices: Floats) -> Floats:
    """(n, 3, 3) inverses by cofactors; not finite where there are none."""
    a, b, c = (matrices[:, :, i] for i in range(3))
    rows = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    return np.asarray(rows / np.einsum("ni,ni->n", a, rows[:, 0])[:, None, None])
