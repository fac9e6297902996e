"""Surfaces where an expression has a value, or that are planes, as what integrals go over."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import Ranks
from elvis.core.base.rows import Rows
from elvis.core.data.axis_planes import box_of
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.coincident import Sides, Turned, turned
from elvis.core.integrals.levels.boxes import FIRST, LevelBoxes
from elvis.core.integrals.quadrics import quadric
from elvis.core.integrals.reference_cells import Piece
from elvis.core.integrals.separation import CellBoxes, separated
from elvis.core.integrals.subcells import corners, subcell_map, without_apex
from elvis.core.integrals.touching import touched
from elvis.core.mapping.patch import Patch, check_not_homogeneous
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.quantities.cleared import MOST_CLEARED, Cleared, cleared_on
from elvis.core.quantities.elements.points import ElementPoints, Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.expression_nets import NetsOf, lattice_of, places_of
from elvis.core.quantities.regions import Region, defined_side, of_polynomial, side
from elvis.core.quantities.tree import AXES, Node, call, fold, jump_name, negative, number
from elvis.core.shapes import Shape

_OUTSIDE = "outside:"
#: relative shift of a level, so that surfaces along borders of elements count once: minimum, maximum, and factor of the
#: jump between two elements
_AWAY, _MOST_AWAY, _AWAY_OF_JUMPS = 2e-14, 4e-12, 4.0
#: relative value beyond which an element certainly doesn't meet the surface, for any rounding
_FAR = 1e-9
#: the size of a function that is zero throughout an element: nowhere negative after the shift
_NOTHING = 1e-280
#: rounding of values on borders, and jumps there that still count as rounding, relative to the values
_ROUNDING, _MOST_JUMP = 2e-15, 1e-10
#: the same within which they are 0 at the apex of a pyramid
_AT_APEX = 4.0


@dataclass(frozen=True, eq=False)
class LevelPiece:
    """The zeros of an expression inside the elements of a piece or, with ``is_filled``, its negative part."""

    piece: Piece
    level: Level
    is_filled: bool = False

    def __len__(self) -> int:
        return len(self.piece)

    @property
    def patch(self) -> Patch:
        """The patch of the piece."""
        return self.piece.patch

    @property
    def has_normals(self) -> bool:
        """Towards greater values, on surfaces."""
        return not self.is_filled

    @property
    def dimension(self) -> int:
        """Dimension of the elements, for surfaces one less."""
        return self.piece.dimension - (not self.is_filled)

    def part(self, chosen: Ints | Bools) -> LevelPiece:
        """Some of the elements."""
        return replace(self, piece=self.piece.part(chosen))


@dataclass(frozen=True, eq=False)
class Level:
    """A part of space where an expression is less than a value, and the surface where it has the value.

    expression  less than zero there; its zeros are the surface
    region      the same by signs of polynomials
    zeros       these polynomials
    """

    name: str
    expression: Expression
    region: Region
    zeros: tuple[ZeroSet, ...]

    @staticmethod
    def parse(dataset: Dataset, name: str) -> Level | None:
        """The surface of a `quadric` or of ``EXPRESSION=VALUE``; None for other names, ElvisError for wrong ones."""
        known = _surface(dataset, name)
        if known is None:
            return None
        root, value = known
        return Level._of(name, call("-", root, number(value)), side(root, value, 1))

    @staticmethod
    def clip(dataset: Dataset, text: str) -> Level:
        """The rest after clipping with ``SURFACE``, or ``outside:SURFACE``, as a level.

        Raises ElvisError for other texts.

        Surfaces are as in `parse`; their expression is negative inside.
        """
        is_outside = text.startswith(_OUTSIDE)
        known = _surface(dataset, text.removeprefix(_OUTSIDE))
        if known is None:
            forms = "plane:P:N, sphere:C:R, cylinder:P:A:R or QUANTITY=VALUE"
            raise ElvisError(f"--clip: expected {forms}, or outside: and one, found {text!r}")
        root, value = known
        height = call("-", root, number(value))
        sign = 1 if is_outside else -1
        return Level._of(text, height if is_outside else negative(height), defined_side(root, value, sign))

    @staticmethod
    def _of(name: str, root: Node, region: Region | None) -> Level:
        """The level of an expression, which may be a polynomial itself where no region is known."""
        known = of_polynomial(root) if region is None else region
        zeros = tuple(ZeroSet(name, Expression(name, node)) for node in known.every_polynomial)
        return Level(name, Expression(name, root), known, zeros)

    @property
    def expressions(self) -> tuple[Expression, ...]:
        """The expressions to be evaluated."""
        return (self.expression, *(zero.expression for zero in self.zeros))

    def known(self, evaluator: Evaluator, ranks: Ranks, sides: Sides | None = None) -> Level:
        """The level with the sizes of polynomials in the elements of all ranks, and with surfaces that are sides."""
        check_not_homogeneous(self.name, evaluator.patches)
        return replace(self, zeros=tuple(zero.known(evaluator, ranks, sides) for zero in self.zeros))

    def boxes(
        self,
        piece: Piece,
        evaluator: Evaluator,
        sizes: Floats,
        parts: Floats,
        is_filled: bool = False,
        is_valid: bool = True,
    ) -> tuple[list[LevelBoxes], Ints]:
        """The surface in some elements, or the part below it; and the elements (m,) that are entirely below it.

        sizes      (n, e) of e expressions on them
        parts      (n,) rounding relative to the sizes
        is_filled  whether the part below is requested
        is_valid   whether det J keeps its sign on the elements
        Raises ElvisError if the surface is not a level of polynomials.
        """
        seen = {zero.expression.root: zero.seen(piece, evaluator, is_valid) for zero in self.zeros}
        signs = {node: own.signs for node, own in seen.items()}
        state = np.broadcast_to(self.region.holds(signs), len(piece))
        met = np.flatnonzero(state == 0)
        known = {node: own.of(met) for node, own in seen.items()}
        own_sizes = sizes[met] * parts[met, None], sizes[met]
        found = [boxes for _, boxes in boxes_in_cells(piece.part(met), known, [self.region], own_sizes, is_filled)]
        if not is_filled:
            for node in self.region.every_surface & known.keys():
                found += _touched(piece.part(met), known[node].touched(), own_sizes)
        return list(_of_degrees(found)), np.flatnonzero(state > 0)


def boxes_in_cells(
    piece: Piece,
    seen: Mapping[Node, Seen],
    regions: Sequence[Region],
    sizes: tuple[Floats, Floats],
    is_filled: bool,
) -> Iterator[tuple[int | None, LevelBoxes]]:
    """Numbers of regions, each with its part of elements or, for a single region, the surface that bounds it.

    None marks boxes in doubt between several regions; for a single region such boxes are lost.
    seen   the polynomials of the regions on the elements
    sizes  (n, e) rounding of expressions, and their sizes
    """
    for cell in range(len(corners(piece.patch.shape))) if len(piece) else ():
        nets = {node: own.nets(cell) for node, own in seen.items()}
        band = {node: own.band for node, own in seen.items()}
        known = separated(regions, CellBoxes.whole(nets, band))
        boxes = partial(_boxes, piece, cell, sizes, is_filled)
        for region, node, some in known.single:
            if is_filled or node in regions[region].every_surface:
                yield region, boxes(some, some.nets[node], some.band[node], node).resolved(FIRST)
        for region, some in known.whole if is_filled else ():
            if len(some):
                yield region, boxes(some, _inside(some), np.zeros(len(some)))
        if len(known.left):
            left = boxes(known.left, _inside(known.left), np.zeros(len(known.left)))
            many = max(2, sum(len(own.every_surface) for own in regions))
            yield (None, left) if len(regions) > 1 else (0, left.given_up(many))


def _boxes(
    piece: Piece,
    cell: int,
    sizes: tuple[Floats, Floats],
    is_filled: bool,
    some: CellBoxes,
    nets: Floats,
    band: Floats,
    zero: Node | None = None,
) -> LevelBoxes:
    """Boxes in a cell with nets of one polynomial."""
    element = piece.rows[some.index], np.full(len(some), cell)
    rounding, size = (each[some.index] for each in sizes)
    columns = nets, band, (rounding, size)
    return LevelBoxes.of(piece.patch, element, (some.low, some.high), *columns, is_filled, zero)


def _of_degrees(boxes: Sequence[LevelBoxes]) -> Iterator[LevelBoxes]:
    """Boxes of the same polynomial together."""
    groups: dict[tuple[object, ...], list[LevelBoxes]] = {}
    for own in boxes:
        groups.setdefault((own.zero, *own.nets.shape[1:]), []).append(own)
    yield from map(LevelBoxes.joined, groups.values())


def _inside(boxes: CellBoxes) -> Floats:
    """(n, D, D, D) nets of a negative number, of the highest degrees of all polynomials."""
    return np.full(np.max([own.shape for own in boxes.nets.values()], axis=0), -1.0)


def _surface(dataset: Dataset, name: str) -> tuple[Node, float] | None:
    """An expression and its value on a surface of a name; None for other names, ElvisError for wrong ones."""
    is_axis = name in AXES and name not in dataset.mesh.named_parts()
    surface = quadric(f"plane:{name}" if is_axis else name, partial(box_of, dataset))
    if surface is not None:
        return surface, 0.0
    text, equals, value = name.rpartition("=")
    if not equals:
        return None
    expression = Expression.of(dataset, text.strip())
    try:
        return expression.root, float(value)
    except ValueError:
        raise ElvisError(f"{name}: expected a number after =, found {value.strip()!r}") from None


@dataclass(frozen=True, eq=False)
class ZeroSet:
    """The zeros of a polynomial.

    size    maximum magnitude of its terms in all elements; None if not yet known
    turned  for each patch, the elements in which the level is moved down; empty if no sides are known
    """

    name: str
    expression: Expression
    size: float | None = None
    turned: tuple[Turned, ...] = ()

    def _doubt(self, evaluator: Evaluator, patch: Patch, rows: Ints, lattice: Floats) -> _Doubt:
        """Precision of values on borders of elements (m,), from points (q, d) inside them."""
        jump = np.full(len(rows), _ROUNDING)
        if not len(rows):
            return _Doubt(jump, jump)
        places = Lattice(patch, rows, lattice)
        for name in self.expression.fields:
            ids = patch.element_ids[rows]
            found = evaluator.attributes.constant(jump_name(name), patch.shape, ids)
            own = np.abs(places.derivative(evaluator.names.index(name), 0)).reshape(len(rows), -1).max(axis=1)
            is_rounding = found <= _MOST_JUMP * own
            parts = np.divide(found, own, out=np.zeros(len(rows)), where=is_rounding & (own > 0))
            jump = np.maximum(jump, parts)

        # rounding of fields is relative to their own values, of coordinates to the largest
        if self._has_coordinates:
            return _Doubt(np.full(len(rows), self._size(evaluator)), jump)
        (sizes,) = evaluator.sizes_at([self.expression], places)
        greatest = np.broadcast_to(sizes, len(places)).reshape(len(rows), -1).max(axis=1)
        return _Doubt(np.maximum(greatest, _NOTHING), jump)

    @property
    def _has_coordinates(self) -> bool:
        return bool(fold(self.expression.root, lambda leaf: leaf.op == "coordinate", lambda _, parts: any(parts)))

    def known(self, evaluator: Evaluator, ranks: Ranks, sides: Sides | None = None) -> ZeroSet:
        """The polynomial with its size in the elements of all ranks, and the elements in which it is moved down."""
        known = replace(self, size=max(ranks.exchange(self._size(evaluator), f"the size of {self.name}")))
        return known if sides is None else replace(known, turned=known._turned(evaluator, sides))

    def _turned(self, evaluator: Evaluator, sides: Sides) -> tuple[Turned, ...]:
        """See `coincident`."""
        cleared = [cleared_on(self.expression, evaluator, patch, patch.is_linear) for patch in evaluator.patches]
        degrees = [None if own is None else own.degree for own in cleared]

        def values(patch: Patch, rows: Ints, points: Floats) -> Floats:
            (found,) = evaluator.values_at([self.expression], Lattice(patch, rows, points))
            return np.broadcast_to(found, len(rows) * len(points)).reshape(len(rows), len(points))

        def within(patch: Patch, rows: Ints) -> Floats:
            vertices = patch.shape.vertices
            doubt = self._doubt(evaluator, patch, rows, np.vstack([vertices, vertices.mean(axis=0)]))
            return np.asarray(doubt.away * doubt.size)

        return turned(evaluator.patches, sides, degrees, values, _FAR * self._size(evaluator), within)

    def _size(self, evaluator: Evaluator) -> float:
        """Maximum magnitude of the expression's terms, at the centres of all elements."""
        if self.size is not None:
            return self.size
        sizes = [0.0]
        for patch in evaluator.patches:
            middle = np.zeros((len(patch), patch.shape.dimension))
            points = ElementPoints(patch, np.arange(len(patch)), uncollapse(patch.shape, middle))
            (size,) = evaluator.sizes_at([self.expression], points)
            # NaN if a patch lacks the field
            sizes.append(float(np.fmax.reduce(np.ravel(size), initial=0.0)))
        return max(sizes)

    def seen(self, piece: Piece, evaluator: Evaluator, is_valid: bool = True) -> Seen:
        """The polynomial on elements of a piece; raises ElvisError if it is not a polynomial.

        is_valid  whether det J keeps its sign on the elements
        """
        patch, (degree, power) = piece.patch, self._cleared(piece, evaluator, is_valid)
        t = places_of(degree)
        lattice = lattice_of(t, patch.shape.dimension)
        whole = uncollapse(patch.shape, 2 * lattice - 1)
        nets = NetsOf(self.expression, evaluator, patch, t, power=power).on(piece.rows, whole)
        axes = tuple(range(1, nets.ndim))
        least, most = nets.min(axis=axes), nets.max(axis=axes)

        # the precision of values matters only near the surface
        far = degree * _FAR * self._size(evaluator)
        signs = (least > far).astype(np.int64) - (most < -far)
        near = np.flatnonzero(signs == 0)
        doubt = self._doubt(evaluator, patch, piece.rows[near], whole)
        within, moved = doubt.within(degree), doubt.away * doubt.size
        signs[near] = (least[near] > within).astype(np.int64) - (most[near] + moved < -within)
        is_nothing = np.maximum(most[near], -least[near]) <= within
        signs[near[is_nothing]] = 1
        every = _Doubt(np.zeros(len(piece)), np.zeros(len(piece)))
        every.size[near], every.jump[near] = doubt.size, doubt.jump
        return Seen(self, piece, evaluator, degree, power, signs, every, *self._turned_in(piece, evaluator))

    def _turned_in(self, piece: Piece, evaluator: Evaluator) -> tuple[Bools, Floats]:
        """(n,) elements of a piece in which the level is moved down, (n,) areas of sides that are in doubt."""
        for patch, own in zip(evaluator.patches, self.turned, strict=False):
            if patch is piece.patch:
                return own.is_turned[piece.rows], own.doubt[piece.rows]
        return np.zeros(len(piece), bool), np.zeros(len(piece))

    def _cleared(self, piece: Piece, evaluator: Evaluator, is_valid: bool) -> Cleared:
        """Degree of the expression in each direction, and the power of det J that it is multiplied by."""
        patch = piece.patch
        if patch.shape.dimension < 2:
            raise ElvisError(f"{self.name}: expected 2D or 3D data, to cut them")
        found = cleared_on(self.expression, evaluator, patch, bool(piece.is_affine.all()))
        if found is None:
            raise ElvisError(f"{self.name}: expected a polynomial of fields, their first derivatives and coordinates")
        if found.power and found.degree > MOST_CLEARED:
            degree = f"expected a degree of at most {MOST_CLEARED} on curved elements, found {found.degree}"
            raise ElvisError(f"{self.name}: {degree}")
        if found.power and not is_valid:
            element = patch.element_ids[piece.rows[0]]
            raise ElvisError(f"{self.name}: expected elements with derivatives, found folds as in element {element}")
        return Cleared(max(found.degree, 1), found.power)


@dataclass(frozen=True, eq=False)
class _Doubt(Rows):
    """Precision of values of an expression on borders of elements (n,).

    size  (n,) maximum magnitude of its terms
    jump  (n,) relative difference between two elements there
    """

    size: Floats
    jump: Floats

    @property
    def away(self) -> Floats:
        """(n,) by how much of the size the level is moved."""
        return np.clip(_AWAY_OF_JUMPS * self.jump, _AWAY, _MOST_AWAY)

    def within(self, degree: int) -> Floats:
        """(n,) values of polynomials of a degree that may be 0."""
        return degree * self.jump * self.size

    def moves(self, rows: Ints, is_turned: Bools, count: int) -> Floats:
        """(count,) shift of the level in elements of a patch, given for rows (n,)."""
        found = np.zeros(count)
        found[rows] = np.where(is_turned, -1.0, 1.0) * self.away * self.size
        return found


@dataclass(frozen=True, eq=False)
class Seen:
    """A polynomial on elements of a piece.

    degree  of the polynomial in each direction
    power   of det J in it
    signs   (n,) its sign if constant, else 0
    is_turned, sides  (n,) whether the level is moved down, and areas of sides on which the surface is in doubt
    """

    zero: ZeroSet
    piece: Piece
    evaluator: Evaluator
    degree: int
    power: int
    signs: Ints
    doubt: _Doubt
    is_turned: Bools
    sides: Floats

    def of(self, chosen: Ints) -> Seen:
        """The polynomial on some of the elements."""
        return replace(
            self,
            piece=self.piece.part(chosen),
            signs=self.signs[chosen],
            doubt=self.doubt.part(chosen),
            is_turned=self.is_turned[chosen],
            sides=self.sides[chosen],
        )

    @property
    def band(self) -> Floats:
        """(n,) magnitudes of the moved polynomial up to which the unmoved one may be zero."""
        return np.asarray(self.doubt.away * self.doubt.size + self.doubt.within(self.degree))

    @cached_property
    def _moved(self) -> NetsOf:
        patch = self.piece.patch
        moves = self.doubt.moves(self.piece.rows, self.is_turned, len(patch))
        return NetsOf(self.zero.expression, self.evaluator, patch, places_of(self.degree), moves, self.power)

    def nets(self, cell: int) -> Floats:
        """(n, D, D, D) of the moved polynomial on a cell of the elements."""
        patch, rows = self.piece.patch, self.piece.rows
        d = patch.shape.dimension
        lattice = lattice_of(places_of(self.degree), d)
        reference = subcell_map(patch.shape, np.full(len(lattice), cell), lattice)[0]
        found = self._moved.on(rows, reference)
        if patch.shape is Shape.PYRAMID:
            found = without_apex(found, _AT_APEX * np.maximum(self.doubt.away, _ROUNDING) * self.doubt.size)
        return found.reshape(len(rows), *(1,) * (3 - d), *found.shape[1:])

    def touched(self) -> Floats:
        """(n,) areas of sides of elements on which the moved polynomial may be zero, or surfaces are in doubt."""
        found = touched(self.piece, self._moved.on, places_of(self.degree), self.doubt.within(self.degree))
        return found + self.sides


def _touched(piece: Piece, areas: Floats, sizes: tuple[Floats, Floats]) -> Iterator[LevelBoxes]:
    """Cells of elements on whose sides areas (n,) of the surface may be lost, or counted twice."""
    here = np.flatnonzero(areas > 0)
    if not len(here):
        return
    low, d = np.zeros((len(here), 3)), piece.patch.shape.dimension
    nets = np.ones((len(here), *((2,) * 3)[3 - d :])).reshape(len(here), *(1,) * (3 - d), *(2,) * d)
    for cell in range(len(corners(piece.patch.shape))):
        element = piece.rows[here], np.full(len(here), cell)
        rounding, size = (each[here] for each in sizes)
        boxes = LevelBoxes.of(piece.patch, element, (low, low + 1), nets, low[:, 0], (rounding, size), False)
        yield replace(boxes.given_up(0), further=areas[here])
