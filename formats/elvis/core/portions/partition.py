"""Partitions: which elements go together, so that each part is compact and has its share."""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Floats, Ints, frozen_ints
from elvis.core.dataset import Dataset
from elvis.core.mapping.boxes import places_on_curve
from elvis.core.mapping.orientation import local_vertices
from elvis.core.mesh import Mesh


def along_curve(dataset: Dataset, count: int) -> list[Ints]:
    """Ids of the elements of each of ``count`` parts: ranges along a Z-shaped curve through their middles.

    Parts have as many elements as others, or one more.
    """
    ids, middles = _middles(dataset.mesh)
    order = np.argsort(places_on_curve(middles), kind="stable")
    return [frozen_ints(np.sort(some)) for some in np.array_split(ids[order], count)]


def _middles(mesh: Mesh) -> tuple[Ints, Floats]:
    """(n,) ids of all elements, and (n, 3) the means of their vertices."""
    ids, middles = [np.empty(0, np.int64)], [np.empty((0, 3))]
    for shape, entities in mesh.elements.items():
        ids.append(entities.ids)
        middles.append(mesh.vertices[local_vertices(mesh, shape)].mean(axis=1))
    return np.concatenate(ids), np.concatenate(middles)
