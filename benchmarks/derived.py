"""Isosurfaces of quantities: certainty and seconds.  The Q criterion on curved elements, and a field for comparison.

python benchmarks/derived.py [--size 1000] [--rounds 3] [--data FILES QUANTITY=VALUE] [--made NAME QUANTITY=VALUE]
[--cold] [--pictures FOLDER]
"""

from __future__ import annotations

import argparse
import atexit
import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from time import perf_counter, process_time

import numpy as np
from machine import description, sentences
from shown import DELTA
from tables import Table, percent, seconds

from elvis import Camera, Dataset, Isosurface, Renderer, Scene, Shape, read
from elvis.core.testing import VORTICES, approximated, curved, grid, swirled
from elvis.renderer.asking.completing import completed

CAMERA = Camera((2.5, -2.0, 1.9), (0.5, 0.5, 0.5), fov=30.0)
#: cells of a grid each way, and modes of the fields: 27 hexahedra of order 4, 48 tetrahedra and 16 prisms of order 3
CASES = {Shape.HEXAHEDRON: (3, 5), Shape.TETRAHEDRON: (2, 4), Shape.PRISM: (2, 4)}


def drawn(dataset: Dataset, scene: Scene, rounds: int, picture: Path | None) -> list[str]:
    """Shares of certain pixels and of certain hits among hits; seconds of the first frame and of later ones."""
    (surface,) = scene.objects
    with Renderer("auto") as renderer:
        renderer.load(dataset, str(scene.field), str(surface.quantity))
        start, started = perf_counter(), process_time()
        frame = renderer.render(scene)
        first, cold = perf_counter() - start, process_time() - started
        best, busy = first, cold
        for _ in range(rounds):
            start, started = perf_counter(), process_time()
            frame = renderer.render(scene)
            best, busy = min(best, perf_counter() - start), min(busy, process_time() - started)
    if picture is not None:
        frame.save(picture)
    counts = frame.counts()
    hits = np.isfinite(frame.depth)
    hit = (frame.status[hits] == 1).mean() if hits.any() else np.nan
    sure = 1.0 - counts["ambiguous"] / frame.status.size
    return [percent(sure), percent(hit), str(int(hits.sum())), *map(seconds, (first, cold, best, busy))]


def made() -> Iterator[tuple[str, Dataset, list[tuple[str, float]], Camera | str]]:
    """Names, data, quantities with values, cameras: curved elements, and the half delta wing with straight ones."""
    for shape, (cells, modes) in CASES.items():
        mesh = Dataset(curved(grid(shape, cells), swirled, 3))
        fields = tuple(approximated(mesh, name, wave, modes) for name, wave in VORTICES.items())
        yield shape.name.lower(), replace(mesh, fields=fields), [("u", 0.3), ("q_criterion", 3.0)], CAMERA
    yield "delta wing", DELTA.whole(quick=False), [("q_criterion", 20.0)], "iso"


def named(files: str, quantity: str) -> tuple[str, Dataset, list[tuple[str, float]], Camera | str]:
    """The same of files, joined by commas, and QUANTITY=VALUE."""
    paths = [Path(file) for file in files.split(",")]
    name, value = quantity.rsplit("=", 1)
    return paths[0].stem, read(*paths), [(name, float(value))], "iso"


def cases(options: argparse.Namespace) -> Iterator[tuple[str, Dataset, list[tuple[str, float]], Camera | str]]:
    """What the command line asks for."""
    if not options.data and not options.made:
        yield from made()
    for each in options.data or ():
        yield named(*each)
    for wanted, quantity in options.made or ():
        text, value = quantity.rsplit("=", 1)
        for name, dataset, _, camera in made():
            if name == wanted:
                yield name, dataset, [(text, float(value))], camera
                break


def start_cold() -> None:
    """Keep kernels, the driver's too, in an empty folder; before any device is opened."""
    folder = tempfile.mkdtemp(prefix="elvis-cold-")
    os.environ["XDG_CACHE_HOME"] = folder
    atexit.register(shutil.rmtree, folder, ignore_errors=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=1000, help="pixels each way")
    parser.add_argument("--rounds", type=int, default=3, help="frames after the first")
    pair = {"nargs": 2, "action": "append", "metavar": ("FILES", "QUANTITY=VALUE")}
    parser.add_argument("--data", **pair, help="files, joined by commas, instead of the cases made here")
    pair["metavar"] = ("NAME", "QUANTITY=VALUE")
    parser.add_argument("--made", **pair, help="one of the cases made here, with another quantity")
    parser.add_argument("--cold", action="store_true", help="begin with empty caches")
    parser.add_argument("--pictures", type=Path, help="a folder for the pictures")
    options = parser.parse_args()
    if options.cold:
        start_cold()
    columns = ["", "% certain", "% of hits", "hits", "first s", "first CPU s", "s", "CPU s"]
    table = Table(f"Isosurfaces of quantities, {options.size} x {options.size} pixels", columns)
    print(sentences(description("auto")), flush=True)
    for name, dataset, asked, camera in cases(options):
        for quantity, value in asked:
            surface = Isosurface(values=(value,), quantity=quantity)
            field = dataset.fields[0].name
            scene = Scene(field=field, objects=(surface,), camera=camera, size=(options.size, options.size))
            picture = options.pictures and options.pictures / f"{len(table.rows)}.png"
            row = drawn(dataset, completed(dataset, scene), options.rounds, picture)
            table.rows.append([f"{quantity} = {value:g}, {name}", *row])
            print(" | ".join(table.rows[-1]), flush=True)
    print(table.text())


if __name__ == "__main__":
    main()
