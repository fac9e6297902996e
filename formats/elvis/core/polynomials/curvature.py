"""Second derivatives of expansions at reference points, an element for each point."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Expansion
from elvis.core.polynomials.bernstein import (
    BernsteinSpace,
    bernstein_coefficients,
    bernstein_space,
    bernstein_values,
    differentiate,
)
from elvis.core.polynomials.collapse import collapse
from elvis.core.shapes import Shape

#: number of coefficients in the nets of the elements that are treated together
_BATCH = 1 << 20


def hessians_at(expansion: Expansion, coefficients: Floats, rows: Ints, points: Floats) -> Floats:
    """(n, ..., d, d) second derivatives in xi at the points xi (n, d), point i in element ``rows[i]``.

    coefficients  (e, ..., m) of e elements
    On a pyramid they aren't finite at the apex.  Raises FormatError for Fourier directions.
    """
    space = bernstein_space(expansion)
    result = np.empty((len(points), *coefficients.shape[1:-1], *(space.shape.dimension,) * 2))
    step = max(1, _BATCH // (space.count * int(np.prod(coefficients.shape[1:-1]))))
    for first in range(0, len(points), step):
        batch = slice(first, first + step)
        net = bernstein_coefficients(expansion, coefficients[rows[batch]])
        rule = _of_pyramid if space.shape is Shape.PYRAMID else _of_net
        result[batch] = rule(space, net, np.asarray(points[batch], np.float64))
    return result


def _of_net(space: BernsteinSpace, net: Floats, points: Floats) -> Floats:
    """Second derivatives (n, ..., d, d) of nets (n, ..., count), in the coordinates of the net."""
    d = space.shape.dimension
    result = np.empty((*net.shape[:-1], d, d))
    for i in range(d):
        lower, derivative = differentiate(space, net, i)
        for j in range(i, d):
            result[..., i, j] = result[..., j, i] = _values(*differentiate(lower, derivative, j), points)
    return result


def _values(space: BernsteinSpace, net: Floats, points: Floats) -> Floats:
    return np.asarray(np.einsum("n...m,nm->n...", net, bernstein_values(space, points)))


def _of_pyramid(space: BernsteinSpace, net: Floats, points: Floats) -> Floats:
    """Uses the chain rule with eta_1 = (1 + xi_1) / w - 1 and w = (1 - xi_3) / 2, and in the same way for eta_2.

    The third coordinate is eta_3 = xi_3.
    """
    w, eta = (1 - points[:, 2]) / 2, collapse(space.shape, points)
    derivatives = [_values(*differentiate(space, net, i), points) for i in range(2)]
    inner = np.zeros((len(points), 3, 3))
    bends = np.zeros((2, len(points), 3, 3))
    with np.errstate(divide="ignore", invalid="ignore"):
        inner[:, 2, 2] = 1
        for i in range(2):
            inner[:, i, i] = 1 / w
            inner[:, i, 2] = (1 + eta[:, i]) / (2 * w)
            bends[i, :, i, 2] = bends[i, :, 2, i] = 1 / (2 * w**2)
            bends[i, :, 2, 2] = (1 + eta[:, i]) / (2 * w**2)
        result = np.einsum("n...ij,nik,njl->n...kl", _of_net(space, net, points), inner, inner)
        for derivative, bend in zip(derivatives, bends, strict=True):
            result += np.einsum("n...,nkl->n...kl", derivative, bend)
    return np.asarray(result)
