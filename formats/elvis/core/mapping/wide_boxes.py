"""Boxes of hexahedra from their vertices, edges and faces; the boxes of their maps are smaller but cost more.

A map is the blend of its vertices, edges and faces (format notes 2.4).  In each of its Bernstein coefficients the four
edges of a direction have weights that add up to 1, and so have two opposite faces.
"""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.mapping.geometry import Assembly
from elvis.core.mapping.orientation import chunks, first_face_row
from elvis.core.shapes import Shape

#: elements that are processed together
_AT_ONCE = 1 << 12


def vertex_boxes(part: Assembly, rows: Ints) -> Floats:
    """(n, 6) boxes of the vertices of elements ``rows`` (n,) of a part of the map."""
    found = np.empty((len(rows), 6))
    for some in chunks(len(rows), _AT_ONCE):
        corners = part.skeleton.vertices[part.vertices[part.rows[rows[some]]]]
        found[some] = np.concatenate([corners.min(axis=1), corners.max(axis=1)], axis=1)
    return found


def wide_boxes(part: Assembly, rows: Ints, inner: Floats) -> Floats:
    """(n, 6) boxes that hold the Bernstein coefficients of hexahedra ``rows`` (n,).

    inner  (n, 6) boxes of their vertices
    """
    skeleton, faces = part.skeleton, Shape.QUADRILATERAL
    mesh = skeleton.mesh
    # in each of three directions: how far edges are from straight ones, and faces from what their edges give
    of_edges = 3 * skeleton.edge_widths()[mesh.of(faces).members].max(axis=1)
    of_faces = 3 * skeleton.face_widths(faces)
    found = inner.copy()
    for some in chunks(len(rows), _AT_ONCE):
        own = mesh.of(Shape.HEXAHEDRON).members[part.rows[rows[some]]] - first_face_row(mesh, faces)
        widths = of_edges[own].max(axis=1) + of_faces[own].max(axis=1)
        found[some, :3] -= widths
        found[some, 3:] += widths
    return found
