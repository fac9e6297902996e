"""Fields without their highest modes: projections to one order less, in the inner product of the reference shape.

On elements with an affine map this is the L2 projection in space; on curved ones it is weighted by the inverse of the
Jacobian.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Block, Dataset, Field, Rates, rate_name
from elvis.core.mapping.orientation import chunks
from elvis.core.resolution.modal_bases import modal_basis

if TYPE_CHECKING:
    from elvis.core.streamlines.moving import Interval

#: elements whose coefficients are transformed together
_TOGETHER = 1 << 12


def truncated(field: Field, name: str) -> Field:
    """The field without the highest modes of each element, under another name; ElvisError with Fourier directions.

    It has the expansions of the field, so that both are exact in one space.  Elements of order 0 keep their values.
    """
    blocks = []
    for block in field.blocks:
        try:
            basis = modal_basis(block.expansion)
        except ElvisError as error:
            raise ElvisError(f"{field.name}: {error}") from error
        found = np.empty(block.coefficients.shape)
        for part in chunks(len(block), _TOGETHER):
            found[part] = basis.truncated(block.coefficients[part])
        blocks.append(Block(block.expansion, block.element_ids, frozen_floats(found)))
    return replace(field, name=name, blocks=tuple(blocks), continuous=None)


def difference(field: Field, less: Field) -> Field:
    """The difference of two fields in the same expansions, under the name of the first."""
    pairs = zip(field.blocks, less.blocks, strict=True)
    blocks = [replace(own, coefficients=frozen_floats(own.coefficients - other.coefficients)) for own, other in pairs]
    return replace(field, blocks=tuple(blocks), continuous=None)


@dataclass(frozen=True, eq=False)
class TruncatedRates:
    """Derivatives in time of truncated fields: those of the fields, truncated (see `elvis.core.data.dataset.Rates`)."""

    rates: Rates

    @property
    def remark(self) -> str:
        """Description of the derivatives."""
        return self.rates.remark

    @property
    def times(self) -> Floats:
        """(n,) of the steps of the series."""
        return self.rates.times

    def field(self, name: str) -> Field:
        """The derivative of a field."""
        return truncated(self.rates.field(name), rate_name(name))

    def intervals(self, start: float, stop: float) -> Iterator[Interval]:
        """None: the steps of the series still have their highest modes."""
        raise ElvisError("expected fields with their highest modes to follow particles in time, found truncated ones")


def without_top_modes(dataset: Dataset) -> Dataset:
    """The dataset with all fields truncated, under their names; coordinates and other datasets stay unchanged.

    Raises ElvisError for fields with Fourier directions.
    """
    changed = {field.name for field in dataset.solution}
    fields = tuple(truncated(own, own.name) if own.name in changed else own for own in dataset.fields)
    return replace(dataset, fields=fields, rates=None if dataset.rates is None else TruncatedRates(dataset.rates))


def orders_below(dataset: Dataset) -> str:
    """The order of the fields without their highest modes in words: ``of order 6``, or ``one order less``."""
    spaces = [block.expansion for own in dataset.solution for block in own.blocks]
    orders = {count - 1 for space in spaces for count in space.modes}
    return f"of order {max(orders.pop() - 1, 0)}" if len(orders) == 1 else "one order less"
