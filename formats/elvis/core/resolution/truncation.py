"""Fields without their highest modes: projections to one order less, in the inner product of the reference shape.

On elements with an affine map this is the L2 projection in space; on curved ones it is weighted by the inverse of the
Jacobian.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from elvis.core.arrays import Floats, frozen_floats
from elvis.core.dataset import Block, Field
from elvis.core.errors import ElvisError
from elvis.core.mapping.orientation import chunks
from elvis.core.resolution.modal_bases import ModalBasis, modal_basis

#: elements whose coefficients are transformed together
_TOGETHER = 1 << 12


def truncated(field: Field, name: str) -> Field:
    """The field without the highest modes of each element, under another name; ElvisError with Fourier directions.

    It has the expansions of the field, so that both are exact in one space.  Elements of order 0 keep their values.
    """
    return _mapped(field, name, lambda basis, coefficients: basis.truncated(coefficients))


def removed_part(field: Field, name: str) -> Field:
    """The difference of a field and its `truncated` field, under another name."""
    return _mapped(field, name, lambda basis, coefficients: coefficients - basis.truncated(coefficients))


def _mapped(field: Field, name: str, change: Callable[[ModalBasis, Floats], Floats]) -> Field:
    """A field with other coefficients."""
    blocks = []
    for block in field.blocks:
        try:
            basis = modal_basis(block.expansion)
        except ElvisError as error:
            raise ElvisError(f"{field.name}: {error}") from error
        found = np.empty(block.coefficients.shape)
        for part in chunks(len(block), _TOGETHER):
            found[part] = change(basis, block.coefficients[part])
        blocks.append(Block(block.expansion, block.element_ids, frozen_floats(found)))
    return replace(field, name=name, blocks=tuple(blocks), continuous=None)
