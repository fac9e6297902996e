"""Quantities of data with a Fourier direction as fields with the same waves.

A quantity is sampled at more places along the waves than there are planes.  Least squares give the coefficients of the
planes, and each plane is projected like a field.  Sums of fields, of their derivatives and of products with functions
of the plane stay exact.  Other products have more waves; the part beyond the waves of the data is measured.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Field
from elvis.core.polynomials.expansion import wave_values
from elvis.core.quantities import Expression
from elvis.core.quantities.elements.points import ElementPoints
from elvis.core.quantities.evaluator import Evaluator
from elvis.plugins.conversion.converting import Settings
from elvis.plugins.conversion.plugin import Elements, SourceField
from elvis.plugins.conversion.report import Measure
from elvis.plugins.conversion.reporting import measures_of_fields
from elvis.plugins.fourier.planes import fourier_coefficients, stacked_planes
from elvis.plugins.transfers.field_passes import FieldPass, blocks_of
from elvis.plugins.transfers.other_mesh import OnMesh

#: places along the waves for each plane, and in addition
_PLACES, _MORE = 2, 5
#: share of a quantity's largest value up to which what is left out is rounding
WAVE_ROUNDING = 1e-11


def wave_fields(
    dataset: Dataset, named: Mapping[str, Expression], order: int | None
) -> list[tuple[Field, Measure, float]]:
    """Fields of expressions, their errors in the waves of the data, and the largest value beyond these waves.

    order  polynomial degree in the plane; by default the order of the data's fields

    ElvisError for data with several expansions along the waves, and for values that are not finite.
    """
    source = _WaveSource(dataset, named, order)
    work = FieldPass(source, source.fields, Settings(order=source.order))
    measures = tuple(measures_of_fields(work.projection.fields, work.projection.findings.fields, source))
    found = []
    for number, name in enumerate(named):
        own = [each for each, field in zip(measures, source.fields, strict=True) if field.key[0] == number]
        planes = [blocks_of([work], each.name) for each in own]
        field = Field(name, stacked_planes(planes, source.waves))
        left = source.beyond[number]
        found.append((field, joined_measure(name, own, left, source.ends[number]), left))
    return found


def joined_measure(name: str, planes: list[Measure], left: float, ends: tuple[float, float]) -> Measure:
    """The error of a field: errors of its planes, whose functions are at most 1, and the part beyond their waves.

    ends  the lowest and the highest value of the quantity
    """
    worst = max(planes, key=lambda own: own.max)
    largest = max(map(abs, ends))
    is_whole = left <= WAVE_ROUNDING * largest
    total = sum(own.max for own in planes) + (0.0 if is_whole else left)
    squared = sum(own.l2**2 for own in planes)
    return replace(
        worst,
        name=name,
        max=total,
        l2=float(np.sqrt(squared)),
        range=ends[1] - ends[0],
        magnitude=largest,
        is_exact=is_whole and all(own.is_exact or own.max <= WAVE_ROUNDING * largest for own in planes),
        is_continuous=False,
    )


class _WaveSource(OnMesh):
    """The planes of expressions as fields of the plane elements; the key of each is the expression and the plane.

    beyond, ends  for each expression the largest value that the waves don't contain, and its lowest and highest value
    """

    format = "quantities of fields"

    def __init__(self, dataset: Dataset, named: Mapping[str, Expression], order: int | None) -> None:
        super().__init__(fourier_coefficients(dataset, 0))
        self._names, self._expressions = list(named), list(named.values())
        self._evaluator = Evaluator(dataset, self._expressions)
        waves = {own.homogeneous for own in self._evaluator.patches}
        first = next(iter(waves))
        if len(waves) != 1 or first is None:
            raise ElvisError("expected one expansion along the Fourier direction for all elements, found several")
        self.waves = first
        count = _PLACES * len(first.z_ids) + _MORE
        self._zeta = 2 * (np.arange(count) + 0.5) / count - 1
        self._table = wave_values(first, self._zeta[:, None])
        self._inverse = np.linalg.pinv(self._table)
        held = [own for patch in self._evaluator.patches for own in patch.fields if own is not None]
        self.order = max(max(own.modes) - 1 for own in held) if order is None else order
        self.beyond = [0.0] * len(named)
        self.ends = [(np.inf, -np.inf)] * len(named)
        planes = range(len(first.z_ids))
        self.fields = [
            SourceField(f"{name} {plane}", self.order, False, False, (number, plane))
            for number, name in enumerate(named)
            for plane in planes
        ]
        self._last: tuple[int, Elements, Floats, Floats] | None = None

    def values_at(self, places: Floats) -> Floats:
        """Not used: values belong to elements."""
        raise NotImplementedError

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """The coefficients of a plane; the same values give the other planes of the expression."""
        number, plane = field.key
        last = self._last
        if last is None or last[0] != number or last[1] is not block or last[2] is not points:
            last = self._last = number, block, points, self._planes(number, block, points)
        return np.asarray(last[3][plane].reshape(len(block), len(points)))

    def _planes(self, number: int, block: Elements, points: Floats) -> Floats:
        """(planes, n) coefficients of an expression at reference points in each element."""
        patch = self._evaluator.patches[block.key]
        rows = np.repeat(np.arange(len(patch))[block.rows], len(points))
        in_plane = np.tile(points, (len(block), 1))
        values = np.empty((len(self._zeta), len(rows)))
        for i, zeta in enumerate(self._zeta):
            own = ElementPoints(patch, rows, np.column_stack([in_plane, np.full(len(rows), zeta)]))
            values[i] = next(iter(self._evaluator.values_at([self._expressions[number]], own)))
        if not np.isfinite(values).all():
            raise ElvisError(f"{self._names[number]}: expected finite values, found others")
        found: Floats = self._inverse @ values
        self.beyond[number] = max(self.beyond[number], float(np.abs(self._table @ found - values).max(initial=0)))
        low, high = self.ends[number]
        self.ends[number] = min(low, float(values.min(initial=low))), max(high, float(values.max(initial=high)))
        return found
