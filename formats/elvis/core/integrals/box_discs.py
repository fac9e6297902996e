"""Discs that hold the values of expressions on complex neighbourhoods of boxes of eta: Bernstein ellipses.

Leaves are polynomials of eta.  Their first Legendre coefficient is the middle, the sum of |c_k| P_k((rho + 1/rho)/2)
over the others the radius, since |P_k| is largest at the end of the ellipse.  Only the coordinate of one direction is
complex; all others are in [-1, 1], where |P_k| <= 1.  Functions of leaves follow by `elvis.core.quantities.discs`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.integrals.degrees import DegreeRules
from elvis.core.integrals.disc_algebra import determinant, enclosed, minor
from elvis.core.integrals.eta_boxes import EtaBoxes, to_legendre
from elvis.core.integrals.tree_discs import ROUNDING, Ball, TreeDiscs, divided, interval_of
from elvis.core.polynomials.collapse import collapse_jacobian
from elvis.core.polynomials.jacobi import jacobi
from elvis.core.quantities import discs
from elvis.core.quantities.attributes import Attributes, is_constant
from elvis.core.quantities.discs import Disc
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.elements.sides import SIDES
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import Node, call, fold, number, whole_exponent
from elvis.core.shapes import Shape

#: parameters of the ellipses; the best one is used: for singularities from 0.02 to 10 half lengths of a box away
RHOS = frozen_floats(1.25 * 1.6 ** np.arange(7))
_NORMALS = SIDES[:3]


def is_bounded(root: Node, rules: DegreeRules) -> bool:
    """Whether discs are known of all leaves of an expression on a piece."""
    piece = rules.piece
    patch, d = piece.patch, piece.patch.shape.dimension

    def leaf(node: Node) -> bool:
        if node.op == "attribute":
            return is_constant(node.name) or (piece.is_side and node.name in _NORMALS)
        if len(node.axes) < 2 or node.op != "field":
            return not (node.op == "field" and node.axes) or rules.is_affine or (patch.is_flat and d > 1)
        return rules.is_affine and patch.is_flat and patch.shape is not Shape.PYRAMID

    return patch.homogeneous is None and fold(root, leaf, lambda _, parts: all(parts))


@dataclass(frozen=True, eq=False)
class BoxDiscs:
    """Discs of expressions on the ellipses of boxes.

    A disc has a column for the real box, then one for each direction's ellipse of each parameter.

    rules   of the piece that the boxes are in
    names   of the patch's fields
    places  Gauss points of the boxes, as many as determine the leaves
    counts  number of these in each direction
    """

    boxes: EtaBoxes
    rules: DegreeRules
    names: Sequence[str]
    attributes: Attributes
    places: ElementPoints
    counts: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of boxes."""
        return len(self.boxes)

    @cached_property
    def eta(self) -> Floats:
        """(n q, k) of the points."""
        return self.boxes.eta(self.counts)

    def disc(self, root: Node) -> tuple[Disc, Floats]:
        """Middles (n, 1) and radii (n, 1 + k rhos) of an expression, and how far (n,) it may be off at real points."""
        columns = 1 + len(self.counts) * len(RHOS)
        tree = TreeDiscs(self.count, _factors(len(self.counts)), self._leaf, self._cofactor)
        found = tree.of(without_roots(root))
        middle, slack = (np.broadcast_to(own, (self.count, 1)) for own in (found.middle, found.slack))
        return (middle, np.broadcast_to(found.radius, (self.count, columns))), slack[:, 0]

    def interval(self, root: Node) -> Interval:
        """Smallest and largest value (n,) of an expression on the real boxes; infinite if nothing is known."""

        def leaf(node: Node) -> Interval:
            middle, radius = self._leaf(node).disc
            if np.ndim(middle) == 0:
                return middle, middle
            return middle[:, 0] - radius[:, 0], middle[:, 0] + radius[:, 0]

        return interval_of(root, leaf, self.count)

    @cached_property
    def measure(self) -> Disc:
        """The measure for each unit of eta."""
        if self.rules.is_affine:
            return self._of(self.boxes.density(self.places, self.eta))
        fold_ = self._of(collapse_jacobian(self.rules.piece.shape, self.eta))
        if self._is_solid and not self.rules.piece.is_side:
            return discs.times(self._volume, fold_)
        return discs.times(self._stretch, fold_)

    @property
    def _volume(self) -> Disc:
        """The magnitude of the determinant; in valid elements this is the determinant itself, or its negative."""
        middle, radius = self._determinant
        if not self.rules.is_valid or self.rules.piece.is_signed:
            return discs.absolute((middle, radius))

        # of all points the one with the largest determinant tells the sign, as rounding can't change it there
        d = self.rules.piece.patch.shape.dimension
        values = np.linalg.det(self.places.jacobians[:, :d, :d]).reshape(self.count, -1)
        largest = np.argmax(np.abs(values), axis=1)
        sign = np.sign(np.take_along_axis(values, largest[:, None], axis=1))
        return sign * middle, radius

    @property
    def _is_solid(self) -> bool:
        return self.rules.piece.patch.is_flat and self.rules.piece.patch.shape.dimension > 1

    def _of(self, values: Floats) -> Disc:
        """The disc of a polynomial with values (n q,) at the points."""
        return self._several(values[:, None])[0]

    def _several(self, values: Floats) -> list[Disc]:
        """Discs of polynomials with values (n q, m) at the points."""
        middles, sizes, rounding = self._sizes(values)
        real = sizes[0].sum(axis=1)[..., None]
        on_ellipses = [np.tensordot(own, _growths(own.shape[1])[0], (1, 0)) for own in sizes]
        radii = np.concatenate([real, *on_ellipses], axis=2) + rounding[..., None]
        return [(middles[:, k, None], radii[:, k]) for k in range(values.shape[1])]

    def _sizes(self, values: Floats) -> tuple[Floats, list[Floats], Floats]:
        """Legendre coefficients of polynomials with values (n q, m): the first (n, m), sizes of the others, rounding.

        For each direction the sizes (n, k, m) are sums over all coefficients that have a degree in it.
        """
        m, axes = values.shape[1], range(1, 1 + len(self.counts))
        coefficients = values.reshape(self.count, *self.counts, m)
        for axis, count in zip(axes, self.counts, strict=True):
            coefficients = np.moveaxis(np.tensordot(to_legendre(count), coefficients, (1, axis)), 0, axis)
        coefficients = np.ascontiguousarray(coefficients)
        middles, sizes = coefficients.reshape(self.count, -1, m)[:, 0].copy(), np.abs(coefficients)
        rounding = ROUNDING * np.abs(values).reshape(self.count, -1, m).max(axis=1)
        sizes.reshape(self.count, -1, m)[:, 0] = 0.0
        return middles, [sizes.sum(axis=tuple(other for other in axes if other != axis)) for axis in axes], rounding

    def _polynomial(self, values: Floats, rounding: Floats | None = None) -> Ball:
        """The ball of a polynomial with values (n q,) at the points, which may have more rounding (n, 1)."""
        middles, sizes, least = self._sizes(values[:, None])
        rounding = least if rounding is None else rounding
        parts = [np.tensordot(own, _growths(own.shape[1]), (1, 1)) for own in sizes]
        real, imaginary = (np.concatenate([part[:, 0, kind] for part in parts], axis=1) for kind in (0, 1))
        radii = np.concatenate([sizes[0].sum(axis=1), real], axis=1) + rounding
        return Ball(middles, radii, middles - radii, np.concatenate([0 * rounding, imaginary], axis=1) + rounding)

    def _cofactor(self, node: Node) -> tuple[Ints, Ball] | None:
        """The cofactor of a polynomial leaf without its zeros on faces of boxes, and these zeros' powers (n, 2 k)."""
        self._leaf(node)
        if node not in self._values:
            return None
        if node not in self._divided:
            values = self._values[node].reshape(self.count, -1)
            own = divided(values, self.counts)
            rounding = ROUNDING * own.growth * np.abs(values).max(axis=1)
            ball = self._polynomial(own.values.reshape(-1), rounding[:, None])
            slack = own.slack[:, None]
            self._divided[node] = own.powers, ball._replace(slack=slack, root_slack=np.sqrt(slack))
        return self._divided[node]

    def _leaf(self, node: Node) -> Ball:
        """The ball of a leaf."""
        if node.op == "number":
            return Ball.around(discs.number(node.value))
        if node not in self._known:
            values = self._values_of(node)
            if values is None:
                self._known[node] = Ball.around(self._other(node))
            else:
                self._values[node] = values
                self._known[node] = self._polynomial(values)
        return self._known[node]

    @cached_property
    def _values(self) -> dict[Node, Floats]:
        """Values (n q,) of leaves that are polynomials."""
        return {}

    @cached_property
    def _divided(self) -> dict[Node, tuple[Ints, Ball]]:
        """Cofactors computed so far."""
        return {}

    @cached_property
    def _known(self) -> dict[Node, Ball]:
        """Leaves computed so far."""
        return {}

    def _values_of(self, node: Node) -> Floats | None:
        """Values (n q,) of a leaf at the points; None if it is not a polynomial."""
        if node.op == "coordinate":
            return self.places.positions[:, node.axes[0]]
        if node.op != "field":
            return None
        field = self.names.index(node.name)
        if not node.axes:
            return self.places.derivative(field, 0)
        if self.rules.is_affine:
            return np.asarray(self.places.derivative(field, len(node.axes)).T[node.axes[::-1]])
        return None

    def _other(self, node: Node) -> Disc:
        """The disc of an attribute, or of a derivative in curved elements."""
        if node.op == "attribute":
            return self._attribute(node.name)
        gradient = self._gradient(self.names.index(node.name))
        return gradient[node.axes[0]] if node.axes[0] < len(gradient) else discs.number(0.0)

    def _attribute(self, name: str) -> Disc:
        values = self.attributes.at(name, self.places.patch, self.places.rows, self.places.points)
        if is_constant(name) or self.rules.is_affine or self.rules.is_flat:
            return self._of(values)
        axis = _NORMALS.index(name)
        found = discs.over(self._normal[axis], self._stretch)
        one = slice(None, None, int(np.prod(self.counts)))
        is_turned = values[one] * self._normal_values[one, axis] < 0
        return np.where(is_turned[:, None], -found[0], found[0]), found[1]

    @cached_property
    def _frame(self) -> tuple[Floats, Floats, list[list[Disc]]]:
        """A = J0^-T and det J0 of a mean Jacobian J0 of each box, and discs of R = A J^T - 1."""
        d = self.rules.piece.patch.shape.dimension
        jacobians = self.places.jacobians[:, :d, :d].reshape(self.count, -1, d, d)
        mean = jacobians.mean(axis=1)
        determinant = np.linalg.det(mean)
        inverse = np.linalg.inv(np.where(determinant[:, None, None] == 0, np.nan, mean)).transpose(0, 2, 1)
        rest = np.einsum("nij,nqkj->nqik", inverse, jacobians) - np.eye(d)
        found = self._several(rest.reshape(-1, d * d))
        return inverse, determinant, [found[row * d : (row + 1) * d] for row in range(d)]

    @cached_property
    def _determinant(self) -> Disc:
        """The determinant of 1 + R, a nearly diagonal matrix, times det J0."""
        _, mean, rest = self._frame
        one = discs.number(1.0)
        near = [[discs.plus(own, one) if i == k else own for k, own in enumerate(row)] for i, row in enumerate(rest)]
        return discs.times((mean[:, None], np.zeros((len(mean), 1))), determinant(near))

    def _gradient(self, field: int) -> list[Disc]:
        """The gradient of a field: from J^T g = s with g0 = A s, g = g0 - R g."""
        if field not in self._gradients:
            inverse, _, rest = self._frame
            own = self.places.reference_gradients(field).reshape(self.count, -1, len(rest))
            first = self._several(np.einsum("nij,nqj->nqi", inverse, own).reshape(-1, len(rest)))
            self._gradients[field] = enclosed(rest, first)
        return self._gradients[field]

    @cached_property
    def _gradients(self) -> dict[int, list[Disc]]:
        """Gradients computed so far."""
        return {}

    @cached_property
    def _tangents(self) -> Floats:
        """(n q, 3, k) of the piece at the points."""
        return self.rules.piece.along(self.places.jacobians)

    @cached_property
    def _normal_values(self) -> Floats:
        """(n q, 3) vectors across a side at the points: tangents' product, on an edge its tangent turned."""
        along = self._tangents
        if along.shape[2] == 2:
            return np.cross(along[:, :, 0], along[:, :, 1])
        return np.stack([along[:, 1, 0], -along[:, 0, 0], 0 * along[:, 0, 0]], axis=1)

    @cached_property
    def _normal(self) -> list[Disc]:
        """Discs of these."""
        along = self._tangents
        if along.shape[2] == 1:
            return self._several(self._normal_values)
        one, two = self._several(along[:, :, 0]), self._several(along[:, :, 1])
        return [minor(one[i], one[k], two[i], two[k]) for i, k in ((1, 2), (2, 0), (0, 1))]

    @cached_property
    def _stretch(self) -> Disc:
        """Length or area of tangents."""
        is_edge = self._tangents.shape[2] == 1
        parts = self._several(self._tangents[:, :, 0]) if is_edge else self._normal
        squares = [discs.times(part, part) for part in parts]
        return discs.root(reduce(discs.plus, squares))


@bounded_cache
def _growths(count: int) -> Floats:
    """(2, count, rhos) upper bounds of |P_k| and |Im P_k| inside the ellipses.

    |P_k| is largest at their real ends. With P_k = sum a_j T_j, where no a_j is negative, |Im P_k| is at most
    sum a_j (rho^j - rho^-j)/2.
    """
    real = jacobi(count - 1, 0, 0, (RHOS + 1 / RHOS) / 2)

    # a_j for j > 0 by the Gauss-Chebyshev rule, which is exact
    angles = (np.arange(count) + 0.5) * np.pi / count
    j = np.arange(1, count)[:, None]
    chebyshev = jacobi(count - 1, 0, 0, np.cos(angles)) @ np.cos(j * angles).T * 2 / count
    rounded_up = np.maximum(chebyshev, 0.0) + ROUNDING
    return frozen_floats(np.stack([real, rounded_up @ ((RHOS**j - RHOS**-j) / 2)]))


@bounded_cache
def _factors(d: int) -> Floats:
    """(2 d, 1 + d rhos) radii of 1 + t and 1 - t around 1 for each direction: |t| on its ellipses, 1 elsewhere."""
    radii = np.ones((d, 2, 1 + d * len(RHOS)))
    for axis in range(d):
        first = 1 + axis * len(RHOS)
        radii[axis, :, first : first + len(RHOS)] = (RHOS + 1 / RHOS) / 2
    return frozen_floats(radii.reshape(2 * d, -1))


def without_roots(root: Node) -> Node:
    """An expression with squares of sqrt(a) replaced by a, and squares of abs(a) by a^2."""

    def inner(node: Node, parts: list[Node]) -> Node:
        base, exponent = parts[0], whole_exponent(node)
        if node.op == "*" and parts[0] is parts[1]:
            exponent = 2
        if exponent is None or exponent % 2 or base.op not in ("sqrt", "abs"):
            return call(node.op, *parts)
        return call("^", base.operands[0], number(exponent / 2 if base.op == "sqrt" else exponent))

    return fold(root, lambda leaf: leaf, inner)
