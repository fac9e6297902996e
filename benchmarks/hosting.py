"""A step of PyFR as a host: processor seconds from solution points to a picture on disk, next to only drawing.

    python benchmarks/hosting.py [MESH.pyfrm ...] [--cells N] [--size 300x200 1000x1000] [--rounds N]

Without a mesh, one of hexahedra, pyramids, tetrahedra and prisms with N cells each way is made, which PyFR imports.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py  # type: ignore[import-untyped]
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "renderer" / "pyfr"))

from measuring import in_turn
from pyfr_running import imported
from tables import Table, seconds

from elvis import Scene, Session
from elvis.plugins.command.registry import load
from elvis.plugins.data.run_states import NodalStates
from elvis.renderer.frame.rendering import Pictures

NAMES = ("rho", "rhou", "rhov", "rhow", "E")
ORDER = 3
#: by kind: the solution points that PyFR takes, and how many there are at order 3
RULES = {
    "hex": ("gauss-legendre", 64),
    "pri": ("williams-shunn~gauss-legendre", 40),
    "pyr": ("gauss-legendre", 30),
    "tet": ("shunn-ham", 20),
}
#: by number of vertices: the type of an element in MSH 2.2, and its faces
SOLIDS = {
    4: (4, ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3))),
    5: (7, ((0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 3, 4))),
    6: (6, ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (0, 2, 5, 3))),
    8: (5, ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7))),
}
#: the same of faces
SIDES = {3: 2, 4: 3}


class Steps:
    """States of a solver on a mesh: a wave at the solution points of each element."""

    def __init__(self, mesh: Path) -> None:
        from pyfr.quadrules import get_quadrule

        self.source: Any = load("elvis.converters", "pyfr")([mesh])
        self.states = NodalStates(self.source, mesh.name)
        with h5py.File(mesh) as file:
            self.counts = {kind: len(file["eles"][kind]) for kind in file["eles"]}
        self.points = {kind: np.asarray(get_quadrule(kind, *RULES[kind]).pts) for kind in self.counts}

    def fields(self, step: int) -> Any:
        """What the first rank has of a step, once all ranks' parts are joined."""
        found = {}
        for kind, points in self.points.items():
            phase = np.arange(self.counts[kind])[:, None, None] + 0.1 * np.arange(len(NAMES))[:, None]
            found[kind] = points, 2.0 + 0.1 * np.sin(phase + points @ (0.3, 0.2, 0.1) + 0.01 * step)
        return self.source.state(NAMES, found, "[constants]\ngamma = 1.4\n")


def measure(mesh: Path, size: tuple[int, int], rounds: int, path: Path) -> list[str]:
    """A row: processor seconds of a step, of its conversion alone, and of drawing and writing data at hand, in turn."""
    whole, alone = Steps(mesh), Steps(mesh)
    scene = Scene("rho", size=size, outputs=(str(path),))
    at_hand = [alone.states.at(0.1 * step, alone.fields(step), ["rho"]) for step in range(2)]
    # what the solver computes is made before the clock runs
    coming = {steps: [steps.fields(step) for step in range(rounds + 1)] for steps in (whole, alone)}
    left = {steps: iter(fields) for steps, fields in coming.items()}
    turns = iter(range(rounds + 1))
    with Session(whole.states, scene) as session, Pictures(at_hand[0]) as pictures:
        session.show(0, 0.0, whole.fields(0))

        def draw() -> None:
            pictures.show(at_hand[next(turns) % 2])
            pictures.draw(scene).save(path)

        works = {
            "step": lambda: session.show(1, 0.0, next(left[whole])),
            "conversion": lambda: alone.states.at(0.0, next(left[alone]), ["rho"]),
            "drawing": draw,
        }
        times = in_turn(works, rounds)
        assert session.drawn == rounds + 2, session.faults
    cost = {name: timing.effort for name, timing in times.items()}
    usual = {name: float(np.median(timing.processor)) for name, timing in times.items()}
    numbers = [f"{sum(whole.counts.values()):,}", "x".join(map(str, size)), *map(seconds, cost.values())]
    return [*numbers, *(f"{some['step'] / some['drawing']:.2f}" for some in (cost, usual))]


def mixed(folder: Path, cells: int) -> Path:
    """A mesh of four layers: hexahedra, cells of 5 pyramids and 2 tetrahedra, of 2 prisms, of 6 tetrahedra."""
    numbers = np.arange((cells + 1) ** 2 * 5).reshape(5, cells + 1, cells + 1)
    z, y, x = np.meshgrid(np.arange(5.0), np.arange(cells + 1.0), np.arange(cells + 1.0), indexing="ij")
    # PyFR takes pyramids on parallelograms alone
    nodes = list(map(tuple, np.stack([x + 0.2 * z, y, z], axis=-1).reshape(-1, 3)))
    elements: list[tuple[int, ...]] = []
    for layer, row, column in np.ndindex(4, cells, cells):
        low, high = (numbers[layer + up, row : row + 2, column : column + 2] for up in range(2))
        (a, b), (d, c) = low.tolist()
        (e, f), (h, g) = high.tolist()
        if layer == 0:
            elements.append((a, b, c, d, e, f, g, h))
        elif layer == 1:
            apex = len(nodes)
            nodes.append(tuple(np.mean([nodes[i] for i in (a, b, c, d, e, f, g, h)], axis=0)))
            sides = [(a, b, c, d), (a, e, f, b), (b, f, g, c), (c, g, h, d), (d, h, e, a)]
            elements += [(*side, apex) for side in sides]
            elements += [(e, g, f, apex), (e, h, g, apex)]
        elif layer == 2:
            elements += [(a, b, c, e, f, g), (a, c, d, e, g, h)]
        else:
            turning, others = [(b, c), (d, h), (e, f)], [(c, d), (f, b), (h, e)]
            elements += [(a, *two, g) for two in (*turning, *others)]
    source, mesh = folder / "mixed.msh", folder / "mixed.pyfrm"
    source.write_text(msh(nodes, elements))
    imported(source, mesh)
    return mesh


def msh(nodes: Sequence[tuple[float, ...]], elements: Sequence[tuple[int, ...]]) -> str:
    """Elements as MSH 2.2, with those of their faces that are no other's as the boundary."""
    faces = [tuple(one[i] for i in side) for one in elements for side in SOLIDS[len(one)][1]]
    often = Counter(map(frozenset, faces))
    rows = [(SOLIDS[len(one)][0], 1, one) for one in elements]
    rows += [(SIDES[len(face)], 2, face) for face in faces if often[frozenset(face)] == 1]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "2", '3 1 "fluid"', '2 2 "wall"']
    lines += ["$EndPhysicalNames", "$Nodes", str(len(nodes))]
    lines += [f"{number} {x:.17g} {y:.17g} {z:.17g}" for number, (x, y, z) in enumerate(nodes, 1)]
    lines += ["$EndNodes", "$Elements", str(len(rows))]
    for number, (kind, group, corners) in enumerate(rows, 1):
        lines.append(" ".join(map(str, (number, kind, 2, group, group, *(i + 1 for i in corners)))))
    return "\n".join([*lines, "$EndElements", ""])


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("meshes", nargs="*", type=Path)
    parser.add_argument("--cells", type=int, default=18)
    parser.add_argument("--size", nargs="+", default=["300x200", "1000x1000"])
    parser.add_argument("--rounds", type=int, default=9)
    options = parser.parse_args()
    columns = ["elements", "pixels", "step, CPU s", "conversion", "drawing", "ratio", "of medians"]
    table = Table("A step of PyFR: values at solution points to a picture of all faces on disk", columns)
    with tempfile.TemporaryDirectory(prefix="elvis-hosting-") as name:
        folder = Path(name)
        for mesh in options.meshes or [mixed(folder, options.cells)]:
            for size in options.size:
                width, height = map(int, size.split("x"))
                table.rows.append(measure(mesh, (width, height), options.rounds, folder / "rho.png"))
    table.notes = ["The least of all rounds, in turn; *drawing*: the same of data that are at hand."]
    print(table.text())


if __name__ == "__main__":
    main()
