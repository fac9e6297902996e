"""Outer faces of curved cubes, from all sides and from inside."""

from functools import partial

from audit.cases import CAMERAS, ORDINARY, Case, camera, exact, random_polynomial, tolerance
from audit.truths import Rays, Truth, in_box, joined, surface_roots
from audit.validating import validate
from audit.worlds import world
from elvis import Faces


def case(rng, size):
    """One picture of all outer faces."""
    kind = str(rng.choice(CAMERAS))
    joins = ("joined", "doubled") if kind in ("inside", "close") else ("joined", "doubled", "apart")
    own = world(rng, joins=joins)
    view = camera(rng, own, kind)
    data, _, field = exact(own, random_polynomial(rng, 3, 3), 4)
    scene = {"field": "u", "camera": view, "size": size, "objects": (Faces(),)}
    ordinary = kind in ("oblique", "perspective") and own.name.split()[-1] in ORDINARY and "joined" in own.name
    return Case(f"{own.name}, {view}", data, scene, partial(count, own, field), ordinary)


def count(own, field, case, frame):
    """The count of a picture of faces."""
    rays = Rays(own, frame.view)
    parts = []
    for axis in range(3):
        others = tuple(other for other in range(3) if other != axis)
        for side in (0, 1):
            q = rays.quadratics[:, axis] - [side, 0, 0]
            parts.append(surface_roots(rays, q, float(rays.rounding[axis]), in_box(rays, others)))
    truth = Truth(rays.counted, *joined(parts), field, tolerance(field, own))
    return validate(case, frame, truth, rays)
