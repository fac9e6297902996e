"""Jumps of discontinuous fields across the sides of elements: faces of volumes, edges of plane elements, ends of lines.

Both elements at a side are evaluated at the same points of a lattice on it.  The points are given by weights of the
side's vertices, counted from the vertex with the lowest row in the mesh, so both elements see the side in the same way.
If sides don't match, elements on the other side are located by position (`interface_jumps`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from elvis.core.arrays import Floats, Ints, frozen_floats
from elvis.core.bounded_cache import bounded_cache
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.core.mapping.orientation import local_vertices
from elvis.core.patch import Patch, patches
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.quantities.interface_jumps import raise_across_interfaces
from elvis.core.shapes import Shape

#: positions on a side are multiples of 1 over this number
_PLACES = 1 << 20
#: a side's points: its row among all sides, the row of the element and the values at the points
_Seen = tuple[Ints, Ints, Floats]


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
    ids = np.concatenate([np.empty(0, np.int64), *(patch.element_ids for patch in own)])
    starts = np.cumsum([0, *map(len, own)])
    along = max([modes, *(max(patch.fields[0].modes) for patch in own if patch.fields[0])]) + 2

    sides: dict[int, list[_Seen]] = {}
    for start, patch in zip(starts, own, strict=False):
        for corners, side in _sides(dataset, patch, int(start), along):
            sides.setdefault(corners, []).append(side)
    greatest = np.zeros(len(ids))
    for parts in sides.values():
        side, element, values = zip(*parts, strict=True)
        _meet(np.concatenate(side), np.concatenate(element), np.concatenate(values), greatest)
    if dataset.mesh.dimension > 1:
        raise_across_interfaces(dataset, own, {count: _lattice(count, along) for count in (2, 3, 4)}, greatest)
    return ids, greatest


def _meet(side: Ints, element: Ints, values: Floats, greatest: Floats) -> None:
    """Raise the elements' largest jumps by those on sides that two of them share."""
    order = np.argsort(side, kind="stable")
    first, second = order[:-1], order[1:]
    shared = side[first] == side[second]
    first, second = first[shared], second[shared]
    # jumps next to values that are not finite are unknown
    with np.errstate(invalid="ignore"):
        difference = np.abs(values[first] - values[second]).max(axis=1)
        for owner in (element[first], element[second]):
            np.maximum.at(greatest, owner, difference)


def _sides(dataset: Dataset, patch: Patch, start: int, along: int) -> Iterator[tuple[int, _Seen]]:
    """The sides of a patch's elements, which count from ``start``, each with its number of corners."""
    mesh, shape = dataset.mesh, patch.shape
    expansion, coefficients = patch.fields[0], patch.coefficients[0]
    assert expansion is not None
    assert coefficients is not None
    entities = mesh.of(shape)
    rows = entities.rows_of(patch.element_ids)
    vertices, members = local_vertices(mesh, shape)[rows], entities.members[rows]
    for number, local in enumerate(_local_sides(shape)):
        turns = _turns(vertices[:, local])
        for turn in np.unique(turns, axis=0):
            here = np.flatnonzero((turns == turn).all(axis=1))
            points = _lattice(len(local), along) @ shape.vertices[np.array(local)[turn]]
            found = evaluate(expansion, coefficients[here], points)
            yield len(local), (members[here, number], start + here, found)


def _local_sides(shape: Shape) -> Sequence[tuple[int, ...]]:
    """Local vertices of each side, in the order of the mesh's members."""
    return {1: ((0,), (1,)), 2: shape.edges, 3: shape.faces}[shape.dimension]


def _turns(vertices: Ints) -> Ints:
    """(n, k) the order in which vertices (n, k) of sides are taken: from the lowest on, towards its lower neighbour."""
    if vertices.shape[1] < 4:
        return np.argsort(vertices, axis=1)
    first = vertices.argmin(axis=1)[:, None]
    around = np.take_along_axis(vertices, (first + np.array([1, 3])) % 4, axis=1)
    way = np.where(around[:, :1] < around[:, 1:], 1, -1)
    return np.asarray((first + way * np.arange(4)) % 4)


@bounded_cache
def _lattice(corners: int, along: int) -> Floats:
    """(n, corners) weights of a side's vertices at the points of a lattice."""
    if corners == 1:
        return frozen_floats([[1.0]])
    # products of such places are exact, so that points on quadrilaterals form a lattice to the last digit (`lattices`)
    t = np.round(np.linspace(0.0, 1.0, along) * _PLACES) / _PLACES
    if corners == 2:
        return frozen_floats(np.stack([1 - t, t], axis=1))
    a, b = (part.reshape(-1) for part in np.meshgrid(t, t))
    if corners == 3:
        inside = a + b <= 1 + 1e-12
        return frozen_floats(np.stack([1 - a - b, a, b], axis=1)[inside])
    return frozen_floats(np.stack([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b], axis=1))
