"""Composites: parts of the domain, and the boundaries that a source names."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np

from elvis.core.base.arrays import Ints, distinct_sides, frozen_ints, uses_of
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.data.mesh import PERIODIC, Composite, Mesh
from elvis.core.shapes import Shape
from elvis.plugins.conversion.plugin import Boundary, Converter
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.frames import orders
from elvis.plugins.projection.sides import Sides

#: what boundaries without a name of their own are called
OUTER = "boundary"

#: names of boundaries that a source knows by their numbers
_NUMBERED = re.compile(r"(?:boundary|physical|sides) ?([0-9]{1,9})")

_TAGS = {1: "V", 2: "E", 3: "F"}


@dataclass(frozen=True, eq=False)
class Naming:
    """The composites of a mesh.

    composites  parts of the domain, then boundaries
    domain      ids of the composites that form the domain
    notes       sentences on names that match nothing
    outline     name of the last composite if it contains the sides that the source doesn't name, else None
    mortars     (n,) rows of the sides that the source declares non-conforming
    """

    composites: tuple[Composite, ...]
    domain: tuple[int, ...]
    notes: tuple[str, ...]
    outline: str | None
    mortars: Ints


def composites(
    source: Converter, mesh: Mesh, blocks: Sequence[NativeBlock], vertices: Sequence[Ints], numbers: Ints
) -> Naming:
    """All composites.

    vertices  of each block's elements in the source, (n, v) in its local order, to determine outer sides
    numbers   (n_vertices,) the source's number of each vertex of the mesh
    """
    # the source's own numbers of boundaries are the ids of their composites; all others get the remaining ids
    own = _own_numbers(source.boundaries)
    taken = frozenset(own.values())
    free = (number for number in count() if number not in taken)
    domain = [Composite(next(free), ((shape.tag, frozen_ints(ids)),), name) for shape, name, ids in _regions(blocks)]

    # the boundaries that the source names
    notes: list[str] = []
    boundaries: list[tuple[str, Ints, int | None]] = []
    known = Sides(mesh, numbers)
    for i, boundary in enumerate(source.boundaries):
        rows, lost = _boundary_rows(boundary, mesh, blocks, known)
        if lost:
            notes.append(f"{lost} entries of the boundary {boundary.name!r} are sides of no element")
        boundaries.append((boundary.name, rows, own.get(i)))

    # outer sides that none of them has make one more
    named = _concatenate([rows for _, rows, _ in boundaries])
    outer = _concatenate(
        [_mesh_rows(mesh, blocks[i], rows, sides) for i, rows, sides in _outer_sides(blocks, vertices)]
    )
    periodic = known.repeated(outer)
    unnamed = np.setdiff1d(np.setdiff1d(outer, named), periodic)
    boundaries += [(PERIODIC, periodic, None), (OUTER, unnamed, None)]

    tag = _TAGS[mesh.dimension]
    every = list(domain)
    for shape, name, ids in _other_regions(blocks):
        every.append(Composite(next(free), ((shape.tag, frozen_ints(ids)),), name))
    for name, rows, number in boundaries:
        if len(rows):
            every.append(Composite(next(free) if number is None else number, ((tag, frozen_ints(rows)),), name))
    mortars = _concatenate([_mesh_rows(mesh, blocks[i], rows, sides) for i, rows, sides in source.mortars])
    outline = OUTER if len(unnamed) else None
    return Naming(tuple(every), tuple(each.id for each in domain), tuple(notes), outline, mortars)


def _own_numbers(boundaries: Sequence[Boundary]) -> dict[int, int]:
    """The number of each boundary that has one that no other has, by its place among them."""
    found: dict[int, list[int]] = {}
    for i, boundary in enumerate(boundaries):
        name = _NUMBERED.fullmatch(boundary.name)
        number = int(name[1]) if boundary.number is None and name else boundary.number
        if number is not None and number >= 0:
            found.setdefault(number, []).append(i)
    return {places[0]: number for number, places in found.items() if len(places) == 1}


def _concatenate(rows: Sequence[Ints]) -> Ints:
    """All rows; there may be none."""
    return np.concatenate([np.empty(0, np.int32), *rows])


def _regions(blocks: Sequence[NativeBlock]) -> Iterator[tuple[Shape, str, Ints]]:
    """Shape, name and element ids of each part of the domain: one a shape and region, in the order of the blocks."""
    parts: dict[tuple[Shape, str], list[Ints]] = {}
    for block in blocks:
        if len(block):
            parts.setdefault((block.shape, block.source.region), []).append(block.ids)
    for (shape, region), ids in parts.items():
        yield shape, region or shape.label.lower(), np.concatenate(ids)


def _other_regions(blocks: Sequence[NativeBlock]) -> Iterator[tuple[Shape, str, Ints]]:
    """Further regions as in `_regions`: parts of one name together form that region."""
    parts: dict[tuple[Shape, str], list[Ints]] = {}
    for block in blocks:
        for name in block.source.other_regions if len(block) else ():
            parts.setdefault((block.shape, name), []).append(block.ids)
    for (shape, name), ids in parts.items():
        yield shape, name, np.concatenate(ids)


def _boundary_rows(boundary: Boundary, mesh: Mesh, blocks: Sequence[NativeBlock], known: Sides) -> tuple[Ints, int]:
    """Rows of the faces (edges, vertices) of a boundary, ascending, and how many of its entries fit none."""
    found = []
    for i, rows, sides in boundary.sides:
        found.append(_mesh_rows(mesh, blocks[i], np.asarray(rows), np.asarray(sides)))
    lost = 0
    for vertices in boundary.vertices:
        wanted = np.atleast_2d(np.asarray(vertices, np.int64))
        rows, missing = known.matched(wanted)
        found.append(rows)
        lost += missing
    return np.unique(_concatenate(found)), lost


def _mesh_rows(mesh: Mesh, block: NativeBlock, rows: Ints, sides: Ints) -> Ints:
    """Rows of the sides of elements ``rows`` (n,) of the source's block; ``sides`` (n,) in its local numbers."""
    table = _native_sides(block.source.shape, block.is_mirrored)
    native = table[block.order[rows], sides]
    members = mesh.of(block.shape).members[block.mesh_rows[rows]]
    return np.asarray(members[np.arange(len(rows)), native])


def local_sides(shape: Shape) -> tuple[tuple[int, ...], ...]:
    """Local vertices of the sides of a shape: faces of solids, edges of plane shapes, ends of segments."""
    if shape.dimension == 3:
        return shape.faces
    return shape.edges if shape.dimension == 2 else ((0,), (1,))


@bounded_cache
def _native_sides(shape: Shape, is_mirrored: bool) -> Ints:
    """(orders, sides) the native local side that each side of the source's element becomes."""
    sides = [set(side) for side in local_sides(shape)]
    table = []
    for order in orders(shape, is_mirrored):
        native = [{order.index(vertex) for vertex in side} for side in sides]
        table.append([sides.index(side) for side in native])
    return frozen_ints(table)


def _outer_sides(blocks: Sequence[NativeBlock], vertices: Sequence[Ints]) -> Iterator[tuple[int, Ints, Ints]]:
    """Block, rows and local sides of the source's elements that no other element shares."""
    # block, number and local vertices of each side, those with as many corners together
    by_corners: dict[int, list[tuple[int, int, tuple[int, ...]]]] = {}
    for i, block in enumerate(blocks):
        for side, local in enumerate(local_sides(block.source.shape)):
            by_corners.setdefault(len(local), []).append((i, side, local))

    for views in by_corners.values():
        _, which = distinct_sides([(vertices[i], local) for i, _, local in views])
        is_single = (uses_of(which, 1 + int(which.max(initial=-1))) == 1)[which]
        ends = np.cumsum([len(vertices[i]) for i, _, _ in views])[:-1]
        for (i, side, _), part in zip(views, np.split(is_single, ends), strict=True):
            rows = np.flatnonzero(part)
            yield i, rows, np.full(len(rows), side)
