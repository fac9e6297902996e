"""Reference elements as unions of images of unit squares and cubes, on which polynomials are tensor polynomials.

A simplex has one for each vertex, between the middles of its edges, faces and itself; a prism those of its triangle.
Their maps are linear in each coordinate, so that degrees stay.  A pyramid is the image of the box of its collapsed
coordinates, in which its functions are polynomials.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from elvis.core.arrays import Floats, Ints, frozen_floats
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.shapes import Shape


@cache
def corners(shape: Shape) -> Floats:
    """(cells, 2, …, 2, d) places of the corners of the cells; of a pyramid in collapsed coordinates."""
    d = shape.dimension
    if shape in (Shape.TRIANGLE, Shape.TETRAHEDRON):
        return frozen_floats(_of_simplex(shape.vertices))
    if shape is Shape.PRISM:
        plane = _of_simplex(Shape.TRIANGLE.vertices)
        found = np.empty((3, 2, 2, 2, 3))
        found[..., [0, 2]] = plane[:, :, None, :, :]
        found[..., 1] = np.array([-1.0, 1.0])[None, None, :, None]
        return frozen_floats(found)
    return frozen_floats(np.stack(np.meshgrid(*[[-1.0, 1.0]] * d, indexing="ij"), axis=-1)[None])


def _of_simplex(vertices: Floats) -> Floats:
    """For each vertex the means of it and any of the others."""
    count, d = vertices.shape
    found = np.empty((count, *(2,) * d, d))
    for vertex in range(count):
        others = [(vertex + 1 + k) % count for k in range(d)]
        for bits in np.ndindex(*(2,) * d):
            chosen = [vertex, *(other for other, bit in zip(others, bits, strict=True) if bit)]
            found[(vertex, *bits)] = vertices[chosen].mean(axis=0)
    return found


def subcell_map(shape: Shape, cell: Ints, places: Floats) -> tuple[Floats, Floats]:
    """Reference points (n, d) at places (n, d) in [0, 1]^d of cells (n,), and their derivatives (n, d, d)."""
    d = shape.dimension
    own = corners(shape)[cell]
    values, derivatives = own, [own] * d
    for axis in range(d):
        t = places[:, axis].reshape(-1, *(1,) * (d - axis))
        low, high = values[:, 0], values[:, 1]
        derivatives = [
            part[:, 1] - part[:, 0] if number == axis else part[:, 0] * (1 - t) + part[:, 1] * t
            for number, part in enumerate(derivatives)
        ]
        values = low * (1 - t) + high * t
    columns = np.stack(derivatives, axis=2)
    if shape is not Shape.PYRAMID:
        return values, columns
    return uncollapse(shape, values), _unfolding(values) @ columns


def _unfolding(eta: Floats) -> Floats:
    """(n, 3, 3) derivatives of a pyramid's xi in eta."""
    found = np.zeros((len(eta), 3, 3))
    found[:, 0, 0] = found[:, 1, 1] = (1 - eta[:, 2]) / 2
    found[:, 0, 2], found[:, 1, 2] = -(1 + eta[:, 0]) / 2, -(1 + eta[:, 1]) / 2
    found[:, 2, 2] = 1.0
    return found
