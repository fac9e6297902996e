"""The faces of lines with Fourier directions: walls along z are faces themselves, blocks along y and z have six."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints, starts_of
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.geometry import GeometryBlock, geometry
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.expansion import values
from elvis.core.shapes import Shape
from elvis.plugins.faces.dataset_faces import frames
from elvis.plugins.faces.faces import FaceBlock, Faces
from elvis.plugins.faces.hexahedra import Hexahedra, hexahedron_faces, vertices_at
from elvis.plugins.faces.nets import Images, face_space, polynomial, sampled_nets
from elvis.plugins.runtime.volume import Volume


def line_faces(dataset: Dataset, volume: Volume) -> Faces:
    """The faces of the elements of the volume's parts; ElvisError for lines without Fourier directions."""
    ids = [part.element_ids for part in volume.parts]
    lengths = next((np.asarray(part.buffers["period"]) for part in volume.parts if "period" in part.buffers), None)
    if lengths is None:
        raise ElvisError("expected 2D or 3D data, found DIM=1: lines have no faces")
    blocks = [_block(dataset, own) for own in ids]
    images = [_images(block, rows, lengths) for block, rows in blocks]
    degrees = [max(1, *bernstein_space(block.expansion).degrees) for block, _ in blocks]
    if len(lengths) == 1:
        first = starts_of(ids)
        found = (_walls(k, len(ids[k]), int(first[k]), degrees[k], images[k]) for k in range(len(ids)))
        return Faces(list(found), ids)
    corners = [
        own(np.arange(len(some)), Shape.HEXAHEDRON.vertices)[..., :3] for own, some in zip(images, ids, strict=True)
    ]
    numbers = np.split(vertices_at(np.concatenate(corners)), np.cumsum([len(own) for own in corners])[:-1])
    parts = [Hexahedra(*some) for some in zip(numbers, degrees, images, strict=True)]
    return Faces(hexahedron_faces(parts), ids)


def _block(dataset: Dataset, ids: Ints) -> tuple[GeometryBlock, Ints]:
    """The geometry of a part's elements, and their rows in it."""
    for block in geometry(dataset):
        order = np.argsort(block.element_ids)
        place = np.searchsorted(block.element_ids, ids, sorter=order).clip(0, len(block) - 1)
        if (block.element_ids[order[place]] == ids).all():
            return block, order[place]
    raise ElvisError("expected lines of one geometry in each part, found several")


def _images(block: GeometryBlock, rows: Ints, lengths: Floats) -> Images:
    """The maps of a part's elements: the line, and one period along each Fourier direction."""

    def positions(elements: Ints, points: Floats) -> Floats:
        basis = values(block.expansion, points[:, :1])
        found: Floats = np.einsum("ndm,km->nkd", block.coefficients[rows[elements]], basis)
        for number, length in enumerate(lengths):
            found[..., 3 - len(lengths) + number] = length * (1 + points[:, 1 + number]) / 2
        return found

    return polynomial(positions)


def _walls(part: int, count: int, first: int, degree: int, images: Images) -> FaceBlock:
    """Elements that are faces themselves."""
    space, own, element = face_space(Shape.QUADRILATERAL, degree), frames(Shape.QUADRILATERAL), np.arange(count)
    local = np.zeros(count, np.int64)
    nets = sampled_nets(space, element, local, own, images)
    return FaceBlock(part, "extruded segment", space, element, local, first + element, own, nets)
