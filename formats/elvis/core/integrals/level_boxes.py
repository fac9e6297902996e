"""Surfaces g = 0 inside elements as graphs over boxes, with all roots isolated, and rules on them.

After Saye 2015, High-order quadrature methods for implicitly defined surfaces and volumes in hyperrectangles (SIAM
J. Sci. Comput. 37, A993).  On a box with coordinates (i, j, k) in [0, 1]^3 the surface is a graph k(i, j) where dg/dk
keeps its sign.  It ends where g vanishes on the faces k = 0 and k = 1; these ends are graphs j(i) where dg/dj keeps its
sign there, and begin where g vanishes on edges, whose roots are single where coefficients change their sign once.  So
Gauss rules between such breaks, in i, then in j, meet smooth functions.  All signs are proved from Bernstein nets, and
boxes halved where one isn't.  In two dimensions i is left out: an axis of degree 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from elvis.core.arrays import Bools, Floats, Ints
from elvis.core.integrals.graph_orders import greatest, orders, shares_of_ends, shifts
from elvis.core.integrals.graphs import Graph, below_graph, on_graph
from elvis.core.integrals.subcells import subcell_map
from elvis.core.mapping import pointwise, tangents
from elvis.core.patch import Patch
from elvis.core.polynomials.boxnets import halves
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities.element_points import ElementPoints

#: how often a box is halved until its signs must be known, and how many boxes are halved: at least, and for each box
#: at first
_DEPTH, _MANY, _MANY_OF_ONE = 24, 1 << 13, 8
#: halvings of a graph after which its ends need not be proved, as where it touches a border: differences of rules tell
_LOOSE = 5
#: what moving a surface by a part of the cell's size does to integrals over it, in parts of these: as a rule of maps
#: and integrands, whose second derivatives aren't known
_MOVED = 10.0
#: changes of g in a direction in which boxes needn't be halved, in parts of the greatest
_FLAT = 0.05
#: what there is for each box
_COLUMNS = ("rows", "cell", "low", "high", "nets", "band", "age", "rounding", "sizes", "order")


@dataclass(frozen=True, eq=False)
class LevelBoxes:
    """Boxes in elements of a patch, in each of which g = 0 is a graph.

    rows        (n,)          of the patch
    cell        (n,)          the part of the reference element, see `subcells`
    low, high   (n, 3)        corners in the part's coordinates in [0, 1]^3
    nets        (n, D, D, D)  Bernstein nets of g on the boxes; the first axis has one coefficient in two dimensions
    band        (n,)          magnitudes of g below which a point may be on either side of the surface
    age         (n,)          halvings for which g = 0 has been a graph with ends that aren't proved
    rounding    (n, e)        of e expressions
    sizes       (n, e)        of their values
    order       (n, 3)        the axes that are i, j, k
    lost        (e,)          what expressions may amount to on boxes that were given up
    is_filled   whether the rule is one for the part where g < 0, not for the surface
    enough      points on a line in a box that integrate exactly what is integrated, where these are known
    moved       (e,)          by how much moving g may have changed integrals beyond ``rounding``
    """

    patch: Patch
    rows: Ints
    cell: Ints
    low: Floats
    high: Floats
    nets: Floats
    band: Floats
    age: Ints
    rounding: Floats
    sizes: Floats
    order: Ints
    lost: Floats
    is_filled: bool = False
    enough: int | None = None
    moved: Floats | float = 0.0

    def __len__(self) -> int:
        return len(self.rows)

    def part(self, chosen: Ints | Bools | slice) -> LevelBoxes:
        """Some of the boxes."""
        columns: dict[str, Any] = {name: getattr(self, name)[chosen] for name in _COLUMNS}
        return replace(self, **columns, lost=np.zeros_like(self.lost), moved=0.0)

    @property
    def is_whole(self) -> Bools:
        """(n,) whether all of a box is below the surface."""
        return np.asarray(self.nets.max(axis=(1, 2, 3)) < 0)

    def halves(self) -> LevelBoxes:
        """The boxes halved in every direction, as far as the surface meets them."""
        return self._halved().resolved()

    def _halved(self, is_flat: Bools | None = None) -> LevelBoxes:
        """The boxes halved in every direction, but for those (n, 3) in which g hardly changes."""
        parts = self
        flat = np.zeros((len(self), 3), bool) if is_flat is None else is_flat
        for axis in range(3):
            if self.nets.shape[1 + axis] == 1:
                continue
            whole, cut = np.flatnonzero(flat[:, axis]), np.flatnonzero(~flat[:, axis])
            chosen = np.concatenate([whole, cut, cut])
            flat = flat[chosen]
            lower, upper = halves(parts.nets[cut], axis)
            nets = np.concatenate([parts.nets[whole], lower, upper])
            middle = (parts.low[cut, axis] + parts.high[cut, axis]) / 2
            parts = parts.part(chosen)
            low, high = parts.low.copy(), parts.high.copy()
            first, last = len(whole), len(whole) + len(cut)
            high[first:last, axis] = middle
            low[last:, axis] = middle
            parts = replace(parts, nets=nets, low=low, high=high)
        return parts

    @property
    def _is_flat(self) -> Bools:
        """(n, 3) directions in which g changes little in comparison with the others, so that halving tells nothing."""
        changes = np.stack([greatest(np.diff(self.nets, axis=axis)) for axis in (1, 2, 3)], axis=1)
        return np.asarray(changes < _FLAT * changes.max(axis=1, keepdims=True))

    def resolved(self) -> LevelBoxes:
        """The boxes that g = 0 meets, halved until it is a graph in each; boxes that can't be are given up."""
        found, boxes, lost, moved = [self.part(slice(0))], self, self.lost, self.moved
        limit = max(_MANY, _MANY_OF_ONE * len(self))
        for depth in range(_DEPTH):
            least, most = boxes.nets.min(axis=(1, 2, 3)), boxes.nets.max(axis=(1, 2, 3))
            if self.is_filled:
                found.append(boxes.part(most < -boxes.band))
            boxes = boxes.part((least <= boxes.band) & (most >= -boxes.band))
            if not len(boxes):
                break
            graphs, boxes = boxes._graphs()
            moved = moved + graphs.moved
            found.append(graphs)
            if len(boxes) > limit or depth == _DEPTH - 1:
                break
            boxes = boxes._halved(boxes._is_flat)
        return replace(joined(found), lost=lost + boxes.given_up().lost, moved=moved)

    def _graphs(self) -> tuple[LevelBoxes, LevelBoxes]:
        """Boxes in which g = 0 is a graph, with what may be lost; the others.

        Boxes that moved g doesn't meet need no ends.
        """
        least, most = self.nets.min(axis=(1, 2, 3)), self.nets.max(axis=(1, 2, 3))
        is_met = (least <= 0) & (most >= 0)
        free, is_free = orders(self.nets, are_ends_free=True)
        order, is_proved = free.copy(), is_free & ~is_met
        open_ended = np.flatnonzero(is_free & is_met)
        with_ends, have_ends = orders(self.nets[open_ended], are_ends_free=False)
        order[open_ended[have_ends]] = with_ends[have_ends]
        is_proved[open_ended[have_ends]] = True
        is_graph = is_proved | (is_free & (self.age >= _LOOSE))
        graphs = replace(self, order=order).part(is_graph)
        others = self.part(~is_graph)
        return graphs._moved(), replace(others, age=others.age + is_free[~is_graph])

    def _moved(self) -> LevelBoxes:
        """Graphs with the error of moving g by less than the band; unproved ends are left to differences of rules.

        The volume between is at most band / |dg/dk| of a box.  A point of the surface moves so far along k; the area
        changes with the slopes (dg/di)/(dg/dk), whose derivatives along k are bounded by second differences.
        """
        shift = np.zeros(len(self))
        change = np.zeros(len(self))
        share = np.zeros(len(self))
        for order in sorted(set(map(tuple, self.order.tolist()))):
            here = np.flatnonzero((self.order == order).all(axis=1))
            turned = self.nets[here].transpose(0, *(1 + axis for axis in order))
            shift[here], change[here] = shifts(turned, self.band[here])
            share[here] = shares_of_ends(turned, self.band[here])
        if self.is_filled:
            return replace(self, moved=(self._extent() * np.minimum(shift, 1.0)) @ self.sizes)
        height = np.take_along_axis(self.high - self.low, self.order[:, 2:], axis=1)[:, 0]
        rounding = self.rounding + self.sizes * (_MOVED * shift * height + change)[:, None]
        return replace(self, rounding=rounding, moved=(self._extent() * np.minimum(share, 1.0)) @ self.sizes)

    def given_up(self) -> LevelBoxes:
        """None of the boxes, with what they may amount to as lost."""
        return replace(self.part(slice(0)), lost=self._extent() @ self.sizes)

    def _extent(self) -> Floats:
        """(n,) how large the surface, or the part, in each box may be.

        A line along direction k meets g = 0 at most as often as its degree D_k, unless it lies in it.  So the integral
        of |n_k| over the surface is at most D_k in the unit cube, and its image no larger than the sum of these times
        the greatest areas of faces.  Tangents that are linear in each coordinate are longest at corners.
        """
        d = self.patch.shape.dimension
        longest = np.zeros((len(self), d))
        for bits in np.ndindex(*(2,) * d):
            local = np.full((len(self), 3), 0.5)
            local[:, 3 - d :] = bits
            columns = self._map(np.arange(len(self)), local)[1]
            longest = np.maximum(longest, np.linalg.norm(columns, axis=1))
        if self.is_filled:
            return np.asarray(longest.prod(axis=1))
        degrees = np.array(self.nets.shape[4 - d :]) - 1
        others = [np.delete(longest, axis, axis=1).prod(axis=1) for axis in range(d)]
        return np.asarray(sum(degree * other for degree, other in zip(degrees, others, strict=True)))

    def quadrature(self, counts: tuple[int, ...]) -> tuple[ElementPoints, Floats, Ints]:
        """Points on the surface with its normal there, their shares of its area (n,), and the box of each (n,)."""
        kinds = sorted(set(map(tuple, self.order.tolist())))
        if self.is_filled:
            whole, upwards = self.is_whole, counts[-1] if self.enough is None else min(self.enough, counts[-1])
            inner = [self._below_graphs(order, (*counts[:-1], upwards), ~whole) for order in kinds]
            inner.append(self._inside(np.flatnonzero(whole), upwards if self.enough is None else self.enough))
            box, places, shares = (np.concatenate(columns) for columns in zip(*inner, strict=True))
            return ElementPoints(self.patch, self.rows[box], places), shares, box
        parts = [self._on_graphs(order, counts) for order in kinds]
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
    lost = np.sum([own.lost for own in several], axis=0)
    return replace(several[0], **columns, lost=lost, moved=sum((own.moved for own in several), np.zeros_like(lost)))


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
