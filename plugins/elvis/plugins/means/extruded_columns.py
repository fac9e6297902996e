"""Columns of an extruded mesh: elements x(xi, t) = (p(xi), z(t)) along an axis that share a plane map p."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.mapping.mode_entities import vertex_functions
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape

#: deviation from an extruded element, relative to its size, that rounding of maps in single precision explains
TOLERANCE = 1e-5
#: distance of corners of one column, relative to the shortest edge of all plane maps
_NEAR = 1e-2


@dataclass(frozen=True, eq=False)
class Layer:
    """Elements of a patch that are extruded along one of their reference directions.

    rows       (n,) of the patch
    direction  the reference direction
    corners    (n, c, 2) positions of the corners of their plane maps
    heights    (n,) of elements along the axis
    """

    patch: Patch
    rows: Ints
    direction: int
    corners: Floats
    heights: Floats

    @property
    def plan(self) -> Shape:
        """The shape of the plane map."""
        return plan_of(self.patch.shape)

    def points(self, plane: Floats, along: Floats) -> Floats:
        """(q * s, 3) reference points: plane points (q, 2) at places (s,) along the direction, which vary fastest."""
        return extruded_points(plane, along, self.direction)


@dataclass(frozen=True, eq=False)
class Stack:
    """Elements of a layer with columns whose corners they have in one order.

    columns  (n,)
    rows     (n,) of the layer's patch
    order    (c,) for each corner of a column the corner of the element
    """

    layer: Layer
    columns: Ints
    rows: Ints
    order: tuple[int, ...]

    def plane(self, points: Floats) -> Floats:
        """(q, 2) plane points of the elements at plane points (q, 2) of their columns."""
        shape = self.layer.plan
        return np.asarray(vertex_functions(shape, points) @ shape.vertices[list(self.order)])

    def corners_of(self, vertices: Floats) -> set[int]:
        """The corners of columns on which vertices (k, 3) of the elements lie."""
        flat = np.delete(vertices, self.layer.direction, axis=1)
        lies = (self.layer.plan.vertices[list(self.order)][:, None] == flat).all(axis=2).any(axis=1)
        return set(np.flatnonzero(lies).tolist())


@dataclass(frozen=True, eq=False)
class Columns:
    """The columns over plane elements of one shape.

    stacks   the elements
    first    (n, 2) the stack that holds an element of each column whose plane map is used, and the element in it
    heights  (n,)
    """

    shape: Shape
    stacks: tuple[Stack, ...]
    first: Ints
    heights: Floats

    def __len__(self) -> int:
        return len(self.first)


def plan_of(shape: Shape) -> Shape:
    """The shape of plane maps of prisms or hexahedra."""
    return Shape.TRIANGLE if shape is Shape.PRISM else Shape.QUADRILATERAL


def extruded_points(plane: Floats, along: Floats, direction: int) -> Floats:
    """See `Layer.points`."""
    found = np.empty((len(plane), len(along), 3))
    found[:, :, [i for i in range(3) if i != direction]] = plane[:, None]
    found[:, :, direction] = along
    return found.reshape(-1, 3)


def layers_of(patch: Patch, axis: int) -> list[Layer]:
    """The elements of a patch by their direction along a world axis.

    Raises ElvisError for elements that are not extruded along the axis, and other shapes than prisms and hexahedra.
    """
    label = f"--direction {'xyz'[axis]}"
    if patch.shape not in (Shape.PRISM, Shape.HEXAHEDRON):
        expected = f"hexahedra and prisms that are extruded along {'xyz'[axis]}"
        raise ElvisError(f"{label}: expected {expected}, found {len(patch)} {patch.shape.label.lower()}s")
    directions = (1,) if patch.shape is Shape.PRISM else (0, 1, 2)
    ends = [_ends(patch, axis, direction) for direction in directions]
    steepest = np.argmax([np.abs(high - low).min(axis=1) for low, high in ends], axis=0)
    found = []
    for number, direction in enumerate(directions):
        rows = np.flatnonzero(steepest == number)
        if len(rows):
            found.append(_layer(patch, rows, direction, axis))
    return found


def _ends(patch: Patch, axis: int, direction: int) -> tuple[Floats, Floats]:
    """(n, c) coordinates along the axis of the corners at both ends of a reference direction."""
    plane = plan_of(patch.shape).vertices
    points = extruded_points(plane, np.array([-1.0, 1.0]), direction)
    world = evaluate(patch.geometry, patch.geometry_coefficients[:, axis], points).reshape(len(patch), -1, 2)
    return world[..., 0], world[..., 1]


def _layer(patch: Patch, rows: Ints, direction: int, axis: int) -> Layer:
    """Elements that are extruded along a direction; ElvisError for others."""
    flat = [i for i in range(3) if i != axis]
    plan = plan_of(patch.shape)
    corners = len(plan.vertices)
    plane = np.concatenate([plan.vertices, inner_points(plan, max(patch.geometry.modes) + 1)])
    along = np.concatenate([[-1.0, 1.0], gauss(max(patch.geometry.modes))[0]])
    coefficients = patch.geometry_coefficients[rows]
    world = evaluate(patch.geometry, coefficients, extruded_points(plane, along, direction))
    world = world.reshape(len(rows), 3, len(plane), len(along))

    _check_extruded(patch.element_ids[rows], world, axis)
    across, height = world[:, flat], world[:, axis]
    heights = np.abs(height[:, 0, 1] - height[:, 0, 0])
    return Layer(patch, rows, direction, np.swapaxes(across[:, :, :corners, 0], 1, 2), heights)


def _check_extruded(ids: Ints, world: Floats, axis: int) -> None:
    """Raise ElvisError if plane coordinates vary along the direction, or the other one varies across it.

    world  (n, 3, q, s) positions over q plane points, at s places along the direction
    """
    name = "xyz"[axis]
    across = np.delete(world, axis, axis=1)
    deviation = np.ptp(across, axis=3).max(axis=(1, 2)) + np.ptp(world[:, axis], axis=1).max(axis=1)
    relative = deviation / np.ptp(across.reshape(len(world), 2, -1), axis=2).max(axis=1)
    worst = int(relative.argmax())
    if relative[worst] > TOLERANCE:
        position = ", ".join(f"{x:.4g}" for x in world[worst].mean(axis=(1, 2)))
        raise ElvisError(
            f"--direction {name}: expected elements that are extruded along {name}, found element {ids[worst]} near "
            f"({position}), off by {relative[worst]:.2g} of its size"
        )


def columns_of(layers: Sequence[Layer], shape: Shape) -> Columns:
    """The columns over plane elements of a shape; ElvisError if elements of one column have different plane maps."""
    corners = np.concatenate([layer.corners for layer in layers])
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    near = _NEAR * float(edges.min())
    pairs = cKDTree(corners.mean(axis=1)).query_pairs(near, output_type="ndarray")
    graph = sparse.coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (len(corners),) * 2)
    count, owner = connected_components(graph, directed=False)
    _, first = np.unique(owner, return_index=True)
    heights = np.bincount(owner, np.concatenate([layer.heights for layer in layers]), count)

    # corners of a column go round counter-clockwise
    goal = corners[first]
    is_clockwise = _area(goal) < 0
    goal[is_clockwise] = goal[is_clockwise][:, ::-1]

    stacks, start = list[Stack](), 0
    for layer in layers:
        part = owner[start : start + len(layer.rows)]
        start += len(part)
        stacks += _stacks(layer, part, goal[part], near)
    return Columns(shape, tuple(stacks), _first(stacks, count), heights)


def _stacks(layer: Layer, owner: Ints, goal: Floats, near: float) -> list[Stack]:
    """The elements of a layer by the order of their corners; ``goal`` (n, c, 2) has the corners of their columns."""
    order = _orders(layer.corners, goal, near)
    found = []
    for own in np.unique(order, axis=0):
        members = np.flatnonzero((order == own).all(axis=1))
        found.append(Stack(layer, owner[members], layer.rows[members], tuple(own.tolist())))
    return found


def _first(stacks: Sequence[Stack], count: int) -> Ints:
    """(count, 2) for each column the number of a stack, and an element in it."""
    found = np.empty((count, 2), np.int64)
    for number, stack in enumerate(stacks):
        found[stack.columns, 0] = number
        found[stack.columns, 1] = np.arange(len(stack.columns))
    return found


def _area(corners: Floats) -> Floats:
    """(n,) signed areas of polygons with corners (n, c, 2): the shoelace formula."""
    x, y = corners[..., 0], corners[..., 1]
    return np.asarray((x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y).sum(axis=1) / 2)


def _orders(corners: Floats, goal: Floats, near: float) -> Ints:
    """(n, c) for each corner of a goal (n, c, 2) the corner of an element (n, c, 2) that lies there."""
    distance = np.linalg.norm(goal[:, :, None] - corners[:, None], axis=3)
    order = distance.argmin(axis=2)
    is_there = np.take_along_axis(distance, order[..., None], axis=2).max(axis=(1, 2)) <= near
    if not is_there.all():
        raise ElvisError("expected elements on top of one another with the same corners, found others")
    return order


def inner_points(shape: Shape, count: int) -> Floats:
    """Points (q, 2) inside a plane shape."""
    nodes = gauss(count)[0]
    x, y = (own.reshape(-1) for own in np.meshgrid(nodes, nodes))
    if shape is Shape.TRIANGLE:
        x = (1 + x) * (1 - y) / 2 - 1
    return np.stack([x, y], axis=1)
