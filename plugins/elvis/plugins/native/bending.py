"""Curvature of the maps of elements: whether Newton's method can be trusted with them.

Let J be the Jacobian relative to the one at the centre, b the maximum change of J over the element and m the maximum
change per unit of length (maximum norms).  A step of Newton's method misses the root, d away, by at most k d with
k = m d / (2 (1 - b)), so from a step of length l < 1/4 the root is at most k l / (1 - k) away from the end of the step.
The kernels classify a point as outside for good once it is outside by 2 l (classify, invert.slang); facets of simplices
are three times as steep as coordinates.  Both hold together for k <= 0.4, that is for b + m / 2 <= 1, nearly.  The
Jacobian of a pyramid depends on the direction at the apex, however little it changes, unless the map is affine.

Both b and m are bounded by Bernstein coefficients of first and second derivatives, on a slightly larger element.
"""

from __future__ import annotations

from functools import reduce
from itertools import product

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints, frozen_floats
from elvis.core.base.bounded_cache import bounded_cache
from elvis.core.mapping.orientation import chunks
from elvis.core.mapping.patch import Patch
from elvis.core.mapping.tangents import duals
from elvis.core.polynomials.bernstein import (
    BernsteinSpace,
    bernstein_coefficients,
    bernstein_space,
    bernstein_values,
    gradient_nets,
)
from elvis.core.polynomials.collapse import uncollapse
from elvis.core.polynomials.expansion import values_and_gradients
from elvis.core.shapes import Shape

#: largest b of a map that counts as affine
_AFFINE = 1e-9
#: the bounds hold a little beyond the border of the element
BEYOND = 1.25
#: elements at once
_CHUNK = 256


def bends(patch: Patch, rows: Ints) -> Bools:
    """Flags (n,) of elements whose curvature may make Newton's method miss a root; true if J is singular.

    A false flag is proved, up to rounding.
    """
    result, space = np.empty(len(rows), bool), bernstein_space(patch.geometry)
    centre = patch.shape.vertices.mean(axis=0, keepdims=True)
    gradients = values_and_gradients(patch.geometry, centre)[1][0]
    for part in chunks(len(rows), _CHUNK):
        coefficients = patch.geometry_coefficients[rows[part]]
        nets = bernstein_coefficients(patch.geometry, coefficients)
        result[part] = bent(space, nets, np.einsum("ncm,dm->ncd", coefficients, gradients))
    return result


def bent(
    space: BernsteinSpace, nets: Floats, jacobians: Floats, weights: Floats | None = None, unit: float = 1.0
) -> Bools:
    """Flags (n,) as `bends`, for maps with nets (n, 3, count) over weights (n, count), 1 by default.

    jacobians  (n, 3, d)  at the centre, or nearby
    unit       length of a kernel's unit of reference coordinates in units of xi
    """
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        parts = np.einsum("nci,ncm->nim", duals(jacobians), nets)
        if space.shape is Shape.PYRAMID:
            return np.asarray(~(_pyramid_change(space, parts) <= _AFFINE))
        change, derivative = rational_changes(space, parts, weights) if weights is not None else changes(space, parts)
        return np.asarray(~(change + unit * derivative / 2 <= 1))


def changes(space: BernsteinSpace, parts: Floats, beyond: float = BEYOND) -> tuple[Floats, Floats]:
    """Bounds of b and m (n,) of maps with nets (n, d, count) relative to the Jacobian at the centre.

    beyond  size, relative to the element, of the neighbourhood in which they hold
    """
    change, derivative = derivative_sums(space, parts - net_of_xi(space).T, beyond)
    return change.max(axis=(1, 2)), derivative.max(axis=(1, 2))


def rational_changes(
    space: BernsteinSpace, parts: Floats, weights: Floats, beyond: float = BEYOND
) -> tuple[Floats, Floats]:
    """Bounds as `changes`, for maps y = Y / w: w dy = dY - y dw, and w ddy = ddY - dy dw - dw dy - y ddw."""
    axes = range(space.shape.dimension)
    middle = parts[..., parts.shape[-1] // 2] / weights[:, weights.shape[-1] // 2, None]
    parts, weights = parts - middle[..., None] * weights[:, None], weights[:, None]
    least = derived(space, weights, (), beyond).min(axis=(1, 2))
    least = np.where(least > 0.0, least, 0.0)[:, None]
    size = np.abs(derived(space, parts, (), beyond)).max(axis=2) / least
    first = [np.abs(derived(space, weights, (j,), beyond)).max(axis=2) for j in axes]

    # changes (n, d) of the columns of the Jacobian, then how fast the columns change
    changes = []
    for j in axes:
        own = derived(space, parts, (j,), beyond)
        own[:, j] -= derived(space, weights, (), beyond)[:, 0]
        changes.append((np.abs(own).max(axis=2) + size * first[j]) / least)
    derivatives = [change + np.eye(len(axes))[j] for j, change in zip(axes, changes, strict=True)]
    derivative = np.zeros_like(size)
    for j, k in product(axes, axes):
        own, second = (np.abs(derived(space, some, (j, k), beyond)).max(axis=2) for some in (parts, weights))
        derivative += (own + derivatives[j] * first[k] + derivatives[k] * first[j] + size * second) / least
    return np.sum(changes, axis=0).max(axis=1), derivative.max(axis=1)


def _pyramid_change(space: BernsteinSpace, parts: Floats) -> Floats:
    """A bound of b (n,) on pyramids: derivatives in xi are those in eta, two of them over c = (1 - eta3)/2.

    The format's functions do not depend on eta1 and eta2 at the apex.  For the others, b_k^r = c r/(r - k) b_k^(r-1).
    """
    parts, top = parts - net_of_xi(space).T, space.degrees[2]
    scale = top / (top - np.arange(top))
    across = []
    for _, matrix in gradient_nets(space)[:2]:
        layers = (parts @ matrix).reshape(*parts.shape[:2], top + 1, -1)[:, :, :top]
        across.append((np.abs(layers) * scale[:, None]).max(axis=(2, 3)))
    up = np.abs(parts @ gradient_nets(space)[2][1]).max(axis=2) + across[0] + across[1]
    return np.asarray((across[0] + across[1] + up).max(axis=1))


def derivative_sums(space: BernsteinSpace, nets: Floats, beyond: float = BEYOND) -> tuple[Floats, Floats]:
    """Absolute nets (..., count) of the first and of the second derivatives, summed over directions and their pairs."""
    axes = range(space.shape.dimension)
    first = sum(np.abs(derived(space, nets, (j,), beyond)) for j in axes)
    second = sum(np.abs(derived(space, nets, pair, beyond)) for pair in product(axes, axes))
    return np.asarray(first), np.asarray(second)


def derived(space: BernsteinSpace, nets: Floats, directions: tuple[int, ...], beyond: float = BEYOND) -> Floats:
    """Nets (..., count) of derivatives in these directions, in the space itself, on a larger element."""
    if len(space.degrees) < space.shape.dimension:
        return np.asarray(nets @ _matrix(space, directions, beyond))
    grid = nets.reshape(*nets.shape[:-1], *(degree + 1 for degree in space.degrees[::-1]))
    for direction, degree in enumerate(space.degrees):
        line = BernsteinSpace(Shape.SEGMENT, (degree,))
        matrix = _matrix(line, (0,) * directions.count(direction), beyond)
        grid = np.moveaxis(np.moveaxis(grid, -1 - direction, -1) @ matrix, -1, -1 - direction)
    return np.ascontiguousarray(grid.reshape(nets.shape))


@bounded_cache
def _matrix(space: BernsteinSpace, directions: tuple[int, ...], beyond: float) -> Floats:
    """Matrix (count, count), applied from the right: from a net on the element to a derivative's on the larger one."""
    centre, places = space.shape.centre, net_of_xi(space)
    to_net = np.linalg.inv(bernstein_values(space, places))
    larger = (to_net @ bernstein_values(space, centre + beyond * (places - centre))).T
    derivatives = [(lower, gradient_nets(space)[i][1]) for i in directions for lower in (gradient_nets(space)[i][0],)]
    raised = [matrix @ (to_net @ bernstein_values(lower, places)).T / beyond for lower, matrix in derivatives]
    return frozen_floats(reduce(np.matmul, raised, larger))


@bounded_cache
def net_of_xi(space: BernsteinSpace) -> Floats:
    """(count, d) the net of xi itself: for each function of the space the point of its largest value."""
    tops = space.powers.max(axis=0)
    eta = 2 * space.powers / np.maximum(tops, 1) - 1
    return frozen_floats(uncollapse(space.shape, eta) if space.shape is Shape.PYRAMID else eta)
