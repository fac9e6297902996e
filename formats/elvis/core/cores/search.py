"""Places of elements through which vortex cores pass: a point of every arc, by exclusion with Bernstein nets on boxes.

Elements are images of boxes (`subcells`).  A box is dropped if the flow has no complex eigenvalues there, or if a
component of the vector that vanishes on cores has one sign.  For each other box, two combinations of this vector are
formed that vanish where the vector does.  If their derivatives across one coordinate stay close to the unit matrix, in
a box three times as wide, the core is a graph over that coordinate.  It then has one point at the middle of this
coordinate, found by iteration, or does not pass the box.  Other boxes are bisected.
"""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, joined_ints
from elvis.core.cores.boxes import Boxes, lattice_of, through
from elvis.core.cores.graphs import Graphs, by_eigenvalue, by_rotation, by_velocity
from elvis.core.cores.parallel import ParallelVectors
from elvis.core.cores.turning import turns_less
from elvis.core.integrals.subcells import corners, subcell_map
from elvis.core.mapping.margins import facets, heights
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.net_zeros import BEYOND, has_no_zero
from elvis.core.quantities.elements.points import ElementPoints, Lattice

#: halvings at most, and boxes of an element
_DEPTH, _MOST_BOXES = 12, 30_000
#: bisections near places at rest, such as edges and vertices of walls
_DEPTH_AT_REST = 6
#: turning that is ignored: relative to an element's largest gradient, and to the rounding of a velocity
LEAST, _NOISE = 1e-4, 1e-9
#: relative velocity that counts as zero on a side, and the distance from such sides at which cores end
_AT_REST, BEFORE_WALLS = 1e-11, 1e-6
#: positions along an arc where a point inside the element is sought
_PLACES = np.linspace(0, 1, 17)


class CoreSearch:
    """The search in elements of one patch.

    rows, xi   elements and reference coordinates of points of cores, several for most cores
    undecided  rows of elements in which boxes were left
    near_rest  rows of elements in which boxes of 1/64 were left that touch a place at rest, as edges of walls are
    limits     (n,) turning that counts in each element of the patch
    walls      (n, k) the facets of each on which the velocity is zero
    """

    def __init__(self, parallel: ParallelVectors, patch: Patch, least: float, only_q: bool) -> None:
        self.parallel, self.patch, self._least, self._only_q = parallel, patch, least, only_q
        self.limits = np.zeros(len(patch))
        self.walls = np.zeros((len(patch), len(facets(patch.shape)[1])), bool)
        self._is_affine = _is_affine(patch)
        self._own, self._slope = parallel.degrees(patch, self._is_affine)
        self._cell = 0
        self.rows: list[Ints] = []
        self.xi: list[Floats] = []
        self.undecided: set[int] = set()
        self.near_rest: set[int] = set()
        self._counts = np.zeros(len(patch), np.int64)

    def run(self, rows: Ints) -> None:
        """Search elements."""
        self.limits[rows] = self._limits(rows)
        self.undecided.update(rows[np.isnan(self.limits[rows])].tolist())
        rows = rows[self.limits[rows] > 0]
        if not len(rows):
            return
        self.walls[rows] = self._at_rest(rows)
        for cell in range(len(corners(self.patch.shape))):
            self._cell = cell
            boxes = _crossed(self._whole(rows))
            stack = [(0, part) for part in _parts(boxes)]
            while stack:
                depth, boxes = stack.pop()
                left = self._left(boxes)
                if depth >= _DEPTH_AT_REST:
                    resting = left.rest_at_corners()
                    self.near_rest.update(left.rows[resting].tolist())
                    left = left.part(~resting)
                if depth == _DEPTH:
                    self.undecided.update(left.rows.tolist())
                    continue
                stack += [(depth + 1, _halved(part)) for part in _parts(left)]

    def points(self) -> tuple[Ints, Floats]:
        """Rows (n,) and reference coordinates (n, 3) of points of cores."""
        rows = joined_ints(self.rows)
        return rows, np.concatenate([np.empty((0, 3)), *self.xi])

    def merit(self, rows: Ints, xi: Floats) -> Floats:
        """(n,) nonnegative if places are in elements, and the flow turns at least as much as required."""
        return np.minimum(self.margins(rows, xi).min(axis=1) + BEYOND, self.turning(rows, xi))

    def margins(self, rows: Ints, xi: Floats) -> Floats:
        """(n, k) heights over facets; over walls, where cores have no direction, over a place before them."""
        return heights(self.patch.shape, xi) - BEFORE_WALLS * self.walls[rows]

    def turning(self, rows: Ints, xi: Floats) -> Floats:
        """(n,) nonnegative if the flow turns at least as much as required."""
        motions = self.parallel.at(ElementPoints(self.patch, rows, xi))
        limits = self.limits[rows]
        found = motions.swirl / limits - 1
        return np.minimum(found, motions.q / limits**2) if self._only_q else found

    def _limits(self, rows: Ints) -> Floats:
        """(n,) turning that counts in elements; 0 if nothing moves or turns, NaN if values are no numbers."""
        lattice = 2 * lattice_of(self._own) - 1
        places = Lattice(self.patch, rows, uncollapse(self.patch.shape, lattice))
        motions = self.parallel.at(places)
        shape = (len(rows), len(lattice))
        with np.errstate(all="ignore"):
            steep = np.linalg.norm(motions.gradient, axis=(1, 2)) / motions.below**2
            noise = np.linalg.norm(motions.velocity, axis=1) * np.linalg.norm(
                np.linalg.inv(places.jacobians), axis=(1, 2)
            )
        greatest, noise = (own.reshape(shape).max(axis=1) for own in (steep, noise))
        limits = np.maximum(np.maximum(LEAST * greatest, _NOISE * noise), self._least)
        limits[greatest <= limits] = 0.0
        return np.where(np.isfinite(greatest + limits), limits, np.nan)

    def _at_rest(self, rows: Ints) -> Bools:
        """(n, k) the facets of elements on which the velocity is zero, as at more places than it has coefficients."""
        shape, random = self.patch.shape, np.random.default_rng(0)
        tables = []
        for local in (heights(shape, shape.vertices) == 0).T:
            own = shape.vertices[local]
            places = random.dirichlet(np.ones(len(own)), 2 * (self._own + 1) ** 2) @ own
            inside = (places + shape.centre) / 2
            motions = self.parallel.at(Lattice(self.patch, rows, np.concatenate([places, inside])))
            tables.append(np.linalg.norm(motions.above, axis=1).reshape(len(rows), 2, len(places)).max(axis=2))
        speeds = np.stack(tables, axis=1)
        return np.asarray(speeds[:, :, 0] <= _AT_REST * speeds.max(axis=(1, 2))[:, None])

    def _whole(self, rows: Ints) -> Boxes:
        """The cell of elements as boxes.

        H is multiplied by the determinant of the map, where that is not affine: so it is a polynomial.
        """
        nets: list[Floats] = []
        least = self.limits[rows]
        for degree in (self._own, self._slope):
            lattice = lattice_of(degree)
            xi = subcell_map(self.patch.shape, np.full(len(lattice), self._cell), lattice)[0]
            places = Lattice(self.patch, rows, xi)
            motions = self.parallel.at(places)
            shape = (len(rows), len(lattice))
            if not nets:
                nets.append(through(motions.above.reshape(*shape, 3).transpose(0, 2, 1), degree))
                continue
            factor = np.ones(shape) if self._is_affine else np.linalg.det(places.jacobians).reshape(shape)
            table = factor[:, :, None] * motions.gradient.reshape(*shape, 9)
            nets.append(through(table.transpose(0, 2, 1), degree))
            factors = through((factor * motions.below.reshape(shape) ** 2)[:, None], degree)
            least = least * factors.min(axis=(1, 2, 3, 4), initial=np.inf).clip(0)
        return Boxes.whole(rows, nets[0], nets[1], least, self.parallel.criterion == "acceleration")

    def _left(self, boxes: Boxes) -> Boxes:
        """The boxes that must be bisected, when points of cores in others are noted."""
        boxes = boxes.part(~turns_less(boxes))
        ways = (by_rotation,) if self.parallel.criterion == "vorticity" else (by_velocity, by_eigenvalue)
        for way in ways:
            graphs = way(boxes, None)
            keep = ~graphs.excluded()
            boxes, axes, known = boxes.part(keep), graphs.axis[keep], graphs.is_known[keep]
            done = np.zeros(len(boxes), bool)
            for axis in range(3):
                here = np.flatnonzero(known & (axes == axis))
                wide = boxes.part(here).widened(axis)
                again = way(wide, 2)
                single = again.is_graph()
                done[here[single]] = True
                self._note(boxes.part(here[single]), wide.part(single), again.part(single), axis)
            boxes = boxes.part(~done)
        np.add.at(self._counts, boxes.rows, 1)
        crowded = self._counts[boxes.rows] > _MOST_BOXES
        self.undecided.update(boxes.rows[crowded].tolist())
        return boxes.part(~crowded)

    def _note(self, boxes: Boxes, wide: Boxes, graphs: Graphs, axis: int) -> None:
        """Keep a point of the core that passes each box, one in the element where there is one."""
        if not len(boxes):
            return
        best = np.full(len(boxes), -np.inf)
        points = np.empty((len(boxes), 3))
        left = np.arange(len(boxes))
        others = [k for k in range(3) if k != axis]
        for places in ((0.5,), _PLACES):
            for along in places:
                found, is_there = graphs.part(left).at(wide.part(left), along)
                inner = np.empty_like(found)
                inner[:, others], inner[:, axis] = 3 * found[:, :2] - 1, found[:, 2]
                low, high = boxes.low[left], boxes.high[left]
                xi = subcell_map(self.patch.shape, np.full(len(left), self._cell), low + inner * (high - low))[0]
                merit = np.where(is_there, self.merit(boxes.rows[left], xi), -np.inf)
                better = merit > best[left]
                best[left[better]], points[left[better]] = merit[better], xi[better]
            left = np.flatnonzero((best < 0) & np.isfinite(best))
            if not len(left):
                break
        good = best >= 0
        self.rows.append(boxes.rows[good])
        self.xi.append(points[good])


def _parts(boxes: Boxes) -> list[Boxes]:
    """Parts of boxes whose halves fit in memory together."""
    count, step = len(boxes), boxes.at_once
    return [boxes.part(np.arange(first, min(first + step, count))) for first in range(0, count, step)]


def _halved(boxes: Boxes) -> Boxes:
    """The halves in every direction, restricted to boxes where cores may be."""
    for axis in range(3):
        boxes = _crossed(boxes.halved(axis))
    return boxes


def _crossed(boxes: Boxes) -> Boxes:
    """The boxes where the vector that vanishes on cores may be zero."""
    return boxes.part(~has_no_zero(boxes.crossed, boxes.crossed_error))


def _is_affine(patch: Patch) -> bool:
    """Whether the maps of all elements are affine, to rounding."""
    if patch.is_linear:
        return True
    lattice = lattice_of(max(patch.geometry.modes))
    xi = subcell_map(patch.shape, np.zeros(len(lattice), np.int64), lattice)[0]
    for first in range(0, len(patch), 256):
        rows = np.arange(first, min(first + 256, len(patch)))
        found = Lattice(patch, rows, xi).jacobians.reshape(len(rows), len(xi), -1)
        if (np.abs(found - found[:, :1]).max(axis=(1, 2)) > 1e-13 * np.abs(found).max(axis=(1, 2))).any():
            return False
    return True
