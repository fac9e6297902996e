"""Cuts by planes, through 3D data and of 2D data: coverage, elements and values."""

from functools import partial

import numpy as np

from audit.cases import CAMERAS, ORDINARY, Case, camera, exact, random_polynomial, tolerance
from audit.truths import Rays, Truth, in_domain, surface_roots
from audit.validating import validate
from audit.worlds import EPS, mixed, world
from elvis import Plane

#: modes of the field of straight elements: one for few kernels, a higher order, and both by turns
MODES = (4, 4, 4, 6, (6, 4), (4, 6))
NORMALS = ((0, 0, 1), (0, 1, 0), (1, 0, 0), (1, 1, 0), (1, 2, 3), (-3, 2, 1), (0.3, -0.7, 0.2))


def case(rng, size):
    """One cut."""
    dimension = int(rng.choice([2, 3, 3]))
    own = mixed(rng, dimension) if rng.random() < 0.15 else world(rng, dimension, joins=("joined", "doubled", "apart"))
    kind = str(rng.choice(CAMERAS[: 5 if dimension == 3 else 4]))
    kind = "oblique" if dimension == 2 and kind in ("along", "inside") else kind
    view, modes = camera(rng, own, kind), MODES[rng.integers(len(MODES))] if own.bend == (0.0, 0.0) else 4
    data, _, field = exact(own, random_polynomial(rng, 3, dimension), modes)

    # through borders of elements where it is the middle, else anywhere
    straight = np.array([[0.5, 0.5, 0.5]]) if rng.random() < 0.3 else rng.integers(1, 64, (1, 3)) / 64
    point = own.placed(own.bent(straight))[0]
    normal = NORMALS[rng.integers(len(NORMALS))]
    if dimension == 2:
        point, normal = np.zeros(3), (0, 0, 1)
    plane = Plane(tuple(map(float, point)), tuple(map(float, normal)))
    scene = {"field": "u", "camera": view, "size": size}
    scene |= {"plane": plane} if dimension == 3 else {}
    name = f"{own.name} modes {modes}, plane {plane.point} {normal}, {view}"
    ordinary = kind in ("oblique", "perspective", "close") and own.name.split()[-1] in ORDINARY
    ordinary &= "joined" in own.name and bool((straight != 0.5).any())
    return Case(name, data, scene, partial(count, own, plane, field), ordinary)


def count(own, plane, field, case, frame):
    """The count of a cut."""
    rays = Rays(own, frame.view)
    depth, sure, slack, free = plane_roots(rays, plane, in_domain(rays))
    truth = Truth(rays.counted, depth, sure, slack, free, field, tolerance(field, own))
    return validate(case, frame, truth, rays)


def plane_roots(rays, plane, inside):
    """Where rays meet a plane in the domain; see surface_roots."""
    normal = np.asarray(plane.normal, np.longdouble)
    normal /= np.sqrt((normal**2).sum())
    zero = np.zeros(len(rays.origins), np.longdouble)
    q = np.stack([(rays.origins - np.asarray(plane.point)) @ normal, rays.ways @ normal, zero], axis=1)
    noise = 16 * EPS * (rays.extent + float(np.abs(plane.point).max()))
    return surface_roots(rays, q, noise, inside)
