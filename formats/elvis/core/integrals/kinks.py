"""Expressions with kinks and jumps as smooth ones, each with the region in which it is the expression.

abs(a) is a where a > 0 and -a where a < 0; max, min, sign and step are alike.  If a is a quotient of polynomials, signs
of polynomials bound the regions (see `regions`).  Kinks inside of others come first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.base.ranks import ALONE
from elvis.core.integrals.degrees import DegreeRules
from elvis.core.integrals.levels.boxes import LevelBoxes
from elvis.core.integrals.levels.of_elements import ZeroSet, boxes_in_cells
from elvis.core.integrals.reference_cells import Piece
from elvis.core.quantities.cleared import cleared_on
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.regions import EVERYWHERE, NOWHERE, Region, side
from elvis.core.quantities.tree import ONE, ZERO, Node, call, fold, negative, number, ordered

#: regions of an expression, beyond which its kinks are not cut
_MOST = 16

#: the switching expression, the value where it is negative, and the value where it is positive
Switch = tuple[Node, Node, Node]
_SWITCHES: Mapping[str, Callable[..., Switch]] = {
    "abs": lambda a: (a, negative(a), a),
    "sign": lambda a: (a, number(-1.0), ONE),
    "step": lambda a, b: (call("-", a, b), ONE, ZERO),
    "max": lambda a, b: (call("-", a, b), b, a),
    "min": lambda a, b: (call("-", a, b), a, b),
}


@dataclass(frozen=True, eq=False)
class Branch:
    """A smooth expression, and the region in which it is another one."""

    region: Region
    root: Node


def branches(root: Node) -> list[Branch]:
    """The smooth expressions that an expression with kinks consists of.

    Only the expression itself if a region is unknown.
    """
    found = [Branch(EVERYWHERE, root)]
    left: set[Node] = set()
    while len(found) < _MOST:
        switches = (_first_switch(own.root, left) for own in found)
        node = next((each for each in switches if each is not None), None)
        if node is None:
            break
        switch, *values = _SWITCHES[node.op](*node.operands)
        regions = [side(switch, 0.0, sign) for sign in (1, -1)]
        if any(region is None for region in regions):
            left.add(node)
            continue
        found = [each for own in found for each in _split(own, node, regions, values)]
    return found


def _split(own: Branch, node: Node, regions: Sequence[Region | None], values: Sequence[Node]) -> Iterator[Branch]:
    """A branch with the values of a part in its regions."""
    if node not in ordered(own.root):
        yield own
        return
    for region, value in zip(regions, values, strict=True):
        if region is not None and region is not NOWHERE:
            yield Branch(Region("all", (*own.region.parts, region)), _with(own.root, node, value))


def _first_switch(root: Node, left: set[Node]) -> Node | None:
    """A part with a kink whose operands have none that are known."""
    return next((node for node in ordered(root) if node.op in _SWITCHES and node not in left), None)


def _with(root: Node, part: Node, value: Node) -> Node:
    """An expression with a part replaced by a value."""

    def inner(node: Node, operands: list[Node]) -> Node:
        return value if node is part else call(node.op, *operands)

    return fold(root, lambda leaf: leaf, inner)


@dataclass(frozen=True, eq=False)
class Cut:
    """An expression with kinks, cut along them.

    numbers  numbers of the branches' expressions, and the number of the expression itself
    regions  of the branches
    zeros    the polynomials on the borders of the regions
    """

    numbers: tuple[int, ...]
    whole: int
    regions: tuple[Region, ...]
    zeros: tuple[ZeroSet, ...]

    @staticmethod
    def of(expression: Expression, whole: int, first: int, found: Sequence[Branch]) -> Cut:
        """The cut of branches whose expressions have the numbers from ``first``."""
        regions = tuple(branch.region for branch in found)
        nodes = dict.fromkeys(node for region in regions for node in region.every_polynomial)
        zeros = tuple(ZeroSet(expression.text, Expression(expression.text, node)) for node in nodes)
        return Cut(tuple(range(first, first + len(found))), whole, regions, zeros)

    def is_known(self, rules: DegreeRules, evaluator: Evaluator) -> bool:
        """Whether a piece can be cut: all of elements with polynomials of fields on them."""
        piece = rules.piece
        if piece.is_side or piece.is_signed or piece.shape.dimension < 2 or piece.patch.homogeneous is not None:
            return False
        found = [cleared_on(zero.expression, evaluator, piece.patch, rules.is_affine) for zero in self.zeros]
        return all(own is not None and own.is_known(rules.is_valid) for own in found)

    def parts(
        self, piece: Piece, evaluator: Evaluator, sizes: Floats, parts: Floats
    ) -> tuple[list[tuple[int, LevelBoxes]], list[tuple[int, Ints]]]:
        """Boxes with the number of the expression there, and elements (m,) of the piece that are in one region.

        sizes  (n, 1) of the expression on the elements
        parts  (n,) of them in which it is rounded
        """
        zeros = [zero.known(evaluator, ALONE) for zero in self.zeros]
        seen = {zero.expression.root: zero.seen(piece, evaluator) for zero in zeros}
        signs = {node: own.signs for node, own in seen.items()}
        states = [np.broadcast_to(region.holds(signs), len(piece)) for region in self.regions]
        whole = [(own, np.flatnonzero(state > 0)) for own, state in zip(self.numbers, states, strict=True)]
        met = np.flatnonzero(np.max(states, axis=0) <= 0)
        known = {node: own.of(met) for node, own in seen.items()}
        every = boxes_in_cells(piece.part(met), known, self.regions, (sizes[met] * parts[met, None], sizes[met]), True)
        boxes = [(self.whole if own is None else self.numbers[own], each) for own, each in every]
        return boxes, [(own, rows) for own, rows in whole if len(rows)]
