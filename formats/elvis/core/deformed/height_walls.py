"""Vertical strips that close the gaps of a height over 2D data where it jumps between elements.

The strip between two edges a(s) and b(s) is the ruled surface (1 - t)/2 a(s) + (1 + t)/2 b(s), a polynomial map of
the degree of the edges along s and of degree 1 along t.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, frozen_ints, joined_ints
from elvis.core.data.dataset import MAP_FIELDS, MAP_KEY, Block, Dataset, Field
from elvis.core.distances.boundaries import sides_of
from elvis.core.mapping.connectivity import connected
from elvis.core.mapping.geometry import GeometryBlock, geometry
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.quadrature import lobatto
from elvis.core.shapes import Shape

#: share of the largest coordinate up to which edges are one
CLOSE = 1e-10


def height_walls(dataset: Dataset) -> Dataset | None:
    """Strips between the edges of neighbouring elements of a surface over the plane; None where nothing jumps.

    Sides that don't match those of one neighbour, as of refined elements, get no strip.
    """
    known = dataset.deformation
    if known is not None and known.joined is not None:
        dataset = replace(dataset, mesh=known.joined)
    blocks = list(geometry(dataset))
    count = max((mode for block in blocks for mode in block.expansion.modes), default=2)
    nodes = lobatto(max(count, 2))[0]
    found = [edges for block in blocks for edges in _edges(dataset, block, nodes)]
    side = joined_ints(own for own, _ in found)
    traces = np.concatenate([np.empty((0, len(nodes), 3)), *(own for _, own in found)])
    order = np.argsort(side, kind="stable")
    at = np.flatnonzero(np.diff(side[order]) == 0)
    one, other = traces[order[at]], traces[order[at + 1]]
    # both run in one direction: their ends lie over each other
    ahead, back = (np.abs(one[:, 0, :2] - own[:, 0, :2]).max(axis=1, initial=0) for own in (other, other[:, ::-1]))
    other = np.where((back < ahead)[:, None, None], other[:, ::-1], other)
    room = CLOSE * np.abs(traces).max(initial=0.0)
    is_open = np.abs(one - other).max(axis=(1, 2), initial=0.0) > room
    return _strips(one[is_open], other[is_open], nodes) if is_open.any() else None


def _edges(dataset: Dataset, block: GeometryBlock, nodes: Floats) -> Iterator[tuple[Ints, Floats]]:
    """Numbers (n,) of sides and places (n, k, 3) on them at nodes from -1 to 1, for each edge of the elements."""
    shape = block.expansion.shape
    members = sides_of(dataset.mesh, shape, block.element_ids)
    for number, (start, end) in enumerate(shape.edges):
        ends = shape.vertices[[start, end]]
        points = ends[0] + 0.5 * (nodes[:, None] + 1.0) * (ends[1] - ends[0])
        places = [evaluate(block.expansion, block.coefficients[:, axis], points) for axis in range(3)]
        yield members[:, number], np.stack(places, axis=2)


def _strips(one: Floats, other: Floats, nodes: Floats) -> Dataset:
    """Quadrilaterals between edges with places (n, k, 3) at nodes."""
    count = len(one)
    expansion = modified(Shape.QUADRILATERAL, (len(nodes), 2))
    points = np.array([(s, t) for t in (-1.0, 1.0) for s in nodes])
    places = np.concatenate([one, other], axis=1)
    inverse = np.linalg.inv(values(expansion, points))
    ids = frozen_ints(np.arange(count))
    names = MAP_FIELDS[:3]
    fields = []
    for axis, name in enumerate(names):
        coefficients = places[..., axis] @ inverse.T
        fields.append(Field(name, (Block(expansion, ids, frozen_floats(coefficients)),), None))
    corners = np.stack([one[:, 0], one[:, -1], other[:, -1], other[:, 0]], axis=1).reshape(-1, 3)
    mesh = connected(corners, {Shape.QUADRILATERAL: np.arange(4 * count).reshape(-1, 4)}, 3)
    return Dataset(mesh, tuple(fields), metadata={MAP_KEY: ",".join(names)})
