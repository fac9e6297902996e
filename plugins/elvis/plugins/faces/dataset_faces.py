"""The faces of the elements of a dataset."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints, concatenated, frozen_floats, narrow_ints, numbered
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Mesh
from elvis.core.distances.boundaries import inner_sides
from elvis.core.mapping.geometry import Part, mapping
from elvis.core.mapping.orientation import face_shape, first_face_row
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.row_products import row_products
from elvis.core.shapes import Shape
from elvis.plugins.faces.faces import FaceBlock, Faces
from elvis.plugins.faces.nets import Images, face_space, polynomial, sampled_nets

_FACES = (Shape.TRIANGLE, Shape.QUADRILATERAL)


def native_faces(dataset: Dataset, ids: Sequence[Ints], length: float | None = None) -> Faces:
    """The faces of the elements of a dataset that the parts of a volume hold; 2D elements are faces themselves.

    ids     for each part the ids of its elements in the file
    length  of the period of quasi-3D data: the faces of plane elements are walls over their edges, and lids at its ends
    ElvisError for 1D meshes, which have no faces.
    """
    mesh = dataset.mesh
    if mesh.dimension < 2:
        raise ElvisError("expected 2D or 3D data, found DIM=1: lines have no faces")
    found: list[FaceBlock] = []
    for block in mapping(dataset):
        for part, own in enumerate(ids):
            rows = numbers = numbered(len(own))
            if not np.array_equal(block.element_ids, own):
                rows, numbers = np.intersect1d(block.element_ids, own, return_indices=True)[1:]
            if len(rows):
                found += _blocks(mesh, part, block, rows, numbers, length)
    is_extruded = length is not None
    boundaries, regions = _names(mesh, is_extruded)
    inner = inner_sides(mesh) if mesh.dimension == 3 or is_extruded else np.empty(0, np.int64)
    return Faces(found, ids, boundaries, regions, inner)


def frames(shape: Shape, unit: bool = False) -> Floats:
    """(k, 3, 3) where the faces of a shape lie: the ``frames`` of a FaceBlock.

    unit  whether reference coordinates lie in [0, 1]; else in [-1, 1]
    """
    # axes run from the first corner to the next and to the last one
    corners = np.pad(shape.vertices, ((0, 0), (0, 3 - shape.dimension)))
    origin, next_corner, last_corner = (corners[[face[k] for face in shape.faces]] for k in (0, 1, -1))
    along = (next_corner - origin) / 2
    across = (last_corner - origin) / 2
    found = np.stack([origin + along + across, along, across], axis=1)
    if unit:
        found = 0.5 * found + np.array([0.5, 0.0, 0.0])[:, None]
    return frozen_floats(found)


def faces_by_shape(shape: Shape) -> Iterator[tuple[Shape, list[int]]]:
    """Numbers of the triangles, then of the quadrilaterals, among a shape's faces."""
    for kind in _FACES:
        local = [k for k, face in enumerate(shape.faces) if face_shape(face) is kind]
        if local:
            yield kind, local


def _blocks(mesh: Mesh, part: int, block: Part, rows: Ints, numbers: Ints, length: float | None) -> Iterator[FaceBlock]:
    """The faces of the elements ``rows`` of a block, which are ``numbers`` in their part: by shape of face."""
    shape = block.expansion.shape
    degree = max(1, *bernstein_space(block.expansion).degrees)
    images = _images(block, length)
    ids = block.element_ids[rows]
    if length is None:
        solid = shape.label.lower()
        sides = _sides(mesh, shape, ids)
    else:
        solid = f"extruded {shape.label.lower()}"
        sides = _extruded_sides(mesh, shape, ids)

    for kind, places, entity in sides:
        space = face_space(kind, degree)
        count = len(places)
        local: NDArray[Any] = np.tile(np.arange(count, dtype=np.uint8), len(rows))
        repeated = np.repeat(narrow_ints(rows, len(block)), count)
        nets = sampled_nets(space, repeated, local, places, images)
        element = repeated if rows is numbers else np.repeat(narrow_ints(numbers, mesh.count), count)
        yield FaceBlock(part, solid, space, element, local, entity.reshape(-1), places, nets)


def _sides(mesh: Mesh, shape: Shape, ids: Ints) -> Iterator[tuple[Shape, Floats, Ints]]:
    """Faces of elements by shape: the shape, frames (k, 3, 3), and numbers (n, k) of the faces in the mesh.

    Triangles of the mesh count first, then quadrilaterals.
    """
    numbers = _faces_of_elements(mesh, shape, ids)
    places = frames(shape)
    for kind, local in faces_by_shape(shape):
        is_only_kind = len(local) == len(places)
        yield kind, places[local], numbers if is_only_kind else numbers[:, local]


def _faces_of_elements(mesh: Mesh, shape: Shape, ids: Ints) -> Ints:
    """(n, k) numbers in the mesh of the faces of elements; those of all elements of a shape without a copy."""
    entities = mesh.of(shape)
    if shape.dimension == 2:
        return _plane_numbers(mesh, shape, entities.rows_of(ids))
    if np.array_equal(ids, entities.ids):
        return entities.members
    return entities.members[entities.rows_of(ids)]


def _extruded_sides(mesh: Mesh, shape: Shape, ids: Ints) -> Iterator[tuple[Shape, Floats, Ints]]:
    """The same of plane elements with a period along z: walls over their edges, which count first, then lids."""
    entities = mesh.of(shape)
    rows = entities.rows_of(ids)

    # a wall lies around the middle of its edge: s along the edge, t up
    ends = shape.vertices[[*shape.edges]]
    in_space = ((0, 0), (0, 1))
    middle = np.pad((ends[:, 0] + ends[:, 1]) / 2, in_space)
    half = np.pad((ends[:, 1] - ends[:, 0]) / 2, in_space)
    up = np.broadcast_to([0.0, 0.0, 1.0], half.shape)
    yield Shape.QUADRILATERAL, np.stack([middle, half, up], axis=1), entities.members[rows]

    # two lids for each element
    lids = np.repeat(frames(shape), 2, axis=0)
    lids[:, 0, 2] = (-1.0, 1.0)
    walls = len(mesh.of(Shape.SEGMENT))
    yield shape, lids, walls + 2 * _plane_numbers(mesh, shape, rows) + np.arange(2)


def _plane_numbers(mesh: Mesh, shape: Shape, rows: Ints) -> Ints:
    """(n, 1) numbers of plane elements as faces of the mesh."""
    return np.asarray(rows[:, None] + first_face_row(mesh, shape))


def _images(block: Part, length: float | None) -> Images:
    """The maps of a block's elements; in quasi-3D data the third coordinate goes from 0 to the length."""

    def positions(rows: Ints, points: Floats) -> Floats:
        in_plane = points[:, : block.expansion.shape.dimension]
        basis = values(block.expansion, in_plane)
        found = row_products(block.take(rows), basis.T).swapaxes(1, 2)
        if length is not None:
            found[..., 2] = length * (1 + points[:, 2]) / 2
        return found

    return polynomial(positions)


def _names(mesh: Mesh, extruded: bool) -> tuple[dict[str, Ints], dict[str, Ints]]:
    """Composites by id and name: composites of faces as numbers of faces, composites of elements as ids."""
    face_tags = ("E", "S") if extruded else ("F", "T", "Q")
    element_tags = {shape.tag for shape in Shape.of_dimension(mesh.dimension)}
    if mesh.dimension == 2:
        element_tags.add("F")

    boundaries: dict[str, Ints] = {}
    regions: dict[str, Ints] = {}
    for name, parts in mesh.named_parts().items():
        faces = [_face_numbers(mesh, extruded, ids) for tag, ids in parts if tag in face_tags]
        if faces:
            boundaries[name] = concatenated(faces)
        elements = [ids for tag, ids in parts if tag in element_tags]
        if elements:
            regions[name] = concatenated(elements)
    return boundaries, regions


def _face_numbers(mesh: Mesh, extruded: bool, ids: Ints) -> Ints:
    """Numbers of the faces with these ids."""
    shapes = (Shape.SEGMENT,) if extruded else _FACES
    every = np.concatenate([mesh.of(shape).ids for shape in shapes])
    return np.flatnonzero(np.isin(every, ids))
