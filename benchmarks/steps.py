"""Frames of a series next to a single still: what a step costs where the mesh stays, and the memory of many steps.

python benchmarks/steps.py KIND CELLS STEPS SIDE DEVICE        one process that draws and prints JSON
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

from cases import FIELD, Case, mild
from measuring import ENVIRONMENT, Timing, forget_peak, peak_memory
from tables import Table, mebibytes, seconds

from elvis import Camera, Contours, CutSurface, Faces, Plane, Scene, Shape, Style, write
from elvis.renderer.film.animation import Film

#: what is drawn
LINES = Style(contours=Contours(count=10))
KINDS: dict[str, tuple[Any, ...]] = {
    "plane": (CutSurface(Plane((0.5, 0.5, 0.5), (0.1, 0.3, 1.0))),),
    "plane, 10 contours": (CutSurface(Plane((0.5, 0.5, 0.5), (0.1, 0.3, 1.0)), LINES),),
    "surfaces": (Faces(),),
    "surfaces, 10 contours": (Faces(style=LINES),),
}
#: states that are written; more steps are the same files again
STATES = 4


def measure(device: str, cells: int, steps: int, side: int, kinds: Sequence[str]) -> dict[str, Any]:
    """Each kind in a process of its own: seconds of stills and frames, peak memory after few and after all steps."""
    found: dict[str, Any] = {"steps": steps, "side": side, "kinds": {}}
    with tempfile.TemporaryDirectory(prefix="elvis-steps-") as folder:
        found["elements"] = write_steps(Path(folder), cells, steps)
        for kind in kinds:
            command = [sys.executable, __file__, kind, folder, str(side), device]
            process = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=ENVIRONMENT)
            found["kinds"][kind] = json.loads(process.stdout.splitlines()[-1])
    return found


def write_steps(folder: Path, cells: int, steps: int) -> int:
    """Quadratic tetrahedra with four cubic fields that grow from state to state; the number of elements."""
    dataset = Case("steps", Shape.TETRAHEDRON, cells, 2, 3, mild).dataset()
    (own,) = dataset.fields
    for state in range(min(STATES, steps)):
        fields = tuple(_scaled(own, name, 1.0 + 0.1 * state) for name in (FIELD, "v", "w", "p"))
        here = replace(dataset, fields=fields)
        write(here, folder / "case.xml" if state == 0 else None, folder / f"case_{state}.fld")
    for step in range(STATES, steps):
        os.link(folder / f"case_{step % STATES}.fld", folder / f"case_{step}.fld")
    return len(dataset.mesh.domain_ids())


def _scaled(field: Any, name: str, factor: float) -> Any:
    blocks = tuple(replace(block, coefficients=factor * block.coefficients) for block in field.blocks)
    return replace(field, name=name, blocks=blocks)


@contextmanager
def drawn(kind: str, folder: Path, side: int, device: str) -> Iterator[tuple[Film, list[Scene]]]:
    """The animation of a kind and the scenes of its frames."""
    camera = Camera((3.5, 2.5, 2.0), (0.5, 0.5, 0.5), height=1.8)
    data = tuple(map(str, [folder / "case.xml", *folder.glob("case_*.fld")]))
    look: dict[str, Any] = {"camera": camera, "size": (side, side), "range": (-3.0, 3.0), "outputs": ("frame.png",)}
    scene = Scene(FIELD, data=data, device=device, objects=KINDS[kind], step=0, **look)
    with Film(scene, is_kept=False) as film:
        assert film.series is not None
        yield film, [replace(scene, step=step) for step in range(len(film.series))]


def frames(kind: str, folder: Path, side: int, device: str) -> dict[str, Any]:
    """Stills of one step, then frames of all: with all that they take, and without reading."""
    still, bare, reading, whole = Timing(), Timing(), Timing(), Timing()
    with drawn(kind, folder, side, device) as (film, scenes):
        series = film.series
        assert series is not None
        for scene in (*scenes[:3], *scenes[:3]):
            film.draw(scene)
        for _ in range(3):
            still.run(lambda: film.draw(scenes[2]))

        # steps that are at hand
        for step in (0, 1, 0, 1, 0, 1):
            reading.run(lambda step=step: series[step])  # type: ignore[misc]
            bare.run(lambda step=step: film.draw(scenes[step]))  # type: ignore[misc]
        reading = Timing()
        for step in range(2, min(5, len(scenes))):
            reading.run(lambda step=step: series[step])  # type: ignore[misc]

        forget_peak()
        peaks = []
        for scene, following in zip(scenes, [*scenes[1:], None], strict=True):
            whole.run(lambda scene=scene, following=following: film.draw(scene, following))  # type: ignore[misc]
            peaks.append(peak_memory())
    times = {"still": still, "frame": bare, "reading": reading, "film": whole}
    found: dict[str, Any] = {name: median(timing.wall) for name, timing in times.items()}
    found |= {f"{name}, processor": timing.effort for name, timing in times.items()}
    return {**found, "peak early": peaks[min(4, len(peaks) - 1)], "peak": peaks[-1]}


def table(numbers: dict[str, Any]) -> Table:
    """One row a kind: processor seconds, which other programs hardly touch, and seconds by the clock."""
    columns = ["", "still, CPU s", "frame, CPU s", "ratio", "reading, CPU s", "film, s a frame", "MiB, 5 steps", "all"]
    title = f"{numbers['steps']} steps of {numbers['elements']:,} quadratic tetrahedra, four cubic fields"
    shown = Table(f"{title}, {numbers['side']}^2 pixels", columns)
    for kind, own in numbers["kinds"].items():
        cpu = [own[f"{name}, processor"] for name in ("still", "frame", "reading")]
        times = [seconds(cpu[0]), seconds(cpu[1]), f"{cpu[1] / cpu[0]:.2f}", seconds(cpu[2]), seconds(own["film"])]
        shown.rows.append([kind, *times, mebibytes(own["peak early"]), mebibytes(own["peak"])])
    shown.notes = [
        "*still*: the same step again; *frame*: another step that is in memory, its coefficients brought to the "
        "device.  *film*: frame after frame, reading included, the next step while one is drawn.  Limits: a ratio of "
        "1.3, and as much memory after all steps as after five.",
    ]
    return shown


if __name__ == "__main__":
    print(json.dumps(frames(sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), sys.argv[4])))
