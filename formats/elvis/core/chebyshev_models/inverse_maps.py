"""Models of the inverses of maps: reference coordinates as polynomials of positions, with bounds of their errors.

The map of an element on a box with the centre c and half side h is x(c + h v).  Let A be MARGIN times the inverse of
its Jacobian at v = 0.  Then M(v) = A (x(c + h v) - x(c)) is close to MARGIN v.  A polynomial P approximates the inverse
of M on [-1, 1]^3, so that its values are in the box, and R(y) = M(P(y)) - y is its residual.

Let D be a convex set that contains the element, and let the Jacobian of M differ from MARGIN times the identity by at
most MARGIN k there, in the maximum norm, k < 1.  Then |M(v) - M(w)| >= MARGIN (1 - k) |v - w| for all points of D.  If
v is the point of the element at y = M(v), and P(y) is in D, then

    |v - P(y)| <= |M(v) - M(P(y))| / (MARGIN (1 - k)) = |R(y)| / (MARGIN (1 - k)).

A bound of the residual on [-1, 1]^3 is therefore enough.  The residual is a polynomial.  Its Chebyshev
interpolant through N^3 points is known, and what is left follows from a bound of R on polyellipses (Trefethen 2013,
theorem 8.1): if |R| <= m on the ellipses with foci -1 and 1 whose half axes sum to r, its coefficients are at most 8 m
r^-|k|, and interpolation aliases those of degree N and beyond in some direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.base.rows import Rows
from elvis.core.chebyshev_models.model_boxes import ShapeFacets
from elvis.core.chebyshev_models.series import (
    PARTS_ROUNDING,
    ROOM,
    along_axes,
    coefficients_of,
    nodes,
    part_matrices,
    slopes_of,
    values_at,
)

#: total degree of the polynomials for inverses
DEGREE = 6
#: models hold on boxes that are enlarged by about this factor, so that those of neighbours overlap
OVERLAP = 1.06
#: boxes of series are larger by one more factor, so that P(y) is in them
MARGIN = 1.06
#: total degree of the terms of the map that residuals are computed from; the others only count by their magnitudes
_MAP_DEGREE = 6
#: points in each direction at which inverses are found, and at which residuals are checked
_FOUND, _CHECKED = 8, 10
#: points in each direction by which polynomials are bounded, for each of their terms
_OFTEN = 3
#: steps to these points
_STEPS = 3
#: half axes of ellipses on which residuals are bounded
_AXES = np.array([1.5, 2.0, 2.7, 3.6, 5.0, 7.0])
#: largest difference of Jacobians from the identity
_MOST_BEND = 0.8
#: P is that far inside of the box of the series, in units of its half side, and errors are smaller than the rest
_INSIDE = 1.0 - 1e-4
#: boxes that are computed together
_AT_ONCE = 64
#: points at which polynomials are evaluated together
_IN_CACHE = 64
#: maximum distance of P(y) from the element's shape, in its coordinates, for which errors hold
BESIDE = 1e-3


@dataclass(frozen=True, eq=False)
class InverseMaps(Rows):
    """Boxes of elements with models of the inverse map.

    element  (n,) rows of elements
    centre   (n, 3) and half (n,) half sides of the boxes of series, in coordinates of the elements' cubes
    origin   (n, 3) positions of the centres
    axes     (n, 3, 3) from positions relative to the origin to y
    series   (n, 3, DEGREE + 1 three times) P as a Chebyshev series, up to a total degree
    error    (n,) maximum distance of P(y) from v; infinite where nothing is known
    """

    element: Ints
    centre: Floats
    half: Floats
    origin: Floats
    axes: Floats
    series: Floats
    error: Floats


@bounded_cache
def total_degrees(count: int) -> Ints:
    """(count, count, count) total degrees of terms."""
    k = np.arange(count)
    return np.asarray(k[:, None, None] + k[:, None] + k)


def growth_at(axes: Floats, count: int) -> Floats:
    """(..., count) largest magnitudes of T_k on ellipses with these half axes: at their ends."""
    values = [np.polynomial.chebyshev.chebval(axes, own) for own in np.eye(count)]
    return np.asarray(np.stack(values, axis=-1) * (1.0 + 1e-12))


def weighted(magnitudes: Floats, x: Floats, y: Floats, z: Floats) -> Floats:
    """(n, ...) sums of magnitudes (n, ..., count three times) times weights (n, count) in each direction."""
    leading = (slice(None), *[None] * (magnitudes.ndim - 4), slice(None))
    found = np.matmul(magnitudes, x[leading][..., None, :, None])[..., 0]
    found = np.matmul(found, y[leading][..., :, None])[..., 0]
    return np.asarray((found * z[leading]).sum(axis=-1))


def around(reach: Floats) -> Floats:
    """Half axes of the smallest ellipses that contain discs of complex numbers around 0."""
    return np.asarray(np.sqrt(reach * reach + 1.0))


def box_centres(halvings: int) -> Floats:
    """(m, 3) centres of the boxes that divide the cube."""
    line = (2.0 * np.arange(1 << halvings) + 1.0) / (1 << halvings) - 1.0
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    return np.stack([x, y, z], axis=-1).reshape(-1, 3)


def inverse_maps(series: Floats, inside: ShapeFacets, rows: Ints, halvings: int) -> InverseMaps:
    """Models of the inverses of maps (elements, 3, count three times) of some elements, on boxes that meet the shape.

    All boxes of an element together cover it.
    """
    half = 0.5**halvings
    centres = box_centres(halvings)
    centres = centres[inside.holds(centres, np.full(len(centres), half))]
    found = []
    for some in np.array_split(rows, min(len(rows), -(-len(rows) * len(centres) // _AT_ONCE))):
        element = np.repeat(some, len(centres))
        centre = np.tile(centres, (len(some), 1))
        found.append(_of_boxes(series, element, centre, MARGIN * OVERLAP * half, len(centres)))
    return InverseMaps.joined(found)


def on_boxes(series: Floats, element: Ints, centre: Floats, half: Floats) -> Floats:
    """(n, ..., count three times) series (elements, ..., count three times) on boxes of elements, in v."""
    matrices = part_matrices(series.shape[-1], ROOM * centre, half)
    return along_axes(series[element], *(matrices[:, None, axis] for axis in range(3)))


def _of_boxes(series: Floats, element: Ints, centre: Floats, half: float, boxes_of_each: int) -> InverseMaps:
    """Models on boxes (n,): for each element the same number, one after the other."""
    halves = np.full(len(element), half)
    with np.errstate(all="ignore"):
        own = on_boxes(series, element, centre, halves)
        origin, jacobian = _at_centre(own)
        axes = MARGIN * _inverses(jacobian)
        map = np.einsum("nij,njcba->nicba", axes, own)
        map[..., 0, 0, 0] -= _at_centre(map)[0]
        bend = _bends(own, axes, boxes_of_each)
        found = _inverted(map)
        error = (_residual(map, own, axes, found) + _left_out(map, centre, halves)) / (MARGIN * (1.0 - bend))
        known = (bend <= _MOST_BEND) & _covers(map) & (error <= 1.0 - _INSIDE)
    return InverseMaps(element, centre, halves, origin, axes, found, np.where(known, error, np.inf))


def _at_centre(series: Floats) -> tuple[Floats, Floats]:
    """Values (n, 3) and Jacobians (n, 3, 3) of maps at the centres of their boxes."""
    count = series.shape[-1]
    one = np.ones((len(series), 1))
    values, slopes = (one * np.polynomial.chebyshev.chebvander(0.0, count - 1), one * _slopes_at_centre(count))
    columns = [weighted(series, *(slopes if axis == own else values for axis in range(3))) for own in range(3)]
    return weighted(series, values, values, values), np.stack(columns, axis=-1)


def _slopes_at_centre(count: int) -> Floats:
    """(count,) derivatives of T_k at 0."""
    k = np.arange(count)
    return np.where(k % 2 == 1, k * (-1.0) ** (k // 2), 0.0)


def _inverses(matrices: Floats) -> Floats:
    """Inverses of matrices (..., 3, 3)."""
    x, y, z = np.moveaxis(matrices, -1, 0)
    across = np.cross(y, z)
    rows = np.stack([across, np.cross(z, x), np.cross(x, y)], axis=-2)
    return np.asarray(rows / (x * across).sum(axis=-1)[..., None, None])


def _bends(own: Floats, axes: Floats, boxes_of_each: int) -> Floats:
    """(n,) largest difference of Jacobians of M / MARGIN from the identity over the whole element, in the maximum norm.

    On each box the Jacobian differs from that at the middle by at most the magnitudes of the other terms.
    """
    slopes = np.stack([slopes_of(own, direction) for direction in range(3)], axis=2)
    middle = slopes[..., 0, 0, 0].reshape(-1, 1, boxes_of_each, 3, 3)
    beside = np.abs(slopes).sum(axis=(-3, -2, -1)).reshape(middle.shape) * (1.0 + PARTS_ROUNDING) - np.abs(middle)
    inverse = axes.reshape(-1, boxes_of_each, 1, 3, 3) / MARGIN
    off = np.abs(inverse @ middle - np.eye(3)) + np.abs(inverse) @ beside
    return np.asarray(off.sum(axis=-1).max(axis=(-2, -1)).reshape(-1))


def _covers(map: Floats) -> Bools:
    """(n,) whether |M| <= 1 on the box that was enlarged."""
    bend = np.abs(map - MARGIN * _identity(map.shape[-1])).sum(axis=(-3, -2, -1)).max(axis=1)
    return np.asarray(bend <= 1.0 - (1.0 + BESIDE) / OVERLAP)


def _identity(count: int) -> Floats:
    """(3, count three times) the series of the coordinates."""
    series = np.zeros((3, count, count, count))
    series[0, 0, 0, 1] = series[1, 0, 1, 0] = series[2, 1, 0, 0] = 1.0
    return series


@bounded_cache
def _lattice(count: int) -> Floats:
    """(3, count^3) the points of a lattice, x fastest."""
    line = nodes(count)
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    return np.stack([x, y, z]).reshape(3, -1)


def _inverted(map: Floats) -> Floats:
    """Series (n, 3, DEGREE + 1 three times) of the inverses of M, by Newton's method at the points of a lattice."""
    short, targets = _truncated(map, _MAP_DEGREE), _lattice(_FOUND)
    powers = to_powers(short)
    basis = np.asarray(np.polynomial.chebyshev.chebvander(nodes(_FOUND) / MARGIN, _MAP_DEGREE), np.float64)
    slopes = np.stack([along_axes(slopes_of(short, axis), basis, basis, basis) for axis in range(3)], axis=2)
    # (n, 3, 3, points): Jacobians where v would be y / MARGIN, which all steps use
    inverse = _inverses(np.moveaxis(slopes.reshape(*slopes.shape[:3], -1), -1, 1))
    points = np.broadcast_to(targets / MARGIN, (len(map), *targets.shape))
    for _ in range(_STEPS):
        miss = targets - at_points(powers, points)
        points = points + np.einsum("npij,njp->nip", inverse, miss)
    found = coefficients_of(points.reshape(len(map), 3, _FOUND, _FOUND, _FOUND))
    return _truncated(found, DEGREE)


def _truncated(series: Floats, degree: int) -> Floats:
    """The terms (..., degree + 1 three times) of series up to a total degree, padded if there are fewer."""
    return np.where(total_degrees(degree + 1) <= degree, _padded(series, degree + 1), 0.0)


@bounded_cache
def _power_terms(degree: int) -> tuple[tuple[int, int], ...]:
    """For each power product up to a total degree after 1, the number of one that it is a multiple of, and the axis."""
    places = power_places(degree).tolist()
    known = {tuple(place): number for number, place in enumerate(places)}
    found = []
    for place in places[1:]:
        axis = next(k for k in range(3) if place[2 - k])
        place[2 - axis] -= 1
        found.append((known[tuple(place)], axis))
    return tuple(found)


@bounded_cache
def power_places(degree: int) -> Ints:
    """(terms, 3) powers of z, y and x of the power products up to a total degree, which ascends."""
    degrees = total_degrees(degree + 1)
    places = np.argwhere(degrees <= degree)
    return np.asarray(places[np.argsort(places.sum(axis=1), kind="stable")])


@bounded_cache
def _powers_of_chebyshev(count: int) -> Floats:
    """(count, count) matrix from Chebyshev coefficients to coefficients of powers."""
    columns = [np.polynomial.chebyshev.cheb2poly(own) for own in np.eye(count)]
    return frozen_floats(np.stack([np.pad(own, (0, count - len(own))) for own in columns], axis=1))


def to_powers(series: Floats) -> Floats:
    """(..., terms) coefficients of power products of series up to a total degree."""
    matrix = _powers_of_chebyshev(series.shape[-1])
    z, y, x = power_places(series.shape[-1] - 1).T
    return np.asarray(along_axes(series, matrix, matrix, matrix)[..., z, y, x])


@bounded_cache
def horner_order(degree: int) -> Ints:
    """(terms,) numbers of power products as nested Horner schemes take them: powers of z, of y, and of x descend."""
    return np.lexsort(-power_places(degree).T[::-1])


def at_points(powers: Floats, points: Floats) -> Floats:
    """(n, m, k) values of polynomials (n, m, terms) at points (n, 3, k)."""
    values = [_at_some_points(powers, points[..., k : k + _IN_CACHE]) for k in range(0, points.shape[-1], _IN_CACHE)]
    return np.concatenate(values, axis=-1)


def _at_some_points(powers: Floats, points: Floats) -> Floats:
    """Values as in `at_points`, for so few points that all power products stay in the processor's cache."""
    products = np.empty((powers.shape[-1], len(points), points.shape[-1]))
    products[0] = 1.0
    for number, (before, axis) in enumerate(_power_terms(_degree_of(powers.shape[-1])), start=1):
        np.multiply(products[before], points[:, axis], out=products[number])
    return np.asarray(np.matmul(powers, products.swapaxes(0, 1)))


def _degree_of(terms: int) -> int:
    """The total degree of polynomials with this number of terms."""
    degree = 0
    while (degree + 1) * (degree + 2) * (degree + 3) // 6 < terms:
        degree += 1
    return degree


def _residual(map: Floats, own: Floats, axes: Floats, found: Floats) -> Floats:
    """(n,) bounds of the residual on [-1, 1]^3, for the map up to a total degree; infinite if P may leave the box."""
    short, magnitudes = _truncated(map, _MAP_DEGREE), np.abs(found)
    basis = values_at(_CHECKED, DEGREE + 1)
    points = along_axes(found, basis, basis, basis).reshape(len(map), 3, -1)
    residual = at_points(to_powers(short), points) - _lattice(_CHECKED)
    series = coefficients_of(residual.reshape(len(map), 3, *[_CHECKED] * 3))
    measured = np.abs(series).sum(axis=(-3, -2, -1)).max(axis=1)

    beyond = np.full(len(map), np.inf)
    for axis in _AXES:
        ellipses = around(reach_of(magnitudes, axis))
        weights = growth_at(ellipses, short.shape[-1])
        greatest = weighted(np.abs(short), weights, weights, weights).max(axis=1) + axis
        beyond = np.minimum(beyond, greatest * aliased(axis, _CHECKED))

    # the rounding of all sums is far below that of parts
    total = np.einsum("nij,nj->ni", np.abs(axes), np.abs(own).sum(axis=(-3, -2, -1))).max(axis=1)
    stays = reach_of(magnitudes, 1.0) <= _INSIDE
    return np.where(stays, measured + beyond + 10.0 * PARTS_ROUNDING * total, np.inf)


def _padded(series: Floats, count: int) -> Floats:
    """(..., count three times) the terms of series that have at least as many, and zeros if they have fewer."""
    size = min(series.shape[-1], count)
    padded = np.zeros((*series.shape[:-3], *[count] * 3))
    padded[..., :size, :size, :size] = series[..., :size, :size, :size]
    return padded


def _left_out(map: Floats, centre: Floats, half: Floats) -> Floats:
    """(n,) bounds of the terms of M beyond the total degree, in the elements' cubes and next to them."""
    series = map - _padded(_truncated(map, _MAP_DEGREE), map.shape[-1])
    return np.asarray(np.stack([largest_sum(series[:, axis, None], centre, half) for axis in range(3)]).max(axis=0))


def largest_sum(series: Floats, centre: Floats, half: Floats) -> Floats:
    """(n,) bounds of the sums of the magnitudes of several series (n, m, count three times) of boxes.

    They hold in the parts of the boxes that are in the elements' cubes or next to them.
    """
    room, count = 1.0 + BESIDE, series.shape[-1]
    low = np.maximum((-room - centre) / half[:, None], -1.0)
    high = np.minimum((room - centre) / half[:, None], 1.0)
    places = 0.5 * ((high + low)[..., None] + (high - low)[..., None] * nodes(_OFTEN * count))
    basis = np.polynomial.chebyshev.chebvander(places, count - 1)
    values = np.abs(along_axes(series, *(basis[:, None, axis] for axis in range(3)))).sum(axis=1)
    return np.asarray(values.max(axis=(1, 2, 3)) * _between_points(count))


def _between_points(count: int) -> float:
    """How much larger polynomials of ``count`` terms a direction may be than at _OFTEN times as many Chebyshev points.

    A polynomial of degree d is at most 1 / cos(pi d / 2 m) times its largest value at m points of a line (Ehlich and
    Zeller 1964, Schwankung von Polynomen zwischen Gitterpunkten).  A sum of magnitudes is the largest sum with signs.
    """
    return float(np.cos(0.5 * np.pi * (count - 1) / (_OFTEN * count)) ** -3)


def reach_of(magnitudes: Floats, axis: float) -> Floats:
    """(n,) largest magnitude of P on polyellipses with this half axis, from the magnitudes of its terms."""
    weights = np.broadcast_to(growth_at(np.array(axis), magnitudes.shape[-1]), (len(magnitudes), magnitudes.shape[-1]))
    return np.asarray(weighted(magnitudes, weights, weights, weights).max(axis=1))


def aliased(axis: float, count: int) -> float:
    """How far functions of three variables may be from their interpolants, if they are within 1 on polyellipses."""
    q = 1.0 / (axis + np.sqrt(axis * axis - 1.0))
    whole = 1.0 + 2.0 * q / (1.0 - q)
    below = 1.0 + 2.0 * q * (1.0 - q ** (count - 1)) / (1.0 - q)
    return float(2.0 * (whole**3 - below**3))
