"""From a mesh named by global ids to the mesh in memory: ids become rows, and everything named must exist."""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Floats, Ints, frozen_floats, frozen_ints
from elvis.core.errors import FormatError
from elvis.core.mesh import Composite, Curves, Entities, Mesh
from elvis.core.polynomials.points import PointsType
from elvis.core.shapes import Shape
from elvis.formats.nektar.lookup import Lookup
from elvis.formats.nektar.raw import RawCurves, RawGeometry

#: dimension of what the tags name that stand for no one shape
_DIMENSIONS = {"V": 0, "E": 1, "F": 2}


def assemble(raw: RawGeometry) -> Mesh:
    """The mesh; FormatError where an id is unknown or given twice, or a curve or coordinate can't be.

    The members in ``raw`` are overwritten, so that a mesh is never held twice.
    """
    try:
        return _assembled(raw)
    except FormatError as error:
        raise error.within(raw.file, "GEOMETRY") from error


def _assembled(raw: RawGeometry) -> Mesh:
    lookups = _lookups(raw)
    top = lookups[raw.dimension]
    if not len(top.ids):
        raise FormatError(f"expected elements of dimension {raw.dimension}, found none")
    composites = _composites(raw, lookups)
    return Mesh(
        raw.dimension,
        raw.space,
        frozen_ints(raw.vertex_ids),
        _coordinates(raw.vertices, raw.space, "vertices"),
        {shape: _entities(shape, *table, lookups[shape.dimension - 1]) for shape, table in raw.tables.items()},
        _edge_curves(raw, lookups[1]),
        _face_curves(raw, lookups[2]),
        composites,
        _domains(raw, composites),
    )


def _lookups(raw: RawGeometry) -> list[Lookup]:
    """Vertices, edges, faces and volume elements by dimension; faces are the triangles, then the quadrilaterals."""
    names = ["vertex", "edge", "face", "element"]
    names[raw.dimension] = "element"
    ids = [np.concatenate([_ids(raw, shape) for shape in Shape.of_dimension(d)]) for d in (1, 2, 3)]
    return [Lookup(numbers, name) for numbers, name in zip([raw.vertex_ids, *ids], names, strict=True)]


def _entities(shape: Shape, ids: Ints, members: Ints, lookup: Lookup) -> Entities:
    return Entities(frozen_ints(ids), frozen_ints(lookup.into_rows(members, f"entries {shape.tag}")))


def _ids(raw: RawGeometry, shape: Shape) -> Ints:
    return raw.tables[shape][0] if shape in raw.tables else np.empty(0, np.int64)


def _coordinates(points: Floats, space: int, what: str) -> Floats:
    """Finite points, what lies beyond the space set to zero."""
    if not np.isfinite(points).all():
        row = int(np.flatnonzero(~np.isfinite(points).all(axis=1))[0])
        raise FormatError(f"expected finite coordinates of {what}, found {points[row]} in row {row}")
    if space < 3 and points[:, space:].any():
        points = points.copy()
        points[:, space:] = 0.0
    return frozen_floats(points)


def _edge_curves(raw: RawGeometry, edges: Lookup) -> Curves:
    curves = raw.edge_curves
    _check_counts(curves, curves.counts >= 2, "at least 2 points on an edge")
    return _curves(raw, curves, edges, "curved edges")


def _face_curves(raw: RawGeometry, faces: Lookup) -> Curves:
    """Curved faces: so many points as a triangle or a square of them needs."""
    curves = raw.face_curves
    nodal = np.isin(curves.kinds, [kind for kind in PointsType if kind.is_triangular])
    on_triangle = np.isin(curves.entities, _ids(raw, Shape.TRIANGLE))
    side = np.rint(np.sqrt(np.clip(curves.counts, 0, None).astype(float))).astype(np.int64)
    half = ((np.sqrt(8.0 * np.clip(curves.counts, 0, None) + 1) - 1) / 2 + 0.5).astype(np.int64)
    _check_counts(curves, nodal <= on_triangle, "nodes of a triangle on triangles only")
    _check_counts(curves, nodal | ((side * side == curves.counts) & (side > 1)), "a square number of points on a face")
    fits = (half * (half + 1) // 2 == curves.counts) & (half > 1)
    _check_counts(curves, ~nodal | fits, "n(n+1)/2 points on a face")
    return _curves(raw, curves, faces, "curved faces")


def _check_counts(curves: RawCurves, holds: np.ndarray[tuple[int, ...], np.dtype[np.bool_]], expected: str) -> None:
    if not holds.all():
        first = int(np.flatnonzero(~holds)[0])
        label = _family(int(curves.kinds[first]))
        raise FormatError(f"expected {expected}, found {curves.counts[first]} {label} on {curves.entities[first]}")


def _family(kind: int) -> str:
    return PointsType(kind).label if kind in set(PointsType) else f"points of family {kind}"


def _curves(raw: RawGeometry, curves: RawCurves, lookup: Lookup, what: str) -> Curves:
    _check_counts(curves, np.isin(curves.kinds, [k for k in PointsType if k]), "a known family of points")
    Lookup(curves.entities, what[:-1])
    return Curves(
        frozen_ints(lookup.rows(curves.entities, what)),
        frozen_ints(curves.kinds),
        frozen_ints(np.append(0, np.cumsum(curves.counts))),
        _coordinates(curves.points, raw.space, what),
    )


def _composites(raw: RawGeometry, lookups: list[Lookup]) -> tuple[Composite, ...]:
    """The composites with those of their ids that exist; others are ignored, as the format asks."""
    Lookup(np.array([id for id, _, _ in raw.composites], np.int64), "composite")
    tags = {tag for _, tokens, _ in raw.composites for tag, _ in tokens}
    present = {tag: lookups[dimension].ids for tag, dimension in _DIMENSIONS.items() if tag in tags}
    present |= {shape.tag: np.sort(_ids(raw, shape)) for shape in Shape if shape.tag in tags}
    return tuple(
        Composite(id, tuple((tag, frozen_ints(ids.existing(present[tag]))) for tag, ids in tokens), name)
        for id, tokens, name in raw.composites
    )


def _domains(raw: RawGeometry, composites: tuple[Composite, ...]) -> dict[int, tuple[int, ...]]:
    present = np.sort(np.array([composite.id for composite in composites], np.int64))
    domains = {id: tuple(ids.existing(present).tolist()) for id, ids in raw.domains.items()}
    if domains and not any(domains.values()):
        raise FormatError("expected a domain of composites that exist, found none of them")
    return domains
