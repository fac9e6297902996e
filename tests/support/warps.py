"""Warps of the unit square and cube."""

import numpy as np


def bubble(points):
    """A warp that keeps the border of the unit square or cube."""
    is_used = points.any(axis=0)
    inner = np.prod(np.where(is_used, 4 * points * (1 - points), 1.0), axis=1)
    return points + np.where(is_used, 0.12 * inner[:, None] * [1.0, -0.7, 0.4], 0.0)


def sector(points):
    """The unit cube onto a part of a ball between the radii 1 and 2."""
    radius, height, angle = 1 + points[..., 2], 1.2 + 0.4 * points[..., 1], 0.5 * points[..., 0]
    flat = radius * np.sin(height)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), radius * np.cos(height)], axis=-1)


def bent_plane(points):
    """A shear of second degree: elements of three nodes along an edge follow it exactly."""
    return points + 0.2 * points[:, :1] ** 2 * [0, 1, 0]


def bent_volume(points):
    """Another in the third direction, to the same degree."""
    x, y, _ = points.T
    return bent_plane(points) + np.outer(0.25 * x * y - 0.15 * y**2, [0, 0, 1])


def straightened_plane(points):
    """The inverse of ``bent_plane``."""
    return points - 0.2 * points[:, :1] ** 2 * [0, 1, 0]


def straightened_volume(points):
    """The inverse of ``bent_volume``."""
    x, y, _ = straightened_plane(points).T
    return straightened_plane(points) - np.outer(0.25 * x * y - 0.15 * y**2, [0, 0, 1])


def cubic(points):
    """A field of third degree in the straight coordinates."""
    x, y, z = points.T
    return 1 + x - 2 * y * z + x**2 * y - z**3 + 0.3 * y**3


def sheared(points):
    """A bend of second degree that keeps the cube's chords along z, and its volume."""
    x, y, _ = points.T
    return points + np.outer(0.3 * x * y - 0.2 * y**2, [0, 0, 1])
