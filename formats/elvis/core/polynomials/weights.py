"""Weights of the scaled Bernstein form: the binomial or multinomial factor of every coefficient."""

from __future__ import annotations

from math import comb

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.polynomials.bernstein import BernsteinSpace
from elvis.core.shapes import Shape


@bounded_cache
def weights(space: BernsteinSpace) -> Floats:
    """(count,) the factor of each Bernstein function, in coefficient order; exact integers up to 2^53."""
    if space.shape in (Shape.TRIANGLE, Shape.TETRAHEDRON):
        return frozen_floats([_multinomial(space.degrees[0], powers) for powers in space.powers.tolist()])
    if space.shape is Shape.PRISM:
        p, q = space.degrees
        return frozen_floats([_multinomial(p, (i, k)) * comb(q, j) for i, j, k in space.powers.tolist()])
    return frozen_floats(
        [
            np.prod([comb(p, i) for p, i in zip(space.degrees, row, strict=True)], dtype=float)
            for row in space.powers.tolist()
        ]
    )


def _multinomial(degree: int, powers: tuple[int, ...] | list[int]) -> int:
    """degree! / (a! i! j! …) with a the power that is left for the first barycentric coordinate."""
    weight = 1
    for power in powers:
        weight *= comb(degree, power)
        degree -= power
    return weight
