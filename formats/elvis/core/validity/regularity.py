"""A test that most elements pass quickly: the derivative of their map is regular, and its determinant positive.

J maps the k directions of an element into d dimensions of space.  With a fixed matrix P of shape (k, d), the matrix P J
is regular if its symmetric part is positive definite, for then x' P J x > 0 for all x.  Its determinant is then
positive, for it is positive on the whole segment from the unit matrix (Johnson 1970, Positive definite matrices).  J
therefore has rank k, and for k = d its determinant has the sign of the determinant of P.

P J is a convex combination of P times the control matrices of J, its Bernstein coefficients.  Matrices with positive
definite symmetric part form a convex cone, so it is enough to check the control matrices.  P is the inverse of their
mean, or its pseudo-inverse for d > k.  Boxes that don't pass are bisected.

Most maps of segments, quadrilaterals and hexahedra need no control matrices.  In their Modified basis the sum of the
absolute coefficients bounds how far J is from its mean M anywhere, and P J is regular if |1 - P J| < 1.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.core.data.dataset import Expansion
from elvis.core.mapping.orientation import chunks
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.boxnets import all_halves, box_nets, corners, product, raised, total
from elvis.core.polynomials.rounding import RAISED, UNIT
from elvis.core.shapes import Shape
from elvis.core.validity.determinants import Polynomials, tangents

#: number of bisections of boxes in every direction
HALVINGS = 2
#: parts of the product of its factors' sizes by which a minor or a determinant is more than rounding
ROUNDING = 1e-12
#: roundings, relative to the largest number, in products with the shares and sums in `_upward`
UPWARD = 24
#: numbers in the control matrices that are checked together
NUMBERS = 1 << 21
#: elements whose slopes are bounded together, and roundings in a slope
AT_ONCE = 1 << 8
SLOPES = 16


def are_regular(expansion: Expansion, coefficients: Floats, space: int | None = None) -> Bools:
    """(n,) whether maps with coefficients (n, 3, m) pass; False proves nothing.

    space  dimension of the world, by default of the elements; if it is larger, elements that pass have a positive area
           or length everywhere
    Raises FormatError for maps that aren't polynomials.
    """
    dimension = expansion.shape.dimension
    world = dimension if space is None else space
    passed = np.zeros(len(coefficients), bool)
    if set(expansion.bases) == {Basis.MODIFIED_A}:
        for part in chunks(len(coefficients), AT_ONCE):
            passed[part] = _are_nearly_affine(expansion.modes, coefficients[part, :world])
    left = np.flatnonzero(~passed)
    count = max(expansion.modes) ** dimension * world * dimension
    for part in chunks(len(left), max(1, NUMBERS // count)):
        rows = left[part]
        passed[rows] = _pass(*_controls(tangents(expansion, coefficients[rows]), world))
    return passed


def are_regular_between(expansion: Expansion, first: Floats, last: Floats) -> Bools:
    """(n,) whether all maps between two, (1 - t) first + t last with t from 0 to 1, pass `are_regular`.

    first, last  coefficients (n, 3, m) of maps in a space of the dimension of the elements

    t is one more direction of the boxes, in which the Jacobian is linear.
    """
    world = expansion.shape.dimension
    (controls, error), (others, other_error) = (_controls(tangents(expansion, own), world) for own in (first, last))
    return _pass(np.stack([controls, others], axis=-1), np.maximum(error, other_error))


def _are_nearly_affine(modes: tuple[int, ...], coefficients: Floats) -> Bools:
    """(n,) whether J of maps (n, d, m) in the Modified basis is so near its mean M that |1 - M^-1 J| < 1 everywhere."""
    # the first direction is the fastest
    net = coefficients.reshape(*coefficients.shape[:2], *modes[::-1])
    with np.errstate(all="ignore"):
        columns = [_slope(np.moveaxis(net, -1 - direction, 2)) for direction in range(len(modes))]
        means, deviations = (np.stack(own, axis=2) for own in zip(*columns, strict=True))
        inverse, is_sound = _inverse(means)
        magnitude = np.abs(coefficients).max(axis=(1, 2), initial=0.0)
        # each slope is off by a few roundings of the largest coefficient, and the weights of their sum are below m
        off = SLOPES * coefficients.shape[2] ** 2 * UNIT * magnitude[:, None, None]
        rest = np.eye(len(modes)) - inverse @ means
        far = np.abs(rest) + np.abs(inverse) @ (deviations + off)
        return np.asarray(is_sound & (np.linalg.norm(far, axis=(1, 2)) < 1 - ROUNDING))


def _slope(net: Floats) -> tuple[Floats, Floats]:
    """(n, d) mean of the slopes of maps (n, d, p, ...) along their first direction, and the largest deviation from it.

    The derivative of mode k from 2 on is (k - 1)/2 times a Legendre polynomial, the mode itself (k - 1)/(2 (2 k - 1))
    times the difference of two (Karniadakis and Sherwin 2005, section 3.2), and Legendre polynomials are at most 1.
    """
    weights = np.arange(1, net.shape[2] - 1) / 2
    linear = (net[:, :, 1] - net[:, :, 0]) / 2
    vertices = (slice(None), slice(None), *(slice(0, 2),) * (linear.ndim - 2))
    corners = linear[vertices]
    means = corners.mean(axis=tuple(range(2, corners.ndim)))
    corners -= means.reshape(*means.shape, *(1,) * (corners.ndim - 2))
    sizes = np.abs(linear) + np.einsum("ndk...,k->nd...", np.abs(net[:, :, 2:]), weights)
    while sizes.ndim > 2:
        # modes 0 and 1 add up to 1, so that their sum is at most the larger coefficient
        degrees = np.arange(1, sizes.shape[-1] - 1)
        sizes = np.maximum(sizes[..., 0], sizes[..., 1]) + sizes[..., 2:] @ (degrees / (2 * degrees + 1))
    return means, sizes


def _controls(columns: list[list[Polynomials]], world: int) -> tuple[Floats, Floats]:
    """(n, d, k, D1, …, Dk) control matrices of J on the boxes of elements, and (n,) the Frobenius norm of their error.

    Halving a box, and raising the degree of its net, take means of at most D numbers in each direction.
    """
    every = [own for column in columns for own in column[:world]]
    nets = [box_nets(own.space, np.ascontiguousarray(own.net.T)) for own in every]
    error = np.sqrt(sum(own.error**2 for own in every))
    if every[0].space.shape is Shape.PYRAMID:
        nets[2 * world :] = _upward(nets, world)
        # the weights of the sums are at most 1
        error *= 3
    sizes = np.max([net.shape[1:] for net in nets], axis=0)
    for axis, size in enumerate(sizes.tolist(), 1):
        nets = [raised(net, axis, size - 1) for net in nets]
    controls = np.stack(nets, axis=1)
    greatest = np.abs(controls).max(axis=tuple(range(1, controls.ndim)), initial=0.0)
    roundings = UPWARD + (HALVINGS + 1) * len(sizes) * (int(sizes.max()) + RAISED)
    error += roundings * UNIT * np.sqrt(len(every)) * greatest
    controls = controls.reshape(len(controls), len(columns), world, *sizes)
    return np.ascontiguousarray(controls.swapaxes(1, 2)), error


def _upward(nets: list[Floats], world: int) -> list[Floats]:
    """The nets of dx/dxi3 on pyramids from the nets of `tangents`: dx/deta1 / c, dx/deta2 / c and dx/deta3.

    With xi1 = (1 + eta1) c - 1 and xi2 in the same way, dx/dxi3 = dx/deta3 + (1 + eta1)/2 dx/deta1 / c + (1 + eta2)/2
    dx/deta2 / c.
    """
    found = nets[2 * world :]
    for direction in range(2):
        share = np.array([0.0, 1.0]).reshape(1, *(2 if axis == direction else 1 for axis in range(3)))
        along = nets[direction * world : (direction + 1) * world]
        found = [total(own, product(share, other)) for own, other in zip(found, along, strict=True)]
    return found


def _pass(controls: Floats, error: Floats, level: int = 0) -> Bools:
    """(b,) whether J is regular on boxes with control matrices (b, d, k, D1, …, Dk) that may be off by ``error`` (b,).

    level  how often they were bisected
    """
    if not len(controls):
        return np.empty(0, bool)
    with np.errstate(all="ignore"):
        means = controls.mean(axis=tuple(range(3, controls.ndim)))
        inverse, is_sound = _inverse(means)
        passed = is_sound & _are_definite(inverse, controls, error)
        if level == HALVINGS or passed.all():
            return np.asarray(passed)
        # at the corners of a box, J is its control matrix, which must be regular for any subdivision
        ends = corners(controls.reshape(-1, *controls.shape[3:])).reshape(*controls.shape[:3], -1)
        is_possible = np.all([_inverse(end)[1] for end in np.moveaxis(ends, -1, 0)], axis=0)
    rows = np.flatnonzero(~passed & is_possible)
    for half in _halves(controls[rows]):
        rows_left = np.flatnonzero(is_possible[rows])
        is_possible[rows[rows_left]] = _pass(half[rows_left], error[rows[rows_left]], level + 1)
    passed[rows] = is_possible[rows]
    return np.asarray(passed)


def _halves(controls: Floats) -> Iterator[Floats]:
    """The control matrices of the halves of boxes in every direction."""
    matrices, box = controls.shape[:3], controls.shape[3:]
    yield from all_halves(controls.reshape(-1, *box)).reshape(2 ** len(box), *matrices, *box)


def _inverse(matrices: Floats) -> tuple[Floats, Bools]:
    """(b, k, d) pseudo-inverses of matrices (b, d, k), and for which of them (b,) they are known.

    Square matrices must have positive determinants.
    """
    transposed = matrices.swapaxes(1, 2)
    squares = transposed @ matrices
    sizes = np.linalg.norm(matrices, axis=1).prod(axis=1)
    is_square = matrices.shape[1] == matrices.shape[2]
    volumes = np.linalg.det(matrices) if is_square else np.sqrt(np.linalg.det(squares))
    is_known = np.asarray(volumes > ROUNDING * sizes)
    safe = np.where(is_known[:, None, None], matrices if is_square else squares, np.eye(squares.shape[1]))
    inverse = np.linalg.inv(safe)
    return inverse if is_square else inverse @ transposed, is_known


def _are_definite(inverse: Floats, controls: Floats, error: Floats) -> Bools:
    """(b,) whether the symmetric parts of P J are positive definite at all control matrices, with P (b, k, d).

    An error E of J changes their eigenvalues by at most |P| |E|, so that much is subtracted.  All leading minors must
    be positive (Sylvester's criterion).
    """
    directions = controls.shape[2]
    flat = controls.reshape(*controls.shape[:3], -1)
    product = np.einsum("bkd,bdlc->klbc", inverse, flat)
    size = np.abs(product).max(axis=(0, 1, 3), initial=1.0)
    off = np.linalg.norm(inverse, axis=(1, 2)) * error + ROUNDING * size
    s = (product + product.swapaxes(0, 1)) / 2
    for direction in range(directions):
        s[direction, direction] -= off[:, None]
    least = s[0, 0].min(axis=1) / size
    if directions > 1:
        minor = s[0, 0] * s[1, 1] - s[0, 1] ** 2
        least = np.minimum(least, minor.min(axis=1) / size**2)
    if directions > 2:
        last = s[2, 2] * minor
        last += 2 * s[0, 1] * s[0, 2] * s[1, 2] - s[0, 0] * s[1, 2] ** 2 - s[1, 1] * s[0, 2] ** 2
        least = np.minimum(least, last.min(axis=1) / size**3)
    return np.asarray(least > ROUNDING)
