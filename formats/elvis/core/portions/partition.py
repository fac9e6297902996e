"""Partitions: which elements go together, so that each part is compact and has its share."""

from __future__ import annotations

import numpy as np

from elvis.core.arrays import Floats, Ints, frozen_ints
from elvis.core.dataset import Dataset
from elvis.core.mapping.boxes import places_on_curve
from elvis.core.mesh import Mesh
from elvis.core.shapes import Shape


def along_curve(dataset: Dataset, count: int) -> list[Ints]:
    """Ids of the elements of each of ``count`` parts: ranges along a Z-shaped curve through their first vertices.

    Parts have about as many elements as others: those with one first vertex stay together.
    """
    mesh = dataset.mesh
    ids = np.concatenate([own.ids for own in mesh.elements.values()])
    first = _first_vertices(mesh)
    parts = cut_curve(mesh.vertices, np.bincount(first, minlength=len(mesh.vertices)), count)[first]
    return [frozen_ints(np.sort(ids[parts == number])) for number in range(count)]


def cut_curve(vertices: Floats, held: Ints, count: int) -> Ints:
    """(n,) which of ``count`` ranges of a curve through vertices (n, 3) each is in; these hold about as much.

    held  (n,) how much is where each vertex is
    """
    order = np.argsort(places_on_curve(vertices), kind="stable")
    along = held[order]
    # where the middle of what a vertex holds lies among all
    middles = 2 * np.cumsum(along) - along
    parts = np.empty(len(vertices), np.int64)
    parts[order] = middles * count // max(2 * int(held.sum()), 1)
    return parts


def _first_vertices(mesh: Mesh) -> Ints:
    """(n,) for each element a vertex: the first of its first edge, of its first face."""
    first = np.arange(len(mesh.vertices))
    for dimension in range(1, mesh.dimension + 1):
        first = np.concatenate([first[mesh.of(shape).members[:, 0]] for shape in Shape.of_dimension(dimension)])
    return first
