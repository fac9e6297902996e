"""Cores followed through elements, from points of them to the elements' borders: predictor and corrector.

On the core, the derivatives of the vanishing vector have rank two, and the direction of the core is their kernel.  The
predictor takes a step along this direction, and the corrector returns to the core in the plane across it.  Derivatives
come from differences, which only costs corrector steps: points are on the core up to rounding.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, joined_columns
from elvis.core.cores.search import CoreSearch
from elvis.core.mapping import pointwise
from elvis.core.mapping.margins import heights
from elvis.core.polynomials.net_zeros import BEYOND
from elvis.core.quantities.elements.points import ElementPoints

#: of differences; steps of the corrector; the last one's length
_DIFFERENCE, _STEPS, _SHORT = 1e-5, 8, 1e-12
#: steps along the core in reference coordinates: the first, the largest, the smallest
_FIRST, _GREATEST, _LEAST = 0.05, 0.3, 1e-6
#: maximum change of direction in a step, and of the corrector's lateral step relative to the step
_TURN, _ASIDE = 0.15, 0.2
#: points of a core in an element at most, and how far apart two points of the core are that are one
_MOST, SAME = 5000, 1e-7
#: steps of the search for a line's end
_END_STEPS = 60


@dataclass(frozen=True, eq=False)
class Arc:
    """A core within an element.

    row       of the patch
    xi        (k, 3) reference coordinates of its points, the first again where it is closed
    tangents  (k, 3) unit vectors there, in reference coordinates
    closed    whether it comes back to its beginning
    """

    row: int
    xi: Floats
    tangents: Floats
    closed: bool


class CoreTracing:
    """The cores that pass points found by a search.

    failed  rows of elements in which a core could not be followed
    """

    def __init__(self, search: CoreSearch, spacing: float) -> None:
        self._search, self._spacing = search, spacing
        self.failed: set[int] = set()

    def run(self, rows: Ints, xi: Floats) -> Iterator[Arc]:
        """All cores through points (n, 3) of elements (n,), each once."""
        left = np.arange(len(rows))
        while len(left):
            first = left[np.unique(rows[left], return_index=True)[1]]
            arcs = self._through(rows[first], xi[first])
            yield from arcs
            left = np.setdiff1d(left, first)
            left = left[~self._passed(arcs, rows[left], xi[left])]

    def _residuals(self, rows: Ints, xi: Floats) -> Floats:
        """(n, 3) the vector that vanishes on cores, divided by the heights over walls, where the velocity is zero."""
        parallel, patch = self._search.parallel, self._search.patch
        found = parallel.residuals(parallel.at(ElementPoints(patch, rows, xi)))
        above = np.where(self._search.walls[rows], heights(patch.shape, xi), 1.0)
        return np.asarray(found / np.where(above == 0, 1.0, above).prod(axis=1)[:, None])

    def slopes(self, rows: Ints, xi: Floats) -> Floats:
        """(n, 3, 3) derivatives of the vanishing vector, relative to the largest one."""
        steps = _DIFFERENCE * np.concatenate([np.eye(3), -np.eye(3)])
        places = xi[:, None, :] + steps
        values = self._residuals(np.repeat(rows, 6), places.reshape(-1, 3)).reshape(len(rows), 6, 3)
        return np.asarray((values[:, :3] - values[:, 3:]).swapaxes(1, 2) / (2 * _DIFFERENCE))

    def _tangents(self, slopes: Floats, along: Floats | None) -> Floats:
        """(n, 3) unit vectors along cores, in the direction of others where these are given."""
        found = np.linalg.svd(slopes)[2][:, 2]
        if along is not None:
            found = found * np.where(np.einsum("ni,ni->n", found, along) < 0, -1.0, 1.0)[:, None]
        return np.asarray(found)

    def corrected(self, rows: Ints, xi: Floats, normal: Floats, slopes: Floats | None = None) -> tuple[Floats, Bools]:
        """(n, 3) points of cores in planes through points with unit normals, and whether the corrector came to rest.

        slopes  near the points; if the corrector does not converge with them, it continues with its own
        """
        if slopes is None:
            slopes = self.slopes(rows, xi)
        found, last = self._stepped(rows, xi, xi, normal, slopes)
        left = np.flatnonzero(~(last < _SHORT))
        if len(left):
            again = self.slopes(rows[left], found[left])
            found[left], last[left] = self._stepped(rows[left], found[left], xi[left], normal[left], again)
        return found, np.asarray(last < 1e-9)

    def _stepped(self, rows: Ints, start: Floats, xi: Floats, normal: Floats, slopes: Floats) -> tuple[Floats, Floats]:
        """Points (n, 3) that steps lead to with the same derivatives, and the lengths (n,) of the last ones."""
        size = np.abs(slopes).max(axis=(1, 2), initial=1e-300)[:, None, None]
        inverse = np.linalg.pinv(np.concatenate([slopes / size, normal[:, None, :]], axis=1), rcond=1e-9)
        found, last = start.copy(), np.full(len(xi), np.inf)
        going = np.arange(len(xi))
        for _ in range(_STEPS):
            values = self._residuals(rows[going], found[going]) / size[going, :, 0]
            values = np.column_stack([values, np.einsum("ni,ni->n", normal[going], found[going] - xi[going])])
            step = np.einsum("nij,nj->ni", inverse[going], values)
            found[going] -= step.clip(-1, 1)
            last[going] = np.abs(step).max(axis=1, initial=0.0)
            going = going[~(last[going] < _SHORT)]
            if not len(going):
                break
        return found, last

    def _through(self, rows: Ints, xi: Floats) -> list[Arc]:
        """The cores through points, both ways from each."""
        slopes = self.slopes(rows, xi)
        tangents = self._tangents(slopes, None)
        xi, sound = self.corrected(rows, xi, tangents, slopes)
        self.failed.update(rows[~sound].tolist())
        rows, xi = rows[sound], xi[sound]
        tangents = self._tangents(self.slopes(rows, xi), None)
        forward = self._followed(rows, xi, tangents)
        backward = self._followed(rows, xi, -tangents)
        arcs = []
        for row, one, other in zip(rows, forward, backward, strict=True):
            if one.closed:
                arcs.append(one)
                continue
            places = np.concatenate([other.xi[:0:-1], one.xi])
            along = np.concatenate([-other.tangents[:0:-1], one.tangents])
            arcs.append(Arc(int(row), places, along, False))
        return arcs

    def _followed(self, rows: Ints, xi: Floats, tangents: Floats) -> list[Arc]:
        """Cores from points in directions, until they leave their elements, fade, or come back."""
        count = len(rows)
        kept: list[list[tuple[Floats, Floats]]] = [[(xi[i], tangents[i])] for i in range(count)]
        closed, counts = np.zeros(count, bool), np.ones(count, np.int64)
        width = np.full(count, _FIRST)
        leaving: list[tuple[Ints, Floats, Floats, Floats]] = []
        going, place, along = np.arange(count), xi.copy(), tangents.copy()
        for _ in range(_MOST):
            if not len(going):
                break
            own, here, way = rows[going], place[going], along[going]
            width[going] = np.minimum(width[going], self._most(own, here, way))
            step = width[going]
            found, turned, sound = self._step(own, here, way, step)
            merit = self._search.merit(own, found)
            returns = sound & self._returns(xi[going], tangents[going], here, found, way, counts[going])
            for i in np.flatnonzero(sound & ((merit >= 0) | returns)).tolist():
                number = int(going[i])
                closed[number] |= returns[i]
                point = (xi[number], tangents[number]) if returns[i] else (found[i], turned[i])
                kept[number].append(point)
                counts[number] += 1
                place[number], along[number] = found[i], turned[i]
            ends = np.flatnonzero(sound & (merit < 0) & ~returns)
            leaving.append((going[ends], here[ends], way[ends], step[ends]))
            width[going] *= np.where(sound, 1.5, 0.5)
            lost = width[going] < _LEAST
            self.failed.update(own[lost].tolist())
            over = lost | returns
            over[ends] = True
            going = going[~over]
        self.failed.update(rows[going].tolist())
        if leaving:
            numbers, here, way, step = joined_columns(leaving)
            last, ways = self._ends(rows[numbers], here, way, step)
            for i, number in enumerate(numbers.tolist()):
                kept[number].append((last[i], ways[i]))
        return [
            Arc(int(rows[i]), np.array([p for p, _ in kept[i]]), np.array([t for _, t in kept[i]]), bool(closed[i]))
            for i in range(count)
        ]

    def _step(self, rows: Ints, here: Floats, way: Floats, step: Floats) -> tuple[Floats, Floats, Bools]:
        """Points (n, 3) of cores a step ahead, tangents there, and whether steps were small enough."""
        ahead = here + step[:, None] * way
        slopes = self.slopes(rows, ahead)
        found, sound = self.corrected(rows, ahead, way, slopes)
        turned = self._tangents(slopes, way)
        sound &= np.linalg.norm(found - ahead, axis=1) < _ASIDE * step
        sound &= np.linalg.norm(turned - way, axis=1) < _TURN
        return found, turned, sound

    def _most(self, rows: Ints, xi: Floats, tangents: Floats) -> Floats:
        """(n,) the largest steps that are as long in the world as points may be apart."""
        jacobians = pointwise.jacobians(self._search.patch, rows, xi)
        speed = np.linalg.norm(np.einsum("nci,ni->nc", jacobians, tangents), axis=1)
        return np.asarray(np.minimum(self._spacing / speed, _GREATEST))

    def _returns(
        self, start: Floats, direction: Floats, here: Floats, there: Floats, way: Floats, counts: Ints
    ) -> Bools:
        """(n,) whether steps from here to there pass the start."""
        step = there - here
        length = np.linalg.norm(step, axis=1)
        part = np.einsum("ni,ni->n", start - here, step) / length**2
        beside = np.linalg.norm(start - here - part[:, None] * step, axis=1)
        same = np.einsum("ni,ni->n", direction, way) > 0.9
        return np.asarray((counts > 3) & same & (part > 0) & (part <= 1) & (beside < 0.1 * length))

    def _ends(self, rows: Ints, here: Floats, way: Floats, step: Floats) -> tuple[Floats, Floats]:
        """(n, 3) points where steps leave elements, or turning fades, and directions there.

        Found by bisection and false position.  A step may begin on a side, up to rounding; such a side counts as left
        once the step is beyond it by more than rounding.  The corrector uses the derivatives at each place that is
        tried: with derivatives from beyond a wall, rounding might grow from step to step.  If it does not converge at a
        place, the place counts as beyond; an end next to such a place is unknown.
        """
        begin = self._search.margins(rows, here)
        is_inner = begin > 1e-8
        slack, scale = np.where(is_inner, 0.0, BEYOND), np.where(is_inner, 1.0, 1 / BEYOND)

        def merit(these: Ints, parts: Floats) -> tuple[Floats, Floats]:
            ahead = here[these] + (parts * step[these])[:, None] * way[these]
            found, sound = self.corrected(rows[these], ahead, way[these])
            margin = (scale[these] * (self._search.margins(rows[these], found) + slack[these])).min(axis=1)
            value = np.minimum(margin, self._search.turning(rows[these], found))
            return np.where(sound, value, np.nan), found

        left, point = np.arange(len(rows)), here.copy()
        low, high = np.zeros(len(rows)), np.ones(len(rows))
        value_high, value_low = merit(left, high)[0], merit(left, low)[0].clip(0)
        for count in range(_END_STEPS):
            if not len(left):
                break
            below, above = value_low[left], value_high[left]
            with np.errstate(all="ignore"):
                middle = low[left] + (high - low)[left] * below / (below - above)
            middle = np.where((count % 3 == 2) | ~np.isfinite(middle), (low + high)[left] / 2, middle)
            value, found = merit(left, middle)
            point[left] = np.where(np.isnan(value)[:, None], point[left], found)
            inside = value >= 0
            low[left], value_low[left] = np.where(inside, middle, low[left]), np.where(inside, value, below)
            high[left], value_high[left] = np.where(inside, high[left], middle), np.where(inside, above, value)
            left = left[~(np.abs(value) <= 1e-13) & ((high - low)[left] > 1e-13)]
        self.failed.update(rows[np.isnan(value_high)].tolist())
        return point, self._tangents(self.slopes(rows, point), way)

    def _passed(self, arcs: list[Arc], rows: Ints, xi: Floats) -> Bools:
        """(n,) whether one of the arcs passes points of cores."""
        found = np.zeros(len(rows), bool)
        for arc in arcs:
            here = np.flatnonzero((rows == arc.row) & ~found)
            if not len(here) or len(arc.xi) < 2:
                continue
            begin, step = arc.xi[:-1], np.diff(arc.xi, axis=0)
            offset = xi[here, None, :] - begin
            part = np.einsum("nki,ki->nk", offset, step) / np.einsum("ki,ki->k", step, step).clip(1e-300)
            near = begin + part.clip(-0.01, 1.01)[:, :, None] * step
            which = np.linalg.norm(xi[here, None, :] - near, axis=2).argmin(axis=1)
            normal = step[which] / np.linalg.norm(step[which], axis=1, keepdims=True).clip(1e-300)
            nearest = near[np.arange(len(here)), which]

            # the arc's own point in the plane through the point, across the step: another core is far from the step,
            # and a core beyond the arc's end is one that turns again after this one has faded
            along = np.einsum("ni,ni->n", xi[here] - nearest, normal)
            on_plane = nearest + along[:, None] * normal
            point, sound = self.corrected(np.full(len(here), arc.row), on_plane, normal)
            aside = _ASIDE * np.linalg.norm(step[which], axis=1) + SAME
            is_near = (np.linalg.norm(point - on_plane, axis=1) < aside) & (np.abs(along) < aside)
            found[here] = sound & is_near & (np.abs(point - xi[here]).max(axis=1) < SAME)
        return found
