"""Error bounds of computed Bernstein coefficients and nets, in 64-bit floats.

A product or sum of floats has a relative error of at most u = 2^-53.  A result after k of them has an error of at most
gamma_k = k u / (1 - k u) times the sum of its terms' magnitudes, for any order of summation (Higham 2002, Accuracy and
Stability of Numerical Algorithms, 3.1 to 3.5).  Nets are weighted means of other nets, with weights that aren't
negative and sum to 1: halves, parts, raised degrees, values.  Magnitudes don't grow there, so the error of a net is at
most the roundings of its weights and sums times its largest magnitude.  Denormal numbers are ignored.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_coefficients
from elvis.core.shapes import TENSOR, Shape

#: unit roundoff of 64-bit floats
UNIT = 2.0**-53
#: unit roundings of a power t^k as libraries compute it, in vector registers too: 4 units in the last place
POWER = 8
#: roundings of a weight that raises a degree (`boxnets.power_net`): two products of integers, and a quotient
RAISED = 4


def gamma(roundings: int, unit: float = UNIT) -> float:
    """Maximum error of a number after this number of products and sums, relative to its terms' magnitudes."""
    return roundings * unit / (1 - roundings * unit)


def coefficient_rounding(
    expansion: Expansion, modal: Floats, space: BernsteinSpace | None = None, unit: float = UNIT
) -> Floats:
    """(...,) maximum error of Bernstein coefficients of polynomials with ``modal`` coefficients (..., m)."""
    summed = bernstein_coefficients(expansion, modal, space, magnitudes=True).max(axis=-1, initial=0.0)
    return np.asarray(gamma(coefficient_roundings(expansion, modal.shape[-1]), unit) * summed)


def coefficient_roundings(expansion: Expansion, modes: int) -> int:
    """Roundings of a Bernstein coefficient of a polynomial with this number of modes.

    An entry of the matrix has a quotient and an irrational scale in each direction, 3 roundings, and their product, 1.
    One more covers the rounding of the magnitudes.
    """
    terms = sum(expansion.modes) if expansion.shape in TENSOR else modes
    return terms + 4 * expansion.shape.dimension + 1


def box_roundings(space: BernsteinSpace) -> int:
    """Roundings of a coefficient of `boxnets.box_nets`: each weight is a product of raised ones of its directions."""
    d = space.shape.dimension
    is_collapsed = space.shape in (Shape.TRIANGLE, Shape.TETRAHEDRON, Shape.PRISM)
    return space.count + (RAISED + 1) * d if is_collapsed else 0


def raising_roundings(sizes: Sequence[int]) -> int:
    """Roundings of a coefficient when a net of these sizes per direction is raised to a higher degree."""
    return sum(size + RAISED for size in sizes)


def halving_roundings(sizes: Sequence[int]) -> int:
    """Roundings of a coefficient when a net of these sizes is bisected in every direction: weights are exact."""
    return sum(sizes)


def value_roundings(sizes: Sequence[int]) -> int:
    """Roundings of a value in the box of a net with these numbers of coefficients, one direction after the other.

    A Bernstein function C t^i s^j, 0 <= t <= 1, has s = 1 - t rounded once, j times in its power; two powers; two
    products.
    """
    return sum(size + (size - 1) + 2 * POWER + 3 for size in sizes)
