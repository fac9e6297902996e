"""A case: data, a scene and the truth; and what families choose at random for theirs."""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from audit.polynomials import Polynomial, multiple
from elvis import Camera


@dataclass(frozen=True, eq=False)
class Case:
    """One picture.

    name      says how it was made, for those who want to see it again
    data      a dataset, or what a runtime plugin has opened
    scene     keywords of Scene
    count     function of (case, frame) to a Count
    ordinary  whether few pixels may be ambiguous: nothing touches, coincides or is far off
    draw      function of (gallery, case) to what ``count`` takes; None draws the scene
    """

    name: str
    data: Any
    scene: dict[str, Any]
    count: Callable[..., Any]
    ordinary: bool
    draw: Callable[..., Any] | None = None


#: how a camera looks at a world
CAMERAS = ("oblique", "perspective", "along", "inside", "close")
#: placements whose pictures are ordinary
ORDINARY = ("plain", "off", "mirrored")


def camera(rng, world, kind):
    """A camera of one of the kinds, at random."""
    corners = world.corners()
    middle, radius = corners.mean(axis=0), float(np.linalg.norm(np.ptp(corners, axis=0))) / 2
    place = world.placed(world.bent(rng.uniform(0.2, 0.8, (1, 3)) * [1, 1, world.dimension == 3]))[0]
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    if kind == "along":
        way = np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
        kind = str(rng.choice(["oblique", "perspective"]))
    up = _vector(np.roll(np.eye(3)[int(np.abs(way).argmax())], 1))
    if kind == "inside":
        return Camera(_vector(place), _vector(place + radius * way), up, fov=90.0)
    distance = float(rng.uniform(1.5, 4)) * radius
    if kind == "perspective":
        fov = float(np.degrees(2 * np.arctan(0.8 * radius / distance)))
        return Camera(_vector(middle - distance * way), _vector(middle), up, fov=fov)
    at, part = (place, 10.0 ** -rng.uniform(0, 3)) if kind == "close" else (middle, 0.8)
    return Camera(_vector(at - distance * way), _vector(at), up, height=float(2 * part * radius))


def _vector(array):
    x, y, z = (float(part) for part in array)
    return x, y, z


def random_polynomial(rng, degree, dimension):
    """A polynomial of some degree whose coefficients are quarters."""
    terms = {}
    for i in range(degree + 1):
        for j in range(degree + 1 - i):
            for k in range(degree + 1 - i - j if dimension == 3 else 1):
                terms[i, j, k] = Fraction(int(rng.integers(-4, 5)), 4)
    return Polynomial(terms)


def exact(world, polynomial, modes):
    """A dataset with the field u, a multiple of the polynomial without any rounding; that multiple, and the field."""
    times = multiple(max(np.atleast_1d(modes).tolist()), world.shapes)
    return world.dataset({"u": polynomial * times}, modes), times, polynomial * times


def tolerance(polynomial, world):
    """The tolerance of values: a hundred thousand millionth of the range, or the rounding of the largest."""
    points = np.random.default_rng(0).random((4000, 3)) * np.ptp(world.mesh.vertices, axis=0)
    values = polynomial(points)
    return max(1e-11 * float(np.ptp(values)), 8 * 2.3e-16 * float(np.abs(values).max()))
