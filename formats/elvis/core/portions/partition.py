"""Partitions: which elements go together, so that each part is compact and has its share."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_ints
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Mesh
from elvis.core.mapping.boxes import places_on_curve
from elvis.core.shapes import Shape


def along_curve(dataset: Dataset, count: int) -> list[Ints]:
    """Ids of the elements of each of ``count`` parts, which are ranges along a curve (see `numbers_along_curve`)."""
    elements = dataset.mesh.elements
    ids = np.concatenate([own.ids for own in elements.values()])
    numbers = np.concatenate([*numbers_along_curve(dataset, count).values()])
    return [frozen_ints(np.sort(ids[numbers == number])) for number in range(count)]


def numbers_along_curve(dataset: Dataset, count: int) -> dict[Shape, Ints]:
    """For each shape of the elements (n,) which of ``count`` parts each is in.

    Parts are ranges along a Z-shaped curve through first vertices.  They have about as many elements as others: those
    with one first vertex stay together.
    """
    mesh = dataset.mesh
    first = _first_vertices(mesh)
    parts = cut_curve(mesh.vertices, np.bincount(first, minlength=len(mesh.vertices)), count)[first]
    starts = np.cumsum([len(own) for own in mesh.elements.values()])[:-1]
    return dict(zip(mesh.elements, np.split(parts, starts), strict=True))


def cut_curve(vertices: Floats, held: Ints, count: int) -> Ints:
    """(n,) which of ``count`` ranges of a curve through vertices (n, 3) each is in; these hold about as much.

    held  (n,) how much is where each vertex is
    """
    order = np.argsort(places_on_curve(vertices), kind="stable")
    along = held[order]
    # position of the middle of each vertex's share among all
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
