"""Traces: the coefficients of vertices, edges and faces, one set for all elements that share them.

Each entity takes its coefficients from the first of the elements of lowest order around it, and passes them to all of
them.  Elements see a shared face only through sign changes and exchanges (format notes 2.3), so their traces are equal
to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, groups, narrow_ints
from elvis.core.base.threads import results
from elvis.core.data.mesh import Mesh
from elvis.core.mapping.mode_entities import edge_places, face_grid
from elvis.core.mapping.orientation import (
    chunks,
    face_shape,
    face_turns,
    first_face_row,
    orientation_matrix,
    polygon_vertices,
)
from elvis.core.polynomials.expansion import mode_indices
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape
from elvis.plugins.projection.blocks import NativeBlock

T = TypeVar("T")
_FACES = (Shape.TRIANGLE, Shape.QUADRILATERAL)

#: more modes than any element has: initial value for faces without an owner
_NEVER = np.iinfo(np.int64).max

#: numbers in an array of what faces hold
_BATCH = 1 << 18


@dataclass(frozen=True, eq=False)
class _Link:
    """How the elements of a block see one of their faces.

    rows   (n,)  of the faces among all of their kind
    turns  (n,)  how each lies in its element: see `orientation.turned`
    owns   (n,)  elements whose coefficients the face takes
    """

    kind: Shape
    rows: Ints
    turns: Ints
    owns: Bools


class Traces:
    """Vertices, edges and faces of a mesh that collect and distribute coefficients of Modified expansions.

    blocks  of elements with modes (b,) in each direction; those with 0 modes are ignored
    """

    def __init__(self, mesh: Mesh, blocks: Sequence[NativeBlock], modes: Sequence[int]) -> None:
        self.mesh, self.blocks, self.modes = mesh, tuple(blocks), tuple(modes)
        self.most = max(2, *modes)
        self.faces = {kind: polygon_vertices(mesh, kind) for kind in _FACES} if mesh.dimension > 1 else {}
        self.by_order = sorted((i for i in range(len(blocks)) if modes[i]), key=lambda i: modes[i])
        self._face_modes = {kind: np.full(len(rows), _NEVER) for kind, rows in self.faces.items()}
        self._links = dict(self._linked())
        self.edges = {kind: self._edge_links(kind) for kind in self.faces}
        self.vertex_keepers = self._keepers(len(mesh.vertices), lambda kind: self.faces[kind].T)
        edges = len(mesh.of(Shape.SEGMENT)) if self.faces else 0
        self.edge_keepers = self._keepers(edges, lambda kind: [own for own, _ in self.edges[kind]])

    def _linked(self) -> Iterator[tuple[int, list[_Link]]]:
        """The links of each block; blocks of low order own first."""
        for number in self.by_order:
            block = self.blocks[number]
            links: list[_Link] = []
            for local in block.shape.faces if block.shape.dimension > 1 else ():
                links.append(self._link(number, local, len(links)))
            yield number, links

    def _link(self, number: int, local: tuple[int, ...], face: int) -> _Link:
        block, kind = self.blocks[number], face_shape(local)
        if self.mesh.dimension == 2:
            rows, turns = block.mesh_rows, np.zeros(len(block), np.int64)
        else:
            members = self.mesh.of(block.shape).members[block.mesh_rows, face]
            rows = members - first_face_row(self.mesh, kind)
            turns = face_turns(block.vertices[:, list(local)], self.faces[kind][rows])
        free = self._face_modes[kind][rows] == _NEVER
        owns = np.zeros(len(rows), bool)
        first = groups(rows[free])[0]
        owns[np.flatnonzero(free)[first]] = True
        self._face_modes[kind][rows[free]] = self.modes[number]
        return _Link(kind, narrow_ints(rows, len(self.faces[kind])), turns.astype(np.int8), owns)

    def _edge_links(self, kind: Shape) -> list[tuple[Ints, Bools]]:
        """For each local edge of a kind of faces: the edges (n,) and which of them run against its direction."""
        members, starts = self.mesh.of(kind).members, self.mesh.of(Shape.SEGMENT).members[:, 0]
        places = edge_places(kind, 2)
        return [
            (members[:, i], starts[members[:, i]] != self.faces[kind][:, start])
            for i, (start, _, _) in enumerate(places)
        ]

    def _keepers(self, count: int, members: Callable[[Shape], Iterable[Ints]]) -> Ints:
        """(count,) the face that speaks for each vertex or edge: the first of lowest order; none without faces.

        members  of the faces of a kind, one array (n,) a corner or side
        """
        keys, total = np.full(count, _NEVER), sum(map(len, self.faces.values()))
        for kind, modes in self._face_modes.items():
            taken = np.flatnonzero(modes != _NEVER)
            for own in members(kind):
                np.minimum.at(keys, own[taken], modes[taken] * total + first_face_row(self.mesh, kind) + taken)
        return narrow_ints(keys % max(total, 1), total)

    def gather(self, coefficients: Sequence[Floats]) -> Skins:
        """The coefficients of all vertices, edges and faces, from those (n, c, m) of each block."""
        width = next((coefficients[i].shape[1] for i in self.by_order), 1)
        parts = ((i, rows, coefficients[i][rows]) for i in self.by_order for rows in self.batches(width, i))
        return self.taken(parts, width)

    def batches(self, width: int, number: int) -> Iterator[slice]:
        """Rows of a block, as many as let their faces, with ``width`` columns, fit in one batch."""
        return chunks(len(self.blocks[number]), max(1, _BATCH // (width * self.most**2)))

    def taken(self, parts: Iterable[tuple[int, slice | Ints, Floats]], width: int) -> Skins:
        """The same, from numbers of blocks, rows of their elements and the coefficients (k, width, m) of these.

        Threads share the work, for a face, an edge or a vertex is taken from one element; on lines from the last.
        """
        skins = Skins(self, width)
        jobs = (partial(self._take, skins, *part) for part in parts)
        for _ in results(jobs) if self.mesh.dimension > 1 else (job() for job in jobs):
            pass
        return skins

    def _take(self, skins: Skins, number: int, rows: slice | Ints, own: Floats) -> None:
        """Copy coefficients (k, c, m) of the elements ``rows`` of a block to the entities that they own."""
        block, modes = self.blocks[number], self.modes[number]
        if not modes:
            return
        if block.shape.dimension == 1:
            ends = self.mesh.of(Shape.SEGMENT).members[block.mesh_rows[rows]]
            skins.vertices[ends[:, 0]], skins.vertices[ends[:, 1]] = own[:, :, 0], own[:, :, 1]
        for face, link in enumerate(self._links[number]):
            for turn, here in _by_turn(link.turns[rows], np.flatnonzero(link.owns[rows])):
                carried, places, signs = self._view(block.shape, face, modes, turn)
                squares = np.zeros((len(here), skins.width, self.most**2))
                squares[:, :, places] = own[here][:, :, carried] * signs
                skins.put(link.kind, link.rows[rows][here], squares)

    def _view(self, shape: Shape, face: int, modes: int, turn: int) -> tuple[Ints, Ints, Floats]:
        """Modes of an element on a face, their places in the face's own square, and their signs there."""
        if shape.dimension == 2:
            p, q = mode_indices(modified(shape, (modes, modes))).T
            return np.arange(len(p)), p * self.most + q, np.ones(len(p))
        valid, carried = face_grid(shape, face, modes)
        index, signs = orientation_matrix(len(shape.faces[face]), turn, modes)
        p, q = np.divmod(index[valid], modes)
        return carried, p * self.most + q, signs[valid]

    def views(self, number: int, rows: slice, skins: Skins) -> Iterator[tuple[Ints, Ints, Floats]]:
        """Some elements (k,) of a block, modes on one of their faces, and their coefficients (k, c, modes) there.

        rows  of the block that contains these elements
        """
        block, modes = self.blocks[number], self.modes[number]
        if block.shape.dimension == 1:
            ends = self.mesh.of(Shape.SEGMENT).members[block.mesh_rows[rows]]
            yield np.arange(rows.start, rows.stop), np.arange(2), skins.vertices[ends].transpose(0, 2, 1)
            return
        for face, link in enumerate(self._links[number]):
            for turn, here in _by_turn(link.turns[rows], np.arange(rows.stop - rows.start)):
                carried, places, signs = self._view(block.shape, face, modes, turn)
                if block.shape.dimension == 2:  # the inside is the element's own
                    outer = skins.outer[block.shape][places]
                    carried, places, signs = carried[outer], places[outer], signs[outer]
                seen = skins.squares(link.kind, link.rows[rows][here])[:, :, places]
                yield rows.start + here, carried, seen * signs


class Skins:
    """Coefficients of vertices (n, c), of edges (n, c, modes - 2) and of the insides of faces (n, c, k).

    Edges hold their modes 2, 3, ...; faces those at the places ``inside`` of the square of modes.  `squares` puts
    together what a face holds with its border.
    """

    def __init__(self, traces: Traces, width: int) -> None:
        mesh, most = traces.mesh, traces.most
        self._traces, self.width = traces, width
        self.outer = {kind: _outer(kind, most) for kind in _FACES}
        self.inside = {kind: _inside(kind, most) for kind in _FACES}
        self.vertices = np.zeros((len(mesh.vertices), width))
        count = len(mesh.of(Shape.SEGMENT)) if mesh.dimension > 1 else 0
        self.edges = np.zeros((count, width, most - 2))
        self.faces = {kind: np.zeros((len(rows), width, len(self.inside[kind]))) for kind, rows in traces.faces.items()}

    @property
    def blocks(self) -> tuple[NativeBlock, ...]:
        """The blocks of the elements."""
        return self._traces.blocks

    def put(self, kind: Shape, rows: Ints, squares: Floats) -> None:
        """Store the coefficients (k, c, modes^2) of faces ``rows``, and coefficients of their edges and vertices."""
        traces, most = self._traces, self._traces.most
        numbers = first_face_row(traces.mesh, kind) + rows
        self.faces[kind][rows] = squares[:, :, self.inside[kind]]
        for corner, place in enumerate(_corners(kind, most)):
            own = traces.faces[kind][rows, corner]
            kept = np.flatnonzero(traces.vertex_keepers[own] == numbers)
            self.vertices[own[kept]] = squares[kept, :, place]
        for (edges, backwards), places in zip(traces.edges[kind], _edges(kind, most), strict=True):
            kept = np.flatnonzero(traces.edge_keepers[edges[rows]] == numbers)
            own = rows[kept]
            self.edges[edges[own]] = squares[kept][:, :, places] * _signs(backwards[own], most)

    def squares(self, kind: Shape, rows: Ints) -> Floats:
        """(k, c, modes^2) all that faces ``rows`` hold, of their own and from their border."""
        traces, most = self._traces, self._traces.most
        found = np.zeros((len(rows), self.width, most * most))
        found[:, :, self.inside[kind]] = self.faces[kind][rows]
        for corner, place in enumerate(_corners(kind, most)):
            found[:, :, place] = self.vertices[traces.faces[kind][rows, corner]]
        for (edges, backwards), places in zip(traces.edges[kind], _edges(kind, most), strict=True):
            found[:, :, places] = self.edges[edges[rows]] * _signs(backwards[rows], most)
        return found

    def apply(self, coefficients: Sequence[Floats]) -> Floats:
        """Set the coefficients of vertices, edges and faces in every element of every block (n, c, m).

        Returns (c,) the largest difference from the previous coefficients.
        """

        def change(number: int, rows: slice) -> Floats:
            worst, own = np.zeros(self.width), coefficients[number]
            for here, carried, seen in self._traces.views(number, rows, self):
                given, difference = seen.transpose(0, 2, 1), own[here[:, None], :, carried]
                with np.errstate(invalid="ignore"):  # values that are not finite remain so
                    difference -= given
                largest = np.abs(difference, out=difference).max(axis=(0, 1), initial=0)
                worst = np.maximum(worst, largest)
                if largest.any():
                    # what faces share is the same to the last bit, so that the next face finds no difference there
                    own[here[:, None], :, carried] = given
            return worst

        return np.asarray(np.max([np.zeros(self.width), *self._of_batches(change)], axis=0))

    def _of_batches(self, work: Callable[[int, slice], T]) -> Iterator[T]:
        """Results of work on each batch of elements, shared by threads: number of the block, and its rows."""
        traces = self._traces
        return results(partial(work, i, rows) for i in traces.by_order for rows in traces.batches(self.width, i))


def _signs(backwards: Bools, most: int) -> Floats:
    """(n, 1, most - 2) the signs of the modes 2, 3, ... of edges, seen from faces that may have them reversed."""
    return np.where(backwards[:, None, None], (-1.0) ** np.arange(2, most), 1.0)


def _by_turn(turns: Ints, rows: Ints) -> Iterator[tuple[int, Ints]]:
    for turn in np.unique(turns[rows]).tolist():
        yield turn, rows[turns[rows] == turn]


def _corners(kind: Shape, most: int) -> Ints:
    """Places in the square of the vertex modes of a face."""
    p, q = (kind.vertices > 0).astype(np.int64).T
    return np.asarray(p * most + q)


def _edges(kind: Shape, most: int) -> list[Ints]:
    """Places in the square of the modes 2, 3, ... of each edge of a face."""
    return [p * most + q for _, p, q in edge_places(kind, most)]


def _outer(kind: Shape, most: int) -> Bools:
    """(most^2,) which places of the square belong to vertices and edges."""
    marks = np.zeros(most * most, bool)
    marks[np.concatenate([_corners(kind, most), *_edges(kind, most)])] = True
    return marks


def _inside(kind: Shape, most: int) -> Ints:
    """(k,) places of the square that are modes of the face's inside."""
    p, q = mode_indices(modified(kind, (most, most))).T
    return np.setdiff1d(p * most + q, np.flatnonzero(_outer(kind, most)))
