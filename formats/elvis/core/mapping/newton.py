"""Newton's method for the inverse of the mapping, damped, for many points at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.mapping.margins import TOLERANCE, drawn_in, facets, heights
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.tangents import duals
from elvis.core.polynomials.evaluation import evaluate_at_with_gradients
from elvis.core.shapes import Shape

#: maximum distance of iterates from the element, as a margin
_SLACK = 0.25
#: searches that converge need fewer steps
ITERATIONS = 50


@dataclass(frozen=True, eq=False)
class Targets(Rows):
    """World points to be found, each in one element of a patch.

    rows       (n,)    rows of the patch
    points     (n, 3)  world coordinates
    precision  (n,)    length of a last Newton step, measured in the world
    distance   (n,) largest distance of a point from its image: more than the precision off curves and surfaces only
    rounding   (n,)    how far each world coordinate of a point or of its image may be off
    """

    patch: Patch
    rows: Ints
    points: Floats
    precision: Floats
    distance: Floats
    rounding: Floats


@dataclass(frozen=True, eq=False)
class Feet:
    """The nearest reference points that were found.

    reference  (n, d)
    margin     (n,) smallest height over the facets there
    converged  (n,)    whether the method converged there
    inside     (n,)    whether that is a root inside
    """

    reference: Floats
    margin: Floats
    converged: Bools
    inside: Bools


def newton(targets: Targets, starts: Floats, iterations: int = ITERATIONS) -> Feet:
    """The nearest reference points found from first guesses (n, d), in at most ``iterations`` steps.

    Steps are quartered if they don't bring the image nearer; iterates stay near the element; points without progress
    are given up.  On a curve or surface, it converges to the foot of the point (Gauss-Newton), which is a root if it is
    near.  A root is inside if it lies beyond the facets by at most the tolerance of margins, plus the possible effect
    of rounding of world coordinates.  A point between two elements that share a face is thus never outside both.
    """
    state = _State(targets, starts)
    for _ in range(iterations):
        if not len(state.active):
            break
        state.advance()
    converged = state.change <= targets.precision
    root = (converged & (state.distance <= targets.distance)) | (state.distance <= targets.precision)
    above = heights(targets.patch.shape, state.best)
    margin = above.min(axis=1)
    inside = root & (margin >= -TOLERANCE)
    beyond = np.flatnonzero(root & ~inside)
    room = heights_rounding(targets.patch.shape, state.duals[beyond], targets.rounding[beyond])
    inside[beyond] = (above[beyond] >= -TOLERANCE - room).all(axis=1)
    return Feet(state.best, margin, converged, inside)


def heights_rounding(shape: Shape, duals: Floats, rounding: Floats) -> Floats:
    """(n, k) how far heights over facets may be off where each world coordinate may be by ``rounding`` (n,).

    duals  (n, 3, d)  derivatives of reference coordinates with respect to world coordinates
    """
    normals, _ = facets(shape)
    gradients = np.einsum("ki,nci->nkc", normals, duals)
    return np.asarray(np.abs(gradients).sum(axis=2) * rounding[:, None])


class _State:
    """Iterates of all targets; ``active`` are those still under way.

    best      (n, d)  nearest point so far, with its distance (n,), the Newton step (n, d) from it and that step's
                      length in the world, change (n,)
    duals     (n, 3, d)  inverse of the map's Jacobian at the best point
    damping   (n,)    part of the step to be tried
    idle      (n,)    steps in succession that hardly helped
    """

    def __init__(self, targets: Targets, starts: Floats) -> None:
        count = len(targets)
        self.targets, self.active = targets, np.arange(count)
        self.best = self._near(starts)
        self.distance, self.change = np.full((2, count), np.inf)
        self.step, self.damping, self.idle = np.zeros_like(starts), np.ones(count), np.zeros(count, np.int64)
        self.duals = np.full((count, 3, starts.shape[1]), np.nan)

    def _near(self, points: Floats) -> Floats:
        return drawn_in(self.targets.patch.shape, points, _SLACK)

    def advance(self) -> None:
        """One evaluation for every active target: accept the trial or shorten the step."""
        active = self.active
        trial = self._near(self.best[active] + self.damping[active, None] * self.step[active])
        patch, targets = self.targets.patch, self.targets.part(active)
        world, jacobians = evaluate_at_with_gradients(patch.geometry, patch.geometry_coefficients, targets.rows, trial)
        gap = targets.points - world
        distance = np.linalg.norm(gap, axis=1)
        nearer = distance < self.distance[active]
        self._accept(active[nearer], trial[nearer], gap[nearer], distance[nearer], jacobians[nearer])
        self.damping[active[~nearer]] /= 4
        near = (self.change[active] <= targets.precision) | (self.distance[active] <= targets.precision / 4)
        self.active = active[~near & (self.damping[active] > 1e-4) & (self.idle[active] < 4)]

    def _accept(self, rows: Ints, trial: Floats, gap: Floats, distance: Floats, jacobians: Floats) -> None:
        hardly = distance > 0.8 * self.distance[rows]
        self.idle[rows] = np.where(hardly, self.idle[rows] + 1, 0)
        self.best[rows], self.distance[rows], self.damping[rows] = trial, distance, 1.0
        with np.errstate(invalid="ignore", over="ignore"):
            self.duals[rows] = duals(jacobians)
            step = np.einsum("nci,nc->ni", self.duals[rows], gap)
            self.change[rows] = np.linalg.norm(np.einsum("nci,ni->nc", jacobians, step), axis=1)
            longest = np.abs(step).max(axis=1, keepdims=True, initial=1.0)
            self.step[rows] = step / longest
