"""Forests of Trixi.jl: curved trees, each refined into squares or cubes, by p4est or t8code.

A tree holds the coordinates of its nodes.  Its leaves are in Morton order, so their levels determine their positions.
Layout of p4est's file: cburstedde/p4est, `p4est_connectivity_sink` and `p4est_save_ext`, format 0x2000009.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.converters.shared.hdf5 import attribute, floats, ints, number, text, texts
from elvis.converters.shared.inputs import check_rows
from elvis.converters.trixi.mesh import TOGETHER, Cells, dimension_of, next_to, unnamed
from elvis.core.base.arrays import Floats, Ints, distinct_bits
from elvis.core.base.errors import FormatError
from elvis.core.data.mesh import PERIODIC
from elvis.core.files.plain import content
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import NodalBasis

if TYPE_CHECKING:
    import h5py  # type: ignore[import-untyped]

#: beginning of p4est's files, by dimension, and their formats
_MAGIC = {2: b"p4est", 3: b"p8est"}
_FORMATS = {2: 0x2000009, 3: 0x3000009}

#: number of header fields of the connectivity, and of the quadrants
_COUNTS = 10
_HEAD = 6

#: bytes of a name and of a version before the counts; multiples at which parts of a file begin
_WORDS = 32
_ALIGNED = 32

#: the levels of p4est's lattice, now and before version 2.8 in three dimensions
_LATTICES = (30, 19)

#: name that Trixi writes for a side without a name
_NO_NAME = "---"

#: elements that are taken together
_TOGETHER = 4096

#: the most bits of the number of a place in a tree
_BITS = 62


@dataclass(frozen=True, eq=False)
class Forest:
    """Trees and their leaves.

    line    (m,) nodes along an edge
    places  (trees, m^d, c) of the nodes of each tree, the first direction fastest
    names   (trees, 2 d) of the boundaries on which sides of trees lie
    links   (k, 4) tree and side of each pair of sides that belong together
    counts  (trees,) of leaves
    levels  (n,) of leaves, in Morton order tree by tree
    """

    line: Floats
    places: Floats
    names: NDArray[Any]
    links: Ints
    counts: Ints
    levels: Ints

    def cells(self) -> Cells:
        """The leaves as elements."""
        dimension = self.names.shape[1] // 2
        # the counts may be too large for an array until they are checked with the corners
        corners = morton_corners(self.levels, self.counts, dimension)
        tree = np.repeat(np.arange(len(self.counts)), self.counts)
        places = self._places(tree, corners, dimension)
        width = 1 << (_deepest(self.levels) - self.levels)
        ends = np.stack([corners == 0, corners + width[:, None] == 1 << _deepest(self.levels)], axis=2)
        is_on_outline = ends.reshape(len(tree), -1)
        names = unnamed(len(tree), dimension)
        of_tree = self._names()[tree]
        names[is_on_outline] = of_tree[is_on_outline]
        is_conforming = len(np.unique(self.levels)) < 2
        return Cells(self.line, places, names, np.zeros(names.shape, bool), is_conforming)

    def _places(self, tree: Ints, corners: Ints, dimension: int) -> Floats:
        """(n, m^d, c) nodes of the leaves, on the polynomials of their trees."""
        count, space = len(self.line), self.places.shape[2]
        basis = NodalBasis(Shape.SEGMENT, count - 1, self.line[:, None])
        result = self.places[tree]
        for axis in range(dimension):
            # a leaf is the part of its tree from low to low + 2 / 2^level
            first, which = distinct_bits(np.column_stack([self.levels, corners[:, axis]]))
            low = 2 * corners[first, axis] / 2.0 ** _deepest(self.levels) - 1
            points = low[:, None] + (self.line + 1) / 2.0 ** self.levels[first, None]
            tables = basis.at(points.reshape(-1, 1)).reshape(len(first), count, count)

            # values at the nodes of leaves are combinations of values at nodes of trees, along one direction after
            # another
            own = result.reshape(len(tree), count ** (dimension - 1 - axis), count, -1)
            for rows in range(0, len(tree), _TOGETHER):
                some = slice(rows, rows + _TOGETHER)
                own[some] = np.matmul(tables[which[some], None], own[some])
            result = own.reshape(len(tree), -1, space)
        return result

    def _names(self) -> NDArray[Any]:
        """The names of the sides of trees, including sides that are connected but apart."""
        names = self.names.copy()
        dimension = names.shape[1] // 2
        middles = np.empty((len(self.places), 2 * dimension, self.places.shape[2]))
        count = len(self.line)
        nodes = self.places.reshape(-1, *(count,) * dimension, self.places.shape[2])
        for axis in range(dimension):
            for end in (0, 1):
                side = np.take(nodes, -end, axis=dimension - axis)
                middles[:, 2 * axis + end] = side.reshape(len(nodes), -1, side.shape[-1]).mean(axis=1)
        one, other = (middles[self.links[:, i], self.links[:, i + 1]] for i in (0, 2))
        extent = float(np.ptp(self.places.reshape(-1, self.places.shape[2]), axis=0).max(initial=0))
        apart = self.links[np.abs(one - other).max(axis=1, initial=0) > TOGETHER * extent]
        for i in (0, 2):
            names[apart[:, i], apart[:, i + 1]] = PERIODIC
        return names


def morton_corners(levels: Ints, counts: Ints, dimension: int) -> Ints:
    """(n, d) lower corners of the leaves of trees on a lattice of 2^L cells in each direction, L the deepest level.

    Raises FormatError if the leaves of a tree don't fill it.
    """
    deepest = _deepest(levels)
    if levels.min(initial=0) < 0 or deepest * dimension > _BITS:
        raise FormatError(f"expected levels from 0 to {_BITS // dimension}, found others", place="levels")
    if counts.min(initial=1) < 1 or counts.sum() != len(levels):
        raise FormatError(f"expected {len(levels)} leaves of trees that all have some, found {counts.sum()}")

    # a leaf begins where the one before it ends; places of one tree are counted along the curve
    sizes = 1 << (dimension * (deepest - levels))
    starts = np.cumsum(sizes.astype(np.uint64), dtype=np.uint64) - sizes.astype(np.uint64)
    firsts = np.cumsum(counts) - counts
    starts -= np.repeat(starts[firsts], counts)
    ends = np.append(firsts[1:], len(levels)) - 1
    place = starts.astype(np.int64)
    is_whole = place[ends] + sizes[ends] == 1 << (dimension * deepest)
    if not is_whole.all() or (place % sizes).any():
        raise FormatError("expected leaves that fill their trees in Morton order, found others", place="levels")
    corners = np.zeros((len(levels), dimension), np.int64)
    for bit in range(deepest):
        for axis in range(dimension):
            corners[:, axis] |= ((place >> (dimension * bit + axis)) & 1) << bit
    return corners


def t8code_cells(file: h5py.File) -> Cells:
    """The elements of a T8codeMesh."""
    dimension = dimension_of(file)
    line, places, names = _trees(file, dimension)
    counts = ints(file, "num_elements_per_tree", len(places))
    levels = ints(file, "levels", None)
    if number(file, "nelements") != len(levels):
        raise FormatError(f"expected {number(file, 'nelements'):g} elements, found {len(levels)}", place="levels")
    columns = [ints(file, name, None) for name in ("treeIDs", "faces", "neighIDs", "duals")]
    if len({len(column) for column in columns}) > 1:
        raise FormatError("expected equally many sides and neighbours, found others", place="treeIDs")
    links = np.column_stack(columns)
    check_rows(links[:, ::2], len(places), "trees", place="treeIDs")
    check_rows(links[:, 1::2], 2 * dimension, "sides", place="faces")
    return Forest(line, places, names, links, counts, levels).cells()


def p4est_cells(file: h5py.File, folder: Path, others: list[Path]) -> tuple[Cells, Path]:
    """The elements of a P4estMesh, and p4est's file, which is sought next to it."""
    dimension = dimension_of(file)
    line, places, names = _trees(file, dimension)
    path = next_to(folder, text(attribute(file, "p4est_file")), others)
    try:
        links, counts, levels = _read_p4est(content(path), dimension, len(places))
        return Forest(line, places, names, links, counts, levels).cells(), path
    except FormatError as error:
        raise error.within(path) from error


def _trees(file: h5py.File, dimension: int) -> tuple[Floats, Floats, NDArray[Any]]:
    """Nodes along an edge, places of the nodes of trees, and names of their sides."""
    line = floats(file, "nodes", None)
    count = len(line)
    places = floats(file, "tree_node_coordinates", None, *(count,) * dimension, None)
    total, space = len(places), places.shape[-1]
    if not 2 <= count <= 31 or not dimension <= space <= 3 or not total:
        expected = f"trees of 2 to 31 nodes in each direction, in {dimension} to 3 dimensions"
        raise FormatError(f"expected {expected}, found an array of shape {places.shape}", place="tree_node_coordinates")
    words = texts(file, "boundary_names", total, 2 * dimension)
    names = np.array([name if name != _NO_NAME else "" for name in words], object)
    return line, places.reshape(total, -1, space), names.reshape(total, -1)


def _read_p4est(data: bytes, dimension: int, trees: int) -> tuple[Ints, Ints, Ints]:
    """Links of the sides of trees, and the numbers and levels of their leaves."""
    reader = _Bytes(data)
    if reader.take(_WORDS, np.uint8).tobytes()[:5] != _MAGIC[dimension]:
        raise FormatError(f"expected a file of {_MAGIC[dimension].decode()}, found another")
    head = reader.take(_COUNTS, np.int64).tolist()
    code, size, vertices, count, edges, entries, corners, corner_entries, attribute_bytes, _ = head
    if code != _FORMATS[dimension] or size != 4:
        raise FormatError(f"expected the format {_FORMATS[dimension]:#x}, found {code:#x}")
    if count != trees:
        raise FormatError(f"expected {trees} trees as in the mesh, found {count}")

    # vertices, edges and corners of trees are skipped
    faces = 2 * dimension
    reader.skip(24 * vertices)
    if dimension == 3 and edges:
        reader.skip(4 * 12 * trees)
    reader.skip(4 * 2**dimension * trees * (bool(vertices) + bool(corners)))
    neighbours = reader.take(faces * trees, np.int32).astype(np.int64)
    theirs = reader.take(faces * trees, np.int8).astype(np.int64) % faces
    reader.skip(attribute_bytes * trees)
    if dimension == 3:
        reader.skip(4 * (edges + 1) + 5 * entries)
    reader.skip(4 * (corners + 1) + 5 * corner_entries)
    reader.align()

    tree, side = (own.reshape(-1) for own in np.indices((trees, faces)))
    check_rows(neighbours, trees, "trees")
    is_joined = (neighbours != tree) | (theirs != side)
    links = np.column_stack([tree, side, neighbours, theirs])[is_joined]
    return links, *_read_quadrants(reader, dimension, trees)


def _read_quadrants(reader: _Bytes, dimension: int, trees: int) -> tuple[Ints, Ints]:
    """Numbers of the leaves of trees, and their levels."""
    code, size, _, extra, _, processes = reader.take(_HEAD, np.int64).tolist()
    if code != _FORMATS[dimension] or size != 4 or processes < 1:
        raise FormatError("expected a list of quadrants, found something else")
    total = int(reader.take(processes, np.int64)[-1])
    ends = reader.take(trees, np.int64)
    reader.align()
    counts = np.diff(ends, prepend=0)
    if total != ends[-1] or (counts < 0).any():
        raise FormatError(f"expected {total} quadrants in trees, found others")
    width = 4 * (dimension + 1) + extra
    rows = reader.take(total * width, np.uint8).reshape(total, width)[:, : 4 * (dimension + 1)]
    numbers = np.ascontiguousarray(rows).view(np.int32).astype(np.int64)
    levels = numbers[:, dimension]
    corners = morton_corners(levels, counts, dimension)
    deepest = _deepest(levels)
    if not any(_fits(numbers[:, :dimension], corners, deepest, lattice) for lattice in _LATTICES):
        raise FormatError("expected quadrants in Morton order, found others")
    return counts, levels


def _fits(found: Ints, corners: Ints, deepest: int, lattice: int) -> bool:
    """Whether the corners of quadrants on a lattice of 2^lattice cells match their order."""
    return lattice >= deepest and np.array_equal(found, corners << (lattice - deepest))


def _deepest(levels: Ints) -> int:
    return int(levels.max(initial=0))


class _Bytes:
    """The numbers of a file, one after another; raises FormatError if it ends before."""

    def __init__(self, data: bytes) -> None:
        self._data, self._place = data, 0

    def take(self, count: int, kind: type) -> NDArray[Any]:
        """The next numbers of a kind."""
        start = self._place
        self.skip(count * np.dtype(kind).itemsize)
        return np.frombuffer(self._data, kind, count, start)

    def skip(self, count: int) -> None:
        """Pass bytes."""
        if count < 0 or self._place + count > len(self._data):
            raise FormatError(f"expected {count} bytes more, found {len(self._data) - self._place}")
        self._place += count

    def align(self) -> None:
        """Pass bytes up to the next multiple."""
        self.skip(-self._place % _ALIGNED)
