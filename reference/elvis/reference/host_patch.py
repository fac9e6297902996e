"""Elements that a runtime plugin describes in NumPy (`elvis.plugins.host_evaluation`), met like those of datasets."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elvis.core.arrays import Floats, Ints
from elvis.core.cutting import template
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.margins import TOLERANCE, drawn_in, margins
from elvis.core.mapping.tangents import duals
from elvis.core.patch import Patch
from elvis.core.polynomials.interpolation import modified
from elvis.plugins.host_evaluation import HostEvaluation

#: cuts of elements in the search for points, and how many radii of a small cell a point may be away from its middle
_LEVEL, _RADII = 2, 1.5
#: small cells that a search starts from, steps of Newton's method, how far it may go beyond an element
_STARTS, _STEPS, _SLACK = 4, 20, 0.05
#: distance of the points of rough derivatives; steps so short that they only lead along the border
_NEAR, _STUCK = 1e-4, 1e-3
#: residual of a root, in parts of the greatest coordinate; how far rounding of coordinates may move margins at most
_RESIDUAL, _MOST = 4e-15, 0.25
#: modes that stand for functions of which no degree is known
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
        places = self.host.evaluate(np.repeat(rows, len(points)), np.tile(points, (len(rows), 1)))[0]
        return places.reshape(len(rows), len(points), 3)

    @cached_property
    def cells(self) -> Floats:
        """(k, c, d) corners of small cells that make up the shape."""
        cut = template(self.shape, _LEVEL)
        found: list[Floats] = [cut.points[own] for own in cut.cells.values()]
        most = max(own.shape[1] for own in found)
        return np.concatenate([np.pad(own, ((0, 0), (0, most - own.shape[1]), (0, 0)), mode="edge") for own in found])

    def invert(self, rows: Ints, points: Floats) -> tuple[Floats, NDArray[np.uint8]]:
        """Reference points (n, d) and `Status` (n,) of world points (n, 3) in elements (n,).

        Newton's method starts in the small cells that are near; outside all of them a point is outside.
        """
        elements, place = np.unique(rows, return_inverse=True)
        corners = self.map_lattice(elements, self.cells.reshape(-1, self.shape.dimension))
        corners = corners.reshape(len(elements), *self.cells.shape[:2], 3)
        middles = corners.mean(axis=2)
        radii = np.linalg.norm(corners - middles[:, :, None], axis=3).max(axis=2)
        away = np.linalg.norm(points[:, None] - middles[place], axis=2) / radii[place]
        order = np.argsort(away, axis=1)[:, :_STARTS]

        reference = np.full((len(rows), self.shape.dimension), np.nan)
        status = np.full(len(rows), Status.OUTSIDE, np.uint8)
        for number in range(order.shape[1]):
            cell = order[:, number]
            due = (status != Status.INSIDE) & (away[np.arange(len(rows)), cell] <= _RADII)
            here = np.flatnonzero(due)
            found, root = self._newton(rows[here], self.cells[cell[here]].mean(axis=1), points[here])
            margin = margins(self.shape, found) + self._blur(rows[here], found)
            inside = root & (margin >= -TOLERANCE)
            reference[here[inside]], status[here[inside]] = found[inside], Status.INSIDE
            if number == 0:
                status[here[~root & (margin >= 0)]] = Status.FAILED
        return reference, status

    def search(self, rows: Ints, points: Floats) -> tuple[Floats, NDArray[np.uint8]]:
        """The same where `invert` is UNCERTAIN, which it never is."""
        return self.invert(rows, points)

    def _newton(self, rows: Ints, start: Floats, points: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        """Where damped steps lead (n, d), a little beyond the shape at most, and whether that is a root (n,)."""
        found, root, active = start.copy(), np.zeros(len(rows), bool), np.arange(len(rows))
        precision = _RESIDUAL * float(np.abs(self.host.part.boxes).max(initial=0.0))
        for _ in range(_STEPS):
            own, place = rows[active], found[active]
            gap = points[active] - self.host.evaluate(own, place)[0]
            with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
                step = np.einsum("nci,nc->ni", duals(self._rough(own, place)), gap)
            length = np.abs(step).max(axis=1)
            good = np.isfinite(length)
            root[active] = good & ((length < 1e-13) | (np.linalg.norm(gap, axis=1) <= precision))
            moved = place + np.where(good[:, None], step / np.maximum(2.0 * length, 1.0)[:, None], 0.0)
            found[active] = drawn_in(self.shape, moved, _SLACK)

            # what is drawn back to where it was leads beyond the element
            stuck = (np.abs(found[active] - place).max(axis=1) < _STUCK) & (length > 2 * _STUCK)
            active = active[good & ~root[active] & ~stuck]
            if not len(active):
                break
        return found, root

    def _blur(self, rows: Ints, points: Floats) -> Floats:
        """(n,) how much rounding of coordinates may move margins at reference points (n, d).

        As a margin changes by at most half the sum of the changes of the reference coordinates.
        """
        magnitudes = np.abs(self.host.part.boxes[rows]).max(axis=1, initial=0.0).astype(np.float64)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            lengths = np.linalg.norm(duals(self._rough(rows, points)), axis=1).sum(axis=1)
            blur = 0.5 * _RESIDUAL * magnitudes * lengths
        return np.asarray(np.where(np.isfinite(blur), np.minimum(blur, _MOST), 0.0))

    def _rough(self, rows: Ints, points: Floats) -> Floats:
        """(n, 3, d) derivatives of the map by central differences: near enough for steps."""
        dimension = self.shape.dimension
        ways = np.concatenate([_NEAR * np.eye(dimension), -_NEAR * np.eye(dimension)])
        near = (points[:, None] + ways).reshape(-1, dimension)
        places = self.host.evaluate(np.repeat(rows, len(ways)), near)[0].reshape(len(rows), 2, dimension, 3)
        return np.asarray(((places[:, 0] - places[:, 1]) / (2 * _NEAR)).transpose(0, 2, 1))
