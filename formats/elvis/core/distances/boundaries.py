"""The boundaries of a dataset: faces of volumes and edges of plane elements, by name, as polynomials."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Floats, Ints, distinct, uses_of
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.data.dataset import Dataset, Expansion
from elvis.core.data.mesh import NON_CONFORMING, PERIODIC, Curves, Mesh
from elvis.core.distances.surface_patches import WHOLE, SurfacePatches
from elvis.core.mapping.geometry import GeometryBlock, geometry
from elvis.core.mapping.orientation import local_vertices
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.expansion import values, values_and_gradients
from elvis.core.polynomials.quadrature import gauss
from elvis.core.shapes import Shape

#: name for all outer faces
ALL = "all"
#: a boundary touches a side of the data's box within this distance, relative to the box
CLEARANCE = 0.02
#: thickness of a flat boundary, relative to the box
FLATNESS = 1e-6
_JOINED = (NON_CONFORMING, PERIODIC)
_KINDS = {2: Shape.SEGMENT, 3: Shape.TRIANGLE, 4: Shape.QUADRILATERAL}


@dataclass(frozen=True, eq=False)
class Faces:
    """Faces of one kind and degree.

    patches    each face as one patch, numbered from 0
    vertices  (n, corners) rows of the mesh's vertices at the corners of `surface_patches`
    inward     (n,) 1 if the normal of a patch points into the element, -1 if out of it; 0 for edges in space
    """

    patches: SurfacePatches
    vertices: Ints
    inward: Ints


def boundaries(mesh: Mesh) -> dict[str, Ints]:
    """Composites of the elements' sides by name and by id: rows of faces of volumes, or of edges of plane elements."""
    shapes = (Shape.SEGMENT,) if mesh.dimension < 3 else tuple(_KINDS.values())[1:]
    every = np.concatenate([mesh.of(shape).ids for shape in shapes])
    return {name: np.flatnonzero(np.isin(every, ids)) for name, ids in sides_by_name(mesh).items()}


def names_of_boundaries(mesh: Mesh) -> list[str]:
    """Names of boundaries, each once; a name is preferred to an id if both denote the same composites.

    They cover the whole if the mesh is a part.
    """
    found: dict[tuple[int, ...], str] = {}
    for word in sides_by_name(mesh):
        same = tuple(own.id for own in mesh.composites if word in (own.name, str(own.id), own.label))
        if same not in found or (found[same].isdecimal() and not word.isdecimal()):
            found[same] = word
    return list(found.values())


@dataclass(frozen=True)
class Bodies:
    """Boundaries that others surround, such as a wing in its far field.

    names  of the boundaries
    box    (2, 3) minimum and maximum coordinates of their vertices and points of curves; None without bodies
    size   the longest side of that box relative to the longest side of the data's box
    """

    names: tuple[str, ...] = ()
    box: Floats | None = None
    size: float = 0.0


def bodies(mesh: Mesh) -> Bodies:
    """The bodies of 2D and 3D data; there are none unless there are other boundaries.

    A body stays clear of both ends of the data's box along two axes or more, and does not lie flat on a side of the
    box.  A wing may stand on a plane of symmetry, a cylinder between two periodic planes, and an inlet is not a body.
    """
    if mesh.dimension < 2 or mesh.space > mesh.dimension or mesh.excerpt is not None:
        return Bodies()
    names = names_of_boundaries(mesh)
    rows = boundaries(mesh)
    low, high = mesh.corners
    room = CLEARANCE * (high - low)
    found = []
    corners = []
    for name in names:
        points = _points_of_sides(mesh, rows[name])
        if not len(points):
            continue
        least, greatest = points.min(axis=0), points.max(axis=0)
        is_clear = (least > low + room) & (greatest < high - room)
        is_flat = (greatest - least <= FLATNESS * (high - low)) & ~is_clear & (high > low)
        if is_clear.sum() >= 2 and not is_flat.any():
            found.append(name)
            corners += [least, greatest]
    if not found or len(found) == len(names):
        return Bodies()
    box = np.array([np.min(corners, axis=0), np.max(corners, axis=0)])
    return Bodies(tuple(found), box, float(np.ptp(box, axis=0).max() / (high - low).max()))


def _points_of_sides(mesh: Mesh, rows: Ints) -> Floats:
    """(n, 3) the vertices of sides (edges, or faces with triangles first), and the points of their curves."""
    if mesh.dimension == 2:
        vertices = distinct(mesh.of(Shape.SEGMENT).members[rows].ravel())
        return np.concatenate([mesh.vertices[vertices], _points_of_curves(mesh.edge_curves, rows)])
    triangles = mesh.of(Shape.TRIANGLE).members
    quadrilaterals = mesh.of(Shape.QUADRILATERAL).members
    count = len(triangles)
    sides = [triangles[rows[rows < count]].ravel(), quadrilaterals[rows[rows >= count] - count].ravel()]
    edges = distinct(np.concatenate(sides))
    vertices = distinct(mesh.of(Shape.SEGMENT).members[edges].ravel())
    of_curves = [_points_of_curves(mesh.edge_curves, edges), _points_of_curves(mesh.face_curves, rows)]
    return np.concatenate([mesh.vertices[vertices], *of_curves])


def _points_of_curves(curves: Curves, rows: Ints) -> Floats:
    """(n, 3) the points of the curves of edges or faces."""
    is_own = np.isin(curves.rows, rows)
    return curves.points[np.repeat(is_own, np.diff(curves.offsets))]


def sides_by_name(mesh: Mesh) -> dict[str, Ints]:
    """`boundaries` with the ids of faces or edges."""
    tags = {2: ("E", "S"), 3: ("F", "T", "Q")}.get(mesh.dimension, ())
    found: dict[str, Ints] = {}
    for name, parts in mesh.named_parts().items():
        ids = [own for tag, own in parts if tag in tags]
        if ids:
            found[name] = np.concatenate(ids)
    return found


def faces_of(dataset: Dataset, name: str) -> list[Faces]:
    """The faces of a boundary, or all outer ones; each face once, even if it belongs to two elements.

    In a part of a mesh, outer faces are outer faces of the whole.  Raises ElvisError if there are no faces, and for
    lines.
    """
    mesh, known = dataset.mesh, boundaries(dataset.mesh)
    if mesh.dimension < 2:
        raise ElvisError("expected 2D or 3D data, found lines, which have no boundary faces")
    if name != ALL and name not in known:
        raise ElvisError(f"there is no boundary {name!r}{perhaps(name, known)}; there are {', '.join((ALL, *known))}")
    blocks = geometry(dataset)
    members = [sides_of(mesh, block.expansion.shape, block.element_ids) for block in blocks]
    owners = owners_of_sides(mesh, members)
    wanted = outer_sides(mesh, owners) if name == ALL else np.isin(np.arange(len(owners)), known[name])
    found = [faces for block, own in zip(blocks, members, strict=True) for faces in _take(mesh, block, own, wanted)]
    if not found:
        raise ElvisError(f"expected a boundary with faces of the data's elements, found none in {name!r}")
    return found


def owners_of_sides(mesh: Mesh, members: Sequence[Ints]) -> Ints:
    """(n,) how many elements each face of volumes, edge of plane elements or end of lines belongs to.

    members  of kinds of elements (k, sides) rows of their sides
    """
    shapes = [shape for shape in mesh.entities if shape.dimension == mesh.dimension - 1]
    count = sum(len(mesh.of(shape)) for shape in shapes) if mesh.dimension > 1 else len(mesh.vertices)
    owners: NDArray[Any] = np.zeros(count, np.int32)
    for own in members:
        owners += uses_of(own, count)
    return owners


def outer_sides(mesh: Mesh, owners: Ints) -> Bools:
    """(n,) whether faces of volumes, or edges of plane elements, are on the outer boundary.

    owners  (n,) number of elements at each side
    Non-conforming and periodic sides, and sides with elements beyond them in the whole, are not outer sides.
    """
    outer = owners == 1
    inner = inner_sides(mesh)
    outer[inner[inner < len(outer)]] = False
    return np.asarray(outer)


def inner_sides(mesh: Mesh) -> Ints:
    """(n,) rows of sides of one element that are no outer ones (`outer_sides`)."""
    return np.concatenate([np.empty(0, np.int64), *joined_sides(mesh).values(), *_sides_of_whole(mesh)])


def joined_sides(mesh: Mesh) -> dict[str, Ints]:
    """Rows of the non-conforming and of the periodic sides, by the names of the composites that hold them."""
    if not any(composite.name in _JOINED for composite in mesh.composites):
        return {}
    return {name: rows for name, rows in boundaries(mesh).items() if name in _JOINED}


def _sides_of_whole(mesh: Mesh) -> tuple[Ints, ...]:
    """Rows of sides beyond which there are elements in the whole that the mesh is a part of."""
    return () if mesh.excerpt is None else (np.asarray(mesh.excerpt.sides),)


def sides_of(mesh: Mesh, shape: Shape, element_ids: Ints) -> Ints:
    """(n, sides) rows of the sides of elements (n,) of one shape: faces, triangles first, or edges."""
    elements = mesh.of(shape)
    return np.asarray(elements.members[elements.rows_of(element_ids)])


def _take(mesh: Mesh, block: GeometryBlock, members: Ints, wanted: Bools) -> Iterator[Faces]:
    """The requested sides of a block's elements, which are then removed from the request."""
    shape = block.expansion.shape
    vertices = local_vertices(mesh, shape)[mesh.of(shape).rows_of(block.element_ids)]
    for number, local in enumerate(shape.edges if shape.dimension == 2 else shape.faces):
        entity, first = np.unique(members[:, number], return_index=True)
        rows = first[wanted[entity]]
        wanted[members[rows, number]] = False
        if len(rows):
            coefficients = side_coefficients(block.expansion, block.coefficients[rows], local)
            outer = np.full(len(rows), WHOLE[len(local)])
            patches = SurfacePatches(len(local), coefficients, np.arange(len(rows)), outer)
            inward = _inward(block.expansion, block.coefficients[rows], local, mesh.space)
            yield Faces(patches, vertices[rows][:, list(local)], inward)


def _inward(expansion: Expansion, maps: Floats, local: tuple[int, ...], space: int) -> Ints:
    """(n,) `Faces.inward` of one side of elements.

    In the reference element the normal points inwards or not; the map keeps that if its determinant on the side is
    positive, and reverses it if it is negative.
    """
    corners = expansion.shape.vertices[list(local)]
    dimension = expansion.shape.dimension
    if dimension != space:
        return np.zeros(len(maps), np.int64)
    along, across = corners[1] - corners[0], corners[-1] - corners[0]
    normal = np.cross(along, across) if dimension == 3 else np.array([along[1], -along[0]])
    side = np.sign(normal @ (expansion.shape.centre - corners[0]))

    middle = corners.mean(axis=0, keepdims=True)
    gradients = values_and_gradients(expansion, middle)[1][0]
    jacobians = np.einsum("ncm,im->nci", maps[:, :space], gradients)
    return np.asarray(side * np.sign(np.linalg.det(jacobians)), np.int64)


def side_coefficients(expansion: Expansion, maps: Floats, local: tuple[int, ...]) -> Floats:
    """(n, m, k, 3) the maps of elements on one of their sides, as in SurfacePatches.

    maps   (n, 3, modes) coefficients of the elements
    local  their vertices around the side
    """
    space, inverse, basis = _side_matrices(expansion, local)
    world = np.einsum("ndm,km->nkd", maps, basis, optimize=True)
    count = side_degree(expansion) + 1
    found = np.zeros((len(maps), count**2, 3))
    found[:, np.flatnonzero(space)] = inverse @ world
    square = found.reshape(len(maps), count, count, 3)
    return np.ascontiguousarray(square[:, :1] if len(local) == 2 else square)


def side_degree(expansion: Expansion) -> int:
    """Degree of the maps of elements on their sides, in each direction."""
    return max(1, *bernstein_space(expansion).degrees)


@bounded_cache
def _side_matrices(expansion: Expansion, local: tuple[int, ...]) -> tuple[Bools, Floats, Floats]:
    """Which powers s^i t^j a side has, the matrix from values at points to their coefficients, and the modes there."""
    kind, shape = _KINDS[len(local)], expansion.shape
    degree = side_degree(expansion)
    nodes = gauss(degree + 1)[0]
    grid = np.stack(np.meshgrid(*[nodes] * kind.dimension), axis=-1).reshape(-1, kind.dimension)
    points = uncollapse(kind, grid)
    origin, along, across = (shape.vertices[corner] for corner in (local[0], local[1], local[-1]))
    images = origin + (1 + points[:, :1]) / 2 * (along - origin)
    if kind.dimension == 2:
        images = images + (1 + points[:, 1:]) / 2 * (across - origin)

    # powers s^i t^j of the space, fitted at as many points or more
    i, j = (power.reshape(-1) for power in np.meshgrid(np.arange(degree + 1), np.arange(degree + 1)))
    space = j == 0 if kind is Shape.SEGMENT else i + j <= degree if kind is Shape.TRIANGLE else i >= 0
    s, t = points[:, 0], points[:, -1]
    powers = s[:, None] ** i[space] * (t[:, None] ** j[space] if kind.dimension == 2 else 1.0)
    return space, np.linalg.pinv(powers), values(expansion, images)
