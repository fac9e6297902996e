"""The faces of the elements of a dataset."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elvis.core.arrays import Floats, Ints, frozen_floats
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.core.geometry import GeometryBlock, geometry
from elvis.core.mapping.orientation import face_shape, first_face_row
from elvis.core.mesh import Mesh
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.expansion import values
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
    for block in geometry(dataset):
        for part, own in enumerate(ids):
            rows, numbers = np.intersect1d(block.element_ids, own, return_indices=True)[1:]
            if len(rows):
                found += _blocks(mesh, part, block, rows, numbers, length)
    return Faces(found, ids, *_names(mesh, length is not None))


def frames(shape: Shape) -> Floats:
    """(k, 3, 3) where the faces of a shape lie: the ``frames`` of a FaceBlock."""
    corners = np.pad(shape.vertices, ((0, 0), (0, 3 - shape.dimension)))[[[f[0], f[1], f[-1]] for f in shape.faces]]
    along, across = (corners[:, 1] - corners[:, 0]) / 2, (corners[:, 2] - corners[:, 0]) / 2
    return frozen_floats(np.stack([corners[:, 0] + along + across, along, across], axis=1))


def _blocks(
    mesh: Mesh, part: int, block: GeometryBlock, rows: Ints, numbers: Ints, length: float | None
) -> Iterator[FaceBlock]:
    """The faces of the elements ``rows`` of a block, which are ``numbers`` in their part: by shape of face."""
    shape, degree = block.expansion.shape, max(bernstein_space(block.expansion).degrees)
    solid = shape.label.lower() if length is None else f"extruded {shape.label.lower()}"
    for kind, own, entity in _sides(mesh, shape, block.element_ids[rows], length is not None):
        space, local = face_space(kind, max(degree, 1)), np.tile(np.arange(len(own)), len(rows))
        element, nets = (np.repeat(which, len(own)) for which in (numbers, rows))
        images = sampled_nets(space, nets, local, own, _images(block, length))
        yield FaceBlock(part, solid, space, element, local, entity.reshape(-1), own, images)


def _sides(mesh: Mesh, shape: Shape, ids: Ints, extruded: bool) -> Iterator[tuple[Shape, Floats, Ints]]:
    """Faces of elements by shape: the shape, frames (k, 3, 3), and numbers (n, k) of the faces in the mesh.

    Triangles of the mesh count first, then quadrilaterals; in quasi-3D data edges, then lids.
    """
    entities = mesh.of(shape)
    rows = entities.rows_of(ids)
    numbers = rows[:, None] + first_face_row(mesh, shape) if shape.dimension == 2 else entities.members[rows]
    if extruded:
        ends, up = shape.vertices[[*shape.edges]], np.broadcast_to([0.0, 0.0, 1.0], (len(shape.edges), 3))
        middle, half = np.pad((ends[:, 0] + ends[:, 1]) / 2, ((0, 0), (0, 1))), (ends[:, 1] - ends[:, 0]) / 2
        yield Shape.QUADRILATERAL, np.stack([middle, np.pad(half, ((0, 0), (0, 1))), up], 1), entities.members[rows]
        lids = np.repeat(frames(shape), 2, axis=0)
        lids[:, 0, 2] = (-1.0, 1.0)
        yield shape, lids, len(mesh.of(Shape.SEGMENT)) + 2 * numbers + np.arange(2)
        return
    for kind in _FACES:
        local = [k for k, face in enumerate(shape.faces) if face_shape(face) is kind]
        if local:
            yield kind, frames(shape)[local], numbers[:, local]


def _images(block: GeometryBlock, length: float | None) -> Images:
    """The maps of a block's elements; in quasi-3D data the third coordinate goes from 0 to the length."""

    def positions(rows: Ints, points: Floats) -> Floats:
        basis = values(block.expansion, points[:, : block.expansion.shape.dimension])
        found: Floats = np.einsum("ndm,km->nkd", block.coefficients[rows], basis, optimize=True)
        if length is not None:
            found[..., 2] = length * (1 + points[:, 2]) / 2
        return found

    return polynomial(positions)


def _names(mesh: Mesh, extruded: bool) -> tuple[dict[str, Ints], dict[str, Ints]]:
    """Composites by id and name: those of faces as numbers of faces, those of elements as ids."""
    tables: tuple[dict[str, Ints], dict[str, Ints]] = {}, {}
    solids = {shape.tag for shape in Shape.of_dimension(mesh.dimension)} | ({"F"} if mesh.dimension == 2 else set())
    sides = ("E", "S") if extruded else ("F", "T", "Q")
    for name, parts in mesh.named_parts().items():
        faces = [_numbers(mesh, extruded, ids) for tag, ids in parts if tag in sides]
        elements = [ids for tag, ids in parts if tag in solids]
        for table, found in zip(tables, (faces, elements), strict=True):
            if found:
                table[name] = np.concatenate(found)
    return tables


def _numbers(mesh: Mesh, extruded: bool, ids: Ints) -> Ints:
    """Numbers of the faces with these ids."""
    every = np.concatenate([mesh.of(shape).ids for shape in ((Shape.SEGMENT,) if extruded else _FACES)])
    return np.flatnonzero(np.isin(every, ids))
