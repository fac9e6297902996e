"""The sides of plane elements that are edges: shells have faces before them, and writers of Exodus differ.

The library (ex_get_side_set_node_list.c) numbers the faces of shells and of triangles in space first.  It knows no
faces of quadrilaterals in space, while other writers number these as shells; libMesh gives shells of triangles faces in
a plane too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from elvis.converters.exodus.files import SIDES
from elvis.converters.exodus.pieces import ExodusPiece, is_empty
from elvis.core.base.arrays import Bools, Ints
from elvis.core.shapes import Shape

#: sides of a shell that are its faces, before its edges
FACES_OF_SHELLS = 2
_OPEN = (
    "the sides of plane elements in side sets were read as edges that count from 1, as by the library; they fit on "
    "shells as well, whose edges count from 3, so boundaries may have wrong names"
)


class _PlaneBlock(NamedTuple):
    """A block of plane elements: the first of them, and the places (n, edges, 2) of the ends of their edges."""

    start: int
    edges: Ints


class PlaneSides(NamedTuple):
    """Numbering of the sides of plane elements.

    firsts    for each block of plane elements the number, from 0, of the side that is their first edge
    warnings  a message if side sets fit two ways of counting
    """

    firsts: dict[int, int]
    warnings: tuple[str, ...]


def plane_sides(piece: ExodusPiece) -> PlaneSides:
    """Numbering of the sides of the plane elements of a file."""
    stated: dict[int, int | None] = {}
    blocks: dict[int, _PlaneBlock] = {}
    # discontinuous elements have nodes of their own at the same places
    places = np.unique(piece.places, axis=0, return_inverse=True)[1].reshape(-1)
    for number in piece.file_blocks():
        shape, nodes = piece.connectivity(number)
        if shape is not None and shape.dimension == 2:
            ends = places[nodes][:, np.array(SIDES[shape])]
            blocks[number] = _PlaneBlock(piece.starts[number], np.sort(ends, axis=-1))
            stated[number] = _stated(piece.file.element_type(f"connect{number}"), shape, piece.places.shape[1])
    doubtful = {number for number, first in stated.items() if first is None}
    likely, warnings = _likely(piece, blocks, doubtful) if doubtful else (0, ())
    firsts = {number: likely if first is None else first for number, first in stated.items()}
    return PlaneSides(firsts, warnings)


def _stated(kind: str, shape: Shape, space: int) -> int | None:
    """The first edge of elements of a type; None if writers differ."""
    name = kind.upper()
    if name.startswith("SHELL"):
        return FACES_OF_SHELLS
    if shape is Shape.TRIANGLE and space == 3:
        return FACES_OF_SHELLS
    is_doubtful = space == 3 or name.startswith("TRISHELL")
    return None if is_doubtful else 0


def _likely(piece: ExodusPiece, blocks: dict[int, _PlaneBlock], doubtful: set[int]) -> tuple[int, tuple[str, ...]]:
    """The first edge for which fewer sides of the sets lie inside the mesh.

    The library's choice, with a message, if neither is better.
    """
    outer = _outer(blocks)
    inside = {0: 0, FACES_OF_SHELLS: 0}
    count_of_sides = 0
    for elements, sides in _sets(piece):
        for number in doubtful:
            count = outer[number].shape[1]
            rows = elements - blocks[number].start
            is_own = (rows >= 0) & (rows < len(outer[number]))
            for first in inside:
                edges = sides - first
                is_edge = is_own & (edges >= 0) & (edges < count)
                is_inside = ~outer[number][rows[is_edge], edges[is_edge]]
                # an edge that the elements lack is as wrong as one inside
                inside[first] += int(is_inside.sum() + (is_own & (edges >= count)).sum())
                count_of_sides += int(is_own.sum())
    is_open = bool(count_of_sides) and inside[0] == inside[FACES_OF_SHELLS]
    return min(inside, key=lambda first: (inside[first], first)), (_OPEN,) if is_open else ()


def _sets(piece: ExodusPiece) -> list[tuple[Ints, Ints]]:
    """Elements and sides of the sets that have entries."""
    numbers = piece.file.numbers("num_side_sets")
    return [piece.sides(n) for n in numbers if not is_empty(piece.file, f"elem_ss{n}", f"num_side_ss{n}")]


def _outer(blocks: dict[int, _PlaneBlock]) -> dict[int, Bools]:
    """For each block, (n, edges) whether an edge belongs to only one element."""
    every = np.concatenate([block.edges.reshape(-1, 2) for block in blocks.values()])
    _, which, counts = np.unique(every, axis=0, return_inverse=True, return_counts=True)
    is_single = counts[which.reshape(-1)] == 1
    sizes = [block.edges[..., 0].size for block in blocks.values()]
    parts = np.split(is_single, np.cumsum(sizes)[:-1])
    return {n: part.reshape(block.edges.shape[:2]) for (n, block), part in zip(blocks.items(), parts, strict=True)}
