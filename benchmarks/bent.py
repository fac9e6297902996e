"""Volumes of straight and of curved elements: how their time grows with the number of elements."""

from __future__ import annotations

from functools import partial
from typing import Any

from cases import FIELD, Case, mild
from measuring import in_turn
from pictures import exact
from scenes import exponent
from tables import Table, seconds

from elvis import Camera, Renderer, Scene, Shape, Transfer, VolumeRendering

MAPS = {"straight": 1, "quadratic": 2}


def measure(device: str, side: int, rounds: int, quick: bool) -> dict[str, Any]:
    """Seconds of volumes in cubes of ever more tetrahedra, straight ones and curved ones."""
    cells = (2, 3) if quick else (4, 8, 16)
    volume = VolumeRendering(Transfer((-2.7, 0.0, 2.7), (0.0, 0.5, 2.0)), error=1e-2)
    camera = Camera((2.9, -2.1, 1.9), (0.5, 0.5, 0.5), height=1.8)
    scene = Scene(FIELD, camera=camera, size=(side, side), objects=(volume,))
    rows: dict[str, Any] = {name: [] for name in MAPS}
    for name, degree in MAPS.items():
        for count in cells:
            case = Case("volume", Shape.TETRAHEDRON, count, degree, 3, mild)
            with Renderer(device) as renderer:
                renderer.load(case.dataset(), FIELD)
                timing = in_turn({"volume": partial(exact, renderer, scene)}, rounds)["volume"].record()
                segments = exact(renderer, scene).stats["volume"]["segments"]
            rows[name].append({"count": case.elements, "segments": segments, **timing})
    return {"side": side, **rows}


def table(numbers: dict[str, Any]) -> Table:
    """CPU seconds over elements, with the exponents that join first and last."""
    counts = [row["count"] for row in numbers["straight"]]
    shown = Table("Growth of volumes with elements", ["tetrahedra", *(f"{count:,}" for count in counts), "exponent"])
    for name in MAPS:
        times = [row["processor"] for row in numbers[name]]
        segments = [row["segments"] for row in numbers[name]]
        shown.rows.append([f"{name}, CPU s", *map(seconds, times), exponent(counts, times)])
        each = [f"{1e6 * time / count:.2f}" for time, count in zip(times, segments, strict=True)]
        shown.rows.append([f"{name}, CPU us a segment", *each, ""])
    shown.notes = [f"{numbers['side']}^2 pixels of a cube; rays meet elements as the cube root of their number."]
    return shown
