"""Boundary conditions of CGNS files as sides of cells.

Layout: SIDS, "Boundary Condition Structure Definition".  Sides are triples of arrays: number of a group of cells in the
zone, row in it, and our local side.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.converters.cgns.tree import Node
from elvis.converters.cgns.zones import Group, Zone
from elvis.converters.shared.inputs import check_rows
from elvis.core.base.arrays import Bools, Ints, distinct_bits, distinct_rows, joined_ints
from elvis.core.base.errors import FormatError
from elvis.core.base.rows import Rows
from elvis.plugins.projection.naming import local_sides

#: direction of a structured zone across which the faces lie
_AXES = {"IFaceCenter": 0, "JFaceCenter": 1, "KFaceCenter": 2}

#: beginnings of conditions on lines and points, which have no sides
_DEGENERATE = ("BCDegenerate", "BCAxisymmetricWedge", "BCSymmetryPolar")


@dataclass(frozen=True, eq=False)
class SideList(Rows):
    """Sides of cells: ``groups``, ``rows`` and local ``sides``, (n,) each."""

    groups: Ints
    rows: Ints
    sides: Ints

    def parts(self) -> Iterator[tuple[int, Ints, Ints]]:
        """Number of each group, with rows and local sides in it."""
        for group in np.unique(self.groups).tolist():
            here = self.groups == group
            yield group, self.rows[here], self.sides[here]

    def are_among(self, others: SideList) -> bool:
        """Whether all of them are among others."""
        keys = [np.stack([each.groups, each.rows, each.sides], axis=1) for each in (self, others)]
        _, which = distinct_bits(np.concatenate(keys))
        return bool(np.isin(which[: len(self)], which[len(self) :]).all())

    @classmethod
    def joined(cls, lists: Sequence[SideList]) -> SideList:
        """All of several lists."""
        empty = np.empty(0, np.int64)
        groups = np.concatenate([empty, *(each.groups for each in lists)])
        rows = np.concatenate([empty, *(each.rows for each in lists)])
        sides = np.concatenate([empty, *(each.sides for each in lists)])
        return cls(groups, rows, sides)


class ZoneSides:
    """The sides of the cells of a zone, found by vertices, by numbers of elements or by place in the grid."""

    def __init__(self, zone: Zone) -> None:
        self.zone = zone

    @cached_property
    def _every(self) -> dict[int, tuple[SideList, Ints]]:
        """All sides of cells, and the vertices (n, k) at their corners, by number of corners."""
        found: dict[int, list[tuple[SideList, Ints]]] = {}
        for number, group in enumerate(self.zone.cells):
            count = len(group.numbers)
            for side, columns in enumerate(group.kind.side_corners()):
                own = SideList(np.full(count, number), np.arange(count), np.full(count, side))
                found.setdefault(len(columns), []).append((own, group.nodes[:, columns]))
        return {
            corners: (SideList.joined([own for own, _ in parts]), np.concatenate([table for _, table in parts]))
            for corners, parts in found.items()
        }

    @cached_property
    def _outer(self) -> dict[int, tuple[SideList, Ints]]:
        """Sides of a single cell, in the same form."""
        result = {}
        for corners, (sides, table) in self._every.items():
            _, which = distinct_rows(table)
            is_outer = np.bincount(which)[which] == 1
            result[corners] = sides.part(is_outer), table[is_outer]
        return result

    def outer_vertices(self) -> Bools:
        """(n,) which vertices of the zone are corners of outer sides."""
        marks = np.zeros(self.zone.vertex_count, bool)
        if self.zone.is_structured:
            grid = np.indices(self.zone.sizes[::-1])
            ends = np.array(self.zone.sizes[::-1]).reshape(-1, *[1] * len(self.zone.sizes)) - 1
            return np.asarray(((grid == 0) | (grid == ends)).any(axis=0).reshape(-1))
        for _, table in self._outer.values():
            marks[table.reshape(-1)] = True
        return marks

    def of_vertices(self, marks: Bools) -> SideList:
        """Outer sides all of whose vertices are marked; the nodes inside sides count where any of these is marked."""
        kept = []
        has_inner = bool(marks[self._inner_nodes()].any())
        for sides, table in self._outer.values():
            chosen = sides.part(marks[table].all(axis=1))
            kept.append(self._whole(chosen, marks) if has_inner else chosen)
        return SideList.joined(kept)

    def _inner_nodes(self) -> Ints:
        """Vertices of the zone that are nodes of sides, but no corners."""
        found = [np.empty(0, np.int64)]
        for group in self.zone.cells:
            columns = np.unique(np.concatenate(group.kind.side_nodes()))
            found.append(group.nodes[:, np.setdiff1d(columns, group.kind.corners)].reshape(-1))
        return np.unique(np.concatenate(found))

    def _whole(self, sides: SideList, marks: Bools) -> SideList:
        """The sides whose nodes are all marked."""
        keep = np.zeros(len(sides), bool)
        for number, group in enumerate(self.zone.cells):
            for side, columns in enumerate(group.kind.side_nodes()):
                here = np.flatnonzero((sides.groups == number) & (sides.sides == side))
                keep[here] = marks[group.nodes[sides.rows[here]][:, columns]].all(axis=1)
        return sides.part(keep)

    def of_elements(self, groups: Sequence[Group]) -> tuple[SideList, int]:
        """Sides of cells that have the corners of elements of one dimension less, and how many of these no cell has."""
        found, lost = [], 0
        wanted: dict[int, list[Ints]] = {}
        for group in groups:
            wanted.setdefault(len(group.kind.corners), []).append(group.nodes[:, group.kind.corners])
        for corners, tables in wanted.items():
            asked = np.concatenate(tables)
            if corners not in self._every:
                lost += len(asked)
                continue
            sides, table = self._every[corners]
            _, which = distinct_rows(np.concatenate([table, asked]))
            own, other = which[: len(table)], which[len(table) :]
            found.append(sides.part(np.isin(own, other)))
            lost += int((~np.isin(other, own)).sum())
        return SideList.joined(found), lost

    def of_faces(self, axis: int, faces: Ints) -> SideList:
        """Sides of a structured zone's cells on faces across a direction, whose indices (n, d) count from 0."""
        cells = np.array(self.zone.cell_sizes)
        steps = np.cumprod([1, *cells[:-1]])
        vertices = self.zone.cells[0].kind.shape.vertices
        local = local_sides(self.zone.cells[0].kind.shape)
        found = []
        for end, shift in ((1, -1), (-1, 0)):  # the cell before the face touches it with its last side
            own = faces.copy()
            own[:, axis] += shift
            own = own[((own >= 0) & (own < cells)).all(axis=1)]
            (side,) = (i for i, each in enumerate(local) if (vertices[list(each), axis] == end).all())
            count = len(own)
            found.append(SideList(np.zeros(count, np.int64), own @ steps, np.full(count, side)))
        return SideList.joined(found)


@dataclass(frozen=True, eq=False)
class Numbers:
    """Numbers of elements of a zone, from 0: two ends of a range, or a list."""

    own: Ints
    is_range: bool

    def hold(self, numbers: Ints) -> Bools:
        """(n,) which of the numbers are among these."""
        if self.is_range:
            return np.asarray((numbers >= self.own[0]) & (numbers <= self.own[1]))
        return np.isin(numbers, self.own)

    @property
    def count(self) -> int:
        """Number of distinct entries."""
        return int(self.own[1] - self.own[0]) + 1 if self.is_range else len(np.unique(self.own))

    def all(self) -> Ints:
        """All of them."""
        return np.arange(self.own[0], self.own[1] + 1) if self.is_range else self.own


def named_points(node: Node, directions: int) -> tuple[Ints, bool, bool]:
    """(n, directions) the indices that a node names, from 0, whether they are ends of a range, and whether elements.

    ElementRange and ElementList are of versions before 3.1, and name elements.
    """
    for name in ("PointRange", "ElementRange", "PointList", "ElementList"):
        own = node.child(name)
        if own is None:
            continue
        raw = own.array()
        points = own.ints(None) if raw is not None and raw.ndim == 1 else own.ints(None, directions)
        if points.size % directions:
            raise FormatError(f"expected {directions} indices of each point, found {points.size}", place=own.place)
        points = points.reshape(-1, directions) - 1
        is_range = name.endswith("Range")
        if is_range and len(points) != 2:
            raise FormatError(f"expected two ends of a range, found {len(points)}", place=own.place)
        return (np.sort(points, axis=0) if is_range else points), is_range, name.startswith("Element")
    return np.empty((0, directions), np.int64), False, False


def named_elements(node: Node) -> Numbers | None:
    """The elements of an unstructured zone that a node names; None if it names vertices, or nothing."""
    points, is_range, is_elements = named_points(node, 1)
    if not len(points) or (_location(node) == "Vertex" and not is_elements):
        return None
    return Numbers(points[:, 0], is_range)


def _location(node: Node) -> str:
    """GridLocation of a node."""
    found = node.child("GridLocation")
    return found.text() if found is not None else "Vertex"


class Condition:
    """A boundary condition and the parts of its zone that it names.

    sides   of the cells
    cells   numbers of cells, if it names cells
    taken   numbers of elements that it names
    warnings  messages about omitted parts
    """

    def __init__(self, node: Node, zone: Zone, sides: ZoneSides) -> None:
        self.node, self.zone, self._sides = node, zone, sides
        self.sides = SideList.joined([])
        self.cells = self.taken = np.empty(0, np.int64)
        self.warnings: list[str] = []
        self._is_degenerate = node.text().startswith(_DEGENERATE)
        if zone.is_structured:
            self._read_structured()
        else:
            self._read_unstructured()
        if not len(self.sides) and not len(self.cells) and not self.warnings and not self._is_degenerate:
            self._leave_out("marks no side of a cell")

    def _leave_out(self, reason: str) -> None:
        self.warnings.append(f"the boundary condition {self.node.name} of {self.zone.name} {reason}, and was skipped")

    def _read_unstructured(self) -> None:
        numbers = named_elements(self.node)
        if numbers is not None:
            self._read_elements(numbers)
            return
        points, is_range, _ = named_points(self.node, 1)
        if not len(points):
            return
        own, count = points[:, 0], self.zone.vertex_count
        check_rows(own, count, "vertices", 1, place=self.node.place)
        marks = np.zeros(count, bool)
        marks[slice(own[0], own[1] + 1) if is_range else own] = True
        self.sides = self._sides.of_vertices(marks)

    def _read_elements(self, named: Numbers) -> None:
        """Sides or cells by the numbers of elements."""
        cells = [group.numbers[named.hold(group.numbers)] for group in self.zone.cells]
        self.cells = joined_ints(cells)
        others = [group.part(np.flatnonzero(named.hold(group.numbers))) for group in self.zone.others]
        self.taken = np.concatenate([self.cells, *(group.numbers for group in others)])
        flat = [g for g in others if g.kind.shape.dimension == self.zone.dimension - 1 and len(g.numbers)]
        self.sides, lost = self._sides.of_elements(flat)
        if lost:
            self.warnings.append(f"{lost} elements of the boundary condition {self.node.name} belong to no cell")
        unknown = named.count - len(self.taken)
        if unknown > 0 and len(self.taken):
            self.warnings.append(f"{unknown} elements of the boundary condition {self.node.name} are in no section")
        if not len(self.taken):
            self._leave_out("names elements that are in no section")
        elif not flat and not len(self.cells):
            self._is_degenerate = True  # points, or lines in space

    def _read_structured(self) -> None:
        directions = len(self.zone.sizes)
        points, is_range, _ = named_points(self.node, directions)
        if not len(points):
            return
        location = _location(self.node)
        if location == "Vertex":
            self._of_vertices(points, is_range)
            return
        axis = _AXES.get(location)
        inward = self._inward()
        if axis is None and inward is not None:
            axis = int(np.flatnonzero(inward)[0])
        faces = _filled(points) if is_range else points
        is_cells = location == "CellCenter"
        if axis is None:
            axis = _flat_axis(faces, self.zone.cell_sizes if is_cells else self.zone.sizes)
        if axis is None or axis >= directions:
            self._leave_out("doesn't define which direction is normal to its faces")
            return
        if is_cells:
            faces = self._beside_cells(faces, axis, inward)
        ends = np.array(self.zone.cell_sizes) - 1 + (np.arange(directions) == axis)
        outside = int(((faces < 0) | (faces > ends)).any(axis=1).sum())
        if 0 < outside < len(faces):
            self.warnings.append(f"{outside} faces of the boundary condition {self.node.name} lie outside of the grid")
        self.sides = self._sides.of_faces(axis, faces)

    def _inward(self) -> Ints | None:
        """InwardNormalIndex, with one number that is not 0."""
        node = self.node.child("InwardNormalIndex")
        if node is None:
            return None
        found = node.ints(len(self.zone.sizes))
        return found if (found != 0).sum() == 1 else None

    def _beside_cells(self, cells: Ints, axis: int, inward: Ints | None) -> Ints:
        """The outer faces of cells at an end of a direction."""
        last = self.zone.cell_sizes[axis] - 1
        is_last = cells[:, axis] == last
        if inward is not None:
            is_last = np.full(len(cells), inward[axis] < 0)
        elif last == 0:
            self._leave_out("names cells that have outer faces at both ends")
            return cells[:0]
        is_outer = is_last | (cells[:, axis] == 0)
        faces: Ints = cells[is_outer].copy()
        faces[:, axis] += is_last[is_outer]
        return faces

    def _of_vertices(self, points: Ints, is_range: bool) -> None:
        """Faces between vertices: the faces of a flat range, or outer faces whose vertices are all listed."""
        sizes = np.array(self.zone.sizes)
        if points.min() < 0 or (points >= sizes).any():
            named = f"{(points.min(axis=0) + 1).tolist()} to {(points.max(axis=0) + 1).tolist()}"
            self._leave_out(f"names vertices {named} of a grid of {sizes.tolist()}")
            return
        if not is_range:
            marks = np.zeros(self.zone.vertex_count, bool)
            marks[points @ np.cumprod([1, *sizes[:-1]])] = True
            self.sides = self._sides.of_vertices(marks)
            return
        flat = np.flatnonzero(points[0] == points[1])
        if len(flat) != 1:
            if len(flat) > 1:
                self._is_degenerate = True
                return
            self._leave_out("is not a face but a part of the grid")
            return
        axis = int(flat[0])
        ends = points.copy()
        ends[1] -= np.arange(len(sizes)) != axis  # a range of vertices has one face fewer
        self.sides = self._sides.of_faces(axis, _filled(ends))


def _filled(ends: Ints) -> Ints:
    """(n, d) all indices of a range."""
    axes = [np.arange(low, high + 1) for low, high in ends.T]
    return np.stack([axis.reshape(-1) for axis in np.meshgrid(*axes, indexing="ij")], axis=1)


def _flat_axis(points: Ints, sizes: Sequence[int]) -> int | None:
    """The direction along which points all lie at one end of a grid; None if that fits several or none."""
    ends = [{0, size - 1} for size in sizes]
    flat = [i for i, column in enumerate(points.T) if len(set(column[:1].tolist())) and np.ptp(column) == 0]
    at_end = [i for i in flat if int(points[0, i]) in ends[i]]
    if len(at_end) > 1:  # a face has an index beyond the range of cells only along its own direction
        at_end = [i for i in at_end if points[0, i] == sizes[i] - 1]
    return at_end[0] if len(at_end) == 1 else flat[0] if len(flat) == 1 else None
