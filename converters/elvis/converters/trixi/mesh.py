"""Meshes of Trixi.jl: what its HDF5 files, and the files that they name, say of elements and their sides.

Layout: Trixi.jl, `save_mesh_file`.  Julia's arrays have their first index fastest, so they arrive transposed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.converters.shared.hdf5 import attribute, attributes, floats, ints, number, text
from elvis.converters.shared.inputs import check_rows
from elvis.converters.trixi.mapping import Mapping
from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.errors import FormatError
from elvis.core.data.mesh import PERIODIC
from elvis.core.polynomials.quadrature import lobatto
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import tensor_nodes

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

#: shapes of elements by dimension
SHAPES = {1: Shape.SEGMENT, 2: Shape.QUADRILATERAL, 3: Shape.HEXAHEDRON}

#: Trixi's names of the sides towards -x, x, -y, y, -z, z
DIRECTIONS = ("x_neg", "x_pos", "y_neg", "y_pos", "z_neg", "z_pos")

#: places that are nearer than this share of the mesh's size coincide
TOGETHER = 1e-10

#: the deepest level of refinement of a tree
_DEEPEST = 60

#: order of the nodes at which a mapping is evaluated if no solution gives another
_MAPPED_ORDER = 6

#: maximum number of cells of a mesh stored only by numbers of cells
_MOST_CELLS = 1 << 24


@dataclass(eq=False)
class Cells:
    """The elements of a mesh, with their sides towards -x, x, -y, y, -z, z of the reference element.

    line     (m,) nodes along an edge
    places   (n, m^d, c) positions of the nodes of each element, the first direction fastest
    names    (n, 2 d) names of boundaries for sides, empty for inner sides and sides without a name
    mortars  (n, 2 d) whether sides meet parts of others, as far as the files show
    mapping  mapping from [-1, 1]^d, with the cells along each direction, if no solution gives the nodes of elements
    notes    messages for the report
    """

    line: Floats
    places: Floats
    names: NDArray[Any]
    mortars: Bools
    is_conforming: bool = True
    mapping: tuple[Mapping, Ints] | None = None
    notes: list[str] = field(default_factory=list)


def dimension_of(file: h5py.File) -> int:
    """The dimension of the elements."""
    found = number(file, "ndims")
    if found not in SHAPES:
        raise FormatError(f"expected 1, 2 or 3 dimensions, found {found:g}", place="ndims")
    return int(found)


def unnamed(count: int, dimension: int) -> NDArray[Any]:
    """(n, 2 d) empty names."""
    return np.full((count, 2 * dimension), "", object)


def tree_cells(file: h5py.File) -> Cells:
    """The leaves of a tree of squares or cubes, in the order of the file."""
    dimension = dimension_of(file)
    is_leaf = (ints(file, "child_ids", None, 2**dimension) == 0).all(axis=1)
    leaves = np.flatnonzero(is_leaf)
    count, declared = len(is_leaf), number(file, "n_leaf_cells")
    if declared != len(leaves):
        raise FormatError(f"expected {declared:g} leaves as declared, found {len(leaves)}", place="child_ids")
    levels = ints(file, "levels", count)[leaves]
    if levels.min(initial=0) < 0 or levels.max(initial=0) > _DEEPEST:
        raise FormatError(f"expected levels from 0 to {_DEEPEST}, found others", place="levels")

    # a leaf is a cube around its centre
    length = number(file, "length_level_0")
    centres = floats(file, "coordinates", count, dimension)[leaves]
    halves = np.asarray(length / 2.0 ** (levels + 1), np.float64)
    places = centres[:, None] + halves[:, None, None] * tensor_nodes(SHAPES[dimension], (-1.0, 1.0))
    is_outer, is_mortar = _sides_of_leaves(file, is_leaf)
    names = unnamed(len(leaves), dimension)
    names[is_outer] = np.broadcast_to(np.array(DIRECTIONS[: 2 * dimension], object), names.shape)[is_outer]

    # sides of the whole tree have no neighbours, except in a periodic mesh
    is_on_outline = _on_outline(file, centres, halves, length)
    names[is_on_outline & np.repeat(_periodicity(file, dimension), 2)] = PERIODIC
    is_mortar &= ~is_on_outline
    return Cells(np.array([-1.0, 1.0]), places, names, is_mortar, not is_mortar.any())


def _periodicity(file: h5py.File, dimension: int) -> Bools:
    """(d,) whether directions are periodic."""
    found = attributes(file, "periodicity")
    if len(found) not in (1, dimension) or found.dtype.kind not in "biu":
        raise FormatError(f"expected {dimension} truth values, found {found!r:.40}", place="periodicity")
    return np.broadcast_to(found.astype(bool), dimension)


def _on_outline(file: h5py.File, centres: Floats, halves: Floats, length: float) -> Bools:
    """(n, 2 d) whether sides of cubes, given by centres and half lengths, lie on the outline of the tree."""
    middle = attributes(file, "center_level_0").astype(np.float64)
    if len(middle) != centres.shape[1]:
        raise FormatError(f"expected {centres.shape[1]} coordinates, found {len(middle)}", place="center_level_0")
    inner = length / 2 - halves[:, None]
    ends = np.stack([centres - middle + inner, centres - middle - inner], axis=2)
    return np.asarray(np.abs(ends) <= TOGETHER * length).reshape(len(centres), -1)


def _sides_of_leaves(file: h5py.File, is_leaf: Bools) -> tuple[Bools, Bools]:
    """(n, 2 d) whether sides of the leaves of a tree lie on its boundary, and whether they meet sides of other sizes.

    A side without a neighbour of its level meets a larger one where its parent has a neighbour.
    """
    count, leaves = len(is_leaf), np.flatnonzero(is_leaf)
    parents = ints(file, "parent_ids", count)
    neighbours = ints(file, "neighbor_ids", count, 2 * dimension_of(file))
    for name, ids in (("parent_ids", parents), ("neighbor_ids", neighbours)):
        check_rows(ids, count + 1, "cells", place=name)

    # cells are numbered from 1; 0 means no cell
    above = np.concatenate([np.zeros((1, neighbours.shape[1]), np.int64), neighbours])[parents[leaves]]
    own = neighbours[leaves]
    is_split = np.concatenate([[False], ~is_leaf])[own]
    return (own == 0) & (above == 0), ((own == 0) & (above > 0)) | is_split


def structured_cells(file: h5py.File, order: int | None, count: int | None, extra: str) -> Cells:
    """The cells of a mesh that is curved by a mapping.

    order  of the solution, at whose Gauss-Lobatto nodes Trixi takes the mapping; None without a solution
    count  of the elements of the solution
    extra  definitions that the mapping lacks
    """
    dimension = dimension_of(file)
    size = attributes(file, "size").astype(np.int64)
    total = float(np.prod(size.astype(np.float64)))
    if len(size) != dimension or size.min() < 1 or total > _MOST_CELLS or (count or total) != total:
        expected = f"{dimension} numbers of cells, all together {count or f'up to {_MOST_CELLS}'}"
        raise FormatError(f"expected {expected}, found {size.tolist()}", place="size")
    try:
        mapping = Mapping(text(attribute(file, "mapping")), dimension, extra)
    except FormatError as error:
        raise FormatError(str(error), place="attribute mapping") from error
    line = lobatto(2 if mapping.is_affine else (order or _MAPPED_ORDER) + 1)[0]
    inside = tensor_nodes(SHAPES[dimension], tuple(line.tolist()))
    points = in_cells(size, np.arange(int(np.prod(size))), inside)
    places = mapping.at(points.reshape(-1, dimension)).reshape(points.shape)
    is_own = order is None and not mapping.is_affine
    names = _names_of_box(places, size, _periodicity(file, dimension))
    return Cells(line, places, names, np.zeros(names.shape, bool), mapping=(mapping, size) if is_own else None)


def in_cells(size: Ints, cells: Ints, points: Floats) -> Floats:
    """(n, m, d) places in [-1, 1]^d of reference points (m, d) of cells (n,).

    size  (d,) numbers of cells along each direction; the first is the fastest in the numbers of cells
    """
    corners = np.stack(np.unravel_index(cells, tuple(size[::-1]))[::-1], axis=1)
    return np.asarray((2 * corners[:, None] + 1 + points) / size - 1)


def _names_of_box(places: Floats, size: Ints, periodicity: Bools) -> NDArray[Any]:
    """(n, 2 d) names of the sides of a box of cells; sides that a periodic direction joins have none."""
    dimension = len(size)
    count = len(places)
    names = unnamed(count, dimension)
    nodes = places.reshape(*size[::-1], *(round(places.shape[1] ** (1 / dimension)),) * dimension, -1)
    numbers = np.arange(count).reshape(size[::-1])
    extent = float(np.ptp(places.reshape(-1, dimension), axis=0).max())
    for axis in range(dimension):
        own = dimension - 1 - axis
        layers = [np.take(np.take(nodes, end, axis=own), end, axis=2 * dimension - 2 - axis) for end in (0, -1)]
        is_closed = float(np.abs(layers[0] - layers[1]).max()) <= TOGETHER * extent
        for end in (0, 1):
            name = PERIODIC if periodicity[axis] else DIRECTIONS[2 * axis + end]
            if not (periodicity[axis] and is_closed):
                names[np.take(numbers, -end, axis=own), 2 * axis + end] = name
    return names


def next_to(folder: Path, name: str, others: list[Path]) -> Path:
    """The file that a mesh names: among the given files, or else in the folder of the mesh."""
    wanted = name.replace("\\", "/").rsplit("/", 1)[-1]
    for path in (*others, folder / wanted):
        if path.name == wanted and path.is_file():
            return path
    raise FormatError(f"expected {wanted} next to it, which it names, found none; also give that file")
