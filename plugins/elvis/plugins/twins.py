"""Elements of a runtime plugin in NumPy: where a part says its shape and gives `Part.evaluate`, all else follows.

Points are those of the shape in `elvis.core.shapes`, whatever coordinates the plugin takes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.distances import Surface, nearest, surface_of
from elvis.core.errors import ElvisError
from elvis.core.mapping.tangents import duals
from elvis.core.quantities import Expression
from elvis.core.quantities.attributes import from_ideal, target_of
from elvis.core.quantities.functions import function
from elvis.core.quantities.tree import Node, folded
from elvis.core.shapes import Shape
from elvis.plugins.volume import Part, Volume

#: attributes of elements that need nothing but the map
POINTWISE = ("element", "jacobian", "scaled_jacobian")
#: distance of the points that derivatives are made of: the error is some 1e-11 of what is smooth over an element
_STEP = 0.02
#: monomials of a polynomial through seven points, from its values there
_THROUGH = np.linalg.inv(np.vander(np.arange(-3.0, 4.0), increasing=True))


@dataclass(frozen=True, eq=False)
class Twin:
    """The elements of a part."""

    part: Part
    shape: Shape

    def __len__(self) -> int:
        return len(self.part)

    def evaluated(self, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        """World positions (n, 3) and values (n,) in elements ``rows`` (n,) at points (n, d)."""
        assert self.part.evaluate is not None
        own = np.zeros((len(points), 3))
        own[:, : self.shape.dimension] = (1 + points) / 2 if self.part.unit else points
        positions, values = self.part.evaluate(rows, own)
        return np.asarray(positions, np.float64), np.asarray(values, np.float64)

    def slopes(self, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        """Derivatives of positions (n, 3, d) and values (n, d); see `slopes_of`."""
        every = slopes_of(lambda rows, points: np.column_stack(self.evaluated(rows, points)), rows, points)
        return every[:, :3], every[:, 3]


def slopes_of(function: Callable[[Ints, Floats], Floats], rows: Ints, points: Floats) -> Floats:
    """(n, …, d) derivatives of a function of elements (n,) and points (n, d), which gives (n, …).

    They are those of polynomials of degree 6 through points nearby, in [-1, 1]^d.
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


def twins_of(volume: Volume) -> list[Twin] | None:
    """The elements of each part; None where there is none, or one doesn't say its shape or has no `evaluate`."""
    found = [Twin(part, part.shape) for part in volume.parts if part.shape is not None and part.evaluate is not None]
    return found if found and len(found) == len(volume.parts) else None


def twins_by_field(parts: Mapping[str, Part]) -> Mapping[str, Twin] | None:
    """The same for the parts of several fields."""
    found = {name: Twin(part, part.shape) for name, part in parts.items() if part.shape is not None and part.evaluate}
    return found if len(found) == len(parts) else None


def number_of(shape: Shape | None) -> float:
    """The number that stands for a shape in expressions."""
    return float([*Shape].index(shape)) if shape else np.nan


def expressed(expression: Expression, twins: Mapping[str, Twin], rows: Ints, points: Floats) -> Floats:
    """(n,) an expression of fields in elements ``rows`` (n,) at points (n, d).

    twins  the same elements with each field, one at least
    ElvisError for what isn't known of such elements.
    """
    first = next(iter(twins.values()))

    @cache
    def found(name: str) -> tuple[Floats, Floats]:
        return twins[name].evaluated(rows, points)

    @cache
    def slopes(name: str) -> tuple[Floats, Floats]:
        return twins[name].slopes(rows, points)

    @cache
    def jacobians() -> Floats:
        return slopes(next(iter(twins)))[0]

    def leaf(node: Node) -> Floats | float:
        if node.op == "number":
            return node.value
        if node.op == "coordinate":
            return np.asarray(found(next(iter(twins)))[0][:, node.axes[0]])
        target = target_of(node.name)
        if target is not None:
            return nearest(_surface(target), found(next(iter(twins)))[0]).distance
        if node.op == "attribute":
            return _attribute(node.name, first, rows, jacobians)
        if len(node.axes) > 1:
            raise ElvisError(f"there is no second derivative of {node.name}, which a plugin describes in NumPy")
        if not node.axes:
            return found(node.name)[1]
        moved, risen = slopes(node.name)
        return np.asarray(np.einsum("nci,ni->nc", duals(moved), risen)[:, node.axes[0]])

    with np.errstate(all="ignore"):
        values = folded(expression.root, leaf, lambda node, parts: function(node).numpy(*parts))
    return np.broadcast_to(np.asarray(values, np.float64), len(rows))


@lru_cache(maxsize=4)
def _surface(target: str) -> Surface:
    """The triangles of a file."""
    return surface_of(None, target)


def _attribute(name: str, twin: Twin, rows: Ints, jacobians: Callable[[], Floats]) -> Floats | float:
    """What is known of elements by themselves (`elvis.core.quantities.attributes`)."""
    if name == "element":
        return twin.part.element_ids[rows].astype(np.float64)
    if name == "shape":
        return number_of(twin.shape)
    if name not in (*POINTWISE, "quality"):
        raise ElvisError(f"there is no {name} of elements that a runtime plugin describes in NumPy")
    own = jacobians()[:, : twin.shape.dimension] * (2.0 if twin.part.unit else 1.0)
    determinant = np.linalg.det(own)
    if name == "jacobian":
        return np.asarray(determinant)
    if name == "scaled_jacobian":
        return np.asarray(determinant / np.linalg.norm(own, axis=1).prod(axis=1))
    inverse, d = from_ideal(twin.shape), twin.shape.dimension
    size = ((own @ inverse) ** 2).sum(axis=(1, 2))
    return np.asarray(d * np.maximum(determinant * np.linalg.det(inverse), 0.0) ** (2 / d) / size)
