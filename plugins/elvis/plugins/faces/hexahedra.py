"""Faces of hexahedra, for authors of runtime plugins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.shapes import Shape
from elvis.plugins.faces.dataset_faces import frames
from elvis.plugins.faces.faces import FaceBlock
from elvis.plugins.faces.nets import Images, face_space, sampled_nets
from elvis.plugins.projection.vertices import clusters, merging_tolerance


@dataclass(frozen=True, eq=False)
class Hexahedra:
    """The hexahedra of one part.

    vertices  (n, 8) numbers of the corners, in the order of `elvis.core.shapes`; see `vertices_at`
    degree    of the maps in each direction
    images    what the maps do
    unit      whether reference coordinates lie in [0, 1]^3; else in [-1, 1]^3
    """

    vertices: Ints
    degree: int
    images: Images
    unit: bool = False

    def frames(self) -> Floats:
        """(6, 3, 3) where the faces lie: the ``frames`` of a FaceBlock."""
        return frames(Shape.HEXAHEDRON, self.unit)


def hexahedron_faces(parts: Sequence[Hexahedra]) -> tuple[FaceBlock, ...]:
    """All faces of the hexahedra of a volume's parts; faces with the same four vertices are one."""
    corners = [part.vertices[:, [*Shape.HEXAHEDRON.faces]].reshape(-1, 4) for part in parts]
    entity = np.unique(np.sort(np.concatenate(corners), axis=1), axis=0, return_inverse=True)[1].reshape(-1)
    owned = np.split(entity, np.cumsum([len(own) for own in corners])[:-1])
    return tuple(_block(number, part, own) for number, (part, own) in enumerate(zip(parts, owned, strict=True)))


def _block(number: int, part: Hexahedra, entity: Ints) -> FaceBlock:
    element, local = (some.reshape(-1) for some in np.indices((len(part.vertices), 6)))
    space, own = face_space(Shape.QUADRILATERAL, part.degree), part.frames()
    nets = sampled_nets(space, element, local, own, part.images)
    return FaceBlock(number, "hexahedron", space, element, local, entity, own, nets)


def vertices_at(corners: Floats) -> Ints:
    """(n, v) vertex numbers for corners (n, v, 3) of elements: those at one place are one vertex."""
    found = clusters(corners.reshape(-1, 3), merging_tolerance([corners], np.finfo(float).eps))
    return found.reshape(corners.shape[:2])
