"""Minimum and maximum over the steps of a series, at points of each element, with the times of the steps.

The minimum of polynomials is not a polynomial: it has kinks where another step begins to attain it, and its time jumps
there.  Both are fitted in the space of the field, exactly if one step attains it throughout an element; the error of
the fit is bounded.  If the values of steps are equal to rounding, the first one counts, as rounding would choose
another at each point.

The bound: let b_k be the Bernstein coefficients of u_k in an element, and q the fit and its coefficients.  As Bernstein
polynomials are not negative, the minimum of all u_k is at least the polynomial of the minimum b_k, and at most u_j for
any step j.  So min_k u_k - q lies between the minimum coefficient of (min_k b_k) - q and the maximum of b_j - q.  Times
belong to steps whose coefficients are not all above another step's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.data.dataset import Block, Dataset, Expansion, Field
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.bernstein import bernstein_coefficients, bernstein_space
from elvis.core.polynomials.boxnets import all_halves, box_nets
from elvis.core.polynomials.rounding import box_roundings, coefficient_rounding, gamma, halving_roundings
from elvis.plugins.series.between import is_alike
from elvis.plugins.series.lattices import Fit, Lattice, Table

#: halvings of boxes in every direction for the ranges of polynomials, and elements at a time
_HALVINGS = 2
_CHUNK = 1 << 8


class Extrema:
    """Minimum and maximum values of all fields so far."""

    def __init__(self, state: Dataset) -> None:
        """Nothing yet, on the fields of a state."""
        self._times: list[float] = []
        self._fields = {field.name: field for field in state.solution}
        self._parts = {field.name: [_Part.of(block) for block in field.blocks] for field in state.solution}

    def add(self, state: Dataset, time: float) -> None:
        """Include a step; fields that it lacks, or has in another form, are skipped from now on."""
        for name, first in list(self._fields.items()):
            if name not in state or not is_alike(first, state.field(name)):
                del self._fields[name], self._parts[name]
        for name, parts in self._parts.items():
            for part, block in zip(parts, state.field(name).blocks, strict=True):
                part.add(block.coefficients, len(self._times))
        self._times.append(time)

    def fields(self) -> tuple[tuple[Field, ...], Mapping[str, FitError]]:
        """For each field u: u_min, u_max, u_min_time, u_max_time; the largest error of each fit, by name.

        Errors are relative to the largest magnitude of a value, errors of times to the largest time.
        """
        found, errors = [], dict[str, FitError]()
        times = np.array(self._times)
        for name, parts in self._parts.items():
            for end in ("min", "max"):
                own = {f"{name}_{end}": [part.ends[end].values for part in parts]}
                own[f"{name}_{end}_time"] = [times[part.ends[end].steps] for part in parts]
                for label, samples in own.items():
                    fitted = [part.fit(each) for part, each in zip(parts, samples, strict=True)]
                    size = max(float(np.abs(each).max(initial=0.0)) for each in samples) or 1.0
                    found.append(Field(label, tuple(block for block, _ in fitted)))
                    of_times = times if label.endswith("_time") else None
                    bounds = [part.bound(end, block, of_times) for part, (block, _) in zip(parts, fitted, strict=True)]
                    estimate = max(left for _, left in fitted) / size
                    errors[label] = FitError(estimate, max(bounds) / size)
        return tuple(found), errors


@dataclass(frozen=True)
class FitError:
    """Error of a fit, relative to the largest value.

    estimate  the largest difference at points: it may be larger between them
    bound     proved upper bound of the difference; inf if nothing is proved
    """

    estimate: float
    bound: float = np.inf


@dataclass
class _End:
    """The smallest values, or the largest, so far.

    sign    1 for the smallest, -1 for the largest
    values  (elements, points)
    held    (elements, points) values of the first steps that are as extreme, to rounding
    steps   (elements, points) these steps
    """

    sign: int
    values: Floats
    held: Floats
    steps: NDArray[np.int32]

    @classmethod
    def of(cls, sign: int, shape: tuple[int, int]) -> _End:
        """Nothing yet, at (elements, points)."""
        return cls(sign, np.full(shape, sign * np.inf), np.full(shape, sign * np.inf), np.zeros(shape, np.int32))

    def add(self, samples: Floats, rounding: Floats, step: int) -> None:
        """Include the values (elements, points) of a step, with rounding (elements, 1).

        NaN is ignored.
        """
        is_beyond = self.sign * samples < self.sign * self.values
        self.values[is_beyond] = samples[is_beyond]
        is_clearly_beyond = self.sign * samples < self.sign * self.held - rounding
        self.held[is_clearly_beyond] = samples[is_clearly_beyond]
        self.steps[is_clearly_beyond] = step


@dataclass
class _Enclosure:
    """Bernstein coefficients that enclose the minimum of all steps so far, or the maximum, in each element.

    sign         1 for the minimum, -1 for the maximum, whose coefficients have the other sign
    outer        (elements, m) the minimum coefficients of all steps
    inner        (elements, m) coefficients of one step, and ``step`` (elements,) its number
    first, last  (elements,) the first and the last of the steps that may attain an extreme
    rounding     (elements,) of all of these
    """

    sign: int
    outer: Floats
    inner: Floats
    step: Ints
    first: Ints
    last: Ints
    rounding: Floats

    @classmethod
    def of(cls, sign: int, count: int, size: int) -> _Enclosure:
        """Nothing yet, in a number of elements."""
        nothing = np.full((count, size), np.inf)
        start = np.zeros(count, np.int64)
        return cls(sign, nothing, nothing.copy(), start, start.copy(), start.copy(), np.zeros(count))

    def add(self, net: Floats, rounding: Floats, step: int) -> None:
        """Take the coefficients (elements, m) of a step in, of some rounding (elements,)."""
        net = self.sign * net
        self.rounding = np.maximum(self.rounding, rounding)
        slack = 2 * self.rounding[:, None]
        is_alone = (self.first == self.last) & (net < self.inner - slack).all(axis=1)
        may_hold = ~(net >= self.inner - slack).all(axis=1)
        self.first = np.where(is_alone, step, self.first)
        self.last = np.where(may_hold, step, self.last)
        is_better = net.mean(axis=1) < self.inner.mean(axis=1) - slack[:, 0]
        is_better |= ~np.isfinite(self.inner).all(axis=1)
        self.inner = np.where(is_better[:, None], net, self.inner)
        self.step = np.where(is_better, step, self.step)
        self.outer = np.fmin(self.outer, net)

    def bound(self, expansion: Expansion, fitted: Floats, rounding: Floats) -> float:
        """Upper bound of the difference from fits with coefficients (elements, m)."""
        low, _ = _ranges(expansion, self.outer - self.sign * fitted)
        _, high = _ranges(expansion, self.inner - self.sign * fitted)
        return float((np.maximum(np.abs(low), np.abs(high)) + self.rounding + rounding).max(initial=0.0))

    def bound_of_times(self, expansion: Expansion, fitted: Floats, rounding: Floats, times: Floats) -> float:
        """The same bound for times of steps, in ascending order, and fits of these."""
        low, high = _ranges(expansion, fitted)
        below, above = high - times[self.first], times[self.last] - low
        return float((np.maximum(np.abs(below), np.abs(above)) + rounding).max(initial=0.0))


def _ranges(expansion: Expansion, coefficients: Floats) -> tuple[Floats, Floats]:
    """Bounds (elements,) of polynomials with Bernstein coefficients (elements, m).

    They follow from nets on boxes that are subdivided a few times, including the rounding of that.
    """
    space = bernstein_space(expansion)
    dimension = expansion.shape.dimension
    low, high = np.empty((2, len(coefficients)))
    for part in chunks(len(coefficients), _CHUNK):
        own = coefficients[part]
        nets = box_nets(space, own)
        roundings = box_roundings(space) + _HALVINGS * halving_roundings(nets.shape[1:])
        for _ in range(_HALVINGS):
            nets = all_halves(nets)
        by_box = nets.reshape(2 ** (dimension * _HALVINGS), len(own), -1)
        off = gamma(roundings) * np.abs(own).max(axis=1)
        low[part], high[part] = by_box.min(axis=(0, 2)) - off, by_box.max(axis=(0, 2)) + off
    return low, high


@dataclass(frozen=True)
class _Part:
    """The extrema of a block of elements, at the points of a lattice, and enclosed; None along Fourier directions."""

    expansion: Expansion
    element_ids: Ints
    table: Table
    ends: Mapping[str, _End]
    enclosures: Mapping[str, _Enclosure] | None

    @classmethod
    def of(cls, block: Block) -> _Part:
        """Nothing yet of a block."""
        lattice = Lattice.of(block.expansion)
        count = len(block), len(lattice.points) * len(lattice.zeta)
        ends = {name: _End.of(sign, count) for name, sign in (("min", 1), ("max", -1))}
        enclosures = None
        if block.expansion.homogeneous is None:
            size = bernstein_coefficients(block.expansion, block.coefficients[:1]).shape[1]
            enclosures = {name: _Enclosure.of(sign, len(block), size) for name, sign in (("min", 1), ("max", -1))}
        return cls(block.expansion, block.element_ids, Table.of(block.expansion, lattice), ends, enclosures)

    def add(self, coefficients: Floats, step: int) -> None:
        """Take the coefficients (elements, m) of a step in."""
        samples = self.table.samples(coefficients)

        # a sum of m products is off by m eps times the sum of their magnitudes (Higham, Accuracy and Stability of
        # Numerical Algorithms, 2002, section 3.1), the coefficients by as much again; the same holds for the other step
        largest = np.abs(self.table.modes).max(initial=0.0)  # a wave is 1 at most
        magnitudes = np.abs(coefficients).sum(axis=1, keepdims=True) * largest
        rounding = 4 * self.table.size * np.finfo(float).eps * np.where(np.isfinite(magnitudes), magnitudes, 0.0)
        for end in self.ends.values():
            end.add(samples, rounding, step)
        if self.enclosures is not None:
            net = bernstein_coefficients(self.expansion, coefficients)
            for enclosure in self.enclosures.values():
                enclosure.add(net, coefficient_rounding(self.expansion, coefficients), step)

    def fit(self, samples: Floats) -> tuple[Block, float]:
        """The block of the best approximation of samples (elements, n), and the largest difference from these."""
        with np.errstate(invalid="ignore"):
            coefficients = Fit.of(self.expansion).coefficients(samples)
            left = np.abs(self.table.samples(coefficients) - samples)
        return Block(self.expansion, self.element_ids, frozen_floats(coefficients)), float(left.max(initial=0.0))

    def bound(self, end: str, fitted: Block, times: Floats | None) -> float:
        """Upper bound of the difference of a fit from the minimum or maximum values, or from their times."""
        if self.enclosures is None:
            return np.inf
        net = bernstein_coefficients(self.expansion, fitted.coefficients)
        rounding = coefficient_rounding(self.expansion, fitted.coefficients)
        own = self.enclosures[end]
        with np.errstate(invalid="ignore"):
            if times is None:
                found = own.bound(self.expansion, net, rounding)
            else:
                found = own.bound_of_times(self.expansion, net, rounding, times)
        return found if np.isfinite(found) else np.inf
