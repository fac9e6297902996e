"""Least and greatest values over the steps of a series, at points of each element, with the times of the steps.

The least of polynomials is none: it has kinks where another step begins to hold it, and its time jumps there.  Both are
fitted in the space of the field, exactly where one step holds it throughout an element; what fits leave is measured.
Of steps whose values are equal to rounding the first one counts, as rounding would choose another at each point.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from elvis.core.arrays import Floats, Ints, frozen_floats
from elvis.core.dataset import Block, Dataset, Expansion, Field
from elvis.plugins.series.between import is_alike
from elvis.plugins.series.lattices import Fit, Lattice, Table


class Extremes:
    """Least and greatest values of all fields so far."""

    def __init__(self, state: Dataset) -> None:
        """Nothing yet, on the fields of a state."""
        self._times: list[float] = []
        self._fields = {field.name: field for field in state.solution}
        self._parts = {field.name: [_Part.of(block) for block in field.blocks] for field in state.solution}

    def add(self, state: Dataset, time: float) -> None:
        """Take a step in; fields that it has not alike are left out from now on."""
        for name, first in list(self._fields.items()):
            if name not in state or not is_alike(first, state.field(name)):
                del self._fields[name], self._parts[name]
        for name, parts in self._parts.items():
            for part, block in zip(parts, state.field(name).blocks, strict=True):
                part.add(block.coefficients, len(self._times))
        self._times.append(time)

    def fields(self) -> tuple[tuple[Field, ...], Mapping[str, float]]:
        """For each field u: u_min, u_max, u_min_time, u_max_time; the largest error of each fit, by name.

        Errors are parts of the largest magnitude of a value, those of times parts of the largest of these.
        """
        found, errors = [], dict[str, float]()
        times = np.array(self._times)
        for name, parts in self._parts.items():
            for end in ("min", "max"):
                own = {f"{name}_{end}": [part.ends[end].values for part in parts]}
                own[f"{name}_{end}_time"] = [times[part.ends[end].steps] for part in parts]
                for label, samples in own.items():
                    fitted = [part.fit(each) for part, each in zip(parts, samples, strict=True)]
                    size = max(float(np.abs(each).max(initial=0.0)) for each in samples)
                    found.append(Field(label, tuple(block for block, _ in fitted)))
                    errors[label] = max(left for _, left in fitted) / (size or 1.0)
        return tuple(found), errors


@dataclass
class _End:
    """The least values, or the greatest, so far.

    sign    1 for the least, -1 for the greatest
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
        """Take the values (elements, points) of a step in, of some rounding (elements, 1).

        What is no number is passed over.
        """
        is_beyond = self.sign * samples < self.sign * self.values
        self.values[is_beyond] = samples[is_beyond]
        is_clearly_beyond = self.sign * samples < self.sign * self.held - rounding
        self.held[is_clearly_beyond] = samples[is_clearly_beyond]
        self.steps[is_clearly_beyond] = step


@dataclass(frozen=True)
class _Part:
    """The extremes of a block of elements, at the points of a lattice."""

    expansion: Expansion
    element_ids: Ints
    table: Table
    ends: Mapping[str, _End]

    @classmethod
    def of(cls, block: Block) -> _Part:
        """Nothing yet of a block."""
        lattice = Lattice.of(block.expansion)
        count = len(block), len(lattice.points) * len(lattice.zeta)
        ends = {name: _End.of(sign, count) for name, sign in (("min", 1), ("max", -1))}
        return cls(block.expansion, block.element_ids, Table.of(block.expansion, lattice), ends)

    def add(self, coefficients: Floats, step: int) -> None:
        """Take the coefficients (elements, m) of a step in."""
        samples = self.table.samples(coefficients)

        # a sum of m products is off by m eps times the sum of their magnitudes (Higham, Accuracy and Stability of
        # Numerical Algorithms, 2002, section 3.1), the coefficients by as much again; so are those of the other step
        largest = np.abs(self.table.modes).max(initial=0.0)  # a wave is 1 at most
        magnitudes = np.abs(coefficients).sum(axis=1, keepdims=True) * largest
        rounding = 4 * self.table.size * np.finfo(float).eps * np.where(np.isfinite(magnitudes), magnitudes, 0.0)
        for end in self.ends.values():
            end.add(samples, rounding, step)

    def fit(self, samples: Floats) -> tuple[Block, float]:
        """The block of the best approximation of samples (elements, n), and the largest difference from these."""
        with np.errstate(invalid="ignore"):
            coefficients = Fit.of(self.expansion).coefficients(samples)
            left = np.abs(self.table.samples(coefficients) - samples)
        return Block(self.expansion, self.element_ids, frozen_floats(coefficients)), float(left.max(initial=0.0))
