"""Attributes: quantities that elements define, independent of fields.

element          id in the file
composite        id of the composite that holds it, the first of several (see `elements.sizes`)
h                size: the d-th root of its length, area or volume
order            highest degree of a field on it, or of its map without fields
shape            0 segment, 1 triangle, 2 quadrilateral, 3 tetrahedron, 4 pyramid, 5 prism, 6 hexahedron
jacobian_sign    1 if the Jacobian is proved to be positive everywhere, -1 if it isn't, 0 if undecided (`validity`)
jacobian         determinant of the map's derivative in xi; length or area if the space has more dimensions
scaled_jacobian  the determinant divided by the product of the lengths of the derivative's columns: -1 to 1
quality          mean ratio of the map from the ideal element, which has equal edges: 1 for a similarity, 0 for a
                 degenerate or inverted map (Knupp 2001, Algebraic mesh quality metrics: shape)
xi1_x, …         derivatives of the reference coordinates (see `elements.sides.DUALS`)
nx, ny, nz       outward unit normal on the element's sides, and
face_height      height of the element above them; NaN elsewhere (see `elements.sides`)
jump(f)          largest jump of the field f across the element's faces (see `jumps`)
decay(f)         rate at which the modes of the field f fall with the order (see `resolution.element_resolution`)
tail(f)          share of the energy of f in the highest modes
recovered_error(f)  estimated error of the gradient of f on the element (see `resolution.gradient_errors`)
distance(b)      distance to a boundary or to a file's triangles (see `elvis.core.distances`), and
d(distance(b),x), bfc_dir1_x(b)  unit vectors from the nearest point (see `tree.Direction`)
ref:p            the value of p in the dataset named ref, at the same position (see `elsewhere`)
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, joined_floats, joined_ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Block, Dataset
from elvis.core.distances import Near, Surface, gradients, nearest, surface_of, vectors_away
from elvis.core.mapping import pointwise, tangents
from elvis.core.mapping.geometry import GeometryBlock, geometry
from elvis.core.mapping.patch import Patch
from elvis.core.quantities.elements.sides import DUALS, SIDES, of_side, side_gradients
from elvis.core.quantities.elements.sizes import composites, sizes
from elvis.core.quantities.jumps import jumps
from elvis.core.quantities.tree import direction_of, measured_of, other_of, target_of
from elvis.core.shapes import Shape
from elvis.core.validity.validity import statuses

if TYPE_CHECKING:
    from elvis.core.quantities.elsewhere import Elsewhere

#: attributes that are constant on an element, in addition to functions of fields
CONSTANT = ("element", "composite", "h", "order", "shape", "jacobian_sign")
_NUMBERS = {shape: float(number) for number, shape in enumerate(Shape)}

#: points of the last searches for a surface that are kept, 80 bytes each
_REMEMBERED = 1 << 18

#: edges of the ideal element along xi, in columns; of the pyramid and the prism those at the middle of the base
_ROOT = np.sqrt(3.0)
_IDEAL: Mapping[Shape, list[list[float]]] = {
    Shape.SEGMENT: [[1]],
    Shape.TRIANGLE: [[1, 0.5], [0, _ROOT / 2]],
    Shape.QUADRILATERAL: [[1, 0], [0, 1]],
    Shape.TETRAHEDRON: [[1, 0.5, 0.5], [0, _ROOT / 2, _ROOT / 6], [0, 0, np.sqrt(2 / 3)]],
    Shape.PYRAMID: [[1, 0, 0.5], [0, 1, 0.5], [0, 0, np.sqrt(0.5)]],
    Shape.PRISM: [[1, 0, 0.5], [0, 1, 0], [0, 0, _ROOT / 2]],
    Shape.HEXAHEDRON: [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
}


def measured(name: str, surface: Surface, positions: Floats, near: Near) -> Floats:
    """(n,) the distance to a surface, or a component of a direction, at positions (n, 3).

    near  the nearest points of the surface
    """
    direction = direction_of(name)
    if direction is None:
        return near.distance
    vectors = vectors_away if direction.is_away else gradients
    return vectors(surface, positions, near)[:, direction.axis]


def is_constant(name: str) -> bool:
    """Whether an attribute is one number throughout an element."""
    return name in CONSTANT or measured_of(name) is not None


@cache
def from_ideal(shape: Shape) -> Floats:
    """(d, d) the inverse of the ideal element's edges: a map's derivative times this is that from the ideal element."""
    return frozen_floats(np.linalg.inv(np.array(_IDEAL[shape], float)))


class Attributes:
    """The attributes of a dataset's elements."""

    def __init__(self, dataset: Dataset) -> None:
        self._dataset = dataset
        self._found: dict[str, tuple[Ints, Floats]] = {}
        self._surfaces: dict[str, Surface] = {}
        self._nears: dict[str, list[tuple[Floats, Near]]] = {}
        self._others: dict[str, Elsewhere] = {}

    def at(self, name: str, patch: Patch, rows: Ints, points: Floats) -> Floats:
        """(n,) values on elements ``rows`` of a patch at reference points (n, D)."""
        if is_constant(name):
            return self.constant(name, patch.shape, patch.element_ids[rows])
        target, elsewhere = target_of(name), other_of(name)
        if target is not None:
            return self._from_surface(name, target, pointwise.positions(patch, rows, points))
        if elsewhere is not None:
            return self._other(elsewhere[0]).values(elsewhere[1], pointwise.positions(patch, rows, points))
        return _POINTWISE[name](patch, rows, points)

    def _from_surface(self, name: str, target: str, positions: Floats) -> Floats:
        """(n,) a distance or a direction at positions (n, 3)."""
        surface = self.surface(target)
        return measured(name, surface, positions, self._near(surface, target, positions))

    def _near(self, surface: Surface, target: str, positions: Floats) -> Near:
        """The nearest points to positions (n, 3); quantities that are evaluated in turn share the last searches."""
        searches = self._nears.setdefault(target, [])
        for known, near in searches:
            if np.array_equal(known, positions):
                return near
        searches.append((positions, nearest(surface, positions)))
        while len(searches) > 1 and sum(len(known) for known, _ in searches) > _REMEMBERED:
            searches.pop(0)
        return searches[-1][1]

    def surface(self, target: str) -> Surface:
        """The surface to which distances are measured."""
        if target not in self._surfaces:
            self._surfaces[target] = surface_of(self._dataset, target)
        return self._surfaces[target]

    def _other(self, name: str) -> Elsewhere:
        """Another dataset."""
        from elvis.core.quantities.elsewhere import Elsewhere

        if name not in self._others:
            self._others[name] = Elsewhere(self._dataset.others[name])
        return self._others[name]

    def constant(self, name: str, shape: Shape, element_ids: Ints) -> Floats:
        """(n,) an attribute that is one number throughout each element; NaN for elements beyond the domain."""
        if name == "element":
            return element_ids.astype(np.float64)
        if name == "shape":
            return np.full(len(element_ids), _NUMBERS[shape])
        if name not in self._found:
            ids, values = self._constant(name)
            order = np.argsort(ids, kind="stable")
            self._found[name] = ids[order], values[order]
        ids, values = self._found[name]
        place = np.searchsorted(ids, element_ids).clip(0, max(len(ids) - 1, 0))
        held = ids[place] == element_ids if len(ids) else np.zeros(len(element_ids), bool)
        return np.where(held, values[place] if len(ids) else 0.0, np.nan)

    def _constant(self, name: str) -> tuple[Ints, Floats]:
        """Ids of elements and the attribute on each."""
        own = {"order": self._orders, "composite": self._composites, "h": self._sizes}
        if name in own:
            return own[name]()
        if name == "jacobian_sign":
            maps, space = geometry(self._dataset), self._dataset.mesh.space
            ids = joined_ints(block.element_ids for block in maps)
            return ids, joined_floats(statuses(block, space) for block in maps)
        if name in self._dataset.borrowed:
            blocks = self._dataset.field(name).blocks
            ids = joined_ints(block.element_ids for block in blocks)
            return ids, joined_floats(block.coefficients[:, 0] for block in blocks)
        return self._measured(name)

    def _measured(self, name: str) -> tuple[Ints, Floats]:
        """Ids of elements, and a function of a field on each."""
        found = measured_of(name)
        assert found is not None
        function, field = found
        if function == "jump":
            return jumps(self._dataset, field)
        if function == "recovered_error":
            from elvis.core.resolution.gradient_errors import gradient_errors

            return gradient_errors(self._dataset, field)
        from elvis.core.resolution.decay_rates import LOWEST_ORDER
        from elvis.core.resolution.element_resolution import element_resolution

        measures = element_resolution(self._dataset, field)
        if function == "tail":
            return measures.element_ids, measures.tail
        highest = int(measures.orders.max())
        if highest < LOWEST_ORDER:
            raise ElvisError(f"decay({field}): expected a field of order {LOWEST_ORDER} or more, found order {highest}")
        return measures.element_ids, measures.decay

    def _composites(self) -> tuple[Ints, Floats]:
        return composites(self._dataset)

    def _sizes(self) -> tuple[Ints, Floats]:
        return sizes(self._dataset)

    def _orders(self) -> tuple[Ints, Floats]:
        """Ids of elements and the highest degree of a field on each."""
        own = (field for field in self._dataset.fields if field.name not in self._dataset.borrowed)
        blocks: list[Block | GeometryBlock] = [block for field in own for block in field.blocks]
        blocks = blocks or [*geometry(self._dataset)]
        ids = joined_ints(block.element_ids for block in blocks)
        degrees = np.repeat([max(block.expansion.modes) - 1.0 for block in blocks], list(map(len, blocks)))
        every, place = np.unique(ids, return_inverse=True)
        highest = np.zeros(len(every))
        np.maximum.at(highest, place, degrees)
        return every, highest


def _on_side(name: str, patch: Patch, rows: Ints, points: Floats) -> Floats:
    duals = tangents.duals(pointwise.jacobians(patch, rows, points))
    return of_side(name, side_gradients(patch.shape, points, duals))


def _dual(name: str, patch: Patch, rows: Ints, points: Floats) -> Floats:
    """(n,) one of DUALS."""
    direction, axis = int(name[2]) - 1, "xyz".index(name[-1])
    found = tangents.duals(pointwise.jacobians(patch, rows, points))
    return found[:, axis, direction] if direction < found.shape[2] else np.zeros(len(rows))


def _scale(patch: Patch, rows: Ints, points: Floats) -> Floats:
    jacobians = pointwise.jacobians(patch, rows, points)
    with np.errstate(divide="ignore", invalid="ignore"):
        lengths = np.sqrt((jacobians**2).sum(axis=1)).prod(axis=1)
        return np.asarray(pointwise.determinants(patch, rows, points) / lengths)


def _quality(patch: Patch, rows: Ints, points: Floats) -> Floats:
    """d det(T)^(2/d) / |T|^2 with T the derivative from the ideal element."""
    jacobians = pointwise.jacobians(patch, rows, points)
    d, own = jacobians.shape[2], patch.shape.dimension
    inverse = np.eye(d)
    inverse[:own, :own] = from_ideal(patch.shape)
    determinants = pointwise.determinants(patch, rows, points) * np.linalg.det(inverse)
    with np.errstate(divide="ignore", invalid="ignore"):
        size = ((jacobians @ inverse) ** 2).sum(axis=(1, 2))
        return np.asarray(d * np.maximum(determinants, 0.0) ** (2 / d) / size)


_POINTWISE: Mapping[str, Callable[[Patch, Ints, Floats], Floats]] = {
    "jacobian": pointwise.determinants,
    "scaled_jacobian": _scale,
    "quality": _quality,
    **{name: partial(_on_side, name) for name in SIDES},
    **{name: partial(_dual, name) for name in DUALS},
}
