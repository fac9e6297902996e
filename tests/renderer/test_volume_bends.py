"""How much polynomials bend around tetrahedra: bounds against derivatives at complex points, each of their terms."""

from itertools import product

import numpy as np
import pytest

from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_values
from elvis.core.shapes import Shape
from elvis.renderer.passes.volume.simplex_bends import RADII, nodes, tetrahedron_bends

ORDERS = (1, 2)


def polynomial(rng, degree):
    """Powers (m, 3) of a total degree, and random coefficients (m,)."""
    powers = np.array([p for p in product(range(degree + 1), repeat=3) if sum(p) <= degree])
    return powers, rng.normal(size=len(powers))


def derivative(powers, coefficients, axis):
    """Likewise of the derivative along an axis."""
    lower = powers.copy()
    lower[:, axis] = np.maximum(lower[:, axis] - 1, 0)
    return lower, coefficients * powers[:, axis]


def values(powers, coefficients, points):
    """(n,) at points (n, 3), real or complex."""
    return np.prod(points[:, None, :] ** powers, axis=2) @ coefficients


def lattice_of(degree):
    """((degree + 1)^3, 3) the lattice of nodes, the first direction running fastest."""
    own = nodes(degree)
    z, y, x = np.meshgrid(own, own, own, indexing="ij")
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


def points_near(rng, radius, count=40):
    """Complex points (n, 3) that are a distance in each coordinate from a corner, or any point, of the tetrahedron."""
    corners = np.array([[-1.0, -1, -1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    weights = np.concatenate([np.eye(4), rng.dirichlet(np.ones(4), count)])
    angles = rng.uniform(0, 2 * np.pi, (len(weights), 3))
    real = np.repeat(weights, 3, axis=0) @ corners
    ways = np.concatenate([np.exp(1j * angles), np.ones((len(weights), 3)), -np.ones((len(weights), 3))])
    return real.reshape(-1, 3, 3).swapaxes(0, 1).reshape(-1, 3) + radius * ways


def sums(powers, coefficients, points, order):
    """(n,) sums of the magnitudes of all derivatives of an order."""
    total = np.zeros(len(points))
    for axes in product(range(3), repeat=order):
        own = powers, coefficients
        for axis in axes:
            own = derivative(*own, axis)
        total += np.abs(values(*own, points))
    return total


@pytest.mark.parametrize("degree", [1, 2, 3, 5])
def test_derivatives_around_tetrahedra_are_within_their_bounds(degree):
    rng = np.random.default_rng(degree)
    lattice = lattice_of(degree)
    for _ in range(2):
        own = polynomial(rng, degree)
        found = tetrahedron_bends(values(*own, lattice)[None, None], np.zeros((1, 1)), degree)
        for place, order in product(range(len(RADII)), ORDERS):
            greatest = sums(*own, points_near(rng, RADII[place]), order).max()
            assert greatest <= found[0, 0, place, order - 1]


def test_one_power_has_its_own_bounds():
    """x^4 at a distance R of the corner 1 has the derivatives 4 (1 + R)^3 and 12 (1 + R)^2: no term may be left out."""
    found = tetrahedron_bends((lattice_of(4)[:, 0] ** 4)[None, None], np.zeros((1, 1)), 4)[0, 0]
    radii = np.array(RADII)
    assert (found[:, 0] >= 4 * (1 + radii) ** 3).all()
    assert (found[:, 1] >= 12 * (1 + radii) ** 2).all()
    assert found[:, 0] == pytest.approx(4 * (1 + radii) ** 3, rel=1e-3, abs=0)
    assert found[:, 1] == pytest.approx(12 * (1 + radii) ** 2, rel=1e-3, abs=0)


@pytest.mark.parametrize("order", ORDERS)
def test_errors_of_values_widen_bounds(order):
    """Values off by 1 as the worst polynomial has them: the bounds hold that one's derivatives."""
    degree, lattice = 3, lattice_of(3)
    space = BernsteinSpace(Shape.TETRAHEDRON, (degree,))
    inside = lattice.sum(axis=1) <= -1.0 + 1e-9
    inverse = np.linalg.inv(bernstein_values(space, lattice[inside]))
    found = tetrahedron_bends(np.zeros((1, 1, len(lattice))), np.ones((1, 1)), degree)[0, 0]
    point = np.array([[-1.0, -1.0, -1.0]])
    for signs in np.sign(inverse):
        exponents = np.array([p for p in product(range(degree + 1), repeat=3) if sum(p) <= degree])
        table = np.prod(lattice[inside][:, None, :] ** exponents, axis=2)
        own = exponents, np.linalg.solve(table, signs)
        assert sums(*own, point, order)[0] <= found[0, order - 1]


def test_polynomials_of_higher_degree_are_not_treated_as_those_of_tetrahedra():
    lattice = lattice_of(2)
    assert tetrahedron_bends(np.prod(lattice, axis=1)[None, None], np.zeros((1, 1)), 2) is None
