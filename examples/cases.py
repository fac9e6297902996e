"""The paper's cases, regenerated: meshes by Gmsh, fields as analytic expressions, all in the native format.

    python examples/cases.py [FOLDER] [NAME ...]       writes NAME.xml and NAME.fld (default: out/cases, all of them)
    python examples/cases.py --quick FOLDER            small ones, to see whether it runs

delta        half delta wing, about 5,000 straight tetrahedra, cubic u, v, w, p: a vortex at the leading edge (delta.py)
wing         wing like the ONERA M6, about 70,000 quadratic tetrahedra, thin at the wall, cubic p (wing.py)
hemisphere   about 440 quadratic tetrahedra of half a ball, a cubic wave
folded       one quadratic tetrahedron whose node (0.5, 0, 0) was moved to (0.5, 0, 0.6): it intersects itself.  Its
             field is its Jacobian determinant in parts of that of the straight one, 1 - 2.4 x' at reference points x'
twist        about 800 tetrahedra of a curved and twisted bar, maps of order 4, a field of order 7 that varies strongly

Running it again gives the same bytes.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import delta
import numpy as np
import wing
from meshing import meshed, name_sides, session

from elvis import Block, Dataset, Field, Shape, write
from elvis.core.base.arrays import Floats
from elvis.core.mapping.connectivity import connected
from elvis.core.mapping.geometry import geometry
from elvis.core.polynomials.expansion import values
from elvis.core.polynomials.interpolation import modified
from elvis.core.testing import approximated, curved
from elvis.core.validity.validity import ValidityStatus, validity

ROOT = Path(__file__).resolve().parent.parent
Function = Callable[[Floats], Floats]


def delta_wing(quick: bool) -> Dataset:
    """The half delta wing."""
    parts: dict[str, Function] = {
        name: lambda points, name=name: delta.flow(points)[name]  # type: ignore[misc]
        for name in ("u", "v", "w", "p")
    }
    return with_fields(delta.mesh(0.5 if quick else 1.0), parts, order=3)


def swept_wing(quick: bool) -> Dataset:
    """The wing like the ONERA M6."""
    return with_fields(wing.mesh(0.4 if quick else 1.47), {"p": wing.pressure}, order=3)


def hemisphere(quick: bool) -> Dataset:
    """Half a ball of radius 1 around the origin, z from 0 to 1."""
    with session() as gmsh:
        gmsh.model.occ.addSphere(0, 0, 0, 1, angle1=0)
        gmsh.model.occ.synchronize()
        name_sides(gmsh, {"base": lambda box: box[1, 2] < 1e-3, "dome": lambda box: True})
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.7 if quick else 0.31)
        dataset = meshed(gmsh, order=2)

    def wave(points: Floats) -> Floats:
        x, y, z = np.moveaxis(points, -1, 0)
        return np.asarray(np.sin(3 * x + 1) * np.cos(4 * y) * np.exp(z / 2))

    return with_fields(dataset, {"wave": wave}, order=3)


def folded(quick: bool) -> Dataset:
    """The tetrahedron that intersects itself, with its Jacobian."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    straight = connected(corners, {Shape.TETRAHEDRON: np.arange(4)[None]}, 3)

    def move(points: Floats) -> Floats:
        bubble = 4 * points[:, 0] * (1 - points.sum(axis=1))
        return np.asarray(points + 0.6 * bubble[:, None] * [0, 0, 1])

    dataset = Dataset(curved(straight, move, 3))
    expansion = modified(Shape.TETRAHEDRON, (2, 2, 2))
    at_vertices = 1 - 2.4 * corners[:, 0]
    modes = np.linalg.solve(values(expansion, Shape.TETRAHEDRON.vertices), at_vertices)
    ids = geometry(dataset)[0].element_ids
    return replace(dataset, fields=(Field("jacobian", (Block(expansion, ids, np.asarray(modes[None], np.float64)),)),))


def twist(quick: bool) -> Dataset:
    """A square bar that turns around itself by half while it goes around three quarters of a ring of radius 1."""
    with session() as gmsh:
        gmsh.model.occ.addBox(0, -0.4, -0.4, 4.8, 0.8, 0.8)
        gmsh.model.occ.synchronize()
        sides = {
            "start": lambda box: box[1, 0] < 0.1,
            "end": lambda box: box[0, 0] > 4.7,
            "sides": lambda box: True,
        }
        name_sides(gmsh, sides)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5 if quick else 0.29)
        straight = meshed(gmsh)

    def bend(points: Floats) -> Floats:
        along, across, up = np.moveaxis(points, -1, 0)
        turn, angle = np.pi * along / 4.8, 1.5 * np.pi * along / 4.8
        radius = 1 - across * np.cos(turn) + up * np.sin(turn)
        height = across * np.sin(turn) + up * np.cos(turn)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)

    def field(points: Floats) -> Floats:
        x, y, z = np.moveaxis(points, -1, 0)
        return np.asarray(np.sin(8 * x + 1) * np.cos(9 * y) * np.exp(z / 2))

    return with_fields(replace(straight, mesh=curved(straight.mesh, bend, 5)), {"u": field}, order=7)


def with_fields(dataset: Dataset, functions: dict[str, Function], order: int) -> Dataset:
    """The best approximations of some functions of the world coordinates (n, 3), on each element by itself."""
    bare = replace(dataset, fields=(), metadata={}, time=None)
    return replace(bare, fields=tuple(approximated(bare, name, f, order + 1) for name, f in functions.items()))


@dataclass(frozen=True)
class Case:
    """How a case is made, and how many of its elements may be invalid."""

    make: Callable[[bool], Dataset]
    invalid: int = 0


CASES = {
    "delta": Case(delta_wing),
    "wing": Case(swept_wing),
    "hemisphere": Case(hemisphere),
    "folded": Case(folded, invalid=1),
    "twist": Case(twist),
}


def main(arguments: list[str]) -> int:
    """Write the cases; 2 where a name is unknown, 1 where elements are invalid that shouldn't be."""
    parser = argparse.ArgumentParser(description="Write the cases of the gallery and of the benchmarks.")
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "out" / "cases", help="default: out/cases")
    parser.add_argument("names", nargs="*", metavar="CASE", help=f"all by default: {', '.join(CASES)}")
    parser.add_argument("--quick", action="store_true", help="coarse meshes")
    options = parser.parse_args(arguments)
    folder, names, quick = options.folder, options.names, options.quick
    unknown = [name for name in names if name not in CASES]
    if unknown:
        print(f"there is no case {unknown[0]}; the cases are {', '.join(CASES)}", file=sys.stderr)
        return 2
    folder.mkdir(parents=True, exist_ok=True)
    good = [write_case(name, folder, quick) for name in names or CASES]
    return 0 if all(good) else 1


def write_case(name: str, folder: Path, quick: bool) -> bool:
    """Make and write one case, tell what came out; whether its elements are as valid as they should be."""
    print(f"{name} ...", end=" ", flush=True)
    start = time.perf_counter()
    dataset = CASES[name].make(quick)
    write(dataset, folder / f"{name}.xml", folder / f"{name}.fld")
    found = validity(dataset)
    invalid = len(found) - found.count(ValidityStatus.POSITIVE)
    fields = ", ".join(field.name for field in dataset.fields)
    order = max(dataset.fields[0].blocks[0].expansion.modes) - 1
    took = time.perf_counter() - start
    print(f"{len(found):,} tetrahedra, {invalid} invalid; {fields} of order {order}; {took:.1f} s")
    return invalid == CASES[name].invalid


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
