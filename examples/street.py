"""A vortex street, computed by NGSolve: the channel with a cylinder of the DFG's benchmark 2D-2, Reynolds number 100.

    python examples/street.py [FOLDER]        writes street.xml and street_0.chk … street_35.chk (default: out/street)

Schäfer and Turek, Benchmark computations of laminar flow around a cylinder, 1996: a parabolic inflow of 1.5 at most, a
cylinder of diameter 0.1 a little below the middle of a channel of height 0.41, viscosity 0.001.  Taylor-Hood elements
of degrees 4 and 3 on curved triangles; convection is explicit, all else implicit (NGSolve's tutorial on the same flow).
The steps are about one period of the vortices after these have settled.  Takes some minutes.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import ngsolve as ng
from netgen.occ import Circle, OCCGeometry, Rectangle
from ngsolve import div, dx

import elvis

ROOT = Path(__file__).resolve().parent.parent
#: of the solver: step in time, viscosity; of what is retained: first and last time, steps
STEP, VISCOSITY = 0.0005, 0.001
FIRST, LAST, COUNT = 5.0, 5.35, 36


def channel() -> Any:
    """The mesh, whose triangles at the cylinder are curved by degree 4."""
    mesh = ng.Mesh(OCCGeometry(_shape(), dim=2).GenerateMesh(maxh=0.05))
    mesh.Curve(4)
    return mesh


def _shape() -> Any:
    """The channel without the cylinder, at which elements are smaller."""
    shape = Rectangle(2, 0.41).Face() - Circle((0.2, 0.2), 0.05).Face()
    shape.edges.name = "wall"
    min(shape.edges, key=lambda edge: abs(edge.center.x - 0.2) + abs(edge.center.y - 0.2)).maxh = 0.025
    _edge(shape, 0.0).name = "inlet"
    _edge(shape, 2.0).name = "outlet"
    return shape


def _edge(shape: Any, x: float) -> Any:
    """The straight edge at a place along the channel."""
    return min(shape.edges, key=lambda edge: abs(edge.center.x - x))


def solve(mesh: Any) -> Iterator[tuple[float, Any, Any]]:
    """Times, velocity and pressure after each step."""
    velocities = ng.VectorH1(mesh, order=4, dirichlet="wall|inlet")
    space = velocities * ng.H1(mesh, order=3)
    (u, p), (v, q) = space.TnT()
    stokes = ng.InnerProduct(VISCOSITY * ng.Grad(u), ng.Grad(v)) - div(u) * q - div(v) * p - 1e-10 * p * q
    stiffness = ng.BilinearForm(stokes * dx).Assemble()
    whole = ng.BilinearForm((ng.InnerProduct(u, v) + STEP * stokes) * dx).Assemble()
    convection = ng.BilinearForm(space, nonassemble=True)
    convection += ng.InnerProduct(ng.Grad(u) * u, v) * dx
    flow = ng.GridFunction(space)
    velocity, pressure = flow.components
    inflow = 1.5 * 4 * ng.y * (0.41 - ng.y) / 0.41**2
    velocity.Set(ng.CF((inflow, 0)), definedon=mesh.Boundaries("inlet"))
    # the flow begins as Stokes' flow
    free = space.FreeDofs()
    flow.vec.data -= stiffness.mat.Inverse(free, inverse="umfpack") * (stiffness.mat * flow.vec)
    inverse = whole.mat.Inverse(free, inverse="umfpack")
    residual = flow.vec.CreateVector()
    time = 0.0
    while True:
        convection.Apply(flow.vec, residual)
        residual.data += stiffness.mat * flow.vec
        flow.vec.data -= STEP * inverse * residual
        time += STEP
        yield time, velocity, pressure


def main() -> None:
    """Write the mesh and the steps."""
    parser = argparse.ArgumentParser(description="Compute a vortex street with NGSolve, some minutes long.")
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "out" / "street", help="default: out/street")
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    mesh = channel()
    wanted = [FIRST + (LAST - FIRST) * number / (COUNT - 1) for number in range(COUNT)]
    number = 0
    for time, velocity, pressure in solve(mesh):
        if time < wanted[number] - STEP / 2:
            continue
        _write(mesh, {"velocity": velocity, "p": pressure}, time, folder, number)
        number += 1
        if number == COUNT:
            return


def _write(mesh: Any, fields: dict[str, Any], time: float, folder: Path, number: int) -> None:
    """A step, with the mesh next to the first."""
    dataset = elvis.from_ngsolve(mesh, fields, time=round(time, 9))
    if number == 0:
        elvis.write(dataset, folder / "street.xml", folder / "street_0.chk")
    else:
        elvis.write(dataset, field_path=folder / f"street_{number}.chk")
    print(f"time {time:.3f}: {folder / f'street_{number}.chk'}", flush=True)


if __name__ == "__main__":
    main()
