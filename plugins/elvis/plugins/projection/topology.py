"""The mesh of a source: vertices identified, elements put in native order, faces found, parts named."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from elvis.core.base.arrays import (
    Floats,
    Ints,
    concatenated,
    distinct,
    frozen_floats,
    frozen_ints,
    index_type,
    narrow_ints,
    numbered,
)
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.data.mesh import Entities, Mesh
from elvis.core.mapping.connectivity import connected
from elvis.core.mapping.mode_entities import entities
from elvis.core.mapping.orientation import chunks, even_chunks, local_vertices
from elvis.core.polynomials.expansion import values_and_gradients
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape
from elvis.plugins.conversion.plugin import Converter, Elements
from elvis.plugins.projection.blocks import NativeBlock
from elvis.plugins.projection.frames import orders
from elvis.plugins.projection.naming import composites
from elvis.plugins.projection.numbering import Corners, chosen_orders, conflicting_elements, ranks
from elvis.plugins.projection.vertices import merge_vertices, merging_tolerance, neighbours

#: elements whose places are computed together
_ELEMENTS_AT_ONCE = 1 << 16
#: coefficients of one coordinate of elements whose corners are computed together
_NUMBERS_AT_ONCE = 1 << 19


@dataclass(frozen=True, eq=False)
class Topology:
    """A mesh of straight elements, and the source's blocks in it.

    numbers   (n_vertices,) the source's number of each vertex, -1 where it has none
    repeated  ids of elements with one vertex at several corners
    detached  ids of elements whose triangles could not be collapsed as their neighbours' are
    notes     sentences on sides that boundaries name in vain
    outline   name of the last composite where it holds the sides that the source doesn't name, else None
    mortars   (n,) rows of the sides that the source calls non-conforming
    """

    mesh: Mesh
    blocks: tuple[NativeBlock, ...]
    repeated: Ints
    detached: Ints
    notes: tuple[str, ...] = ()
    outline: str | None = None
    mortars: Ints = field(default_factory=lambda: np.empty(0, np.int64))


@dataclass(eq=False)
class _Draft:
    """A block before the mesh is assembled.

    source    (n, v) unified vertices in the source's local order
    vertices  (n, n_vertices) vertices of the native elements, in the source's order until orders are chosen
    """

    number: int
    elements: Elements
    shape: Shape
    source: Ints
    vertices: Ints
    is_mirrored: bool
    order: Ints = field(default_factory=lambda: np.empty(0, np.int64))

    @property
    def corners(self) -> Corners:
        return Corners(self.shape, self.vertices, self.is_mirrored)


def topology(source: Converter, is_collapsed: Callable[[int], bool]) -> Topology:
    """The topology of a source's blocks.

    is_collapsed  whether hexahedra stand for the pyramids of the block of this number
    ElvisError where there are no elements, elements of several dimensions, or vertices that don't fit.
    """
    blocks = _check(source)
    places = [_corner_places(source, block) for block in blocks]
    tolerance = merging_tolerance(places, source.precision, neighbours)
    numbers, which, vertices = _vertices(blocks, places, tolerance)
    del places
    is_planar = not vertices[:, 2].any()
    drafts = []
    for number, (block, own) in enumerate(zip(blocks, which, strict=True)):
        is_mirrored = _is_left_handed(block.shape, vertices, own, is_planar)
        shape = Shape.HEXAHEDRON if is_collapsed(number) else block.shape
        drafts.append(_Draft(number, block, shape, own, own, is_mirrored))

    pool = _Pool(vertices, numbers)
    repeated = [_part_repeated(draft, pool) for draft in drafts]
    _raise_apexes(drafts, pool)
    detached = _order(drafts, pool)
    return _assemble(source, drafts, pool, repeated, detached)


def given_topology(source: Converter, mesh: Mesh) -> Topology:
    """The source's blocks in a mesh that is used unchanged; ElvisError if there are no elements."""
    blocks = []
    for number, block in enumerate(_check(source)):
        rows = np.arange(len(block))
        assert block.ids is not None
        own = mesh.of(block.shape).rows_of(block.ids)
        vertices = local_vertices(mesh, block.shape)[own]
        blocks.append(NativeBlock(number, block, block.shape, vertices, 0 * rows, False, rows, own, block.ids))
    return Topology(mesh, tuple(blocks), np.empty(0, np.int64), np.empty(0, np.int64))


class _Pool:
    """Vertices, and copies of them where elements must not share one."""

    def __init__(self, places: Floats, numbers: Ints) -> None:
        self.places, self.numbers = places, numbers

    def copies(self, vertices: Ints) -> Ints:
        """New vertices at the places of ``vertices`` (...)."""
        first = len(self.places)
        self.places = np.concatenate([self.places, self.places[vertices.reshape(-1)]])
        self.numbers = np.concatenate([self.numbers, self.numbers[vertices.reshape(-1)]])
        return np.arange(first, len(self.places)).reshape(vertices.shape)

    def renumber(self, rank: Ints) -> None:
        """Vertices in the order of their rank (n,)."""
        order = np.argsort(rank)
        self.places, self.numbers = self.places[order], self.numbers[order]


def _check(source: Converter) -> Sequence[Elements]:
    dimensions = {block.shape.dimension for block in source.blocks if len(block)}
    if not dimensions:
        raise FormatError("expected elements to convert, found none")
    if len(dimensions) > 1:
        raise FormatError(f"expected elements of one dimension, found {' and '.join(map(str, sorted(dimensions)))}")
    for number, block in enumerate(source.blocks):
        wanted = (block.count, len(block.shape.vertices))
        if block.vertices is not None and np.shape(block.vertices) != wanted:
            raise FormatError(f"block {number}: expected vertices {wanted}, found {np.shape(block.vertices)}")
        if block.order < 1:
            raise FormatError(f"block {number}: expected a map of order 1 or more, found {block.order}")
    return source.blocks


def _corner_places(source: Converter, block: Elements) -> Floats:
    """(n, v, 3) where the vertices of the source's elements lie."""
    points = block.shape.vertices if block.frame is None else np.asarray(block.frame, np.float64)
    places = np.zeros((len(block), len(points), 3))
    for rows in even_chunks(len(block), _NUMBERS_AT_ONCE // (block.order + 1) ** block.shape.dimension):
        found = np.asarray(source.positions(block.take(rows), points), np.float64)
        count = rows.stop - rows.start
        if found.ndim != 3 or found.shape[:2] != (count, len(points)):
            raise ElvisError(f"positions: expected an array of shape ({count}, {len(points)}, 3), found {found.shape}")
        places[rows, :, : found.shape[2]] = found
    wrong = np.flatnonzero(~np.isfinite(places).all(axis=(1, 2)))
    if len(wrong):
        name = wrong[0] if block.ids is None else block.ids[wrong[0]]
        raise ElvisError(
            f"{block.shape.label.lower()} {name}: expected finite coordinates, found {len(wrong)} elements without"
        )
    return places


def _vertices(
    blocks: Sequence[Elements], places: Sequence[Floats], tolerance: float
) -> tuple[Ints, list[Ints], Floats]:
    """The source's number of each vertex, the vertices of each block's elements, and where they lie."""
    counts = [p.shape[0] * p.shape[1] for p in places]
    most = max((int(block.vertices.max(initial=0)) for block in blocks if block.vertices is not None), default=0)
    stacked = np.full(sum(counts), -1, index_type(most + 1))
    for block, part in zip(blocks, np.split(stacked, np.cumsum(counts)[:-1]), strict=True):
        if block.vertices is not None:
            part[:] = np.reshape(block.vertices, -1)
    corners = [p.reshape(-1, 3) for p in places]
    vertex, where = merge_vertices(stacked, concatenated(corners), tolerance)
    own = np.full(len(where), -1, stacked.dtype)
    own[vertex] = stacked
    parts = np.split(vertex, np.cumsum(counts)[:-1])
    return own, [part.reshape(p.shape[:2]) for part, p in zip(parts, places, strict=True)], where


def _is_left_handed(shape: Shape, places: Floats, elements: Ints, is_planar: bool) -> bool:
    """Whether most elements with vertices (n, v) at ``places`` have a negative Jacobian at their centre."""
    if shape.dimension == 1 or (shape.dimension == 2 and not is_planar) or not len(elements):
        return False
    centre = shape.vertices.mean(axis=0, keepdims=True)
    if shape is not Shape.HEXAHEDRON and shape is not Shape.QUADRILATERAL:
        centre = 0.5 * centre + 0.5 * shape.vertices[:1]
    linear = modified(shape, (2,) * shape.dimension)
    gradients = values_and_gradients(linear, centre)[1][0][:, entities(shape, 2).vertices]
    negative = 0
    for rows in chunks(len(elements), _ELEMENTS_AT_ONCE):
        corners = places[elements[rows]]
        jacobians = np.einsum("evc,dv->ecd", corners[:, :, : shape.dimension], gradients)
        negative += int((np.linalg.det(jacobians) < 0).sum())
    return negative > 0.5 * len(elements)


def _part_repeated(draft: _Draft, pool: _Pool) -> Ints:
    """Rows of elements with a vertex at several corners; they get vertices of their own."""
    is_repeated = np.zeros(len(draft.vertices), bool)
    for part in chunks(len(is_repeated), _ELEMENTS_AT_ONCE):
        ordered = np.sort(draft.vertices[part], axis=1)
        is_repeated[part] = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    rows = np.flatnonzero(is_repeated)
    draft.vertices = draft.vertices.copy()
    draft.vertices[rows] = pool.copies(draft.vertices[rows])
    return rows


def _raise_apexes(drafts: Sequence[_Draft], pool: _Pool) -> None:
    """Hexahedra for pyramids: the apex becomes a vertex above each corner of the base, shared with like neighbours."""
    for draft in drafts:
        if draft.shape is draft.elements.shape:
            continue
        base, apex = draft.vertices[:, :4], np.repeat(draft.vertices[:, 4:], 4, axis=1)
        pairs = np.stack([apex.reshape(-1), base.reshape(-1)], axis=1)
        distinct, which = np.unique(pairs, axis=0, return_inverse=True)
        tops = pool.copies(distinct[:, 0])[which.reshape(-1)].reshape(-1, 4)
        draft.vertices = np.concatenate([base, tops], axis=1)


def _order(drafts: Sequence[_Draft], pool: _Pool) -> list[Ints]:
    """Put every element's vertices in native order and number vertices by rank; rows of the elements detached."""
    rank = ranks([draft.corners for draft in drafts], len(pool.places))
    for draft in drafts:
        corners = draft.corners
        draft.order = chosen_orders(corners, rank)
        table = np.array(_native_orders(draft))
        for part in chunks(len(draft.vertices), _ELEMENTS_AT_ONCE):
            own = draft.vertices[part]
            own[:] = np.take_along_axis(own, table[draft.order[part]], axis=1)
    marks = conflicting_elements([draft.corners for draft in drafts], rank)
    for draft, mark in zip(drafts, marks, strict=True):
        draft.vertices[mark] = pool.copies(draft.vertices[mark])
    rank = np.concatenate([rank, numbered(len(pool.places) - len(rank), len(rank))])
    pool.renumber(rank)
    for draft in drafts:
        draft.vertices = rank[draft.vertices]
    return [np.flatnonzero(mark) for mark in marks]


def _native_orders(draft: _Draft) -> tuple[tuple[int, ...], ...]:
    """The vertex orders of the native shape; a mirrored pyramid that becomes a hexahedron is mirrored in its base."""
    if draft.shape is draft.elements.shape or not draft.is_mirrored:
        return orders(draft.shape, draft.is_mirrored)
    return ((1, 0, 3, 2, 5, 4, 7, 6),)


def _assemble(
    source: Converter,
    drafts: Sequence[_Draft],
    pool: _Pool,
    repeated: Sequence[Ints],
    detached: Sequence[Ints],
) -> Topology:
    """The mesh, and native blocks with the places of their elements in it."""
    dimension = drafts[0].shape.dimension
    shapes = [shape for shape in Shape.of_dimension(dimension) if any(draft.shape is shape for draft in drafts)]
    stacked = {s: np.concatenate([d.vertices for d in drafts if d.shape is s]) for s in shapes}
    mesh = connected(pool.places, stacked)
    ids = _ids([draft.elements for draft in drafts])
    blocks = tuple(_native(draft, own, first) for draft, own, first in zip(drafts, ids, _firsts(drafts), strict=True))
    kinds = dict(mesh.entities)
    for shape in shapes:
        own = np.concatenate([block.ids for block in blocks if block.shape is shape])
        kinds[shape] = Entities(frozen_ints(own), mesh.of(shape).members)
    mesh = replace(mesh, entities=kinds, vertices=frozen_floats(pool.places), composites=(), domains={})
    naming = composites(source, mesh, blocks, [d.source for d in drafts], pool.numbers)
    return Topology(
        replace(mesh, composites=naming.composites, domains={0: naming.domain}),
        blocks,
        np.concatenate([block.ids[rows] for block, rows in zip(blocks, repeated, strict=True)]),
        np.concatenate([block.ids[rows] for block, rows in zip(blocks, detached, strict=True)]),
        naming.notes,
        naming.outline,
        naming.mortars,
    )


def _native(draft: _Draft, ids: Ints, first: int) -> NativeBlock:
    rows = numbered(len(draft.vertices))
    return NativeBlock(
        draft.number,
        draft.elements,
        draft.shape,
        draft.vertices,
        draft.order,
        draft.is_mirrored,
        rows,
        numbered(len(rows), first),
        ids,
    )


def _firsts(drafts: Sequence[_Draft]) -> list[int]:
    """First number of the elements of each block among all of their shape."""
    counts: dict[Shape, int] = {}
    firsts = []
    for draft in drafts:
        firsts.append(counts.get(draft.shape, 0))
        counts[draft.shape] = firsts[-1] + len(draft.vertices)
    return firsts


def _ids(blocks: Sequence[Elements]) -> list[Ints]:
    """Ids: the source's where they are unique and not negative, else counted from 0."""
    if all(block.ids is not None for block in blocks):
        ids = [np.asarray(block.ids, np.int64) for block in blocks]
        stacked = np.concatenate(ids)
        if stacked.min(initial=0) >= 0 and len(distinct(stacked)) == len(stacked):
            most = int(stacked.max(initial=0))
            return [narrow_ints(own, most + 1) for own in ids]
    firsts = np.cumsum([0, *(len(block) for block in blocks)]).tolist()
    return [numbered(len(block), first) for block, first in zip(blocks, firsts, strict=False)]
