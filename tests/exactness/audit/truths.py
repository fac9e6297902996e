"""Hits of rays in closed form: along a ray all straight coordinates are quadratic, and so is the function sought."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from audit.worlds import BORDER, EPS, margins

#: part of the domain's diagonal that a hit may be off by (the tolerance of positions)
POSITION = 1e-10
#: part of its terms within which a discriminant may as well be zero: the ray touches
TOUCHING = 1e-9


@dataclass(frozen=True, eq=False)
class Truth:
    """What may be and what must be seen along each of n rays.

    counted    (n,)    rays that come near the domain; others are trivially right
    depth      (n, k)  where something may be hit, infinite where nothing is
    sure       (n, k)  whether it must be: it is farther than the tolerance from every border and from touching
    slack      (n, k)  how far a depth may be off
    free       (n,)    rays that run within what is searched for: anything is right
    field      Polynomial of the values seen; None where they are not compared
    tolerance  of values, next to the rounding of places
    """

    counted: Any
    depth: Any
    sure: Any
    slack: Any
    free: Any
    field: Any = None
    tolerance: float = 0.0


class Rays:
    """The rays of a view in a world.

    quadratics  (n, 3, 3) coefficients of 1, t, t^2 of the straight coordinates along each ray
    extent      largest coordinate that takes part in computing them
    rounding    (3,) of straight coordinates
    """

    def __init__(self, world, view, corners=None):
        """Of a view in a world, in a box around the domain with ``corners`` (8, 3) where they are not the world's."""
        self.world, self.view = world, view
        self.origins, self.ways = (part.astype(np.longdouble) for part in view.every_ray())
        self.quadratics = world.along(self.origins, self.ways)
        corners = world.corners() if corners is None else corners
        self.diagonal = float(np.linalg.norm(np.ptp(corners, axis=0)))
        self.extent = float(max(np.abs(corners).max(), np.abs(view.camera.eye).max()))
        self.rounding, self.sides = world.rounding(self.extent), world.sides()
        room = 1e-9 * self.diagonal * np.array([[-1.0], [1.0]])
        box = np.stack([corners.min(axis=0), corners.max(axis=0)]) + room
        self.enter, self.leave = _interval(self.origins, self.ways, *box)
        self.counted = self.leave >= self.enter

    def places(self, depth):
        """(n, k, 3) straight coordinates at depths (n, k); of those that are not finite at 0."""
        t = np.where(np.isfinite(depth), depth, 0.0)[..., None]
        q = self.quadratics[:, None]
        return q[..., 0] + t * (q[..., 1] + t * q[..., 2])

    def at(self, pixels, depth):
        """(m, 3) straight coordinates at one depth (m,) of some pixels."""
        q, t = self.quadratics[pixels], depth[:, None]
        return q[..., 0] + t * (q[..., 1] + t * q[..., 2])

    def noise(self, polynomial):
        """How far a polynomial may be off where straight coordinates are rounded."""
        return polynomial.greatest_derivative() * float(self.rounding.max())

    def slack(self, depth, noise, derivative):
        """How far a depth may be off: the tolerance, and the noise of a zero over its derivative along the ray."""
        with np.errstate(divide="ignore", invalid="ignore"):
            moved = np.where(derivative == 0, np.inf, noise / np.abs(derivative))
        return POSITION * self.diagonal + 4 * EPS * np.abs(depth) + moved


def _interval(origins, ways, low, high):
    """Depths (n,) between which rays are in a box; they miss it where the second is the smaller."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - origins) / ways, (high - origins) / ways
    within, still = (origins >= low) & (origins <= high), ways == 0
    enter = np.where(still, np.where(within, -np.inf, np.inf), np.minimum(first, second)).max(axis=1)
    leave = np.where(still, np.where(within, np.inf, -np.inf), np.maximum(first, second)).min(axis=1)
    return np.maximum(enter, 0), leave


def quadratic_roots(q):
    """Roots (n, 2) of q0 + q1 t + q2 t^2, NaN where there are none, and the discriminant over its parts' size (n,)."""
    q0, q1, q2 = q.T
    discriminant, size = q1 * q1 - 4 * q0 * q2, q1 * q1 + np.abs(4 * q0 * q2)
    with np.errstate(divide="ignore", invalid="ignore"):
        # the form of the textbook that does not cancel
        half = -(q1 + np.where(q1 < 0, -1, 1) * np.sqrt(discriminant)) / 2
        roots = np.stack([np.where(q2 == 0, -q0 / q1, q0 / half), np.where(q2 == 0, np.nan, half / q2)], axis=1)
        relative = np.where(size > 0, discriminant / size, 1.0)
    return np.where(np.isfinite(roots), roots, np.nan), relative


def surface_roots(rays, q, noise, inside):
    """Depth, sure, slack, each (n, 2), and free (n,) of the roots of quadratics q (n, 3) in the domain, as in Truth.

    noise   how far the quadratic form may be off, see Rays.noise
    inside  function of straight points (m, 3): whether they may be in the domain, and whether they surely are
    """
    roots, relative = quadratic_roots(q)
    touching = (np.abs(relative) < TOUCHING) & (q[:, 2] != 0)
    vertex = np.divide(-q[:, 1], 2 * q[:, 2], out=np.zeros(len(q), q.dtype), where=q[:, 2] != 0)
    roots = np.where(touching[:, None] & np.isnan(roots), vertex[:, None], roots)
    derivative = q[:, 1:2] + 2 * q[:, 2:3] * np.nan_to_num(roots)
    slack = rays.slack(np.nan_to_num(roots), noise, derivative)

    # where it touches, roots lie anywhere between those of the two nearest cases
    size = q[:, 1] ** 2 + np.abs(4 * q[:, 0] * q[:, 2])
    wide = np.divide(np.sqrt(TOUCHING * size), np.abs(q[:, 2]), out=np.zeros_like(size), where=q[:, 2] != 0)
    slack = np.where(touching[:, None], wide[:, None] + rays.slack(0.0, 0.0, np.ones(1)), slack)
    possible, sure = (part.reshape(roots.shape) for part in inside(rays.places(roots).reshape(-1, 3)))
    possible &= np.isfinite(roots) & (roots > -slack)
    sure &= possible & (roots > slack) & ~touching[:, None] & np.isfinite(slack)
    return np.where(possible, roots, np.inf), sure, np.where(np.isfinite(slack), slack, 0.0), _along(rays, q, noise)


def _along(rays, q, noise):
    """(n,) whether a quadratic form vanishes all along the ray, as far as rounding can tell."""
    ends = np.where(rays.counted, [rays.enter, rays.leave], 0.0)
    middle = ends.mean(axis=0)
    depths = middle + np.array([[-1.0], [0.0], [1.0]]) * rays.diagonal
    values = q[:, 0] + depths * (q[:, 1] + depths * q[:, 2])
    return rays.counted & (np.abs(values) <= 1e-12 + 4 * noise).all(axis=0)


def in_box(rays, axes=(0, 1, 2)):
    """The unit cube or square, for surface_roots."""
    chosen = list(axes)

    def inside(points):
        away, slack = np.minimum(points, 1 - points)[:, chosen], BORDER + rays.rounding[chosen]
        return (away >= -slack).all(axis=1), (away >= slack).all(axis=1)

    return inside


def in_elements(rays):
    """All elements of a mesh that is not a cube, for surface_roots; slack as in in_box."""
    slack = BORDER + float(rays.rounding.max())

    def inside(points):
        best = np.full(len(points), -np.inf)
        for element in range(len(rays.sides)):
            best = np.maximum(best, margins(rays.sides, np.full(len(points), element), points))
        return best >= -slack, best >= slack

    return inside


def in_domain(rays):
    """The domain of a world, for surface_roots."""
    if rays.world.name == "mixed":
        return in_elements(rays)
    return in_box(rays, (0, 1, 2) if rays.world.dimension == 3 else (0, 1))


def joined(parts):
    """Of surfaces the roots of all: depth, sure, slack (n, sum of k) and free (n,)."""
    depth, sure, slack, free = zip(*parts, strict=True)
    return (*(np.concatenate(some, axis=1) for some in (depth, sure, slack)), np.any(free, axis=0))
