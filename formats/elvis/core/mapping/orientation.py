"""Orientation of the entities of an element: its local vertices and the turns of its faces.

Format notes 1.4 and 2.3.  Files tie elements to faces and faces to edges; local vertices follow from what these share.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from weakref import WeakKeyDictionary

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_view, sorted_columns
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.errors import FormatError
from elvis.core.data.mesh import Mesh
from elvis.core.shapes import Shape

#: entities handled at once, so that intermediate arrays stay small
CHUNK = 1 << 16
#: and where several arrays of them should stay in a processor's cache
_FEW = 1 << 14

#: `local_vertices` of the volume elements of meshes, which take longest to find: once each
_OF_SOLIDS: WeakKeyDictionary[Mesh, dict[Shape, Ints]] = WeakKeyDictionary()

#: corners of a face's own frame, in the order of its vertices
_CORNERS = Shape.QUADRILATERAL.vertices.astype(np.int64)


def chunks(count: int, size: int = CHUNK) -> Iterator[slice]:
    """Slices that cover ``range(count)``, ``size`` at a time."""
    return (slice(start, min(start + size, count)) for start in range(0, count, size))


def even_chunks(count: int, least: int) -> Iterator[slice]:
    """Slices of nearly equal length that cover ``range(count)``: each at least ``least``, unless ``count`` is smaller.

    Products of matrices in such parts equal the products of the whole bit by bit; a small remainder would be computed
    differently by BLAS.
    """
    parts = max(1, count // max(1, least))
    ends = [count * number // parts for number in range(parts + 1)]
    return (slice(*pair) for pair in pairwise(ends))


def local_vertices(mesh: Mesh, shape: Shape, faces: Callable[[], Mapping[Shape, Ints]] | None = None) -> Ints:
    """(n, n_vertices) vertex rows of all entities of a shape, in the local order of `Shape`.

    faces  gives `polygon_vertices` of the triangles and of the quadrilaterals, where these are at hand
    FormatError, naming the entity, where edges don't close to a polygon or faces not to the shape, and where a
    triangle's collapsed vertex isn't where its volume element has it.
    """
    if shape.dimension == 1:
        return mesh.of(shape).members
    if shape.dimension == 2:
        return polygon_vertices(mesh, shape)
    known = _OF_SOLIDS.setdefault(mesh, {})
    if shape not in known:
        polygons = faces() if faces else {s: polygon_vertices(mesh, s) for s in Shape.of_dimension(2)}
        known[shape] = frozen_view(_solid_vertices(mesh, shape, polygons))
    return known[shape]


def face_shape(local: tuple[int, ...]) -> Shape:
    """The shape of a face given by its local vertices."""
    return Shape.TRIANGLE if len(local) == 3 else Shape.QUADRILATERAL


def first_face_row(mesh: Mesh, shape: Shape) -> int:
    """First row of triangles or of quadrilaterals among all faces."""
    return 0 if shape is Shape.TRIANGLE else len(mesh.of(Shape.TRIANGLE))


def label(mesh: Mesh, shape: Shape, row: int) -> str:
    """The name of an entity in messages, e.g. ``tetrahedron 12``: its shape and id."""
    return f"{shape.label.lower()} {mesh.of(shape).ids[row]}"


def require(
    holds: Bools,
    mesh: Mesh,
    shape: Shape,
    rows: slice | Ints,
    expected: str,
    found: str,
    facts: Ints | None = None,
    ids: Ints | None = None,
) -> None:
    """Raise FormatError naming the first of the entities ``rows`` for which ``holds`` (n, …) is not all true.

    ``found`` describes the actual data; a ``{}`` in it is replaced by the fact (n, …) of that entity; if ``ids`` are
    given, facts are rows among these.
    """
    if holds.all():
        return
    first = int(np.argmin(holds.reshape(len(holds), -1).all(axis=1)))
    row = rows.start + first if isinstance(rows, slice) else rows[first]
    own = np.empty(0, np.int64) if facts is None else np.ravel(facts[first])
    fact = " ".join(map(str, own if ids is None else ids[own]))
    raise FormatError(f"expected {expected}, found {found.format(fact)}", place=label(mesh, shape, row))


def polygon_vertices(mesh: Mesh, shape: Shape) -> Ints:
    """(n, k) vertex rows of all triangles or quadrilaterals: `local_vertices`."""
    members = mesh.of(shape).members
    result = np.empty_like(members)
    for part in chunks(len(members), _FEW):
        result[part] = _free_ends(mesh, shape, part).T
    return result


# In what follows entities run along the last axis: NumPy then compares many of them at once.


def _free_ends(mesh: Mesh, shape: Shape, part: slice) -> Ints:
    """(k, n) vertices: the end of edge j that isn't shared with edge j + 1 is local vertex j."""
    ends = mesh.of(Shape.SEGMENT).members[mesh.of(shape).members[part].T]
    start, end = np.ascontiguousarray(ends.transpose(2, 0, 1))
    next_start, next_end = np.roll(start, -1, axis=0), np.roll(end, -1, axis=0)
    is_start_shared = (start == next_start) | (start == next_end)
    is_end_shared = (end == next_start) | (end == next_end)
    vertices: Ints = np.where(is_start_shared, end, start)

    # the shared end must then be the next vertex, or the edges run away from one another
    meeting: Ints = np.where(is_start_shared, start, end)
    meets_next = (is_start_shared != is_end_shared) & (meeting == np.roll(vertices, -1, axis=0))
    is_closed = np.asarray(meets_next.all(axis=0))
    expected, found = "edges that form a closed polygon", "edges from and to vertices {}"
    require(is_closed, mesh, shape, part, expected, found, ends.transpose(1, 0, 2), mesh.vertex_ids)
    return vertices


def _solid_vertices(mesh: Mesh, shape: Shape, polygons: Mapping[Shape, Ints]) -> Ints:
    """(n, n_vertices) vertex rows of all volume elements of a shape: `local_vertices`."""
    result = np.empty((len(mesh.of(shape)), len(shape.vertices)), np.result_type(*polygons.values()))
    for part in chunks(len(result), _FEW):
        faces = _solid_faces(mesh, shape, part, polygons)
        vertices = _corners(mesh, shape, part, faces)
        _check_faces(mesh, shape, part, vertices, faces)
        result[part] = vertices.T
    return result


def _corners(mesh: Mesh, shape: Shape, part: slice, faces: list[Ints]) -> Ints:
    """(n_vertices, n) vertices: local vertex j is what the faces around it have in common."""
    result = np.empty((len(shape.vertices), faces[0].shape[1]), faces[0].dtype)
    for j in range(len(shape.vertices)):
        first, *others = (face for face, local in zip(faces, shape.faces, strict=True) if j in local)
        common: Bools = np.ones(first.shape, bool)
        for face in others:
            common &= (first[:, None] == face[None]).any(axis=1)
        counts: Ints = common.sum(axis=0)
        expected = f"faces that share one vertex as local vertex {j}"
        require(counts == 1, mesh, shape, part, expected, "{} shared", counts)
        result[j] = first[0]
        for is_common, vertex in zip(common[1:], first[1:], strict=True):
            np.copyto(result[j], vertex, where=is_common)
    return result


def _solid_faces(mesh: Mesh, shape: Shape, part: slice, polygons: Mapping[Shape, Ints]) -> list[Ints]:
    """For each local face the (3 or 4, n) vertices of the file's face, in the face's own order."""
    faces: list[Ints] = []
    for local, rows in zip(shape.faces, mesh.of(shape).members[part].T, strict=True):
        kind, other = ("triangle", "quadrilateral") if len(local) == 3 else ("quadrilateral", "triangle")
        table, first = polygons[face_shape(local)], first_face_row(mesh, face_shape(local))
        fits = (rows >= first) & (rows < first + len(table))
        require(fits, mesh, shape, part, f"a {kind} as local face {len(faces)}", f"a {other}")
        faces.append(np.ascontiguousarray(table[rows - first].T))
    return faces


def _check_faces(mesh: Mesh, shape: Shape, part: slice, vertices: Ints, faces: list[Ints]) -> None:
    """Raise FormatError unless every face has the vertices of its place, triangles with the same collapsed vertex."""
    ids = mesh.vertex_ids
    for number, (local, face) in enumerate(zip(shape.faces, faces, strict=True)):
        wanted = vertices[list(local)]
        same: Bools = sorted_columns(wanted) == sorted_columns(face)
        expected = f"local face {number} to hold local vertices {local}"
        require(np.asarray(same.all(axis=0)), mesh, shape, part, expected, "one with vertices {}", face.T, ids)
        if len(local) == 3:
            collapsed = wanted[2] == face[2]
            expected = f"local face {number} to be collapsed at local vertex {local[2]}"
            require(collapsed, mesh, shape, part, expected, "vertex {}", face[2], ids)


def face_turns(vertices: Ints, face: Ints) -> Ints:
    """(n,) how each face lies in its element: the ``turn`` of `orientation_matrix`.

    vertices  (n, 3 or 4)  local vertices of the element in the order F0, F1, F2(, F3) of its face
    face      (n, 3 or 4)  the same vertices in the face's own order
    """
    first: Ints = np.argmax(face == vertices[:, :1], axis=1)
    if face.shape[1] == 3:
        return first
    second: Ints = np.argmax(face == vertices[:, 1:2], axis=1)
    return np.where((second - first) % 4 == 3, 2 * first + 1, 2 * first)


def transposed(turns: Ints) -> Bools:
    """(n,) whether axis A of the element lies along axis B of the quadrilateral face."""
    return np.isin(turns % 4, (1, 2))


@bounded_cache
def orientation_matrix(corners: int, turn: int, modes: int) -> tuple[Ints, Floats]:
    """The Modified modes of a turned face in terms of the modes in its own frame.

    Mode (p, q) of the element's face, both below ``modes`` and flattened to p * modes + q, is ``sign`` (modes^2,) times
    mode ``index`` (modes^2,) of the face's own.  Quadrilaterals (four corners) have eight turns: 2 F0 + 1 if the
    element runs the other way round, with F0 the place of the element's first vertex in the face's list; triangles two.
    """
    p, q = np.divmod(np.arange(modes * modes), modes)
    if corners == 3:
        return _turned_triangle(p, q, modes) if turn else (p * modes + q, np.ones(modes * modes))

    # the axes of the element's face, F0 to F1 and F0 to F3, seen in the face's own frame
    first, backwards = divmod(turn, 2)
    origin, along, across = (_CORNERS[(first + step) % 4] for step in ((0, 3, 1) if backwards else (0, 1, 3)))
    (own_p, sign_p), (own_q, sign_q) = _reverse(p, sum(along - origin) < 0), _reverse(q, sum(across - origin) < 0)
    index = own_q * modes + own_p if along[0] == origin[0] else own_p * modes + own_q
    return index, sign_p * sign_q


def _reverse(p: Ints, backwards: bool) -> tuple[Ints, Floats]:
    """Modified_A modes read the other way: 0 and 1 change places, mode p >= 2 has sign (-1)^p."""
    if not backwards:
        return p, np.ones(len(p))
    return np.where(p < 2, 1 - p, p), np.where(p < 2, 1.0, (-1.0) ** p)


def _turned_triangle(p: Ints, q: Ints, modes: int) -> tuple[Ints, Floats]:
    """The two edges that meet in the collapsed vertex change places, and edge v0v1 is read the other way."""
    collapsed, left, right = (p == 0) & (q == 1), p == 0, p == 1
    own_p = np.select([collapsed, left, right], [0, 1, 0], p)
    own_q = np.select([collapsed, left & (q > 1), right & (q > 0)], [1, q - 1, q + 1], q)
    valid = p + q < modes
    index = np.where(valid, own_p * modes + own_q, p * modes + q)
    return index, np.where(p < 2, 1.0, (-1.0) ** p)
