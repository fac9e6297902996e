"""Solutions of CGNS files: values at vertices, in cells, and at the points or in the bases of CPEX 0045.

Layout: SIDS, "Flow Solution Structure Definition"; CPEX 0045, High-Order Polynomial Interpolation, version 3, chapters
3, 5 and 6, with what earlier drafts called the same.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.converters.cgns.elements import basic_shape, corners_of_shape
from elvis.converters.cgns.sides import named_points
from elvis.converters.cgns.tree import Node
from elvis.converters.cgns.zones import Zone, core_of, rind_of
from elvis.converters.shared.unit import UNIT
from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import NodalBasis, NodalValues, ShapeFunctions, native_points, space_size
from elvis.plugins.conversion.plugin import PyramidSpace

#: places of the values of a solution of CPEX 0045, by the names of its versions
_ELEMENTS = ("InterpolationPoints", "ElementBased")

#: names of the degrees in space and time of a solution of CPEX 0045, by its versions
_DEGREES = ("InterpolationDegrees", "InterpolationOrders")

#: arrays of a solution that are not fields
_METADATA = ("CharacteristicLength",)

#: degree of a solution at most
_HIGHEST = 20

#: kinds of functions, by their names
_LAGRANGE, _PARAMETRIC, _CARTESIAN, _SAME = (
    "ParametricLagrange",
    "ParametricMonomialsPascal",
    "CartesianMonomialsPascal",
    "IsoParametric",
)


class Monomials(ShapeFunctions):
    """Monomials of the coordinates of CPEX 0045's reference elements, in the order of its chapter 3.2.3."""

    def __init__(self, shape: Shape, order: int) -> None:
        self.shape, self.order = shape, order
        self._own = reference_corners(shape)[UNIT[shape].corners]

    def tabulate(self, points: Floats) -> Floats:
        """The monomials at points of our reference element."""
        ours, theirs = self.shape.vertices, self._own
        affine = np.linalg.lstsq(np.column_stack([ours, np.ones(len(ours))]), theirs, rcond=None)[0]
        return pascal(np.column_stack([points, np.ones(len(points))]) @ affine, self.order)


def pascal(points: Floats, order: int) -> Floats:
    """(n, m) monomials of total degree up to ``order`` at points (n, d)."""
    return np.stack([np.prod(points ** np.array(e), axis=1) for e in pascal_powers(points.shape[1], order)], axis=1)


def pascal_powers(dimension: int, order: int) -> list[tuple[int, ...]]:
    """Exponents in the order of the loops of CPEX 0045: by degree, then ever more of the later coordinates."""
    if dimension == 1:
        return [(i,) for i in range(order + 1)]
    found: list[tuple[int, ...]] = []
    for i in range(order + 1):
        for j in range(i + 1):
            found += [(i - j, j)] if dimension == 2 else [(i - j - k, k, j) for k in range(i - j + 1)]
    return found


def reference_corners(shape: Shape) -> Floats:
    """(n, d) corners of CPEX 0045's reference elements, in the order of the standard (chapter 6.7)."""
    triangle = [(-1, -1), (1, -1), (-1, 1)]
    if shape is Shape.PRISM:
        return frozen_floats([(*corner, w) for w in (-1, 1) for corner in triangle])
    if shape is Shape.PYRAMID:
        return frozen_floats([(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (0, 0, 1)])
    return corners_of_shape(shape)


def lagrange(shape: Shape, order: int, points: Floats, place: str) -> NodalBasis:
    """The functions of control points (n, d) of CPEX 0045's element; raises FormatError if they determine none."""
    own = native_points(shape, reference_corners(shape)[UNIT[shape].corners], points)
    try:
        return NodalBasis(shape, order, own, PyramidSpace.RATIONAL)
    except ElvisError as error:
        raise FormatError(str(error), place=place) from error


@dataclass(frozen=True, eq=False, kw_only=True)
class CartesianValues(NodalValues):
    """Monomials of places in space, relative to the mean of the corners and divided by lengths.

    values   (m, k, c) coefficients
    places   of the elements
    corners  (v, d) reference coordinates of the vertices
    lengths  (m, d) of each element along each axis
    degree   of the monomials
    """

    places: NodalValues
    corners: Floats
    lengths: Floats
    degree: int

    @property
    def order(self) -> int:
        """Degree in the reference element."""
        return self.degree * self.places.order

    def component(self, number: int, rows: slice | Ints, points: Floats) -> Floats:
        """(r, n) values at reference points (n, d) of elements ``rows``."""
        middle = self.places.at(rows, self.corners).mean(axis=1, keepdims=True)
        lengths = self.lengths[rows][:, None, :]
        local = (self.places.at(rows, points) - middle)[:, :, : lengths.shape[2]] / lengths
        table = pascal(local.reshape(-1, local.shape[2]), self.degree).reshape(*local.shape[:2], -1)
        return np.asarray(np.einsum("rnk,rk->rn", table, self.values[rows][..., number]))


@dataclass(frozen=True, eq=False)
class Interpolation:
    """A node SolutionInterpolation_t: functions of a degree on elements of a shape."""

    shape: Shape
    degree: int
    temporal: int
    kind: str
    functions: ShapeFunctions | None
    count: int


def read_interpolation(node: Node) -> Interpolation:
    """The content of a node SolutionInterpolation_t."""
    number, degree, temporal = node.ints(3).tolist()
    shape = basic_shape(number)
    kind = next((each.text() for each in node.labelled("InterpolationType_t")), "")
    if shape is None or not 0 <= degree <= _HIGHEST or kind not in (_LAGRANGE, _PARAMETRIC, _CARTESIAN, _SAME):
        found = f"type {number}, degree {degree}, {kind or 'no interpolation type'}"
        expected = f"a shape, a degree up to {_HIGHEST} and a known interpolation type"
        raise FormatError(f"expected {expected}, found {found}", place=node.place)
    if kind == _LAGRANGE:
        count = space_size(shape, degree, PyramidSpace.RATIONAL)
        if temporal:
            return Interpolation(shape, degree, temporal, kind, None, count * (temporal + 1))
        points = node.required("LagrangeControlPoints").floats(count, shape.dimension)
        functions: ShapeFunctions | None = lagrange(shape, degree, np.asarray(points, np.float64), node.place)
    else:
        count = len(pascal_powers(shape.dimension, degree)) * (temporal + 1)
        functions = Monomials(shape, degree) if kind == _PARAMETRIC else None
    return Interpolation(shape, degree, temporal, kind, functions, count)


@dataclass(frozen=True, eq=False)
class Values:
    """A field of a solution in a zone: the values on each of the zone's groups of cells, None if it has none."""

    name: str
    is_at_vertices: bool
    on_groups: list[NodalValues | None]


class Solutions:
    """The solutions of a zone.

    families       nodes of the families of the zone, which hold its interpolations
    on_groups      positions of the vertices of each group of cells
    warnings       messages about omitted parts
    """

    def __init__(self, zone: Zone, families: Sequence[Node], places: Sequence[NodalValues]) -> None:
        self.zone, self._families, self._places = zone, families, places
        self.warnings: list[str] = []

    def read(self, node: Node) -> Iterator[Values]:
        """The fields of a node FlowSolution_t."""
        location = node.child("GridLocation")
        kind = location.text() if location is not None else "Vertex"
        degrees = next((each for each in map(node.child, _DEGREES) if each is not None), None)
        arrays = [each for each in node.labelled("DataArray_t") if each.name not in _METADATA]
        if not arrays:
            return
        is_part = node.child("PointRange") is not None or node.child("PointList") is not None
        for array in arrays:
            raw = array.array()
            if raw is None or raw.dtype.kind not in "iuf":
                self.warnings.append(
                    f"{array.name} in {node.name} holds {'nothing' if raw is None else raw.dtype}, and was skipped"
                )
                continue
            if kind in _ELEMENTS or (degrees is not None and kind != "Vertex"):
                yield from self._in_bases(array, node, degrees)
            elif is_part and (kind != "CellCenter" or self.zone.is_structured):
                where = f"on a part of the zone {self.zone.name}"
                self.warnings.append(f"{array.name} in {node.name}, which is given {where}, was skipped")
            elif kind == "Vertex":
                yield self._at_vertices(array, node)
            elif kind == "CellCenter":
                yield self._in_cells(array, node)
            else:
                self.warnings.append(f"values at {kind} in the solution {node.name} were skipped")
                return

    def _at_vertices(self, array: Node, node: Node) -> Values:
        rind = rind_of(node, len(self.zone.sizes))
        own = core_of(array, self.zone.sizes, rind)
        return Values(array.name, True, [replace(each, values=own[:, None]) for each in self._places])

    def _in_cells(self, array: Node, node: Node) -> Values:
        chosen = chosen_elements(node, self.zone)
        if chosen is not None:
            own = array.floats(len(chosen))
        else:
            sizes = self.zone.cell_sizes if self.zone.is_structured else (self.zone.cell_count,)
            own = core_of(array, sizes, rind_of(node, len(sizes)))
        first = self._first(np.ones(self.zone.cell_count, np.int64), chosen, node)
        parts = np.split(first, self._ends)
        constants = [None if (rows < 0).any() else NodalValues(own[rows][:, None, None], None) for rows in parts]
        return Values(array.name, False, list(constants))

    @property
    def _ends(self) -> Ints:
        """Ends of the cells of each group, except the last, in the list of all."""
        return np.cumsum([len(group.numbers) for group in self.zone.cells])[:-1]

    def _first(self, counts: Ints, chosen: Ints | None, node: Node) -> Ints:
        """(n,) the first value of each cell, group by group; -1 for cells that are not chosen.

        Values come in the order of the cells' numbers, independent of their types, or in the order of ``chosen``.
        counts  (n,) of values in each cell
        """
        numbers = np.concatenate([group.numbers for group in self.zone.cells])
        order = np.argsort(numbers, kind="stable")
        if chosen is not None:
            at = np.minimum(np.searchsorted(numbers[order], chosen), len(order) - 1)
            order = order[at]
            if not np.array_equal(numbers[order], chosen):
                raise FormatError("expected numbers of cells, found others", place=node.place)
        first = np.full(len(numbers), -1)
        ends = np.cumsum(counts[order])
        first[order] = ends - counts[order]
        return first

    def _in_bases(self, array: Node, node: Node, degrees: Node | None) -> Iterator[Values]:
        """Values at control points, or coefficients, element after element."""
        degree, temporal = degrees.ints(2).tolist() if degrees is not None else (None, 0)
        known = self._interpolations(degree, temporal)
        groups = self.zone.cells
        if temporal or any(group.kind.shape not in known for group in groups):
            reason = "which are polynomials in time" if temporal else "whose interpolation is in no family of the zone"
            self.warnings.append(f"{array.name} in {node.name}: values of degree {degree}, {reason}, were skipped")
            return
        chosen = chosen_elements(node, self.zone)
        each = [self._count(group.kind.functions, known[group.kind.shape]) for group in groups]
        counts = np.repeat(each, [len(group.numbers) for group in groups])
        first = self._first(counts, chosen, node)
        values, needed = array.floats(None), int(counts[first >= 0].sum())
        if len(values) != needed:
            expected = f"{needed} values of {int((first >= 0).sum())} elements"
            raise FormatError(f"expected {expected}, found {len(values)}", place=array.place)
        yield Values(array.name, False, list(self._spread(values, first, known, node, chosen)))

    def _spread(
        self, values: Floats, first: Ints, known: dict[Shape, Interpolation], node: Node, chosen: Ints | None
    ) -> Iterator[NodalValues | None]:
        """The values on each group, ``first`` of them for each cell."""
        lengths = node.child("CharacteristicLength")
        at = 0
        for group, places in zip(self.zone.cells, self._places, strict=True):
            own = first[at : at + len(group.numbers)]
            at += len(group.numbers)
            way = known[group.kind.shape]
            if (own < 0).any():
                yield None
                continue
            table = values[own[:, None] + np.arange(self._count(group.kind.functions, way))][:, :, None]
            if way.kind == _SAME:
                yield NodalValues(table, group.kind.functions)
            elif way.kind == _CARTESIAN:
                scale = self._lengths(lengths, node, at - len(own), len(own), chosen)
                yield CartesianValues(
                    values=table, functions=None, places=places, corners=group.kind.shape.vertices,
                    lengths=scale, degree=way.degree,
                )  # fmt: skip
            else:
                yield NodalValues(table, way.functions)

    def _lengths(self, lengths: Node | None, node: Node, first: int, count: int, chosen: Ints | None) -> Floats:
        """(n, d) lengths of elements along each axis."""
        if lengths is None:
            raise FormatError("expected lengths CharacteristicLength, found none", place=node.place)
        raw = lengths.array()
        own = lengths.floats(None)[:, None] if raw is not None and raw.ndim == 1 else lengths.floats(None, None)
        dimension = min(self.zone.dimension, self.zone.points.shape[1])
        wanted = self.zone.cell_count if chosen is None else len(chosen)
        if len(own) != wanted or own.shape[1] not in (1, self.zone.points.shape[1]) or not (own > 0).all():
            expected = f"positive lengths of {wanted} elements"
            raise FormatError(f"expected {expected}, found {own.shape} others", place=lengths.place)
        rows = self._first(np.ones(self.zone.cell_count, np.int64), chosen, node)[first : first + count]
        scale = np.asarray(own[rows], np.float64)
        return np.repeat(scale, dimension, axis=1) if own.shape[1] == 1 else scale[:, :dimension]

    @staticmethod
    def _count(functions: ShapeFunctions, way: Interpolation) -> int:
        return functions.at(np.zeros((1, way.shape.dimension))).shape[1] if way.kind == _SAME else way.count

    def _interpolations(self, degree: int | None, temporal: int) -> dict[Shape, Interpolation]:
        """The interpolations of the zone's families, by shape; the only one for each shape if no degree is given."""
        found: dict[Shape, Interpolation] = {}
        for family in self._families:
            for node in family.labelled("SolutionInterpolation_t"):
                number, own, time = node.ints(3).tolist()
                shape = basic_shape(number)
                if shape is not None and degree in (None, own) and time == temporal:
                    found.setdefault(shape, read_interpolation(node))
        return found


def chosen_elements(node: Node, zone: Zone) -> Ints | None:
    """Numbers, from 0, of the cells of an unstructured zone that a solution names; None for all."""
    if node.child("PointRange") is None and node.child("PointList") is None:
        return None
    points, is_range, _ = named_points(node, 1)
    count = int(points[1, 0] - points[0, 0]) + 1 if is_range else len(points)
    if count > zone.cell_count:
        raise FormatError(f"expected up to {zone.cell_count} cells, found {count}", place=node.place)
    return np.arange(points[0, 0], points[1, 0] + 1) if is_range else points[:, 0]
