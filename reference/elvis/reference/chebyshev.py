"""Bounds of polynomials from their values at Chebyshev points, with which the reference proves its exclusions.

The maximum of a polynomial of degree n is at most its largest value at the zeros of the Chebyshev polynomial of degree
m > n, divided by cos(pi n / 2 m) (Ehlich and Zeller, Schwankung von Polynomen zwischen Gitterpunkten, 1964); several
variables need such a divisor for each.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.data.dataset import Expansion
from elvis.core.mapping.patch import Patch
from elvis.core.shapes import Shape

#: samples for each degree
SAMPLES = 2
#: degree that is taken of waves in a box, and of maps that aren't polynomials
GUESSED = 4
#: relative widening of bounds for rounding
_ROUNDING = 1e-12


def map_degrees(patch: Patch) -> tuple[int, ...]:
    """Degrees of the map in each collapsed coordinate, Fourier directions included."""
    return degrees_of(patch, patch.geometry if patch.geometry_coefficients.shape[2] else None)


def degrees_of(patch: Patch, expansion: Expansion | None) -> tuple[int, ...]:
    """Degrees of modes in each collapsed coordinate, Fourier directions included.

    None for functions that are not polynomials.
    """
    waves = (GUESSED,) * len(patch.periods)
    if expansion is None:
        return (GUESSED,) * patch.shape.dimension + waves
    own = [modes - 1 for modes in expansion.modes]
    if patch.shape is Shape.PYRAMID:
        own[2] = max(own[2], own[0] + own[1])
    return (*own, *waves)


@bounded_cache
def lattice(degrees: tuple[int, ...]) -> tuple[Floats, float]:
    """Points (k, d) of [-1, 1]^d for polynomials of these degrees, and how much greater than there they may be."""
    divisor = 1.0
    for degree in degrees:
        divisor *= np.cos(np.pi * degree / (2 * max(1, SAMPLES * degree)))
    lines = lattice_lines(degrees)
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
    return frozen_floats(points.reshape(-1, len(lines))), float(divisor)


@bounded_cache
def lattice_lines(degrees: tuple[int, ...]) -> tuple[Floats, ...]:
    """For each direction the coordinates (k_i,) of the points of `lattice`, where the last one is fastest."""
    return tuple(frozen_floats(chebyshev.chebpts1(max(1, SAMPLES * degree))) for degree in degrees)


def bounds_of(values: Floats, divisor: float) -> tuple[Floats, Floats]:
    """Bounds (...,) of polynomials from their values (..., k) at a lattice; NaN values give no bounds."""
    low, high = values.min(axis=-1), values.max(axis=-1)
    middle, half = 0.5 * (low + high), 0.5 * (high - low) / divisor
    half += _ROUNDING * (np.abs(middle) + half)
    return middle - half, middle + half
