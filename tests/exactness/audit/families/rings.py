"""A quarter of a ring in NURBS, exact circles: cuts, faces and isosurfaces; its field r - 1 is its second parameter.

1 <= r <= 2, x >= 0, y >= 0, 0 <= z <= 1
"""

import json
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from audit.cases import Case, camera
from audit.families.cuts import NORMALS, plane_roots
from audit.truths import Rays, Truth, joined, surface_roots
from audit.validating import validate
from audit.worlds import BORDER, World
from elvis import Faces, Isosurface, Plane
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.plugins.nurbs import Nurbs
from elvis.plugins.runtime.opening import PluginData


class Radius:
    """The field at points (n, 3)."""

    def __call__(self, points):
        return np.hypot(points[:, 0], points[:, 1]) - 1.0

    def greatest_derivative(self):
        return 2.0


def ring():
    """The ring, opened by the plugin."""
    arc = [[1, 0, 0], [1, 1, 0], [0, 1, 0]]
    points = [[s * x, s * y, z] for z in (0.0, 1.0) for s in (1.0, 2.0) for x, y, _ in arc]
    values = [s - 1.0 for _ in (0, 1) for s in (1.0, 2.0) for _ in arc]
    patch = {"degrees": [2, 1, 1], "knots": [[0, 0, 0, 1, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1]], "points": points}
    patch |= {"weights": [1.0, float(np.sqrt(0.5)), 1.0] * 4, "fields": {"u": values}}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "ring.json"
        path.write_text(json.dumps({"format": "elvis-nurbs", "version": 1, "patches": [patch]}))
        return PluginData("nurbs", Nurbs([path]))


def box():
    """The world of a box around the ring, whose straight coordinates are those of the world."""
    mesh = grid(Shape.HEXAHEDRON, 1)
    return World("ring", type(mesh)(**{**vars(mesh), "vertices": mesh.vertices * [2.0, 2.0, 1.0]}))


def case(rng, size):
    """One picture of the ring."""
    own, what = box(), str(rng.choice(["cut", "faces", "isosurface"]))
    view = camera(rng, own, str(rng.choice(["oblique", "perspective", "close"])))
    surface = None
    if what == "cut":
        point = tuple(float(x) for x in rng.integers(1, 16, 3) / 8 * [1, 1, 0.5])
        surface = Plane(point, tuple(map(float, NORMALS[rng.integers(len(NORMALS))])))
        scene = {"plane": surface}
    elif what == "faces":
        scene = {"objects": (Faces(),)}
    else:
        surface = float(rng.integers(1, 16)) / 16
        scene = {"objects": (Isosurface((surface,)),)}
    scene |= {"field": "u", "camera": view, "size": size}
    # of isosurfaces of fields that are not polynomials nothing is proved
    return Case(
        f"ring, {what} {surface}, {view}", ring(), scene, partial(count, own, what, surface), what != "isosurface"
    )


def count(own, what, surface, case, frame):
    """The count of a picture of the ring."""
    rays = Rays(own, frame.view)
    rays.sides = None
    noise = float(rays.rounding.max())
    if what == "cut":
        parts = [plane_roots(rays, surface, inside(rays))]
    else:
        radii = (1.0, 2.0) if what == "faces" else (1.0 + surface,)
        parts = [surface_roots(rays, _squares(rays, radius), 4 * noise, inside(rays, "r")) for radius in radii]
    for axis in range(3) if what == "faces" else ():
        for side in (0.0, 1.0) if axis == 2 else (0.0,):
            q = rays.quadratics[:, axis] - [side, 0, 0]
            parts.append(surface_roots(rays, q, noise, inside(rays, "xyz"[axis])))
    field = None if what == "isosurface" else Radius()
    return validate(case, frame, Truth(rays.counted, *joined(parts), field, 1e-11), rays)


def _squares(rays, radius):
    """(n, 3) coefficients of x^2 + y^2 - radius^2 along rays whose coordinates are linear."""
    x, y = rays.quadratics[:, 0], rays.quadratics[:, 1]
    constant = x[:, 0] ** 2 + y[:, 0] ** 2 - radius**2
    linear = 2 * (x[:, 0] * x[:, 1] + y[:, 0] * y[:, 1])
    return np.stack([constant, linear, x[:, 1] ** 2 + y[:, 1] ** 2], axis=1)


def inside(rays, without=""):
    """The ring, for surface_roots, but for the coordinate that the surface itself holds."""
    slack = 4 * BORDER + 4 * float(rays.rounding.max())

    def within(points):
        x, y, z = points.T
        r = np.hypot(x, y)
        away = {"x": x, "y": y, "z": np.minimum(z, 1 - z), "r": np.minimum(r - 1, 2 - r)}
        least = np.min([value for name, value in away.items() if name != without], axis=0)
        return least >= -slack, least >= slack

    return within
