"""All zeros of as many polynomials as a shape has dimensions, in boxes that form the shape.

Components have no zero in a box where a Bernstein net has one sign.  Nets are combined so that the Jacobian at the
box's centre becomes the unit matrix, which sharpens this test.  If the combination's derivatives stay close to the unit
matrix on the whole box, it has at most one zero, and Newton's method finds it.  Other boxes are bisected.  If all
components are zero on a side, they are first divided by the height over that side.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, grid_points
from elvis.core.base.rows import Rows
from elvis.core.integrals.subcells import corners, subcell_map
from elvis.core.mapping.margins import heights
from elvis.core.polynomials.boxnets import all_half_boxes, all_halves, nets_through
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.net_zeros import (
    BEYOND,
    derivatives,
    has_no_zero,
    inverses,
    is_injective,
    newton_zeros,
    without_walls,
)
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape

#: maximum bisections, in general and next to outer sides, where zeros are expected
_DEPTH, _DEPTH_BESIDE = 14, 7
#: rounding of nets, relative to the element's largest coefficient
_ROUNDING = 1e-13
#: number of boxes of an element, after some bisections, that indicates a line or a surface of zeros
_CROWD = 64

#: places (n, d) in [0, 1]^d to reference coordinates (n, d)
_Map = Callable[[Floats], Floats]


@dataclass(frozen=True, eq=False)
class Boxes(Rows):
    """Boxes in [0, 1]^d: rows (k,) of the patch, ends (k, d), nets (k, d, D, …) and rounding (k, d) of components."""

    rows: Ints
    low: Floats
    high: Floats
    nets: Floats
    rounding: Floats

    def halved(self) -> Boxes:
        """Both halves in every direction."""
        d = self.low.shape[1]
        low, high = all_half_boxes(self.low, self.high)
        nets = all_halves(self.nets.reshape(-1, *self.nets.shape[2:]))
        tiled = np.tile(self.rounding, (2**d, 1))
        return Boxes(np.tile(self.rows, 2**d), low, high, nets.reshape(-1, *self.nets.shape[1:]), tiled)


class ZeroSearch(ABC):
    """The zeros of components in elements of one shape.

    degree     degree of the components in each direction of the boxes, at least 1
    rows, xi   elements and reference coordinates of the zeros
    undecided  rows of elements in which the search ended before every box was decided
    near_boundary  rows of elements where that happened next to an outer side
    """

    def __init__(self, shape: Shape, degree: int) -> None:
        self.shape, self.degree = shape, degree
        self.rows: list[int] = []
        self.xi: list[Floats] = []
        self.undecided: set[int] = set()
        self.near_boundary: set[int] = set()

    @abstractmethod
    def values(self, rows: Ints, lattice: Floats) -> Floats:
        """(n q, d) components in elements (n,) at the same reference points (q, d), an element after the other."""

    @abstractmethod
    def is_outer(self, rows: Ints, touched: Bools) -> Bools:
        """(k,) whether places of elements that touch facets (k, f) are excluded from the search."""

    def run(self, rows: Ints) -> None:
        """Search elements ``rows`` (n,): first whole elements, then the parts of the undecided ones."""
        d = self.shape.dimension
        if not len(rows):
            return
        whole = self._boxes(rows, lambda places: uncollapse(self.shape, 2 * places - 1))
        rows = whole.rows[~has_no_zero(whole.nets, whole.rounding)]
        if not len(rows):
            return
        for cell in range(len(corners(self.shape))):

            def reference(places: Floats, cell: int = cell) -> Floats:
                return subcell_map(self.shape, np.full(len(places), cell), places.reshape(-1, d))[0]

            self._run_in(self._without_walls(self._boxes(rows, reference), reference), reference)

    def _run_in(self, boxes: Boxes, reference: _Map) -> None:
        """Halve boxes until all are decided."""
        for depth in range(_DEPTH + 1):
            boxes = self._isolated(boxes, reference)
            if not len(boxes.rows):
                return
            if depth >= _DEPTH_BESIDE:
                near = self._is_near_boundary(boxes, reference)
                self.near_boundary.update(boxes.rows[near].tolist())
                boxes = boxes.part(~near)
                boxes = self._without_crowds(boxes)
            if depth < _DEPTH:
                boxes = boxes.halved()
        self.undecided.update(boxes.rows.tolist())

    def _without_crowds(self, boxes: Boxes) -> Boxes:
        """Only boxes of elements that have few; elements with many boxes follow a line or a surface of zeros."""
        rows, which, counts = np.unique(boxes.rows, return_inverse=True, return_counts=True)
        crowded = counts > _CROWD
        self.undecided.update(rows[crowded].tolist())
        return boxes.part(~crowded[which.reshape(-1)])

    def _boxes(self, rows: Ints, reference: _Map) -> Boxes:
        """The boxes [0, 1]^d that a map takes into elements, but for those at rest or without numbers."""
        d, nodes = self.shape.dimension, (1 + gauss(self.degree + 1)[0]) / 2
        lattice = grid_points(*[nodes] * d)
        table = self.values(rows, reference(lattice)).reshape(len(rows), len(lattice), d).transpose(0, 2, 1)
        nets = nets_through(table.reshape(-1, len(lattice)), nodes, d).reshape(len(rows), d, *(len(nodes),) * d)
        sizes = np.abs(nets).reshape(len(rows), d, len(lattice)).max(axis=2)
        moving = np.isfinite(sizes).all(axis=1) & (sizes.max(axis=1, initial=0.0) > 0)
        self.undecided.update(rows[~moving].tolist())
        low = np.zeros((len(rows), d))
        return Boxes(rows, low, low + 1, nets, _ROUNDING * sizes).part(moving)

    def _without_walls(self, boxes: Boxes, reference: _Map) -> Boxes:
        """Divided by the heights over sides of the boxes where all components are zero.

        The upper side of a pyramid's box is its apex, noted as a zero unless a side that it belongs to is one.
        """
        nets, on_side = without_walls(boxes.nets, boxes.rounding.max(axis=1, initial=0.0) / _ROUNDING)
        if self.shape is Shape.PYRAMID:
            alone = on_side[:, -1, 1] & ~on_side[:, :-1].any(axis=(1, 2))
            self._note(boxes.rows[alone], reference(np.tile([0.5, 0.5, 1.0], (int(alone.sum()), 1))))
        return Boxes(boxes.rows, boxes.low, boxes.high, nets, boxes.rounding)

    def _isolated(self, boxes: Boxes, reference: _Map) -> Boxes:
        """The boxes that are left when those without a zero are excluded and single zeros are found."""
        boxes = boxes.part(~has_no_zero(boxes.nets, boxes.rounding))
        d = boxes.low.shape[1]
        centre = np.full((len(boxes.rows), d), 0.5)
        slopes = derivatives(boxes.nets, centre)
        inverse = inverses(slopes)
        unit = np.einsum("kij,kj...->ki...", inverse, boxes.nets)
        rounding = np.einsum("kij,kj->ki", np.abs(inverse), boxes.rounding)
        left = ~has_no_zero(unit, rounding)
        boxes, unit = boxes.part(left), unit[left]
        single = np.flatnonzero(is_injective(unit))
        places, sure = newton_zeros(boxes.nets[single])
        hit = single[sure]
        within = boxes.low[hit] + (boxes.high - boxes.low)[hit] * places[sure].clip(0, 1)
        self._note(boxes.rows[hit], reference(within))
        return boxes.part(np.setdiff1d(np.arange(len(boxes.rows)), hit))

    def _note(self, rows: Ints, xi: Floats) -> None:
        """Keep zeros that are not on the outer boundary."""
        inner = ~self.is_outer(rows, heights(self.shape, xi) <= BEYOND)
        self.rows += rows[inner].tolist()
        self.xi += list(xi[inner])

    def _is_near_boundary(self, boxes: Boxes, reference: _Map) -> Bools:
        """(k,) whether boxes touch the outer boundary."""
        d, ends = boxes.low.shape[1], (boxes.low, boxes.high)
        touched = []
        for bits in np.ndindex(*(2,) * d):
            places = np.stack([ends[bit][:, axis] for axis, bit in enumerate(bits)], axis=1)
            touched.append(heights(self.shape, reference(places)) <= BEYOND)
        return np.asarray(np.any([self.is_outer(boxes.rows, corner) for corner in touched], axis=0))
