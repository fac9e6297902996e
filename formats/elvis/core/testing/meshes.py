"""Small and large meshes of straight elements."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.mesh import Mesh
from elvis.core.mapping.connectivity import connected
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.shapes import Shape

#: proper rotations of the shapes that keep the collapsed vertex or edge, as generators: local vertex j becomes row[j]
_ROTATIONS: Mapping[Shape, tuple[tuple[int, ...], ...]] = {
    Shape.SEGMENT: (),
    Shape.TRIANGLE: ((1, 2, 0),),
    Shape.QUADRILATERAL: ((1, 2, 3, 0),),
    Shape.TETRAHEDRON: (),
    Shape.PYRAMID: ((1, 2, 3, 0, 4),),
    Shape.PRISM: ((2, 3, 0, 1, 5, 4),),
    Shape.HEXAHEDRON: ((1, 2, 3, 0, 5, 6, 7, 4), (1, 5, 6, 2, 0, 4, 7, 3)),
}


def one_element(shape: Shape, space: int = 3) -> Mesh:
    """A single element with the vertices of the reference shape."""
    vertices = np.zeros((len(shape.vertices), 3))
    vertices[:, : shape.dimension] = shape.vertices
    return connected(vertices, {shape: np.arange(len(vertices))[None]}, space)


def rotated(elements: Mapping[Shape, Ints], seed: int) -> dict[Shape, Ints]:
    """The elements, each turned at random; on a mesh they meet with all relative turns."""
    rng = np.random.default_rng(seed)
    result = {}
    for shape, rows in elements.items():
        turned = np.array(rows)
        for turn in [generator for _ in range(4) for generator in _ROTATIONS[shape]]:
            chosen = rng.random(len(turned)) < 0.5
            turned[chosen] = turned[chosen][:, list(turn)]
        result[shape] = turned
    return result


def mixed_plane(seed: int | None = None) -> Mesh:
    """Two quadrilaterals and two triangles that fill [0, 3] x [0, 1]; ``seed`` turns them at random."""
    vertices = [(x, y, 0) for y in (0, 1) for x in (0, 1, 2, 3)]
    elements = {
        Shape.QUADRILATERAL: np.array([[0, 1, 5, 4], [2, 3, 7, 6]]),
        Shape.TRIANGLE: np.array([[1, 2, 6], [1, 6, 5]]),
    }
    return connected(np.array(vertices, float), elements if seed is None else rotated(elements, seed), 2)


#: corners of three unit cubes in a row, then: centre of the third, front corners of a pyramid and a tetrahedron
_VERTICES: list[tuple[float, float, float]] = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1, 2, 3)]
_VERTICES += [(2.5, 0.5, 0.5), (1, -1, 0), (2, -1, 0)]

#: a hexahedron; two prisms; five pyramids in the third cube and one in front; tetrahedra for the rest
_ELEMENTS = {
    Shape.HEXAHEDRON: [[0, 1, 5, 4, 8, 9, 13, 12]],
    Shape.PRISM: [[1, 2, 6, 5, 9, 13], [2, 10, 14, 6, 9, 13]],
    Shape.PYRAMID: [
        [2, 6, 14, 10, 16],
        [2, 3, 7, 6, 16],
        [10, 14, 15, 11, 16],
        [2, 10, 11, 3, 16],
        [6, 7, 15, 14, 16],
        [17, 18, 2, 1, 9],
    ],
    Shape.TETRAHEDRON: [[3, 11, 7, 16], [11, 15, 7, 16], [18, 10, 2, 9]],
}


def mixed_volume(seed: int | None = None) -> Mesh:
    """All volume shapes in one conforming mesh; every pair of shapes that can share a face does so somewhere.

    Three unit cubes in [0, 3] x [0, 1]^2 with a pyramid and a tetrahedron in front; ``seed`` turns elements at random.
    """
    elements = {shape: np.array(rows) for shape, rows in _ELEMENTS.items()}
    return connected(np.array(_VERTICES, float), elements if seed is None else rotated(elements, seed))


#: elements that fill a unit square or cube; corner x + 2 y + 4 z lies at (x, y, z), 8 is the centre
_FILLINGS: Mapping[Shape, list[list[int]]] = {
    Shape.SEGMENT: [[0, 1]],
    Shape.TRIANGLE: [[0, 1, 3], [2, 0, 3]],
    Shape.QUADRILATERAL: [[0, 1, 3, 2]],
    Shape.TETRAHEDRON: [[0, 1, 3, 7], [1, 0, 5, 7], [2, 0, 3, 7], [0, 2, 6, 7], [0, 4, 5, 7], [4, 0, 6, 7]],
    Shape.PYRAMID: [
        [0, 1, 3, 2, 8],
        [4, 6, 7, 5, 8],
        [0, 2, 6, 4, 8],
        [1, 5, 7, 3, 8],
        [0, 4, 5, 1, 8],
        [2, 3, 7, 6, 8],
    ],
    Shape.PRISM: [[0, 1, 3, 2, 4, 6], [1, 5, 7, 3, 4, 6]],
    Shape.HEXAHEDRON: [[0, 1, 3, 2, 4, 5, 7, 6]],
}


def grid(shape: Shape, cells: int) -> Mesh:
    """The unit interval, square or cube as ``cells`` cells each way, each filled with elements of one shape.

    A cell holds 1 segment, 2 triangles, 1 quadrilateral, 6 tetrahedra, 6 pyramids, 2 prisms or 1 hexahedron.
    """
    dimension, side = shape.dimension, cells + 1
    steps = side ** np.arange(dimension)
    corners = np.indices((side,) * dimension).reshape(dimension, -1)[::-1].T
    firsts = np.indices((cells,) * dimension).reshape(dimension, -1)[::-1].T @ steps

    # rows of the corners of every cell, then its centre
    offsets = np.indices((2,) * dimension).reshape(dimension, -1)[::-1].T @ steps
    table = np.column_stack([firsts[:, None] + offsets, len(corners) + np.arange(len(firsts))])
    vertices = np.zeros((len(corners) + (len(firsts) if shape is Shape.PYRAMID else 0), 3))
    vertices[: len(corners), :dimension] = corners / cells
    if shape is Shape.PYRAMID:
        vertices[len(corners) :] = vertices[firsts] + 0.5 / cells
    return connected(vertices, {shape: table[:, _FILLINGS[shape]].reshape(-1, len(shape.vertices))}, dimension)


def scattered(shape: Shape, count: int, seed: int = 0) -> Floats:
    """(count, d) random reference points of a shape, some on its faces, edges and vertices."""
    eta = np.random.default_rng(seed).uniform(-1.2, 1.2, (count, shape.dimension)).clip(-1, 1)
    return uncollapse(shape, eta)
