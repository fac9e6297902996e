"""The mean of quasi-3D data along their Fourier direction: the mean mode, as plane data."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from elvis.core.arrays import frozen_floats
from elvis.core.dataset import Block, Dataset, Field
from elvis.core.errors import ElvisError


def fourier_mean(dataset: Dataset, axis: str) -> Dataset:
    """The mean of all fields along a Fourier direction.

    Parameters
    ----------
    dataset : Dataset
        Fields with one Fourier direction, z of plane elements, y of lines.
    axis : str
        ``x``, ``y`` or ``z``.

    Returns
    -------
    Dataset
        The same mesh with fields without this direction: the coefficients of wave number 0, exact, as all other modes
        have the mean zero.

    Raises
    ------
    ElvisError
        If the data have no Fourier direction along the axis, or two.
    """
    waves = [block.expansion.homogeneous for own in dataset.fields for block in own.blocks]
    found = {len(own.lengths) for own in waves if own is not None}
    along = "xyz"[dataset.mesh.dimension] if dataset.mesh.dimension < 3 else ""
    if not found or axis != along:
        known = f"one along {along}" if found else "none"
        raise ElvisError(f"--direction {axis}: expected data with a Fourier direction along {axis}, found {known}")
    if found != {1}:
        raise ElvisError(f"--direction {axis}: expected one Fourier direction, found {max(found)}")
    fields = tuple(replace(own, blocks=tuple(_means(own))) for own in dataset.fields)
    return replace(dataset, fields=fields)


def _means(field: Field) -> Iterator[Block]:
    """The blocks of a field without their Fourier direction."""
    for block in field.blocks:
        waves = block.expansion.homogeneous
        if waves is None:
            yield block
            continue
        planes = block.coefficients.reshape(len(block), len(waves.z_ids), -1)
        # the number of the wave's plane: 0 is the constant, whatever the basis
        is_constant = np.array(waves.z_ids) == 0
        mean = planes[:, is_constant].sum(axis=1)
        yield Block(replace(block.expansion, homogeneous=None), block.element_ids, frozen_floats(mean))
