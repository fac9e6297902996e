"""The last resort for points that kernels could not decide: w(r) (x(r) - p) = 0 is polynomial, and solved with proof.

Weights are positive, so its roots equal the rational map's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.data.dataset import Expansion
from elvis.core.mapping.inverse import Status, invert
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values, gradient_nets
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape
from elvis.plugins.native.bending import bent
from elvis.plugins.nurbs.bezier import bernstein
from elvis.plugins.runtime.volume import Solution

UNDECIDED = 2


@dataclass(frozen=True, eq=False)
class Solver:
    """Solves in rational elements.

    nets   (n, n_x, n_y, n_z, 4) of w x, w y, w z, w
    value  of the field: elements (n,) and reference points (n, 3) to (n,)
    """

    nets: Floats
    value: Callable[[Ints, Floats], Floats]

    def __call__(self, elements: Ints, points: Floats) -> Solution:
        """Status, margin, reference point and field of pairs of an element (n,) and a world point (n, 3)."""
        n = len(elements)
        solution = Solution(np.zeros(n, np.int64), np.zeros(n), np.zeros((n, 3)), np.full(n, np.nan))
        near = np.flatnonzero(self._may_hold(elements, points))
        if not len(near):
            return solution

        # w (x - p) is zero where x is p
        nets = self.nets[elements[near]]
        goals = points[near, None, None, None]
        gaps = nets[..., :3] - goals * nets[..., 3:]
        patch = _interpolate(_values_at_nodes(gaps), gaps.shape[1:4])
        roots = invert(patch, np.arange(len(near)), np.zeros((len(near), 3)))

        is_inside = roots.status == Status.INSIDE
        is_outside = roots.status == Status.OUTSIDE
        solution.status[near] = np.select([is_inside, is_outside], [1, 0], UNDECIDED)
        inside = near[is_inside]
        reference = (1 + roots.reference[is_inside]) / 2
        solution.margin[inside] = roots.margin[is_inside]
        solution.reference[inside] = reference
        solution.field[inside] = self.value(elements[inside], reference)
        return solution

    def _may_hold(self, elements: Ints, points: Floats) -> Bools:
        """(n,) whether points lie between the control points, along the element's own directions."""
        turn, low, high = self._boxes
        with np.errstate(invalid="ignore"):
            along = np.einsum("nij,nj->ni", turn[elements], points)
            is_beyond = (along < low[elements]) | (along > high[elements])
        return np.asarray(~is_beyond.any(axis=1))

    @cached_property
    def _boxes(self) -> tuple[Floats, Floats, Floats]:
        """Matrices (e, 3, 3) to the elements' own directions, and bounds (e, 3) of the control points there."""
        # an element's own directions are the mean steps from one side to the other
        controls = self.nets[..., :3] / self.nets[..., 3:]
        directions = []
        for axis in (1, 2, 3):
            steps = np.take(controls, -1, axis) - np.take(controls, 0, axis)
            directions.append(steps.mean(axis=(1, 2)))
        turn = inverses(np.stack(directions, axis=2))
        along = np.einsum("nij,nkj->nki", turn, controls.reshape(len(controls), -1, 3))
        slack = 1e-9 * np.ptp(along, axis=1)
        return turn, along.min(axis=1) - slack, along.max(axis=1) + slack

    def bends(self, elements: Ints) -> Bools:
        """(n,) whether elements may bend so strongly that Newton's method misses a root."""
        nets = self.nets[elements]
        space = BernsteinSpace(Shape.HEXAHEDRON, tuple(size - 1 for size in nets.shape[1:4]))
        flat = nets.transpose(0, 4, 3, 2, 1).reshape(len(nets), 4, space.count)
        places = flat[:, :3]
        weights = flat[:, 3]
        return bent(space, places, _central_jacobians(space, flat), weights, unit=2.0)


def _central_jacobians(space: BernsteinSpace, nets: Floats) -> Floats:
    """(n, 3, 3) derivatives of x = (w x) / w at the centre, from nets (n, 4, count) of w x and w."""
    centre = np.zeros((1, 3))
    middle = nets @ bernstein_values(space, centre)[0]
    derivatives = []
    for lower, matrix in gradient_nets(space):
        derivatives.append(nets @ matrix @ bernstein_values(lower, centre)[0])
    jacobians = np.stack(derivatives, axis=2)

    # the quotient's rule: x' = ((w x)' - x w') / w
    place = middle[:, :3, None] / middle[:, 3:, None]
    weight = middle[:, 3:, None]
    return np.asarray((jacobians[:, :3] - place * jacobians[:, 3:]) / weight)


def inverses(matrices: Floats) -> Floats:
    """(n, 3, 3) inverses; the unit matrix where there is none, or hardly one."""
    is_regular = np.linalg.cond(matrices) < 1e6
    regular = np.where(is_regular[:, None, None], matrices, np.eye(3))
    return np.asarray(np.linalg.inv(regular))


def _values_at_nodes(nets: Floats) -> Floats:
    """(n, k, c) values of nets at the nodes."""
    lines = [bernstein(size - 1, (1 + gauss(size)[0]) / 2) for size in nets.shape[1:4]]
    found = np.einsum("ai,bj,ck,nijkd->nabcd", *lines, nets, optimize=True)
    return np.asarray(found.reshape(len(nets), -1, nets.shape[4]))


def _interpolate(places: Floats, sizes: tuple[int, ...]) -> Patch:
    """The maps that have these values (n, k, 3) at the nodes."""
    expansion, fit = _fit(sizes)
    coefficients = np.einsum("mk,nkc->ncm", fit, places)
    return Patch(Shape.HEXAHEDRON, np.arange(len(places)), expansion, coefficients, (), ())


@bounded_cache
def _fit(sizes: tuple[int, ...]) -> tuple[Expansion, Floats]:
    """The modes of hexahedra, and the matrix (modes, k) from values at the nodes to them."""
    expansion = modified(Shape.HEXAHEDRON, tuple(max(size, 2) for size in sizes))
    grid = np.meshgrid(*(gauss(size)[0] for size in sizes), indexing="ij")
    nodes = np.stack([axis.ravel() for axis in grid], axis=1)
    return expansion, np.asarray(np.linalg.pinv(values(expansion, nodes)))
