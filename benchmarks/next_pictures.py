"""First and next pictures of data that are examined brick by brick, and of the whole: seconds, memory, equal bytes.

python benchmarks/next_pictures.py [--cells 56] [--memory 256MiB] [--folder F]    prints a table

A process for each row draws a plane in three places, then outer faces from two sides, of native HDF5.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time
from typing import Any

from cases import million
from measuring import ENVIRONMENT, anonymous_memory
from tables import Table, seconds

from elvis import Camera, Faces, Plane, Scene, write
from elvis.core.base.terminal import warn
from elvis.renderer.asking.request import reading_for
from elvis.renderer.frame.rendering import Pictures
from elvis.renderer.parts.bricks import opening_for

NAMES = ("plane, first", "plane, next", "plane, next", "faces, first", "faces, next")


def scenes(memory: float | None) -> list[Scene]:
    """What is drawn, one after another."""
    planes = [Scene(field="u", plane=Plane((0.5, 0.45, z), (0.3, 0.2, 1.0))) for z in (0.52, 0.4, 0.7)]
    eyes = [(3.0, 2.0, 1.5), (-2.0, 2.5, 1.5)]
    cameras = [Camera(eye, (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), height=2.0) for eye in eyes]
    faces = [Scene(field="u", objects=(Faces(),), camera=camera) for camera in cameras]
    return [replace(scene, size=(1000, 1000), memory=memory) for scene in (*planes, *faces)]


def drawn(files: list[str], memory: float | None) -> list[dict[str, Any]]:
    """Of each picture seconds, processor seconds, anonymous memory after it, and a sum over its bytes."""
    found = []
    every = scenes(memory)
    clock, effort = perf_counter(), process_time()
    opened = opening_for(every)([Path(file) for file in files], reading_for(every), warn)
    with TemporaryDirectory() as folder, Pictures(opened) as pictures:
        del opened
        for scene in every:
            path = Path(folder) / "a.png"
            pictures.draw(replace(scene, outputs=(str(path),))).save(path, plain=True)
            spent = {"s": perf_counter() - clock, "CPU s": process_time() - effort}
            mark = hashlib.sha256(path.read_bytes()).hexdigest()
            found.append({**spent, "memory": anonymous_memory(), "mark": mark})
            clock, effort = perf_counter(), process_time()
    return found


def measured(files: list[str], memory: float | None) -> list[dict[str, Any]]:
    """The same, in a process of its own."""
    command = [sys.executable, __file__, "--draw", json.dumps([files, memory])]
    process = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, env=ENVIRONMENT)
    found: list[dict[str, Any]] = json.loads(process.stdout.splitlines()[-1])
    return found


def main() -> None:
    """Write the data, draw, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=56, help="along each side of a cube, six tetrahedra each (56)")
    parser.add_argument("--memory", type=float, default=256.0, help="limit in MiB (256)")
    parser.add_argument("--folder", type=Path, help="where the data are kept for the next time, or are")
    parser.add_argument("--draw", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.draw:
        print(json.dumps(drawn(*json.loads(asked.draw))))
        return
    case = million(cells=asked.cells)
    with TemporaryDirectory() as temporary:
        path = (asked.folder or Path(temporary)) / "million.xml"
        if not path.exists():
            write(case.dataset(), path, mesh_format="hdf5", field_format="hdf5")
        files = [str(path), str(path.with_suffix(".fld"))]
        whole, bricks = measured(files, None), measured(files, asked.memory * 2**20)
    table = Table(
        f"{case.label}, 1000 x 1000 pixels",
        ["", *(f"{name}, {of}" for of in ("whole", "bricks") for name in ("s", "CPU s", "MB after"))],
    )
    for name, *both in zip(NAMES, whole, bricks, strict=True):
        table.rows.append(
            [
                name,
                *(
                    cell
                    for own in both
                    for cell in (seconds(own["s"]), seconds(own["CPU s"]), f"{own['memory'] / 1e6:,.0f}")
                ),
            ]
        )
    is_same = all(a["mark"] == b["mark"] for a, b in zip(whole, bricks, strict=True))
    table.notes.append(f"The pictures are {'the same to the byte' if is_same else 'NOT the same'}.")
    print(table.text())


if __name__ == "__main__":
    main()
