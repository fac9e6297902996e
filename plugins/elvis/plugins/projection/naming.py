"""Composites: parts of the domain, and the boundaries that a source names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elvis.core.arrays import Ints, frozen_ints
from elvis.core.mesh import Composite, Mesh
from elvis.core.shapes import Shape
from elvis.plugins.conversion import Boundary, Converter
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.frames import orders
from elvis.plugins.projection.sides import Sides

#: what boundaries without a name of their own are called
OUTER = "boundary"

_TAGS = {1: "V", 2: "E", 3: "F"}


def composites(
    source: Converter, mesh: Mesh, blocks: Sequence[NativeBlock], vertices: Sequence[Ints], numbers: Ints
) -> tuple[tuple[Composite, ...], tuple[int, ...], tuple[str, ...]]:
    """All composites, the ids of those that make the domain, and notes on names that fit nothing.

    vertices  of each block's elements as the source has them, (n, v) in its local order, to tell which sides are outer
    numbers   (n_vertices,) the source's number of each vertex of the mesh
    """
    domain = [
        Composite(id, ((shape.tag, frozen_ints(ids)),), name) for id, (shape, name, ids) in enumerate(_regions(blocks))
    ]
    notes, known = list[str](), Sides(mesh, numbers)
    named: list[tuple[str, Ints]] = []
    for boundary in source.boundaries:
        rows, lost = _rows(boundary, mesh, blocks, known)
        if lost:
            notes.append(f"{lost} entries of the boundary {boundary.name!r} are sides of no element")
        named.append((boundary.name, rows))
    outer = [_side_rows(mesh, blocks[i], rows, sides) for i, rows, sides in _outer_sides(blocks, vertices)]
    rest = np.setdiff1d(
        np.concatenate([np.empty(0, np.int64), *outer]), np.concatenate([np.empty(0, np.int64), *(r for _, r in named)])
    )
    found = [(name, rows) for name, rows in (*named, (OUTER, rest)) if len(rows)]
    tag = _TAGS[mesh.dimension]
    sides = [Composite(len(domain) + i, ((tag, frozen_ints(rows)),), name) for i, (name, rows) in enumerate(found)]
    return (*domain, *sides), tuple(range(len(domain))), tuple(notes)


def _regions(blocks: Sequence[NativeBlock]) -> Iterator[tuple[Shape, str, Ints]]:
    """Shape, name and element ids of each part of the domain: one a shape and region, in the order of the blocks."""
    parts: dict[tuple[Shape, str], list[Ints]] = {}
    for block in blocks:
        if len(block):
            parts.setdefault((block.shape, block.source.region), []).append(block.ids)
    for (shape, region), ids in parts.items():
        yield shape, region or shape.label.lower(), np.concatenate(ids)


def _rows(boundary: Boundary, mesh: Mesh, blocks: Sequence[NativeBlock], known: Sides) -> tuple[Ints, int]:
    """Rows of the faces (edges, vertices) of a boundary, ascending, and how many of its entries fit none."""
    found = [_side_rows(mesh, blocks[i], np.asarray(rows), np.asarray(sides)) for i, rows, sides in boundary.sides]
    lost = 0
    for wanted in boundary.vertices:
        rows, missing = known.matched(np.atleast_2d(np.asarray(wanted, np.int64)))
        found.append(rows)
        lost += missing
    return np.unique(np.concatenate([np.empty(0, np.int64), *found])), lost


def _side_rows(mesh: Mesh, block: NativeBlock, rows: Ints, sides: Ints) -> Ints:
    """Rows of the sides of elements ``rows`` (n,) of the source's block; ``sides`` (n,) in its local numbers."""
    table = _native_sides(block)
    native = table[block.order[rows], sides]
    members = mesh.of(block.shape).members[block.mesh_rows[rows]]
    return np.asarray(members[np.arange(len(rows)), native])


def local_sides(shape: Shape) -> tuple[tuple[int, ...], ...]:
    """Local vertices of the sides of a shape: faces of solids, edges of plane shapes, ends of segments."""
    return shape.faces if shape.dimension == 3 else shape.edges if shape.dimension == 2 else ((0,), (1,))


def _native_sides(block: NativeBlock) -> Ints:
    """(orders, sides) the native local side that each side of the source's element becomes."""
    sides = [set(side) for side in local_sides(block.source.shape)]
    taken = orders(block.source.shape, block.is_mirrored)
    return np.array([[sides.index({order.index(j) for j in side}) for side in sides] for order in taken])


def _outer_sides(blocks: Sequence[NativeBlock], vertices: Sequence[Ints]) -> Iterator[tuple[int, Ints, Ints]]:
    """Block, rows and local sides of the source's elements that no other element shares."""
    views = [(i, j, local) for i, b in enumerate(blocks) for j, local in enumerate(local_sides(b.source.shape))]
    for corners in {len(local) for _, _, local in views}:
        own = [view for view in views if len(view[2]) == corners]
        tables = [vertices[i][:, list(local)] for i, _, local in own]
        key = np.sort(np.concatenate(tables), axis=1)
        order = np.lexsort(key.T)
        change = (np.diff(key[order], axis=0) != 0).any(axis=1)
        single = np.empty(len(key), bool)
        single[order] = np.append(True, change) & np.append(change, True)
        ends = np.cumsum([len(table) for table in tables])[:-1]
        for (i, j, _), part in zip(own, np.split(single, ends), strict=True):
            rows = np.flatnonzero(part)
            yield i, rows, np.full(len(rows), j)
