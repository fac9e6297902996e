"""Seeds of streamlines: points, or texts that describe many.

point:X,Y,Z                  a point
line:P:Q:N                   N points from P to Q, both included
circle:C:NORMAL:R:N          N equidistant points of a curve; also polyline:P:Q:…:N, spline:P:Q:…:N,
                             normal:BOUNDARY:P:LENGTH:N and section:BOUNDARY:plane:P:NORMAL:N
disc:C:NORMAL:R:N            N points over a disc, evenly
grid:LOW:HIGH:NX,NY,NZ       a lattice over a box, ends included
plane:POINT:NORMAL:N         a square lattice on a cut plane, N points along the box's longest side, restricted to the
                             elements
elements                     the centre of each element
boundary:NAME:N              a lattice of N points per direction on each face of a boundary, N per edge in 2D
random:N, random:N:LOW:HIGH  N random points, uniform over the elements, or over their part in a box
a name of a file             the points of a table with columns x, y, z
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints, grid_points, rows_by_number
from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.data.axis_planes import Corners, box_of, with_normals
from elvis.core.data.dataset import Dataset
from elvis.core.distances.boundaries import ALL
from elvis.core.integrals.reference_cells import Piece
from elvis.core.integrals.targets import Places
from elvis.core.mapping import pointwise
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Locator
from elvis.core.mapping.patch import Patch
from elvis.core.numbers.queries import points_in_table, points_on_line
from elvis.core.numbers.sampling import world_points
from elvis.core.quantities.names import Names
from elvis.core.streamlines.seed_forms import CURVES, FORMS, names_file
from elvis.core.wall_curves import points_along

_Parts = Sequence[str]
#: seeds of a text at most, and how often random ones are drawn until enough lie in elements
_MOST, _DRAWS = 1_000_000, 100


@dataclass(frozen=True, eq=False)
class SeedPlaces:
    """The data to which texts refer.

    dimension    number of coordinates
    locator      finds elements
    positions    (n, 3) world points of reference points (n, D) in elements: patches (n,) and rows in them (n,)
    on_boundary  (n, 3) centres of k x k equal parts of each side of a boundary by its name, k of each edge in 2D;
                 raises ElvisError for an unknown name
    on_curve     (n, 3) equidistant points of a curve by its name; raises ElvisError for an unknown name
    corners      of the box of the data
    """

    dimension: int
    locator: Locator
    positions: Callable[[Ints, Ints, Floats], Floats]
    on_boundary: Callable[[str, int], Floats]
    on_curve: Callable[[str, int], Floats]
    corners: Corners

    @staticmethod
    def of(dataset: Dataset, locator: Locator, patches: Sequence[Patch] | None = None) -> SeedPlaces:
        """The places of a dataset.

        ``patches`` are the elements whose sides are boundaries, None for the locator's elements.
        """
        sides = tuple(locator.patches if patches is None else patches)

        def positions(patch: Ints, row: Ints, points: Floats) -> Floats:
            found = np.empty((len(points), 3))
            for number, here in rows_by_number(patch):
                found[here] = pointwise.positions(locator.patches[number], row[here], points[here])
            return found

        def on_boundary(name: str, count: int) -> Floats:
            return _on_boundary(dataset, sides, name, count)

        def on_curve(name: str, count: int) -> Floats:
            return points_along(dataset, name, count)

        corners = partial(box_of, dataset)
        return SeedPlaces(Names.of(dataset).dimension, locator, positions, on_boundary, on_curve, corners)


def seed_points(places: SeedPlaces, seeds: Any, random: int = 0) -> Floats:
    """(n, 3) seeds from points (n, d), a text or several (see above); raises ElvisError for invalid ones.

    random  seed of the random number generator: the same points each time
    """
    if isinstance(seeds, (str, Path)):
        seeds = [seeds]
    if isinstance(seeds, Sequence) and seeds and all(isinstance(seed, (str, Path)) for seed in seeds):
        found = np.concatenate([_Reader(places, random).points(str(seed)) for seed in seeds])
    else:
        found = world_points(seeds, places.dimension)
    if not len(found):
        raise ElvisError("expected at least one seed, found none")
    return found


class _Reader:
    """Points of seed texts in data."""

    def __init__(self, places: SeedPlaces, random: int) -> None:
        self.places, self.locator = places, places.locator
        self._draw = np.random.default_rng(random)
        self._kinds: Mapping[str, tuple[tuple[int, ...], Callable[[_Parts], Floats]]] = {
            "point": ((1,), self._point),
            "line": ((3,), self._line),
            "disc": ((4,), self._disc),
            "grid": ((3,), self._grid),
            "plane": ((3,), self._plane),
            "elements": ((1,), self._elements),
            "boundary": ((1, 2), self._boundary),
            "random": ((1, 3), self._random),
        }

    def points(self, text: str) -> Floats:
        """(n, 3) the points of one text."""
        known = f"random:{text}" if text.isdecimal() else with_normals(text, self.places.corners)
        kind, _, rest = known.partition(":")
        if kind in CURVES:
            return self._curve(text)
        if kind not in self._kinds:
            if names_file(text) or Path(text).exists():
                return points_in_table(text)
            known = ", ".join(FORMS.values())
            hint = perhaps(kind, (*self._kinds, *CURVES))
            raise ElvisError(f"expected seeds as one of {known}, or a file of points, found {text!r}{hint}")
        counts, make = self._kinds[kind]
        parts = rest.split(":")
        try:
            if len(parts) not in counts:
                raise ValueError
            return make(parts)
        except ValueError:
            raise ElvisError(f"expected seeds as {FORMS[kind]}, found {text!r}") from None

    def _curve(self, text: str) -> Floats:
        """Points at even steps of a curve, both ends included."""
        name, _, count = text.rpartition(":")
        if not count.isdecimal() or not 2 <= int(count) <= _MOST:
            form = FORMS[text.partition(":")[0]]
            raise ElvisError(f"expected seeds as {form}, N from 2 to {_MOST}, found {text!r}")
        return self.places.on_curve(name, int(count))

    def _point(self, parts: _Parts) -> Floats:
        return _triple(parts[0])[None]

    def _line(self, parts: _Parts) -> Floats:
        return points_on_line(_triple(parts[0]), _triple(parts[1]), _count(parts[2]))  # type: ignore[arg-type]

    def _disc(self, parts: _Parts) -> Floats:
        """Vogel's spiral (Mathematical Biosciences 44, 1979): each point has the same area of the disc."""
        centre, normal, count = _triple(parts[0]), _triple(parts[1]), _count(parts[3])
        axes = _across(normal)
        order = np.arange(count)
        radius = float(parts[2]) * np.sqrt((order + 0.5) / count)
        angle = order * np.pi * (3 - np.sqrt(5))
        plane = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        found: Floats = centre + plane @ axes
        return found

    def _grid(self, parts: _Parts) -> Floats:
        low, high = _triple(parts[0]), _triple(parts[1])
        counts = [_count(part) for part in parts[2].replace("x", ",").split(",")]
        counts += [1] * (3 - len(counts))
        if len(counts) != 3 or np.prod(counts) > _MOST:
            raise ValueError
        lines = [
            np.linspace(a, b, count) if count > 1 else np.array([(a + b) / 2])
            for a, b, count in zip(low, high, counts, strict=True)
        ]
        return grid_points(*lines)

    def _plane(self, parts: _Parts) -> Floats:
        """The middles of equal squares of the plane, over all of the box of all elements."""
        point, normal, count = _triple(parts[0]), _triple(parts[1]), _count(parts[2])
        if count > np.sqrt(_MOST):
            raise ValueError
        axes, box = _across(normal), np.asarray(self.locator.tree.nodes[0], np.float64)
        low, high = box[:3], box[3:]
        corners = grid_points(*zip(low, high, strict=True))
        seen = (corners - point) @ axes.T
        start, extent = seen.min(axis=0), np.ptp(seen, axis=0)
        side = float(extent.max()) / count
        numbers = [np.arange(max(1, round(length / side))) for length in extent]
        places = grid_points(*numbers)
        found = point + (start + (places + 0.5) * side) @ axes
        # on planes along an axis no rounding leads away from them
        found[:, np.abs(axes).max(axis=0) == 0] = point[np.abs(axes).max(axis=0) == 0]
        inside: Floats = found[self.locator.locate(found).status == Status.INSIDE]
        if not len(inside):
            raise ElvisError(f"plane:{':'.join(parts)}: expected elements on the plane, found none at its points")
        return inside

    def _elements(self, parts: _Parts) -> Floats:
        """The images of the reference elements' centroids."""
        if parts != [""]:
            raise ValueError
        found = []
        for number, patch in enumerate(self.locator.patches):
            middle = np.zeros(patch.dimension)
            middle[: patch.shape.dimension] = patch.shape.centre
            rows = np.arange(len(patch))
            middles = np.tile(middle, (len(patch), 1))
            found.append(self.places.positions(np.full(len(patch), number), rows, middles))
        return np.concatenate(found)

    def _boundary(self, parts: _Parts) -> Floats:
        """The middles of equal parts of each side, in its collapsed coordinates."""
        return self.places.on_boundary(parts[0], _count(parts[1]) if len(parts) > 1 else 1)

    def _random(self, parts: _Parts) -> Floats:
        """Random points of the box of all elements, restricted to the elements."""
        count = _count(parts[0])
        box = np.asarray(self.locator.tree.nodes[0], np.float64)
        low, high = box[:3], box[3:]
        dimension = self.places.dimension
        low[dimension:], high[dimension:] = 0.0, 0.0
        if len(parts) > 1:
            low, high = np.maximum(low, _triple(parts[1])), np.minimum(high, _triple(parts[2]))
        found, held = [np.empty((0, 3))], 0
        for _ in range(_DRAWS):
            drawn = low + (high - low) * self._draw.random((count, 3))
            inside = drawn[self.locator.locate(drawn).status == Status.INSIDE] if (high >= low).all() else drawn[:0]
            found.append(inside)
            held += len(inside)
            if held >= count:
                return np.concatenate(found)[:count]
        raise ElvisError(f"random:{':'.join(parts)}: expected elements in the box, found {held} of {count} seeds")


def part_middles(count: int, dimension: int) -> Floats:
    """(count^d, d) the middles of equal parts of [-1, 1]^d."""
    middles = (2 * np.arange(count) + 1) / count - 1
    return grid_points(*[middles] * dimension)


def check_boundary(name: str, known: Sequence[str]) -> None:
    """Raise ElvisError for a name that no boundary has."""
    if name not in known:
        raise ElvisError(f"there is no boundary {name!r}{perhaps(name, known)}; there are {', '.join(known)}")


def _on_boundary(dataset: Dataset, patches: Sequence[Patch], name: str, count: int) -> Floats:
    """(n, 3) the middles of equal parts of each side of a boundary, in its collapsed coordinates."""
    sides = Places(dataset, tuple(patches), {})
    check_boundary(name, (ALL, *sides.boundaries))
    found = []
    for target in sides.named(name).rows:
        for piece in target.pieces:
            assert isinstance(piece, Piece)
            places = piece.points(part_middles(count, piece.dimension))
            rows = np.repeat(piece.rows, len(places))
            found.append(pointwise.positions(piece.patch, rows, np.tile(places, (len(piece), 1))))
    return np.concatenate(found)


def _across(normal: Floats) -> Floats:
    """(2, 3) unit vectors across a normal (3,) and each other, along axes where it is; raises ValueError for none."""
    size = float(np.linalg.norm(normal))
    if not 0 < size < np.inf:
        raise ValueError
    axes: Floats = np.linalg.svd(normal[None] / size)[2][1:]
    return axes


def _triple(text: str) -> Floats:
    """``0,0.5`` or ``0,0.5,1`` as (3,); raises ValueError for another text."""
    found = np.array([float(part) for part in text.split(",")])
    if len(found) not in (2, 3) or not np.isfinite(found).all():
        raise ValueError
    return np.pad(found, (0, 3 - len(found)))


def _count(text: str) -> int:
    """A number of points; raises ValueError for another text."""
    found = int(text)
    if not 1 <= found <= _MOST:
        raise ValueError
    return found
