"""Many small pictures in one process, from new renderers and from a kept one: what it holds meanwhile.

Then the host's share of a steady frame: 16 x 16 pixels of a small scene whose camera turns.

python benchmarks/repeating.py KIND COUNT DEVICE        one process that draws and prints JSON
"""

from __future__ import annotations

import gc
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from time import perf_counter, process_time, thread_time
from typing import Any

import numpy as np
from cases import FIELD, Case, mild
from tables import Table, mebibytes, seconds

from elvis import (
    Camera,
    CutSurface,
    Dataset,
    Faces,
    Isosurface,
    Plane,
    Renderer,
    Scene,
    Shape,
    Style,
    Transfer,
    VolumeRendering,
    render,
)
from elvis.renderer.device.device import Device, Kernel
from elvis.renderer.frame.rendering import Pictures

KINDS = {"new": "a new renderer for each picture", "kept": "one renderer for all pictures"}
#: how often it is read what the process holds
READINGS = 10
_VIEW: dict[str, Any] = {"camera": Camera((2.9, -2.1, 1.9), (0.5, 0.5, 0.5), height=1.8), "size": (60, 50)}
SCENES = (
    Scene(FIELD, objects=(Faces(),), **_VIEW),
    Scene(FIELD, plane=Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0)), **_VIEW),
    Scene(FIELD, objects=(Isosurface((0.3,)),), **_VIEW),
)
CUT = Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0))
VOLUME = VolumeRendering(Transfer((-1.0, 1.0), (0.5, 1.0)))
#: what steady frames show, by name
STEADY: dict[str, tuple[Any, ...]] = {
    "cut": (CutSurface(CUT),),
    "faces": (Faces(),),
    "isosurface": (Isosurface((0.3,)),),
    "volume": (VOLUME,),
    "all in one": (CutSurface(CUT), Faces(style=Style(opacity=0.5)), Isosurface((0.3,)), VOLUME),
}
#: pictures alone, in a range that is known
_SEEN: dict[str, Any] = {"outputs": ("picture.png",), "range": (-1.0, 1.0)}
#: what is counted of the device's work, and the method that does it
WORK = {"uploads": (Device, "buffer"), "dispatches": (Kernel, "_dispatch"), "read-backs": (Device, "read")}


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


def steady(device: str, count: int, quick: bool) -> dict[str, Any]:
    """Milliseconds of a steady frame, and what of the device's work it asks for, on straight and on curved elements.

    quick  only what is drawn in the other table as well
    """
    found: dict[str, Any] = {"count": count}
    names = ("cut", "faces", "isosurface") if quick else tuple(STEADY)
    for degree, words in ((2, "curved"),) if quick else ((1, "straight"), (2, "curved")):
        dataset = Case("small", Shape.TETRAHEDRON, 2, degree, 3, mild).dataset()
        with Pictures(dataset, device) as pictures:
            found[words] = {name: _frames(pictures, STEADY[name], count) for name in names}
    return found


def _frames(pictures: Pictures, objects: tuple[Any, ...], count: int) -> dict[str, float]:
    """The same for one scene: medians over the frames of a camera that turns, after as many that don't count."""
    scenes = [Scene(FIELD, camera=_turned(k), size=(16, 16), objects=objects, **_SEEN) for k in range(2 * count)]
    for scene in scenes[:count]:
        pictures.draw(scene)
    rows = []
    with counted() as work:
        made = pictures.buffers_made
        for scene in scenes[count:]:
            start = thread_time(), process_time(), perf_counter()
            np.asarray(pictures.draw(scene).rgb)
            ends = thread_time(), process_time(), perf_counter()
            rows.append([1e3 * (end - first) for first, end in zip(start, ends, strict=True)])
    times = [median(column) for column in zip(*rows, strict=True)]
    each = {"buffers made": (pictures.buffers_made - made) / count}
    each |= {name: work[name] / count for name in WORK}
    return dict(zip(("host", "processor", "wall"), times, strict=True)) | each


def _turned(step: int) -> Camera:
    """The camera of a frame."""
    angle = 0.01 * step
    return Camera((0.5 + 3.0 * np.cos(angle), 0.5 + 3.0 * np.sin(angle), 1.9), (0.5, 0.5, 0.5), height=1.8)


@contextmanager
def counted() -> Iterator[Counter[str]]:
    """Counts the device's work meanwhile."""
    found: Counter[str] = Counter()
    before = {name: getattr(*place) for name, place in WORK.items()}

    def counting(name: str) -> Callable[..., Any]:
        def run(*arguments: Any, **keywords: Any) -> Any:
            found[name] += 1
            return before[name](*arguments, **keywords)

        return run

    try:
        for name, place in WORK.items():
            setattr(*place, counting(name))
        yield found
    finally:
        for name, place in WORK.items():
            setattr(*place, before[name])


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


def steady_table(numbers: dict[str, Any]) -> Table:
    """One row for each scene."""
    columns = ["ms a frame", "host", "processor", "wall", "buffers made", *WORK]
    shown = Table(f"Steady frames of 16 x 16 pixels, {numbers['count']} of each", columns)
    for words in ("straight", "curved"):
        for name, own in numbers.get(words, {}).items():
            times = [f"{own[key]:.2f}" for key in ("host", "processor", "wall")]
            counts = [f"{own[key]:.3g}" for key in ("buffers made", *WORK)]
            shown.rows.append([f"{name}, {words}", *times, *counts])
    shown.notes = [
        "48 tetrahedra with a cubic field; the camera turns.  *host* is the processor time of the thread that asks for "
        "the picture, *processor* that of all threads.  Of curved elements the host halves faces and proves what is "
        "on borders, which is work for the picture and not overhead.",
    ]
    return shown


if __name__ == "__main__":
    print(json.dumps(pictures(sys.argv[1], int(sys.argv[2]), sys.argv[3])))
