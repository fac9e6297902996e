"""Rules for a mesh as a whole: entities given once, faces that fit, curves that meet, composites, Jacobians."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_ints
from elvis.core.base.errors import FormatError
from elvis.core.data.dataset import MAP_KEY, Dataset
from elvis.core.data.mesh import Curves, Mesh
from elvis.core.mapping.geometry import geometry
from elvis.core.mapping.orientation import local_vertices
from elvis.core.polynomials.points import PointsType
from elvis.core.shapes import Shape
from elvis.core.summary.summary import jacobian
from elvis.formats.strict.finding import Finding, library_rule, style_rule

_LINES = (PointsType.POLY_EVENLY_SPACED, PointsType.LOBATTO_LEGENDRE)
_TRIANGLES = (PointsType.TRIANGLE_EVENLY_SPACED, PointsType.TRIANGLE_FEKETE)

#: maximum distance of the ends of a curve from its vertices
_NEAR = 1e-8


def mesh_findings(dataset: Dataset) -> Iterator[Finding]:
    """The rules that the mesh breaks."""
    mesh = dataset.mesh
    for shape in mesh.entities:
        yield from _check_duplicates(mesh, shape)
    yield from _composites(mesh)
    broken = list(_orientation(mesh))
    yield from broken
    yield from _edge_curves(mesh)
    yield from _face_curves(mesh)
    if not broken:
        yield from _jacobians(dataset)


def _check_duplicates(mesh: Mesh, shape: Shape) -> Iterator[Finding]:
    """Every edge, face and element is listed once, and no face bounds three elements."""
    entities = mesh.of(shape)
    if not len(entities):
        return
    key = np.sort(entities.members, axis=1)
    order = np.lexsort(key.T[::-1])
    again = (np.diff(key[order], axis=0) == 0).all(axis=1)
    if again.any():
        sentence = f"expected each once, found {_first_ids(entities.ids[order[1:][again]])} again"
        yield style_rule(_what(mesh, shape), sentence)
    if shape.dimension != mesh.dimension or shape.dimension == 1:
        return
    for label, ids, counts in _uses(mesh, shape):
        if (counts > 2).any():
            sentence = f"expected at most two elements on each, found more on {_first_ids(ids[counts > 2])}"
            yield style_rule(_what(mesh, label), sentence)


def _uses(mesh: Mesh, last: Shape) -> Iterator[tuple[Shape, Ints, Ints]]:
    """Number of elements of each bounding entity; found once for all shapes."""
    if last is not list(mesh.elements)[-1]:
        return
    counts = np.bincount(np.concatenate([own.members.reshape(-1) for own in mesh.elements.values()]))
    start = 0
    for shape in Shape.of_dimension(mesh.dimension - 1):
        ids = mesh.of(shape).ids
        own = np.zeros(len(ids), np.int64)
        part = counts[start : start + len(ids)]
        own[: len(part)] = part
        yield shape, ids, own
        start += len(ids)


def _orientation(mesh: Mesh) -> Iterator[Finding]:
    """Edges close to polygons, faces to elements, triangles collapse at the same vertex from both sides."""
    for shape in mesh.entities:
        try:
            local_vertices(mesh, shape)
        except FormatError as error:
            yield library_rule(_what(mesh, shape), str(error))


def _edge_curves(mesh: Mesh) -> Iterator[Finding]:
    curves, edges = mesh.edge_curves, mesh.of(Shape.SEGMENT)
    if not len(curves):
        return
    yield from _kinds(curves, edges.ids[curves.rows], _LINES, "edges")
    ends = np.stack([curves.points[curves.offsets[:-1]], curves.points[curves.offsets[1:] - 1]], axis=1)
    gap = np.abs(ends - mesh.vertices[edges.members[curves.rows]]).max(axis=(1, 2))
    if not (gap <= _NEAR).all():
        ids = edges.ids[curves.rows[~(gap <= _NEAR)]]
        yield style_rule(
            "curved edges", f"expected curves from vertex to vertex, found others on edges {_first_ids(ids)}"
        )


def _face_curves(mesh: Mesh) -> Iterator[Finding]:
    """Families of nodes, and edges that are curved with the same number of points."""
    curves, first = mesh.face_curves, len(mesh.of(Shape.TRIANGLE))
    along = np.zeros(len(mesh.of(Shape.SEGMENT)), np.int64)
    along[mesh.edge_curves.rows] = np.diff(mesh.edge_curves.offsets)
    for shape, families in ((Shape.TRIANGLE, _TRIANGLES), (Shape.QUADRILATERAL, _LINES)):
        chosen = (curves.rows < first) == (shape is Shape.TRIANGLE)
        own = Curves(curves.rows[chosen], curves.kinds[chosen], curves.offsets, curves.points)
        if not len(own):
            continue
        rows = own.rows - (0 if shape is Shape.TRIANGLE else first)
        ids = mesh.of(shape).ids[rows]
        yield from _kinds(own, ids, families, f"{shape.label.lower()}s")
        counts = np.diff(curves.offsets)[chosen]
        wrong = (along[mesh.of(shape).members[rows]] != _points_along(own.kinds, counts)[:, None]).any(axis=1)
        if wrong.any():
            expected = "expected edges curved with as many points as their face"
            sentence = f"{expected}, found others around {_first_ids(ids[wrong])}"
            yield library_rule(f"curved {shape.label.lower()}s", sentence)


def _points_along(kinds: Ints, counts: Ints) -> Floats:
    """(n,) points on an edge of faces with this many points."""
    nodal = np.isin(kinds, [f for f in PointsType if f.is_triangular])
    return np.where(nodal, (np.sqrt(8 * counts + 1) - 1) / 2, np.sqrt(counts))


def _kinds(curves: Curves, ids: Ints, families: tuple[PointsType, ...], what: str) -> Iterator[Finding]:
    wrong = ~np.isin(curves.kinds, families)
    if wrong.any():
        wanted = " or ".join(family.label for family in families)
        found = PointsType(int(curves.kinds[wrong][0])).label
        yield style_rule(f"curved {what}", f"expected {wanted}, found {found} on {_first_ids(ids[wrong])}")


def _composites(mesh: Mesh) -> Iterator[Finding]:
    """Composites of one dimension, one shape each in the domain, where every element lies once."""
    dimensions = {"V": 0, "E": 1, "F": 2, **{shape.tag: shape.dimension for shape in Shape}}
    for composite in mesh.composites:
        tags = sorted({tag for tag, _ in composite.parts})
        if len({dimensions[tag] for tag in tags}) > 1:
            sentence = f"expected entities of one dimension, found {', '.join(tags)}"
            yield library_rule(f"composite {composite.id}", sentence)
    known = {composite.id: composite for composite in mesh.composites}
    named = [c for composites in mesh.domains.values() for c in composites]
    own = [known[c] for c in named if c in known]
    if len(own) < len(named) or not own:
        sentence = f"expected composites of the mesh, found {_first_ids(np.array(named, np.int64))}"
        yield library_rule("<DOMAIN>", sentence)
    elements = {shape.tag for shape in Shape.of_dimension(mesh.dimension)}
    for composite in own:
        tags = sorted({tag for tag, _ in composite.parts})
        if not set(tags) <= elements or len(tags) != 1:
            kind = style_rule if set(tags) <= elements else library_rule
            sentence = f"expected elements of one shape in the domain, found {', '.join(tags)}"
            yield kind(f"composite {composite.id}", sentence)
    ids = joined_ints(part for c in own for _, part in c.parts)
    distinct, counts = np.unique(ids, return_counts=True)
    if (counts > 1).any():
        yield style_rule("<DOMAIN>", f"expected each element once, found {_first_ids(distinct[counts > 1])} again")


def _jacobians(dataset: Dataset) -> Iterator[Finding]:
    """Positive where sampled, for the map of the mesh file and for the one that fields give."""
    plain = replace(dataset, metadata={k: v for k, v in dataset.metadata.items() if k != MAP_KEY})
    for each in [plain, dataset] if MAP_KEY in dataset.metadata else [plain]:
        wrong = jacobian(geometry(each), dataset.mesh.space)["elements_not_positive"]
        if wrong:
            whose = "of the map that fields give" if each is dataset and each is not plain else "of the mesh"
            listed = _first_ids(np.array(wrong, np.int64))
            sentence = f"expected positive Jacobians {whose}, found others in {len(wrong)}: {listed}"
            yield style_rule("elements", sentence)


def _what(mesh: Mesh, shape: Shape) -> str:
    return "edges" if shape is Shape.SEGMENT and mesh.dimension > 1 else f"{shape.label.lower()}s"


def _first_ids(ids: Ints) -> str:
    shown = ", ".join(map(str, ids[:5].tolist()))
    return f"{shown}{f' and {len(ids) - 5} more' if len(ids) > 5 else ''}" or "none"
