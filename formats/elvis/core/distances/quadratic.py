"""Minimum of a quadratic function of two coordinates on a line, a triangle or a square."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.core.distances.surface_patches import CORNERS


def least(corners: int, bend: Floats, gradient: Floats) -> Floats:
    """(n, 2) the points of a domain (see `surface_patches`) where gradient . w + w . bend w / 2 is smallest.

    bend (n, 3)      its entries ss, st, tt
    gradient (n, 2)
    If the function is not convex, the minimum over the sides.
    """
    result, lowest = np.zeros_like(gradient), np.full(len(gradient), np.inf)
    own = CORNERS[corners]
    for first, last in zip(own[: 1 if corners == 2 else None], np.roll(own, -1, axis=0), strict=False):
        way = last - first
        straight, curved = gradient @ way + multiply(bend, first) @ way, multiply(bend, way) @ way
        with np.errstate(divide="ignore", invalid="ignore"):
            part = np.where(curved > 0, np.clip(-straight / curved, 0.0, 1.0), straight + curved / 2 < 0)
        point = first + np.nan_to_num(part)[:, None] * way
        terms = (gradient + multiply(bend, point) / 2) * point
        value = terms[:, 0] + terms[:, 1]
        better = value < lowest
        result[better], lowest[better] = point[better], value[better]
    if corners == 2:
        return result

    # the stationary point, if it lies inside
    ss, st, tt = bend.T
    determinant = ss * tt - st**2
    convex = (ss > 0) & (tt > 0) & (determinant > 1e-14 * ss * tt)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Cramer's rule for the stationary point
        gs, gt = gradient.T
        inner = np.stack([st * gt - tt * gs, st * gs - ss * gt]) / determinant
        inside = convex & _holds(corners, inner.T)
    result[inside] = inner.T[inside]
    return result


def multiply(bend: Floats, points: Floats) -> Floats:
    """(n, 2) symmetric matrices of entries ss, st, tt (n, 3) times points (n, 2) or (2,)."""
    s, t = points[..., 0], points[..., 1]
    return np.stack([bend[:, 0] * s + bend[:, 1] * t, bend[:, 1] * s + bend[:, 2] * t], axis=1)


def _holds(corners: int, points: Floats) -> Bools:
    s, t = points.T
    inside = (s >= -1) & (t >= -1)
    return np.asarray(inside & ((s + t <= 0) if corners == 3 else (s <= 1) & (t <= 1)))
