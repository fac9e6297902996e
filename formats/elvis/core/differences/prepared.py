"""The elements of either dataset with what bounds of differences need of them: nets, affine maps, and their errors.

Coefficients of the files are taken as exact.  Errors of results computed from them follow `polynomials.rounding`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import EPS, Bools, Floats
from elvis.core.mapping.boxes import BoxTree, element_boxes
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_coefficients, bernstein_space, differentiate
from elvis.core.polynomials.boxnets import box_degrees, box_nets
from elvis.core.polynomials.rounding import box_roundings, coefficient_rounding, gamma
from elvis.core.shapes import Shape

#: maximum relative deviation of a map from an affine one; the deviation counts as an error of the inverse map
_NEARLY = 64 * EPS


@dataclass(frozen=True, eq=False)
class Side:
    """Elements of a patch with its only field.

    space         of the field, and ``net`` (n, count) its Bernstein coefficients, off by ``error`` (n,) at most
    box           (n, D, …) nets of the field on the box of eta, and ``box_error`` (n,)
    places        (n, d, D, …) nets of the coordinates there, and ``place_error`` (n, d)
    affine        maps from x to xi, where there are such
    """

    patch: Patch
    space: BernsteinSpace
    net: Floats
    error: Floats
    box: Floats
    box_error: Floats
    places: Floats
    place_error: Floats
    affine: AffineMaps

    @cached_property
    def boxes(self) -> Floats:
        """(n, 6) boxes that hold the elements."""
        return element_boxes(self.patch).astype(np.float64)

    @cached_property
    def tree(self) -> BoxTree:
        """Tree of ``boxes``."""
        return BoxTree.build(self.boxes.astype(np.float32))

    @cached_property
    def slopes(self) -> Floats:
        """(n, d) what the derivatives of the field in each direction of xi don't exceed, in the element."""
        directions = range(self.patch.dimension)
        nets = [differentiate(self.space, self.net, direction)[1] for direction in directions]
        return np.stack([np.abs(net).max(axis=1) for net in nets], axis=1)

    @property
    def degree(self) -> int:
        """The largest of the field in a direction of eta."""
        return max(box_degrees(self.space))

    @property
    def total(self) -> int:
        """The total degree of the field in xi, in which the shape isn't a pyramid."""
        return sum(self.space.degrees)

    def ranges(self) -> tuple[Floats, Floats]:
        """(n,) what the field isn't below and above of in each element."""
        return self.net.min(axis=1) - self.error, self.net.max(axis=1) + self.error


@dataclass(frozen=True, eq=False)
class AffineMaps:
    """Inverse maps xi = (x - origin) @ matrix of elements whose maps are affine.

    origin  (n, d), and ``matrix`` (n, d, d)
    error   (n, d) by how much they are off at the element's own points
    holds   (n,) whether the map is one
    """

    origin: Floats
    matrix: Floats
    error: Floats
    holds: Bools

    @staticmethod
    def of(shape: Shape, places: Floats, place_error: Floats) -> AffineMaps:
        """The affine maps of elements with nets of coordinates (n, d, D, …) that have errors ``place_error`` (n, d)."""
        count, d = places.shape[:2]
        origin, matrix, error = np.zeros((count, d)), np.zeros((count, d, d)), np.zeros((count, d))
        if shape is Shape.PYRAMID or max(places.shape[2:]) > 2:
            return AffineMaps(origin, matrix, error, np.zeros(count, bool))

        # x = origin + B xi through the corners, and xi = B^-1 (x - origin)
        ends = np.where(shape.vertices > 0, 1, 0)
        vertices = np.stack([places[(slice(None), slice(None), *end)] for end in ends], axis=2)
        own = np.hstack([np.ones((len(ends), 1)), shape.vertices])
        fit = vertices @ np.linalg.pinv(own).T
        apart = np.abs(fit @ own.T - vertices).max(axis=(1, 2))
        determinants = np.linalg.det(fit[:, :, 1:])
        holds = (apart <= _NEARLY * np.abs(vertices).max(axis=(1, 2))) & (np.abs(determinants) > 0)
        origin = fit[:, :, 0]
        matrix[holds] = np.linalg.inv(fit[holds][:, :, 1:]).swapaxes(1, 2)

        # A map that is a mean of its corners, with weights at each point, has an inverse whose error is at most the
        # largest error at a corner.  There the inverse is compared with the corner itself.
        away = (vertices - origin[:, :, None]).swapaxes(1, 2)
        off = np.abs(away @ matrix - shape.vertices).max(axis=1)
        size = np.einsum("nd,ndk->nk", np.abs(away).max(axis=1), np.abs(matrix))
        error = off + gamma(d + 3) * (size + 1) + np.einsum("nd,ndk->nk", place_error, np.abs(matrix))
        return AffineMaps(origin, matrix, error, holds)


def sides(held: Sequence[Patch]) -> list[Side] | None:
    """Patches prepared, each with one field; None if one can't be bounded.

    This is the case on curves and surfaces in space, with Fourier directions, and for infinite or undefined numbers.
    """
    found = [_side(patch) for patch in held]
    known = [own for own in found if own is not None]
    return known if len(known) == len(found) else None


def _side(patch: Patch) -> Side | None:
    expansion, coefficients = patch.fields[0], patch.coefficients[0]
    if expansion is None or coefficients is None or patch.periods or not patch.is_flat:
        return None
    if not (np.isfinite(coefficients).all() and np.isfinite(patch.geometry_coefficients).all()):
        return None
    space = bernstein_space(expansion)
    net = bernstein_coefficients(expansion, coefficients)
    error = coefficient_rounding(expansion, coefficients)
    box_error = error + gamma(box_roundings(space)) * np.abs(net).max(axis=1)

    d, maps = patch.dimension, bernstein_space(patch.geometry)
    modal = patch.geometry_coefficients[:, :d]
    points = bernstein_coefficients(patch.geometry, modal)
    place_error = coefficient_rounding(patch.geometry, modal) + gamma(box_roundings(maps)) * np.abs(points).max(axis=2)
    nets = box_nets(maps, points.reshape(-1, points.shape[-1]))
    places = nets.reshape(len(patch), d, *nets.shape[1:])
    affine = AffineMaps.of(patch.shape, places, place_error)
    return Side(patch, space, net, error, box_nets(space, net), box_error, places, place_error, affine)
