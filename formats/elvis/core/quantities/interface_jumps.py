"""Jumps of a field across sides that don't match: of refined elements, mortars, sides of elements of other shapes.

A lattice on each such side is located in the elements beyond it, where the field is evaluated again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elvis.core.base.arrays import Floats, Ints, every_pair, rows_by_number, starts_of
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import NON_CONFORMING
from elvis.core.distances.boundaries import joined_sides, sides_of
from elvis.core.mapping import pointwise
from elvis.core.mapping.inverse import Status
from elvis.core.mapping.locate import Locator
from elvis.core.mapping.patch import Patch
from elvis.core.shapes import Shape

#: part of a side by which points keep off its border, where elements touch that have no side in common with it
INSET = 1e-6


def raise_across_interfaces(
    dataset: Dataset, patches: Sequence[Patch], lattices: dict[int, Floats], greatest: Floats
) -> None:
    """Raise the largest jumps (n,) of elements by those across their non-conforming sides.

    patches   elements, numbered patch after patch, whose first field is meant
    lattices  (k, c) weights of the corners at points of sides, by the number c of corners
    """
    rows = joined_sides(dataset.mesh).get(NON_CONFORMING)
    if rows is None or not len(rows):
        return
    starts = starts_of(patches)
    touching = [_touching(dataset, patch, rows) for patch in patches]
    locator = Locator([patch.part(own) for patch, own in zip(patches, touching, strict=True)])
    for number, (patch, own) in enumerate(zip(patches, touching, strict=True)):
        for here, points in _points(dataset, patch, own, rows, lattices):
            values = pointwise.values(patch, 0, here, points)
            world = pointwise.positions(patch, here, points)
            point, element, beyond = _beyond(locator, world)
            other = np.concatenate([start + part for start, part in zip(starts, touching, strict=False)])[element]
            differs = other != starts[number] + here[point]
            jump = np.abs(values[point] - beyond)[differs]
            np.maximum.at(greatest, starts[number] + here[point[differs]], jump)
            np.maximum.at(greatest, other[differs], jump)


def _touching(dataset: Dataset, patch: Patch, sides: Ints) -> Ints:
    """Rows of a patch's elements that have one of the sides."""
    members = sides_of(dataset.mesh, patch.shape, patch.element_ids)
    return np.flatnonzero(np.isin(members, sides).any(axis=1))


def _points(
    dataset: Dataset, patch: Patch, rows: Ints, sides: Ints, lattices: dict[int, Floats]
) -> Iterator[tuple[Ints, Floats]]:
    """Rows (n,) of elements and reference points (n, d) on their sides that are among ``sides``."""
    shape = patch.shape
    members = sides_of(dataset.mesh, shape, patch.element_ids[rows])
    for number, local in enumerate(_local_sides(shape)):
        here = rows[np.isin(members[:, number], sides)]
        if len(here):
            weights = (1 - INSET) * lattices[len(local)] + INSET / len(local)
            points = weights @ shape.vertices[list(local)]
            yield every_pair(here, points)


def _local_sides(shape: Shape) -> Sequence[tuple[int, ...]]:
    return shape.edges if shape.dimension == 2 else shape.faces


def _beyond(locator: Locator, world: Floats) -> tuple[Ints, Ints, Floats]:
    """Points, elements of the locator that hold them, counted patch after patch, and values of the field there."""
    found = locator.locate(world, all=True)
    inside = np.flatnonzero(found.status == Status.INSIDE)
    patch, row = found.patch[inside], found.row[inside]
    values = np.empty(len(inside))
    for number, here in rows_by_number(patch):
        values[here] = pointwise.values(locator.patches[number], 0, row[here], found.reference[inside[here]])
    starts = starts_of(locator.patches)
    return found.point[inside], starts[patch] + row, values
