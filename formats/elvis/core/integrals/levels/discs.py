"""Discs of expressions and measures on neighbourhoods of parts of boxes that a graph cuts.

On a cell of an element, fields and map are polynomials of the cell's coordinates, so Taylor expansions about the
centres of parts bound them and their derivatives.  Let t be the coordinates of a box, or on surfaces a, b and t of
`graph_discs`, and X = dx/dt = X_0 Y, where X_0 is the derivative at the centre.  Then Y is close to the identity, which
keeps discs of determinants and solutions narrow.

The area of a surface per unit of i and j is |N| with N = cof(X) (g_a/g_t, g_b/g_t, 1), and N/|N| is its normal.  The
integral of an expression linear in the normal is therefore the integral of the same expression of N. With a normal
instead of dx/dt in X_0, N is n = cof(Y) (g_a/g_t, g_b/g_t, 1) in the basis det(X_0) X_0^-T, whose last vector is
orthogonal to the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, reduce
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.integrals.box_discs import without_roots
from elvis.core.integrals.cut_expansions import Expansion
from elvis.core.integrals.degrees import DegreeRules
from elvis.core.integrals.disc_algebra import cofactors, determinant, solution
from elvis.core.integrals.graph_discs import PartDiscs
from elvis.core.integrals.graph_orders import greatest, turned
from elvis.core.integrals.subcells import subcell_map
from elvis.core.integrals.taylor import taylor
from elvis.core.integrals.tree_discs import Ball, TreeDiscs, interval_of
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import bernstein_space
from elvis.core.polynomials.boxnets import box_degrees, nets_through
from elvis.core.quantities import discs
from elvis.core.quantities.attributes import Attributes, is_constant
from elvis.core.quantities.discs import Disc
from elvis.core.quantities.elements.points import Lattice
from elvis.core.quantities.elements.sides import SIDES
from elvis.core.quantities.expression_nets import lattice_of, places_of
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import Node, coordinate, field, fold, whole_exponent
from elvis.core.shapes import Shape

_NORMALS = SIDES[:3]
#: lower bound of 1 plus a sum of squares, with room for rounding
_LEAST_SQUARE = 1 - 1e-9


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


def order_in_normals(root: Node) -> int | None:
    """The order of an expression in the components of the normal if it is homogeneous in them."""

    def leaf(node: Node) -> int | None:
        return int(node.op == "attribute" and node.name in _NORMALS)

    def inner(node: Node, orders: list[int | None]) -> int | None:
        known = [order for order in orders if order is not None]
        if len(known) < len(orders):
            return None
        exponent = whole_exponent(node)
        if node.op == "*":
            return sum(known)
        if node.op == "/":
            return known[0] - known[1]
        if exponent is not None:
            return int(exponent) * known[0]
        is_negative = node.op == "-" and node.operands[0].op == "number" and node.operands[0].value == 0
        if node.op in ("+", "-") and (is_negative or known[0] == known[1]):
            return known[1]
        return None if any(known) else 0

    return fold(root, leaf, inner)


class CellNets:
    """Bernstein nets of leaves on cells of elements, each made once.

    rows, cells  (n,) of boxes in them
    """

    def __init__(self, patch: Patch, rows: Ints, cells: Ints, rules: DegreeRules) -> None:
        self._patch, self._names, self._is_affine = patch, rules.names, rules.is_affine
        self._codes = np.unique(self._code(rows, cells))
        self._known: dict[Node, Floats] = {}
        self._lattices: dict[tuple[int, int], Lattice] = {}

    def __len__(self) -> int:
        return len(self._codes)

    def _code(self, rows: Ints, cells: Ints) -> Ints:
        return np.asarray(cells * len(self._patch) + rows)

    def index(self, rows: Ints, cells: Ints) -> Ints:
        """(n,) numbers of the cells that boxes are in."""
        return np.searchsorted(self._codes, self._code(rows, cells))

    def nets(self, node: Node) -> Floats:
        """(cells, D, D, D) of a leaf that is a polynomial; the first axis has one coefficient in two dimensions."""
        if node not in self._known:
            self._known[node] = self._nets(node)
        return self._known[node]

    def interval(self, root: Node) -> Interval:
        """Smallest and largest value (cells,) of an expression; infinite if nothing is known."""

        def leaf(node: Node) -> Interval:
            if node.op == "number":
                return np.float64(node.value), np.float64(node.value)
            if node.op == "attribute" and node.name in _NORMALS:
                return np.float64(-1.0), np.float64(1.0)
            if node.op == "attribute" or (node.op == "field" and node.axes and not self._is_affine):
                return np.float64(-np.inf), np.float64(np.inf)
            nets = self.nets(node).reshape(len(self), -1)
            return nets.min(axis=1), nets.max(axis=1)

        return interval_of(root, leaf, len(self))

    @cached_property
    def longest(self) -> Floats:
        """(cells, 3) bounds of the lengths of dx/dc along their coordinates c; 0 for one that isn't there."""
        squares = np.zeros((len(self), 3))
        for axis in range(self._patch.shape.dimension):
            nets = self.nets(coordinate(axis))
            for along in range(3):
                changes = np.diff(nets, axis=1 + along) * (nets.shape[1 + along] - 1)
                squares[:, along] += greatest(changes) ** 2
        return np.sqrt(squares)

    def _nets(self, node: Node) -> Floats:
        number = None if node.op == "coordinate" else self._names.index(node.name)
        expansion = self._patch.geometry if number is None else self._patch.fields[number]
        assert expansion is not None
        d, degree = self._patch.shape.dimension, max(box_degrees(bernstein_space(expansion)))
        parts = []
        for cell in np.unique(self._codes // len(self._patch)).tolist():
            places = self._lattice(cell, degree)
            if number is None:
                values = places.positions[:, node.axes[0]]
            else:
                derivative = places.derivative(number, len(node.axes))
                values = derivative.T[node.axes[::-1]] if node.axes else derivative
            parts.append(nets_through(values, places_of(degree), d))
        found = np.concatenate(parts)
        return found.reshape(len(found), *(1,) * (3 - d), *found.shape[1:])

    def _lattice(self, cell: int, degree: int) -> Lattice:
        """Points whose values determine polynomials of a degree, in each element with boxes in a cell of its shape."""
        if (cell, degree) not in self._lattices:
            own, rows = np.divmod(self._codes, len(self._patch))
            lattice = lattice_of(places_of(degree), self._patch.shape.dimension)
            reference = subcell_map(self._patch.shape, np.full(len(lattice), cell), lattice)[0]
            self._lattices[cell, degree] = Lattice(self._patch, rows[own == cell], reference)
        return self._lattices[cell, degree]


@dataclass(frozen=True, eq=False)
class LevelDiscs:
    """Discs (n, columns) of expressions on parts of boxes.

    cell, rows  (n,)    numbers of the cells that parts are in, and rows of the patch
    low, size   (n, 3)  of the boxes along i, j, k
    order       (n, 3)  the axes that are i, j, k
    parts       discs of i, j, k
    gradient    of g but for a factor, on surfaces; empty if it isn't known
    """

    cells: CellNets
    rules: DegreeRules
    attributes: Attributes
    cell: Ints
    rows: Ints
    low: Floats
    size: Floats
    order: Ints
    parts: PartDiscs
    gradient: tuple[Node, ...] = ()

    def density(self, root: Node) -> Disc:
        """Middles (n, 1) and radii (n, columns) of an expression times the measure for each unit of i, j and k."""
        if self.parts.tilts is None:
            return discs.times(self._disc(root, ()), self.volume)
        order = order_in_normals(root)
        if order == 1:
            return self._disc(root, self._normal)
        normals = () if order == 0 else [discs.over(own, self.area) for own in self._normal]
        return discs.times(self._disc(root, normals), self.area)

    def _disc(self, root: Node, normals: Sequence[Disc]) -> Disc:
        """The disc of an expression with such components of the normal."""
        shape = len(self.rows), self.parts.radii[0].shape[1]

        def leaf(node: Node) -> Ball:
            return Ball.around(self._leaf(node, normals))

        found = TreeDiscs(shape[0], np.ones((2, shape[1])), leaf, lambda _: None).of(without_roots(root))
        return np.broadcast_to(found.middle, (shape[0], 1)), np.broadcast_to(found.radius, shape)

    def interval(self, root: Node) -> Interval:
        """Smallest and largest value (n,) of an expression at real points; infinite if nothing is known."""
        one = np.float64(0.0), np.float64(1.0)

        def leaf(node: Node) -> Interval:
            middle, radius = self._leaf(node, [one] * 3)
            if np.ndim(middle) == 0:
                return middle - radius, middle + radius
            return middle[:, 0] - radius[:, 0], middle[:, 0] + radius[:, 0]

        return interval_of(root, leaf, len(self.rows))

    @cached_property
    def volume(self) -> Disc:
        """The volume for each unit of i, j and k, area in two dimensions."""
        near = determinant(self._near_centre)
        found = near if self.rules.is_valid else discs.absolute(near)
        return discs.times((np.abs(np.linalg.det(self._centre))[:, None], np.float64(0.0)), found)

    @cached_property
    def area(self) -> Disc:
        """The area of the surface for each unit of i and j, length in two dimensions.

        With v the basis and r_i = n_i / n_d it is n_d |v_d| sqrt(1 + sum r_i r_j (v_i . v_j) / |v_d|^2) over i, j < d.
        """
        gram = self._basis.transpose(0, 2, 1) @ self._basis
        ratios, upwards = self._ratios, self._across(-1)
        found = discs.number(1.0)
        for row, one in enumerate(ratios):
            for column, other in enumerate(ratios):
                weight = (gram[:, row, column] / gram[:, -1, -1])[:, None], np.float64(0.0)
                found = discs.plus(found, discs.times(weight, discs.times(one, other)))
        size = np.sqrt(gram[:, -1, -1])[:, None], np.float64(0.0)
        return discs.times(discs.times(size, upwards), _root_of_squares(found, self.parts.radii[0].shape))

    @cached_property
    def _ratios(self) -> list[Disc]:
        """The ratios r_i of the derivatives of g along the frame, or of n if the gradient is unknown."""
        if not self.gradient:
            own = [self._across(axis) for axis in range(len(self._axes))]
        else:
            slopes = [self._disc(part, ()) for part in self.gradient[: len(self._axes)]]
            own = _product(self._frame.transpose(0, 2, 1), slopes)
        return [discs.over(each, own[-1]) for each in own[:-1]]

    @cached_property
    def _normal(self) -> list[Disc]:
        """N, towards greater g."""
        sign = np.where(self.parts.is_rising, 1.0, -1.0)
        upwards = self._across(-1)
        along = [*(discs.times(own, upwards) for own in self._ratios), upwards]
        return _product(sign[:, None, None] * self._basis, along)

    def _across(self, axis: int) -> Disc:
        """A component of n."""
        assert self.parts.tilts is not None
        tilts = [*self.parts.tilts, discs.number(1.0)][-len(self._axes) :]
        return reduce(discs.plus, map(discs.times, cofactors(self._near_frame, axis), tilts))

    @cached_property
    def _basis(self) -> Floats:
        """(n, d, d) |det(X_0)| X_0^-T."""
        size = np.abs(np.linalg.det(self._frame))[:, None, None]
        return np.asarray(size * np.linalg.inv(self._frame).transpose(0, 2, 1))

    @cached_property
    def _frame(self) -> Floats:
        """(n, d, d) X_0 with a normal of the surface as its last column."""
        found = self._centre.copy()
        along = found[:, :, :-1]
        if along.shape[2] == 1:
            normal = np.stack([-along[:, 1, 0], along[:, 0, 0]], axis=1)
        else:
            normal = np.cross(along[:, :, 0], along[:, :, 1])
        size = np.linalg.norm(along, axis=1).max(axis=1) / np.linalg.norm(normal, axis=1)
        turn = np.sign(np.einsum("nc,nc->n", normal, found[:, :, -1]))
        found[:, :, -1] = normal * (turn * size)[:, None]
        return found

    @cached_property
    def longest(self) -> Floats:
        """(n, d) bounds of the lengths of dx/di, dx/dj and dx/dk at real points."""
        found = []
        for axis in self._axes:
            own = [x.slope(axis, self.parts.radii) for x in self._positions]
            found.append(np.sqrt(sum((np.abs(part[0]) + part[1])[:, 0] ** 2 for part in own)))
        return np.stack(found, axis=1).reshape(len(self.rows), len(self._axes))

    def _leaf(self, node: Node, normals: Sequence[Disc]) -> Disc:
        """The disc of a leaf."""
        if node.op == "number":
            return discs.number(node.value)
        if node.op == "attribute" and node.name in _NORMALS:
            axis = _NORMALS.index(node.name)
            return normals[axis] if axis < len(self._axes) else discs.number(0.0)
        if node not in self._known:
            self._known[node] = self._other(node)
        return self._known[node]

    def _other(self, node: Node) -> Disc:
        d = len(self._axes)
        if node.op == "attribute":
            return self._constant(node.name)
        if node.op == "field" and max(node.axes, default=0) >= d:
            return discs.number(0.0)
        if node.op == "field" and node.axes and not self.rules.is_affine:
            return self._gradient(field(node.name))[node.axes[0]]
        return self._expansion(node).disc(self.parts.radii)

    def _constant(self, name: str) -> Disc:
        """The disc of an attribute that is one number throughout an element."""
        patch = self.rules.piece.patch
        middle = np.tile(patch.shape.centre, (len(self.rows), 1))
        return self.attributes.at(name, patch, self.rows, middle)[:, None], np.float64(0.0)

    @cached_property
    def _known(self) -> dict[Node, Disc]:
        """Leaves computed so far."""
        return {}

    @property
    def _axes(self) -> range:
        """The axes i, j, k that exist in this dimension."""
        return range(3 - self.rules.piece.patch.shape.dimension, 3)

    def _expansion(self, node: Node) -> Expansion:
        """Taylor expansion of a leaf about the centres of parts, in the coordinates whose discs are known."""
        nets = turned(self.cells.nets(node)[self.cell], self.order)
        found = taylor(nets, self.low + self.size * self.parts.centres, self.size)
        if self.parts.bends is None:
            return Expansion(found)
        return Expansion.curved(found, self.parts.bends, self.parts.radii[:2])

    @cached_property
    def _positions(self) -> list[Expansion]:
        """Expansions of x, y and z, of x and y in two dimensions."""
        return [self._expansion(coordinate(axis)) for axis in range(len(self._axes))]

    @cached_property
    def _centre(self) -> Floats:
        """(n, d, d) X_0: the derivative of x at the centres."""
        columns = [[x.slope_at_centre(axis) for axis in self._axes] for x in self._positions]
        return np.array(columns).transpose(2, 0, 1)

    def _near(self, frame: Floats) -> _Rows:
        """Discs of Y for a matrix X_0 (n, d, d), computed row by row on demand."""
        inverse = np.linalg.inv(np.where(np.linalg.det(frame)[:, None, None] == 0, np.nan, frame))

        def row(number: int) -> list[Disc]:
            own = Expansion.combined(inverse[:, number], self._positions)
            return [own.slope(axis, self.parts.radii) for axis in self._axes]

        return _Rows(row, len(self._axes))

    @cached_property
    def _near_frame(self) -> _Rows:
        """Discs of Y for derivatives and a normal."""
        return self._near(self._frame)

    @cached_property
    def _near_centre(self) -> _Rows:
        """Discs of Y for the derivatives at the centres."""
        return self._near(self._centre)

    def _gradient(self, leaf: Node) -> list[Disc]:
        """The gradient of a field in a curved element: X^T g = df/dt, with q = X_0^T g: Y^T q = df/dt."""
        own = self._expansion(leaf)
        found = solution(_transposed(self._near_centre), [own.slope(axis, self.parts.radii) for axis in self._axes])
        return _product(np.linalg.inv(self._centre).transpose(0, 2, 1), found)


def _root_of_squares(found: Disc, shape: tuple[int, ...]) -> Disc:
    """The root of 1 plus a sum of squares, with radii of a shape (n, columns).

    The first column is for real points, where the sum is never below 1, however far its disc reaches.
    """
    middle, radius = discs.root(found)
    own = np.broadcast_to(radius, shape).copy()
    real = discs.root_above((found[0], np.broadcast_to(found[1], shape)[:, :1]), _LEAST_SQUARE)
    own[:, :1] = np.fmin(own[:, :1], real[1])
    return middle, own


class _Rows(Sequence[list[Disc]]):
    """Rows of a matrix that are computed on demand."""

    def __init__(self, make: Callable[[int], list[Disc]], count: int) -> None:
        self._make, self._count = cache(make), count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, row: Any) -> Any:
        if row >= self._count:
            raise IndexError(row)
        return self._make(row)


def _transposed(matrix: Sequence[Sequence[Disc]]) -> list[list[Disc]]:
    return [list(row) for row in zip(*matrix, strict=True)]


def _product(matrices: Floats, vector: Sequence[Disc]) -> list[Disc]:
    """Discs of matrices (n, d, d) times a vector of discs."""
    found = []
    for row in range(matrices.shape[1]):
        terms = [
            discs.times((matrices[:, row, column, None], np.float64(0.0)), own) for column, own in enumerate(vector)
        ]
        found.append(reduce(discs.plus, terms))
    return found
