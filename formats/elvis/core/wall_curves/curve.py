"""Curves on boundaries by name, their lengths, and the values of quantities along them.

boundary:NAME                2D: the edges of a boundary, in order
section:NAME:plane:P:N       3D: where the plane through P at right angles to N meets the faces of a boundary

Values come from the element behind the side, so that quantities of walls, such as wall shear, have theirs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, partial

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, rows_by_number
from elvis.core.base.errors import ElvisError
from elvis.core.data.axis_planes import box_of, point_and_normal
from elvis.core.data.dataset import Dataset
from elvis.core.files.columns import Columns
from elvis.core.integrals.curves import Curve
from elvis.core.integrals.reference_cells import Piece
from elvis.core.integrals.targets import Places
from elvis.core.mapping import pointwise
from elvis.core.mapping.inverse import Status
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression, taken_name
from elvis.core.streamlines.walls import outward
from elvis.core.wall_curves.chains import chains, places_by_number, without_doubles
from elvis.core.wall_curves.plane_sections import Section, section
from elvis.core.wall_curves.segments import Segments, Straight

#: the words that names of curves begin with
BOUNDARY, SECTION = KINDS = ("boundary", "section")
_FORM = "section:NAME:plane:P:N"
#: advice for data of the other dimension, by the expected one
_OTHER = {2: "section:NAME:plane:P:N cuts walls of 3D data", 3: "boundary:NAME follows walls of 2D data"}
#: the end of a segment as a place in it: a parameter of 1 would belong to the next one
_LAST = 1 - 2.0**-40
#: columns of `on_walls` that quantities can't have
_OWN = ("curve", "length", "x/c")
#: maximum distance of ends at the same place, relative to the size of a curve
_MEETING = 1e-6
#: intervals of a segment, by which lengths are found
_INTERVALS = 6
#: a positive squared length for any coordinates
_SMALLEST = 1e-300


@dataclass(frozen=True, eq=False)
class WallPoints:
    """Points on a wall curve, n of them.

    curve    (n,)    number of the curve, 0 for the first
    length   (n,)    length of the curve up to the point
    points   (n, 3)
    normals  (n, 3)  unit normals out of the elements
    element  (n,)    ids of elements
    values   (n, k)  of the quantities
    """

    curve: Ints
    length: Floats
    points: Floats
    normals: Floats
    element: Ints
    values: Floats

    def columns(self, parts: Floats, are_several: bool) -> dict[str, Floats | Ints]:
        """All but the values as a table, with parts (n,) of the chord, and numbers of curves if there are several."""
        count = len(self.length)
        found: dict[str, Floats | Ints] = {"point": np.arange(count)}
        found |= {"curve": self.curve} if are_several else {}
        found |= {"length": self.length, "x/c": parts}
        found |= dict(zip("xyz", self.points.T, strict=True))
        found |= dict(zip(("nx", "ny", "nz"), self.normals.T, strict=True))
        return found | {"element": self.element, "status": np.full(count, int(Status.INSIDE))}


@dataclass(frozen=True, eq=False)
class WallCurve:
    """One connected curve on a wall.

    pieces     sides of elements
    kinds      of segments
    kind, row  (m,) the kind and the row in it of each segment, in order
    is_turned  (m,) whether it is passed from t = 1 to t = 0
    is_closed  whether the curve ends where it begins
    plane      a point (3,) and a normal (3,) of the plane that holds it; None for a 2D boundary
    """

    name: str
    pieces: Sequence[Piece]
    kinds: Sequence[Segments]
    kind: Ints
    row: Ints
    is_turned: Bools
    is_closed: bool
    plane: tuple[Floats, Floats] | None = None

    @cached_property
    def curve(self) -> Curve:
        """The curve in the world; its parameter is the number of a segment plus the place in it."""
        return Curve(self.name, len(self.row), self._at, _INTERVALS)

    def _at(self, t: Floats) -> tuple[Floats, Floats]:
        """Points (n, 3) and derivatives (n, 3)."""
        points, slopes = np.empty((len(t), 3)), np.empty((len(t), 3))
        for here, piece, rows, xi, slope in self._placed(t):
            reference = piece.places(xi)
            points[here] = pointwise.positions(piece.patch, rows, reference)
            along = piece.along(pointwise.jacobians(piece.patch, rows, reference))
            slopes[here] = np.einsum("ncd,nd->nc", along, slope)
        return points, slopes

    def _placed(self, t: Floats) -> Iterator[tuple[Ints, Piece, Ints, Floats, Floats]]:
        """Groups of parameters (n,): which, the piece, rows of its patch, reference points of sides, derivatives."""
        segment = np.clip(t.astype(np.int64), 0, len(self.row) - 1)
        within = t - segment
        own = np.where(self.is_turned[segment], 1 - within, within)
        sign = np.where(self.is_turned[segment], -1.0, 1.0)
        for number, kind in enumerate(self.kinds):
            here = np.flatnonzero(self.kind[segment] == number)
            if not len(here):
                continue
            which = self.row[segment[here]]
            xi, slope = kind.at(which, own[here])
            for piece, chosen in rows_by_number(kind.piece[which]):
                rows = self.pieces[piece].rows[kind.row[which[chosen]]]
                turned = sign[here[chosen], None] * slope[chosen]
                yield here[chosen], self.pieces[piece], rows, self._onto(piece, rows, xi[chosen]), turned

    def references(self, t: Floats) -> tuple[Floats, Ints]:
        """Reference points (n, 3) in elements, zero beyond their dimension, and ids (n,) of these."""
        reference, element = np.zeros((len(t), 3)), np.empty(len(t), np.int64)
        for here, piece, rows, xi, _ in self._placed(t):
            own = piece.places(xi)
            reference[here, : own.shape[1]] = own
            element[here] = piece.patch.element_ids[rows]
        return reference, element

    def _onto(self, piece: int, rows: Ints, xi: Floats) -> Floats:
        """(n, k) reference points of sides, moved onto the plane by a step of Newton's method on the elements' map."""
        if self.plane is None:
            return xi
        point, normal = self.plane
        own = self.pieces[piece]
        reference = own.places(xi)
        height = (pointwise.positions(own.patch, rows, reference) - point) @ normal
        slope = np.einsum("ncd,c->nd", own.along(pointwise.jacobians(own.patch, rows, reference)), normal)
        return np.asarray(xi - (height / np.maximum((slope**2).sum(axis=1), _SMALLEST))[:, None] * slope)

    @property
    def length(self) -> float:
        """Length of the curve."""
        return self.curve.length

    def taken(self, order: Ints) -> WallCurve:
        """The segments in another order."""
        return replace(self, kind=self.kind[order], row=self.row[order], is_turned=self.is_turned[order])

    def turned(self, corners: Floats) -> tuple[WallCurve, Floats]:
        """The curve from its end to its start, and the ends (m + 1, 3) of its segments in this order."""
        other = self.taken(np.arange(len(self.row))[::-1])
        return replace(other, is_turned=~other.is_turned), corners[::-1]

    def sample(self, evaluator: Evaluator, count: int, number: int = 0) -> WallPoints:
        """Values at ``count`` equidistant points by length, both ends included; a closed curve has its start twice."""
        t, lengths = self.curve.parameters(count)
        return self.values(evaluator, evaluator.expressions, t, lengths, number)

    def values(
        self, evaluator: Evaluator, expressions: Sequence[Expression], t: Floats, lengths: Floats, number: int = 0
    ) -> WallPoints:
        """Values of expressions at parameters t (n,), up to which the curve has lengths (n,)."""
        count = len(t)
        points, normals = np.empty((count, 3)), np.empty((count, 3))
        element, values = np.empty(count, np.int64), np.empty((count, len(expressions)))
        for here, piece, rows, xi, _ in self._placed(t):
            reference = piece.places(xi)
            normals[here] = outward(piece, pointwise.jacobians(piece.patch, rows, reference))
            places = ElementPoints(piece.patch, rows, reference, normals[here])
            points[here], element[here] = places.positions, piece.patch.element_ids[rows]
            for column, own in enumerate(evaluator.values_at(expressions, places)):
                values[here, column] = own
        return WallPoints(np.full(count, number), lengths, points, normals, element, values)


def is_wall_curve(name: str) -> bool:
    """Whether a name denotes a curve on a boundary."""
    return name.partition(":")[0] in KINDS and ":" in name


def wall_curves(
    dataset: Dataset, name: str, expressions: Sequence[Expression] = ()
) -> tuple[list[WallCurve], Evaluator]:
    """The connected curves of a name, and what evaluates quantities on them; the longest curve comes first.

    Closed curves begin at the point with the largest x, as airfoils do at their trailing edge, and run
    counter-clockwise about +z or about the plane's normal.  Open ones begin where x is smallest.

    Raises ElvisError for names of no curve, for boundaries that the data don't have, and for data without walls of
    this dimension.
    """
    evaluator = Evaluator(dataset, expressions)
    return curves_with(dataset, name, evaluator), evaluator


def curves_with(dataset: Dataset, name: str, evaluator: Evaluator) -> list[WallCurve]:
    """The curves of `wall_curves` on the elements of an evaluator."""
    kind, _, rest = name.partition(":")
    if any(patch.homogeneous for patch in evaluator.patches):
        raise ElvisError(f"{name}: expected data without Fourier directions")
    kinds: list[Segments]
    plane: tuple[Floats, Floats] | None
    if kind == BOUNDARY:
        pieces = _sides(dataset, evaluator, rest, 2, name)
        kinds, axis, plane = [_edges(pieces)], np.array([0.0, 0.0, 1.0]), None
    else:
        boundary, point, axis = _plane(dataset, rest, name)
        pieces = _sides(dataset, evaluator, boundary, 3, name)
        found = section(pieces, point, axis)
        _check(found, name, boundary)
        kinds, plane = [*found.graphs, found.straight], (point, axis)
    return _connected(WallCurve(name, pieces, kinds, *_every(kinds), plane), axis)


def _sides(dataset: Dataset, evaluator: Evaluator, boundary: str, dimension: int, name: str) -> list[Piece]:
    """`wall_sides` of data of a dimension; raises ElvisError for others."""
    if dataset.mesh.dimension != dimension:
        raise ElvisError(f"{name}: expected {dimension}D data, found {dataset.mesh.dimension}D; {_OTHER[dimension]}")
    return wall_sides(dataset, evaluator, boundary, name)


def wall_sides(dataset: Dataset, evaluator: Evaluator, boundary: str, name: str) -> list[Piece]:
    """The sides of a boundary, or of all outer ones, as pieces of elements; ``name`` begins what errors say."""
    target = Places(dataset, evaluator.patches, {}).named(boundary)
    rows = (target.total,) if target.total is not None else target.rows
    pieces = [piece for row in rows for piece in row.pieces if isinstance(piece, Piece) and piece.is_side]
    if not pieces:
        raise ElvisError(f"{name}: expected the name or id of a boundary, found {boundary!r}")
    return pieces


def _plane(dataset: Dataset, text: str, name: str) -> tuple[str, Floats, Floats]:
    """The boundary, and the point (3,) and normal (3,) of the plane, from a text NAME:plane:P:N."""
    boundary, found, numbers = text.rpartition(":plane:")
    try:
        parts = point_and_normal(numbers, partial(box_of, dataset)).split(":")
        point, normal = (np.array([float(x) for x in part.split(",")]) for part in parts)
        if not found or not boundary or not point.shape == normal.shape == (3,):
            raise ValueError
        if not np.isfinite([point, normal]).all() or not normal.any():
            raise ValueError
    except ValueError:
        raise ElvisError(f"expected {_FORM}, such as section:wing:plane:0,0.5,0:0,1,0, found {name!r}") from None
    return boundary, point, normal / np.linalg.norm(normal)


def _check(found: Section, name: str, boundary: str) -> None:
    """Raise ElvisError if the plane misses the boundary, holds sides of it, or touches it."""
    if found.in_plane:
        raise ElvisError(f"{name}: the plane holds {found.in_plane} sides of {boundary}; expected one that cuts it")
    if len(found.touching):
        place = ", ".join(f"{x:.3g}" for x in found.touching[0])
        raise ElvisError(f"{name}: the plane touches a side of {boundary} near ({place}); move it a little")
    if not len(found.straight.row) and not any(len(own.row) for own in found.graphs):
        raise ElvisError(f"{name}: the plane does not intersect {boundary}")


def _edges(pieces: Sequence[Piece]) -> Straight:
    """Edges of plane elements, each a segment."""
    piece = np.concatenate([np.full(len(own), number) for number, own in enumerate(pieces)])
    row = np.concatenate([np.arange(len(own)) for own in pieces])
    ends = np.ones((len(row), 1))
    return Straight(piece, row, -ends, ends)


def _every(kinds: Sequence[Segments]) -> tuple[Ints, Ints, Bools, bool]:
    """Kind, row and direction of all segments, as if they were one open curve."""
    kind = np.concatenate([np.full(len(own.row), number) for number, own in enumerate(kinds)])
    row = np.concatenate([np.arange(len(own.row)) for own in kinds])
    return kind, row, np.zeros(len(row), bool), False


def _connected(every: WallCurve, axis: Floats) -> list[WallCurve]:
    """All segments as curves, the longest first."""
    t = np.arange(len(every.row))[:, None] + np.array([0.0, 0.5, _LAST])
    points = every.curve.at(t.reshape(-1))[0].reshape(-1, 3, 3)
    kept = without_doubles(points)
    ends = places_by_number(points[kept][:, [0, 2]].reshape(-1, 3)).reshape(-1, 2)
    found = []
    for order, is_turned, is_closed in chains(ends):
        chosen = kept[order]
        own = replace(every.taken(chosen), is_turned=is_turned, is_closed=is_closed)
        corners = np.where(is_turned[:, None], points[chosen, 2], points[chosen, 0])
        last = points[chosen[-1], 0 if is_turned[-1] else 2]
        found.append(_oriented(own, np.vstack([corners, last]), axis))
    return sorted(found, key=lambda own: -own.length)


def _oriented(own: WallCurve, corners: Floats, axis: Floats) -> WallCurve:
    """A curve that begins and runs as `wall_curves` says; corners (m + 1, 3) are the ends of its segments, in order."""
    if own.is_closed:
        area = np.cross(corners[:-1], corners[1:]).sum(axis=0) @ axis
        own, corners = own.turned(corners) if area < 0 else (own, corners)
        first = int(corners[:-1, 0].argmax())
        order = np.roll(np.arange(len(own.row)), -first)
        return own.taken(order)
    is_ahead = tuple(corners[0]) <= tuple(corners[-1])
    return own if is_ahead else own.turned(corners)[0]


def on_walls(
    dataset: Dataset,
    name: str,
    expressions: Sequence[Expression],
    count: int,
    chord: tuple[Sequence[float], Sequence[float]] | None = None,
) -> Columns:
    """A table of quantities along the curves of a name: ``count`` points in total, divided by the curves' lengths.

    chord  the points with x/c = 0 and x/c = 1; None for the ends of an open curve, or the two most distant points of a
           closed one

    Columns: point; curve, if there are several; length, x/c, x, y, z, nx, ny, nz, element, status, the quantities.
    Raises as `wall_curves`.

    >>> table = on_walls(ds, "boundary:airfoil", [Expression.of(ds, "p")], 200)  # doctest: +SKIP
    """
    taken = [own.text for own in expressions if own.text in _OWN]
    if taken:
        raise ElvisError(taken_name(taken[0]))
    curves, evaluator = wall_curves(dataset, name, expressions)
    counts = _shared(curves, count)
    several = [own.sample(evaluator, n, k) for k, (own, n) in enumerate(zip(curves, counts, strict=True))]
    whole = WallPoints(*(np.concatenate([getattr(own, f.name) for own in several]) for f in fields(WallPoints)))
    first, last = _chord(curves[0], several[0].points) if chord is None else np.array(chord, np.float64)
    along = {own.text: column for own, column in zip(expressions, whole.values.T, strict=True)}
    return whole.columns(_parts(whole.points, first, last, name), len(curves) > 1) | along


def points_along(dataset: Dataset, name: str, count: int) -> Floats:
    """(n, 3) ``count`` equidistant points of any curve, divided by length if a name matches several curves.

    Raises ElvisError for names that are not curves.
    """
    if is_wall_curve(name):
        curves = [own.curve for own in wall_curves(dataset, name)[0]]
        counts = _shared(curves, count)
        return np.concatenate([own.evenly(n)[0] for own, n in zip(curves, counts, strict=True)])
    curve = Curve.parse(dataset, name)
    if curve is None:
        raise ElvisError(f"expected a curve, found {name!r}")
    return curve.evenly(count)[0]


def _shared(curves: Sequence[WallCurve | Curve], count: int) -> list[int]:
    """Number of points of each curve, for a total of ``count``."""
    lengths = np.array([own.length for own in curves])
    shares = np.round(count * lengths / lengths.sum())
    return [max(2, int(own)) for own in shares]


def _parts(points: Floats, first: Floats, last: Floats, name: str) -> Floats:
    """(n,) places of points (n, 3) along a chord between two points (3,), from 0 to 1."""
    size = float((last - first) @ (last - first))
    if not size > 0:
        raise ElvisError(f"{name}: expected a chord with two different ends")
    return np.asarray((points - first) @ (last - first) / size)


def _chord(curve: WallCurve, points: Floats) -> tuple[Floats, Floats]:
    """The ends (3,) of the chord of a curve with points (n, 3); that with the lesser x comes first."""
    first, last = points[0], points[-1]
    # an open curve may end where it begins, where other curves meet it
    if curve.is_closed or np.linalg.norm(last - first) <= _MEETING * np.ptp(points, axis=0).max():
        distances = np.linalg.norm(points[:, None] - points[None], axis=2)
        first, last = points[list(np.unravel_index(distances.argmax(), distances.shape))]
    return (first, last) if tuple(first) <= tuple(last) else (last, first)
