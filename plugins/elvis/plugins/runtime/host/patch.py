"""Elements of a runtime plugin in NumPy (`elvis.plugins.runtime.host.evaluation`), with the interface of datasets."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.cutting import template
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.margins import TOLERANCE, drawn_in, margins
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.tangents import duals
from elvis.core.polynomials.interpolation import modified
from elvis.plugins.runtime.host.evaluation import HostEvaluation

#: cuts of elements in the search for points
_LEVEL = 2
#: how many radii of a small cell a point may be away from its middle
_RADII = 1.5
#: small cells that a search starts from, steps of Newton's method, how far it may go beyond an element
_STARTS = 4
_STEPS = 20
_SLACK = 0.05
#: distance of the points of rough derivatives
_NEAR = 1e-4
#: steps so short that they only lead along the border
_STUCK = 1e-3
#: residual of a root, relative to the largest coordinate
_RESIDUAL = 4e-15
#: how far rounding of coordinates may move margins at most
_MOST = 0.25
#: number of modes of functions without a known degree
_MODES = 9


class HostPatch(Patch):
    """The elements of a part; expansions and coefficients only say that these are not polynomials of a low degree."""

    def __init__(self, host: HostEvaluation) -> None:
        shape = host.shape
        expansion = modified(shape, (_MODES,) * shape.dimension)
        none = np.zeros((len(host), 3, 0))
        super().__init__(shape, host.part.element_ids, expansion, none, (expansion,), (none[:, 0],))
        object.__setattr__(self, "host", host)

    host: HostEvaluation

    def map_points(self, rows: Ints, points: Floats) -> tuple[Floats, Floats]:
        """World coordinates (n, 3) and their derivatives (n, 3, d) at reference points (n, d) of elements (n,)."""
        return self.host.evaluate(rows, points)[0], self.host.derivatives(rows, points)[0]

    def map_lattice(self, rows: Ints, points: Floats) -> Floats:
        """(e, k, 3) world coordinates of the same reference points (k, d) in some elements."""
        return self.host.positions(rows, points)

    @cached_property
    def cells(self) -> Floats:
        """(k, c, d) corners of small cells that make up the shape; where cells have fewer, the last one is repeated."""
        cut = template(self.shape, _LEVEL)
        most = max(cells.shape[1] for cells in cut.cells.values())
        found: list[Floats] = []
        for cells in cut.cells.values():
            missing = most - cells.shape[1]
            found.append(np.pad(cut.points[cells], ((0, 0), (0, missing), (0, 0)), mode="edge"))
        return np.concatenate(found)

    def invert(self, rows: Ints, points: Floats) -> tuple[Floats, NDArray[np.uint8]]:
        """Reference points (n, d) and `Status` (n,) of world points (n, 3) in elements (n,).

        Newton's method starts in the small cells that are near; outside all of them a point is outside.
        """
        away = self._cell_distances(rows, points)
        nearest = np.argsort(away, axis=1)[:, :_STARTS]
        every = np.arange(len(rows))
        reference = np.full((len(rows), self.shape.dimension), np.nan)
        status = np.full(len(rows), Status.OUTSIDE, np.uint8)
        for number, cell in enumerate(nearest.T):
            here = np.flatnonzero((status != Status.INSIDE) & (away[every, cell] <= _RADII))
            start = self.cells[cell[here]].mean(axis=1)
            found, is_root = self._newton(rows[here], start, points[here])

            # inside includes points that rounding may have moved out
            margin = margins(self.shape, found) + self._blur(rows[here], found)
            is_inside = is_root & (margin >= -TOLERANCE)
            inside = here[is_inside]
            reference[inside] = found[is_inside]
            status[inside] = Status.INSIDE

            # from the nearest cell: what ended in the element without a root says nothing
            if number == 0:
                status[here[~is_root & (margin >= 0)]] = Status.FAILED
        return reference, status

    def _cell_distances(self, rows: Ints, points: Floats) -> Floats:
        """(n, k) distances of world points (n, 3) from the middles of their elements' small cells, in their radii."""
        elements, place = np.unique(rows, return_inverse=True)
        corners = self.map_lattice(elements, self.cells.reshape(-1, self.shape.dimension))
        corners = corners.reshape(len(elements), *self.cells.shape[:2], 3)
        middles = corners.mean(axis=2)
        radii = np.linalg.norm(corners - middles[:, :, None], axis=3).max(axis=2)
        distances = np.linalg.norm(points[:, None] - middles[place], axis=2)
        return np.asarray(distances / radii[place])

    def search(self, rows: Ints, points: Floats) -> tuple[Floats, NDArray[np.uint8]]:
        """The same where `invert` is UNCERTAIN, which it never is."""
        return self.invert(rows, points)

    def _newton(self, rows: Ints, start: Floats, points: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """End points (n, d) of damped steps, at most a little beyond the shape, and whether they are roots (n,)."""
        precision = _RESIDUAL * float(np.abs(self.host.part.boxes).max(initial=0.0))
        found = start.copy()
        is_root = np.zeros(len(rows), bool)
        active = np.arange(len(rows))
        for _ in range(_STEPS):
            place = found[active]
            gap = points[active] - self.host.evaluate(rows[active], place)[0]
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                inverse = duals(self._rough_derivatives(rows[active], place))
                step = np.einsum("nci,nc->ni", inverse, gap)
            length = np.abs(step).max(axis=1)
            is_finite = np.isfinite(length)
            is_there = (length < 1e-13) | (np.linalg.norm(gap, axis=1) <= precision)
            is_root[active] = is_finite & is_there

            # steps of half the shape at most, which stay near it
            damping = np.maximum(2.0 * length, 1.0)
            damped = np.where(is_finite[:, None], step / damping[:, None], 0.0)
            moved = drawn_in(self.shape, place + damped, _SLACK)
            found[active] = moved

            # points that are drawn back to the same position lead beyond the element
            is_stuck = (np.abs(moved - place).max(axis=1) < _STUCK) & (length > 2 * _STUCK)
            active = active[is_finite & ~is_root[active] & ~is_stuck]
            if not len(active):
                break
        return found, is_root

    def _blur(self, rows: Ints, points: Floats) -> Floats:
        """Maximum changes (n,) of margins at reference points (n, d) through rounding of coordinates.

        A margin changes by at most half the sum of the changes of the reference coordinates.
        """
        magnitudes = np.abs(self.host.part.boxes[rows]).max(axis=1, initial=0.0).astype(np.float64)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            inverse = duals(self._rough_derivatives(rows, points))
            lengths = np.linalg.norm(inverse, axis=1).sum(axis=1)
            blur = 0.5 * _RESIDUAL * magnitudes * lengths
        return np.asarray(np.where(np.isfinite(blur), np.minimum(blur, _MOST), 0.0))

    def _rough_derivatives(self, rows: Ints, points: Floats) -> Floats:
        """(n, 3, d) derivatives of the map by central differences: near enough for steps."""
        dimension = self.shape.dimension
        ahead = _NEAR * np.eye(dimension)
        steps = np.concatenate([ahead, -ahead])
        near = (points[:, None] + steps).reshape(-1, dimension)
        places = self.host.evaluate(np.repeat(rows, len(steps)), near)[0]
        places = places.reshape(len(rows), 2, dimension, 3)
        differences = (places[:, 0] - places[:, 1]) / (2 * _NEAR)
        return np.asarray(differences.transpose(0, 2, 1))
