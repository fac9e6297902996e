"""Surfaces where an expression has a value, or that are planes, as what integrals go over."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.errors import ElvisError
from elvis.core.integrals.level_boxes import LevelBoxes, joined
from elvis.core.integrals.quadrics import quadric
from elvis.core.integrals.reference_cells import Piece
from elvis.core.integrals.subcells import corners, subcell_map
from elvis.core.integrals.touching import touched
from elvis.core.patch import Patch
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.quantities.element_points import ElementPoints, Lattice
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.expression_nets import NetsOf, degree_on, lattice_of, places_of
from elvis.core.quantities.levels import same_level
from elvis.core.quantities.tree import call, fold, jump_name, number
from elvis.core.ranks import Ranks
from elvis.core.shapes import Shape

_OUTSIDE = "outside:"
#: by how much of the size of its values a level is moved, so that surfaces along borders of elements count once: at
#: least and at most, and of how far values of two elements differ
_AWAY, _MOST_AWAY, _AWAY_OF_JUMPS = 2e-14, 4e-12, 4.0
#: elements that the surface doesn't meet, whatever is rounding: values so far from it, in parts of the greatest size
_FAR = 1e-9
#: the size of what is zero throughout an element: less than zero nowhere once it is moved
_NOTHING = 1e-280
#: rounding of values on borders, and jumps there that are still taken for rounding, in parts of the size of values
_ROUNDING, _MOST_JUMP = 2e-15, 1e-10
#: what moving a level does to integrals over its surface, as a rule, in parts of how far it is moved
_MOVED = 50.0
#: the same within which they are 0 at the apex of a pyramid
_AT_APEX = 4.0


@dataclass(frozen=True, eq=False)
class LevelPiece:
    """Where an expression is zero inside the elements of a piece, or, where ``is_filled``, less than that."""

    piece: Piece
    level: Level
    is_filled: bool = False

    def __len__(self) -> int:
        return len(self.piece)

    @property
    def patch(self) -> Patch:
        """That of the piece."""
        return self.piece.patch

    @property
    def has_normals(self) -> bool:
        """Towards greater values, on surfaces."""
        return not self.is_filled

    @property
    def dimension(self) -> int:
        """That of the elements, of surfaces one less."""
        return self.piece.dimension - (not self.is_filled)

    def part(self, chosen: Ints | Bools) -> LevelPiece:
        """Some of the elements."""
        return replace(self, piece=self.piece.part(chosen))


@dataclass(frozen=True, eq=False)
class Level:
    """Where an expression is zero.

    size  what it is added up from, at most, in all elements; None where it isn't known yet
    """

    name: str
    expression: Expression
    size: float | None = None

    @staticmethod
    def parse(dataset: Dataset, name: str) -> Level | None:
        """What a `quadric` or ``EXPRESSION=VALUE`` mean; None for other names, ElvisError for wrong ones."""
        surface = quadric(name)
        if surface is not None:
            return Level(name, Expression(name, surface))
        text, equals, value = name.rpartition("=")
        if not equals:
            return None
        expression = Expression.of(dataset, text.strip())
        try:
            level = float(value)
        except ValueError:
            raise ElvisError(f"{name}: expected a number after =, found {value.strip()!r}") from None
        same = same_level(expression.root, level)
        if same is None or same.spurious is not None:
            return Level(name, Expression(name, call("-", expression.root, number(level))))
        return Level(name, Expression(name, call("-", same.root, number(same.value))))

    @staticmethod
    def clip(dataset: Dataset, text: str) -> Level:
        """What is less than zero where ``SURFACE``, or ``outside:SURFACE``, leaves something; ElvisError for others.

        Surfaces are those of `parse`; inside is where their expression is less.
        """
        is_outside = text.startswith(_OUTSIDE)
        level = Level.parse(dataset, text.removeprefix(_OUTSIDE))
        if level is None:
            forms = "plane:P:N, sphere:C:R, cylinder:P:A:R or QUANTITY=VALUE"
            raise ElvisError(f"--clip: expected {forms}, or outside: and one, found {text!r}")
        root = level.expression.root
        return Level(text, Expression(text, root if is_outside else call("-", number(0.0), root)))

    def _doubt(self, evaluator: Evaluator, patch: Patch, rows: Ints, lattice: Floats) -> _Doubt:
        """How well values on borders of elements (m,) are known, from points (q, d) inside them."""
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

        # fields are known in parts of their own values, coordinates in parts of the greatest
        if self._has_coordinates:
            return _Doubt(np.full(len(rows), self._size(evaluator)), jump)
        (sizes,) = evaluator.sizes_at([self.expression], places)
        greatest = np.broadcast_to(sizes, len(places)).reshape(len(rows), -1).max(axis=1)
        return _Doubt(np.maximum(greatest, _NOTHING), jump)

    @property
    def _has_coordinates(self) -> bool:
        return bool(fold(self.expression.root, lambda leaf: leaf.op == "coordinate", lambda _, parts: any(parts)))

    def known(self, evaluator: Evaluator, ranks: Ranks) -> Level:
        """The same with its size in the elements of all ranks."""
        return replace(self, size=max(ranks.exchange(self._size(evaluator), f"the size of {self.name}")))

    def _size(self, evaluator: Evaluator) -> float:
        """What the expression is added up from, at most: in the middles of all elements."""
        if self.size is not None:
            return self.size
        sizes = [0.0]
        for patch in evaluator.patches:
            middle = np.zeros((len(patch), patch.shape.dimension))
            points = ElementPoints(patch, np.arange(len(patch)), uncollapse(patch.shape, middle))
            (size,) = evaluator.sizes_at([self.expression], points)
            sizes.append(float(np.nanmax(size)))
        return max(sizes)

    def boxes(
        self, piece: Piece, evaluator: Evaluator, sizes: Floats, parts: Floats, is_filled: bool = False
    ) -> tuple[LevelBoxes, Ints]:
        """The surface in some elements, or the part below it; which of them (m,) are whole below it.

        sizes      (n, e) of e expressions on them
        parts      (n,) of the sizes in which they are rounded
        is_filled  whether the part below is wanted
        ElvisError where it is not that of a polynomial.
        """
        patch, degree = piece.patch, self._degree(piece, evaluator)
        d, t = patch.shape.dimension, places_of(degree)
        lattice = lattice_of(t, d)
        met, below, doubt = self._met(piece, evaluator, lattice, t)
        moved = NetsOf(self.expression, evaluator, patch, t, doubt.moves(piece.rows[met], len(patch)))
        rounding = sizes[met] * (parts[met] + _MOVED * doubt.away)[:, None]
        found = []
        for cell in range(len(corners(patch.shape))):
            reference = subcell_map(patch.shape, np.full(len(lattice), cell), lattice)[0]
            nets = moved.on(piece.rows[met], reference)
            if patch.shape is Shape.PYRAMID:
                nets = without_apex(nets, _AT_APEX * np.maximum(doubt.away, _ROUNDING) * doubt.size)
            nets = nets.reshape(len(met), *(1,) * (3 - d), *nets.shape[1:])
            cells = _boxes(patch, piece.rows[met], cell, nets, rounding, sizes[met])
            found.append(replace(cells, is_filled=is_filled).resolved())
        boxes = joined(found)
        if is_filled:
            return boxes, below
        areas = touched(piece.part(met), moved.on, t, doubt.within(degree))
        return replace(boxes, lost=boxes.lost + areas @ sizes[met]), below

    def _met(self, piece: Piece, evaluator: Evaluator, lattice: Floats, t: Floats) -> tuple[Ints, Ints, _Doubt]:
        """Which elements of a piece the surface may meet, and which are whole below it; what is known in the first.

        lattice  (n^d, d) of places t (n,) in [0, 1] each way
        """
        patch, degree = piece.patch, len(t) - 1
        whole = uncollapse(patch.shape, 2 * lattice - 1)
        nets = NetsOf(self.expression, evaluator, patch, t).on(piece.rows, whole)
        axes = tuple(range(1, nets.ndim))
        least, most = nets.min(axis=axes), nets.max(axis=axes)

        # how well values are known matters near the surface alone
        far = degree * _FAR * self._size(evaluator)
        is_below = most < -far
        near = np.flatnonzero((least <= far) & ~is_below)
        doubt = self._doubt(evaluator, patch, piece.rows[near], whole)
        within, moved = doubt.within(degree), doubt.away * doubt.size
        is_below[near] = most[near] + moved < -within
        is_met = (least[near] + moved <= within) & ~is_below[near]
        return near[is_met], np.flatnonzero(is_below), _Doubt(doubt.size[is_met], doubt.jump[is_met])

    def _degree(self, piece: Piece, evaluator: Evaluator) -> int:
        """Of the expression in each direction."""
        patch = piece.patch
        if patch.homogeneous is not None or patch.shape.dimension < 2:
            raise ElvisError(f"{self.name}: expected 2D or 3D data without Fourier directions, to cut them")
        degree = degree_on(self.expression, evaluator, patch, bool(piece.is_affine.all()))
        if degree is None:
            raise ElvisError(
                f"{self.name}: expected a polynomial of fields and coordinates, whose surface can be proved"
            )
        return max(degree, 1)


def without_apex(nets: Floats, nothing: Floats | float) -> Floats:
    """The nets (n, D, D, D) of g in pyramids' collapsed cubes, of g / (1 - c) instead where g is 0 at the apex.

    There g vanishes on the whole face c = 1 that is the apex, next to which no halving shows a graph.  The quotient h
    has its sign and its other zeros: with g of degree m in c, h_k = g_k m / (m - k), whose degree is raised to m.

    nothing  (n,) below which values are 0
    """
    degree = nets.shape[3] - 1
    result, k = nets.copy(), np.arange(degree + 1)
    for _ in range(degree):
        size = np.abs(result).max(axis=(1, 2, 3))
        at_apex = np.abs(result[..., -1]).max(axis=(1, 2))
        here = np.flatnonzero((at_apex <= nothing) & (size > nothing))
        if not len(here):
            break
        quotient = result[here][..., :-1] * degree / (degree - k[:-1])
        below = np.concatenate([quotient[..., :1], quotient], axis=3)
        above = np.concatenate([quotient, quotient[..., -1:]], axis=3)
        result[here] = below * k / degree + above * (1 - k / degree)
    return result


@dataclass(frozen=True, eq=False)
class _Doubt:
    """How well values of an expression are known on borders of elements (n,).

    size  (n,) of what it is added up from, at most
    jump  (n,) by how much two elements differ there, in parts of it
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

    def moves(self, rows: Ints, count: int) -> Floats:
        """(count,) by how much the level is moved in elements of a patch, of which rows (n,) are these."""
        found = np.zeros(count)
        found[rows] = self.away * self.size
        return found


def _boxes(patch: Patch, rows: Ints, cell: int, nets: Floats, rounding: Floats, sizes: Floats) -> LevelBoxes:
    """Whole cells of elements."""
    low = np.zeros((len(rows), 3))
    order = np.tile(np.arange(3), (len(rows), 1))
    lost = np.zeros(sizes.shape[1])
    return LevelBoxes(patch, rows, np.full(len(rows), cell), low, low + 1, nets, rounding, sizes, order, lost)
