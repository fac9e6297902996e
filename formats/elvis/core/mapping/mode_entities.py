"""Which Modified modes belong to the vertices, edges, faces and the inside of an element (format notes 2.4).

A mode belongs to the smallest entity outside whose closure it may vanish: vertex modes are 1 at one vertex and 0 at the
others, edge modes vanish on all other edges, face modes on all other faces.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.mapping.solids import volume_modes
from elvis.core.polynomials.expansion import mode_indices, values
from elvis.core.polynomials.interpolation import modified
from elvis.core.shapes import Shape


@dataclass(frozen=True, eq=False)
class Entities:
    """Mode numbers of the entities of an element, each group in its own order.

    vertices  (n_vertices,)  in the order of the shape
    edges     for each edge of the shape, its modes 2, 3, ...
    faces     for each face of a solid, its interior modes; for a 2D shape none
    inside    the rest
    """

    vertices: Ints
    edges: tuple[Ints, ...]
    faces: tuple[Ints, ...]
    inside: Ints


@bounded_cache
def face_grid(shape: Shape, face: int, modes: int) -> tuple[Ints, Ints]:
    """Modes (k,) of the square p * modes + q that a local face has, and the modes (k,) of the solid that carry them."""
    numbers = np.full((modes,) * 3, -1)
    numbers[tuple(mode_indices(modified(shape, (modes,) * 3)).T)] = np.arange(
        len(mode_indices(modified(shape, (modes,) * 3)))
    )
    p, q = np.divmod(np.arange(modes * modes), modes)
    valid = np.flatnonzero((len(shape.faces[face]) == 4) | (p + q < modes))
    return frozen_ints(valid), frozen_ints(numbers[tuple(volume_modes(shape, face, p[valid], q[valid]))])


@bounded_cache
def entities(shape: Shape, modes: int) -> Entities:
    """The groups of modes of the Modified expansion with ``modes`` modes each way."""
    index = mode_indices(modified(shape, (modes,) * shape.dimension))
    vertices = np.array([np.flatnonzero((index == (v > 0)).all(axis=1))[0] for v in shape.vertices])
    if shape is Shape.SEGMENT:
        return Entities(frozen_ints(vertices), (), (), frozen_ints(np.arange(2, modes)))
    edges = tuple(frozen_ints(own) for own in (_flat_edges if shape.dimension == 2 else _solid_edges)(shape, modes))
    outer = np.concatenate([vertices, *edges])
    faces: tuple[Ints, ...] = ()
    if shape.dimension == 3:
        grids = [face_grid(shape, face, modes)[1] for face in range(len(shape.faces))]
        faces = tuple(frozen_ints(grid[~np.isin(grid, outer)]) for grid in grids)
    rest = np.setdiff1d(np.arange(len(index)), np.concatenate([outer, *faces]))
    return Entities(frozen_ints(vertices), edges, faces, frozen_ints(rest))


def edge_places(shape: Shape, modes: int) -> list[tuple[int, Ints, Ints]]:
    """For each edge of a 2D shape: where it starts in its natural direction, and p and q of its modes 2, 3, ..."""
    k = np.arange(2, modes)
    zero, one = 0 * k, 0 * k + 1
    if shape is Shape.TRIANGLE:
        return [(0, k, zero), (1, one, k - 1), (0, zero, k)]
    return [(0, k, zero), (1, one, k), (3, k, one), (0, zero, k)]


def _flat_edges(shape: Shape, modes: int) -> list[Ints]:
    numbers = np.full((modes, modes), -1)
    index = mode_indices(modified(shape, (modes,) * 2))
    numbers[tuple(index.T)] = np.arange(len(index))
    return [numbers[p, q] for _, p, q in edge_places(shape, modes)]


def _solid_edges(shape: Shape, modes: int) -> list[Ints]:
    """Edge modes, taken from the first face that contains each edge."""
    found = []
    for ends in shape.edges:
        face = next(i for i, local in enumerate(shape.faces) if set(ends) <= set(local))
        local = shape.faces[face]
        kind = Shape.TRIANGLE if len(local) == 3 else Shape.QUADRILATERAL
        number = next(i for i, pair in enumerate(kind.edges) if {local[pair[0]], local[pair[1]]} == set(ends))
        _, p, q = edge_places(kind, modes)[number]
        valid, carried = face_grid(shape, face, modes)
        found.append(carried[np.searchsorted(valid, p * modes + q)])
    return found


def vertex_functions(shape: Shape, points: Floats) -> Floats:
    """(n, k) the functions of order 1 that are 1 at one vertex of a shape and 0 at others, at points (n, d)."""
    table = values(modified(shape, (2,) * shape.dimension), points)
    return np.asarray(table[:, entities(shape, 2).vertices])
