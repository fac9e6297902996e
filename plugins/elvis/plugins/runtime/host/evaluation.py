"""Host evaluation: the elements of a runtime plugin in NumPy.

If a part states its shape and provides `Part.evaluate`, everything else follows.

Points belong to the shape in `elvis.core.shapes`, for all coordinates that the plugin uses.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.distances import Surface, nearest, surface_of
from elvis.core.mapping.tangents import duals
from elvis.core.quantities import Expression
from elvis.core.quantities.attributes import from_ideal, measured
from elvis.core.quantities.elements.sides import SIDES, of_side, side_gradients
from elvis.core.quantities.functions import function
from elvis.core.quantities.tree import Node, fold, target_of
from elvis.core.shapes import Shape
from elvis.plugins.runtime.volume import Part, Volume

#: attributes of elements that need nothing but the map
POINTWISE = ("element", "jacobian", "scaled_jacobian")
#: spacing of the points for derivatives: the error is about 1e-11 for functions that are smooth over an element
_STEP = 0.02
#: monomials of a polynomial through seven points, from its values there
_THROUGH = np.linalg.inv(np.vander(np.arange(-3.0, 4.0), increasing=True))


@dataclass(frozen=True, eq=False)
class HostEvaluation:
    """The elements of a part, evaluated in NumPy."""

    part: Part
    shape: Shape

    def __len__(self) -> int:
        return len(self.part)

    def evaluate(self, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        """World positions (n, 3) and values (n,) in elements ``rows`` (n,) at points (n, d)."""
        assert self.part.evaluate is not None
        own = np.zeros((len(points), 3))
        own[:, : self.shape.dimension] = (1 + points) / 2 if self.part.unit else points
        positions, values = self.part.evaluate(rows, own)
        return np.asarray(positions, np.float64), np.asarray(values, np.float64)

    def positions(self, rows: Ints, points: Floats) -> Floats:
        """(n, k, 3) world positions of the same points (k, d) in each of the elements ``rows`` (n,)."""
        every_row = np.repeat(rows, len(points))
        every_point = np.tile(points, (len(rows), 1))
        positions, _ = self.evaluate(every_row, every_point)
        return positions.reshape(len(rows), len(points), 3)

    def derivatives(self, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        """Derivatives of positions (n, 3, d) and values (n, d); see `numerical_derivatives`."""

        def evaluate(rows: Ints, points: Floats) -> Floats:
            positions, values = self.evaluate(rows, points)
            return np.column_stack([positions, values])

        every = numerical_derivatives(evaluate, rows, points)
        return every[:, :3], every[:, 3]


def numerical_derivatives(function: Callable[[Ints, Floats], Floats], rows: Ints, points: Floats) -> Floats:
    """Derivatives (n, …, d) of a function of elements (n,) and points (n, d), with values (n, …).

    They are derivatives of polynomials of degree 6 through points nearby, in [-1, 1]^d.
    """
    found = []
    for axis in range(points.shape[1]):
        middle = np.clip(points[:, axis], -1 + 3 * _STEP, 1 - 3 * _STEP)
        place = (points[:, axis] - middle) / _STEP
        weights = place[:, None] ** np.arange(6) * np.arange(1, 7) @ _THROUGH[1:] / _STEP
        near = np.repeat(points, 7, axis=0)
        near[:, axis] = (middle[:, None] + _STEP * np.arange(-3, 4)).ravel()
        values = function(np.repeat(rows, 7), near)
        found.append(np.einsum("nk,nk...->n...", weights, values.reshape(-1, 7, *values.shape[1:])))
    return np.stack(found, axis=-1)


def host_evaluations(volume: Volume) -> list[HostEvaluation] | None:
    """The elements of each part; None where there is none, or one doesn't say its shape or has no `evaluate`."""
    hosts = []
    for part in volume.parts:
        if part.shape is None or part.evaluate is None:
            return None
        hosts.append(HostEvaluation(part, part.shape))
    return hosts or None


def host_evaluations_by_field(parts: Mapping[str, Part]) -> Mapping[str, HostEvaluation] | None:
    """The same for the parts of several fields."""
    hosts = {}
    for name, part in parts.items():
        if part.shape is None or part.evaluate is None:
            return None
        hosts[name] = HostEvaluation(part, part.shape)
    return hosts


def number_of(shape: Shape | None) -> float:
    """The number that stands for a shape in expressions."""
    return float([*Shape].index(shape)) if shape else np.nan


def evaluate_expression(
    expression: Expression, hosts: Mapping[str, HostEvaluation], rows: Ints, points: Floats
) -> Floats:
    """(n,) an expression of fields in elements ``rows`` (n,) at points (n, d).

    hosts  the same elements with each field, one at least
    ElvisError for what isn't known of such elements.
    """
    first = next(iter(hosts))

    @cache
    def evaluate(name: str) -> tuple[Floats, Floats]:
        return hosts[name].evaluate(rows, points)

    @cache
    def derivatives(name: str) -> tuple[Floats, Floats]:
        return hosts[name].derivatives(rows, points)

    @cache
    def jacobians() -> Floats:
        return derivatives(first)[0]

    def positions() -> Floats:
        return evaluate(first)[0]

    def leaf(node: Node) -> Floats | float:
        if node.op == "number":
            return node.value
        if node.op == "coordinate":
            return np.asarray(positions()[:, node.axes[0]])
        target = target_of(node.name)
        if target is not None:
            return _measured(node.name, target, positions())
        if node.op == "attribute":
            if node.name in SIDES:
                return of_side(node.name, side_gradients(hosts[first].shape, points, duals(jacobians())))
            return _attribute(node.name, hosts[first], rows, jacobians)
        if len(node.axes) > 1:
            raise ElvisError(f"there is no second derivative of {node.name}, which a plugin describes in NumPy")
        if not node.axes:
            return evaluate(node.name)[1]
        jacobian, derivative = derivatives(node.name)
        gradient = np.einsum("nci,ni->nc", duals(jacobian), derivative)
        return np.asarray(gradient[:, node.axes[0]])

    with np.errstate(all="ignore"):
        values = fold(expression.root, leaf, lambda node, parts: function(node).numpy(*parts))
    return np.broadcast_to(np.asarray(values, np.float64), len(rows))


def _measured(name: str, target: str, positions: Floats) -> Floats:
    """(n,) a distance or a direction at positions (n, 3)."""
    surface = _surface(target)
    return measured(name, surface, positions, nearest(surface, positions))


@lru_cache(maxsize=4)
def _surface(target: str) -> Surface:
    """The triangles of a file."""
    return surface_of(None, target)


def _attribute(name: str, host: HostEvaluation, rows: Ints, jacobians: Callable[[], Floats]) -> Floats | float:
    """Attributes of single elements (`elvis.core.quantities.attributes`)."""
    if name == "element":
        return host.part.element_ids[rows].astype(np.float64)
    if name == "shape":
        return number_of(host.shape)
    if name not in (*POINTWISE, "quality"):
        raise ElvisError(f"there is no {name} of elements that a runtime plugin describes in NumPy")
    own = jacobians()[:, : host.shape.dimension] * (2.0 if host.part.unit else 1.0)
    if name == "jacobian":
        return np.asarray(np.linalg.det(own))
    return scaled_determinants(own) if name == "scaled_jacobian" else mean_ratios(host.shape, own)


def scaled_determinants(jacobians: Floats) -> Floats:
    """(n,) determinants of Jacobians (n, d, d), divided by the lengths of their columns."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.linalg.det(jacobians) / np.linalg.norm(jacobians, axis=1).prod(axis=1))


def mean_ratios(shape: Shape, jacobians: Floats) -> Floats:
    """(n,) 1 where Jacobians (n, d, d) scale and turn the ideal element of a shape, 0 where they invert it."""
    inverse = from_ideal(shape)
    d = shape.dimension
    determinants = np.linalg.det(jacobians) * np.linalg.det(inverse)
    size = ((jacobians @ inverse) ** 2).sum(axis=(1, 2))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(d * np.maximum(determinants, 0.0) ** (2 / d) / size)
