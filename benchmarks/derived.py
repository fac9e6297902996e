"""Isosurfaces of the Q criterion on bent elements, those of a field beside them: what is certain, and seconds.

python benchmarks/derived.py [--size 1000] [--rounds 3]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from time import perf_counter, process_time

import numpy as np
from tables import Table, percent, seconds

from elvis.core.testing import VORTICES, approximated, curved, grid, swirled
from elvis.formats import Dataset, Shape
from elvis.renderer import Camera, Isosurface, Renderer, Scene

CAMERA = Camera((2.5, -2.0, 1.9), (0.5, 0.5, 0.5), fov=30.0)
#: cells of a grid each way, and modes of the fields: 27 hexahedra of order 4, 48 tetrahedra and 16 prisms of order 3
CASES = {Shape.HEXAHEDRON: (3, 5), Shape.TETRAHEDRON: (2, 4), Shape.PRISM: (2, 4)}


def drawn(dataset: Dataset, quantity: str, value: float, size: int, rounds: int) -> list[str]:
    """Shares of certain pixels and of certain hits among hits; seconds of the first frame and of later ones."""
    surface = Isosurface(values=(value,), quantity=quantity)
    scene = Scene(field="u", objects=(surface,), camera=CAMERA, size=(size, size))
    with Renderer("auto") as renderer:
        renderer.load(dataset, "u", quantity)
        start = perf_counter()
        frame = renderer.render(scene)
        first, best, busy = perf_counter() - start, np.inf, np.inf
        for _ in range(rounds):
            start, started = perf_counter(), process_time()
            frame = renderer.render(scene)
            best, busy = min(best, perf_counter() - start), min(busy, process_time() - started)
    counts = frame.counts()
    hits = np.isfinite(frame.depth)
    hit = (frame.status[hits] == 1).mean() if hits.any() else np.nan
    sure = 1.0 - counts["ambiguous"] / size**2
    return [percent(sure), percent(hit), str(int(hits.sum())), seconds(first), seconds(best), seconds(busy)]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", type=int, default=1000, help="pixels each way")
    parser.add_argument("--rounds", type=int, default=3, help="frames after the first")
    options = parser.parse_args()
    columns = ["", "% certain", "% of hits", "hits", "first s", "s", "CPU s"]
    table = Table(f"Isosurfaces on bent elements, {options.size} x {options.size} pixels", columns)
    for shape, (cells, modes) in CASES.items():
        mesh = Dataset(curved(grid(shape, cells), swirled, 3))
        fields = tuple(approximated(mesh, name, wave, modes) for name, wave in VORTICES.items())
        dataset = replace(mesh, fields=fields)
        for quantity, value in (("u", 0.3), ("q_criterion", 3.0)):
            row = drawn(dataset, quantity, value, options.size, options.rounds)
            table.rows.append([f"{quantity}, {shape.name.lower()}", *row])
    print(table.text())


if __name__ == "__main__":
    main()
