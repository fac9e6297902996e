"""Data of a part that depend only on its elements' maps, shared by the steps of a series."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, concatenated, frozen_floats
from elvis.core.base.threads import Once
from elvis.core.mapping.boxes import Boxes, element_boxes
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_coefficients, to_bernstein
from elvis.core.polynomials.weights import weights


@dataclass(frozen=True, eq=False)
class Maps:
    """Scaled Bernstein control points of elements, and boxes that hold these.

    points   (m, 3)
    indices  (n * k,) the control points of one element after the other, in spaces of degree 1
    boxes    (n, 6) see Part
    """

    points: Floats
    indices: NDArray[np.uint32]
    boxes: Boxes

    @staticmethod
    def of(patches: Sequence[Patch], space: BernsteinSpace) -> Maps:
        """The maps of all elements of some patches, in one space."""
        boxes = concatenated([element_boxes(patch) for patch in patches])
        return Maps(*_control_points(patches, space), boxes)


#: function that returns the cached value of a key, or the one that its argument computes
Keep: TypeAlias = Callable[[Hashable, Callable[[], Once[Maps]]], Once[Maps]]


def keep_nothing(_: Hashable, make: Callable[[], Once[Maps]]) -> Once[Maps]:
    """Makes it each time."""
    return make()


def _control_points(patches: Sequence[Patch], space: BernsteinSpace) -> tuple[Floats, NDArray[np.uint32]]:
    """Scaled Bernstein control points (m, 3) of the maps of patches, and the points of each element, (n * count,).

    If all maps are straight, the points are the vertices of the mesh: the same array for all its parts.  In spaces of
    higher degree each element has its own points, in order, and no list is needed.
    """
    corners = patches[0].corners
    found = (_vertex_rows(patch, space) for patch in patches)
    rows = [own for own in found if own is not None]
    if corners is not None and len(rows) == len(patches):
        return corners.vertices, concatenated(rows)
    points = np.concatenate([_controls(patch, space) for patch in patches]).reshape(-1, 3)
    count = len(points) if space.degrees[0] == 1 else 1
    return frozen_floats(points), np.arange(count, dtype=np.uint32)


def _vertex_rows(patch: Patch, space: BernsteinSpace) -> NDArray[np.uint32] | None:
    """(n * count,) the vertices of the mesh that are a patch's control points in a space; None where some aren't."""
    if patch.corners is None:
        return None
    matrix = to_bernstein(patch.geometry, space) * weights(space)
    is_choice = np.isin(matrix, (0, 1)).all() and (matrix.sum(axis=0) == 1).all()
    if not is_choice:
        return None
    vertices = np.array(patch.corners.modes)[matrix.argmax(axis=0)]
    rows = patch.corners.rows
    if not np.array_equal(vertices, np.arange(rows.shape[1])):
        rows = rows[:, vertices]
    # the rows of simplices are in order: no copy is made of them
    return (rows.view(np.uint32) if rows.dtype == np.int32 else rows.astype(np.uint32)).reshape(-1)


def _controls(patch: Patch, space: BernsteinSpace) -> Floats:
    """(n, k, 3) scaled Bernstein control points of the patch's maps."""
    n, directions, modes = patch.geometry_coefficients.shape
    flat = patch.geometry_coefficients.reshape(n * directions, modes)
    nets = bernstein_coefficients(patch.geometry, flat, space).reshape(n, directions, space.count)
    return np.ascontiguousarray(nets.transpose(0, 2, 1)) * weights(space)[:, None]
