"""The Modified bases in any arithmetic, written from their definition (Karniadakis and Sherwin, 2005, chapter 3).

Shares no line with `elvis.core.polynomials`, but for the order in which modes are stored, so that tables in
fractions or in extended precision say what coefficients in a file mean.
"""

import numpy as np

from elvis.core.polynomials.expansion import mode_indices
from elvis.core.shapes import Shape


def jacobi(n, alpha, z):
    """P_n^{alpha, 1}(z) of an integer alpha, by the sum over binomials; ``z`` any kind of number, or an array."""
    total = 0 * z
    low, high = (z - 1) / 2, (z + 1) / 2
    for s in range(n + 1):
        total = total + _binomial(n + alpha, n - s) * _binomial(n + 1, s) * low**s * high ** (n - s)
    return total


def _binomial(n, k):
    result = 1
    for j in range(k):
        result = result * (n - j) // (j + 1)
    return result


def modified_a(p, z):
    """The factor along a line: two vertices, then bubbles."""
    low, high = (1 - z) / 2, (1 + z) / 2
    if p == 0:
        return low
    return high if p == 1 else low * high * jacobi(p - 2, 1, z)


def modified_b(p, q, z):
    """The factor along the collapsed direction of a triangle."""
    low, high = (1 - z) / 2, (1 + z) / 2
    if p == 0:
        return modified_a(q, z)
    return low**p if q == 0 else low**p * high * jacobi(q - 1, 2 * p - 1, z)


def modified_pyramid(p, q, r, z):
    """The factor along the height of a pyramid."""
    if p < 2 or q < 2:
        return modified_b(q if p == 0 else max(1, q) if p == 1 else p, r, z)
    low, high = (1 - z) / 2, (1 + z) / 2
    degree = p + q - 2
    return low**degree if r == 0 else low**degree * high * jacobi(r - 1, 2 * (p + q) - 3, z)


def mode(shape, index, eta):
    """One mode at collapsed coordinates ``eta``, a sequence with one number or array for each direction."""
    if shape in (Shape.QUADRILATERAL, Shape.HEXAHEDRON):
        factors = [modified_a(p, z) for p, z in zip(index, eta, strict=True)]
    elif shape is Shape.TRIANGLE:
        factors = _triangle(index, eta)
    elif shape is Shape.PRISM:
        factors = [modified_a(index[1], eta[1]), *_triangle((index[0], index[2]), (eta[0], eta[2]))]
    elif shape is Shape.PYRAMID:
        p, q, r = index
        # the apex is one function: what has a factor along the base belongs to it
        base = [] if (p, q, r) == (0, 0, 1) else [modified_a(p, eta[0]), modified_a(q, eta[1])]
        factors = [*base, modified_pyramid(p, q, r, eta[2])]
    else:
        p, q, r = index
        apex, edge = (p, q, r) == (0, 0, 1), (p, q) == (0, 1)
        first = [] if apex or edge else [modified_a(p, eta[0])]
        second = [] if apex else [modified_b(p, q, eta[1])]
        factors = [*first, *second, modified_b(p + q, r, eta[2])]
    result = factors[0]
    for factor in factors[1:]:
        result = result * factor
    return result


def _triangle(index, eta):
    """Factors along a triangle's directions; the collapsed vertex is one function."""
    p, q = index
    first = [] if (p, q) == (0, 1) else [modified_a(p, eta[0])]
    return [*first, modified_b(p, q, eta[1])]


def uncollapsed(shape, eta):
    """Reference coordinates of collapsed ones, in the arithmetic of ``eta``."""

    def folded(first, last):
        return (1 + first) * (1 - last) / 2 - 1

    if shape is Shape.TRIANGLE:
        return [folded(eta[0], eta[1]), eta[1]]
    if shape is Shape.PRISM:
        return [folded(eta[0], eta[2]), eta[1], eta[2]]
    if shape is Shape.PYRAMID:
        return [folded(eta[0], eta[2]), folded(eta[1], eta[2]), eta[2]]
    if shape is Shape.TETRAHEDRON:
        middle = folded(eta[1], eta[2])
        return [(1 + eta[0]) * (1 - eta[1]) * (1 - eta[2]) / 4 - 1, middle, eta[2]]
    return list(eta)


def table(expansion, eta):
    """Values (m,) of all modes at one collapsed point, or (m, n) at n points given by coordinate."""
    return np.array([mode(expansion.shape, tuple(index), eta) for index in mode_indices(expansion).tolist()])
