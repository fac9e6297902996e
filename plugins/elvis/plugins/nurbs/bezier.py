"""Nets of Bernstein coefficients over boxes, (n, n_x, n_y, n_z, …): made from splines and nodes, and evaluated."""

from __future__ import annotations

from math import comb

import numpy as np

from elvis.core.base.arrays import Floats


def binomials(degree: int) -> Floats:
    """(degree + 1,) binomial coefficients."""
    return np.array([comb(degree, i) for i in range(degree + 1)], dtype=np.float64)


def bernstein(degree: int, t: Floats) -> Floats:
    """(n, degree + 1) Bernstein polynomials at t (n,) in [0, 1]."""
    t = np.asarray(t, np.float64)
    return np.asarray(binomials(degree) * np.vander(t, degree + 1, increasing=True) * np.vander(1 - t, degree + 1))


def from_nodes(nodes: Floats) -> Floats:
    """(p + 1, p + 1) matrix from values at p + 1 nodes in [0, 1] to Bernstein coefficients."""
    return np.asarray(np.linalg.inv(bernstein(len(nodes) - 1, nodes)))


def along(matrices: tuple[Floats, Floats, Floats], values: Floats) -> Floats:
    """Values (n_x, n_y, n_z, …) with a matrix applied along each of the first three axes."""
    return np.asarray(np.einsum("ai,bj,ck,ijk...->abc...", *matrices, values, optimize=True))


def scaled_coefficients(nets: Floats) -> Floats:
    """(n, n_z n_y n_x, …) coefficients with x fastest, each times its binomial factors: the scaled form."""
    factors = [binomials(size - 1) for size in nets.shape[1:4]]
    scale = np.einsum("i,j,k->ijk", *factors).reshape(*nets.shape[1:4], *(1,) * (nets.ndim - 4))
    turned = np.moveaxis(nets * scale, (1, 2, 3), (3, 2, 1))
    return np.ascontiguousarray(turned).reshape(len(nets), -1, *nets.shape[4:])


def evaluated(nets: Floats, points: Floats) -> Floats:
    """(n, …) value of net e at point e (n, 3)."""
    lines = [bernstein(size - 1, points[:, axis]) for axis, size in enumerate(nets.shape[1:4])]
    return np.asarray(np.einsum("ei,ej,ek,eijk...->e...", *lines, nets, optimize=True))
