"""Further sample data: solutions whose every detail is known, on curved meshes.

cylinder  2D, triangles of a quadratic map, field order 8: potential flow past a cylinder with circulation
bend      3D, hexahedra of a quartic map, field order 5: flow with two vortices through a curved duct
blocks    3D, all four volume shapes in one mesh, quadratic map, field order 6
wave      2D, a series of nine steps: a standing wave that loses strength, of order 7
resolved  2D, 64 squares of order 4 with a smooth field, a layer, a shock and a corner
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.data.dataset import Dataset
from elvis.core.data.mesh import Composite, Mesh
from elvis.core.mapping.connectivity import connected
from elvis.core.shapes import Shape
from elvis.core.testing.bending import curved
from elvis.core.testing.fields import approximated
from elvis.core.testing.meshes import grid, mixed_volume

Function = Callable[[Floats], Floats]
CIRCULATION = 2.5
#: sides of the polygons, and layers of elements, of the ring
AROUND = 12


def annulus() -> Mesh:
    """The ring between the circles of radius 1 and 5, finer towards the cylinder, in triangles of a quadratic map."""
    ring, layer = np.meshgrid(np.arange(AROUND), np.arange(AROUND + 1), indexing="ij")
    radius, angle = 5.0 ** (layer / AROUND), 2 * np.pi * ring / AROUND
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * radius], axis=-1).reshape(-1, 3)

    # two triangles on each side of a polygon in each layer
    rows = np.arange(len(vertices)).reshape(AROUND, AROUND + 1)
    after = np.roll(rows, -1, axis=0)
    a, b, c, d = (own.ravel() for own in (rows[:, :-1], after[:, :-1], after[:, 1:], rows[:, 1:]))
    triangles = np.concatenate([np.stack([a, c, b], axis=1), np.stack([a, d, c], axis=1)])
    straight = replace(connected(vertices, {Shape.TRIANGLE: triangles}), space=2)
    mesh = curved(straight, rounded, 3)

    edges = mesh.of(Shape.SEGMENT)
    away = np.linalg.norm(vertices[edges.members], axis=2)
    circles = {"cylinder": (away < 1 + 1e-9).all(axis=1), "far": (away > 5 - 1e-9).all(axis=1)}
    own = [Composite(number, (("E", edges.ids[on]),), name) for number, (name, on) in enumerate(circles.items(), 1)]
    return replace(mesh, composites=(mesh.composites[0], *own))


def rounded(points: Floats) -> Floats:
    """Polygons to circles: the middles of sides are nearer to the centre by the cosine of half their angle."""
    step = 2 * np.pi / AROUND
    off = np.mod(np.arctan2(points[..., 1], points[..., 0]), step) - step / 2
    return np.asarray(points * (np.cos(off) / np.cos(step / 2))[..., None])


def cylinder_flow(points: Floats) -> tuple[Floats, Floats]:
    """Velocity of the potential flow past the unit cylinder, speed 1 far away, with circulation."""
    z = points[..., 0] + 1j * points[..., 1]
    w = 1 - 1 / z**2 - 1j * CIRCULATION / (2 * np.pi * z)
    return np.asarray(w.real, np.float64), np.asarray(-w.imag, np.float64)


def cylinder() -> Dataset:
    """Fields u, v and pressure coefficient Cp around a cylinder."""
    mesh = annulus()

    def pressure(points: Floats) -> Floats:
        u, v = cylinder_flow(points)
        return np.asarray(1 - u**2 - v**2)

    functions: dict[str, Function] = {
        "u": lambda points: cylinder_flow(points)[0],
        "v": lambda points: cylinder_flow(points)[1],
        "Cp": pressure,
    }
    return with_fields(mesh, functions, modes=9)


def duct(points: Floats) -> Floats:
    """Unit cube to a square duct of side 1 that turns by 90 degrees around the z axis at the radius 2."""
    angle = 0.5 * np.pi * (1 - points[..., 0])
    radius = 1.5 + points[..., 1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), points[..., 2] - 0.5], axis=-1)


def speed_in_duct(points: Floats) -> Floats:
    """An axial profile, pushed outwards, with the dents of two counter-rotating vortices."""
    across = np.hypot(points[..., 0], points[..., 1]) - 2.0
    along, height = np.arctan2(points[..., 1], points[..., 0]), points[..., 2]
    profile = (1 - 4 * across**2) * (1 - 4 * height**2) * (1 + across * (1 + along))
    dents = sum(np.exp(-40 * ((across + 0.12) ** 2 + (height - side) ** 2)) for side in (-0.22, 0.22))
    return np.asarray(profile * (1 - 0.5 * np.sin(along) ** 2 * dents))


def bend() -> Dataset:
    """The speed in a curved duct."""
    mesh = curved(grid(Shape.HEXAHEDRON, 5), duct, 5)
    return with_fields(mesh, {"speed": speed_in_duct}, modes=6)


def ripples(points: Floats) -> Floats:
    """A gentle warp of space."""
    x, y, z = np.moveaxis(points, -1, 0)
    return np.stack([x + 0.06 * np.sin(3 * y + z), y + 0.06 * np.sin(2 * z + x), z + 0.06 * np.sin(2 * x + y)], axis=-1)


def blocks() -> Dataset:
    """A wave over tetrahedra, pyramids, prisms and a hexahedron."""
    mesh = curved(mixed_volume(), ripples, 3)
    functions: dict[str, Function] = {"wave": lambda p: np.sin(4 * p[..., 0] + 3 * p[..., 1]) * np.cos(3 * p[..., 2])}
    return with_fields(mesh, functions, modes=7)


def with_fields(mesh: Mesh, functions: dict[str, Function], modes: int) -> Dataset:
    """The mesh with the best approximations of some functions, each element by itself."""
    bare = Dataset(mesh)
    fields = tuple(approximated(bare, name, function, modes) for name, function in functions.items())
    return replace(bare, fields=fields, time=0.0)


def wave() -> list[Dataset]:
    """The steps of a field u of order 7 on 16 squares, at times 0 to 2."""
    mesh = grid(Shape.QUADRILATERAL, 4)
    times = [step / 4 for step in range(9)]
    return [Dataset(mesh, (approximated(Dataset(mesh), "u", partial(_wave, time), 8),), time) for time in times]


def _wave(time: float, x: Floats) -> Floats:
    """Values (n,) of the wave at points (n, 3)."""
    shape = np.cos(2 * np.pi * x[:, 0]) * np.cos(np.pi * x[:, 1])
    moving = np.sin(3 * np.pi * x[:, 0]) * np.sin(2 * np.pi * x[:, 1])
    waves: Floats = np.exp(-time / 4) * (np.cos(np.pi * time) * shape + np.sin(np.pi * time) * moving)
    return waves


def resolved() -> Dataset:
    """A square with fields that are resolved well and badly: smooth, layer, shock, corner (r^(2/3) sin(2 θ / 3))."""
    dataset = Dataset(grid(Shape.QUADRILATERAL, 8))
    functions = {
        "smooth": lambda x: np.sin(2 * x[:, 0]) * np.cos(3 * x[:, 1]),
        "layer": lambda x: np.tanh((x[:, 0] - 0.55) / 0.05),
        "shock": lambda x: np.tanh((x[:, 0] + x[:, 1] / 2 - 0.61) / 0.002),
        "corner": lambda x: np.hypot(x[:, 0], x[:, 1]) ** (2 / 3) * np.sin(2 / 3 * np.arctan2(x[:, 1], x[:, 0])),
    }
    fields = (approximated(dataset, name, function, modes=5) for name, function in functions.items())
    return replace(dataset, fields=tuple(fields))
