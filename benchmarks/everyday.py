"""Ten integrals as engineers ask for them: forces, flow rates, averages, clipped volumes, areas and fluxes.

The requested error is the same whatever the tree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.data.dataset import Dataset
from elvis.core.integrals import integrate
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid

#: the error that is requested in all trees, in parts of the integral of the absolute value
ERROR = 1e-6
#: cells of a row: of tetrahedra, hexahedra and quadrilaterals, and of each where it is only seen whether they run
TETRAHEDRA, HEXAHEDRA, QUADRILATERALS, FEW = 6, 4, 12, 2


@dataclass(frozen=True)
class Everyday:
    """An integral.

    make   makes the data
    over   the target, as `integrate` names it
    clip   the surface that clips the elements; its inside is left out
    """

    make: Callable[[], Dataset]
    field: str
    over: str = "domain"
    clip: str | None = None

    def value(self) -> float:
        """The value of the integral."""
        return float(integrate(self.make(), self.field, self.over, error=ERROR, clip=self.clip)[0].value)


def integrals(quick: bool) -> dict[str, Everyday]:
    """The ten by name."""
    tetrahedra = partial(_flow, Shape.TETRAHEDRON, FEW if quick else TETRAHEDRA, 1, 3)
    bent = {order: partial(_flow, Shape.HEXAHEDRON, FEW if quick else HEXAHEDRA, order, order) for order in (2, 3, 4)}
    plane = partial(_flow, Shape.QUADRILATERAL, FEW if quick else QUADRILATERALS, 3, 3)
    mu = "0.01"
    stress = f"-p*nx+{mu}*(2*d(u,x)*nx+(d(u,y)+d(v,x))*ny+(d(u,z)+d(w,x))*nz)"
    flux = "u*nx+v*ny+w*nz"
    speed = "average(sqrt(u^2+v^2+w^2))"
    return {
        "force on all sides, straight tetrahedra": Everyday(tetrahedra, stress, "all"),
        "force on all sides, hexahedra of order 2": Everyday(bent[2], stress, "all"),
        "flow through a plane, straight tetrahedra": Everyday(tetrahedra, flux, "plane:0.47,0.5,0.5:1,0.2,0.1"),
        "flow through a plane, hexahedra of order 3": Everyday(bent[3], flux, "plane:0.47,0.5,0.5:1,0.2,0.1"),
        "average speed, hexahedra of order 4": Everyday(bent[4], speed),
        "average pressure above a plane, straight tetrahedra": Everyday(
            tetrahedra, "average(p)", clip="plane:0.47,0.5,0.5:1,0.2,0.1"
        ),
        "energy in a ball, straight tetrahedra": Everyday(
            tetrahedra, "(u^2+v^2+w^2)/2", clip="outside:sphere:0.5,0.45,0.52:0.3"
        ),
        "area of an isosurface, straight tetrahedra": Everyday(tetrahedra, "area", "p=0.2"),
        "flow through an isosurface, hexahedra of order 2": Everyday(bent[2], flux, "p=0.2"),
        "average pressure in a disc, quadrilaterals of order 3": Everyday(
            plane, "average(p)", clip="outside:sphere:0.5,0.45,0:0.3"
        ),
    }


@cache
def _flow(shape: Shape, cells: int, degree: int, order: int) -> Dataset:
    """A pressure and a velocity with about one wave per side on the unit cube or square, curved if degree > 1."""
    mesh = grid(shape, cells)
    mesh = curved(mesh, partial(_bend, shape.dimension), degree + 1) if degree > 1 else mesh
    known = Dataset(mesh)
    fields = {"p": _pressure, "u": partial(_velocity, 0), "v": partial(_velocity, 1), "w": partial(_velocity, 2)}
    names = list(fields)[: 1 + mesh.space]
    return Dataset(mesh, tuple(approximated(known, name, fields[name], order + 1) for name in names))


def _bend(dimension: int, points: Floats) -> Floats:
    """Points of the unit cube or square moved by waves."""
    moved = np.array(points, dtype=np.float64)
    for axis in range(dimension):
        other = points[..., (axis + 1) % dimension]
        moved[..., axis] += 0.02 * np.sin(4 * other + axis)
    return moved


def _pressure(points: Floats) -> Floats:
    x, y, z = points.T
    return np.asarray(np.sin(3 * x + 1) * np.cos(4 * y) * np.exp(z / 2))


def _velocity(axis: int, points: Floats) -> Floats:
    x, y, z = np.roll(points, -axis, axis=1).T
    return np.asarray(np.sin(3 * y + 1) * np.cos(2 * z) + (axis == 0) + x / 4)
