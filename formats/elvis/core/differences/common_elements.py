"""Elements that two datasets have in common for any ids, order and orientation; fields of one on the other.

Two elements are the same if their corners and their maps agree: x1(xi) = x2(S xi), with S one of the symmetries of the
shape.  All symmetries are affine in xi, so a field u2 of the second dataset is the polynomial u2(S xi) on the element
of the first.  Coefficients represent it there; no point has to be located.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats, frozen_ints
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.data.dataset import Block, Dataset, Expansion, Field, Homogeneous
from elvis.core.mapping.boxes import BoxTree, outward
from elvis.core.mapping.geometry import GeometryBlock, geometry
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.polynomials.row_products import row_products
from elvis.core.shapes import Shape

#: tolerance for maps of the same element, relative to the size of coordinates: rounding in other programs' numbers
_SAME = 1e-12
#: tolerance for equal polynomials at points, each of magnitude one
_CLOSE = 1e-12
_SHAPES = tuple(Shape)

#: for each corner of the first element, the corner of the second one
Corners = tuple[int, ...]
#: a shape, and the corner of the second element that each corner of the first one is
Symmetry = tuple[Shape, Corners]


@dataclass(frozen=True, eq=False)
class CommonElements:
    """Elements of one dataset that are elements of another.

    element_ids  (n,)  in the first dataset, ascending
    others       (n,)  their ids in the second
    kinds        (n,) numbers of the symmetries, -1 if reference coordinates are the same
    symmetries   in ascending order
    is_whole     whether they are all elements of the first dataset
    apart        largest distance of their maps in a coordinate, relative to the size of coordinates
    """

    element_ids: Ints
    others: Ints
    kinds: Ints
    symmetries: tuple[Symmetry, ...]
    is_whole: bool
    apart: float

    def __len__(self) -> int:
        return len(self.element_ids)

    def field(self, of: Field, name: str) -> Field:
        """A field of the second dataset as one of the first, on common elements, exact but for rounding."""
        return Field(name, tuple(self._blocks(of)), of.continuous)

    def _blocks(self, of: Field) -> Iterator[Block]:
        for block in of.blocks:
            rows, mine = self._rows(block)
            for kind in np.unique(self.kinds[mine]).tolist():
                yield self._block(block, rows, mine, None if kind < 0 else self.symmetries[kind])[0]

    def in_parts(self, of: Field, name: str, symmetries: Sequence[Symmetry]) -> tuple[Field, list[tuple[int, Ints]]]:
        """The field on parts of both datasets, with the blocks that occur in any part.

        For each block, the block of the second dataset that holds its elements, and their rows (n,) there.

        symmetries  symmetries of all parts, ascending
        """
        blocks, places = [], []
        for number, block in enumerate(of.blocks):
            rows, mine = self._rows(block)
            own = [symmetry for symmetry in symmetries if symmetry[0] is block.expansion.shape]
            for symmetry in (None, *own):
                found, place = self._block(block, rows, mine, symmetry)
                blocks.append(found)
                places.append((number, place))
        return Field(name, tuple(blocks), of.continuous), places

    def _rows(self, block: Block) -> tuple[Ints, Ints]:
        """(n,) rows of common elements in a block of the second dataset, and among all common elements."""
        order = np.argsort(self.others, kind="stable")
        known = self.others[order]
        place = np.searchsorted(known, block.element_ids)
        place = np.minimum(place, max(len(known) - 1, 0))
        rows = np.flatnonzero(known[place] == block.element_ids) if len(known) else place[:0]
        return rows, order[place[rows]]

    def _block(self, block: Block, rows: Ints, mine: Ints, symmetry: Symmetry | None) -> tuple[Block, Ints]:
        """The elements with a symmetry among some of a block, and their rows in it."""
        numbers = [-1, *range(len(self.symmetries))]
        known = dict(zip((None, *self.symmetries), numbers, strict=True))
        here = self.kinds[mine] == known[symmetry] if symmetry in known else np.zeros(len(mine), bool)
        expansion, coefficients = self._turned(block, rows[here], symmetry)
        ids = self.element_ids[mine[here]]
        return Block(expansion, frozen_ints(ids), frozen_floats(coefficients)), rows[here]

    def _turned(self, block: Block, rows: Ints, symmetry: Symmetry | None) -> tuple[Expansion, Floats]:
        """Coefficients of some elements of a block in the first dataset's reference coordinates."""
        if symmetry is None:
            return block.expansion, block.coefficients[rows] if len(rows) < len(block) else block.coefficients
        found = _turning(block.expansion, *symmetry)
        assert found is not None
        expansion, matrix = found
        return expansion, row_products(block.coefficients[rows], matrix)


def common_elements(first: Dataset, second: Dataset) -> CommonElements:
    """The elements that two datasets have in common: their maps are the same to rounding of the coordinates.

    There are none if fields have other Fourier series.
    """
    if _series(first) != _series(second):
        return _joined([], [], 0, 0.0)
    if first.mesh is second.mesh and not (first.map_names or second.map_names):
        ids = first.mesh.domain_ids()
        return CommonElements(frozen_ints(ids), frozen_ints(ids), frozen_ints(np.full(len(ids), -1)), (), True, 0.0)
    ours, theirs = geometry(first), geometry(second)
    size = max((float(np.abs(block.coefficients).max(initial=0.0)) for block in ours), default=0.0) or 1.0
    spaces = {block.expansion for one in second.solution for block in one.blocks}
    symmetries: list[Symmetry] = []
    parts: list[_Match] = []
    for one in ours:
        for two in theirs:
            if one.expansion.shape is two.expansion.shape and len(one) and len(two):
                parts += _matched(one, two, _SAME * size, spaces, symmetries)
    return _joined(parts, symmetries, sum(map(len, ours)), size)


#: ids in either dataset, numbers of symmetries, and distances of maps, (n,) each
_Match = tuple[Ints, Ints, Ints, Floats]


def _joined(parts: Sequence[_Match], symmetries: Sequence[Symmetry], total: int, size: float) -> CommonElements:
    """Several matches as one, of ``total`` elements of the first dataset; elements of either dataset count once."""
    none = np.empty(0, np.int64)
    first: _Match = (none, none, none, np.empty(0))
    columns = [np.concatenate(column) for column in zip(first, *parts, strict=True)]
    for own in (1, 0):
        rows = np.unique(columns[own], return_index=True)[1]
        columns = [column[rows] for column in columns]
    # numbers of symmetries don't depend on which of them comes first
    ordered = sorted(symmetries, key=place_of)
    number = np.array([*(ordered.index(symmetry) for symmetry in symmetries), -1])
    ids, others, kinds = map(frozen_ints, (columns[0], columns[1], number[columns[2]]))
    apart = float(columns[3].max(initial=0.0)) / (size or 1.0)
    return CommonElements(ids, others, kinds, tuple(ordered), 0 < total == len(ids), apart)


def place_of(symmetry: Symmetry) -> tuple[int, Corners]:
    """The key by which symmetries are sorted."""
    return _SHAPES.index(symmetry[0]), symmetry[1]


def _matched(
    one: GeometryBlock,
    two: GeometryBlock,
    tolerance: float,
    spaces: Iterable[Expansion],
    symmetries: list[Symmetry],
) -> Iterator[_Match]:
    """Common elements of two blocks of a shape.

    spaces  of the second dataset's fields, which must have polynomials on the first one's elements
    """
    shape = one.expansion.shape
    ours, theirs = (evaluate(own.expansion, own.coefficients, shape.vertices).swapaxes(1, 2) for own in (one, two))
    rows, others = _near(ours.mean(axis=1), theirs.mean(axis=1), tolerance)

    # each corner of one element is a corner of the other: no two are the same, but where nothing turns
    apart = np.abs(ours[rows][:, :, None] - theirs[others][:, None]).max(axis=3)
    own = np.arange(apart.shape[1])
    is_unturned = (apart[:, own, own] <= tolerance).all(axis=1)
    corners = np.where(is_unturned[:, None], own, apart.argmin(axis=2))
    same = (apart.min(axis=2) <= tolerance).all(axis=1)
    same &= (np.sort(corners, axis=1) == own).all(axis=1)
    rows, others, corners = rows[same], others[same], corners[same]

    for turn in map(tuple, np.unique(corners, axis=0).tolist()):
        here = (corners == turn).all(axis=1)
        if not _is_symmetry(shape, turn, spaces):
            continue
        distances = _distances(one, two, rows[here], others[here], turn)
        near = distances <= tolerance
        number = _number(shape, turn, symmetries)
        ids, other_ids = one.element_ids[rows[here]], two.element_ids[others[here]]
        yield ids[near], other_ids[near], np.full(near.sum(), number), distances[near]


def _is_symmetry(shape: Shape, corners: Corners, spaces: Iterable[Expansion]) -> bool:
    """Whether corners are exchanged as a symmetry of a shape does, and fields of all spaces can be."""
    if corners == tuple(range(len(corners))):
        return True
    own = [space for space in spaces if space.shape is shape]
    return _symmetry(shape, corners) is not None and all(_turning(space, shape, corners) for space in own)


def _number(shape: Shape, corners: Corners, symmetries: list[Symmetry]) -> int:
    """The number of a symmetry, which is added to the list if new; -1 for the identity."""
    if corners == tuple(range(len(corners))):
        return -1
    if (shape, corners) not in symmetries:
        symmetries.append((shape, corners))
    return symmetries.index((shape, corners))


def _near(ours: Floats, theirs: Floats, tolerance: float) -> tuple[Ints, Ints]:
    """Pairs of points (n, 3) and (m, 3) that are nearer than a tolerance in every coordinate."""
    tree = BoxTree.build(outward(theirs - tolerance, theirs + tolerance, 0.0))
    rows, others = tree.candidates(ours)
    near = (np.abs(ours[rows] - theirs[others]) <= tolerance).all(axis=1)
    return rows[near], others[near]


def _distances(one: GeometryBlock, two: GeometryBlock, rows: Ints, others: Ints, corners: Corners) -> Floats:
    """(n,) largest distance of the maps x1(xi) and x2(S xi) of elements in a coordinate.

    Polynomials that agree at as many points as either has coefficients are the same; the largest degree counts in all
    directions, which the symmetry exchanges.
    """
    shape = one.expansion.shape
    degree = max(max(box_degrees(bernstein_space(own.expansion))) for own in (one, two))
    points = _lattice(shape, degree + 1)
    ours = evaluate(one.expansion, one.coefficients[rows], points)
    theirs = evaluate(two.expansion, two.coefficients[others], _turned_points(shape, corners, points))
    return np.asarray(np.abs(ours - theirs).max(axis=(1, 2)))


def _lattice(shape: Shape, count: int) -> Floats:
    """(n, d) points inside a shape, ``count`` per direction of eta, which determine polynomials of lower degree."""
    line = np.cos(np.linspace(0.05, np.pi - 0.05, count))
    eta = np.stack(np.meshgrid(*[line] * shape.dimension, indexing="ij"), axis=-1)
    return uncollapse(shape, eta.reshape(-1, shape.dimension))


@bounded_cache
def _symmetry(shape: Shape, corners: Corners) -> Floats | None:
    """(1 + d, d) the affine map of reference coordinates, (1, xi) to S xi, that takes corner i to ``corners[i]``.

    None if no such map exists.
    """
    own = np.hstack([np.ones((len(corners), 1)), shape.vertices])
    wanted = shape.vertices[list(corners)]
    matrix = np.linalg.lstsq(own, wanted, rcond=None)[0]
    # entries are halves
    matrix = np.round(2 * matrix) / 2
    return frozen_floats(matrix) if np.array_equal(own @ matrix, wanted) else None


def _turned_points(shape: Shape, corners: Corners, points: Floats) -> Floats:
    matrix = _symmetry(shape, corners)
    assert matrix is not None
    return np.asarray(matrix[0] + points @ matrix[1:])


@bounded_cache
def _turning(expansion: Expansion, shape: Shape, corners: Corners) -> tuple[Expansion, Floats] | None:
    """An expansion that holds u(S xi) for all u of another one, and the matrix (m, m') of coefficients.

    None if a Modified expansion of the same degrees, exchanged as the symmetry does, doesn't hold them.
    """
    matrix = _symmetry(shape, corners)
    if matrix is None or expansion.homogeneous is not None:
        return None
    degrees = box_degrees(bernstein_space(expansion))
    if shape in (Shape.QUADRILATERAL, Shape.HEXAHEDRON):
        degrees = tuple(degrees[int(axis)] for axis in np.abs(matrix[1:]).argmax(axis=1))
    elif shape is Shape.PYRAMID:
        degrees = (max(degrees),) * 3
    target = modified(shape, tuple(max(degree, 1) + 1 for degree in degrees))
    points = _lattice(shape, max(target.modes) + 1)
    turned = values(expansion, _turned_points(shape, corners, points))
    modes = values(target, points)
    found = np.linalg.lstsq(modes, turned, rcond=None)[0]
    if np.abs(modes @ found - turned).max() > _CLOSE * max(float(np.abs(turned).max()), 1.0):
        return None
    return target, frozen_floats(found.T)


def _series(dataset: Dataset) -> set[Homogeneous]:
    """The Fourier series along straight directions that fields have."""
    found = (block.expansion.homogeneous for one in dataset.solution for block in one.blocks)
    return {series for series in found if series is not None}
