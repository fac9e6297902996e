"""Surfaces g = 0 inside elements as graphs over boxes, with all roots isolated, and rules on them.

After Saye 2015, High-order quadrature methods for implicitly defined surfaces and volumes in hyperrectangles (SIAM J.
Sci.  Comput. 37, A993).  On a box with coordinates (i, j, k) in [0, 1]^3, the surface is a graph k(i, j) if dg/dk keeps
its sign.  It ends at zeros of g on the faces k = 0 and k = 1; these ends are graphs j(i) if dg/dj keeps its sign there,
and begin at zeros of g on edges, which are single if coefficients change their sign once.  Gauss rules between such
breaks, in i, then in j, thus have smooth integrands.  All signs are proved from Bernstein nets; boxes with an unproved
sign are bisected.  The axis i has degree 0 in two dimensions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, grid_points, joined_columns
from elvis.core.base.rows import Rows
from elvis.core.integrals.graph_orders import are_upright, greatest, orders, shares_of_ends, shifts, turned
from elvis.core.integrals.graphs import Graph, below_graph, on_graph
from elvis.core.integrals.subcells import subcell_map
from elvis.core.mapping import pointwise, tangents
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.boxnets import halves
from elvis.core.polynomials.quadrature import gauss
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.tree import Node

#: bisections of a box until its signs must be known, and how many boxes are bisected: at least, and for each box
#: at first
_DEPTH, _MANY, _MANY_OF_ONE = 24, 1 << 13, 8
#: tests of boxes and their halves at first, and of halves that are made because the error is large
FIRST, _FURTHER = 3, 2
#: halvings of a graph after which its ends need not be proved, as where it touches a border
_LOOSE = 5
#: estimated relative change of integrals over a surface when it is moved by the cell's size, if nothing is known about
#: integrands
_MOVED = 10.0
#: relative change of g in a direction below which boxes are not bisected
_FLAT = 0.05
#: values of lost boxes, in units of the band, below which bisection gives no information
_DOUBTFUL = 4.0
#: parts of the side of a cell below which boxes are not bisected
_LEAST_SIDE = 2.0**-43


@dataclass(frozen=True, eq=False)
class LevelBoxes(Rows):
    """Boxes in elements of a patch; in each, g = 0 is a graph.

    rows        (n,)          of the patch
    cell        (n,)          the part of the reference element, see `subcells`
    low, high   (n, 3)        corners in the part's coordinates in [0, 1]^3
    nets        (n, D, D, D) Bernstein nets of g on the boxes; in two dimensions, the first axis has one coefficient
    band        (n,)          magnitudes of g below which a point may be on either side of the surface
    age         (n,) number of bisections for which g = 0 has been a graph with unproved ends
    rounding    (n, e)        of e expressions
    sizes       (n, e)        of their values
    order       (n, 3)        the axes that are i, j, k
    is_proved   (n,)          whether g = 0 is a graph whose ends are graphs
    is_lost     (n,) whether boxes are given up: rules have no points there
    several     (n,) number of polynomials that may be zero in lost boxes
    further     (n,) additional area of surfaces that may be lost
    shift       (n,) maximum movement of the surface along k by rounding, relative to the box
    change      (n,) relative change of its area by this movement
    share       (n,) share of i and j in which the movement affects ends of the surface
    is_filled   whether the rule is for the part with g < 0, not for the surface
    zero        the polynomial g up to its sign; None if it may be another one
    enough      number of points on a line along k for an exact rule, if known
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
    is_proved: Bools
    is_lost: Bools
    several: Ints
    further: Floats
    shift: Floats
    change: Floats
    share: Floats
    is_filled: bool = False
    zero: Node | None = None
    enough: int | None = None

    @staticmethod
    def of(
        patch: Patch,
        element: tuple[Ints, Ints],
        corners: tuple[Floats, Floats],
        nets: Floats,
        band: Floats,
        sizes: tuple[Floats, Floats],
        is_filled: bool,
        zero: Node | None = None,
    ) -> LevelBoxes:
        """Boxes before any analysis: rows and cells, low and high corners, rounding and sizes."""
        count = len(nets)
        order, zeros, ones = np.tile(np.arange(3), (count, 1)), np.zeros(count), np.ones(count, np.int64)
        first = patch, *element, *corners, nets, band, 0 * ones, *sizes, order
        return LevelBoxes(*first, ones > 0, ones < 0, ones, zeros, zeros, zeros, zeros, is_filled, zero)

    @property
    def dimension(self) -> int:
        """Dimension of the domain of the rules."""
        return self.patch.shape.dimension - (not self.is_filled)

    @property
    def is_whole(self) -> Bools:
        """(n,) whether all of a box is below the surface."""
        return np.asarray(self.nets.max(axis=(1, 2, 3)) < 0)

    @property
    def can_be_halved(self) -> Bools:
        """(n, 1) whether bisection may give more information."""
        is_above_rounding = greatest(self.nets) > _DOUBTFUL * self.band
        is_single = ~self.is_lost | ((self.several == 1) & (self.further == 0) & is_above_rounding)
        return np.asarray(is_single & ((self.high - self.low).min(axis=1) > 2 * _LEAST_SIDE))[:, None]

    def halves(self) -> LevelBoxes:
        """The boxes bisected in every direction, as far as the surface meets them."""
        return self.halved(np.ones((len(self), self.patch.shape.dimension), bool), _DEPTH)

    def halved(self, directions: Bools, tests: int = _FURTHER) -> LevelBoxes:
        """Halves in directions i, j, k (n, 1 to 3) where that is requested, as far as the surface meets them.

        Upright graphs are not bisected along k: this would give them further ends.  Others are, with all directions:
        another axis may become their height.
        """
        if not self.is_filled and directions.shape[1] < self.patch.shape.dimension:
            along_height = directions.all(axis=1) & ~self._are_upright
            directions = np.concatenate([directions, along_height[:, None]], axis=1)
        is_kept = ~self.can_be_halved[:, 0]
        is_flat = np.ones((len(self), 3), bool)
        first = 3 - self.patch.shape.dimension
        for number, wanted in enumerate(directions.T):
            np.put_along_axis(is_flat, self.order[:, first + number, None], ~wanted[:, None], axis=1)
        is_flat[self.is_lost] = self._is_flat[self.is_lost]
        halves = self.part(~is_kept)._halved(is_flat[~is_kept])
        return LevelBoxes.joined([self.part(is_kept), halves.resolved(tests)])

    def _halved(self, is_flat: Bools | None = None) -> LevelBoxes:
        """The boxes bisected in every direction, but for those (n, 3) in which g hardly changes."""
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
    def _are_upright(self) -> Bools:
        """(n,) whether graphs are nowhere much inclined to k, in the coordinates of cells."""
        sizes = np.take_along_axis(self.high - self.low, self.order, axis=1)
        return are_upright(turned(self.nets, self.order), sizes)

    @property
    def _is_flat(self) -> Bools:
        """(n, 3) directions in which g changes little compared with the others; bisection there is useless."""
        changes = np.stack([greatest(np.diff(self.nets, axis=axis)) for axis in (1, 2, 3)], axis=1)
        return np.asarray(changes < _FLAT * changes.max(axis=1, keepdims=True))

    def resolved(self, tests: int = _DEPTH) -> LevelBoxes:
        """The boxes that g = 0 meets, bisected until it is a graph in each; boxes that can't be are given up.

        tests  of boxes and their halves
        """
        found, boxes = [self.part(slice(0))], self
        limit = max(_MANY, _MANY_OF_ONE * len(self))
        for depth in range(tests):
            least, most = boxes.nets.min(axis=(1, 2, 3)), boxes.nets.max(axis=(1, 2, 3))
            if self.is_filled:
                found.append(boxes.part(most < -boxes.band)._whole())
            boxes = boxes.part((least <= boxes.band) & (most >= -boxes.band))
            if not len(boxes):
                break
            graphs, boxes = boxes._graphs()
            found.append(graphs)
            if len(boxes) > limit or depth == tests - 1:
                break
            boxes = boxes._halved(boxes._is_flat)
        return LevelBoxes.joined([*found, boxes.given_up()])

    def finished(self) -> LevelBoxes:
        """The boxes, and lost ones bisected as often as is useful."""
        is_left = self.is_lost & (self.several == 1) & (self.further == 0)
        return LevelBoxes.joined([self.part(~is_left), self.part(is_left).resolved()])

    def _whole(self) -> LevelBoxes:
        """Boxes that are whole below the surface."""
        count = len(self)
        zeros, yes = np.zeros(count), np.ones(count, bool)
        order = np.tile(np.arange(3), (count, 1))
        return replace(self, order=order, is_proved=yes, is_lost=~yes, shift=zeros, change=zeros, share=zeros)

    def _graphs(self) -> tuple[LevelBoxes, LevelBoxes]:
        """Boxes in which g = 0 is a graph, with what may be lost; the others.

        Boxes that moved g doesn't meet need no ends.
        """
        is_met = ~self._is_unmet
        free, is_free = orders(self.nets, are_ends_free=True)
        order, is_proved = free.copy(), is_free & ~is_met
        open_ended = np.flatnonzero(is_free & is_met)
        with_ends, have_ends = orders(self.nets[open_ended], are_ends_free=False)
        order[open_ended[have_ends]] = with_ends[have_ends]
        is_proved[open_ended[have_ends]] = True
        is_graph = is_proved | (is_free & (self.age >= _LOOSE))
        graphs = replace(self, order=order, is_proved=is_proved, is_lost=np.zeros(len(self), bool)).part(is_graph)
        others = self.part(~is_graph)
        others = replace(others, age=others.age + is_free[~is_graph])
        graphs = graphs._moved()

        # where moved g isn't met, but g may be, the surface is lost if it may be anywhere in the box
        is_doubtful = graphs._is_unmet & (graphs.shift > 1) & (not self.is_filled)
        return LevelBoxes.joined([graphs.part(~is_doubtful), graphs.part(is_doubtful).given_up()]), others

    @property
    def _is_unmet(self) -> Bools:
        """(n,) whether moved g has no zeros in boxes."""
        return np.asarray((self.nets.min(axis=(1, 2, 3)) > 0) | (self.nets.max(axis=(1, 2, 3)) < 0))

    def _moved(self) -> LevelBoxes:
        """Graphs with how far rounding moves them."""
        nets = turned(self.nets, self.order)
        shift, change = shifts(nets, self.band)
        return replace(self, shift=shift, change=change, share=shares_of_ends(nets, self.band))

    def given_up(self, several: int = 1) -> LevelBoxes:
        """The boxes as lost ones, in which ``several`` polynomials may be zero."""
        count = len(self)
        no, zeros = np.zeros(count, bool), np.zeros(count)
        many = np.full(count, several)
        return replace(self, is_proved=no, is_lost=~no, several=many, shift=zeros, change=zeros, share=zeros)

    @property
    def lost(self) -> Floats:
        """(n, e) estimates of what expressions amount to where rules have no points."""
        extent = np.where(self.is_lost, self._extent() * self.several + self.further, 0.0)
        return np.asarray(extent[:, None] * self.sizes)

    @property
    def moved(self) -> Floats:
        """(n, e) estimates of what moving g by less than the band changes of integrals.

        The volume between is at most band / |dg/dk| of a box.  A point of the surface moves so far along k; the area
        changes with the slopes (dg/di)/(dg/dk), whose derivatives along k are bounded by second differences.
        """
        moved = self.shift if self.is_filled else self.share + _MOVED * self.shift + self.change
        return np.asarray((self._extent() * np.minimum(moved, 1.0))[:, None] * self.sizes)

    def _extent(self) -> Floats:
        """(n,) maximum size of the surface, or the part, in each box.

        A line along direction k meets g = 0 at most as often as its degree D_k, unless it lies in it.  The integral of
        |n_k| over the surface is therefore at most D_k in the unit cube, and the image is not larger than the sum of
        these times the largest areas of faces.  Tangents that are linear in each coordinate are longest at corners.
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
        if self.is_filled:
            counts = counts if self.enough is None else (*counts[:-1], self.enough)
            is_whole = self.is_whole
            inner = [self._below_graphs(np.flatnonzero(~is_whole & ~self.is_lost), counts)]
            inner.append(self._inside(np.flatnonzero(is_whole & ~self.is_lost), counts))
            box, places, shares = joined_columns(inner)
            return ElementPoints(self.patch, self.rows[box], places), shares, box
        box, places, shares, normals = self._on_graphs(np.flatnonzero(~self.is_lost), counts)
        return ElementPoints(self.patch, self.rows[box], places, normals), shares, box

    def _inside(self, whole: Ints, counts: tuple[int, ...]) -> tuple[Ints, Floats, Floats]:
        """Box, reference point and share of points of boxes (m,) that are whole below the surface."""
        rules = [(np.zeros(1), np.full(1, 2.0))] * (3 - len(counts)) + [gauss(count) for count in counts]
        nodes = grid_points(*[own for own, _ in rules])
        weights = np.stack(np.meshgrid(*[own for _, own in rules], indexing="ij")).prod(axis=0).reshape(-1) / 8
        box = np.repeat(whole, len(nodes))
        reference, stretch = self._stretched(box, np.tile((1 + nodes) / 2, (len(whole), 1)))
        return box, reference, np.tile(weights, len(whole)) * stretch

    def _below_graphs(self, here: Ints, counts: tuple[int, ...]) -> tuple[Ints, Floats, Floats]:
        """Box, reference point and share of points where g < 0, of some graphs."""
        number, points, weights = below_graph(turned(self.nets[here], self.order[here]), counts)
        box = here[number]
        reference, stretch = self._stretched(box, self._in_cells(box, points))
        return box, reference, weights * stretch

    def _in_cells(self, box: Ints, points: Floats) -> Floats:
        """Places (n, 3) along the axes of cells, from those along i, j, k of boxes (n,)."""
        found = np.empty_like(points)
        np.put_along_axis(found, self.order[box], points, axis=1)
        return found

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

    def _on_graphs(self, here: Ints, counts: tuple[int, ...]) -> tuple[Ints, Floats, Floats, Floats]:
        """Box, reference point, share and normal of points on some graphs."""
        graph = on_graph(turned(self.nets[here], self.order[here]), counts)
        box, first = here[graph.box], 3 - self.patch.shape.dimension
        reference, columns = self._map(box, self._in_cells(box, graph.points))
        columns = np.take_along_axis(columns, self.order[box][:, None, first:] - first, axis=2)
        stretch, normals = _areas(_tangents(columns, graph.slopes[:, first:]), columns[:, :, -1], graph)
        return box, reference, graph.weights * stretch, normals


def _determinants(matrices: Floats) -> Floats:
    """(n,) of square matrices (n, d, d), d = 2 or 3."""
    if matrices.shape[1] == 3:
        return tangents.determinants(matrices)
    (a, b), (c, d) = matrices.transpose(1, 2, 0)
    return np.asarray(a * d - b * c)


def _tangents(columns: Floats, slopes: Floats) -> Floats:
    """(n, 3, d - 1) derivatives of points on a graph in the first coordinates: dx/da - dx/dk (dg/da)/(dg/dk)."""
    ratio = slopes[:, :-1] / slopes[:, -1:]
    return np.asarray(columns[:, :, :-1] - columns[:, :, -1:] * ratio[:, None, :])


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
