"""Sub-elements of isosurfaces as Chebyshev series of degree 2, and what NumPy knows of them."""

from itertools import product

import numpy as np
from jets import POWERS
from numpy.polynomial import chebyshev

COUNT = 24
ORDER = POWERS.sum(axis=1)
UNIT = 1.2e-16
#: of the kernels: amplification by series with three nodes of a line, rounding of their sums (test_bounds.py)
LEBESGUE = (1 + 0.637 * np.log(np.float32(3))) ** 3
SUMMED = 6 * 9 * 10 * UNIT


def terms_at(c, order):
    """(n, 27) derivatives of all T_i T_j T_k, of some order in x, y and z, at the corner (c, c, c) of cubes c (n,)."""
    lines = [np.stack([chebyshev.chebval(c, chebyshev.chebder(row, m)) for row in np.eye(3)], axis=-1) for m in order]
    return np.prod([line[..., POWERS[:, axis]] + 0.0 * c[:, None] for axis, line in enumerate(lines)], axis=0)


class SubElements:
    """Random series of map and field over sub-elements (n, 27, 4), and what the kernel is told of them."""

    def __init__(self, rng, bent):
        self.c, self.error, self.amplification = rng.uniform([[1.0], [0.1], [1.0]], [[1.5], [0.2], [2.0]], (3, COUNT))
        self.series = bent * rng.uniform(-1, 1, (COUNT, 27, 4)) * 4.0 ** -ORDER[:, None]
        jacobians = 3 * np.eye(3) + rng.uniform(-1, 1, (COUNT, 3, 3))
        self.series[:, ORDER == 1, :3] = jacobians.swapaxes(1, 2)
        self.series[:, ORDER == 1, 3] = rng.uniform(0.5, 1, (COUNT, 3)) * rng.choice([-1, 1], (COUNT, 3))
        self.inverse = np.linalg.inv(jacobians)
        self.gradient = self.series[:, ORDER == 1, 3]
        self.centre, self.half = rng.uniform(-0.7, 0.2, (COUNT, 3)), rng.uniform(0.1, 0.5, (COUNT, 3))
        self.own, self.value = rng.uniform(1e-3, 1e-2, COUNT), rng.uniform(-1, 1, COUNT)
        self.across, self.misplaced = rng.uniform(1, 2, COUNT), rng.uniform(1e-4, 2e-4, COUNT)
        self.perspective = rng.integers(2, size=COUNT).astype(float)
        self.grid_values, self.grid_places = rng.uniform(1e-4, 2e-4, (2, COUNT, 2)) * rng.choice(
            [0.2, 1.0], (2, COUNT, 1)
        )
        self.spread = rng.choice([0.0, 1e-3], COUNT)
        self.aside, self.off = rng.uniform(0.1, 1, (COUNT, 2)), rng.uniform(0.01, 0.02, (COUNT, 3))
        self.most = np.abs(self.series).sum(axis=1) - np.abs(self.series[:, 0])

    def rows(self):
        """As iso_follow_check.slang reads them."""
        alone = [self.own, self.value, self.across, self.misplaced, self.perspective]
        last = [self.spread, self.c, self.error, self.amplification]
        lists = [
            self.centre,
            self.half,
            np.stack(alone, axis=1),
            self.grid_values,
            self.grid_places,
            np.stack(last, axis=1),
        ]
        return np.concatenate([*lists, self.aside, self.off, self.most, self.series.reshape(COUNT, -1)], axis=1)

    def steps(self):
        """(n, 27, 3) terms of the map in steps of s, without the linear part."""
        return np.einsum("nij,ntj->nti", self.inverse, self.series[..., :3])


def outside_of(cases, extent):
    """Sums of the magnitudes of Bernstein polynomials of degree 2, in each direction and on a tetrahedron."""
    sides = np.array(list(product([-1, 1], repeat=3)))
    corners = cases.centre[:, None] + sides * (extent[:, None] * cases.half)[:, None]
    margin = np.minimum(1 + corners.min(axis=2), -1 - corners.sum(axis=2)).min(axis=1)
    return (np.abs(corners).max(axis=1).clip(1).prod(axis=1) * (1 - np.minimum(margin, 0))) ** 2
