"""Pictures of a running solver: what a step costs next to only drawing, and the memory of many steps.

python benchmarks/running.py CELLS SIDE STEPS DEVICE       one process that draws and prints JSON
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import measuring
import numpy as np
from measuring import ENVIRONMENT, Timing
from tables import Table, mebibytes, seconds

from elvis import Plane, Scene, Session, from_arrays
from elvis.core.polynomials.quadrature import lobatto
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import tensor_nodes
from elvis.renderer.frame.rendering import Pictures

#: of the hexahedra's nodal values
ORDER = 4
#: steps of which seconds are taken
TIMED = 9
PLANE = Plane((0.5, 0.5, 0.5), (0.1, 0.3, 1.0))


def measure(device: str, cells: int, side: int, steps: int) -> dict[str, Any]:
    """In a process of its own."""
    command = [sys.executable, __file__, str(cells), str(side), str(steps), device]
    process = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=ENVIRONMENT)
    numbers: dict[str, Any] = json.loads(process.stdout.splitlines()[-1])
    return {"elements": cells**3, "side": side, "steps": steps, **numbers}


def places(cells: int) -> Any:
    """(elements, nodes, 3) of hexahedra that are curved along one direction."""
    nodes = np.asarray(tensor_nodes(Shape.HEXAHEDRON, tuple(lobatto(ORDER + 1)[0].tolist())))
    corners = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    found = (corners + (nodes + 1) / 2) / cells
    found[..., 2] += 0.05 * np.sin(3 * found[..., 0])
    return found


def values(nodes: Any, step: int) -> Any:
    """Those of a wave at a step."""
    return np.sin(3 * nodes[..., 0] + 0.01 * step) * np.cos(2 * nodes[..., 1])


def steps_of(cells: int, side: int, steps: int, device: str) -> dict[str, Any]:
    """Seconds of a step in situ and of drawing a state that is at hand, in turn; memory early and late."""
    nodes, whole, drawing = places(cells), Timing(), Timing()
    with tempfile.TemporaryDirectory(prefix="elvis-running-") as folder:
        scene = Scene("u", plane=PLANE, size=(side, side), range=(-1.0, 1.0), device=device)
        path = Path(folder) / "u.png"
        mesh = {"hexahedron": nodes}
        states = [from_arrays(mesh, u=values(nodes, step)) for step in range(2)]
        with Session(mesh, scene, output=str(path)) as session, Pictures(states[0], device) as pictures:

            def solve(step: int) -> None:
                session.show(step, 0.0, {"u": values(nodes, step)})

            def draw(step: int) -> None:
                pictures.show(states[step % 2])
                pictures.draw(scene).save(path)

            for step in range(3):
                solve(step)
                draw(step)
            for step in range(3, TIMED + 3):
                whole.run(partial(solve, step))
                drawing.run(partial(draw, step))
            assert session.drawn == TIMED + 3, session.faults
            memory = []
            small = Session(mesh, scene, size=(64, 64), output=str(path))
            for step in range(steps):
                small.show(step, 0.0, {"u": values(nodes, step)})
                memory.append(measuring.memory())
            small.close()
    times = {"step": whole, "drawing": drawing}
    found: dict[str, Any] = {name: median(timing.wall) for name, timing in times.items()}
    found |= {f"{name}, processor": timing.effort for name, timing in times.items()}
    return {**found, "memory early": memory[steps // 8], "memory": memory[-1]}


def table(numbers: dict[str, Any]) -> Table:
    """Processor seconds, which other programs hardly touch, and seconds by the clock."""
    title = f"In situ: {numbers['elements']:,} hexahedra of order {ORDER}, {numbers['side']}^2 pixels"
    columns = [
        "step, CPU s",
        "drawing, CPU s",
        "ratio",
        "step, s",
        "drawing, s",
        "MiB, early",
        f"{numbers['steps']} steps",
    ]
    shown = Table(title, columns)
    cpu = [numbers["step, processor"], numbers["drawing, processor"]]
    times = [seconds(cpu[0]), seconds(cpu[1]), f"{cpu[0] / cpu[1]:.2f}", seconds(numbers["step"])]
    shown.rows.append(
        [*times, seconds(numbers["drawing"]), mebibytes(numbers["memory early"]), mebibytes(numbers["memory"])]
    )
    shown.notes = [
        "*step*: arrays of nodal values to a picture on disk; *drawing*: the same of coefficients that are at hand. "
        "Limits: a ratio of 1.1, and as much memory after all steps as after an eighth.",
    ]
    return shown


if __name__ == "__main__":
    print(json.dumps(steps_of(*map(int, sys.argv[1:4]), sys.argv[4])))
