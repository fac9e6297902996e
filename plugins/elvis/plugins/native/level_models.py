"""Boxes of native elements with Chebyshev models of a quantity, for its isosurfaces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, starts_of
from elvis.core.base.memory import settle_free_memory
from elvis.core.chebyshev_models.expression_models import has_models
from elvis.core.chebyshev_models.level_search import LevelSearch, some_of
from elvis.core.chebyshev_models.model_boxes import ModelBoxes, ShapeFacets
from elvis.core.chebyshev_models.series import (
    ROOM,
    along_axes,
    amplification,
    coefficients_of,
    nodes,
    transform_rounding,
)
from elvis.core.chebyshev_models.series_boxes import SeriesBoxes
from elvis.core.mapping.margins import facets
from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_coefficients, bernstein_values
from elvis.core.polynomials.rounding import UNIT
from elvis.core.quantities import Expression
from elvis.core.quantities.tree import Node, leaves
from elvis.core.shapes import Shape

#: degree of series at least, that kernels take for quantities which are not polynomials
_LEAST_DEGREE = 7
#: degree of maps and fields from which on series in boxes take less time than discs of whole elements
_FROM_DEGREE = 5
#: roundings of tables of Bernstein polynomials: two powers, a binomial, products; and of places, for each degree
_OF_TABLES, _OF_PLACES = 19, 3
#: bytes of the series of a level that stay from one picture to the next
_MOST_OF_BOXES = 3 << 30
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
    condition  positive where a level of the expression does not count; None if all of it counts
    """

    patches: Sequence[Patch]
    geometry: BernsteinSpace
    fields: BernsteinSpace
    names: Sequence[str]
    expression: Expression
    ends: Callable[[], tuple[Floats, Floats]]
    errors: Callable[[], Floats]
    condition: Node | None = None

    @property
    def is_known(self) -> bool:
        """Whether there are models of the expression on these elements."""
        shape, degree = self.geometry.shape, max(*self.geometry.degrees, *self.fields.degrees)
        is_solid = shape.dimension == 3 and shape is not Shape.PYRAMID
        roots = [self.expression.root] if self.condition is None else [self.expression.root, self.condition]
        known = all(leaf.op != "field" or leaf.name in self.expression.fields for leaf in leaves(*roots))
        return is_solid and degree >= _FROM_DEGREE and known and all(map(has_models, roots))

    def boxes(self, level: float) -> ElementLevelSeries:
        """The boxes of elements that may hold a level, of each element once it is needed."""
        low, high = self.ends()
        return ElementLevelSeries(self, level, ~((low > level) | (high < level)))

    def search(self, rows: Ints) -> LevelSearch:
        """The search in some elements."""
        normals, offsets = facets(self.geometry.shape)
        inside = ShapeFacets(np.column_stack([normals, offsets]))
        degree = max(_LEAST_DEGREE, *self.geometry.degrees)
        root, names = self.expression.root, self.expression.fields
        return LevelSearch(self._elements(rows), root, names, self.errors()[rows], inside, degree, self.condition)

    def _elements(self, rows: Ints) -> ElementNets:
        """Bernstein coefficients of some elements."""
        maps = np.empty((len(rows), 3, self.geometry.count))
        values = np.empty((len(rows), len(self.expression.fields), self.fields.count))
        firsts = starts_of(self.patches)
        for patch, first in zip(self.patches, firsts, strict=False):
            own = np.flatnonzero((rows >= first) & (rows < first + len(patch)))
            for some in np.array_split(own, -(-len(own) // _AT_ONCE)) if len(own) else []:
                nets = self._nets(patch, rows[some] - first)
                maps[some] = np.stack(nets[:3], axis=1)
                for number, net in enumerate(nets[3:]):
                    values[some, number] = net
        return ElementNets((self.geometry, self.fields), (maps, values))

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


class ElementLevelSeries:
    """Boxes that may hold a level, with series for map and quantity, found when their elements are first needed.

    models  the elements
    level   the level
    holding (n,) elements that may hold the level
    """

    def __init__(self, models: LevelModels, level: float, holding: Bools) -> None:
        self.models, self.level, self.holding = models, level, holding
        self._found: dict[int, SeriesBoxes] = {}
        self._unmodelled: set[int] = set()
        self.nbytes = 0  # of all series

    @cached_property
    def _search(self) -> LevelSearch:
        """A search planned on some of the elements."""
        rows = np.flatnonzero(self.holding)
        return self.models.search(some_of(rows)).planned()

    @property
    def degree(self) -> int:
        """Degree of the series."""
        return self._search.degree

    def of(self, elements: Ints) -> SeriesBoxes:
        """The boxes of some elements, found now or before."""
        wanted = elements[self.holding[elements]]
        self._find(np.array([element for element in wanted.tolist() if element not in self._found], np.int64))
        self._drop_some(wanted)
        none = replace(
            self._search.none(), unmodelled=wanted[[element in self._unmodelled for element in wanted.tolist()]]
        )
        return SeriesBoxes.joined([none, *(self._found[element] for element in wanted.tolist())])

    def _find(self, rows: Ints) -> None:
        """Search elements and keep their boxes."""
        if not len(rows):
            return
        # models have hundreds of arrays of some 100 KiB, one after another
        settle_free_memory()
        own = self.models.search(rows)
        boxes = replace(self._search, elements=own.elements, errors=own.errors).find(self.level)
        boxes = replace(boxes, element=rows[boxes.element], unmodelled=rows[boxes.unmodelled])
        self._unmodelled.update(boxes.unmodelled.tolist())
        none = self._search.none()
        self._found.update(dict.fromkeys(rows.tolist(), none))
        self._found.update(boxes.by_element())
        self.nbytes += boxes.nbytes

    def _drop_some(self, wanted: Ints) -> None:
        """Drop boxes of random elements other than wanted ones until the memory limit is satisfied.

        Each picture draws the same elements in turn: the oldest boxes are always needed next.
        """
        others = np.setdiff1d(list(self._found), wanted)
        np.random.default_rng(1).shuffle(others)
        for element in others.tolist():
            if self.nbytes <= _MOST_OF_BOXES:
                return
            self.nbytes -= self._found.pop(element).nbytes


@dataclass(frozen=True, eq=False)
class ElementNets:
    """Elements by the Bernstein coefficients of their maps and of fields.

    spaces  of the maps and of the fields
    nets    (n, 3, count) and (n, fields, count)
    """

    spaces: tuple[BernsteinSpace, BernsteinSpace]
    nets: tuple[Floats, Floats]

    @property
    def finite(self) -> Bools:
        """(n,) which elements have only finite coefficients."""
        maps, values = (np.isfinite(net).all(axis=(1, 2)) for net in self.nets)
        return np.asarray(maps & values)

    @property
    def maps(self) -> ElementNets:
        """The elements without fields."""
        maps, values = self.nets
        return replace(self, nets=(maps, values[:, :0]))

    def boxes(self, rows: Ints, centre: Floats, half: float) -> ModelBoxes:
        """The box with this centre (3,) and half side in some elements, with series from values in the box itself."""
        count = max(degree for space in self.spaces for degree in space.degrees) + 1
        found = [
            series_of(space, net[rows].reshape(-1, space.count), count, centre, half)
            for space, net in zip(self.spaces, self.nets, strict=True)
        ]
        leaves = [net.shape[1] for net in self.nets]
        series = [own.reshape(len(rows), m, count, count, count) for (own, _), m in zip(found, leaves, strict=True)]
        off = [errors.reshape(len(rows), m) for (_, errors), m in zip(found, leaves, strict=True)]
        centres = np.tile(centre, (len(rows), 1))
        sides = np.full(len(rows), half)
        numbers = (np.concatenate(own, axis=1) for own in (series, off))
        return ModelBoxes.of_polynomials(rows, centres, sides, *numbers)


def series_of(space: BernsteinSpace, nets: Floats, count: int, centre: Floats, half: float) -> tuple[Floats, Floats]:
    """Series (n, count three times) of polynomials with Bernstein nets (n, m) on a box, and their maximum error (n,).

    Interpolation amplifies the errors of values; the coefficients have rounding of their own.  Both are smaller for
    values about zero: elements may be thin, and far from the origin.
    """
    shift = 0.5 * (nets.min(axis=1) + nets.max(axis=1))
    values, lost = _values(space, nets - shift[:, None], count, centre, half)
    found = coefficients_of(values)
    total = np.abs(found).sum(axis=(1, 2, 3))
    off = amplification(count) * lost + transform_rounding(count) * total
    found[:, 0, 0, 0] += shift
    return found, off + 2.0 * UNIT * np.abs(shift)


def _values(space: BernsteinSpace, nets: Floats, count: int, centre: Floats, half: float) -> tuple[Floats, Floats]:
    """(n, count three times) values at the nodes, and their maximum error (n,).

    Errors are relative to the largest coefficient times the sum of the magnitudes of the polynomials.
    """
    lines = centre[:, None] + half * ROOM * nodes(count)
    entries = _OF_TABLES + _OF_PLACES * count
    greatest = np.abs(nets).max(axis=1)
    if space.shape is Shape.HEXAHEDRON:
        tables = [
            bernstein_values(BernsteinSpace(Shape.SEGMENT, (degree,)), line[:, None])
            for degree, line in zip(space.degrees, lines, strict=True)
        ]
        own = nets.reshape(len(nets), *(degree + 1 for degree in space.degrees[::-1]))
        growth = np.prod([np.abs(table).sum(axis=1).max() for table in tables])
        rounding = 3.0 * (max(own.shape[1:]) + 1 + entries) * UNIT
        return along_axes(own, *tables), rounding * growth * greatest
    z, y, x = np.meshgrid(*lines[::-1], indexing="ij")
    table = bernstein_values(space, np.stack([x, y, z], axis=-1).reshape(-1, 3))
    rounding = (table.shape[1] + 1 + entries) * UNIT
    growth = np.abs(table).sum(axis=1).max()
    return (nets @ table.T).reshape(len(nets), count, count, count), rounding * growth * greatest
