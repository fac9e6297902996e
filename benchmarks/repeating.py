"""Many small pictures in one process, from new renderers and from a kept one: what it holds meanwhile.

python benchmarks/repeating.py KIND COUNT DEVICE        one process that draws and prints JSON
"""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import Any

from cases import FIELD, Case, mild
from tables import Table, mebibytes, seconds

from elvis.formats import Dataset, Shape
from elvis.renderer import Camera, Faces, Isosurface, Plane, Renderer, Scene, render

KINDS = {"new": "a new renderer for each picture", "kept": "one renderer for all pictures"}
#: how often it is read what the process holds
READINGS = 10
_VIEW: dict[str, Any] = {"camera": Camera((2.9, -2.1, 1.9), (0.5, 0.5, 0.5), height=1.8), "size": (60, 50)}
SCENES = (
    Scene(FIELD, objects=(Faces(),), **_VIEW),
    Scene(FIELD, plane=Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0)), **_VIEW),
    Scene(FIELD, objects=(Isosurface((0.3,)),), **_VIEW),
)


def measure(device: str, count: int) -> dict[str, Any]:
    """Draw ``count`` pictures of each kind, in a process of its own."""
    found: dict[str, Any] = {"count": count}
    for kind in KINDS:
        command = [sys.executable, __file__, kind, str(count), device]
        process = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
        found[kind] = json.loads(process.stdout.splitlines()[-1])
    return found


@contextmanager
def drawing(kind: str, dataset: Dataset, device: str) -> Iterator[Callable[[Scene], object]]:
    """What draws a scene."""
    if kind == "new":
        yield lambda scene: render(dataset, scene, device=device)
        return
    with Renderer(device) as renderer:
        renderer.load(dataset, FIELD)
        yield renderer.render


def pictures(kind: str, count: int, device: str) -> dict[str, Any]:
    """Draw the scenes in turn, without the garbage collector; what the process holds after some of the pictures."""
    dataset = Case("small", Shape.TETRAHEDRON, 2, 2, 3, mild).dataset()
    readings = {round(count * k / READINGS) for k in range(1, READINGS + 1)}
    rows = []
    with drawing(kind, dataset, device) as draw:
        # what is compiled and loaded once
        for scene in SCENES:
            draw(scene)
        gc.collect()
        gc.disable()
        rows.append({"pictures": 0, **held()})
        start = perf_counter()
        for number in range(1, count + 1):
            draw(SCENES[number % len(SCENES)])
            if number in readings:
                rows.append({"pictures": number, **held()})
        each = (perf_counter() - start) / count
    return {"rows": rows, "seconds": each}


def held() -> dict[str, int]:
    """Bytes in memory, threads and descriptors of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    threads, descriptors = (len(os.listdir(f"/proc/self/{name}")) for name in ("task", "fd"))
    return {"bytes": pages * os.sysconf("SC_PAGE_SIZE"), "threads": threads, "descriptors": descriptors}


def table(numbers: dict[str, Any]) -> Table:
    """First and last reading, and the most of all, for each kind."""
    columns = ["", "s a picture", "MiB before", "MiB after", "most", "threads", "after", "descriptors", "after"]
    shown = Table(f"{numbers['count']} small pictures in one process", columns)
    for kind, words in KINDS.items():
        rows = numbers[kind]["rows"]
        first, last = rows[0], rows[-1]
        memory = [mebibytes(each) for each in (first["bytes"], last["bytes"], max(row["bytes"] for row in rows))]
        counts = [str(each[name]) for name in ("threads", "descriptors") for each in (first, last)]
        shown.rows.append([words, seconds(numbers[kind]["seconds"]), *memory, *counts])
    shown.notes = ["Faces, cuts and isosurfaces of 48 quadratic tetrahedra in turn; the garbage collector is off."]
    return shown


if __name__ == "__main__":
    print(json.dumps(pictures(sys.argv[1], int(sys.argv[2]), sys.argv[3])))
