"""Plane data out of quasi-3D ones: their mean along the Fourier direction, and their values on a plane across it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from elvis.core.arrays import Floats, frozen_floats
from elvis.core.dataset import Block, Dataset, Field, Homogeneous
from elvis.core.errors import ElvisError
from elvis.core.polynomials.expansion import wave_values


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
    _check(dataset, axis, f"--direction {axis}")
    # the number of the wave's plane: 0 is the constant, whatever the basis
    return _combined(dataset, lambda waves: (np.array(waves.z_ids) == 0).astype(np.float64))


def fourier_plane(dataset: Dataset, axis: str, place: float) -> Dataset:
    """All fields on a plane across a Fourier direction, exact; ElvisError as `fourier_mean`.

    place  coordinate of the plane, of any period
    """
    _check(dataset, axis, f"a plane at {axis} = {place:g}")

    def factors(waves: Homogeneous) -> Floats:
        zeta = 2 * (place / waves.lengths[0]) - 1
        return np.asarray(wave_values(waves, np.array([[zeta]]))[0])

    return _combined(dataset, factors)


def _check(dataset: Dataset, axis: str, what: str) -> None:
    """ElvisError for data without one Fourier direction along an axis."""
    waves = [block.expansion.homogeneous for own in dataset.fields for block in own.blocks]
    found = {len(own.lengths) for own in waves if own is not None}
    along = "xyz"[dataset.mesh.dimension] if dataset.mesh.dimension < 3 else ""
    if not found:
        raise ElvisError(f"{what}: expected data with a Fourier direction, found none")
    if axis != along:
        raise ElvisError(f"{what}: expected data with a Fourier direction along {axis}, found one along {along}")
    if found != {1}:
        raise ElvisError(f"{what}: expected one Fourier direction, found {max(found)}")


def _combined(dataset: Dataset, weights: Callable[[Homogeneous], Floats]) -> Dataset:
    """Fields whose planes of coefficients are added up with weights (planes,)."""
    return replace(dataset, fields=tuple(replace(own, blocks=tuple(_sums(own, weights))) for own in dataset.fields))


def _sums(field: Field, weights: Callable[[Homogeneous], Floats]) -> Iterator[Block]:
    """The blocks of a field without their Fourier direction."""
    for block in field.blocks:
        waves = block.expansion.homogeneous
        if waves is None:
            yield block
            continue
        planes = block.coefficients.reshape(len(block), len(waves.z_ids), -1)
        found = np.einsum("p,npm->nm", weights(waves), planes)
        yield Block(replace(block.expansion, homogeneous=None), block.element_ids, frozen_floats(found))
