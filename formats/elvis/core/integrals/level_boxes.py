"""Surfaces g = 0 inside elements as graphs over boxes, with all roots isolated, and rules on them.

After Saye 2015, High-order quadrature methods for implicitly defined surfaces and volumes in hyperrectangles (SIAM
J. Sci. Comput. 37, A993).  On a box with coordinates (i, j, k) in [0, 1]^3 the surface is a graph k(i, j) where dg/dk
keeps its sign.  It ends where g vanishes on the faces k = 0 and k = 1; these ends are graphs j(i) where dg/dj keeps its
sign there, and begin where g vanishes on edges, whose roots are single where coefficients change their sign once.  So
Gauss rules between such breaks, in i, then in j, meet smooth functions.  All signs are proved from Bernstein nets, and
boxes halved where one isn't.  In two dimensions i is left out: an axis of degree 0.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from typing import Any

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.integrals.graphs import Graph, below_graph, on_graph
from elvis.core.integrals.subcells import subcell_map
from elvis.core.mapping import pointwise, tangents
from elvis.core.patch import Patch
from elvis.core.polynomials.boxnets import halves
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities.element_points import ElementPoints

#: how often a box is halved until its signs must be known, and boxes that are looked at together
_DEPTH, _MANY = 16, 1 << 16
#: halvings after which ends of graphs need not be proved, as where it touches a border: differences of rules tell
_LOOSE = 5
#: derivatives along the height of a graph, in parts of others
_STEEP = 0.1
#: what there is for each box
_COLUMNS = ("rows", "cell", "low", "high", "nets", "rounding", "sizes", "order")


@dataclass(frozen=True, eq=False)
class LevelBoxes:
    """Boxes in elements of a patch, in each of which g = 0 is a graph.

    rows        (n,)          of the patch
    cell        (n,)          the part of the reference element, see `subcells`
    low, high   (n, 3)        corners in the part's coordinates in [0, 1]^3
    nets        (n, D, D, D)  Bernstein nets of g on the boxes; the first axis has one coefficient in two dimensions
    rounding    (n, e)        of e expressions
    sizes       (n, e)        of their values
    order       (n, 3)        the axes that are i, j, k
    lost        (e,)          what expressions may amount to on boxes that were given up
    is_filled   whether the rule is one for the part where g < 0, not for the surface
    enough      points on a line in a box that integrate exactly what is integrated, where these are known
    """

    patch: Patch
    rows: Ints
    cell: Ints
    low: Floats
    high: Floats
    nets: Floats
    rounding: Floats
    sizes: Floats
    order: Ints
    lost: Floats
    is_filled: bool = False
    enough: int | None = None

    def __len__(self) -> int:
        return len(self.rows)

    def part(self, chosen: Ints | Bools | slice) -> LevelBoxes:
        """Some of the boxes."""
        columns: dict[str, Any] = {name: getattr(self, name)[chosen] for name in _COLUMNS}
        return replace(self, **columns, lost=np.zeros_like(self.lost))

    @property
    def is_whole(self) -> Bools:
        """(n,) whether all of a box is below the surface."""
        return np.asarray(self.nets.max(axis=(1, 2, 3)) < 0)

    def halves(self) -> LevelBoxes:
        """The boxes halved in every direction, as far as the surface meets them."""
        return self._halved().resolved()

    def _halved(self) -> LevelBoxes:
        parts = self
        for axis in range(3):
            if self.nets.shape[1 + axis] == 1:
                continue
            nets = np.concatenate(halves(parts.nets, axis))
            middle = (parts.low[:, axis] + parts.high[:, axis]) / 2
            parts = parts.part(np.tile(np.arange(len(parts)), 2))
            low, high = parts.low.copy(), parts.high.copy()
            low[len(middle) :, axis], high[: len(middle), axis] = middle, middle
            parts = replace(parts, nets=nets, low=low, high=high)
        return parts

    def resolved(self) -> LevelBoxes:
        """The boxes that g = 0 meets, halved until it is a graph in each; boxes that can't be are given up."""
        found, boxes = [self.part(slice(0))], self
        for depth in range(_DEPTH):
            least, most = boxes.nets.min(axis=(1, 2, 3)), boxes.nets.max(axis=(1, 2, 3))
            if self.is_filled:
                found.append(boxes.part(most < 0))
            boxes = boxes.part((least <= 0) & (most >= 0))
            if not len(boxes):
                break
            order, is_graph = _orders(boxes.nets, are_ends_free=depth >= _LOOSE)
            found.append(replace(boxes, order=order).part(is_graph))
            boxes = boxes.part(~is_graph)
            if len(boxes) > _MANY:
                break
            boxes = boxes._halved()
        return replace(joined(found), lost=self.lost + boxes.given_up().lost)

    def given_up(self) -> LevelBoxes:
        """None of the boxes, with what they may amount to as lost."""
        return replace(self.part(slice(0)), lost=self._extent() @ self.sizes)

    def _extent(self) -> Floats:
        """(n,) how large the surface, or the part, in each box may be, as a rule: a power of its diameter."""
        d = self.patch.shape.dimension
        reference, derivatives = subcell_map(self.patch.shape, self.cell, ((self.low + self.high) / 2)[:, 3 - d :])
        columns = pointwise.jacobians(self.patch, self.rows, reference) @ derivatives
        sides = np.linalg.norm(columns * (self.high - self.low)[:, None, 3 - d :], axis=1)
        return np.asarray(np.linalg.norm(sides, axis=1) ** (d if self.is_filled else d - 1))

    def quadrature(self, counts: tuple[int, ...]) -> tuple[ElementPoints, Floats, Ints]:
        """Points on the surface with its normal there, their shares of its area (n,), and the box of each (n,)."""
        orders = sorted(set(map(tuple, self.order.tolist())))
        if self.is_filled:
            whole, upwards = self.is_whole, counts[-1] if self.enough is None else min(self.enough, counts[-1])
            inner = [self._below_graphs(order, (*counts[:-1], upwards), ~whole) for order in orders]
            inner.append(self._inside(np.flatnonzero(whole), upwards if self.enough is None else self.enough))
            box, places, shares = (np.concatenate(columns) for columns in zip(*inner, strict=True))
            return ElementPoints(self.patch, self.rows[box], places), shares, box
        parts = [self._on_graphs(order, counts) for order in orders]
        box, places, shares, normals = (np.concatenate(columns) for columns in zip(*parts, strict=True))
        return ElementPoints(self.patch, self.rows[box], places, normals), shares, box

    def _inside(self, whole: Ints, count: int) -> tuple[Ints, Floats, Floats]:
        """Box, reference point and share of points of boxes (m,) that are whole below the surface."""
        is_flat = np.array(self.nets.shape[1:]) == 1
        rules = [(np.zeros(1), np.full(1, 2.0)) if flat else gauss(count) for flat in is_flat]
        nodes = np.stack(np.meshgrid(*[own for own, _ in rules], indexing="ij"), axis=-1).reshape(-1, 3)
        weights = np.stack(np.meshgrid(*[own for _, own in rules], indexing="ij")).prod(axis=0).reshape(-1) / 8
        box = np.repeat(whole, len(nodes))
        reference, stretch = self._stretched(box, np.tile((1 + nodes) / 2, (len(whole), 1)))
        return box, reference, np.tile(weights, len(whole)) * stretch

    def _below_graphs(
        self, order: tuple[int, ...], counts: tuple[int, ...], chosen: Bools
    ) -> tuple[Ints, Floats, Floats]:
        """Box, reference point and share of points where g < 0, of chosen graphs whose axes have one order."""
        here = np.flatnonzero((self.order == order).all(axis=1) & chosen)
        number, points, weights = below_graph(self.nets[here].transpose(0, *(1 + axis for axis in order)), counts)
        box, local = here[number], np.empty_like(points)
        local[:, order] = points
        reference, stretch = self._stretched(box, local)
        return box, reference, weights * stretch

    def _stretched(self, box: Ints, local: Floats) -> tuple[Floats, Floats]:
        """Reference points (n, d) at places (n, 3) in boxes (n,), and volumes (n,) for each unit of these."""
        reference, derivatives, size = self._cell_map(box, local)
        if self.patch.is_linear:
            element = tangents.determinants(self._element_jacobians)[box]
        else:
            element = tangents.determinants(pointwise.jacobians(self.patch, self.rows[box], reference))
        return reference, np.abs(element * _determinants(derivatives)) * size.prod(axis=1)

    def _map(self, box: Ints, local: Floats) -> tuple[Floats, Floats]:
        """Reference points (n, d) at places (n, 3) in boxes (n,), and tangents (n, 3, d) along these."""
        reference, derivatives, size = self._cell_map(box, local)
        if self.patch.is_linear:
            element = self._element_jacobians[box]
        else:
            element = pointwise.jacobians(self.patch, self.rows[box], reference)
        return reference, element @ derivatives * size[:, None, :]

    def _cell_map(self, box: Ints, local: Floats) -> tuple[Floats, Floats, Floats]:
        """Reference points (n, d), their derivatives (n, d, d) in the cells' coordinates, sizes (n, d) of the boxes."""
        first = 3 - self.patch.shape.dimension
        sizes = (self.high - self.low)[:, first:]
        coordinates = self.low[:, first:][box] + sizes[box] * local[:, first:]
        return *subcell_map(self.patch.shape, self.cell[box], coordinates), sizes[box]

    @property
    def _element_jacobians(self) -> Floats:
        """(boxes, 3, d) of maps that are linear."""
        rows, number = np.unique(self.rows, return_inverse=True)
        middles = np.zeros((len(rows), self.patch.shape.dimension))
        return pointwise.jacobians(self.patch, rows, middles)[number]

    def _on_graphs(self, order: tuple[int, ...], counts: tuple[int, ...]) -> tuple[Ints, Floats, Floats, Floats]:
        """Box, reference point, share and normal of points on graphs whose axes have one order."""
        here = np.flatnonzero((self.order == order).all(axis=1))
        graph = on_graph(self.nets[here].transpose(0, *(1 + axis for axis in order)), counts)
        box, d = here[graph.box], self.patch.shape.dimension
        local, slopes = np.empty_like(graph.points), np.empty_like(graph.slopes)
        local[:, order], slopes[:, order] = graph.points, graph.slopes
        reference, columns = self._map(box, local)
        along = _tangents(columns, slopes[:, 3 - d :], order[-1] - (3 - d))
        stretch, normals = _areas(along, columns[:, :, order[-1] - (3 - d)], graph)
        return box, reference, graph.weights * stretch, normals


def joined(several: Sequence[LevelBoxes]) -> LevelBoxes:
    """Boxes of one patch together."""
    columns: dict[str, Any] = {name: np.concatenate([getattr(own, name) for own in several]) for name in _COLUMNS}
    return replace(several[0], **columns, lost=np.sum([own.lost for own in several], axis=0))


def _determinants(matrices: Floats) -> Floats:
    """(n,) of square matrices (n, d, d), d = 2 or 3."""
    if matrices.shape[1] == 3:
        return tangents.determinants(matrices)
    (a, b), (c, d) = matrices.transpose(1, 2, 0)
    return np.asarray(a * d - b * c)


def _tangents(columns: Floats, slopes: Floats, height: int) -> Floats:
    """(n, 3, d - 1) derivatives of points on a graph in the other coordinates: dx/da - dx/dk (dg/da)/(dg/dk)."""
    ratio = slopes / slopes[:, height, None]
    moved = columns - columns[:, :, height, None] * ratio[:, None, :]
    return np.delete(moved, height, axis=2)


def _areas(tangents: Floats, upwards: Floats, graph: Graph) -> tuple[Floats, Floats]:
    """Area or length (n,) for each unit of the graph's coordinates, and the unit normal (n, 3) towards greater g."""
    if tangents.shape[2] == 2:
        normal = np.cross(tangents[:, :, 0], tangents[:, :, 1])
        stretch = np.linalg.norm(normal, axis=1)
    else:
        along = tangents[:, :, 0]
        stretch = np.linalg.norm(along, axis=1)
        part = np.einsum("nc,nc->n", along, upwards) / stretch**2
        normal = upwards - along * part[:, None]
    sign = np.sign(np.einsum("nc,nc->n", normal, upwards)) * np.sign(graph.slopes[:, 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        return stretch, normal * (sign / np.linalg.norm(normal, axis=1))[:, None]


def _orders(nets: Floats, are_ends_free: bool) -> tuple[Ints, Bools]:
    """For each net (n, D, D, D) the axes i, j, k in which g = 0 is a graph with such ends, and whether there are."""
    best, order = np.zeros(len(nets)), np.tile(np.arange(3), (len(nets), 1))
    for axes in _candidates(nets):
        turned = nets.transpose(0, *(1 + axis for axis in axes))
        score = _steepness(turned)
        score = score if are_ends_free else np.where(_are_ends_graphs(turned), score, 0.0)
        better = score > best
        best[better], order[better] = score[better], axes
    return order, best > _STEEP


def _candidates(nets: Floats) -> Iterator[tuple[int, ...]]:
    """Orders of the axes: without a first direction that stays the first."""
    return (axes for axes in permutations(range(3)) if nets.shape[1] > 1 or axes[0] == 0)


def _steepness(nets: Floats) -> Floats:
    """(n,) lower bounds of the derivative along the last axis, in parts of the greatest of all; at most 0 for none.

    Where it is small the surface is steep, and rules converge slowly.
    """
    axes = tuple(range(1, nets.ndim))
    slopes = [np.diff(nets, axis=axis) * (nets.shape[axis] - 1) for axis in axes if nets.shape[axis] > 1]
    last = slopes[-1]
    least = np.maximum(last.min(axis=axes), -last.max(axis=axes))
    most = np.max([np.abs(slope).max(axis=axes) for slope in slopes], axis=0)
    return np.asarray(least / np.where(most > 0, most, 1.0))


def _are_ends_graphs(nets: Floats) -> Bools:
    """(n,) whether on both faces across the last axis g has no zeros, or they are a graph with single ends."""
    found = np.ones(len(nets), bool)
    for face in (nets[:, :, :, 0], nets[:, :, :, -1]):
        flat = face.reshape(len(face), -1)
        is_free = (flat.min(axis=1) > 0) | (flat.max(axis=1) < 0)
        has_single_ends = (_changes(face[:, :, 0]) <= 1) & (_changes(face[:, :, -1]) <= 1)
        found &= is_free | ((_steepness(face) > _STEEP) & has_single_ends)
    return found


def _changes(coefficients: Floats) -> Ints:
    """(n,) how often the sign changes along coefficients (n, D): by Descartes' rule the roots, where that is 0 or 1."""
    is_positive = coefficients >= 0
    return np.asarray((is_positive[:, 1:] != is_positive[:, :-1]).sum(axis=1))
