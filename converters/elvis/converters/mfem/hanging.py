"""Sides of MFEM's elements that meet parts of others, as the library's table of non-conforming faces has them."""

from __future__ import annotations

from typing import Any

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.shapes import Shape

#: corners of the local sides in the library's order (fem/geom.cpp)
SIDES: dict[Shape, tuple[tuple[int, ...], ...]] = {
    Shape.TRIANGLE: ((0, 1), (1, 2), (2, 0)),
    Shape.QUADRILATERAL: ((0, 1), (1, 2), (2, 3), (3, 0)),
    Shape.TETRAHEDRON: ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1)),
    Shape.HEXAHEDRON: ((3, 2, 1, 0), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7)),
    Shape.PRISM: ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    Shape.PYRAMID: ((3, 2, 1, 0), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
}
#: the library's numbers of geometries
_GEOMETRIES = dict(enumerate((*SIDES,), 2))
#: the library encodes a local side and its orientation in one number
_ORIENTATIONS = 64
#: sides whose centres are this far from the side they meet, relative to its size, are identified by a periodic mesh
_APART = 0.5


def hanging_sides(mfem: Any, mesh: Any) -> dict[str, Ints | Bools]:
    """Element and local side (n,) of each side that meets parts of others, and whether these lie at another place."""
    found: dict[tuple[int, int], bool] = {}
    for face in range(mesh.GetNumFaces()):
        first, second, number = mesh.GetFaceInfos(face)
        small, large = mesh.GetFaceElements(face)
        if number < 0 or large < 0:
            continue
        own, other = (small, first // _ORIENTATIONS), (large, second // _ORIENTATIONS)
        found[own] = is_apart = _is_apart(_corners(mfem, mesh, *own), _corners(mfem, mesh, *other))
        found[other] = found.get(other, False) or is_apart
    table = np.array(list(found), np.int64).reshape(-1, 2)
    return {"elements": table[:, 0], "sides": table[:, 1], "is_apart": np.array(list(found.values()), bool)}


def _corners(mfem: Any, mesh: Any, element: int, side: int) -> Floats:
    """(n, d) where the corners of a side of an element lie."""
    geometry, places = mesh.GetElementBaseGeometry(element), mfem.DenseMatrix()
    geometries = mfem.Geometry()  # the rule is a part of it
    rule = geometries.GetVertices(geometry)
    mesh.GetElementTransformation(element).Transform(rule, places)
    return np.array(places.GetDataArray(), np.float64).T[list(SIDES[_GEOMETRIES[geometry]][side])]


def _is_apart(small: Floats, large: Floats) -> bool:
    """Whether a side lies away from the side it is a part of."""
    low, high = large.min(axis=0), large.max(axis=0)
    middle = small.mean(axis=0)
    return bool(np.linalg.norm(middle - np.clip(middle, low, high)) > _APART * np.linalg.norm(high - low))
