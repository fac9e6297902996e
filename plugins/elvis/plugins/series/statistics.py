"""Statistics over a series: means, exact by coefficients, and covariances, exact in the bases that hold products.

A mean is linear in the coefficients.  The product of two fields of degrees p and q has degree p + q in reference space,
whatever the map, and wave numbers up to the sum of theirs along Fourier directions: so its mean is found at points of
each element and fitted in the basis that holds it, but for the rational functions on pyramids; what the fit leaves is
measured.

All is found in one reading of the steps, by sums of squares of what each differs from the mean so far (Welford, Note on
a method for calculating corrected sums of squares and products, Technometrics 1962), which lose no digits to the mean.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.base.errors import ElvisError
from elvis.core.base.terminal import track
from elvis.core.data.dataset import Block, Dataset, Expansion, Field
from elvis.core.polynomials.collapse import uncollapse
from elvis.plugins.series.between import combined, is_one_mesh
from elvis.plugins.series.extrema import Extrema, FitError
from elvis.plugins.series.lattices import Fit, Lattice, Table, product_space
from elvis.plugins.series.series import Series

#: kinds of means: over steps with equal weights, or over time with linear interpolation between steps
OVER = ("steps", "time")
#: remark if some steps are not finite
_FINITE = "means are of the steps whose values are finite"
#: places on [0, 1] of the rule, of equal weights, that is exact for the products of two linears in time
_GAUSS = (0.5 - 0.75**0.5 / 3, 0.5 + 0.75**0.5 / 3)


@dataclass(frozen=True, eq=False)
class Average:
    """The means of all fields under their names, covariances ``u_v`` and extrema ``u_min`` after these.

    left_out  fields that not all steps have alike
    errors    between these and their fits, as a part of the largest value, by name: an estimate and a bound
    """

    dataset: Dataset
    left_out: tuple[str, ...]
    errors: Mapping[str, FitError]


def average(
    series: Series,
    over: str = "steps",
    with_covariances: bool = False,
    order: int | None = None,
    with_extrema: bool = False,
) -> Average:
    """The mean of a series over all steps that can be read (see OVER), each of which is read once.

    order  maximum degree of covariances, whose errors are measured; None for the degree that contains them exactly
    with_extrema  whether to compute minimum and maximum over the steps, with their times (see `extrema`)

    Raises ElvisError if the mesh changes between steps, or if no basis contains requested covariances.

    >>> series = elvis.open_series("wave.xml", "wave_*.chk")
    >>> elvis.average(series).dataset
    <Dataset 2D: 16 quadrilaterals; fields u of order 7>
    """
    if over not in OVER:
        raise ElvisError(f"expected a mean over {' or '.join(OVER)}, found {over!r}")
    # steps that are not finite say nothing of the others' mean, unless there are no others
    for is_finite_wanted in (True, False):
        times: list[float] = []
        sums: _Sums | None = None
        extrema: list[Extrema] = []
        for weight, state in _states(series, over, times, extrema if with_extrema else None, is_finite_wanted):
            if sums is None:
                sums = _Sums.of(state, with_covariances, order)
            sums.add(state, weight)
        if sums is not None:
            break
    assert sums is not None  # a series has a step that can be read, or raises
    mean = sums.mean
    if not mean.solution:
        raise ElvisError(f"expected a field that is alike at all steps, found {', '.join(sums.left_out) or 'none'}")
    fields, errors = sums.covariances()
    for own in extrema:
        more, left = own.fields()
        fields, errors = (*fields, *more), {**errors, **left}
    taken = [field.name for field in fields if field.name in mean]
    if taken:
        raise ElvisError(f"statistics would have the names of fields: {', '.join(taken)}")
    metadata = {key: text for key, text in mean.metadata.items() if key != "Time"}
    metadata |= {"AveragedSteps": str(len(times)), "AveragedOver": over}
    metadata |= {"AveragedFrom": repr(times[0]), "AveragedTo": repr(times[-1])}
    told = (*series.told, *([_FINITE] if is_finite_wanted and series.infinite else []))
    whole = replace(mean, fields=(*mean.fields, *fields), time=None, metadata=metadata, remarks=told)
    return Average(whole, tuple(sums.left_out), errors)


def _states(
    series: Series, over: str, times: list[float], extrema: list[Extrema] | None, is_finite_wanted: bool
) -> Iterator[tuple[float, Dataset]]:
    """Weights and datasets of the weighted mean.

    times     receives the times of the steps that could be read
    extrema  receives the extrema of the steps; None if they aren't wanted
    is_finite_wanted  whether steps with values that are not finite are skipped; there may be none then
    """
    first: Dataset | None = None
    before: tuple[float, Dataset] | None = None
    for number in track(series.readable(), "mean of all steps", len(series)):
        step, time = series[number], float(series.times[number])
        if is_finite_wanted and number in series.infinite:
            continue
        first = first or step
        if not is_one_mesh(first, step):
            raise ElvisError(f"expected one mesh at all steps, found another at time {time:.10g}: no mean can be made")
        times.append(time)
        if extrema is not None:
            extrema[:] = extrema or [Extrema(first)]
            extrema[0].add(step, time)
        if over == "steps":
            yield 1.0, step
        elif before is not None:
            yield from _between(before, (time, step))
        before = time, step
    if over != "steps" and before is not None and len(times) == 1:
        yield 1.0, before[1]


def _between(before: tuple[float, Dataset], after: tuple[float, Dataset]) -> Iterator[tuple[float, Dataset]]:
    """The states and weights of the rule in time between two steps."""
    length = after[0] - before[0]
    for place in _GAUSS:
        state, lacking = combined([before[1], after[1]], np.array([1 - place, place]))
        # a field missing in one state is also dropped from later ones
        yield length / 2, replace(state, fields=tuple(own for own in state.fields if own.name not in lacking))


@dataclass
class _Sums:
    """The mean so far, and the sums of products of what states differ from it by.

    weight    of all states so far
    products  by block of pairs of fields; none where covariances are not requested
    left_out  names of fields that not all states have alike
    """

    mean: Dataset
    weight: float
    products: list[list[_Product]]
    left_out: dict[str, None]

    @classmethod
    def of(cls, state: Dataset, with_covariances: bool, order: int | None) -> _Sums:
        """Nothing yet, on the fields of a state."""
        pairs = combinations_with_replacement(state.solution, 2) if with_covariances else ()
        products = []
        for one, other in pairs:
            if len(one.blocks) != len(other.blocks):
                raise ElvisError(f"covariances need fields on the same elements, {one.name} and {other.name} differ")
            products.append([_Product.of(one, other, number, order) for number in range(len(one.blocks))])
        return cls(state, 0.0, products, {})

    def add(self, state: Dataset, weight: float) -> None:
        """Take a state in.

        With weight W and mean m before, w and x of the state, m becomes m + w / (W + w) (x - m), and the sum of squares
        grows by W w / (W + w) (x - m)^2.
        """
        total = self.weight + weight
        part = weight / total
        mean, lacking = combined([self.mean, state], np.array([1 - part, part]))
        self.left_out.update(dict.fromkeys(lacking))
        self.products = [own for own in self.products if not self.left_out.keys() & set(own[0].names)]
        for own in self.products:
            for product in own:
                product.add(self.mean, state, self.weight * part)
        self.mean, self.weight = mean, total

    def covariances(self) -> tuple[tuple[Field, ...], dict[str, FitError]]:
        """The covariance of each pair of fields, and what their fits leave."""
        fields, errors = [], dict[str, FitError]()
        for own in self.products:
            name = "_".join(own[0].names)
            blocks, left, sizes = zip(*(product.fitted(self.weight) for product in own), strict=True)
            fields.append(Field(name, blocks))
            errors[name] = FitError(max(left) / (max(sizes) or 1.0))
        return tuple(fields), errors


@dataclass
class _Product:
    """The sum of products of what two fields differ from their means by, on a block of elements.

    expansion  that holds the product
    lower      the expansion in which it is requested
    lattice    points of each element at which the product is found
    tables     of either field on it
    samples    (elements, n) of the product
    """

    names: tuple[str, str]
    block: int
    element_ids: Ints
    expansion: Expansion
    lower: Expansion
    lattice: Lattice
    tables: tuple[Table, Table]
    samples: Floats

    @classmethod
    def of(cls, one: Field, other: Field, number: int, order: int | None) -> _Product:
        """The product of two fields on a block; ElvisError if they have other elements or Fourier directions."""
        a, b = one.blocks[number], other.blocks[number]
        if not np.array_equal(a.element_ids, b.element_ids):
            raise ElvisError(f"covariances need fields on the same elements, {one.name} and {other.name} differ")
        expansion = product_space(a.expansion, b.expansion)
        most = max(expansion.modes) if order is None else order + 1
        lower = replace(expansion, modes=tuple(min(count, most) for count in expansion.modes))
        lattice = Lattice.of(expansion)
        tables = Table.of(a.expansion, lattice), Table.of(b.expansion, lattice)
        samples = np.zeros((len(a), len(lattice.points) * len(lattice.zeta)))
        return cls((one.name, other.name), number, a.element_ids, expansion, lower, lattice, tables, samples)

    def add(self, mean: Dataset, state: Dataset, weight: float) -> None:
        """Take in what a state differs from a mean by."""
        product = np.full_like(self.samples, weight)
        for name, table in zip(self.names, self.tables, strict=True):
            own, other = (data.field(name).blocks[self.block].coefficients for data in (state, mean))
            product *= table.samples(own - other)
        self.samples += product

    def fitted(self, weight: float) -> tuple[Block, float, float]:
        """The block of the mean product, the largest difference from it that is found, and the largest sample."""
        samples = self.samples / weight
        coefficients = Fit.of(self.expansion).coefficients(samples)
        left = Table.of(self.expansion, self.lattice).samples(coefficients) - samples
        error, size = (float(np.abs(each).max(initial=0.0)) for each in (left, samples))
        if self.lower != self.expansion:
            coefficients, more = _lowered(coefficients, self.expansion, self.lower)
            error += more
        return Block(self.lower, self.element_ids, frozen_floats(coefficients)), error, size


def _lowered(coefficients: Floats, expansion: Expansion, lower: Expansion) -> tuple[Floats, float]:
    """The best approximation in a lower expansion, and the largest difference on a lattice that holds the borders."""
    shape = expansion.shape
    extra = max(expansion.modes) - max(lower.modes) + 1
    lattice = Lattice.of(lower, extra)
    found = Fit.of(lower, extra).coefficients(Table.of(expansion, lattice).samples(coefficients))

    line = np.linspace(-1.0, 1.0, 2 * max(expansion.modes) + 1)
    axes = np.meshgrid(*[line] * shape.dimension, indexing="ij")
    places = uncollapse(shape, np.stack([axis.reshape(-1) for axis in axes], axis=1))
    lattice = Lattice(places, lattice.zeta)
    left = Table.of(expansion, lattice).samples(coefficients) - Table.of(lower, lattice).samples(found)
    return found, float(np.abs(left).max(initial=0.0))
