"""Curvature of polynomials on and near tetrahedra, from their values at a lattice of points.

Chebyshev series need a cube around a tetrahedron, in whose far corner polynomials are much larger than on it.  So
derivatives of all orders are bounded on the tetrahedron itself, by Bernstein coefficients.  With the sums S_m of the
bounds of all derivatives of order m, Taylor's formula bounds the derivatives of order j within the complex distance R
of it, in each coordinate, by

    sum over k of R^k / k! S_(j + k)
"""

from __future__ import annotations

from math import factorial

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values, differentiate
from elvis.core.shapes import Shape

#: distances from a tetrahedron that bends are known in, in reference coordinates, as many as in volume_enclose.slang
RADII = (0.01, 0.03, 0.08, 0.2, 0.5, 1.0, 2.0, 5.0, 12.0)
#: places on rays may be so far outside of their elements
_OUTSIDE = 1e-5
#: unit roundoff, and tolerance, relative to the maximum value, for values off the lattice
_UNIT, _ALIKE = 2.0**-53, 1e-6


def nodes(degree: int) -> Floats:
    """Positions (degree + 1,) on [-1, 1] whose lattice in the tetrahedron determines polynomials of a degree."""
    return np.linspace(-1.0, 1.0, degree + 1)


def tetrahedron_bends(values: Floats, errors: Floats, degree: int) -> Floats | None:
    """(n, leaves, radii, 2) sums of first and of second derivatives of n times some polynomials around tetrahedra.

    values  (n, leaves, (degree + 1)^3) at the lattice of nodes of the cube, the first direction running fastest
    errors  (n, leaves) of these

    None where the polynomials have a greater degree in all coordinates together.
    """
    own = nodes(degree)
    z, y, x = np.meshgrid(own, own, own, indexing="ij")
    lattice = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    inside = lattice.sum(axis=1) <= -1.0 + 1e-9
    space = BernsteinSpace(Shape.TETRAHEDRON, (degree,))
    tables = bernstein_values(space, lattice)
    inverse = np.linalg.inv(tables[inside])
    nets = values[..., inside] @ inverse.T
    most = np.abs(values).max(axis=2, initial=0.0)
    if (np.abs(nets @ tables.T - values) > _ALIKE * most[..., None]).any():
        return None
    rounding = (space.count + 2) * _UNIT * np.abs(values[..., inside]).max(axis=2, initial=0.0)
    slack = np.abs(inverse).sum(axis=1).max() * (errors + rounding)
    sums = _sums(space, nets, slack)
    found = np.zeros((*nets.shape[:2], len(RADII), 2))
    for place, radius in enumerate(RADII):
        for order in (1, 2):
            for k in range(degree + 1 - order):
                found[:, :, place, order - 1] += (radius + _OUTSIDE) ** k / factorial(k) * sums[order + k - 1]
    return found * (1.0 + 1e-12)


def _sums(space: BernsteinSpace, nets: Floats, slack: Floats) -> list[Floats]:
    """For each order from 1 to the degree, sums (n, leaves) of bounds of all derivatives of nets (n, leaves, count).

    slack  (n, leaves) errors of the nets: a derivative's errors are at most the degree times these
    """
    degree = space.degrees[0]
    derivatives = {(0, 0, 0): (space, nets)}
    sums: list[Floats] = []
    for order in range(1, degree + 1):
        slack = (degree + 1 - order) * slack
        following = dict[tuple[int, int, int], tuple[BernsteinSpace, Floats]]()
        total = 3.0**order * slack
        for powers, (lower, net) in derivatives.items():
            last = max((axis for axis in range(3) if powers[axis]), default=0)
            for axis in range(last, 3):
                more = tuple(power + (k == axis) for k, power in enumerate(powers))
                following[more[0], more[1], more[2]] = differentiate(lower, net, axis)
        for powers, (_, net) in following.items():
            times = factorial(order) // np.prod([factorial(power) for power in powers])
            total = total + times * np.abs(net).max(axis=2)
        derivatives = following
        sums.append(total)
    return sums
