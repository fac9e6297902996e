"""How far computed Bernstein coefficients and nets may be from the true ones, in 64-bit floats.

A product or sum of floats is off by at most u = 2^-53 of itself.  What goes through k of them is off by at most
gamma_k = k u / (1 - k u) of the sum of its terms' magnitudes, in whatever order terms are added (Higham 2002, Accuracy
and Stability of Numerical Algorithms, 3.1 to 3.5).  Nets are weighted means of other nets, of weights that aren't
negative and sum to 1: halves, parts, raised degrees, values.  So magnitudes don't grow there, and a net is off by at
most the roundings of its weights and sums times its greatest magnitude.  Denormal numbers are left out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.arrays import Floats
from elvis.core.dataset import Expansion
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_coefficients
from elvis.core.shapes import Shape

#: unit roundoff of 64-bit floats
UNIT = 2.0**-53
#: unit roundings of a power t^k as libraries compute it, in vector registers too: 4 units in the last place
POWER = 8
#: roundings of a weight that raises a degree (`boxnets.power_net`): two products of integers, and a quotient
RAISED = 4


def gamma(roundings: int) -> float:
    """By how much a number may be off after so many products and sums, in parts of its terms' magnitudes."""
    return roundings * UNIT / (1 - roundings * UNIT)


def coefficient_rounding(expansion: Expansion, modal: Floats, space: BernsteinSpace | None = None) -> Floats:
    """(...,) how far Bernstein coefficients may be from those of polynomials with ``modal`` coefficients (..., m).

    An entry of the matrix has a quotient and an irrational scale in each direction, 3 roundings, and their product, 1.
    One more stands for the rounding of the magnitudes.
    """
    summed = bernstein_coefficients(expansion, modal, space, magnitudes=True).max(axis=-1, initial=0.0)
    is_tensor = expansion.shape in (Shape.SEGMENT, Shape.QUADRILATERAL, Shape.HEXAHEDRON)
    terms = sum(expansion.modes) if is_tensor else modal.shape[-1]
    return np.asarray(gamma(terms + 4 * expansion.shape.dimension + 1) * summed)


def box_roundings(space: BernsteinSpace) -> int:
    """Roundings of a coefficient of `boxnets.box_nets`: each weight is a product of raised ones of its directions."""
    d = space.shape.dimension
    is_collapsed = space.shape in (Shape.TRIANGLE, Shape.TETRAHEDRON, Shape.PRISM)
    return space.count + (RAISED + 1) * d if is_collapsed else 0


def raising_roundings(sizes: Sequence[int]) -> int:
    """Roundings of a coefficient of a net with so many each way that is raised to a higher degree."""
    return sum(size + RAISED for size in sizes)


def halving_roundings(sizes: Sequence[int]) -> int:
    """Roundings of a coefficient of a half in every direction, of a net with so many each way: weights are exact."""
    return sum(sizes)


def value_roundings(sizes: Sequence[int]) -> int:
    """Roundings of a value of a net with so many coefficients each way, in its box, one direction after the other.

    A Bernstein function C t^i s^j, 0 <= t <= 1, has s = 1 - t rounded once, j times in its power; two powers; two
    products.
    """
    return sum(size + (size - 1) + 2 * POWER + 3 for size in sizes)
