"""Curved edges and faces of the mesh file, from the coefficients of a map."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, concatenated, frozen_floats, frozen_ints
from elvis.core.data.mesh import Curves, Mesh
from elvis.core.mapping.orientation import chunks, first_face_row
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.expansion import mode_indices, values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.points import PointsType, nodes, triangle_nodes
from elvis.core.shapes import Shape
from elvis.plugins.projection.traces import Skins

_LINE = PointsType.LOBATTO_LEGENDRE

#: nodes an edge up to which evenly spaced triangles are as good as any, and for which Fekete's are tabulated
_FEW, _TABULATED = 4, (*range(5, 11), 12, 13, 14)

#: modes below this share of the coordinates are rounding
_ROUNDING = 1e-14


def with_curves(mesh: Mesh, skins: Skins, own: Sequence[tuple[Ints, Floats]] = ()) -> Mesh:
    """The mesh with its vertices, and the edges and faces that are curved, as ``skins`` of the coordinates have them.

    own  in one dimension, rows of elements and their coefficients (n, 3, m)
    """
    edges = _edges_of(mesh, skins, own)
    modes = 2 + edges.shape[2]
    tolerance = _ROUNDING * modes * max(float(np.abs(skins.vertices).max(initial=0)), np.finfo(float).tiny)
    bent = _bent(edges, tolerance)
    faces = {kind: _bent(inside, tolerance) for kind, inside in skins.faces.items()}
    for kind, rows in faces.items():
        bent[mesh.of(kind).members[rows].reshape(-1)] = True
    ends = skins.vertices[mesh.of(Shape.SEGMENT).members[bent]].transpose(0, 2, 1)
    table = values(modified(Shape.SEGMENT, (modes,)), nodes(_LINE, modes)[:, None]).T
    points = np.concatenate([ends, edges[bent]], axis=2) @ table
    return replace(
        mesh,
        vertices=frozen_floats(skins.vertices),
        edge_curves=_curves([(np.flatnonzero(bent), _LINE, points.transpose(0, 2, 1))]),
        face_curves=_curves(list(_faces(mesh, skins, faces, modes))),
    )


def _edges_of(mesh: Mesh, skins: Skins, own: Sequence[tuple[Ints, Floats]]) -> Floats:
    """Coefficients (n, 3, modes - 2) of all edges, without their ends."""
    if mesh.dimension > 1:
        return skins.edges
    most = max((coefficients.shape[2] for _, coefficients in own), default=2)
    edges = np.zeros((len(mesh.of(Shape.SEGMENT)), 3, most - 2))
    for rows, coefficients in own:
        edges[rows, :, : coefficients.shape[2] - 2] = coefficients[:, :, 2:]
    return edges


def _bent(coefficients: Floats, tolerance: float) -> Bools:
    """(n,) edges or faces with some coefficient (n, c, k) of their inside."""
    marks = np.zeros(len(coefficients), bool)
    for part in chunks(len(coefficients)):
        marks[part] = (np.abs(coefficients[part]) > tolerance).any(axis=(1, 2))
    return marks


def _faces(mesh: Mesh, skins: Skins, bent: dict[Shape, Bools], modes: int) -> Iterator[tuple[Ints, PointsType, Floats]]:
    """Rows, family and points (n, k, 3) of the curved triangles, then of the curved quadrilaterals."""
    for kind, marks in bent.items():
        family, points = _face_nodes(kind, modes)
        expansion = modified(kind, (modes, modes))
        p, q = mode_indices(expansion).T
        table = values(expansion, points).T
        rows = np.flatnonzero(marks)
        curved = np.empty((len(rows), len(points), 3))
        for part in chunks(len(rows), 1 << 13):
            curved[part] = (skins.squares(kind, rows[part])[:, :, p * modes + q] @ table).transpose(0, 2, 1)
        yield first_face_row(mesh, kind) + rows, family, curved


def _face_nodes(kind: Shape, modes: int) -> tuple[PointsType, Floats]:
    """A family of nodes of a face and where they are, (n, 2), in the order of files."""
    line = nodes(_LINE, modes)
    square = np.stack([axis.reshape(-1) for axis in np.meshgrid(line, line)], axis=1)
    if kind is Shape.QUADRILATERAL:
        return _LINE, square
    if modes > 14:
        return _LINE, uncollapse(Shape.TRIANGLE, square)
    family = PointsType.TRIANGLE_FEKETE if modes in _TABULATED else PointsType.TRIANGLE_EVENLY_SPACED
    return family, triangle_nodes(family, modes)


def _curves(parts: Sequence[tuple[Ints, PointsType, Floats]]) -> Curves:
    """Curves of rows, of a family and with points (n, k, 3), part after part."""
    parts = [part for part in parts if len(part[0])]
    if not parts:
        return Curves.none()
    sizes = np.concatenate([np.full(len(rows), points.shape[1]) for rows, _, points in parts])
    return Curves(
        frozen_ints(np.concatenate([rows for rows, _, _ in parts])),
        frozen_ints(np.concatenate([np.full(len(rows), family) for rows, family, _ in parts])),
        frozen_ints(np.concatenate([[0], np.cumsum(sizes)])),
        frozen_floats(concatenated([points.reshape(-1, 3) for _, _, points in parts])),
    )
