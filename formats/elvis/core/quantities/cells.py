"""Boxes of elements in collapsed coordinates with the Bernstein nets of all leaves of an expression."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.rows import Rows
from elvis.core.data.dataset import Expansion
from elvis.core.distances import Surface, nearest
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_coefficients, bernstein_space, differentiate
from elvis.core.polynomials.boxnets import all_half_boxes, all_halves, box_nets, power_net
from elvis.core.quantities import intervals as i
from elvis.core.quantities.attributes import Attributes, is_constant
from elvis.core.quantities.functions import function
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import Node, direction_of, fold, target_of
from elvis.core.shapes import Shape

#: nets (c, D1, …, Dd), by their object (a coordinate or a field) and the direction of its derivative
Nets = dict[tuple[object, ...], Floats]
#: bounds of attributes on all elements
_UNIT: Interval = (-1.0, 1.0)
_KNOWN: dict[str, Interval] = {
    "quality": (0.0, 1.0),
    "face_height": (0.0, np.inf),
    **dict.fromkeys(("scaled_jacobian", "nx", "ny", "nz"), _UNIT),
}


@dataclass(frozen=True, eq=False)
class Cells(Rows):
    """Boxes of some of a patch's elements.

    rows       (c,)    of the patch
    low, high  (c, d)  corners in eta
    nets       of the map and the fields, and of their derivatives in xi, over each box
    """

    patch: Patch
    names: Sequence[str]
    attributes: Attributes
    rows: Ints
    low: Floats
    high: Floats
    nets: Nets

    @staticmethod
    def of(patch: Patch, names: Sequence[str], attributes: Attributes, rows: Ints, with_gradients: bool) -> Cells:
        """Whole elements ``rows`` (n,); with derivatives if ``with_gradients``."""
        nets: Nets = {}
        for axis in range(3):
            _add(nets, ("x", axis), patch.geometry, patch.geometry_coefficients[rows, axis], with_gradients)
        for number, expansion in enumerate(patch.fields):
            coefficients = patch.coefficients[number]
            if expansion is not None and coefficients is not None:
                _add(nets, ("field", number), expansion, coefficients[rows], with_gradients)
        low = np.full((len(rows), patch.shape.dimension), -1.0)
        return Cells(patch, names, attributes, rows, low, -low, nets)

    def halves(self) -> Cells:
        """The boxes bisected in every direction."""
        low, high = all_half_boxes(self.low, self.high)
        nets = {key: all_halves(net) for key, net in self.nets.items()}
        return replace(self, rows=np.tile(self.rows, len(low) // len(self)), low=low, high=high, nets=nets)

    def bounds(self, root: Node) -> Interval:
        """Certified smallest and largest value (c,) of an expression on each box."""
        with np.errstate(all="ignore"):
            low, high = fold(root, self._leaf, lambda node, parts: function(node).interval(*parts))
        return np.broadcast_to(low, len(self)), np.broadcast_to(high, len(self))

    def _leaf(self, node: Node) -> Interval:
        if node.op == "number":
            return i.number(node.value)
        if node.op == "coordinate":
            return i.ends(self.nets["x", node.axes[0]])
        if node.op == "attribute":
            return self._attribute(node.name)
        number = self.names.index(node.name)
        if not node.axes:
            return i.ends(self.nets["field", number])
        return self._gradient(number, node.axes[0]) if len(node.axes) == 1 else i.ENTIRE

    def _attribute(self, name: str) -> Interval:
        if is_constant(name):
            values = self.attributes.constant(name, self.patch.shape, self.patch.element_ids[self.rows])
            return values, values
        if name == "jacobian" and self._is_solid:
            return self._determinant()
        target = target_of(name)
        if direction_of(name) is not None:
            return _UNIT
        if target is not None:
            return self._distance(self.attributes.surface(target))
        return _KNOWN.get(name, i.ENTIRE)

    def _distance(self, surface: Surface) -> Interval:
        """Bounds of distances: from the box's centre to a point they grow at most by the distance between the two."""
        low, high = np.stack([i.ends(self.nets["x", axis]) for axis in range(3)], axis=2)
        radius = np.linalg.norm((high - low)[:, : 2 if surface.is_planar else 3], axis=1) / 2
        middle = nearest(surface, (low + high) / 2).distance
        least, greatest = 0.0 if not surface.is_closed else -np.inf, 0.0 if surface.encloses else np.inf
        return np.maximum(middle - radius, least), np.minimum(middle + radius, greatest)

    @property
    def _is_solid(self) -> bool:
        return self.patch.is_flat and self.patch.shape.dimension > 1

    @cached_property
    def _frame(self) -> tuple[Floats, Floats, list[list[Interval]]]:
        """Transposed inverse and determinant of a mean Jacobian J0 of each box, bounds of R in J^T = J0^T (1 + R)."""
        d = self.patch.shape.dimension
        axes = tuple(range(1, d + 1))
        nets = [[self.nets["x", c, direction] for direction in range(d)] for c in range(d)]
        mean = np.moveaxis(np.array([[net.mean(axis=axes) for net in row] for row in nets]), 2, 0)
        determinant = np.linalg.det(mean)
        inverse = np.linalg.inv(np.where(determinant[:, None, None] == 0, np.nan, mean)).transpose(0, 2, 1)
        parts = [[_combine(inverse[:, j], nets[c], float(c == j)) for c in range(d)] for j in range(d)]
        return inverse, determinant, parts

    def _determinant(self) -> Interval:
        """The determinant of 1 + R, a nearly diagonal matrix, times the determinant of the mean Jacobian."""
        _, mean, rest = self._frame
        d = len(rest)
        near = [[i.plus(rest[j][c], i.number(float(j == c))) for c in range(d)] for j in range(d)]
        return i.times((mean, mean), _minor(near, 0, 1, 0, 1) if d == 2 else _expand(near))

    def _gradient(self, number: int, axis: int) -> Interval:
        """The derivative of a field along x, y or z; everything where the Jacobian may be singular.

        The source is J^T g = s: with g0 = J0^-T s, g = g0 - R g (Neumaier 1990, Interval methods for systems of
        equations, 4.2).
        """
        d = self.patch.shape.dimension
        if not self._is_solid or axis >= d or ("field", number) not in self.nets:
            return i.ENTIRE
        if number not in self._gradients:
            inverse, _, rest = self._frame
            gradients = [self.nets["field", number, direction] for direction in range(d)]
            first = [_combine(inverse[:, j], gradients) for j in range(d)]
            size = np.max([np.maximum(np.abs(low), np.abs(high)) for low, high in first], axis=0)
            norm = np.max([sum(np.maximum(np.abs(x), np.abs(y)) for x, y in row) for row in rest], axis=0)
            radius = i.largest_solution(size, norm)
            found: list[Interval] = [(-radius, radius)] * d
            for _ in range(2):
                found = [_correct(first[j], rest[j], found) for j in range(d)]
            self._gradients[number] = found
        return self._gradients[number][axis]

    @cached_property
    def _gradients(self) -> dict[int, list[Interval]]:
        """Bounds of gradients computed so far."""
        return {}


def _combine(weights: Floats, nets: Sequence[Floats], less: float = 0.0) -> Interval:
    """Bounds of sums of nets with weights (c, d)."""
    shape = (-1,) + (1,) * (nets[0].ndim - 1)
    return i.ends(sum(weight.reshape(shape) * net for weight, net in zip(weights.T, nets, strict=True)) - less)


def _correct(first: Interval, rest: Sequence[Interval], found: Sequence[Interval]) -> Interval:
    for part, other in zip(rest, found, strict=True):
        first = i.minus(first, i.times(part, other))
    return first


def _minor(t: list[list[Interval]], a: int, b: int, j: int, k: int) -> Interval:
    return i.minus(i.times(t[a][j], t[b][k]), i.times(t[a][k], t[b][j]))


def _cofactor(t: list[list[Interval]], axis: int, direction: int) -> Interval:
    """Cofactor of the entry [axis][direction]."""
    if len(t) == 2:
        other = t[1 - axis][1 - direction]
        return other if axis == direction else i.minus(i.number(0.0), other)
    (a, b), (j, k) = ((axis + 1) % 3, (axis + 2) % 3), ((direction + 1) % 3, (direction + 2) % 3)
    return _minor(t, a, b, j, k)


def _expand(t: list[list[Interval]]) -> Interval:
    total = i.number(0.0)
    for direction in range(3):
        total = i.plus(total, i.times(t[0][direction], _cofactor(t, 0, direction)))
    return total


def _add(nets: Nets, key: tuple[object, ...], expansion: Expansion, coefficients: Floats, with_gradients: bool) -> None:
    """The net of a polynomial, and the nets of its derivatives in xi, all of the same degrees."""
    space = bernstein_space(expansion)
    net = bernstein_coefficients(expansion, coefficients)
    nets[key] = box_nets(space, net)
    if not with_gradients:
        return
    raised = []
    for direction in range(space.shape.dimension):
        derivative = differentiate(space, net, direction)
        if space.shape is Shape.PYRAMID and direction < 2:
            derivative = _shrunk(*derivative)
        raised.append(box_nets(*derivative))

    # on a pyramid eta1 and eta2 change with xi3
    if space.shape is Shape.PYRAMID:
        for direction in range(2):
            raised[2] = _elevate(raised[2], nets[key]) + _elevate(_times_share(raised[direction], direction), nets[key])
    for direction, raised_net in enumerate(raised):
        nets[(*key, direction)] = _elevate(raised_net, nets[key])


def _elevate(net: Floats, like: Floats) -> Floats:
    """The net with as many coefficients in each direction as another one."""
    for axis in range(1, net.ndim):
        net = np.moveaxis(np.moveaxis(net, axis, -1) @ _elevation(net.shape[axis] - 1, like.shape[axis] - 1), -1, axis)
    return net


@bounded_cache
def _elevation(degree: int, target: int) -> Floats:
    """(degree + 1, target + 1) functions of one degree expressed in those of a higher degree.

    Multiply from the right.
    """
    return frozen_floats([power_net(power, degree, target) for power in range(degree + 1)])


def _times_share(net: Floats, direction: int) -> Floats:
    """The net times (1 + eta) / 2 of one direction."""
    moved = np.moveaxis(net, 1 + direction, -1)
    n = moved.shape[-1]
    longer = np.concatenate([np.zeros((*moved.shape[:-1], 1)), moved], axis=-1) * (np.arange(n + 1) / n)
    return np.moveaxis(longer, -1, 1 + direction)


def _shrunk(space: BernsteinSpace, net: Floats) -> tuple[BernsteinSpace, Floats]:
    """A polynomial that is zero at a pyramid's apex, divided by (1 - t), t = (1 + eta3) / 2.

    Uses b_k^r = (1 - t) r / (r - k) b_k^(r - 1).
    """
    p, q, r = space.degrees
    if r == 0:
        return space, net
    layers = net.reshape(-1, r + 1, (q + 1) * (p + 1))[:, :r] * (r / (r - np.arange(r)))[:, None]
    return BernsteinSpace(space.shape, (p, q, r - 1)), layers.reshape(len(net), -1)
