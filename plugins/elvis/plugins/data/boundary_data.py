"""Boundaries as datasets: faces of volumes, or edges of plane elements, with the maps and fields of elements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import starmap
from pathlib import Path

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.conversion_errors import ConversionErrors
from elvis.core.data.dataset import MAP_KEY, Dataset, Field, Homogeneous
from elvis.core.integrals.reference_cells import side_corners
from elvis.core.mapping.orientation import local_vertices
from elvis.core.quantities import Expression
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.streamlines.walls import outward
from elvis.core.triangles.boundary_triangles import boundary_pieces
from elvis.plugins.conversion.converting import Conversion, Settings, convert
from elvis.plugins.conversion.plugin import Converter, Elements, SourceField
from elvis.plugins.conversion.report import CONVERTED, REPORT
from elvis.plugins.data.added_quantities import parse_quantities
from elvis.plugins.fourier.planes import common_waves, fourier_coefficients, has_waves, stacked_planes

#: by how much of a side points on its edges are moved inwards, so that the nearest side of the element is this one
_INWARDS = 1e-12


def boundary_data(dataset: Dataset, boundary: str, quantities: Sequence[str] = ()) -> Dataset:
    """A boundary as a dataset: its faces are elements, with the fields of the volume.

    boundary    name of a boundary, or ``all`` for all outer faces; edges of 2D data become lines
    quantities  of the volume that also become fields, such as ``"shear=wall_shear(mu=2e-4)"``

    Curved faces and fields are traces of polynomials, so they are exact; quantities are projected, and remarks state
    the errors.  Fields with a Fourier direction keep it.  Raises ElvisError for unknown boundaries, and for quantities
    of data with Fourier directions.

    >>> ds = elvis.read("wing.xml", "wing.fld")
    >>> elvis.boundary_data(ds, "wing", ["Cp=2*p"])
    <Dataset 2D in 3D: 80 quadrilaterals; fields u, v, w, p, Cp of order 4>
    """
    conversion = convert_boundary(dataset, boundary, quantities)
    return replace(conversion.dataset, remarks=(*dataset.remarks, *conversion.report.remarks()))


def convert_boundary(
    dataset: Dataset, boundary: str, quantities: Sequence[str] = (), fields: Sequence[str] | None = None
) -> Conversion:
    """The conversion of `boundary_data`, with its report.

    fields  names of remaining fields; None for all
    """
    if has_waves(dataset) and not quantities:
        return _convert_planes(dataset, boundary, fields)
    return convert(BoundarySource(dataset, boundary, quantities, fields), Settings(), (boundary,))


def _convert_planes(dataset: Dataset, boundary: str, fields: Sequence[str] | None) -> Conversion:
    """The boundary of data with a Fourier direction: the traces of each plane of coefficients."""
    waves = common_waves(dataset, boundary)
    planes = [
        convert(BoundarySource(fourier_coefficients(dataset, number), boundary, (), fields), Settings(), (boundary,))
        for number in waves.z_ids
    ]
    found = starmap(partial(_stacked, waves), zip(*(own.dataset.fields for own in planes), strict=True))
    measures = zip(*(own.report.fields for own in planes), strict=True)
    worst = tuple(max(each, key=lambda measure: measure.max) for each in measures)
    first = planes[0]
    return replace(
        first,
        dataset=replace(first.dataset, fields=tuple(found)),
        report=replace(first.report, fields=worst),
    )


def _stacked(waves: Homogeneous, *planes: Field) -> Field:
    """A field with a Fourier direction from its planes of coefficients."""
    blocks = stacked_planes([own.blocks for own in planes], waves)
    return replace(planes[0], blocks=blocks, continuous=all(own.continuous for own in planes))


class BoundarySource(Converter):
    """The sides of a boundary as elements, with the fields of the elements behind them."""

    format = "boundary"

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """No files."""
        return False

    def __init__(
        self, dataset: Dataset, boundary: str, quantities: Sequence[str], fields: Sequence[str] | None
    ) -> None:
        known = [own.name for own in dataset.solution]
        wanted = known if fields is None else list(fields)
        self._expressions = {name: Expression.of(dataset, name) for name in wanted}
        self._expressions |= parse_quantities(dataset, quantities, on_sides=True)
        self._evaluator = Evaluator(dataset, list(self._expressions.values()))
        patches = self._evaluator.patches
        if any(patch.homogeneous for patch in patches):
            raise ElvisError(f"{boundary}: expected only fields, as the data have a Fourier direction")
        self._pieces = boundary_pieces(dataset, patches, boundary)
        self.blocks = [self._block(dataset, number) for number in range(len(self._pieces))]
        self.fields = [self._field(dataset, name) for name in self._expressions]
        self.time = dataset.time
        known_keys = {CONVERTED, REPORT, MAP_KEY}
        self.metadata = {key: text for key, text in dataset.metadata.items() if key not in known_keys}
        lost = ConversionErrors.of(dataset.metadata)
        self.errors = {name: (own.value, own.slope) for name, own in [("", lost.place), *lost.fields.items()]}
        self._last: tuple[Elements, Floats, ElementPoints] | None = None

    def positions(self, block: Elements, points: Floats) -> Floats:
        """The maps of the elements on these sides."""
        return self._elements(block, points).positions.reshape(len(block), len(points), 3)

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """The values of a field or quantity in the elements behind the sides."""
        expression = self._expressions[field.name]
        places = self.on_sides(block, points) if expression.attributes else self._elements(block, points)
        values = next(iter(self._evaluator.values_at([expression], places)))
        return np.broadcast_to(values, len(block) * len(points)).reshape(len(block), len(points))

    def values_on_sides(self, block: Elements, points: Floats, like: ElementPoints) -> Floats:
        """(f, n, q) values of all fields and quantities.

        like  the points of `on_sides` of another step, on the same mesh, whose geometry is used
        """
        places = like.in_patch(self._pieces[block.key][1].patch)
        found = self._evaluator.values_at(list(self._expressions.values()), places)
        shape = len(block), len(points)
        return np.stack([np.broadcast_to(own, len(like)).reshape(shape) for own in found])

    def _elements(self, block: Elements, points: Floats) -> ElementPoints:
        """The points in each element; results of the last call are cached, as fields are sampled in turn."""
        if self._last is None or self._last[0] is not block or self._last[1] is not points:
            piece = self._pieces[block.key][1]
            rows = np.repeat(piece.rows[block.rows], len(points))
            self._last = block, points, ElementPoints(piece.patch, rows, np.tile(piece.places(points), (len(block), 1)))
        return self._last[2]

    def on_sides(self, block: Elements, points: Floats) -> ElementPoints:
        """The points with normals, off the edges, where several sides are as near, and off the tips of pyramids."""
        piece = self._pieces[block.key][1]
        inner = points + _INWARDS * (piece.shape.centre - points)
        places = self._elements(block, inner)
        return ElementPoints(piece.patch, places.rows, places.points, outward(piece, places.jacobians))

    def _block(self, dataset: Dataset, number: int) -> Elements:
        """The sides of a piece, by the ids of their vertices."""
        name, piece = self._pieces[number]
        patch = piece.patch
        assert piece.number is not None
        elements = dataset.mesh.of(patch.shape).rows_of(patch.element_ids[piece.rows])
        own = local_vertices(dataset.mesh, patch.shape)[elements][:, list(side_corners(patch.shape, piece.number))]
        order = max(patch.geometry.modes) - 1
        return Elements(piece.shape, len(piece), order, dataset.mesh.vertex_ids[own], region=name, key=number)

    def _field(self, dataset: Dataset, name: str) -> SourceField:
        """A field of its degree in the elements, or a quantity of the degree of its fields or higher."""
        expression, names = self._expressions[name], self._evaluator.names
        orders: list[int | None] = []
        for _, piece in self._pieces:
            expansions = [piece.patch.fields[names.index(own)] for own in expression.fields]
            degrees = [max(expansion.modes) - 1 for expansion in expansions if expansion is not None]
            orders.append(max(degrees, default=1) if len(degrees) == len(expansions) else None)
        is_trace = expression.is_field
        is_continuous = is_trace and bool(dataset.field(expression.fields[0]).continuous)
        return SourceField(name, orders, is_continuous, is_trace, name)
