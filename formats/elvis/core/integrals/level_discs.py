"""Discs of expressions and measures on neighbourhoods of parts of boxes that a graph cuts.

On a cell of an element, fields and map are polynomials of the cell's coordinates, so that Taylor expansions about the
centres of parts bound them and their derivatives.  With t the coordinates of a box and X = dx/dt = X_0 Y, where X_0 is
the derivative at the centre, Y is near the identity, which keeps discs of determinants and solutions narrow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.integrals.box_discs import without_roots
from elvis.core.integrals.degrees import DegreeRules
from elvis.core.integrals.disc_algebra import cofactors, determinant, solution
from elvis.core.integrals.graph_discs import PartDiscs
from elvis.core.integrals.subcells import subcell_map
from elvis.core.integrals.taylor import on_discs, sheared, slope, taylor
from elvis.core.integrals.tree_discs import Ball, TreeDiscs
from elvis.core.patch import Patch
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees, nets_through
from elvis.core.quantities import discs
from elvis.core.quantities.attributes import Attributes, is_constant
from elvis.core.quantities.discs import Disc
from elvis.core.quantities.element_points import Lattice
from elvis.core.quantities.element_sides import SIDES
from elvis.core.quantities.expression_nets import lattice_of, places_of
from elvis.core.quantities.functions import function
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import Node, coordinate, field, fold
from elvis.core.shapes import Shape

_NORMALS = SIDES[:3]


def is_bounded(root: Node, rules: DegreeRules, is_filled: bool) -> bool:
    """Whether discs are known of all leaves of an expression on levels in a piece."""
    patch = rules.piece.patch
    if patch.homogeneous is not None or not patch.is_flat:
        return False

    def leaf(node: Node) -> bool:
        if node.op == "attribute":
            return is_constant(node.name) or (node.name in _NORMALS and not is_filled)
        is_second = node.op == "field" and len(node.axes) > 1
        return not is_second or (rules.is_affine and patch.shape is not Shape.PYRAMID)

    return fold(root, leaf, lambda _, parts: all(parts))


class CellNets:
    """Bernstein nets of leaves on the cells that boxes are in.

    rows, cells  (n,) of the boxes
    """

    def __init__(self, patch: Patch, rows: Ints, cells: Ints, names: Sequence[str]) -> None:
        self._patch, self._names = patch, names
        both = np.stack([cells, rows], axis=1)
        self._own, index = np.unique(both, axis=0, return_inverse=True)
        self.index = index.reshape(-1)
        self._known: dict[Node, Floats] = {}

    def nets(self, node: Node) -> Floats:
        """(cells, D, D, D) of a leaf that is a polynomial; the first axis has one coefficient in two dimensions."""
        if node not in self._known:
            self._known[node] = self._nets(node)
        return self._known[node]

    def _nets(self, node: Node) -> Floats:
        patch = self._patch
        number = None if node.op == "coordinate" else self._names.index(node.name)
        expansion = patch.geometry if number is None else patch.fields[number]
        assert expansion is not None
        d, t = patch.shape.dimension, places_of(max(box_degrees(bernstein_space(expansion))))
        lattice = lattice_of(t, d)
        parts = []
        for cell in np.unique(self._own[:, 0]).tolist():
            reference = subcell_map(patch.shape, np.full(len(lattice), cell), lattice)[0]
            places = Lattice(patch, self._own[self._own[:, 0] == cell, 1], reference)
            if number is None:
                values = places.positions[:, node.axes[0]]
            else:
                derivative = places.derivative(number, len(node.axes))
                values = derivative.T[node.axes[::-1]] if node.axes else derivative
            parts.append(nets_through(values, t, d))
        found = np.concatenate(parts)
        return found.reshape(len(found), *(1,) * (3 - d), *found.shape[1:])


@dataclass(frozen=True, eq=False)
class LevelDiscs:
    """Discs (n, columns) of expressions on parts of boxes whose axes i, j, k have one order.

    box         (n,)    numbers of the boxes in the cells' nets
    low, size   (n, 3)  of the boxes along i, j, k
    order       of the axes
    levels      (n, Di, Dj, Dk) nets of g on the boxes
    gradient    of the polynomial that g is but for its sign; empty where it isn't known
    parts       discs of i, j, k
    are_normals_known  whether g is a graph in the discs; else components of normals are in [-1, 1]
    """

    cells: CellNets
    rules: DegreeRules
    attributes: Attributes
    box: Ints
    rows: Ints
    low: Floats
    size: Floats
    order: tuple[int, ...]
    levels: Floats
    gradient: tuple[Node, ...]
    parts: PartDiscs
    are_normals_known: bool

    def disc(self, root: Node) -> Disc:
        """Middles (n, 1) and radii (n, columns) of an expression."""
        columns = self.parts.radii[0].shape[1]
        tree = TreeDiscs(len(self.box), np.ones((2, columns)), self._ball, lambda _: None)
        found = tree.of(without_roots(root))
        return np.broadcast_to(found.middle, (len(self.box), 1)), np.broadcast_to(
            found.radius, (len(self.box), columns)
        )

    def interval(self, root: Node) -> Interval:
        """Least and greatest value (n,) of an expression at real points; infinite where nothing is known."""

        def leaf(node: Node) -> Interval:
            middle, radius = self._leaf(node)
            if np.ndim(middle) == 0:
                return middle, middle
            return middle[:, 0] - radius[:, 0], middle[:, 0] + radius[:, 0]

        low, high = fold(root, leaf, lambda node, parts: function(node).interval(*parts))
        low, high = (np.broadcast_to(end, len(self.box)) for end in (low, high))
        is_known = ~np.isnan(low) & ~np.isnan(high)
        return np.where(is_known, low, -np.inf), np.where(is_known, high, np.inf)

    @property
    def volume(self) -> Disc:
        """The volume for each unit of i, j and k, area in two dimensions."""
        found = self._determinant if self.rules.is_valid else discs.absolute(self._determinant)
        return discs.times((np.abs(np.linalg.det(self._centre))[:, None], np.float64(0.0)), found)

    @cached_property
    def area(self) -> Disc:
        """The area of the surface for each unit of i and j, length in two dimensions: the better of two formulas."""
        if not self.gradient:
            return self._area_by_slopes
        (middle, radius), other = self._area_by_gradient, self._area_by_slopes
        return middle, np.fmin(radius, other[1] + np.abs(other[0] - middle))

    @property
    def _area_by_gradient(self) -> Disc:
        """det(X) |grad g| / |dg/dk|, which is narrow where the gradient is.

        In a pyramid g may be a quotient of the polynomial, whose derivative along k is that in the world along dx/dk.
        """
        along = self._level_slopes[-1]
        if self.rules.piece.patch.shape is Shape.PYRAMID:
            upwards = [self._on_discs(slope(x, 2)) for x in self._positions]
            along = reduce(discs.plus, map(discs.times, upwards, self._world_slopes))
        return discs.over(discs.times(self.volume, self._steepness), discs.absolute(along))

    @property
    def _area_by_slopes(self) -> Disc:
        """|cof(X) (g_i, g_j, g_k) / g_k|, which is narrow where the surface is a plane.

        cof(X) = det(X_0) X_0^-T cof(Y).
        """
        last = self._level_slopes[-1]
        tilts = [*(discs.over(own, last) for own in self._level_slopes[:-1]), discs.number(1.0)]
        own = [reduce(discs.plus, map(discs.times, row, tilts)) for row in cofactors(self._near)]
        matrix = np.linalg.det(self._centre)[:, None, None] * np.linalg.inv(self._centre).transpose(0, 2, 1)
        squares = [discs.times(part, part) for part in _turned(matrix, own)]
        return discs.root(reduce(discs.plus, squares))

    @cached_property
    def _steepness(self) -> Disc:
        """|grad g|."""
        squares = [discs.times(part, part) for part in self._world_slopes]
        return discs.root(reduce(discs.plus, squares))

    @cached_property
    def _world_slopes(self) -> list[Disc]:
        """The gradient of g in the world."""
        if not self.gradient:
            transposed = [list(row) for row in zip(*self._near, strict=True)]
            found = solution(transposed, self._level_slopes)
            return _turned(np.linalg.inv(self._centre).transpose(0, 2, 1), found)
        sign = np.where(self._is_turned, -1.0, 1.0)[:, None], np.float64(0.0)
        return [discs.times(sign, self.disc(part)) for part in self.gradient[: len(self._axes)]]

    @property
    def _is_turned(self) -> Bools:
        """(n,) whether g is the negative of its polynomial: the gradients have opposite directions at the centres."""
        own = np.stack([each[0][:, 0] for each in self._level_slopes], axis=1)
        here = np.einsum("nij,ni->nj", np.linalg.inv(self._centre), own)
        other = np.stack([np.broadcast_to(self.disc(part)[0], (len(own), 1))[:, 0] for part in self.gradient], axis=1)
        return np.asarray((here * other[:, : here.shape[1]]).sum(axis=1) < 0)

    @cached_property
    def longest(self) -> Floats:
        """(n, d) bounds of the lengths of dx/di, dx/dj and dx/dk at real points."""
        d = len(self._axes)
        found = []
        for axis in self._axes:
            own = [self._on_discs(slope(x, axis)) for x in self._positions]
            found.append(np.sqrt(sum((np.abs(part[0]) + part[1])[:, 0] ** 2 for part in own)))
        return np.stack(found, axis=1).reshape(len(self.box), d)

    def _ball(self, node: Node) -> Ball:
        return Ball.around(self._leaf(node))

    def _leaf(self, node: Node) -> Disc:
        """The disc of a leaf."""
        if node.op == "number":
            return discs.number(node.value)
        if node not in self._known:
            self._known[node] = self._other(node)
        return self._known[node]

    def _other(self, node: Node) -> Disc:
        d = len(self._axes)
        if node.op == "attribute":
            return self._attribute(node.name)
        if node.op == "field" and max(node.axes, default=0) >= d:
            return discs.number(0.0)
        if node.op == "field" and node.axes and not self.rules.is_affine:
            return self._gradient(field(node.name))[node.axes[0]]
        return self._on_discs(self._expansion(node))

    def _attribute(self, name: str) -> Disc:
        if is_constant(name):
            patch = self.rules.piece.patch
            middle = np.tile(patch.shape.vertices.mean(axis=0), (len(self.rows), 1))
            return self.attributes.at(name, patch, self.rows, middle)[:, None], np.float64(0.0)
        axis = _NORMALS.index(name)
        if axis >= len(self._axes):
            return discs.number(0.0)
        if not self.are_normals_known:
            one = np.ones((len(self.box), 1))
            return 0 * one, one
        return discs.over(self._world_slopes[axis], self._steepness)

    @cached_property
    def _known(self) -> dict[Node, Disc]:
        """Leaves that were asked for."""
        return {}

    @property
    def _axes(self) -> range:
        """Those of i, j, k that there are."""
        return range(3 - self.rules.piece.patch.shape.dimension, 3)

    def _on_discs(self, coefficients: Floats) -> Disc:
        return on_discs(coefficients, self.parts.radii)

    def _expansion(self, node: Node) -> Floats:
        """Taylor coefficients of a leaf about the centres of parts."""
        nets = self.cells.nets(node)[self.cells.index[self.box]].transpose(0, *(1 + axis for axis in self.order))
        return self._straightened(taylor(nets, self.low + self.size * self.parts.centres, self.size))

    def _straightened(self, coefficients: Floats) -> Floats:
        """Coefficients in the coordinates whose discs are known."""
        return coefficients if self.parts.slopes is None else sheared(coefficients, self.parts.slopes)

    @cached_property
    def _positions(self) -> list[Floats]:
        """Expansions of x, y and z, of x and y in two dimensions."""
        return [self._expansion(coordinate(axis)) for axis in range(len(self._axes))]

    @cached_property
    def _centre(self) -> Floats:
        """(n, d, d) X_0: the derivative of x at the centres."""
        columns = [[slope(x, axis)[:, 0, 0, 0] for axis in self._axes] for x in self._positions]
        return np.array(columns).transpose(2, 0, 1)

    @cached_property
    def _near(self) -> list[list[Disc]]:
        """Discs of Y."""
        inverse = np.linalg.inv(np.where(np.linalg.det(self._centre)[:, None, None] == 0, np.nan, self._centre))
        moved = np.einsum("nij,jnabc->inabc", inverse, np.stack(self._positions))
        return [[self._on_discs(slope(own, axis)) for axis in self._axes] for own in moved]

    @cached_property
    def _determinant(self) -> Disc:
        """That of Y."""
        return determinant(self._near)

    @cached_property
    def _level_slopes(self) -> list[Disc]:
        """Derivatives of g along i, j, k."""
        own = self._straightened(taylor(self.levels, self.parts.centres, np.ones_like(self.parts.centres)))
        return [self._on_discs(slope(own, axis)) for axis in self._axes]

    def _gradient(self, leaf: Node) -> list[Disc]:
        """The gradient of a field in a bent element: X^T g = df/dt, with q = X_0^T g: Y^T q = df/dt."""
        own = self._expansion(leaf)
        transposed = [list(row) for row in zip(*self._near, strict=True)]
        found = solution(transposed, [self._on_discs(slope(own, axis)) for axis in self._axes])
        return _turned(np.linalg.inv(self._centre).transpose(0, 2, 1), found)


def _turned(matrices: Floats, vector: Sequence[Disc]) -> list[Disc]:
    """Discs of matrices (n, d, d) times a vector of discs."""
    found = []
    for row in range(matrices.shape[1]):
        terms = [
            discs.times((matrices[:, row, column, None], np.float64(0.0)), own) for column, own in enumerate(vector)
        ]
        found.append(reduce(discs.plus, terms))
    return found
