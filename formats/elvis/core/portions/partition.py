"""Partitions: which elements go together, so that each part is compact and has its share."""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Floats, Ints, frozen_ints
from elvis.core.dataset import Dataset
from elvis.core.mapping.boxes import places_on_curve
from elvis.core.mesh import Mesh
from elvis.core.shapes import Shape


def along_curve(dataset: Dataset, count: int) -> list[Ints]:
    """Ids of the elements of each of ``count`` parts: ranges along a Z-shaped curve through their middles.

    Parts have as many elements as others, or one more.
    """
    ids, middles = _middles(dataset.mesh)
    order = np.argsort(places_on_curve(middles), kind="stable")
    return [frozen_ints(np.sort(some)) for some in np.array_split(ids[order], count)]


def _middles(mesh: Mesh) -> tuple[Ints, Floats]:
    """(n,) ids of all elements, and (n, 3) places in their middles: means of what bounds them, and so on."""
    bounding = mesh.vertices
    for dimension in range(1, mesh.dimension + 1):
        every = [mesh.of(shape) for shape in Shape.of_dimension(dimension)]
        bounding = np.concatenate([_means(bounding, own.members) for own in every])
    return np.concatenate([own.ids for own in every]), bounding


def _means(places: Floats, members: Ints) -> Floats:
    """(n, 3) means of the places (m, 3) of members (n, k)."""
    found = np.zeros((len(members), 3))
    for column in members.T:
        found += places[column]
    return np.asarray(found / members.shape[1])
