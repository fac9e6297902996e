"""Elements with fewer nodes than a complete space of their order has functions.

Serendipity elements have nodes only on their edges, or on edges and faces.  The spaces are hierarchical: they contain
the functions of vertices, edges and, where these have nodes, faces, and no function that vanishes on all of these.
Szabo and Babuska, Finite Element Analysis, 1991, chapters 6 and 13.  On quadrilaterals that is the space of CPEX 0045,
table 1.  If no standard defines the functions between the nodes of a face or an element, they depend only on the face,
independent of the elements that share it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import combinations, product

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.polynomials.collapse import collapse
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import NodalBasis, ShapeFunctions, space_values
from elvis.plugins.conversion.plugin import PyramidSpace

#: powers from this one on vanish at both ends of an edge, once combined with lower ones
_BUBBLE = 2


def barycentric(shape: Shape, points: Floats) -> Floats:
    """(n, d + 1) barycentric coordinates in a triangle or tetrahedron; in the triangle of a prism."""
    axes = [0, 2] if shape is Shape.PRISM else list(range(shape.dimension))
    upper = (1 + points[:, axes]) / 2
    return np.column_stack([1 - upper.sum(axis=1), upper])


def edge_space(a: Floats, order: int) -> list[Floats]:
    """Functions of vertices and edges of a simplex: a_i, and a_i a_j (a_j - a_i)^k.

    a  (n, d + 1) barycentric coordinates
    """
    columns = [*a.T]
    for i, j in combinations(range(a.shape[1]), 2):
        columns += [a[:, i] * a[:, j] * (a[:, j] - a[:, i]) ** k for k in range(order - 1)]
    return columns


def face_functions(a: Floats, order: int) -> list[Floats]:
    """Functions of the faces of a tetrahedron, of a triangle of its own: a_i a_j a_k times monomials in these."""
    columns = []
    for face in combinations(range(a.shape[1]), 3):
        corners = a[:, list(face)]
        powers = [e for e in product(range(order - 2), repeat=3) if sum(e) == order - 3]
        columns += [corners.prod(axis=1) * np.prod(corners ** np.array(e), axis=1) for e in powers]
    return columns


def _tensor(shape: Shape, order: int, has_faces: bool, points: Floats) -> list[Floats]:
    """Monomials with at most one power above the linear ones; with two where faces have nodes."""
    most = 2 if has_faces else 1
    exponents = product(range(order + 1), repeat=shape.dimension)
    chosen = [e for e in exponents if sum(each >= _BUBBLE for each in e) <= most]
    return [np.prod(points ** np.array(e), axis=1) for e in chosen]


def _prism(order: int, has_faces: bool, points: Floats) -> list[Floats]:
    """Functions of the triangles, linear along the prism, and of what stands upright between them."""
    a, y = barycentric(Shape.PRISM, points), points[:, 1]
    edges = edge_space(a, order)
    triangle = edges
    if has_faces:
        flat = points[:, [0, 2]]
        triangle = [*space_values(Shape.TRIANGLE, order, flat).T]
    upright = edges if has_faces else [*a.T]
    columns = [f * g for f in triangle for g in (1 - y, 1 + y)]
    return columns + [f * (1 - y**2) * y**k for f in upright for k in range(order - 1)]


def incomplete_space(shape: Shape, order: int, has_faces: bool, points: Floats) -> Floats:
    """(n, m) functions at reference points (n, d); except for pyramids, which have no simple basis."""
    if shape is Shape.PRISM:
        columns = _prism(order, has_faces, points)
    elif shape in (Shape.TRIANGLE, Shape.TETRAHEDRON):
        a = barycentric(shape, points)
        columns = edge_space(a, order) + (face_functions(a, order) if has_faces else [])
    else:
        columns = _tensor(shape, order, has_faces, points)
    return np.stack(columns, axis=1)


def bubble_space(shape: Shape, is_whole: bool, points: Floats) -> Floats:
    """(n, m) quadratic functions, and functions of third degree that are 1 at the centre of triangles.

    For triangles of 7 nodes and tetrahedra of 14; tetrahedra of 15 also have the function of fourth degree that is 0 on
    all faces (``is_whole``).  Prisms of 21 nodes have the functions of these triangles times quadratic ones.  Prisms of
    20 lack the function that is 1 at the centre (``is_whole`` is False).  Pyramids of 18 nodes use libMesh's functions
    for the triangles.
    """
    if shape is Shape.PYRAMID:
        return np.column_stack([space_values(shape, 2, points, PyramidSpace.RATIONAL), *_pyramid_bubbles(points)])
    a = barycentric(shape, points)
    triangle = edge_space(a, 2)
    bubbles = face_functions(a, 3)
    if shape is not Shape.PRISM:
        inside = [a.prod(axis=1)] if shape is Shape.TETRAHEDRON and is_whole else []
        return np.stack(triangle + bubbles + inside, axis=1)
    y = points[:, 1]
    columns = [f * g for f in triangle + bubbles for g in (1 - y, 1 + y)]
    upright = triangle + (bubbles if is_whole else [])
    return np.stack(columns + [f * (1 - y**2) for f in upright], axis=1)


def _pyramid_bubbles(points: Floats) -> list[Floats]:
    """Functions of third degree on one triangle of a pyramid each, 0 on all other faces.

    With collapsed coordinates x, y, height z from 0 to 1 and c = 1 - z: c² z (1 - x²) (1 ± y)², and with x, y
    exchanged.  Source: libMesh/libmesh, fe_lagrange_shape_3D.C, PYRAMID18.
    """
    x, y, height = collapse(Shape.PYRAMID, points).T
    z = (1 + height) / 2
    scale = (1 - z) ** 2 * z
    return [scale * (1 - p**2) * (1 + sign * q) ** 2 for p, q in ((x, y), (y, x)) for sign in (-1, 1)]


#: Coefficients that `CentredPyramid` adds to the functions of a pyramid of 18 nodes: for corners of the base, its apex,
#: edges of the base, the other edges, the base and the triangles.  They are factors of c² z (1 - x²)(1 - y²) and of c z
#: (1 - x²)(1 - y²), both scaled to be 1 at the node inside.  Source: VTK/Common/DataModel/vtkTriQuadraticPyramid.cxx.
_TO_CENTRE = np.repeat(
    [[-27 / 512, 3 / 64], [-27 / 256, 1 / 8], [27 / 256, 0], [27 / 128, -3 / 16], [0, -9 / 16], [-243 / 1024, 0]],
    [4, 1, 4, 4, 1, 4],
    axis=0,
)
#: height of the node inside such a pyramid, at the centroid
_CENTRE = 0.25


class NodalFunctions(ShapeFunctions):
    """Functions of any space that are 1 at one node and 0 at the others.

    space  (n, m) values of the space's functions at reference points (n, d)
    nodes  (m, d) reference coordinates
    """

    def __init__(self, order: int, space: Callable[[Floats], Floats], nodes: Floats) -> None:
        self.order, self._space = order, space
        self._inverse = frozen_floats(np.linalg.inv(space(nodes)))

    def tabulate(self, points: Floats) -> Floats:
        """The functions of the space, combined."""
        return np.asarray(self._space(points) @ self._inverse)


class CentredPyramid(ShapeFunctions):
    """The functions of a pyramid of 19 nodes, as VTK defines them: of those on its surface, then of its centroid.

    nodes  (18, 3) reference coordinates of those on the surface: corners, edges, base, triangles
    """

    order = 3

    def __init__(self, nodes: Floats) -> None:
        self._surface = NodalFunctions(3, lambda points: bubble_space(Shape.PYRAMID, True, points), nodes)

    def tabulate(self, points: Floats) -> Floats:
        """The functions, some outside the rational space: the functions of the centroid are in the tensor space."""
        x, y, height = collapse(Shape.PYRAMID, points).T
        z = (1 + height) / 2
        scaled = (1 - x**2) * (1 - y**2) * z * (1 - z) / (_CENTRE * (1 - _CENTRE))
        inside = np.stack([scaled * (1 - z) / (1 - _CENTRE), scaled], axis=1)
        return np.column_stack([self._surface.at(points) + inside @ _TO_CENTRE.T, scaled])


class ExtendedFunctions(ShapeFunctions):
    """Functions of a complete space whose values at missing nodes follow from the others.

    extension  (complete, given) the values at all nodes from the values at the given ones
    """

    def __init__(self, basis: NodalBasis, extension: Floats) -> None:
        self.order, self._basis, self._extension = basis.order, basis, extension

    def tabulate(self, points: Floats) -> Floats:
        """The functions of all nodes, combined."""
        return np.asarray(self._basis.at(points) @ self._extension)


def incomplete_functions(shape: Shape, order: int, has_faces: bool, nodes: Floats) -> ShapeFunctions:
    """The functions of a serendipity element other than a pyramid."""
    return NodalFunctions(order, lambda points: incomplete_space(shape, order, has_faces, points), nodes)


def incomplete_pyramid(
    order: int, given: Floats, complete: Floats, faces: Sequence[tuple[Floats, Floats, Floats]]
) -> ShapeFunctions:
    """The functions of a serendipity pyramid: faces use their own shapes' functions, and the inside follows from them.

    given, complete  (n, 3) its nodes, and all nodes of the space of its order
    faces            for each face the given nodes (k, 3), the missing ones, and the functions of the first at the
                     second
    Values inside come from the functions of order 2 that fit the surface best, since no other vanishes on all of it.
    """
    extension = np.zeros((len(complete), len(given)))
    row = {_key(node): i for i, node in enumerate(complete)}
    column = {_key(node): i for i, node in enumerate(given)}
    is_known = np.zeros(len(complete), bool)
    for key, i in column.items():
        extension[row[key], i] = 1
        is_known[row[key]] = True
    for own, missing, table in faces:
        rows = [row[_key(node)] for node in missing]
        columns = [column[_key(node)] for node in own]
        extension[np.ix_(rows, columns)] = table
        is_known[rows] = True
    lower = space_values(Shape.PYRAMID, min(order - 1, 2), complete, PyramidSpace.RATIONAL)
    fit = np.linalg.pinv(lower[is_known])
    extension[~is_known] = lower[~is_known] @ fit @ extension[is_known]
    return ExtendedFunctions(NodalBasis(Shape.PYRAMID, order, complete, PyramidSpace.RATIONAL), extension)


def _key(node: Floats) -> tuple[float, ...]:
    return tuple(np.round(node, 9) + 0.0)
