"""Boxes of eta in elements, and Gauss points in them.

Fields, map and their derivatives in xi are polynomials of eta.  Their values at a lattice of Gauss points of the whole
piece determine them; values in a smaller box follow by interpolation in one direction after the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.rows import Rows
from elvis.core.integrals.reference_cells import Piece, box_rule
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees
from elvis.core.polynomials.collapse import collapse_jacobian
from elvis.core.polynomials.cubature import COLLAPSE
from elvis.core.polynomials.jacobi import jacobi
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities.elements.points import ElementPoints, Lattice

#: boxes smaller than this share of the element are not bisected, since points in them could not be distinguished
_LEAST_SIDE = 2.0**-43


def lattice_counts(piece: Piece) -> tuple[int, ...]:
    """Points in each direction of eta that determine fields, map, their derivatives in xi and the fold of the shape.

    Without Fourier directions.  A side has the largest degree of any direction in each of its own.
    """
    expansions = [own for own in (piece.patch.geometry, *piece.patch.fields) if own is not None]
    degrees = [box_degrees(bernstein_space(own)) for own in expansions]
    most = [max(column) for column in zip(*degrees, strict=True)]
    own = [max(most)] * piece.shape.dimension if piece.is_side else most
    return tuple(max(degree, fold) + 1 for degree, fold in zip(own, COLLAPSE[piece.shape], strict=True))


@bounded_cache
def to_legendre(count: int) -> Floats:
    """(count, count) Legendre coefficients, in rows, from values at Gauss points: (2 k + 1)/2 sum_j w_j P_k(x_j) u_j.

    Exact, since the rule is exact for P_k times a polynomial of degree count - 1.
    """
    nodes, weights = gauss(count)
    factors = (2 * np.arange(count) + 1) / 2
    return frozen_floats(factors[:, None] * jacobi(count - 1, 0, 0, nodes) * weights)


@dataclass(frozen=True, eq=False)
class EtaBoxes(Rows):
    """Boxes of eta in elements of a piece.

    rows       (n,)    of the patch
    rounding   (n, e)  of e expressions on the element
    low, high  (n, k)  corners
    """

    piece: Piece
    rows: Ints
    rounding: Floats
    low: Floats
    high: Floats

    @staticmethod
    def whole(piece: Piece, rounding: Floats) -> EtaBoxes:
        """All of a piece."""
        low = np.full((len(piece), piece.dimension), -1.0)
        return EtaBoxes(piece, piece.rows, rounding, low, -low)

    @property
    def volumes(self) -> Floats:
        """(n,) volumes relative to the volume of [-1, 1]^k."""
        return np.asarray(((self.high - self.low) / 2).prod(axis=1))

    def quadrature(self, counts: tuple[int, ...]) -> tuple[ElementPoints, Floats, Ints]:
        """Gauss points in each box, their shares of its measure (n,), and the box of each (n,)."""
        nodes, weights = box_rule(counts)
        eta, box = self.eta(counts), np.repeat(np.arange(len(self)), len(nodes))
        places = self._places(counts, nodes, eta, box)
        shares = self.density(places, eta)
        shares *= np.outer(self.volumes, weights).reshape(-1)
        return places, shares, box

    def eta(self, counts: tuple[int, ...]) -> Floats:
        """(n q, k) Gauss points in each box."""
        nodes, _ = box_rule(counts)
        size = self.high - self.low
        return np.asarray((self.low[:, None] + size[:, None] * (1 + nodes) / 2).reshape(-1, nodes.shape[1]))

    def density(self, places: ElementPoints, eta: Floats) -> Floats:
        """(n q,) measure for each unit of eta at points; for affine maps, determinants are computed once per box."""
        if not self.is_affine:
            return self.piece.measures(places.jacobians, eta)
        count = len(places) // max(len(self), 1)
        stretch = self.piece.stretches(places.jacobians[::count])
        return np.repeat(stretch, count) * collapse_jacobian(self.piece.shape, eta[:, : self.piece.shape.dimension])

    @property
    def is_affine(self) -> bool:
        """Whether all maps are affine."""
        return bool(self.piece.is_affine.all()) and self.piece.patch.homogeneous is None

    def _places(self, counts: tuple[int, ...], nodes: Floats, eta: Floats, box: Ints) -> ElementPoints:
        if (self.low == -1).all() and (self.high == 1).all():
            return Lattice(self.piece.patch, self.rows, self.piece.points(nodes))
        points = self.piece.points(eta)
        if self.piece.patch.homogeneous is not None:
            return ElementPoints(self.piece.patch, self.rows[box], points)
        return BoxPoints(self, counts, points)

    def halved(self, directions: Bools) -> EtaBoxes:
        """Halves of all boxes in the requested directions (n, k); in other directions they are unchanged."""
        boxes, wanted = self, directions
        for axis in range(directions.shape[1]):
            upper = np.flatnonzero(wanted[:, axis])
            every = np.concatenate([np.arange(len(boxes)), upper])
            middle = (boxes.low[upper, axis] + boxes.high[upper, axis]) / 2
            first, boxes, wanted = len(boxes), boxes.part(every), wanted[every]
            boxes.high[upper, axis] = middle
            boxes.low[first:, axis] = middle
        return boxes

    @property
    def can_be_halved(self) -> Bools:
        """(n, k) whether points in halves can be distinguished."""
        return np.asarray(self.high - self.low > 2 * _LEAST_SIDE)

    def halves(self) -> EtaBoxes:
        """Halves in every direction: 2^k boxes for each."""
        return self.halved(np.ones(self.low.shape, bool))


class BoxPoints(ElementPoints):
    """Gauss points in boxes of a piece's elements, where polynomials have values that are interpolated."""

    def __init__(self, boxes: EtaBoxes, counts: tuple[int, ...], points: Floats) -> None:
        piece = boxes.piece
        super().__init__(piece.patch, np.repeat(boxes.rows, int(np.prod(counts))), points)
        self._known_at, self._is_affine = lattice_counts(piece), boxes.is_affine
        elements, self._element = np.unique(boxes.rows, return_inverse=True)
        self._whole = Lattice(piece.patch, elements, piece.points(box_rule(self._known_at)[0]))
        middle, half = (boxes.low + boxes.high) / 2, (boxes.high - boxes.low) / 2
        self._tables = [
            _interpolation(known, middle[:, axis], half[:, axis], count)
            for axis, (known, count) in enumerate(zip(self._known_at, counts, strict=True))
        ]

    @property
    def positions(self) -> Floats:
        """As in `ElementPoints`."""
        return self._once("positions", lambda: self._inside(self._whole.positions))

    @property
    def jacobians(self) -> Floats:
        """As in `ElementPoints`."""
        return self._once("jacobians", self._jacobians)

    def _jacobians(self) -> Floats:
        if not self._is_affine:
            return self._inside(self._whole.jacobians)
        one = self._whole.jacobians[:: int(np.prod(self._known_at))][self._element]
        return np.repeat(one, len(self) // len(one), axis=0)

    def _values(self, field: int) -> Floats:
        return self._inside(self._whole.derivative(field, 0))

    def reference_gradients(self, field: int) -> Floats:
        """As in `ElementPoints`."""
        return self._inside(self._whole.reference_gradients(field))

    def _inside(self, known: Floats) -> Floats:
        """(n, ...) values at the points, from values at the lattices of the elements.

        The first direction of the lattice becomes a direction of the points, and moves behind the others.
        """
        rest = known.shape[1:]
        found = known.reshape(-1, *self._known_at, int(np.prod(rest)))[self._element]
        boxes = len(found)
        for table in self._tables:
            shape = found.shape
            found = table @ found.reshape(boxes, shape[1], -1)
            found = found.reshape(boxes, table.shape[1], *shape[2:])
            found = np.moveaxis(found, 1, -1)
        return np.ascontiguousarray(np.moveaxis(found, 1, -1)).reshape(-1, *rest)


def _interpolation(known: int, middle: Floats, half: Floats, count: int) -> Floats:
    """(n, count, known) values at Gauss points of the intervals (n,), from those at the Gauss points of [-1, 1]."""
    places = middle[:, None] + half[:, None] * box_rule((count,))[0][:, 0]
    legendre = jacobi(known - 1, 0, 0, places.reshape(-1))
    return (legendre.T @ to_legendre(known)).reshape(len(middle), count, known)
