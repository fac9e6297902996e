"""Boxes that the surface q = 0 may meet, and how far its triangles may be from it there.

The cells of `elvis.core.integrals.subcells` cover an element: images of the unit cube, in 2D of the unit square.  On a
cell q and the map x are tensor polynomials with Bernstein nets.  A net of one sign proves that q has no zero in its
box; nets of second differences bound second derivatives, and so what linear interpolation leaves.  In 2D the surface is
a curve, and lines stand for triangles.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.rows import Rows
from elvis.core.integrals.reference_cells import Piece
from elvis.core.integrals.subcells import corners, subcell_map, subcell_points
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees, halves, nets_through
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.quantities.elements.points import Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.expression_nets import NetsOf, degree_on, lattice_of, places_of
from elvis.core.shapes import Shape
from elvis.core.streamlines.neighbours import Sides
from elvis.core.triangles.interpolation_errors import interpolation_errors

#: elements whose nets are held at a time, by the numbers in these
_NUMBERS = 1 << 22
#: degree of the polynomial that represents other functions when their size is estimated
_DEGREE_OF_OTHERS = 8
#: error of the polynomial of another function, relative to its range on a cell, up to which distances are bounded
_NEGLIGIBLE = 1e-5
#: by how much the degree of the polynomial rises in turn until its error is small
_HIGHER = (0, 4, 8)
#: share of the way from the middle of an element to its vertices at which periodic functions are not zero as well
_BETWEEN = 0.618
#: values below this share of the largest one are rounding
_ROUNDING = 1e-13
#: elements of a block at most
_ELEMENTS = 128
#: height over a face, of its element's, below which corners of cells are on it
_ON_FACE = 1e-9


@dataclass(frozen=True, eq=False)
class CellBlock(Rows):
    """Boxes of one of the cells of some elements of a patch.

    patch   number of the patch
    cell    number of the cell in the shape
    splits  halvings in each direction before all directions are bisected together
    rows    (n,) of the patch
    index   (n, d) counts boxes of their size from the cell's corner
    levels  (n, D, …, D) nets of q
    maps    (n, d, M, …, M) nets of the map
    slack   (n,) how far q may be from its polynomial at most
    outlines  (n, d, 2) which faces of boxes, by axis and end, are on faces of elements at which triangles end
    is_exact  whether q is within that of its polynomial, and the map is its polynomial
    noise   magnitude of q up to which it counts as zero
    """

    patch: int
    shape: Shape
    cell: int
    splits: tuple[int, ...]
    rows: Ints
    index: Ints
    levels: Floats
    maps: Floats
    slack: Floats
    outlines: Bools
    is_exact: bool
    noise: float

    def halved(self, axes: Sequence[int] | None = None) -> CellBlock:
        """The halves of each box in some directions, by default in all, that may have a zero."""
        rows, index, levels, maps, slack = self.rows, self.index, self.levels, self.maps, self.slack
        outlines = self.outlines
        d = index.shape[1]
        for axis in range(d) if axes is None else axes:
            step = np.eye(d, dtype=np.int64)[axis]
            grown = index * (1 + step)
            rows, slack = np.tile(rows, 2), np.tile(slack, 2)
            index = np.concatenate([grown, grown + step])
            levels, maps = np.concatenate(halves(levels, axis)), np.concatenate(halves(maps, 1 + axis))
            # each half has one end of the box
            low, high = outlines.copy(), outlines.copy()
            low[:, axis, 1] = high[:, axis, 0] = False
            outlines = np.concatenate([low, high])
        near = ~has_one_sign(levels, slack, self.noise)
        whole = replace(self, rows=rows, index=index, levels=levels, maps=maps, slack=slack, outlines=outlines)
        return whole.part(near)


def first_halvings(shape: Shape, is_mixed: bool) -> tuple[int, ...]:
    """Bisections of a cell in each direction that make it as fine as its neighbours.

    Cells at the corners of simplices are half as long as their edges; so are cells of prisms in their triangles.
    Others are as long as an edge, which matters in a mesh of several shapes.
    """
    if shape is Shape.PRISM:
        return 0, 1, 0
    return (int(is_mixed and len(corners(shape)) == 1),) * shape.dimension


@cache
def faces_of_cells(shape: Shape) -> Ints:
    """(cells, 3, 2) the face of an element that a face of a cell, by axis and end, is part of; -1 inside."""
    found = np.full((len(corners(shape)), 3, 2), -1)
    sides = Sides.of(shape)
    for cell, axis, end in np.ndindex(found.shape):
        places = np.array(np.meshgrid(*[[0.0, 1.0]] * 3, indexing="ij")).reshape(3, -1).T
        points = subcell_points(shape, cell, places[places[:, axis] == end])
        heights = np.abs(points @ sides.normals.T + sides.offsets).max(axis=0)
        # the tip of a pyramid is a face of its cell, but none of the element
        if np.ptp(points, axis=0).any() and heights.min() < _ON_FACE:
            found[cell, axis, end] = heights.argmin()
    return frozen_ints(found)


def cell_blocks(
    evaluator: Evaluator, level: Expression, outlines: Sequence[Bools] | None = None
) -> Iterator[CellBlock]:
    """The cells of all elements in which q = 0 is not excluded at once.

    outlines  by patch: (n, faces) at which faces of elements triangles end, in 3D

    Raises ElvisError if q is not finite somewhere.
    """
    is_mixed = len({patch.shape for patch in evaluator.patches}) > 1
    noise = _noise(evaluator, level)
    for number, patch in enumerate(evaluator.patches):
        ends = None if outlines is None else outlines[number]
        for rows, is_affine in _by_map(patch):
            degree = degree_on(level, evaluator, patch, is_affine)
            least = min(max(_DEGREE_OF_OTHERS, _highest(patch)), 2 * _DEGREE_OF_OTHERS)
            degrees = tuple(least + own for own in _HIGHER) if degree is None else (max(1, degree),)
            nets = _CellNets(evaluator, level, patch, is_affine, degrees, degree is not None)
            d = patch.shape.dimension
            numbers = (degrees[-1] + 1) ** d + d * (_map_degree(patch) + 1) ** d
            for some in chunks(len(rows), max(1, _NUMBERS // numbers)):
                for block in _blocks_of(nets, number, rows[some], noise, ends):
                    splits = first_halvings(patch.shape, is_mixed)
                    yield replace(block, splits=splits).halved([axis for axis in range(d) if splits[axis]])


def _noise(evaluator: Evaluator, level: Expression) -> float:
    """The rounding of q, by its values at vertices, in the middle of elements, and between these.

    All elements need the same number: where the surface runs along a face, one of the two must count it as its own.
    """
    largest = 0.0
    for patch in evaluator.patches:
        vertices, middle = patch.shape.vertices, patch.shape.centre
        places = np.vstack([vertices, middle, middle + _BETWEEN * (vertices - middle)])
        for some in chunks(len(patch), max(1, _NUMBERS // len(places))):
            lattice = Lattice(patch, np.arange(some.start, some.stop), places)
            (values,) = evaluator.values_at([level], lattice)
            finite = np.abs(np.asarray(values))[np.isfinite(values)]
            largest = max(largest, float(finite.max(initial=0.0)))
    return _ROUNDING * largest


def _by_map(patch: Patch) -> Iterator[tuple[Ints, bool]]:
    """Rows of elements whose maps are affine, and of the others."""
    every = np.arange(len(patch))
    parts = [Piece(patch, every[some], patch.shape).is_affine for some in chunks(len(patch), 1 << 12)]
    affine = np.concatenate([np.zeros(0, bool), *parts])
    yield from ((rows, known) for rows, known in ((every[affine], True), (every[~affine], False)) if len(rows))


def _highest(patch: Patch) -> int:
    return max((max(own.modes) - 1 for own in patch.fields if own is not None), default=1)


def _map_degree(patch: Patch) -> int:
    return max(1, *box_degrees(bernstein_space(patch.geometry)))


@dataclass(frozen=True, eq=False)
class _CellNets:
    """Nets of an expression on cells of the elements of a patch.

    is_affine  whether the elements' maps are affine
    degrees    of polynomials that stand for the expression: the first with a small error, else the first
    is_exact   whether the expression is a polynomial of the only degree
    """

    evaluator: Evaluator
    level: Expression
    patch: Patch
    is_affine: bool
    degrees: Sequence[int]
    is_exact: bool

    def on(self, rows: Ints, cell: int) -> tuple[Floats, Floats, bool]:
        """Nets on a cell of elements (n,), bounds (n,) of their errors, and whether these are known.

        If they are not known, or too large to be of use, they count as zero.
        """
        first = None
        for degree in self.degrees:
            levels = self._nets(rows, cell, degree)
            if self.is_exact:
                return levels, np.zeros(len(rows)), True
            slack = interpolation_errors(self, rows, lambda places: _in_cell(self.patch.shape, cell, places), degree)
            if (slack <= _NEGLIGIBLE * np.ptp(levels.reshape(len(rows), -1), axis=1)).all():
                return levels, slack, True
            first = levels if first is None else first
        assert first is not None
        return first, np.zeros(len(rows)), False

    def _nets(self, rows: Ints, cell: int, degree: int) -> Floats:
        """Nets of one degree; raises ElvisError if the expression is not finite somewhere."""
        places = places_of(degree)
        nets = NetsOf(self.level, self.evaluator, self.patch, places)
        found = nets.on(rows, _in_cell(self.patch.shape, cell, places))
        if not np.isfinite(found).all():
            bad = self.patch.element_ids[rows[~np.isfinite(found.reshape(len(rows), -1)).all(axis=1)]][0]
            raise ElvisError(f"{self.level.text}: expected finite values, found others in element {bad}")
        return found


def _blocks_of(nets: _CellNets, number: int, rows: Ints, noise: float, outlines: Bools | None) -> Iterator[CellBlock]:
    """The cells of some elements of a patch; triangles end at some faces (elements of the patch, faces)."""
    patch = nets.patch
    map_places = places_of(_map_degree(patch))
    for cell in range(len(corners(patch.shape))):
        levels, slack, is_bounded = nets.on(rows, cell)
        near = ~has_one_sign(levels, slack, noise)
        lattice = _in_cell(patch.shape, cell, map_places)
        world = evaluate(patch.geometry, patch.geometry_coefficients[rows[near]], lattice)
        count, d = len(map_places), patch.shape.dimension
        maps = nets_through(world[:, :d].reshape(-1, count**d), map_places, d).reshape(-1, d, *(count,) * d)
        start = np.zeros((int(near.sum()), d), np.int64)
        ends = np.zeros((len(start), d, 2), bool)
        if outlines is not None:
            faces = faces_of_cells(patch.shape)[cell]
            ends = (faces >= 0) & outlines[rows[near]][:, faces]
        own = rows[near], start, levels[near], maps, slack[near], ends, is_bounded
        whole = CellBlock(number, patch.shape, cell, (0,) * d, *own, noise)
        yield from (whole.part(some) for some in chunks(len(whole.rows), _ELEMENTS))


def _in_cell(shape: Shape, cell: int, places: Floats) -> Floats:
    """(n^d, d) reference points of the lattice of places (n,) each way in a cell."""
    lattice = lattice_of(places, shape.dimension)
    return subcell_map(shape, np.full(len(lattice), cell), lattice)[0]


def has_one_sign(nets: Floats, slack: Floats, noise: float) -> Bools:
    """(n,) whether nets exclude a zero of functions that are within ``slack`` (n,) of them, and values of noise."""
    flat = nets.reshape(len(nets), nets[0].size if len(nets) else 1)
    band = np.maximum(np.maximum(_ROUNDING * np.abs(flat).max(axis=1), slack), noise)
    return np.asarray((flat.min(axis=1) > band) | (flat.max(axis=1) < -band))
