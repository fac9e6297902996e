"""The elements of one dataset, with the fields of another at their places."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.distances import nearest, surface_of
from elvis.core.integrals.reference_cells import Piece
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Location, Locator
from elvis.core.mapping.patch import patches
from elvis.core.quantities.elements.points import ElementPoints
from elvis.plugins.conversion.plugin import Elements, SourceField
from elvis.plugins.transfers.field_passes import DatasetSource

#: treatments of points outside the source, apart from a number
OUTSIDE = ("error", "nan", "nearest")
#: by how much of an element points on its border are moved inwards
_OFF_BORDERS = 1e-12
#: by how much of its distance a point is moved inwards from the boundary
_INWARDS = 1e-9


class OnMesh(DatasetSource):
    """The elements of a target, with fields that are given at places; the key of each field is its number."""

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """No files."""
        return False

    def __init__(self, target: Dataset) -> None:
        self.dataset, self.mesh, self.own = target, target.mesh, patches(target)
        self.blocks = [
            Elements(own.shape, len(own), max(own.geometry.modes) - 1, ids=own.element_ids, key=number)
            for number, own in enumerate(self.own)
        ]

    @abstractmethod
    def values_at(self, places: Floats) -> Floats:
        """Values (fields, n) at world points (n, 3)."""

    def positions(self, block: Elements, points: Floats) -> Floats:
        """The map of the target."""
        return self._places(block, points).reshape(len(block), len(points), 3)

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """The values of the source there; on borders those from inside, where the source may jump."""
        inner = points + _OFF_BORDERS * (block.shape.centre - points)
        values = self.values_at(self._places(block, inner))[field.key]
        return np.asarray(values.reshape(len(block), len(points)))

    def _places(self, block: Elements, points: Floats) -> Floats:
        patch = self.own[block.key]
        rows = np.repeat(np.arange(len(patch))[block.rows], len(points))
        return ElementPoints(patch, rows, np.tile(points, (len(block), 1))).positions


class OtherMesh(OnMesh):
    """The elements of a target, with the fields of a source at their places.

    is_affine  for each patch of the source which of its elements (n,) have affine maps
    """

    format = "fields of another mesh"

    def __init__(
        self, source: Dataset, target: Dataset, order: int | None, outside: str, fields: Sequence[str] | None
    ) -> None:
        super().__init__(target)
        known = [own.name for own in source.solution]
        for name in fields or ():
            if name not in known:
                raise ElvisError(f"there is no field {name!r}; the fields are {', '.join(known) or 'none'}")
        self._names = known if fields is None else [name for name in known if name in fields]
        if not self._names:
            raise ElvisError("--onto: expected fields to project, found none")
        self._outside = outside_rule(outside)
        self._source = source
        self._patches = patches(source, self._names)
        if any(patch.homogeneous for patch in self._patches):
            raise ElvisError("--onto: expected data without Fourier directions")
        self._locator = Locator(self._patches)
        self.is_affine = [Piece(own, np.arange(len(own)), own.shape).is_affine for own in self._patches]
        self.fields = [
            SourceField(name, order or self._degree(i), False, False, i) for i, name in enumerate(self._names)
        ]
        if order is not None and not 1 <= order <= 30:
            raise ElvisError(f"expected an order from 1 to 30, found {order}")
        self._last: tuple[Floats, Location, Floats] | None = None

    def _degree(self, number: int) -> int:
        held = [patch.fields[number] for patch in self._patches]
        return max(max(own.modes) - 1 for own in held if own is not None)

    @property
    def degree(self) -> int:
        """The highest of any field."""
        return max(self._degree(number) for number in range(len(self._names)))

    def values_at(self, places: Floats) -> Floats:
        """The values of the source."""
        return self.at(places)[1]

    def locate(self, places: Floats) -> Location:
        """Locations of world points (n, 3) in the source."""
        return self._locator.locate(places)

    def is_near(self, places: Floats, reach: float) -> Bools:
        """(n,) whether elements may be within the box of points (n, k, 3), enlarged by a part of its diagonal."""
        low, high = places.min(axis=1), places.max(axis=1)
        extra = reach * np.linalg.norm(high - low, axis=1, keepdims=True)
        near = np.zeros(len(places), bool)
        near[self._locator.tree.overlaps(low - extra, high + extra)[0]] = True
        return near

    def in_elements(self, number: int, rows: Ints, places: Floats) -> tuple[Bools, Floats]:
        """Which world points (n, 3) are outside elements ``rows`` (n,) of a patch, and values (fields, n) in these."""
        roots = self._locator.invert(number, rows, places)
        is_outside = roots.status != Status.INSIDE
        found = np.full((len(self._names), len(places)), np.nan)
        here = np.flatnonzero(~is_outside)
        points = ElementPoints(self._patches[number], rows[here], roots.reference[here])
        for i in range(len(self._names)) if len(here) else ():
            found[i, here] = points.derivative(i, 0)
        return is_outside, found

    def at(self, places: Floats) -> tuple[Location, Floats]:
        """Locations of world points (n, 3) in the source, and the values (fields, n) there."""
        if self._last is None or not np.array_equal(self._last[0], places):
            location = self._locator.locate(places)
            self._last = places, location, self._values(places, location)
        return self._last[1], self._last[2]

    def _values(self, places: Floats, location: Location) -> Floats:
        found = self._inside(location)
        missing = ~(location.status == Status.INSIDE)
        if not missing.any():
            return found
        if self._outside == "error":
            x, y, z = places[missing][0]
            raise ElvisError(
                f"--onto: the data don't cover the target, as at {x:.6g}, {y:.6g}, {z:.6g}: "
                "use --outside nearest, nan or a value"
            )
        if self._outside == "nearest":
            found[:, missing] = self._nearest(places[missing])
        elif self._outside != "nan":
            found[:, missing] = float(self._outside)
        return found

    def _inside(self, location: Location) -> Floats:
        """(fields, n) values at located points, NaN elsewhere."""
        found = np.full((len(self._names), len(location)), np.nan)
        for number, patch in enumerate(self._patches):
            here = np.flatnonzero((location.status == Status.INSIDE) & (location.patch == number))
            points = ElementPoints(patch, location.row[here], location.reference[here, : patch.dimension])
            for i in range(len(self._names)) if len(here) else ():
                found[i, here] = points.derivative(i, 0)
        return found

    def _nearest(self, places: Floats) -> Floats:
        """(fields, n) values at the nearest points of the boundary."""
        feet = nearest(surface_of(self._source, "all"), places).place
        found = self._inside(self._locator.locate(feet))
        # a foot may lie outside by rounding
        lost = np.isnan(found).any(axis=0)
        if lost.any():
            inwards = feet[lost] + _INWARDS * (feet[lost] - places[lost])
            found[:, lost] = self._inside(self._locator.locate(inwards))
        return found


def outside_rule(outside: str) -> str:
    """One of OUTSIDE, or a number; ElvisError for others."""
    if outside in OUTSIDE:
        return outside
    try:
        if np.isfinite(float(outside)):
            return outside
    except ValueError:
        pass
    raise ElvisError(f"--outside: expected error, nan, nearest or a number, found {outside!r}")
