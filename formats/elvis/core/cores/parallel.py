"""Parallel vectors on the core of a vortex, as polynomials of the solution.

On a core the velocity v is parallel to w, and its gradient G has a pair of complex eigenvalues, so that the flow turns
about the line (Peikert and Roth, The parallel vectors operator, IEEE Visualization 1999).  The vector w is

acceleration  the convective derivative G v: v is then the real eigenvector of G, which is the criterion of Sujudi and
              Haimes, Identification of swirling flow in 3-D vector fields, AIAA 95-1715.  With lambda the real
              eigenvalue, this is (G - lambda) v = 0, which is also regular if v itself is zero on the core
vorticity     rot v: v x rot v = 0

A velocity m / d, such as momentum by density, has the gradient H / d^2 with H = d grad m - m grad d, a polynomial.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.critical.points import degree_of
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.levels import fraction
from elvis.core.quantities.tree import AXES, ONE, Node, call, world_derivative
from elvis.core.shapes import Shape
from elvis.core.streamlines.velocity import velocity_expressions

#: vectors to which the velocity may be parallel
CRITERIA = ("acceleration", "vorticity")


@dataclass(frozen=True, eq=False)
class Motions:
    """A velocity m / d and its gradient H / d^2 at n points.

    above     (n, 3)     m
    gradient  (n, 3, 3)  H: row i is the gradient of component i
    below     (n,)       d
    """

    above: Floats
    gradient: Floats
    below: Floats

    @property
    def velocity(self) -> Floats:
        """(n, 3)."""
        return np.asarray(self.above / self.below[:, None])

    @property
    def swirl(self) -> Floats:
        """(n,) imaginary part of the complex eigenvalues of the velocity's gradient; 0 if all are real."""
        values = np.linalg.eigvals(self.gradient)
        return np.asarray(np.abs(values.imag).max(axis=1, initial=0.0) / self.below**2)

    @property
    def q(self) -> Floats:
        """(n,) -tr(G^2) / 2."""
        return np.asarray(-0.5 * np.einsum("nij,nji->n", self.gradient, self.gradient) / self.below**4)


class ParallelVectors:
    """The velocity of a dataset and the vector it is parallel to on cores.

    criterion  of `CRITERIA`
    evaluator  of all required quantities, and of additional ones
    """

    def __init__(
        self, dataset: Dataset, velocity: Sequence[str] | None, criterion: str, others: Sequence[Expression] = ()
    ) -> None:
        if criterion not in CRITERIA:
            raise ElvisError(f"expected a criterion, one of {', '.join(CRITERIA)}, found {criterion!r}")
        if dataset.mesh.dimension != 3:
            raise ElvisError(f"expected 3D data, found {dataset.mesh.dimension}D data, which have no vortex cores")
        self.criterion = criterion
        self._above, self._below = _over_one_denominator(velocity_expressions(dataset, velocity))
        parts = [*self._above, self._below]
        slopes = [Expression(f"{e.text}_{x}", world_derivative(e.root, k)) for e in parts for k, x in enumerate(AXES)]
        self._every = [*parts, *slopes]
        self.evaluator = Evaluator(dataset, [*self._every, *others])
        if any(patch.periods for patch in self.evaluator.patches):
            raise ElvisError("expected 3D data without Fourier directions")

    def degrees(self, patch: Patch, is_affine: bool) -> tuple[int, int]:
        """Degrees of m and H in each direction of boxes, times the determinant of the map if that is not affine."""
        own = max(degree_of(each, self.evaluator, patch) for each in self._above)
        lower = 0 if self._below.root is ONE else degree_of(self._below, self.evaluator, patch)
        map_degree = max(box_degrees(bernstein_space(patch.geometry)))
        if patch.shape is Shape.TETRAHEDRON:
            return own, max(own + lower - 1 + (0 if is_affine else 2 * map_degree - 2), 1)
        # on pyramids derivatives are polynomials of the box's coordinates, as functions have one value at the apex
        return own, own + lower + (0 if is_affine else 2 * map_degree)

    def at(self, places: ElementPoints) -> Motions:
        """The motion at points in elements."""
        count = len(places)
        table = np.empty((count, len(self._every)))
        for column, value in enumerate(self.evaluator.values_at(self._every, places)):
            table[:, column] = value
        above, below = table[:, :3], table[:, 3]
        slopes, lower = table[:, 4:13].reshape(count, 3, 3), table[:, 13:]
        gradient = below[:, None, None] * slopes - above[:, :, None] * lower[:, None, :]
        return Motions(above, gradient, below)

    def residuals(self, motions: Motions) -> Floats:
        """(n, 3) the vector that vanishes on cores: (H - lambda) m or m x rot."""
        if self.criterion == "vorticity":
            return np.cross(motions.above, rotations(motions.gradient))
        turned = np.einsum("nij,nj->ni", motions.gradient, motions.above)
        return np.asarray(turned - real_eigenvalues(motions.gradient)[:, None] * motions.above)


def rotations(gradients: Floats) -> Floats:
    """(n, 3) rotation of vector fields with gradients (n, 3, 3)."""
    return np.stack(
        [gradients[:, (i + 2) % 3, (i + 1) % 3] - gradients[:, (i + 1) % 3, (i + 2) % 3] for i in range(3)], axis=1
    )


def real_eigenvalues(matrices: Floats) -> Floats:
    """(n,) the real eigenvalue of matrices (n, 3, 3) with a complex pair, else the one farthest from the others."""
    values = np.linalg.eigvals(matrices).astype(complex)
    gaps = np.abs(values[:, [0, 1, 2]] - values[:, [1, 2, 0]])

    # the two nearest to one another are, or become, the pair: of these opposite to the smallest gap is the other one
    is_complex = (values.imag != 0).any(axis=1)
    other = np.where(is_complex, np.abs(values.imag).argmin(axis=1), (gaps.argmin(axis=1) + 2) % 3)
    return np.asarray(values[np.arange(len(values)), other].real)


def _over_one_denominator(components: Sequence[Expression]) -> tuple[list[Expression], Expression]:
    """m and d of a velocity m / d; raises ElvisError if it is not a quotient of polynomials."""
    parts = [fraction(each.root) for each in components]
    for each, part in zip(components, parts, strict=True):
        if part is None:
            raise ElvisError(f"{each.text}: expected a component that is a polynomial of fields, or a quotient of two")
    fractions = [part for part in parts if part is not None]
    denominators = list(dict.fromkeys(below for _, below in fractions if below is not ONE))

    def times(above: Node, below: Node) -> Node:
        for other in denominators:
            above = above if other is below else call("*", above, other)
        return above

    product = ONE
    for other in denominators:
        product = call("*", product, other)
    above = [Expression(each.text, times(*part)) for each, part in zip(components, fractions, strict=True)]
    return above, Expression("denominator", product)
