"""Parts of boxes with the series of a quantity, and of a condition, near a level."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.base.rows import Rows
from elvis.core.chebyshev_models.box_series import BoxSeries
from elvis.core.chebyshev_models.model import ChebyshevModel
from elvis.core.chebyshev_models.model_boxes import EIGHTHS, ModelBoxes, ShapeFacets, eighths_of
from elvis.core.chebyshev_models.series import (
    ORDERS,
    PARTS_ROUNDING,
    ROOM,
    amplification,
    kernel_rounding,
    on_parts,
    shells_of,
    sizes_of,
    steepness,
    tails_of,
)
from elvis.core.chebyshev_models.series_boxes import SeriesBoxes, world_boxes

#: tolerated error of models, relative to their range
MODEL_PART = 1e-4
#: the same tolerance for the smallest boxes, whose error is rounding
_FAIR_PART = 2e-3
#: pixels of a box of a picture; within one, the quantity changes by more than the error of its series
_PIXELS = 16.0


@dataclass(frozen=True, eq=False)
class ModelledBoxes:
    """Parts of boxes with the series of a quantity.

    boxes         of the models, with the series of the map
    row           (n,) the box of each part
    centre        (n, 3) and half (n,) of the parts, in the coordinates of the elements' cubes
    series        of the quantity
    remainder     (ORDERS, n) bounds of its error, and of the error's derivatives in x
    error         (n,) maximum error of computed values of the quantity
    condition     optional: where the level counts
    excess        (boxes, 1 or 2, 8) by how much the errors of the quantity and of the condition are smaller in the
                  eighths of the boxes
    """

    boxes: ModelBoxes
    row: Ints
    centre: Floats
    half: Floats
    series: BoxSeries
    remainder: Floats
    error: Floats
    condition: Condition | None
    excess: Floats

    def __len__(self) -> int:
        return len(self.row)

    @property
    def element(self) -> Ints:
        """(n,) rows of elements."""
        return self.boxes.element[self.row]

    def part(self, rows: Ints | Bools) -> ModelledBoxes:
        """Some of the parts."""
        if rows.dtype == np.bool_ and rows.all():
            return self
        condition = None if self.condition is None else self.condition.part(rows)
        places = self.boxes, self.row[rows], self.centre[rows], self.half[rows]
        series = self.series.part(rows)
        return ModelledBoxes(*places, series, self.remainder[:, rows], self.error[rows], condition, self.excess)

    @property
    def is_good(self) -> Bools:
        """(n,) whether the error of the series is small compared to its range, or is rounding."""
        return self.is_within(1.0)

    def is_within(self, share: float) -> Bools:
        """(n,) whether it is at most this share of the tolerated error, or rounding."""
        own = lacking(self.remainder)
        count = self.series.count
        rounding = amplification(count) * self.error * max(_PIXELS, steepness(count, 1))
        return np.asarray(own <= np.maximum(share * MODEL_PART * self.series.range, 2.0 * rounding))

    @property
    def is_fair(self) -> Bools:
        """(n,) whether the error of the series suffices for boxes that are not bisected any more."""
        return np.asarray(lacking(self.remainder) <= _FAIR_PART * self.series.range)

    def may_hold(self, level: float) -> Bools:
        """(n,) whether the quantity may have the level in a box."""
        meets = ~(np.abs(self.series.mean - level) > self.series.range + self.remainder[0] + self.error)
        return np.asarray(meets if self.condition is None else meets & ~self.condition.is_positive)

    def may_hold_in_parts(self, level: float) -> Bools:
        """(n,) whether the quantity may have the level in an eighth of a box: the series excludes more there."""
        return np.asarray(self._may_hold_in_eighths(level).any(axis=1))

    def eighths_that_may_hold(self, level: float) -> tuple[Ints, Floats, Floats]:
        """Elements, centres and half sides of the eighths in which the quantity may have the level."""
        box, eighth = np.nonzero(self._may_hold_in_eighths(level))
        half = 0.5 * self.half[box]
        return self.element[box], self.centre[box] + half[:, None] * np.array(EIGHTHS)[eighth], half

    def _may_hold_in_eighths(self, level: float) -> Bools:
        """(n, 8) whether the quantity may have the level in the eighths of a box."""
        mean, reach = self.series.in_eighths()
        room = (self.remainder[0] + self.error)[:, None]
        meets = ~(np.abs(mean - level) > reach + room)
        if self.condition is not None:
            meets &= ~self.condition.is_positive_in_eighths
        return np.asarray(meets)

    def misfit(self, degree: int) -> Floats:
        """(ORDERS, n) the remainders with the terms beyond a degree."""
        shells = shells_of(self.series.coefficients)
        shells[:, : degree + 1] = 0.0
        return np.asarray(self.remainder + sizes_of(shells))

    def shortened(self, least: int, share: float) -> ModelledBoxes:
        """The series without terms of high degrees, ``least`` nodes of a line at least: these count as remainder.

        They are at most a share of the range, also of parts, in which they fade faster than the range.
        """
        tails = tails_of(shells_of(self.series.coefficients))
        dropped = lacking(tails) / self.series.range[:, None]
        count = max(least, int(np.count_nonzero(dropped.max(axis=0) > share)))
        condition = None if self.condition is None else self.condition.shortened(share)
        if count >= tails.shape[-1]:
            return replace(self, condition=condition)
        remainder = self.remainder + tails[..., count]
        return replace(self, series=self.series.shortened(count), remainder=remainder, condition=condition)

    def eighths(self, inside: ShapeFacets, level: float) -> ModelledBoxes:
        """Eighths of all parts that may hold a level and lie in their elements; derivatives are half as great."""
        found = self
        for axis in range(3):
            found = found._halves(axis, level)
        found = found.part(inside.holds(found.centre, 0.5 * found.half))
        remainder = found.remainder * (0.5 ** np.arange(ORDERS))[:, None]
        condition = None if found.condition is None else found.condition.halved()
        return replace(found, half=0.5 * found.half, remainder=remainder, condition=condition)

    def _halves(self, axis: int, level: float) -> ModelledBoxes:
        """Halves along an axis that may hold a level; the sizes are not updated."""
        error = self.error + self.series.rounding
        parts = []
        for side in (-1, 1):
            condition = None if self.condition is None else self.condition.on_side(axis, side)
            series = self.series.on_side(axis, side)
            centre = self.centre + 0.5 * side * self.half[:, None] * np.eye(3)[axis]
            half = replace(self, centre=centre, series=series, error=error, condition=condition)
            parts.append(half.part(half.may_hold(level)))
        conditions = [part.condition for part in parts if part.condition is not None]
        return ModelledBoxes(
            self.boxes,
            np.concatenate([part.row for part in parts]),
            np.concatenate([part.centre for part in parts]),
            np.concatenate([part.half for part in parts]),
            BoxSeries.joined([part.series for part in parts]),
            np.concatenate([part.remainder for part in parts], axis=1),
            np.concatenate([part.error for part in parts]),
            Condition.joined(conditions) if conditions else None,
            self.excess,
        )

    def _excess(self) -> Floats:
        """(n, 1 or 2) by how much errors in the parts are smaller than in the boxes."""
        eighth = eighths_of(self.centre - self.boxes.centre[self.row])
        is_part = self.half < self.boxes.half[self.row]
        excess = np.where(is_part[:, None], self.excess[self.row, :, eighth], 0.0)
        # bounds in eighths may be infinite
        return np.asarray(np.where(excess > 0.0, excess, 0.0))

    def as_series_boxes(self, degree: int, misfit: Floats) -> SeriesBoxes:
        """The parts with series of a degree, and what those lack (ORDERS, n), in x."""
        size = degree + 1
        used, map_of = np.unique(self.row, return_inverse=True)
        boxes = self.boxes.part(used)
        maps, errors = _maps_of(boxes, size)
        places, rounding = errors[map_of], PARTS_ROUNDING * np.abs(maps).sum(axis=(1, 2, 3, 4))[map_of]
        series, _ = _of_size(self.series.coefficients, size)
        # kernels sum these series: the rounding of that counts as well
        summed = kernel_rounding(size) * np.abs(series).sum(axis=(1, 2, 3))
        whole = np.tile((-1.0, 0.0), (len(self), 1))
        excess = self._excess()
        ratio = self.half / boxes.half[map_of]
        centre = (self.centre - boxes.centre[map_of]) / boxes.half[map_of, None]
        return SeriesBoxes(
            element=self.element,
            centre=self.centre,
            half=self.half,
            series=series,
            misfit=misfit.T / ROOM ** np.arange(ORDERS),
            error=self.error - excess[:, 0] + summed,
            summed=summed,
            places=places,
            world=world_boxes(on_parts(maps[map_of], centre, ratio), places + rounding),
            condition=whole if self.condition is None else self.condition.in_kernels(excess[:, 1]),
            map_of=map_of,
            unmodelled=np.zeros(0, np.int64),
            map_centre=boxes.centre,
            map_half=boxes.half,
            maps=maps,
        )


def _maps_of(boxes: ModelBoxes, size: int) -> tuple[Floats, Floats]:
    """Series (n, 3, size three times) of the maps of boxes, and the error (n,) of places that kernels find by them."""
    leaves = boxes.leaves[:, :3]
    found, left_out = _of_size(leaves.reshape(-1, *leaves.shape[2:]), size)
    maps = found.reshape(-1, 3, *found.shape[1:])
    summed = kernel_rounding(size) * np.abs(maps).sum(axis=(2, 3, 4))
    return maps, (boxes.off[:, :3] + left_out.reshape(-1, 3) + summed).sum(axis=1)


def _of_size(series: Floats, size: int) -> tuple[Floats, Floats]:
    """Series (n, count three times) cut or padded to ``size`` terms a direction; sums (n,) of the dropped magnitudes.

    Fields may have higher degrees than the map: the map's series contain only rounding there.
    """
    count = min(size, series.shape[-1])
    found = np.zeros((len(series), size, size, size))
    found[:, :count, :count, :count] = series[:, :count, :count, :count]
    return found, shells_of(series)[:, count:].sum(axis=1)


@dataclass(frozen=True, eq=False)
class Condition(Rows):
    """A condition on boxes, which is positive where a level does not count.

    series        the condition itself
    remainder     (n,) bounds of the error of the series
    steepness     (n,) bounds of the sum of the magnitudes of its derivatives in x
    error         (n,) maximum error of computed values
    """

    series: BoxSeries
    remainder: Floats
    steepness: Floats
    error: Floats

    @staticmethod
    def of(model: ChebyshevModel) -> Condition:
        """A condition with a model."""
        remainder = model.series_remainder
        steep = 3.0 * (model.sizes[1] + remainder[1])
        return Condition(BoxSeries.of(model.coefficients), remainder[0], steep, model.error)

    def on_side(self, axis: int, side: int) -> Condition:
        """Those of halves along an axis on one side."""
        remainder = self.remainder + self.series.rounding
        return replace(self, series=self.series.on_side(axis, side), remainder=remainder)

    def shortened(self, share: float) -> Condition:
        """The series without terms of high degrees, at most a share of its range, which count as remainder."""
        tails = tails_of(shells_of(self.series.coefficients))[0]
        count = max(1, int(np.count_nonzero((tails / self.series.range[:, None]).max(axis=0) > share)))
        if count >= self.series.count:
            return self
        return replace(self, series=self.series.shortened(count), remainder=self.remainder + tails[:, count])

    def halved(self) -> Condition:
        """The same in the coordinates of boxes of half the size."""
        return replace(self, steepness=0.5 * self.steepness)

    @property
    def _room(self) -> Floats:
        """(n,) how far values may be from the mean of the series."""
        return np.asarray(self.series.range + self.remainder + self.error)

    @property
    def is_positive(self) -> Bools:
        """(n,) whether the level counts nowhere in a box."""
        return np.asarray(self.series.mean > self._room)

    @property
    def is_positive_in_eighths(self) -> Bools:
        """(n, 8) whether the level counts nowhere in an eighth of a box."""
        mean, reach = self.series.in_eighths()
        return np.asarray(mean > reach + (self.remainder + self.error)[:, None])

    def in_kernels(self, excess: Floats) -> Floats:
        """(n, 2) as in SeriesBoxes, with errors smaller by (n,)."""
        counts = self.series.mean < -self._room
        open_ends = np.stack([self.error - excess, self.steepness / ROOM], axis=1)
        return np.where(counts[:, None], (-1.0, 0.0), open_ends)


def lacking(bounds: Floats) -> Floats:
    """(n,) errors (ORDERS, n) of quantities in a box of a picture, relative to which their range must be large."""
    return np.asarray(np.maximum(_PIXELS * bounds[0], bounds[1]))
