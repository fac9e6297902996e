"""Jumps of discontinuous fields across the sides of elements: faces of volumes, edges of plane elements, ends of lines.

Both elements at a side are evaluated at the same points of a lattice on it.  The points are given by weights of the
side's vertices, counted from the vertex with the lowest row in the mesh, so both elements see the side in the same way.
If sides don't match, elements on the other side are located by position (`interface_jumps`).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elvis.core.base.arrays import Floats, Ints, joined_ints, starts_of
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.patch import Patch, patches
from elvis.core.mapping.side_traces import SideTraces, lattice, shared_pairs, side_traces
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.quantities.interface_jumps import raise_across_interfaces


def jumps(dataset: Dataset, name: str, modes: int = 0) -> tuple[Ints, Floats]:
    """Ids (n,) of elements that have the field, and the largest jump (n,) at points of their sides.

    There are as many points along an edge as the highest order plus three.  Sides of a single element have no jump; an
    element without neighbours has jump 0.
    modes  maximum modes in any direction, in the whole to which the data belong
    Raises ElvisError for quasi-3D fields.
    """
    own = [patch for patch in patches(dataset, [name]) if patch.fields[0] is not None]
    if any(patch.homogeneous for patch in own):
        raise ElvisError(f"jump({name}): expected a field without Fourier directions")
    ids = joined_ints(patch.element_ids for patch in own)
    starts = starts_of(own)
    along = max([modes, *(max(patch.fields[0].modes) for patch in own if patch.fields[0])]) + 2

    # by the number of corners: sides, elements among all, values
    sides: dict[int, list[tuple[Ints, Ints, Floats]]] = {}
    for start, patch in zip(starts, own, strict=False):
        for found in _traces(dataset, patch, along):
            sides.setdefault(found.corners, []).append((found.side, start + found.element, found.values))
    greatest = np.zeros(len(ids))
    for parts in sides.values():
        side, element, values = zip(*parts, strict=True)
        _meet(np.concatenate(side), np.concatenate(element), np.concatenate(values), greatest)
    if dataset.mesh.dimension > 1:
        raise_across_interfaces(dataset, own, {count: lattice(count, along) for count in (2, 3, 4)}, greatest)
    return ids, greatest


def _meet(side: Ints, element: Ints, values: Floats, greatest: Floats) -> None:
    """Raise the elements' largest jumps by those on sides that two of them share."""
    first, second = shared_pairs(side)
    # jumps next to values that are not finite are unknown
    with np.errstate(invalid="ignore"):
        difference = np.abs(values[first] - values[second]).max(axis=1)
        for owner in (element[first], element[second]):
            np.maximum.at(greatest, owner, difference)


def _traces(dataset: Dataset, patch: Patch, along: int) -> Iterator[SideTraces]:
    """The values of a patch's field on the sides of its elements."""
    expansion, coefficients = patch.fields[0], patch.coefficients[0]
    assert expansion is not None
    assert coefficients is not None

    def values_at(rows: Ints, points: Floats) -> Floats:
        return evaluate(expansion, coefficients[rows], points)

    return side_traces(dataset.mesh, patch.shape, patch.element_ids, along, values_at)
