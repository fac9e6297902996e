"""Smooth paths of a camera through given cameras, its keys, with a horizon that doesn't tilt between them.

View direction and up direction follow Bézier curves on the sphere; de Casteljau's algorithm evaluates them with great
circles as lines (Shoemake, Animating rotation with quaternion curves, SIGGRAPH 1985).  The point that the camera faces,
and the logarithms of distance, field of view and height, follow cubics.  At a key all have the mean velocity of the
two adjacent steps (Catmull and Rom 1974); with only two keys all velocities are constant.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.scene.model.errors import SceneError
from elvis.scene.model.whole import Camera

#: tolerance for unit vectors: closer ones are equal; opposite ones, within it, have no unique path between them
_NEAR = 1e-9


@dataclass(frozen=True, eq=False)
class CameraPath:
    """A path through cameras at equal intervals.

    forward, up  (n, 3) unit vectors
    numbers      (n, 5) point that the camera looks at, logarithms of the distance and of field of view or height
    """

    cameras: tuple[Camera, ...]
    forward: Floats
    up: Floats
    numbers: Floats

    @classmethod
    def of(cls, cameras: Sequence[Camera]) -> CameraPath:
        """The path.

        Raises SceneError for fewer than two cameras, for a mix of perspective and parallel cameras, and if two
        successive
        cameras have opposite view or up directions.
        """
        if len(cameras) < 2:
            raise SceneError(f"expected two or more cameras of a path, found {len(cameras)}")
        if len({camera.fov is not None for camera in cameras}) > 1:
            raise SceneError("expected cameras of a path that are all in perspective, or none, found some of each")
        forward = np.array([camera.basis()[2] for camera in cameras])
        up = np.array([np.divide(camera.up, np.linalg.norm(camera.up)) for camera in cameras])
        for vectors in (forward, up):
            if (np.sum(vectors[:-1] * vectors[1:], axis=1) < _NEAR - 1).any():
                raise SceneError("expected successive cameras less than 180 degrees apart: add one in between")
        return cls(tuple(cameras), forward, up, np.array([_numbers(camera) for camera in cameras]))

    def at(self, share: float) -> Camera:
        """The camera at a share of the path from 0 to 1; at a key it is the key."""
        place = share * (len(self.cameras) - 1)
        first = min(int(place), len(self.cameras) - 2)
        part = place - first
        own = self.cameras[first]
        if part in (0.0, 1.0):
            return self.cameras[first + int(part)]
        numbers = _cubic(self.numbers, first, part)
        at, (distance, size) = numbers[:3], np.exp(numbers[3:]).tolist()
        eye = at - distance * _spherical(self.forward, first, part)
        fov, height = (None if value is None else size for value in (own.fov, own.height))
        up = _spherical(self.up, first, part)
        return replace(own, eye=_vector(eye), at=_vector(at), up=_vector(up), fov=fov, height=height)


def _numbers(camera: Camera) -> Floats:
    """(5,) the numbers of a camera that a path interpolates."""
    distance = np.linalg.norm(np.subtract(camera.at, camera.eye))
    return np.array([*camera.at, np.log(distance), np.log(camera.fov or camera.height or 1.0)])


def _cubic(numbers: Floats, first: int, part: float) -> Floats:
    """(k,) between two of (n, k), by Hermite's cubic."""
    leaving, arriving = (_mean_of_steps(np.diff(numbers, axis=0), key) for key in (first, first + 1))
    s, rest = part, 1 - part
    ends = (1 + 2 * s) * rest**2 * numbers[first] + s**2 * (3 - 2 * s) * numbers[first + 1]
    return np.asarray(ends + s * rest**2 * leaving - s**2 * rest * arriving)


def _mean_of_steps(steps: Floats, key: int) -> Floats:
    """Mean of the two steps next to a key, of the steps (n - 1, k) between n keys."""
    return np.asarray(steps[max(key - 1, 0) : key + 1].mean(axis=0))


def _spherical(vectors: Floats, first: int, part: float) -> Floats:
    """(3,) between two of the unit vectors (n, 3), by a Bézier curve on the sphere."""
    start, end = vectors[first], vectors[first + 1]
    points: list[Floats] = [
        start,
        _walked(start, _velocity(vectors, first) / 3),
        _walked(end, -_velocity(vectors, first + 1) / 3),
        end,
    ]
    while len(points) > 1:
        points = [_walked(one, part * _way(one, other)) for one, other in pairwise(points)]
    return points[0]


def _velocity(vectors: Floats, key: int) -> Floats:
    """(3,) at a unit vector: the mean of the way from the one before and that to the one after."""
    own = vectors[key]
    steps = [-_way(own, other) for other in vectors[max(key - 1, 0) : key]]
    steps += [_way(own, other) for other in vectors[key + 1 : key + 2]]
    return np.asarray(np.mean(steps, axis=0))


def _way(one: Floats, other: Floats) -> Floats:
    """(3,) the tangent at a unit vector along the great circle to another, as long as the angle between them."""
    across = other - (one @ other) * one
    sine = float(np.linalg.norm(across))
    return across if sine < _NEAR else np.asarray(np.arctan2(sine, one @ other) / sine * across)


def _walked(start: Floats, way: Floats) -> Floats:
    """(3,) the unit vector at the end of a tangent, see `_way`."""
    angle = float(np.linalg.norm(way))
    found = np.cos(angle) * start + np.sinc(angle / np.pi) * way
    return np.asarray(found / np.linalg.norm(found))


def _vector(values: Floats) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
