"""Polynomials of degree 2 in each of three directions."""

import numpy as np

#: powers of the terms in each direction
POWERS = np.array([[k % 3, k // 3 % 3, k // 9] for k in range(27)])


def jets_of(coefficients, s):
    """Values and derivatives (n, p, l, 4) of polynomials (n, l, 27) at points (n, p, 3), also complex ones."""
    powers = np.stack([np.ones_like(s), s, s**2], axis=-1)
    slopes = np.stack([np.zeros_like(s), np.ones_like(s), 2 * s], axis=-1)
    jets = []
    for axis in (None, 0, 1, 2):
        lines = [(slopes if k == axis else powers)[:, :, k][..., POWERS[:, k]] for k in range(3)]
        jets.append(np.einsum("npt,nlt->npl", np.prod(lines, axis=0), coefficients))
    return np.stack(jets, axis=-1)
