"""Pieces of reference elements that integrals go over: elements themselves, or one of their sides.

A piece has coordinates eta in [-1, 1]^k: the collapsed ones of its shape, then zeta of homogeneous directions.  On
boxes of eta rules are products of Gauss rules; with the map x(xi(eta)), an integral has the integrand f |dx/dxi|
|dxi/deta|.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import EPS, Bools, Floats, Ints, frozen_floats, grid_points
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.data.dataset import Dataset, Expansion
from elvis.core.mapping import tangents
from elvis.core.mapping.geometry import GeometryBlock
from elvis.core.mapping.orientation import face_shape
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees
from elvis.core.polynomials.collapse import collapse_jacobian, uncollapse
from elvis.core.polynomials.evaluation import evaluate_with_gradients
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities.elements.points import Lattice
from elvis.core.shapes import Shape
from elvis.core.validity.validity import are_never_negative

#: rounding of the terms of a map's derivatives, in units of the last place
_ROUNDING = 64
#: points at which the derivatives of maps are compared first
_FEW = 5
#: a positive length for any coordinates
_SMALLEST = 1e-300


@dataclass(frozen=True, eq=False)
class Piece:
    """The corresponding part of some elements of a patch.

    rows    (n,)    of the patch
    shape   of the part
    number  number of the side among the sides of the element's shape; None for the whole element
    is_signed  whether its measure is J instead of |J|, which is negative in inverted elements
    """

    patch: Patch
    rows: Ints
    shape: Shape
    number: int | None = None
    is_signed: bool = False

    def __len__(self) -> int:
        return len(self.rows)

    def part(self, chosen: Ints | Bools) -> Piece:
        """Some of the elements."""
        found = replace(self, rows=self.rows[chosen])
        if "is_affine" in self.__dict__:
            # a cached property, which is not tested again
            found.__dict__["is_affine"] = self.is_affine[chosen]
        return found

    @property
    def is_side(self) -> bool:
        """Whether it is a side of elements, where there are normals."""
        return self.number is not None

    @property
    def has_normals(self) -> bool:
        """Whether there is an outward normal."""
        return self.is_side

    @property
    def dimension(self) -> int:
        """Number of coordinates eta."""
        return self.shape.dimension + len(self.patch.periods)

    @cached_property
    def _frame(self) -> tuple[Floats, Floats]:
        """Origin (d,) and axes (d, k) of the part in its element: xi = origin + axes (1 + xi of the part)/2."""
        corners = self.patch.shape.vertices
        if self.number is None:
            return corners[0], 2.0 * np.eye(self.patch.shape.dimension)
        local = _sides(self.patch.shape)[self.number]
        origin, along, across = (corners[corner] for corner in (local[0], local[1], local[-1]))
        axes = [along - origin] if self.shape is Shape.SEGMENT else [along - origin, across - origin]
        return origin, np.stack(axes, axis=1)

    def points(self, eta: Floats) -> Floats:
        """(n, D) reference points of the elements at coordinates eta (n, k)."""
        own = self.shape.dimension
        return np.hstack([self.places(uncollapse(self.shape, eta[:, :own])), eta[:, own:]])

    def places(self, xi: Floats) -> Floats:
        """(n, d) reference points of the elements at reference points (n, k) of the part's shape."""
        if self.number is None:
            return xi
        origin, axes = self._frame
        return np.asarray(origin + (1 + xi) / 2 @ axes.T)

    def measures(self, jacobians: Floats, eta: Floats) -> Floats:
        """(n,) length, area or volume for each unit of eta (n, k), where elements have Jacobians (n, 3, D)."""
        fold = collapse_jacobian(self.shape, eta[:, : self.shape.dimension])
        return self.stretches(jacobians) * fold

    def stretches(self, jacobians: Floats) -> Floats:
        """(n,) length, area or volume for each unit of reference coordinates, for Jacobians (n, 3, D)."""
        along = self.along(jacobians)
        if not self.is_signed:
            return np.abs(tangents.determinants(along))
        own = along.shape[2]
        return np.asarray(np.linalg.det(along[:, :own, :own]))

    def along(self, jacobians: Floats) -> Floats:
        """(n, 3, k) tangents of the part, from Jacobians (n, 3, D) of elements."""
        if self.number is None:
            return jacobians
        own = self.patch.shape.dimension
        _, axes = self._frame
        return np.concatenate([jacobians[:, :, :own] @ axes / 2, jacobians[:, :, own:]], axis=2)

    def conditions(self, jacobians: Floats) -> Floats:
        """(n,) ratio of coordinates to the size of elements, by which the rounding of lengths is amplified.

        jacobians  (n, 3, D) somewhere in each element
        """
        shortest = np.linalg.norm(self.along(jacobians), axis=1).min(axis=1)
        size = np.abs(self.patch.geometry_coefficients[self.rows]).max(axis=(1, 2))
        # a side that is collapsed to a point or a line is nothing but rounding
        return np.asarray(size / np.maximum(shortest, np.maximum(EPS * size, _SMALLEST)))

    @cached_property
    def is_affine(self) -> Bools:
        """(n,) whether the map's derivative is constant on the whole element, to rounding."""
        patch = self.patch
        if patch.is_linear:
            return np.ones(len(self), bool)
        # a polynomial that is constant at as many points as it has coefficients is constant
        counts = [degree + 1 for degree in box_degrees(bernstein_space(patch.geometry))]
        points = uncollapse(patch.shape, box_rule(tuple(counts))[0])
        coefficients = patch.geometry_coefficients[self.rows]

        # a few of these points are enough for most curved elements
        few = np.unique(np.linspace(0, len(points) - 1, _FEW, dtype=np.int64))
        found = _has_constant_slopes(patch.geometry, coefficients, points[few])
        rest = np.flatnonzero(found)
        found[rest] = _has_constant_slopes(patch.geometry, coefficients[rest], points)
        return found

    @cached_property
    def is_flat(self) -> Bools:
        """(n,) whether the tangents of the part span the same plane, or line, all over, to rounding."""
        degree = max(box_degrees(bernstein_space(self.patch.geometry)))
        eta = box_rule((2 * degree + 1,) * self.shape.dimension)[0]
        eta = np.hstack([eta, np.zeros((len(eta), len(self.patch.periods)))])
        points = self.points(eta)
        jacobians = Lattice(self.patch, self.rows, points).jacobians
        along = self.along(jacobians)[:, :, : self.shape.dimension]
        directions = along[:, :, 0] if along.shape[2] == 1 else np.cross(along[:, :, 0], along[:, :, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        spread = np.ptp(units.reshape(len(self), len(points), 3), axis=1).max(axis=1)
        conditions = self.conditions(jacobians[:: len(points)])
        return np.asarray(spread <= _ROUNDING * EPS * np.maximum(1.0, conditions))

    def is_valid(self, dataset: Dataset) -> Bools:
        """(n,) whether the Jacobian is proved to be its own absolute value all over the element."""
        block = GeometryBlock(self.patch.geometry, self.patch.element_ids[self.rows], self._coefficients)
        return are_never_negative(block, dataset.mesh.space)

    @property
    def _coefficients(self) -> Floats:
        return np.asarray(self.patch.geometry_coefficients[self.rows])


def _has_constant_slopes(geometry: Expansion, coefficients: Floats, points: Floats) -> Bools:
    """(n,) whether maps with coefficients (n, 3, m) have the same derivatives at all points (q, d), to rounding."""
    jacobians = evaluate_with_gradients(geometry, coefficients, points)[1]
    spread = np.ptp(jacobians, axis=2).max(axis=(1, 2))
    return np.asarray(spread <= _ROUNDING * EPS * np.abs(coefficients).max(axis=(1, 2)))


def whole_elements(patches: tuple[Patch, ...]) -> Iterator[Piece]:
    """All elements of patches."""
    for patch in patches:
        yield Piece(patch, np.arange(len(patch)), patch.shape)


def side_shape(shape: Shape, number: int) -> Shape:
    """The shape of a side: a face of a volume, an edge of a plane element."""
    return Shape.SEGMENT if shape.dimension == 2 else face_shape(_sides(shape)[number])


def side_numbers(shape: Shape) -> range:
    """The numbers of the sides of a shape."""
    return range(len(_sides(shape)))


def side_corners(shape: Shape, number: int) -> tuple[int, ...]:
    """The vertices of a side of a shape."""
    return _sides(shape)[number]


def _sides(shape: Shape) -> tuple[tuple[int, ...], ...]:
    return shape.edges if shape.dimension == 2 else shape.faces


@bounded_cache
def box_rule(counts: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Points (n, k) and weights (n,) of the product of Gauss rules on [-1, 1]^k; read-only."""
    lines = [gauss(count) for count in counts]
    points = grid_points(*(nodes for nodes, _ in lines))
    weights = np.ones(1)
    for _, line in lines:
        weights = np.multiply.outer(weights, line).reshape(-1)
    return frozen_floats(points), frozen_floats(weights)
