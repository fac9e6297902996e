"""Elements that contain given world points, and the positions in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints, joined_ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.rows import Rows
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.boxes import MARGIN, BoxTree, outward
from elvis.core.mapping.enclosure import hull_products, hulls
from elvis.core.mapping.inverse import DISTANCE, Roots, Status, decide, invert
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch, patches

#: points located together
_BATCH = 1 << 15
#: pairs of an element and a point from which it pays to cut the element, at least and for each multiplication of that
_WORTH, _WORTH_OF_PRODUCTS = 400, 7e-5
#: number of parts in each direction into which an element is cut
_PARTS = 16


@dataclass(frozen=True, eq=False)
class Location(Rows):
    """Locations of points: one result for a point, or one for each element that holds it; sorted by point.

    point       (k,)    number of the point
    patch, row  (k,) the patch and the row in it, -1 outside all elements
    element_id  (k,) id in the file, -1 outside
    reference   (k, D) reference coordinates, then a zeta for each homogeneous direction; NaN outside
    margin      (k,) minimum height over the facets of the element (`margins`), NaN outside: from -1e-10 to 1/2, or
                below -1e-10 if the rounding of the coordinates exceeds that
    status      (k,) of `Status`: INSIDE, OUTSIDE, or FAILED if no element holds the point but one is in doubt
    is_late     (k,) whether the element was in doubt at first: it counts only if no element held the point before
    """

    point: Ints
    patch: Ints
    row: Ints
    element_id: Ints
    reference: Floats
    margin: Floats
    status: NDArray[np.uint8]
    is_late: Bools


def locate(source: Dataset | Sequence[Patch], points: Floats, all: bool = False) -> Location:
    """The locations of world points (n, 3); `Locator` prepares the search once for many calls.

    all  every element that holds a point, not only the one with the largest margin
    """
    if isinstance(source, Dataset):
        source = patches(source, [field.name for field in source.fields])
    return Locator(source).locate(points, all)


class Locator:
    """The elements of some patches, prepared for locating points.

    patches   in the order of `Location.patch`
    tree      over all their elements, patch after patch
    distance  maximum distance of points from curves and surfaces, relative to the size of an element
    """

    def __init__(self, patches: Sequence[Patch], distance: float = DISTANCE) -> None:
        self.patches, self.distance = tuple(patches), distance
        flat = any(patch.shape.dimension < 3 for patch in self.patches)
        self.tree = BoxTree.over(self.patches, margin=max(MARGIN, distance) if flat else MARGIN)
        self._boxes: dict[int, BoxTree] = {}
        self._starts = np.cumsum([0] + [len(patch) for patch in self.patches])
        self._ids = joined_ints(patch.element_ids for patch in self.patches)
        self._periods = next((patch.periods for patch in self.patches if patch.periods), ())
        self._dimension = max((patch.shape.dimension for patch in self.patches), default=3)

    def locate(self, points: Floats, all: bool = False) -> Location:
        """The locations of world points (n, 3): see `locate`; raises ElvisError for an array of another shape.

        Coordinates along homogeneous directions are taken modulo the period.
        """
        world = np.array(points, np.float64)
        if world.ndim != 2 or world.shape[1] != 3:
            raise ElvisError(f"expected points (n, 3), found an array of shape {world.shape}")
        zeta = self._unroll(world)
        parts = [self._batch(world, part, all) for part in chunks(len(world), _BATCH)]
        found = _join(parts) if parts else self._nowhere(np.empty(0, np.int64), np.empty(0, bool))
        if self._periods:
            inside = found.status == Status.INSIDE
            found.reference[inside, self._dimension :] = zeta[found.point[inside]]
        return found

    def invert(self, number: int, rows: Ints, points: Floats) -> Roots:
        """Reference coordinates of world points (n, 3) in elements (n,) of a patch."""
        return invert(self.patches[number], rows, points)

    def _unroll(self, world: Floats) -> Floats:
        """(n, p) coordinates zeta along the homogeneous directions, which become 0 in ``world`` (n, 3)."""
        zeta = np.empty((len(world), len(self._periods)))
        for i, (axis, length) in enumerate(self._periods):
            along = world[:, axis]
            beyond = (along < 0) | (along > length)
            zeta[:, i] = 2 * np.where(beyond, np.mod(along, length), along) / length - 1
            world[:, axis] = np.where(np.isfinite(along), 0.0, np.nan)
        return zeta

    def _batch(self, world: Floats, part: slice, every: bool) -> Location:
        """Results for the points of ``part``."""
        point, element = self.tree.candidates(world[part])
        point += part.start
        near = ~self._outside_parts(world, point, element)
        point, element = point[near], element[near]
        roots, is_late = self._invert(world, point, element, every)
        doubtful = np.zeros(len(world), bool)
        doubtful[point[roots.status == Status.FAILED]] = True

        # the elements that hold a point, largest margin first
        hits = np.flatnonzero(roots.status == Status.INSIDE)
        hits = hits[np.lexsort((self._ids[element[hits]], -roots.margin[hits], point[hits]))]
        if not every and len(hits):
            hits = hits[np.diff(point[hits], prepend=-1) != 0]
        missed = np.setdiff1d(np.arange(part.start, part.stop), point[hits])
        found = self._hits(point[hits], element[hits], roots.part(hits), is_late[hits])
        return _join([found, self._nowhere(missed, doubtful[missed])])

    def _outside_parts(self, world: Floats, point: Ints, element: Ints) -> Bools:
        """(k,) pairs of a point and an element that certainly doesn't hold it; only of elements with many pairs.

        Such elements are cut into parts once: outside the boxes of all parts there is none of it.
        """
        result = np.zeros(len(point), bool)
        worth = np.array([max(_WORTH, _WORTH_OF_PRODUCTS * hull_products(own, _PARTS)) for own in self.patches])
        pairs = np.bincount(element, minlength=self._starts[-1])
        for number in np.flatnonzero(pairs >= np.repeat(worth, np.diff(self._starts))):
            here = np.flatnonzero(element == number)
            result[here] = True
            result[here[self._parts(int(number)).candidates(world[point[here]])[0]]] = False
        return result

    def _parts(self, element: int) -> BoxTree:
        """Boxes that hold the parts of an element."""
        if element not in self._boxes:
            patch = int(np.searchsorted(self._starts, element, side="right")) - 1
            low, high = hulls(self.patches[patch], element - int(self._starts[patch]), _PARTS)
            extra = max(MARGIN, self.distance) * np.linalg.norm(high.max(axis=0) - low.min(axis=0))
            self._boxes[element] = BoxTree.build(outward(low - extra, high + extra, MARGIN))
        return self._boxes[element]

    def _invert(self, world: Floats, point: Ints, element: Ints, every: bool) -> tuple[Roots, Bools]:
        """Roots for all pairs, and which were in doubt: these are searched where it matters."""
        patch = np.searchsorted(self._starts, element, side="right") - 1
        groups = [np.flatnonzero(patch == number) for number in range(len(self.patches))]
        roots = Roots.none(len(point), self._dimension)
        for number, group in enumerate(groups):
            rows = element[group] - self._starts[number]
            own = invert(self.patches[number], rows, world[point[group]], False, self.distance)
            roots.put(group, own)

        # an element in doubt matters unless another one holds the point
        is_late = roots.status == Status.UNCERTAIN
        held = np.zeros(len(world), bool)
        held[point[roots.status == Status.INSIDE]] = not every
        for number, group in enumerate(groups):
            which = group[(roots.status[group] == Status.UNCERTAIN) & ~held[point[group]]]
            own = roots.part(which)
            decide(self.patches[number], element[which] - self._starts[number], world[point[which]], own, self.distance)
            roots.put(which, own)
        return roots, is_late

    def _hits(self, point: Ints, element: Ints, roots: Roots, is_late: Bools) -> Location:
        patch = np.searchsorted(self._starts, element, side="right") - 1
        reference = np.full((len(point), self._dimension + len(self._periods)), np.nan)
        reference[:, : self._dimension] = roots.reference
        row = element - self._starts[patch]
        return Location(point, patch, row, self._ids[element], reference, roots.margin, roots.status, is_late)

    def _nowhere(self, point: Ints, doubtful: Bools) -> Location:
        none = np.full(len(point), -1)
        reference = np.full((len(point), self._dimension + len(self._periods)), np.nan)
        status = np.where(doubtful, Status.FAILED, Status.OUTSIDE).astype(np.uint8)
        margin, is_late = np.full(len(point), np.nan), np.zeros(len(point), bool)
        return Location(point, none, none, none, reference, margin, status, is_late)


def _join(parts: Sequence[Location]) -> Location:
    """All results, sorted by point."""
    order = np.argsort(np.concatenate([part.point for part in parts]), kind="stable")
    names = [field.name for field in fields(Location)]
    return Location(**{name: np.concatenate([getattr(part, name) for part in parts])[order] for name in names})
