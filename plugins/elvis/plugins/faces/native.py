"""The faces of the elements of a dataset."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from elvis.formats.arrays import Floats, Ints, frozen_floats
from elvis.formats.bernstein import bernstein_space
from elvis.formats.dataset import Dataset, Expansion
from elvis.formats.errors import ElvisError
from elvis.formats.expansion import values
from elvis.formats.geometry import GeometryBlock, geometry
from elvis.formats.mesh import Mesh
from elvis.formats.orientation import face_shape, first_face_row
from elvis.formats.shapes import Shape
from elvis.plugins.faces.faces import FaceBlock, Faces
from elvis.plugins.faces.nets import FaceSpace, face_space


def native_faces(dataset: Dataset, ids: Sequence[Ints], blocks: Sequence[GeometryBlock] | None = None) -> Faces:
    """The faces of the elements of a dataset that the parts of a volume hold; 2D elements are faces themselves.

    ids     for each part the global ids of its elements
    blocks  the dataset's `geometry`, where it is at hand already
    ElvisError for 1D meshes, which have no faces.
    """
    mesh = dataset.mesh
    if mesh.dimension < 2:
        raise ElvisError("expected 2D or 3D data, found DIM=1: lines have no faces")
    found: list[FaceBlock] = []
    for block in geometry(dataset) if blocks is None else blocks:
        for part, own in enumerate(ids):
            rows, numbers = np.intersect1d(block.element_ids, own, return_indices=True)[1:]
            if len(rows):
                found += _blocks(mesh, part, block, rows, numbers)
    boundaries, regions = _names(mesh)
    return Faces(found, ids, boundaries, regions)


def _blocks(mesh: Mesh, part: int, block: GeometryBlock, rows: Ints, numbers: Ints) -> Iterator[FaceBlock]:
    """The faces of the elements ``rows`` of a block, which are ``numbers`` in their part: by shape of face."""
    shape, degree = block.expansion.shape, max(bernstein_space(block.expansion).degrees)
    entity = _entities(mesh, shape, block.element_ids[rows])
    for kind in (Shape.TRIANGLE, Shape.QUADRILATERAL):
        local = np.array([k for k, face in enumerate(shape.faces) if face_shape(face) is kind], np.int64)
        if len(local):
            space = face_space(kind, max(degree, 1))
            sides = np.tile(local, len(rows))
            yield FaceBlock(
                part,
                shape.label.lower(),
                space,
                np.repeat(numbers, len(local)),
                sides,
                entity[:, local].reshape(-1),
                frames(shape),
                _nets(space, block, np.repeat(rows, len(local)), sides),
            )


def frames(shape: Shape) -> Floats:
    """(k, 3, 3) where the faces of a shape lie: the ``frames`` of a FaceBlock."""
    corners = np.pad(shape.vertices, ((0, 0), (0, 3 - shape.dimension)))[[[f[0], f[1], f[-1]] for f in shape.faces]]
    along, across = (corners[:, 1] - corners[:, 0]) / 2, (corners[:, 2] - corners[:, 0]) / 2
    return frozen_floats(np.stack([corners[:, 0] + along + across, along, across], axis=1))


def _nets(space: FaceSpace, block: GeometryBlock, rows: Ints, local: Ints) -> Callable[[Ints], Floats]:
    """The nets of faces ``local`` of the elements ``rows`` of a block."""

    def nets(chosen: Ints) -> Floats:
        result = np.ones((len(chosen), space.count, 4))
        for side in np.unique(local[chosen]):
            here = np.flatnonzero(local[chosen] == side)
            matrix = _restriction(space, block.expansion, int(side))
            result[here, :, :3] = np.einsum("ndm,mk->nkd", block.coefficients[rows[chosen[here]]], matrix)
        return result

    return nets


def _restriction(space: FaceSpace, expansion: Expansion, side: int) -> Floats:
    """(modes, count) matrix from the coefficients of an element's map to the net of one of its faces."""
    frame = frames(expansion.shape)[side, :, : expansion.shape.dimension]
    return np.asarray((space.fit @ values(expansion, frame[0] + space.points @ frame[1:])).T)


def _entities(mesh: Mesh, shape: Shape, ids: Ints) -> Ints:
    """(n, faces) numbers of the faces of elements: triangles of the mesh first, then quadrilaterals."""
    entities = mesh.of(shape)
    order = np.argsort(entities.ids)
    rows = order[np.searchsorted(entities.ids, ids, sorter=order)]
    return rows[:, None] + first_face_row(mesh, shape) if shape.dimension == 2 else entities.members[rows]


def _names(mesh: Mesh) -> tuple[dict[str, Ints], dict[str, Ints]]:
    """Composites by id and name: those of faces as numbers of faces, those of elements as global ids."""
    boundaries: dict[str, Ints] = {}
    regions: dict[str, Ints] = {}
    tags = {shape.tag for shape in Shape.of_dimension(mesh.dimension)}
    for composite in mesh.composites:
        faces = [_numbers(mesh, ids) for tag, ids in composite.parts if tag in ("F", "T", "Q")]
        elements = [ids for tag, ids in composite.parts if tag in tags or (tag == "F" and mesh.dimension == 2)]
        for table, parts in ((boundaries, faces), (regions, elements)):
            if parts:
                table.update(dict.fromkeys(filter(None, (composite.name, str(composite.id))), np.concatenate(parts)))
    return boundaries, regions


def _numbers(mesh: Mesh, ids: Ints) -> Ints:
    """Numbers of the faces with these global ids."""
    every = np.concatenate([mesh.of(Shape.TRIANGLE).ids, mesh.of(Shape.QUADRILATERAL).ids])
    return np.flatnonzero(np.isin(every, ids))
