"""Planes in pyramids: bounds of derivatives in boxes of their collapsed coordinates, as there are none at the apex.

The map of a pyramid and its first derivatives in reference coordinates are polynomials of collapsed coordinates
(a, b, c); second derivatives are polynomials over powers of the share (1 - c) / 2 (see
`elvis.plugins.native.regions`).  So a square's derivatives are bounded in the box that contains its centre; boxes get
smaller towards the apex.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise, product
from typing import Any

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, every_pair, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values
from elvis.core.polynomials.collapse import collapse, uncollapse
from elvis.core.shapes import Shape
from elvis.plugins.native.bending import net_of_xi
from elvis.plugins.native.regions import PyramidBoxes
from elvis.plugins.runtime.volume import Slopes
from elvis.renderer.passes.lines.contours.cuts import ELEMENTS, CutChart
from elvis.renderer.passes.lines.contours.squares import ROUNDING, Derivatives, regular

#: layers of boxes, how much nearer to the apex each is than the one before, and boxes along each side of a layer
_LAYERS, _NEARER, _SIDE = 9, 0.6, 2
#: how many times as large as a box its neighbourhood is in which derivatives are bounded
_BEYOND = 2.2
#: the map is sampled up to here, since at the apex itself directions are lost
_HIGHEST = 0.8


class PyramidChart(CutChart):
    """A plane in a part's pyramids (see `squares.Chart`)."""

    def __init__(self, *about: Any) -> None:
        super().__init__(*about)
        self._known: Ints = np.zeros(0, np.int64)
        self._nets: dict[str, Floats] = {}

    def bounds(self, elements: Ints) -> Derivatives:
        """How much the maps of elements (n,) bend; the rest is not a number until places are known (`localised`)."""
        nodes, fit = _nodes(self._space)
        found = []
        places, values = [], []
        for some in chunks(len(elements), ELEMENTS):
            own = elements[some]
            count = len(own)
            samples = self.sample(*every_pair(own, nodes))
            middle = self.sample(own, np.tile(self.center, (count, 1)))
            inverse = np.linalg.inv(regular(middle.jacobian))

            # the map, and the change of its Jacobian relative to the one at the centre
            away = samples.position.reshape(count, -1, 3) - middle.position[:, None]
            places.append(np.einsum("nij,nkj,km->nim", inverse, away, fit))
            values.append(samples.value.reshape(count, -1) @ fit)
            change = inverse[:, None] @ samples.jacobian.reshape(count, -1, 3, 3) - np.eye(3)
            nets = np.einsum("nkij,km->nijm", change, fit)
            bend = np.abs(nets).max(axis=3).sum(axis=2).max(axis=1)
            unknown = np.full(count, np.nan)
            found.append(Derivatives(bend, unknown, unknown, unknown, unknown, middle.position, inverse))
        self._known = elements
        self._nets = {"places": np.concatenate(places), "values": np.concatenate(values)}
        return Derivatives.joined(found)

    def localised(self, bounds: Derivatives, elements: Ints, centre: Floats) -> Derivatives:
        """The bounds of the boxes that contain positions (n, 3) in elements (n,)."""
        box = _box(centre)
        both, row = np.unique(np.stack([elements, box], axis=1), axis=0, return_inverse=True)
        row = row.reshape(-1)
        found = np.full((4, len(both)), np.inf)
        for some in chunks(len(both), ELEMENTS):
            found[:, some] = self._in_boxes(*both[some].T)
        turn, gradient, curvature, noise = found[:, row]
        return Derivatives(bounds.bend, turn, gradient, curvature, noise, bounds.centre, bounds.inverse)

    def _in_boxes(self, elements: Ints, box: Ints) -> Floats:
        """(4, n) turn, gradient, curvature and noise in boxes of elements (n,)."""
        middle, half = np.moveaxis(_boxes()[box], 1, 0)
        half = _BEYOND * half
        space = BernsteinSpace(Shape.HEXAHEDRON, self._space.degrees)
        boxes = PyramidBoxes(space, middle, half)
        rows = np.searchsorted(self._known, elements)
        with np.errstate(all="ignore"):
            places = self._nets["places"][rows]
            turn = _sum(boxes, places, 2).max(axis=1)
            bounds = self.slope_bounds
            if bounds is not None:
                own = bounds.in_boxes(elements - self._loaded.first[self._number], middle, half)
            else:
                values = self._nets["values"][rows]
                size = np.abs(boxes.ends(values, ())).max(axis=0)
                own = Slopes(_sum(boxes, values, 1), _sum(boxes, values, 2), ROUNDING * size)
        return np.stack([turn, own.gradient, own.curvature, own.noise])

    def reaches(self, elements: Ints, centre: Floats, steps: Floats, slack: Floats) -> Bools:
        """(n,) whether derivatives are bounded within ``slack`` (n,) of places (n, 3) with all steps (k, n, 3).

        Boxes are frusta between planes: a >= A where 1 + x - (1 + A) (1 - z) / 2 >= 0.
        """
        middle, half = np.moveaxis(_boxes()[_box(centre)], 1, 0)
        low, high = middle - _BEYOND * half, middle + _BEYOND * half
        places = centre + steps
        share = (1 - places[..., 2]) / 2
        least = np.minimum(places[..., 2] - low[:, 2], high[:, 2] - places[..., 2])
        for k in range(2):
            least = np.minimum(least, 1 + places[..., k] - (1 + low[:, k]) * share)
            least = np.minimum(least, (1 + high[:, k]) * share - 1 - places[..., k])
        # maximum change per unit of both coordinates
        steepness = 1 + (2 + _BEYOND) / 2
        return np.asarray((least > steepness * slack).all(axis=0))


def _sum(boxes: PyramidBoxes, nets: Floats, order: int) -> Floats:
    """Magnitudes of the derivatives of an order (n, ...) summed over all directions."""
    ends = [boxes.ends(nets, directions) for directions in product(range(3), repeat=order)]
    return np.asarray(sum(np.maximum(np.abs(low), np.abs(high)) for low, high in ends))


@lru_cache(maxsize=1)
def _boxes() -> Floats:
    """(k, 2, 3) middles and half sides of the boxes in collapsed coordinates; the last one holds the apex."""
    found = []
    ends = 1.0 - 2.0 * _NEARER ** np.arange(_LAYERS + 1)
    for low, high in pairwise(ends):
        for a, b in product(range(_SIDE), repeat=2):
            middle = [(2 * a + 1) / _SIDE - 1, (2 * b + 1) / _SIDE - 1, (low + high) / 2]
            found.append([middle, [1 / _SIDE, 1 / _SIDE, (high - low) / 2]])
    found.append([[0.0, 0.0, (high + 1.0) / 2], [1.0, 1.0, (1.0 - high) / 2]])
    return frozen_floats(found)


def _box(reference: Floats) -> Ints:
    """(n,) the boxes that hold reference points (n, 3), or are nearest to them."""
    with np.errstate(all="ignore"):
        eta = collapse(Shape.PYRAMID, reference)
        share = np.clip((1 - eta[:, 2]) / 2, 0.0, 1.0)
        layer = np.nan_to_num(np.log(share) / np.log(_NEARER), nan=_LAYERS, posinf=_LAYERS).astype(int)
        sides = np.nan_to_num(np.clip((eta[:, :2] + 1) / 2 * _SIDE, 0, _SIDE - 1)).astype(int)
    own = (layer * _SIDE + sides[:, 0]) * _SIDE + sides[:, 1]
    return np.where(layer < _LAYERS, own, len(_boxes()) - 1)


@bounded_cache
def _nodes(space: BernsteinSpace) -> tuple[Floats, Floats]:
    """(count, 3) reference points, and the matrix (count, count) from values there to coefficients on the cube."""
    lines, nodes = [], []
    for direction, degree in enumerate(space.degrees):
        line = BernsteinSpace(Shape.SEGMENT, (degree,))
        own = net_of_xi(line)
        if direction == 2:
            own = (1 + _HIGHEST) / 2 * (own + 1) - 1
        nodes.append(own[:, 0])
        lines.append(np.linalg.inv(bernstein_values(line, own)))
    c, b, a = np.meshgrid(*nodes[::-1], indexing="ij")
    eta = np.stack([a, b, c], axis=-1).reshape(-1, 3)
    fit = np.kron(np.kron(lines[2], lines[1]), lines[0]).T
    return frozen_floats(uncollapse(Shape.PYRAMID, eta)), frozen_floats(fit)
