"""Reference elements as unions of images of unit squares and cubes, on which polynomials are tensor polynomials.

A simplex has one image for each vertex, between the midpoints of its edges, faces and itself; a prism uses the images
of its triangle.  Their maps are linear in each coordinate, so degrees are unchanged.  A pyramid is the image of the box
of its collapsed coordinates, in which its functions are polynomials.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.row_products import row_products
from elvis.core.shapes import Shape


@cache
def corners(shape: Shape) -> Floats:
    """(cells, 2, …, 2, d) places of the corners of the cells; for a pyramid in collapsed coordinates."""
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
    points, columns = np.empty_like(places), np.empty((*places.shape, places.shape[1]))
    for number, own in enumerate(_coefficients(shape)):
        here = slice(None) if (cell == number).all() else np.flatnonzero(cell == number)
        products, derivatives = _products(places[here].T)
        points[here] = row_products(products.T, own)
        for axis, derivative in enumerate(derivatives):
            columns[here, :, axis] = (own.T @ derivative).T
    if shape is not Shape.PYRAMID:
        return points, columns
    return uncollapse(shape, points), _unfolding(points) @ columns


def subcell_points(shape: Shape, cell: int, places: Floats) -> Floats:
    """Reference points (n, d) at places (n, d) in [0, 1]^d of one cell."""
    products = np.ones((1, len(places)))
    for own in places.T:
        products = _alternating(products, products * own)
    points = row_products(products.T, _coefficients(shape)[cell])
    return uncollapse(shape, points) if shape is Shape.PYRAMID else points


@cache
def _coefficients(shape: Shape) -> Floats:
    """(cells, 2^d, d) of the maps, by the products of the coordinates of a cell, the last one fastest."""
    found, d = corners(shape), shape.dimension
    for axis in range(1, d + 1):
        low, high = np.take(found, 0, axis), np.take(found, 1, axis)
        found = np.stack([low, high - low], axis)
    return frozen_floats(found.reshape(len(found), -1, d))


def _products(places: Floats) -> tuple[Floats, list[Floats]]:
    """(2^d, n) products of coordinates (d, n), each taken or not, and d of their derivatives."""
    products = np.ones((1, places.shape[1]))
    derivatives = [np.zeros_like(products) for _ in places]
    for axis, own in enumerate(places):
        others = [derivative * own for derivative in derivatives]
        others[axis] = products
        derivatives = [_alternating(*pair) for pair in zip(derivatives, others, strict=True)]
        products = _alternating(products, products * own)
    return products, derivatives


def _alternating(first: Floats, second: Floats) -> Floats:
    """(2 m, n) rows of one and the other (m, n) in turn."""
    return np.stack([first, second], axis=1).reshape(2 * len(first), first.shape[1])


def _unfolding(eta: Floats) -> Floats:
    """(n, 3, 3) derivatives of a pyramid's xi in eta."""
    found = np.zeros((len(eta), 3, 3))
    found[:, 0, 0] = found[:, 1, 1] = (1 - eta[:, 2]) / 2
    found[:, 0, 2], found[:, 1, 2] = -(1 + eta[:, 0]) / 2, -(1 + eta[:, 1]) / 2
    found[:, 2, 2] = 1.0
    return found


def without_apex(nets: Floats, nothing: Floats | float) -> Floats:
    """The nets (n, D, D, D) of g in pyramids' collapsed cubes, of g / (1 - c) instead where g is 0 at the apex.

    There g vanishes on the whole face c = 1 that is the apex, next to which no halving shows a graph.  The quotient h
    has its sign and its other zeros: with g of degree m in c, h_k = g_k m / (m - k), whose degree is raised to m.

    nothing  (n,) below which values are 0
    """
    degree = nets.shape[3] - 1
    result, k = nets.copy(), np.arange(degree + 1)
    for _ in range(degree):
        size = np.abs(result).max(axis=(1, 2, 3))
        at_apex = np.abs(result[..., -1]).max(axis=(1, 2))
        here = np.flatnonzero((at_apex <= nothing) & (size > nothing))
        if not len(here):
            break
        quotient = result[here][..., :-1] * degree / (degree - k[:-1])
        below = np.concatenate([quotient[..., :1], quotient], axis=3)
        above = np.concatenate([quotient, quotient[..., -1:]], axis=3)
        result[here] = below * k / degree + above * (1 - k / degree)
    return result
