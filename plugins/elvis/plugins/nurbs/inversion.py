"""The last resort for points that kernels could not decide: w(r) (x(r) - p) = 0 is polynomial, and solved with proof.

Weights are positive, so that the roots are those of the rational map.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.mapping.inverse import Status, invert
from elvis.core.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values, gradient_nets
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape
from elvis.plugins.native.bending import bent
from elvis.plugins.nurbs.bezier import bernstein
from elvis.plugins.volume import Solution

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
        nets = self.nets[elements[near]]
        gaps = nets[..., :3] - points[near, None, None, None] * nets[..., 3:]
        roots = invert(_through(_values(gaps), gaps.shape[1:4]), np.arange(len(near)), np.zeros((len(near), 3)))
        inside = roots.status == Status.INSIDE
        there, reference = near[inside], (1 + roots.reference[inside]) / 2
        solution.status[near] = np.select([inside, roots.status == Status.OUTSIDE], [1, 0], UNDECIDED)
        solution.margin[there], solution.reference[there] = roots.margin[inside], reference
        solution.field[there] = self.value(elements[there], reference)
        return solution

    def _may_hold(self, elements: Ints, points: Floats) -> Bools:
        """(n,) whether points lie between the control points, along the element's own directions."""
        turn, low, high = self._boxes
        with np.errstate(invalid="ignore"):
            along = np.einsum("nij,nj->ni", turn[elements], points)
            return np.asarray(~((along < low[elements]) | (along > high[elements])).any(axis=1))

    @cached_property
    def _boxes(self) -> tuple[Floats, Floats, Floats]:
        """Matrices (e, 3, 3) to the elements' own directions, and bounds (e, 3) of the control points there."""
        controls = self.nets[..., :3] / self.nets[..., 3:]
        sides = [np.take(controls, -1, axis) - np.take(controls, 0, axis) for axis in (1, 2, 3)]
        turn = inverses(np.stack([side.mean(axis=(1, 2)) for side in sides], axis=2))
        along = np.einsum("nij,nkj->nki", turn, controls.reshape(len(controls), -1, 3))
        slack = 1e-9 * np.ptp(along, axis=1)
        return turn, along.min(axis=1) - slack, along.max(axis=1) + slack

    def bends(self, elements: Ints) -> Bools:
        """(n,) whether elements may bend so strongly that Newton's method misses a root."""
        nets = self.nets[elements]
        space = BernsteinSpace(Shape.HEXAHEDRON, tuple(size - 1 for size in nets.shape[1:4]))
        flat = nets.transpose(0, 4, 3, 2, 1).reshape(len(nets), 4, space.count)
        return bent(space, flat[:, :3], _central_jacobians(space, flat), flat[:, 3], unit=2.0)


def _central_jacobians(space: BernsteinSpace, nets: Floats) -> Floats:
    """(n, 3, 3) derivatives of x = (w x) / w at the centre, from nets (n, 4, count) of w x and w."""
    centre = np.zeros((1, 3))
    middle = nets @ bernstein_values(space, centre)[0]
    lower = gradient_nets(space)
    jacobians = np.stack([nets @ matrix @ bernstein_values(some, centre)[0] for some, matrix in lower], axis=2)
    place, weight = middle[:, :3] / middle[:, 3:], middle[:, 3, None, None]
    return np.asarray((jacobians[:, :3] - place[:, :, None] * jacobians[:, 3:]) / weight)


def inverses(matrices: Floats) -> Floats:
    """(n, 3, 3) inverses; the unit matrix where there is none, or hardly one."""
    good = np.linalg.cond(matrices) < 1e6
    return np.asarray(np.linalg.inv(np.where(good[:, None, None], matrices, np.eye(3))))


def _values(nets: Floats) -> Floats:
    """(n, k, c) values of nets at the nodes."""
    lines = [bernstein(size - 1, (1 + gauss(size)[0]) / 2) for size in nets.shape[1:4]]
    found = np.einsum("ai,bj,ck,nijkd->nabcd", *lines, nets, optimize=True)
    return np.asarray(found.reshape(len(nets), -1, nets.shape[4]))


def _through(places: Floats, sizes: tuple[int, ...]) -> Patch:
    """The maps that have these values (n, k, 3) at the nodes."""
    modes = tuple(max(size, 2) for size in sizes)
    coefficients = np.einsum("mk,nkc->ncm", _fit(sizes), places)
    return Patch(Shape.HEXAHEDRON, np.arange(len(places)), modified(Shape.HEXAHEDRON, modes), coefficients, (), ())


@lru_cache(maxsize=64)
def _fit(sizes: tuple[int, ...]) -> Floats:
    """(modes, k) matrix from values at the nodes to the modes of hexahedra."""
    x, y, z = np.meshgrid(*(gauss(size)[0] for size in sizes), indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    modes = tuple(max(size, 2) for size in sizes)
    return np.asarray(np.linalg.pinv(values(modified(Shape.HEXAHEDRON, modes), points)))
