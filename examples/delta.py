"""The half delta wing: its shape, the distance to it, and a flow with a vortex along its leading edge.

The wing is flat above, bevelled below; its leading edge runs from the apex, the origin, to (1, tan 15 deg, 0), and
y = 0 is the plane of symmetry.  The flow is an analytic expression, not a solution: a stream at 12.5 degrees, a conical
Lamb-Oseen vortex with its mirror image, and a layer in which it comes to rest at the wall.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from meshing import meshed, name_sides, session, size_field

from elvis import Dataset
from elvis.core.base.arrays import Bools, Floats

SLOPE = np.tan(np.radians(15))
BEVEL, THICKNESS, ANGLE = 0.1, 0.024, np.radians(12.5)
BOX = np.array([[-1.0, 0.0, -1.0], [2.5, 1.2, 1.2]])

#: apex, tip and root of the trailing edge, above and below
CORNERS = np.array(
    [
        [0, 0, 0],
        [1, SLOPE, 0],
        [1, 0, 0],
        [BEVEL, 0, -THICKNESS],
        [1, SLOPE * (1 - BEVEL), -THICKNESS],
        [1, 0, -THICKNESS],
    ]
)
#: top, bottom, root, trailing edge, bevel
POLYGONS = ((0, 1, 2), (3, 5, 4), (0, 2, 5, 3), (1, 4, 5, 2), (0, 3, 4, 1))
#: the same without the root, which lies in the plane of symmetry, as triangles
TRIANGLES = CORNERS[[[0, 1, 2], [3, 5, 4], [1, 4, 5], [1, 5, 2], [0, 3, 4], [0, 4, 1]]]


def mesh(fineness: float = 1.0) -> Dataset:
    """Straight tetrahedra around the wing, about 5,000 at fineness 1; more as its cube."""
    with session() as gmsh:
        occ = gmsh.model.occ
        low, high = BOX
        air = occ.addBox(*low, *(high - low))
        occ.cut([(3, air)], [(3, _wing(occ))])
        occ.synchronize()
        sides = {
            "symmetry": lambda box: np.abs(box[:, 1]).max() < 1e-3,
            "wing": lambda box: bool(
                (box[0] > CORNERS.min(axis=0) - 1e-3).all() and (box[1] < CORNERS.max(axis=0) + 1e-3).all()
            ),
            "far": lambda box: True,
        }
        name_sides(gmsh, sides)
        boxes = [
            (0.0487, 0.6, np.array([[0.0, 0, -0.04], [1.0, 0.28, 0.17]])),
            (0.08, 0.6, np.array([[1.0, 0, 0.0], [1.6, 0.28, 0.24]])),
        ]
        size_field(gmsh, [(size / fineness, width, box) for size, width, box in boxes], 0.7 / fineness)
        return meshed(gmsh)


def _wing(occ: Any) -> int:
    points = [occ.addPoint(*corner) for corner in CORNERS]
    lines: dict[tuple[int, int], int] = {}

    def line(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in lines:
            lines[key] = occ.addLine(points[key[0]], points[key[1]])
        return lines[key]

    faces = []
    for polygon in POLYGONS:
        loop = occ.addCurveLoop([line(a, b) for a, b in zip(polygon, (*polygon[1:], polygon[0]), strict=True)])
        faces.append(occ.addPlaneSurface([loop]))
    return int(occ.addVolume([occ.addSurfaceLoop(faces)]))


def flow(points: Floats) -> dict[str, Floats]:
    """Velocity u, v, w and pressure coefficient p at points (n, 3)."""
    x, y, z = np.moveaxis(points, -1, 0)
    along = _smooth_step(x)
    core_y, core_z, core = 0.64 * SLOPE * along, 0.11 * along + 0.06 * (x - along), 0.03 + 0.035 * along
    strength = -0.085 * along

    # the vortex and its image turn opposite ways
    squares = [(y - side * core_y) ** 2 + (z - core_z) ** 2 for side in (1, -1)]
    rates = [side * strength * _lamb(square, core) for side, square in zip((1, -1), squares, strict=True)]
    v = sum(rate * (z - core_z) for rate in rates)
    w = np.sin(ANGLE) - sum(rate * (y - side * core_y) for rate, side in zip(rates, (1, -1), strict=True))
    jet = np.exp(-squares[0] / core**2)
    u = np.cos(ANGLE) + 0.45 * jet * along

    calm = 1 - np.exp(-((distance(points) / 0.025) ** 2))
    p = 1 - (u**2 + v**2 + w**2) - 1.1 * along * jet
    return {"u": u * calm, "v": v * calm, "w": w * calm, "p": p}


def _smooth_step(x: Floats) -> Floats:
    """0 far upstream, x over the wing, 1 behind it, without kinks."""
    return np.asarray(0.08 * (np.logaddexp(0, x / 0.08) - np.logaddexp(0, (x - 1) / 0.08)))


def _lamb(square: Floats, core: Floats) -> Floats:
    """(1 - exp(-r^2/c^2)) / r^2, finite at the axis."""
    ratio = square / core**2
    return np.asarray(-np.expm1(-ratio) / np.where(ratio > 1e-12, square, core**2 * 1e-12))


def distance(points: Floats) -> Floats:
    """(n,) distance to the wing."""
    return np.min([_triangle_distance(points, triangle) for triangle in TRIANGLES], axis=0)


def _height(points: Floats, triangle: Floats) -> Floats:
    """(n,) distance to the plane of a triangle."""
    return np.abs((points - triangle[0]) @ _normal(triangle))


def _above(points: Floats, triangle: Floats) -> Bools:
    """(n,) whether the nearest point of the plane of a triangle (3, 3) is in the triangle."""
    sides = [
        (points - a) @ np.cross(_normal(triangle), b - a) >= 0
        for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True)
    ]
    return np.asarray(np.all(sides, axis=0))


def _normal(triangle: Floats) -> Floats:
    normal = np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0])
    return np.asarray(normal / np.linalg.norm(normal))


def _triangle_distance(points: Floats, triangle: Floats) -> Floats:
    """(n,) distance to a triangle (3, 3): to its plane above and below it, else to an edge."""
    edges = np.full(len(points), np.inf)
    for a, b in zip(triangle, np.roll(triangle, -1, axis=0), strict=True):
        t = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        edges = np.minimum(edges, np.linalg.norm(points - a - t[:, None] * (b - a), axis=1))
    return np.where(_above(points, triangle), _height(points, triangle), edges)
