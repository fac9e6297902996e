"""Statistics of the wall shear over a series, on a boundary as a dataset of its own.

TAWSS                      mean of the length of the wall shear tau: time-averaged wall shear stress
shear_x, shear_y, shear_z  mean of tau
transWSS                   in 3D, mean of the length of the part of tau across the mean of tau: transverse wall shear
                           stress (Peiffer, Sherwin and Weinberg 2013, Cardiovascular Research 99)
TAAFI                      mean of the cosine of the angle between tau and the mean of tau: aligned flow index
TACFI                      in 3D, mean of the sine of this angle: cross flow index (Mohamied et al. 2015, Annals of
                           Biomedical Engineering 43)

OSI, RRT and WSSG are predefined quantities of these fields.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.quantities.elements.points import ElementPoints
from elvis.plugins.conversion.converting import Conversion, Settings, convert
from elvis.plugins.conversion.plugin import Elements, SourceField
from elvis.plugins.data.boundary_data import BoundarySource
from elvis.plugins.series.between import is_one_mesh
from elvis.plugins.series.series import Series

#: name of the mean of the length
TAWSS = "TAWSS"
#: name of the mean of the length of the part across the mean
TRANSVERSE = "transWSS"
#: names of the means of the cosine and the sine of the angle to the mean
ALIGNED, CROSS = "TAAFI", "TACFI"
#: numbers of shears that are held for a second pass, and the part of the mean length below which a mean is rounding
_NUMBERS = 1 << 22
_NO_MEAN = 1e-12
#: steps that are retained in memory; others are read again for each set of points
_KEPT = 32


def wall_statistics(series: Series, boundary: str, over: str = "steps") -> Conversion:
    """The statistics of a boundary, as fields that are projected on each of its elements, with their errors.

    Parameters
    ----------
    series : Series
        Steps with a velocity and a known viscosity, on one mesh.
    boundary : str
        Name or id of a boundary, or ``all`` outer sides.
    over : str
        ``steps``: every step counts the same; ``time``: the trapezoidal rule in time.

    Raises
    ------
    ElvisError
        If the mesh changes, the velocity or the viscosity is unknown, or there is no such boundary.
    """
    return convert(WallStatisticsSource(series, boundary, over), Settings(), (boundary,))


class WallStatisticsSource(BoundarySource):
    """The sides of a boundary with means over all steps; each set of points takes two passes over the steps."""

    format = "wall statistics"

    def __init__(self, series: Series, boundary: str, over: str) -> None:
        self._series, self._boundary = series, boundary
        first = series[0]
        axes = "xyz"[: first.mesh.space]
        self._shears = [f"shear_{axis}=wall_shear_{axis}" for axis in axes]
        super().__init__(first, boundary, self._shears, ())
        self._mesh_of = first
        self._weights = _weights(series, over)
        (vector, *_) = self.fields
        lengths = [TAWSS, TRANSVERSE, ALIGNED, CROSS] if first.mesh.dimension == 3 else [TAWSS, ALIGNED]
        self._vector = list(self.fields)
        self.fields = [*(replace(vector, name=own, is_polynomial=False, key=own) for own in lengths), *self._vector]
        self.time = None
        self.metadata = {key: text for key, text in self.metadata.items() if key != "Time"}
        self.metadata |= {"AveragedSteps": str(len(series)), "AveragedOver": over}
        self._sources: dict[int, BoundarySource] = {}
        self._means: tuple[Elements, Floats, dict[str, Floats]] | None = None

    def sample(self, block: Elements, field: SourceField, points: Floats) -> Floats:
        """The mean of a component, or of the length."""
        means = self._means
        if means is None or means[0] is not block or means[1] is not points:
            means = block, points, self._found(block, points)
            self._means = means
        return means[2][field.name]

    def _found(self, block: Elements, points: Floats) -> dict[str, Floats]:
        """All means at points of a block's elements."""
        places = self.on_sides(block, points)
        mean = np.zeros((len(self._vector), len(block), len(points)))
        length = np.zeros(mean.shape[1:])
        shears = []
        for weight, shear in self._shear(block, points, places):
            mean += weight * shear
            length += weight * np.linalg.norm(shear, axis=0)
            shears.append((weight, shear))
            if sum(own.size for _, own in shears) > _NUMBERS:
                shears.clear()
        mean[np.abs(mean) <= _NO_MEAN * length] = 0.0
        found = {TAWSS: length, **dict(zip((own.name for own in self._vector), mean, strict=True))}
        known = shears if len(shears) == len(self._series) else self._shear(block, points, places)
        return found | _angles(mean, length, known)

    def _shear(self, block: Elements, points: Floats, places: ElementPoints) -> Iterator[tuple[float, Floats]]:
        """Weight of each step, and its shear (d, n, q)."""
        for number, weight in enumerate(self._weights.tolist()):
            yield weight, self._source(number).values_on_sides(block, points, places)

    def _source(self, number: int) -> BoundarySource:
        """The boundary at a step; some steps are retained."""
        known = self._sources.get(number)
        if known is not None:
            return known
        step = self._series[number]
        if not is_one_mesh(self._mesh_of, step):
            time = self._series.times[number]
            raise ElvisError(f"expected one mesh at all steps, found another at time {time:.10g}")
        found = BoundarySource(step, self._boundary, self._shears, ())
        if len(self._sources) < _KEPT:
            self._sources[number] = found
        return found


def _angles(mean: Floats, mean_length: Floats, shears: Iterable[tuple[float, Floats]]) -> dict[str, Floats]:
    """(n, q) means of the part of shears (d, n, q) across their mean, and of the cosine and sine of the angle to it.

    Where the mean is zero, shears count as across it; a shear that is rounding has neither cosine nor sine.
    """
    size = np.linalg.norm(mean, axis=0)
    direction = np.divide(mean, size, out=np.zeros_like(mean), where=size > 0)
    found = {name: np.zeros_like(size) for name in (TRANSVERSE, ALIGNED, CROSS)}
    for weight, shear in shears:
        length = np.linalg.norm(shear, axis=0)
        has_angle = length > _NO_MEAN * mean_length
        along = (shear * direction).sum(axis=0)
        across = np.linalg.norm(shear - along * direction, axis=0)
        found[TRANSVERSE] += weight * across
        for name, part in ((ALIGNED, along), (CROSS, across)):
            found[name] += weight * np.divide(part, length, out=np.zeros_like(length), where=has_angle)
    return found


def _weights(series: Series, over: str) -> Floats:
    """(n,) of the steps, which add up to 1."""
    if over == "steps":
        return np.full(len(series), 1 / len(series))
    times = np.asarray(series.times, np.float64)
    steps = np.diff(times)
    weights = np.concatenate([[0.0], steps]) + np.concatenate([steps, [0.0]])
    return np.asarray(weights / weights.sum())
