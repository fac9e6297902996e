"""Frames of every shape, map and order of the field: seconds, cost of a pixel, distance to the arithmetic floor."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import floor
from cases import CELLS, FIELD, Case, cut, of_order, plural
from measuring import Timing, once
from pictures import error_of_sample, exact
from tables import Table, seconds

from elvis import Renderer, Shape

#: where Slang and Mesa keep what they compiled
CACHES = ("XDG_CACHE_HOME", "MESA_SHADER_CACHE_DIR")
#: shapes and degrees of a smoke run
QUICK = [(Shape.TETRAHEDRON, 1), (Shape.HEXAHEDRON, 2)]


def measure(device: str, side: int, rounds: int, orders: Sequence[int], quick: bool) -> dict[str, Any]:
    """All shapes, straight and quadratic, of the given orders."""
    peaks = floor.peaks(device)
    kinds = QUICK if quick else [(shape, degree) for shape in CELLS for degree in (1, 2)]
    cases = [of_order(*kind, order, quick) for kind in kinds for order in orders]
    return {"peaks": peaks, "pixels": [side, side], "cases": [frame(case, device, side, rounds) for case in cases]}


def frame(case: Case, device: str, side: int, rounds: int) -> dict[str, Any]:
    """Seconds of the first frame with empty caches, of the first with full ones, and of later frames."""
    dataset = case.dataset()
    with TemporaryDirectory() as folder, caches_in(Path(folder)):
        firsts = []
        for _ in range(2):
            with Renderer(device) as renderer:
                renderer.load(dataset, FIELD)
                shown, first = once(partial(exact, renderer, cut(side)))
                firsts.append(first.best)
                timing = Timing()
                for _ in range(rounds if len(firsts) == 2 else 0):
                    timing.run(partial(exact, renderer, cut(side)))
    inside, work = int(shown.seen.sum()), floor.operations(case)
    return {
        "shape": plural(case.shape),
        "elements": case.elements,
        "degree": case.degree,
        "order": case.order,
        "spacing": case.spacing,
        "inside": inside,
        "first": firsts[0],
        "first, cached": firsts[1],
        **timing.record(),
        "draw": shown.stats["seconds"]["draw"],
        "operations of a pixel": work,
        "error": error_of_sample(dataset, shown, count=300),
        "status": shown.counts(),
    }


@contextmanager
def caches_in(folder: Path) -> Iterator[None]:
    """Let kernels be retained in a folder of their own, empty at first."""
    before = {name: os.environ.get(name) for name in CACHES}
    os.environ.update({name: str(folder / name) for name in CACHES})
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


def table(numbers: dict[str, Any]) -> Table:
    """A row a case."""
    width, height = numbers["pixels"]
    columns = [
        "shape, map",
        "elements",
        "p",
        "best s",
        "median s",
        "CPU s",
        "ns/pixel",
        "flop/pixel",
        "floor s",
        "CPU / floor",
    ]
    shown = Table(f"Shapes and orders, {width} x {height} pixels", [*columns, "first s", "cached s", "error"])
    peak = max(numbers["peaks"].values())
    shown.rows = [_row(case, case["inside"] * case["operations of a pixel"] / peak) for case in numbers["cases"]]
    rates = {name: f"{value / 1e9:.1f}" for name, value in numbers["peaks"].items()}
    shown.notes = [
        "Pixels counted are those inside. Floor: operations of pixels inside (docs/internals has the formula) "
        "at the peak of one core, in CPU seconds as the column next to it. Peaks measured: NumPy's matrix product "
        f"{rates['blas']}, multiply-adds in a kernel {rates['device']} Gflop a CPU second. First: the first frame "
        "after loading, nothing compiled before; cached: the same with kernels that were compiled before.",
    ]
    return shown


def _row(case: dict[str, Any], least: float) -> list[str]:
    """A case in words; ``least`` is its floor in seconds."""
    row = [f"{case['shape']}, {'straight' if case['degree'] == 1 else 'quadratic'}", f"{case['elements']:,}"]
    row += [str(case["order"]), *[seconds(case[key]) for key in ("best", "median", "processor")]]
    row += [f"{1e9 * case['best'] / case['inside']:.0f}", str(case["operations of a pixel"]), f"{least:.4f}"]
    row += [f"{case['processor'] / least:.0f}", f"{case['first']:.1f}", f"{case['first, cached']:.2f}"]
    return [*row, f"{case['error']['greatest']:.0e}"]
