"""Values at scattered points as fields on the elements of a mesh, with estimates of what the points leave open.

Values are interpolated linearly on Delaunay's simplices, by splines, or from the nearest point.
In one coordinate the pieces lie between neighbouring points.  Linear functions are exact with ``linear`` and
``spline``; cubic ones also with ``spline`` in one coordinate.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Field
from elvis.core.numbers.queries import AXES, PointValues, values_in_table
from elvis.plugins.conversion.converting import Settings
from elvis.plugins.conversion.plugin import SourceField
from elvis.plugins.conversion.report import Report
from elvis.plugins.conversion.reporting import measures_of_fields
from elvis.plugins.data.added_quantities import unchanged_map, with_errors
from elvis.plugins.data.common_blocks import on_common_blocks
from elvis.plugins.transfers.field_passes import FieldPass, blocks_of
from elvis.plugins.transfers.other_mesh import OnMesh, outside_rule

KINDS = ("linear", "spline", "nearest")
#: suffixes of tables of points
SUFFIXES = (".csv", ".pts")

#: barycentric coordinates down to here count as inside, since borders of a mesh may lie on the hull of the points
_ON_HULL = -1e-9
#: points whose values determine a spline at a place; all of them if they are fewer than four times as many
_NEIGHBOURS = 64
#: one of this many points is left out for an estimate, at most so many, and of so many points at least
_SHARE, _MOST_LEFT_OUT, _LEAST = 10, 1000, 20

#: values (n, fields) at places (n, axes), and which of these (n,) the points cover
Interpolant = Callable[[Floats], tuple[Floats, Bools]]


def is_point_table(files: Sequence[Path]) -> bool:
    """Whether files are one table of points."""
    return len(files) == 1 and files[0].suffix.lower() in SUFFIXES


def points_onto_mesh(
    file: Path, target: Dataset, order: int | None, outside: str, kind: str, fields: Sequence[str] | None = None
) -> tuple[Dataset, Report]:
    """The values of a table as fields of a dataset's mesh, and the report of their errors.

    order    polynomial degree of the fields, 1 to 30; by default the order of the target's fields or expansions
    outside  ``error``, ``nan``, ``nearest`` or a number, for places outside the convex hull of the points
    kind     of interpolation: ``linear``, ``spline`` or ``nearest``

    ElvisError for points outside with ``error``, and for a table whose points don't span its coordinates.
    """
    table = _chosen(values_in_table(file), fields, target, file)
    order = _order_of(target, file) if order is None else order
    source = _PointSource(file, table, target, order, outside, kind)
    work = FieldPass(source, source.fields, Settings(order=order))
    measures = tuple(measures_of_fields(work.projection.fields, work.projection.findings.fields, source))
    solution = tuple(Field(own.name, blocks_of([work], own.name), own.is_continuous) for own in measures)
    held = tuple(own for own in target.fields if own.name in target.map_names)
    bare = replace(target, fields=(*held, *solution), time=None, expansions=(), session={}, remarks=())
    dataset = on_common_blocks(replace(bare, metadata=with_errors(bare, measures)))
    counts = {shape.label.lower(): len(entities) for shape, entities in target.mesh.elements.items()}
    notes = (*source.remarks_on_cover(), *_left_out(table, kind))
    report = Report(source.format, (file.name,), counts, unchanged_map(dataset), (0.0, -1), False, measures, {}, notes)
    return dataset, report


def _chosen(table: PointValues, fields: Sequence[str] | None, target: Dataset, file: Path) -> PointValues:
    """The chosen columns; coordinates that the mesh lacks are dropped if they are constant."""
    unknown = [name for name in fields or () if name not in table.names]
    if unknown:
        raise ElvisError(f"{file}: there is no column {unknown[0]!r}; the values are {', '.join(table.names)}")
    chosen = [i for i, name in enumerate(table.names) if fields is None or name in fields]
    axes = [i for i, axis in enumerate(table.axes) if axis < target.mesh.space]
    for i, axis in enumerate(table.axes):
        if i not in axes and np.ptp(table.points[:, i]) > 0:
            raise ElvisError(f"{file}: expected coordinates of the mesh, found {AXES[axis]}, which it doesn't have")
    # coincident points, such as nodes that elements share, count once, with their mean
    points, group = np.unique(table.points[:, axes], axis=0, return_inverse=True)
    totals = np.zeros((len(points), len(chosen)))
    np.add.at(totals, group.reshape(-1), table.values[:, chosen])
    values = totals / np.bincount(group.reshape(-1))[:, None]
    return PointValues(tuple(table.axes[i] for i in axes), points, tuple(table.names[i] for i in chosen), values)


def _order_of(target: Dataset, file: Path) -> int:
    """The order of a mesh's fields, else of its expansions."""
    modes = [max(block.expansion.modes) for own in target.solution for block in own.blocks]
    modes = modes or [max(rule.modes) for rule in target.expansions]
    if not modes:
        raise ElvisError(f"{file}: expected --order, as the mesh states no expansions and has no fields")
    return max(modes) - 1


class _PointSource(OnMesh):
    """The elements of a target, with values between points."""

    format = "values at points"

    def __init__(self, file: Path, table: PointValues, target: Dataset, order: int, outside: str, kind: str) -> None:
        super().__init__(target)
        self._file, self._table, self._outside = file, table, outside_rule(outside)
        self._interpolant = _interpolant(table, kind, file)
        self._nearest = _interpolant(table, "nearest", file)
        self._evaluated = self._uncovered = 0
        self.fields = [SourceField(name, order, False, False, i) for i, name in enumerate(table.names)]
        self._last: tuple[Floats, Floats] | None = None

    def values_at(self, places: Floats) -> Floats:
        """Interpolated values; at places that the points don't cover the values by ``outside``."""
        if self._last is None or not np.array_equal(self._last[0], places):
            self._last = places, self._values(places)
        return self._last[1]

    def _values(self, places: Floats) -> Floats:
        own = places[:, list(self._table.axes)]
        values, covered = self._interpolant(own)
        self._evaluated += len(own)
        self._uncovered += int((~covered).sum())
        if covered.all():
            return values.T
        if self._outside == "error":
            place = ", ".join(f"{number:.6g}" for number in places[~covered][0])
            raise ElvisError(
                f"--onto: the points of {self._file.name} don't cover the mesh, as at {place}: use --outside nearest, "
                "nan or a value"
            )
        filling = self._nearest(own[~covered])[0] if self._outside == "nearest" else float(self._outside)
        values[~covered] = filling
        return values.T

    def remarks_on_cover(self) -> list[str]:
        """Remarks on the share of places that the points don't cover."""
        if not self._uncovered:
            return []
        share = self._uncovered / self._evaluated
        filling = "the nearest point" if self._outside == "nearest" else self._outside
        return [f"{share:.2g} of the places on the mesh lie outside the hull of the points; values there: {filling}"]


def _left_out(table: PointValues, kind: str) -> list[str]:
    """Sentences on the differences at points that an interpolation of the others has not seen."""
    count = len(table.points)
    if count < _LEAST:
        return []
    order = np.random.default_rng(0).permutation(count)
    tested, others = np.split(order, [min(count // _SHARE, _MOST_LEFT_OUT)])
    kept = np.sort(others)
    rest = replace(table, points=table.points[kept], values=table.values[kept])
    found, covered = _interpolant(rest, kind, Path("the table"))(table.points[tested])
    if not covered.any():
        return []
    differences = np.abs(found - table.values[tested])[covered]
    return [
        f"{name} at points left out of the interpolation: off by up to {own.max():.2g}, root mean square "
        f"{np.sqrt((own**2).mean()):.2g}, of a range of {spread:.3g}"
        for name, own, spread in zip(table.names, differences.T, np.ptp(table.values, axis=0), strict=True)
    ]


def _interpolant(table: PointValues, kind: str, file: Path) -> Interpolant:
    """The interpolation of a kind; ElvisError for points that don't span their coordinates."""
    if kind == "nearest":
        return _nearest(table)
    if len(table.axes) == 1:
        return _along_axis(table, kind)
    return _on_simplices(table, kind, file)


def _nearest(table: PointValues) -> Interpolant:
    from scipy.spatial import cKDTree

    tree = cKDTree(table.points)
    return lambda places: (table.values[tree.query(places)[1]], np.ones(len(places), bool))


def _along_axis(table: PointValues, kind: str) -> Interpolant:
    """Values between sorted points of one coordinate: linear, or a cubic spline (de Boor, without a knot at the ends).

    A place outside counts as covered up to rounding.
    """
    from scipy.interpolate import CubicSpline, make_interp_spline

    line = table.points[:, 0]
    if len(line) < 2:
        raise ElvisError("expected at least two points, found one")
    curve = CubicSpline(line, table.values) if kind == "spline" else make_interp_spline(line, table.values, 1)
    margin = -_ON_HULL * (line[-1] - line[0])

    def at(places: Floats) -> tuple[Floats, Bools]:
        own = places[:, 0]
        return np.asarray(curve(own)), (own >= line[0] - margin) & (own <= line[-1] + margin)

    return at


def _on_simplices(table: PointValues, kind: str, file: Path) -> Interpolant:
    """Values on the simplices of a Delaunay triangulation, or thin plate splines inside its hull."""
    from scipy.interpolate import RBFInterpolator
    from scipy.spatial import Delaunay, QhullError

    axes = [AXES[axis] for axis in table.axes]
    try:
        simplices = Delaunay(table.points)
    except (QhullError, ValueError):
        raise ElvisError(
            f"{file}: expected points that span {' and '.join(axes)}, found fewer or on one line or plane: leave out "
            "columns of coordinates on which nothing depends, or pass --interpolation nearest"
        ) from None
    spline = None
    if kind == "spline":
        few = _NEIGHBOURS if len(table.points) > 4 * _NEIGHBOURS else None
        spline = RBFInterpolator(table.points, table.values, neighbors=few)

    def at(places: Floats) -> tuple[Floats, Bools]:
        simplex = simplices.find_simplex(places, tol=-_ON_HULL)
        if spline is not None:
            return np.asarray(spline(places)), simplex >= 0
        # barycentric coordinates in the simplex (scipy's documentation of Delaunay.transform)
        transform = simplices.transform[simplex]
        inner = np.einsum("nij,nj->ni", transform[:, :-1], places - transform[:, -1])
        weights = np.concatenate([inner, 1 - inner.sum(axis=1, keepdims=True)], axis=1)
        values = np.einsum("nk,nkf->nf", weights, table.values[simplices.simplices[simplex]])
        return values, simplex >= 0

    return at
