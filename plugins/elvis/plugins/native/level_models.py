"""Boxes of native elements with Chebyshev models of a quantity, for its isosurfaces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.chebyshev_models.expression_models import has_models
from elvis.core.chebyshev_models.level_search import LevelSearch, ModelBoxes, SeriesBoxes, ShapeFacets
from elvis.core.chebyshev_models.series import (
    ROOM,
    along_axes,
    coefficients_of,
    nodes,
    sum_rounding,
    to_coefficients,
)
from elvis.core.mapping.margins import facets
from elvis.core.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_coefficients, bernstein_values
from elvis.core.polynomials.rounding import UNIT
from elvis.core.quantities import Expression
from elvis.core.shapes import Shape

#: degree of series at least, that kernels take for quantities which are not polynomials
_LEAST_DEGREE = 7
#: degree of maps and fields from which on series in boxes take less time than discs of whole elements
_FROM_DEGREE = 5
#: roundings of tables of Bernstein polynomials: two powers, a binomial, products; and of places, for each degree
_OF_TABLES, _OF_PLACES = 19, 3
#: elements whose leaves are evaluated together
_AT_ONCE = 256


@dataclass(frozen=True, eq=False)
class LevelModels:
    """Data from which boxes of the elements of a part are computed.

    patches   the elements, all of one shape
    geometry  the space of their maps
    fields    the space of the fields
    names     of the patches' fields
    ends      certified minimum and maximum of each element, (n,) each
    errors    (n, 3 + fields of the expression) bounds of the errors of computed leaves
    """

    patches: Sequence[Patch]
    geometry: BernsteinSpace
    fields: BernsteinSpace
    names: Sequence[str]
    expression: Expression
    ends: Callable[[], tuple[Floats, Floats]]
    errors: Callable[[], Floats]

    @property
    def is_known(self) -> bool:
        """Whether there are models of the expression on these elements."""
        shape, degree = self.geometry.shape, max(*self.geometry.degrees, *self.fields.degrees)
        is_solid = shape.dimension == 3 and shape is not Shape.PYRAMID
        return is_solid and degree >= _FROM_DEGREE and has_models(self.expression.root)

    def boxes(self, level: float) -> SeriesBoxes:
        """The boxes of elements that may hold a level."""
        low, high = self.ends()
        rows = np.flatnonzero(~((low > level) | (high < level)))
        leaves, rounding = self._leaves(rows)
        elements = ModelBoxes(np.arange(len(rows)), np.zeros((len(rows), 3)), np.ones(len(rows)), leaves, rounding)
        normals, offsets = facets(self.geometry.shape)
        inside = ShapeFacets(np.column_stack([normals, offsets]))
        degree = max(_LEAST_DEGREE, *self.geometry.degrees)
        search = LevelSearch(self.expression.root, self.expression.fields, self.errors()[rows], inside, degree)
        found = search.find(elements, level)
        return replace(found, element=rows[found.element], unmodelled=rows[found.unmodelled])

    @property
    def _nodes_of_line(self) -> int:
        return max(*self.geometry.degrees, *self.fields.degrees) + 1

    def _leaves(self, rows: Ints) -> tuple[Floats, Floats]:
        """(n, leaves, nodes three times) series of x, y, z and the fields on some elements; their rounding."""
        count = self._nodes_of_line
        leaves = np.empty((len(rows), 3 + len(self.expression.fields), count, count, count))
        rounding = np.empty(leaves.shape[:2])
        firsts = np.cumsum([0, *map(len, self.patches)])
        for patch, first in zip(self.patches, firsts, strict=False):
            own = np.flatnonzero((rows >= first) & (rows < first + len(patch)))
            for some in np.array_split(own, -(-len(own) // _AT_ONCE)) if len(own) else []:
                for leaf, net in enumerate(self._nets(patch, rows[some] - first)):
                    space = self.fields if leaf > 2 else self.geometry
                    leaves[some, leaf], rounding[some, leaf] = series_of(space, net, count)
        return leaves, rounding

    def _nets(self, patch: Patch, rows: Ints) -> list[Floats]:
        """(n, count) Bernstein coefficients of x, y, z and the fields of some elements of a patch."""
        own = patch.part(rows)
        maps = [
            bernstein_coefficients(own.geometry, own.geometry_coefficients[:, axis], self.geometry) for axis in range(3)
        ]
        fields = []
        for name in self.expression.fields:
            number = self.names.index(name)
            expansion, modal = own.fields[number], own.coefficients[number]
            if expansion is None or modal is None:
                fields.append(np.full((len(rows), self.fields.count), np.nan))
            else:
                fields.append(bernstein_coefficients(expansion, modal, self.fields))
        return [*maps, *fields]


def series_of(space: BernsteinSpace, nets: Floats, count: int) -> tuple[Floats, Floats]:
    """Series (n, count three times) of polynomials with Bernstein nets (n, m), and how far they may be off (n,).

    Both steps, to values and to coefficients, are off by the rounding of their sums, in proportion to the sums of
    magnitudes; what the first does goes through the second.
    """
    values, lost = _values(space, nets, count)
    sizes = _absolute_coefficients(lost + sum_rounding(count) * np.abs(values))
    return coefficients_of(values), sizes.sum(axis=(1, 2, 3))


def _absolute_coefficients(values: Floats) -> Floats:
    """Sums (n, count three times) of the magnitudes that make coefficients."""
    matrix = np.abs(to_coefficients(values.shape[-1]))
    return along_axes(values, matrix, matrix, matrix)


def _values(space: BernsteinSpace, nets: Floats, count: int) -> tuple[Floats, Floats]:
    """(n, count three times) values at the nodes, and how far they may be off."""
    line, entries = ROOM * nodes(count), _OF_TABLES + _OF_PLACES * count
    if space.shape is Shape.HEXAHEDRON:
        tables = [bernstein_values(BernsteinSpace(Shape.SEGMENT, (degree,)), line[:, None]) for degree in space.degrees]
        own = nets.reshape(len(nets), *(degree + 1 for degree in space.degrees[::-1]))
        sizes = along_axes(np.abs(own), *map(np.abs, tables))
        return along_axes(own, *tables), 3.0 * (max(own.shape[1:]) + entries) * UNIT * sizes
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    table = bernstein_values(space, np.stack([x, y, z], axis=-1).reshape(-1, 3))
    shape = (len(nets), count, count, count)
    sizes = np.abs(nets) @ np.abs(table).T
    return (nets @ table.T).reshape(shape), (table.shape[1] + entries) * UNIT * sizes.reshape(shape)
