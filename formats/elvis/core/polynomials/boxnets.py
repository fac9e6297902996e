"""Tensor Bernstein nets over boxes of collapsed coordinates, which can be bisected.

On every shape, a polynomial of the format is a polynomial in the collapsed coordinates eta.  A tensor Bernstein net on
the box of eta therefore bounds it, and de Casteljau's rule splits that box.  Nets are (n, D1, …, Dd): direction i of
eta along axis 1 + i, one more coefficient than the degree there.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import comb

import numpy as np

from elvis.core.base.arrays import Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.polynomials.bernstein import BernsteinSpace, line_tables
from elvis.core.polynomials.row_products import row_products
from elvis.core.shapes import Shape

#: parts of a box's length at which `parts_of_boxes` may begin and end, and the largest degree for which that is exact
GRID, EXACT = 8, 17

#: for each direction of eta those whose powers lower the degree in it, on shapes whose spaces aren't tensor products
_SHRINKING: dict[Shape, tuple[tuple[int, ...], ...]] = {
    Shape.TRIANGLE: ((1,), ()),
    Shape.TETRAHEDRON: ((1, 2), (2,), ()),
    Shape.PRISM: ((2,), (), ()),
}


def box_degrees(space: BernsteinSpace) -> tuple[int, ...]:
    """Degree of the space in each direction of eta."""
    d = space.degrees
    if space.shape is Shape.PRISM:
        return d[0], d[1], d[0]
    return d * space.shape.dimension if len(d) < space.shape.dimension else d


def box_nets(space: BernsteinSpace, coefficients: Floats) -> Floats:
    """(n, D1, …, Dd) tensor Bernstein nets on the box of eta, from Bernstein coefficients (n, count)."""
    sizes = tuple(degree + 1 for degree in box_degrees(space))
    if space.shape in _SHRINKING:
        return row_products(coefficients, _to_box(space)).reshape(len(coefficients), *sizes)
    net = coefficients.reshape(len(coefficients), *sizes[::-1])
    return np.ascontiguousarray(net.transpose(0, *range(len(sizes), 0, -1)))


def difference(one: Floats, other: Floats) -> Floats:
    """(n, D1, …, Dd) nets of the difference of polynomials, of degrees that may differ, with nets (n, …) each."""
    for axis in range(1, one.ndim):
        degree = max(one.shape[axis], other.shape[axis]) - 1
        one, other = (raised(nets, axis, degree) for nets in (one, other))
    return one - other


def total(one: Floats, other: Floats) -> Floats:
    """(n, D1, …, Dd) nets of the sum of polynomials, of degrees that may differ."""
    return difference(one, -other)


def product(one: Floats, other: Floats) -> Floats:
    """(n, D1, …, Dd) nets of the product of polynomials with nets (n, …) each, whose degrees add up.

    In each direction b_i^p b_j^q = C(p, i) C(q, j) / C(p + q, i + j) b_(i+j)^(p+q) (Farin, Curves and Surfaces for
    CAGD, section 6.10).
    """
    sizes = [a + b - 1 for a, b in zip(one.shape[1:], other.shape[1:], strict=True)]
    one, other = _with_binomials(one, 1.0), _with_binomials(other, 1.0)
    found = np.zeros((max(len(one), len(other)), *sizes))
    for index in np.ndindex(*one.shape[1:]):
        place = tuple(slice(first, first + count) for first, count in zip(index, other.shape[1:], strict=True))
        factor = one[(slice(None), *index)].reshape(-1, *(1,) * len(index))
        found[(slice(None), *place)] += factor * other
    return _with_binomials(found, -1.0)


def _with_binomials(nets: Floats, power: float) -> Floats:
    """The nets, each coefficient times a power of the binomial coefficients of its indices."""
    for axis in range(1, nets.ndim):
        degree = nets.shape[axis] - 1
        binomials = np.array([float(comb(degree, k)) for k in range(degree + 1)]) ** power
        nets = nets * binomials.reshape(-1, *(1,) * (nets.ndim - 1 - axis))
    return nets


def raised(nets: Floats, axis: int, degree: int) -> Floats:
    """The nets in a higher degree along an axis."""
    own = nets.shape[axis] - 1
    if own == degree:
        return nets
    matrix = np.array([power_net(power, own, degree) for power in range(own + 1)])
    return np.moveaxis(row_products(np.moveaxis(nets, axis, -1), matrix), -1, axis)


def nets_through(values: Floats, places: Floats, dimension: int, degree: int | None = None) -> Floats:
    """(n, D, …, D) nets of the polynomials with values (n, q^dimension) on the lattice of places (q,) in [0, 1].

    The last direction runs fastest.  They are fitted by least squares if ``degree`` is less than q - 1.
    """
    count = len(places)
    is_full = degree is None or degree == count - 1
    table = line_tables(count - 1 if degree is None else degree, places)[0]
    inverse = np.linalg.inv(table) if is_full else np.linalg.pinv(table)
    nets = values.reshape(-1, *(count,) * dimension)
    for axis in range(dimension):
        nets = np.moveaxis(row_products(np.moveaxis(nets, 1 + axis, -1), inverse.T), -1, 1 + axis)
    return nets


def on_lattice(nets: Floats, places: Floats) -> Floats:
    """(n, q, …, q) values of nets (n, D1, …, Dd) on the lattice of places (q,) in [0, 1]."""
    for axis in range(1, nets.ndim):
        table = line_tables(nets.shape[axis] - 1, places)[0]
        nets = np.moveaxis(np.moveaxis(nets, axis, -1) @ table.T, -1, axis)
    return nets


def corners(nets: Floats) -> Floats:
    """(n, 2^d) values at the corners of the boxes, where the net is the polynomial; the last direction runs fastest."""
    ends = [[0, -1]] * (nets.ndim - 1)
    return nets[np.ix_(range(len(nets)), *ends)].reshape(len(nets), 2 ** len(ends))


def halves(nets: Floats, axis: int) -> tuple[Floats, Floats]:
    """Nets of the lower and of the upper halves of the boxes in one direction, 0 to d - 1."""
    moved = np.ascontiguousarray(np.moveaxis(nets, 1 + axis, -1))
    lower, upper = (row_products(moved, splitter) for splitter in _splitters(nets.shape[1 + axis] - 1))
    return np.moveaxis(lower, -1, 1 + axis), np.moveaxis(upper, -1, 1 + axis)


def all_halves(nets: Floats) -> Floats:
    """(2^d n, D1, …, Dd) nets of the halves in every direction."""
    for axis in range(nets.ndim - 1):
        nets = np.concatenate(halves(nets, axis))
    return nets


def all_half_boxes(low: Floats, high: Floats) -> tuple[Floats, Floats]:
    """(2^d n, d) ends of the halves of boxes (n, d) in every direction, in the order of `all_halves`."""
    for axis in range(low.shape[1]):
        middle = (low[:, axis] + high[:, axis]) / 2
        upper, lower = low.copy(), high.copy()
        upper[:, axis], lower[:, axis] = middle, middle
        low, high = np.concatenate([low, upper]), np.concatenate([lower, high])
    return low, high


def parts_of_boxes(nets: Floats, axis: int, low: Ints, high: Ints) -> Floats:
    """Nets of the parts of boxes from low / GRID to high / GRID (n,) of their lengths in one direction, 0 to d - 1."""
    moved = np.moveaxis(nets, 1 + axis, -1)
    shape = moved.shape
    flat = moved.reshape(len(nets), -1, shape[-1])
    return np.moveaxis((flat @ _restrictions(shape[-1] - 1)[low, high]).reshape(shape), -1, 1 + axis)


@bounded_cache
def _restrictions(degree: int) -> Floats:
    """(GRID + 1, GRID + 1, D, D) matrices from the right that give the nets of parts from and to a place of the grid.

    Coefficient j of a part from a to b is the blossom at a, degree - j times, and b, j times: the sum over s of
    b_s^j(b) b_(i-s)^(degree-j)(a) times coefficient i.  Entries are multiples of GRID^-degree, exact up to EXACT.
    """
    n = degree + 1
    lines = [_whole_line(k) for k in range(n)]
    found = np.zeros((GRID + 1, GRID + 1, n, n), np.int64)
    for j in range(n):
        upper, lower = lines[j], lines[degree - j]
        for s in range(j + 1):
            for r in range(degree - j + 1):
                found[:, :, s + r, j] += lower[:, None, r] * upper[None, :, s]
    return frozen_floats(found / GRID**degree)


def _whole_line(degree: int) -> Ints:
    """(GRID + 1, degree + 1) Bernstein polynomials at the places of the grid, times GRID^degree."""
    t, power = np.arange(GRID + 1)[:, None], np.arange(degree + 1)
    choices = np.array([comb(degree, k) for k in range(degree + 1)])
    return np.asarray(choices * t**power * (GRID - t) ** (degree - power))


@bounded_cache
def _splitters(degree: int) -> tuple[Floats, Floats]:
    """(D, D) matrices from the right that give the nets of the lower and of the upper half; entries are exact."""
    n = degree + 1
    lower = np.array([[comb(i, j) / 2**i for i in range(n)] for j in range(n)])
    return frozen_floats(lower), frozen_floats(lower[::-1, ::-1])


@bounded_cache
def _to_box(space: BernsteinSpace) -> Floats:
    """(count, D1 … Dd) every function of the space as a tensor net: its factors, raised to the full degrees."""
    matrix = np.ones((space.count, 1))
    for factors in _raised_factors(space):
        matrix = (matrix[:, :, None] * factors[:, None, :]).reshape(space.count, -1)
    return frozen_floats(matrix)


def _raised_factors(space: BernsteinSpace) -> Iterator[Floats]:
    """For each direction of eta the (count, D) net of the factor of each function.

    On a tetrahedron b_k^p(t3) b_j^(p-k)(s2) b_i^(p-j-k)(s1): the powers of the later directions lower the degree.
    """
    lowering = _SHRINKING[space.shape]
    for direction, degree in enumerate(box_degrees(space)):
        powers = space.powers[:, direction]
        lowered = degree - space.powers[:, list(lowering[direction])].sum(axis=1)
        yield np.array([power_net(int(i), int(q), degree) for i, q in zip(powers, lowered, strict=True)])


def power_net(power: int, degree: int, target: int) -> list[float]:
    """b_power^degree in the Bernstein basis of degree ``target``."""
    steps = target - degree
    return [
        comb(degree, power) * comb(steps, k - power) / comb(target, k) if 0 <= k - power <= steps else 0.0
        for k in range(target + 1)
    ]
