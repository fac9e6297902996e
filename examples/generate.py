"""Make the sample data: solutions whose every detail is known, on curved meshes.

    python examples/generate.py [FOLDER]        writes them into FOLDER (default: out/data)

cylinder  2D, triangles of a quadratic map, field order 8: potential flow past a cylinder with circulation
bend      3D, hexahedra of a quartic map, field order 5: flow with two vortices through a bent duct
blocks    3D, all four volume shapes in one mesh, quadratic map, field order 6
eddies    2D, quadrilaterals of order 7, as NekRS and Nek5000 write them: Walsh's eddies, which only decay

All but the last in the native format.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from elvis import Dataset, Mesh, Shape, write
from elvis.core.arrays import Floats
from elvis.core.polynomials.quadrature import lobatto
from elvis.core.testing.bending import curved
from elvis.core.testing.fields import approximated
from elvis.core.testing.meshes import grid, mixed_volume

Function = Callable[[Floats], Floats]
CIRCULATION = 2.5


def annulus(points: Floats) -> Floats:
    """Unit square to the ring between the radii 1 and 5, finer towards the cylinder."""
    radius = 5.0 ** points[..., 1]
    angle = -2 * np.pi * points[..., 0]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), 0 * radius], axis=-1)


def cylinder_flow(points: Floats) -> tuple[Floats, Floats]:
    """Velocity of the potential flow past the unit cylinder, speed 1 far away, with circulation."""
    z = points[..., 0] + 1j * points[..., 1]
    w = 1 - 1 / z**2 - 1j * CIRCULATION / (2 * np.pi * z)
    return w.real, -w.imag


def cylinder() -> Dataset:
    """Fields u, v and pressure coefficient Cp around a cylinder."""
    mesh = curved(grid(Shape.TRIANGLE, 12), annulus, 3)

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
    """The speed in a bent duct."""
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


def eddies(path: Path, cells: int = 8, order: int = 7) -> None:
    """Eddies of Walsh (1992), a flow that only decays, on a wavy mesh of cells^2 elements, in Nek's format.

    Its stream function 0.2 (cos 5x + cos 5y) + 0.3 sin 3x sin 4y is one of the Laplacian's, to the eigenvalue -25.
    """
    nodes = (np.arange(cells)[:, None] + (lobatto(order + 1)[0] + 1) / 2) / cells
    s, t = np.broadcast_arrays(nodes[None, :, None, :], nodes[:, None, :, None])
    wave = 0.03 * np.sin(2 * np.pi * s) * np.sin(2 * np.pi * t)
    x, y = 2 * np.pi * (s + wave), 2 * np.pi * (t + wave)
    u = -np.sin(5 * y) + 1.2 * np.sin(3 * x) * np.cos(4 * y)
    v = np.sin(5 * x) - 0.9 * np.cos(3 * x) * np.sin(4 * y)
    # element by element, first all x, then all y; the number tells the order of bytes
    count = cells**2
    head = f"#std 8 {order + 1:2d} {order + 1:2d}  1 {count:10d} {count:10d} {0.0:20.13E} {0:9d}      0      1 XU"
    parts = [np.stack([part.reshape(count, -1) for part in pair], axis=1) for pair in ((x, y), (u, v))]
    content = [
        np.array([6.54321], "<f4"),
        np.arange(1, count + 1, dtype="<i4"),
        *(part.astype("<f8") for part in parts),
    ]
    path.write_bytes(head.ljust(132).encode() + b"".join(part.tobytes() for part in content))


SAMPLES: dict[str, Callable[[], Dataset]] = {"cylinder": cylinder, "bend": bend, "blocks": blocks}


def main(folder: Path) -> None:
    """Write every sample as NAME.xml and NAME.fld, and one as Nek does."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in SAMPLES.items():
        write(make(), folder / f"{name}.xml", folder / f"{name}.fld")
    eddies(folder / "eddies0.f00000")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "out/data"))
