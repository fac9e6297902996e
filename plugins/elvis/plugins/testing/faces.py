"""The test of a runtime plugin's faces: whether they lie on their elements, and where elements meet."""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.polynomials.bernstein import bernstein_values
from elvis.plugins.examining import Examiner
from elvis.plugins.faces import FaceBlock, Faces
from elvis.plugins.volume import Volume

#: faces of a block that are looked at; how far they may lie off, in parts of the greatest coordinate and of references
_MANY, _OFF, _BORDER = 256, 1e-9, 1e-9


def check_faces(volume: Volume, faces: Faces, examiner: Examiner) -> None:
    """AssertionError, in a sentence, where faces aren't on the border of their element, or not where its map has them.

    A face has two sides at most, and these have their corners at the same places.
    """
    sides = np.bincount(np.concatenate([block.entity for block in faces.blocks]))
    assert sides.max() <= 2, (
        f"expected a face between two elements at most, found face {sides.argmax()} of {sides.max()}"
    )
    size = max(float(np.abs(part.boxes).max()) for part in volume.parts)
    found = []
    for block in faces.blocks:
        rows = np.unique(np.linspace(0, len(block) - 1, min(len(block), _MANY)).round().astype(np.int64))
        points = block.space.points
        positions = _check_block(volume, block, rows, points, examiner, size)
        found.append((block.entity[rows], positions.mean(axis=1)))

    # the means of the points of a face's two sides are one place, whichever way round they run
    entity, middles = (np.concatenate(columns) for columns in zip(*found, strict=True))
    order = np.argsort(entity, kind="stable")
    pairs = np.flatnonzero(np.diff(entity[order]) == 0)
    apart = np.abs(middles[order[pairs]] - middles[order[pairs + 1]]).max(axis=1, initial=0.0)
    worst = float(apart.max(initial=0.0))
    assert worst <= _OFF * size, f"expected both sides of a face at one place, found some {worst:.3g} apart"


def _check_block(
    volume: Volume, block: FaceBlock, rows: Ints, points: Floats, examiner: Examiner, size: float
) -> Floats:
    """(n, k, 3) where points (k, 2) of some faces (n,) lie, by the map of their elements."""
    part, frames = volume.parts[block.part], block.frames[block.local[rows]]
    reference = frames[:, None, 0] + np.einsum("pi,nij->npj", points, frames[:, 1:])
    elements = np.repeat(block.element[rows], len(points))
    center = examiner.examine(block.part, elements[:1], np.zeros((1, 3))).center[0]
    samples = examiner.examine(block.part, elements, reference.reshape(-1, 3) - center)
    off = float(np.abs(samples.margin).max()) if volume.dimension == 3 else 0.0
    assert off <= _BORDER, f"{part.type}: expected faces on the border of the reference shape, found some {off:.3g} off"
    homogeneous = np.einsum("pk,nkd->npd", bernstein_values(block.space.space, points), block.nets(rows))
    places = homogeneous[..., :3] / homogeneous[..., 3:]
    positions = samples.position.reshape(places.shape)
    off = float(np.abs(places - positions).max())
    assert off <= _OFF * size, f"{part.type}: expected faces where the map has them, found some off by {off:.3g}"
    return positions
