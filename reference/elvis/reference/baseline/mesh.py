"""The linear mesh: every element cut into simplices whose corners have the exact positions and values.

Elements have their own corners, so fields may jump between them; values between corners are interpolated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.mapping.cutting import Template
from elvis.core.mapping.patch import Patch
from elvis.reference.baseline.templates import pulling, simplices_of
from elvis.reference.quantities import Corners
from elvis.reference.solids import cells_of, map_lattice
from elvis.scene.model.time_limit import check_time

#: the order of corners: along this direction, in which no two points of a mesh are likely to tie
_GENERIC = np.array([0.5772156649, 0.6180339887, 0.5345224838])


@dataclass(frozen=True, eq=False)
class LinearMesh:
    """Simplices of one kind: tetrahedra, or the triangles of a plane mesh, of a section, of a boundary.

    points     (n, 3)      world coordinates of the corners
    values     name -> (n,)
    reference  (n, 3)      reference coordinates in the element
    simplices  (m, 3 or 4) corners
    element    (m,)        id of the element in the file of each simplex
    """

    points: Floats
    values: Mapping[str, Floats]
    reference: Floats
    simplices: NDArray[np.int32]
    element: Ints

    def __len__(self) -> int:
        return len(self.simplices)

    @property
    def bytes(self) -> int:
        """Bytes of all arrays."""
        own = self.points.nbytes + self.reference.nbytes + self.simplices.nbytes + self.element.nbytes
        return own + sum(values.nbytes for values in self.values.values())

    @cached_property
    def size(self) -> float:
        """Diagonal of the box around all points."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0))) if len(self.points) else 0.0

    def part(self, chosen: NDArray[np.bool_]) -> LinearMesh:
        """The simplices for which ``chosen`` (m,) holds."""
        return replace(self, simplices=self.simplices[chosen], element=self.element[chosen])


def linear_meshes(patches: Sequence[Patch], level: int, quantities: Mapping[str, Corners]) -> list[LinearMesh]:
    """The elements of each patch, cut ``level`` times, with the quantities at the corners.

    Raises ElvisError for elements of fewer or more dimensions than a picture needs.
    """
    return [_cut(patch, level, quantities) for patch in patches]


def concatenate(parts: Sequence[LinearMesh]) -> LinearMesh:
    """Several meshes of one kind as one; corners stay apart."""
    starts = np.cumsum([0, *(len(part.points) for part in parts)])
    return LinearMesh(
        np.concatenate([part.points for part in parts]),
        {name: np.concatenate([part.values[name] for part in parts]) for name in parts[0].values},
        np.concatenate([part.reference for part in parts]),
        np.concatenate([part.simplices + np.int32(start) for part, start in zip(parts, starts, strict=False)]),
        np.concatenate([part.element for part in parts]),
    )


def estimate(patches: Sequence[Patch], level: int, quantities: int = 1) -> tuple[int, int, int]:
    """Simplices, points and bytes of a linear mesh, without making it; bytes at the peak of making and drawing it."""
    simplices = points = 0
    for patch in patches:
        own, more = cells_of(patch, min(level, 3)), max(0, level - 3)
        growth = 2 ** (patch.dimension * more)
        simplices += len(patch) * simplices_of(own) * growth
        points += len(patch) * len(own.points) * growth

    # corners, ids and the distances that sections need; twice, for the parts and the whole
    return simplices, points, 2 * (points * 8 * (6 + quantities) + simplices * (4 * 4 + 8) + points * 8 + simplices * 4)


def _cut(patch: Patch, level: int, quantities: Mapping[str, Corners]) -> LinearMesh:
    """The elements of one patch."""
    if patch.shape.dimension < 2:
        raise ElvisError("expected elements of two or three dimensions for a linear mesh, found elements of one")
    check_time()
    cut, rows = cells_of(patch, level), np.arange(len(patch))
    world = map_lattice(patch, rows, cut.points)
    simplices, owner = _simplices(cut, world)
    reference = np.zeros((len(patch), *cut.points.shape[:1], 3))
    reference[..., : cut.points.shape[1]] = cut.points
    return LinearMesh(
        np.ascontiguousarray(world).reshape(-1, 3),
        {name: quantity(patch, rows, cut.points).reshape(-1) for name, quantity in quantities.items()},
        reference.reshape(-1, 3),
        simplices,
        patch.element_ids[owner],
    )


def _simplices(cut: Template, world: Floats) -> tuple[NDArray[np.int32], Ints]:
    """Corners (m, d + 1) of the simplices of elements with points ``world`` (e, k, 3), and their rows (m,)."""
    count, points = world.shape[:2]
    keys, found = (world @ _GENERIC).reshape(-1), []
    for kind, cells in cut.cells.items():
        every = (np.arange(count)[:, None, None] * points + cells).reshape(-1, cells.shape[1])
        found.append(pulling(kind, every, keys[every]))
    simplices = np.concatenate(found)

    # element after element
    owner = simplices[:, 0] // points
    order = np.argsort(owner, kind="stable")
    return simplices[order].astype(np.int32), owner[order]
