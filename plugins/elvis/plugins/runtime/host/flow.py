"""Lines through the elements of a runtime plugin, by its host evaluation.

Elements with coinciding corners are neighbours.  If their reference coordinates don't agree on the shared side, or if
there is no shared side, as next to smaller elements, the point is searched for.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, rows_by_number, starts_of
from elvis.core.base.errors import ElvisError
from elvis.core.distances.boundaries import ALL
from elvis.core.mapping.boxes import BoxTree
from elvis.core.mapping.inverse import Roots
from elvis.core.mapping.locate import Locator
from elvis.core.mapping.margins import margins
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.quantities import Expression
from elvis.core.shapes import Shape
from elvis.core.streamlines.flow_data import FlowData
from elvis.core.streamlines.neighbours import Neighbours, Sides
from elvis.core.streamlines.seeds import SeedPlaces, check_boundary, part_middles
from elvis.core.streamlines.velocity import Values, Velocity
from elvis.plugins.faces.derived import vertex_numbers
from elvis.plugins.faces.faces import FaceBlock, Faces
from elvis.plugins.runtime.host.evaluation import (
    HostEvaluation,
    evaluate_expression,
    host_evaluations,
    host_evaluations_by_field,
)
from elvis.plugins.runtime.host.patch import HostPatch
from elvis.plugins.runtime.opening import PluginData
from elvis.plugins.runtime.serving import names_of, volumes_of
from elvis.plugins.runtime.volume import corners_of_volume


class HostFlow(FlowData):
    """The elements of what a plugin has opened; ElvisError where it describes them in no NumPy."""

    def __init__(self, opened: PluginData) -> None:
        self.opened = opened
        (self.volume,) = volumes_of(opened, []).values()
        hosts = host_evaluations(self.volume)
        if hosts is None:
            wanted = "parts with a shape and `evaluate`"
            raise ElvisError(f"the plugin {opened.name} lets no lines be followed: expected {wanted}, found others")
        self.patches = tuple(HostPatch(host) for host in hosts)
        self.dimension = self.space = self.volume.dimension
        self.names = replace(names_of(opened), dimension=self.dimension)

    def velocity(self, expressions: Sequence[Expression], others: Sequence[Expression] = ()) -> Velocity:
        """With the fields that expressions have."""
        volumes = volumes_of(self.opened, [*expressions, *others])
        hosts = []
        for own in zip(*(volume.parts for volume in volumes.values()), strict=True):
            found = host_evaluations_by_field(dict(zip(volumes, own, strict=True)))
            assert found is not None
            hosts.append(found)
        return HostVelocity(self.patches, hosts, expressions, others)

    def neighbours(self, velocity: Velocity) -> Neighbours:
        """Neighbours by coinciding corners, with the boundaries that the plugin names."""
        vertices = vertex_numbers([patch.host for patch in self.patches])
        sides = _side_numbers([patch.shape for patch in self.patches], vertices)
        give = getattr(self.volume, "faces", None)
        faces: Faces = Faces([], []) if give is None else give()
        count = max(int(own.max(initial=-1)) for own in sides) + 1
        boundary = np.full(count, -1)
        for block in faces.blocks:
            own = sides[block.part][block.element, _side_of_faces(self.patches[block.part], block)[block.local]]
            for number, entities in enumerate(faces.boundaries.values()):
                boundary[own[np.isin(block.entity, entities)]] = number
        return Neighbours(self.patches, vertices, sides, tuple(faces.boundaries), boundary)

    def locator(self, velocity: Velocity) -> Locator:
        """Locator by Newton's method from nearby points."""
        return HostLocator(self.patches)

    def seed_places(self, velocity: Velocity, locator: Locator) -> SeedPlaces:
        """With the boundaries that the plugin names, and all outer sides."""
        neighbours = self.neighbours(velocity)

        def on_boundary(name: str, count: int) -> Floats:
            check_boundary(name, (ALL, *neighbours.names))
            number = None if name == ALL else neighbours.names.index(name)
            places = [_on_sides(patch, k, neighbours, number, count) for k, patch in enumerate(self.patches)]
            return np.concatenate([np.empty((0, 3)), *places])

        def on_curve(name: str, count: int) -> Floats:
            raise ElvisError(
                f"seeds: expected data with a known map, found data opened by the plugin {self.opened.name}: {name}"
            )

        corners = partial(corners_of_volume, self.volume)
        return SeedPlaces(self.names.dimension, locator, velocity.positions, on_boundary, on_curve, corners)

    def on_wall(
        self, wall: str, texts: Sequence[str] | None, others: Sequence[Expression]
    ) -> tuple[Velocity, Neighbours]:
        """None: ElvisError."""
        found = f"data opened by the plugin {self.opened.name}"
        raise ElvisError(f"lines on the wall {wall}: expected a dataset, found {found}")


class HostVelocity(Velocity):
    """Velocity on a plugin's elements.

    hosts  for each of ``patches`` its elements by field, at least one
    """

    def __init__(
        self,
        patches: Sequence[HostPatch],
        hosts: Sequence[Mapping[str, HostEvaluation]],
        expressions: Sequence[Expression],
        others: Sequence[Expression],
    ) -> None:
        self.patches, self._hosts = tuple(patches), hosts
        self.expressions, self.others = tuple(expressions), tuple(others)

    def is_straight(self, number: int) -> bool:
        """Always false: nothing is known of the map but its values."""
        return False

    def component_fields(self, number: int) -> None:
        """None: nothing is known of fields but their values."""
        return

    def positions(self, patch: Ints, row: Ints, points: Floats) -> Floats:
        """(n, 3) world coordinates."""
        found = np.empty((len(points), 3))
        for number, here in rows_by_number(patch):
            found[here] = self._host(number).evaluate(row[here], points[here])[0]
        return found

    def in_elements(self, number: int, points: Floats) -> Floats:
        """(…, D) the plugin's own coordinates of points (…, D)."""
        return 0.5 * (1 + points) if self._host(number).part.unit else points

    def from_elements(self, number: int, points: Floats) -> Floats:
        """(…, D) points of the plugin's own coordinates (…, D)."""
        return 2 * points - 1 if self._host(number).part.unit else points

    def together(self, expressions: Sequence[Expression], number: int, rows: Ints, points: Floats) -> Iterator[Values]:
        """(n,) values of expressions in elements (n,) of a patch."""
        return (evaluate_expression(each, self._hosts[number], rows, points) for each in expressions)

    def values(self, expression: Expression, patch: Ints, row: Ints, points: Floats) -> Floats:
        """(n,) values of an expression."""
        found = np.empty(len(points))
        for number, here in rows_by_number(patch):
            found[here] = evaluate_expression(expression, self._hosts[number], row[here], points[here])
        return found

    def _at(self, number: int, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        """World velocity (n, 3) and Jacobians (n, 3, D) on elements of one patch."""
        return self._vectors(number, rows, points), self._host(number).derivatives(rows, points)[0]

    def _vectors(self, number: int, rows: Ints, points: Floats) -> Floats:
        """(n, 3) world velocity on elements of one patch."""
        velocity = np.zeros((len(rows), 3))
        for axis, value in enumerate(self.together(self.expressions, number, rows, points)):
            velocity[:, axis] = value
        return velocity

    def _host(self, number: int) -> HostEvaluation:
        """The elements of a patch, with one of the fields."""
        return next(iter(self._hosts[number].values()))


class HostLocator(Locator):
    """Locator for a plugin's elements."""

    patches: tuple[HostPatch, ...]

    def __init__(self, patches: Sequence[HostPatch]) -> None:
        super().__init__((), 0.0)
        self.patches = tuple(patches)
        self.tree = BoxTree.build(np.concatenate([np.asarray(patch.host.part.boxes) for patch in patches]))
        self._starts = starts_of(patches)
        self._ids = np.concatenate([patch.element_ids for patch in patches])
        self._dimension = max(patch.shape.dimension for patch in patches)

    def invert(self, number: int, rows: Ints, points: Floats) -> Roots:
        """Positions of world points (n, 3) in elements (n,) of a patch."""
        reference, status = self.patches[number].invert(rows, points)
        return Roots(reference, margins(self.patches[number].shape, reference), status)

    def _outside_parts(self, world: Floats, point: Ints, element: Ints) -> Bools:
        """(k,) nothing is known of pairs of a point and an element."""
        return np.zeros(len(point), bool)

    def _invert(self, world: Floats, point: Ints, element: Ints, every: bool) -> tuple[Roots, Bools]:
        """Roots for all pairs, none of which was in doubt."""
        patch = np.searchsorted(self._starts, element, side="right") - 1
        roots = Roots.none(len(point), self._dimension)
        for number, here in rows_by_number(patch):
            roots.put(here, self.invert(number, element[here] - self._starts[number], world[point[here]]))
        return roots, np.zeros(len(point), bool)


def _side_numbers(shapes: Sequence[Shape], vertices: Sequence[Ints]) -> list[Ints]:
    """(n, f) numbers of sides, for elements of each shape with vertices (n, v): those with the same corners are one."""
    keys, counts = [], []
    for shape, own in zip(shapes, vertices, strict=True):
        around = shape.edges if shape.dimension == 2 else shape.faces
        for side in around:
            key = np.sort(own[:, list(side)], axis=1)
            keys.append(np.pad(key, ((0, 0), (0, 4 - key.shape[1])), constant_values=-1))
        counts.append(len(around))
    which = np.unique(np.concatenate(keys), axis=0, return_inverse=True)[1].reshape(-1)
    ends = np.cumsum([count * len(own) for count, own in zip(counts, vertices, strict=True)])
    parts = np.split(which, ends[:-1])
    return [part.reshape(count, -1).T for part, count in zip(parts, counts, strict=True)]


def _side_of_faces(patch: HostPatch, block: FaceBlock) -> Ints:
    """(k,) which side of the elements each row of a block's frames is: the one that its middle lies on."""
    # (-1/3, -1/3) lies within triangles and quadrilaterals
    middles = block.frames[:, 0] - block.frames[:, 1:].sum(axis=1) / 3
    own = 2 * middles - 1 if patch.host.part.unit else middles
    sides = Sides.of(patch.shape)
    heights = own[:, : patch.shape.dimension] @ sides.normals.T + sides.offsets
    return np.asarray(np.abs(heights).argmin(axis=1))


def _on_sides(patch: HostPatch, part: int, neighbours: Neighbours, number: int | None, count: int) -> Floats:
    """(n, 3) the middles of equal parts of those sides that belong to a boundary, None for all outer ones."""
    shape, sides = patch.shape, Sides.of(patch.shape)
    rows = np.arange(len(patch))
    found = []
    for side, (origin, corners) in enumerate(zip(sides.origins, sides.corners, strict=True)):
        which = np.full(len(patch), part), rows, np.full(len(patch), side)
        is_meant = neighbours.is_outer(*which) if number is None else neighbours.boundary(*which) == number
        places = part_middles(count, shape.dimension - 1)
        if shape.dimension == 3 and len(shape.faces[side]) == 3:
            places = uncollapse(Shape.TRIANGLE, places)
        steps = shape.vertices[corners[1:]] - origin
        places = origin + 0.5 * (1 + places) @ steps
        meant = np.flatnonzero(is_meant)
        found.append(patch.host.positions(meant, places).reshape(-1, 3))
    return np.concatenate(found)
