"""Cold kernels: what the first picture of each kind costs, of every shape, with nothing compiled before."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from cases import CELLS, CUT, FIELD, of_order, plural
from measuring import once
from orders import caches_in
from tables import Table

from elvis import (
    Camera,
    Contours,
    CutSurface,
    Faces,
    Isosurface,
    Renderer,
    Scene,
    Shape,
    Style,
    Transfer,
    VolumeRendering,
)

#: order of the fields
ORDER = 3
#: each kind of picture, as the first objects of its kind
OBJECTS: dict[str, Any] = {
    "cut": CutSurface(CUT),
    "contours": CutSurface(CUT, Style(contours=Contours(count=5))),
    "faces": Faces(("all",)),
    "isosurface": Isosurface((0.5,)),
    "volume": VolumeRendering(Transfer((-1.0, 0.0, 1.0), (0.0, 1.0, 3.0))),
}


def measure(device: str, kinds: Sequence[tuple[Shape, int]], objects: Sequence[str]) -> dict[str, Any]:
    """Seconds of the pictures' first frames, in turn; kernels that an earlier one has made are at hand."""
    return {"order": ORDER, "objects": list(objects), "cases": [first(*kind, device, objects) for kind in kinds]}


def every(quick: bool) -> tuple[list[tuple[Shape, int]], list[str]]:
    """Shapes and degrees of their maps, and kinds of pictures."""
    if quick:
        return [(Shape.TETRAHEDRON, 1)], ["cut"]
    return [(shape, degree) for shape in CELLS for degree in (1, 2)], list(OBJECTS)


def first(shape: Shape, degree: int, device: str, objects: Sequence[str]) -> dict[str, Any]:
    """Seconds of each first frame: by the clock, and of the processor."""
    dataset = of_order(shape, degree, ORDER, quick=True).dataset()
    camera = Camera((3.0, 2.0, 2.5), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), height=1.5)
    found: dict[str, Any] = {"shape": plural(shape), "degree": degree}
    with TemporaryDirectory() as folder, caches_in(Path(folder)), Renderer(device) as renderer:
        renderer.load(dataset, FIELD)
        for name in objects:
            scene = Scene(FIELD, camera=camera, size=(16, 16), objects=(OBJECTS[name],))
            _, timing = once(partial(renderer.render, scene))
            found[name] = {"seconds": timing.best, "processor": timing.effort}
    return found


def table(numbers: dict[str, Any]) -> Table:
    """A row a shape and degree."""
    objects = numbers["objects"]
    shown = Table(f"Cold kernels, fields of order {numbers['order']}", ["shape, map", *objects, "sum, CPU s", "sum, s"])
    for case in numbers["cases"]:
        own = [case[name]["processor"] for name in objects]
        row = [f"{case['shape']}, {'straight' if case['degree'] == 1 else 'quadratic'}"]
        clock = sum(case[name]["seconds"] for name in objects)
        shown.rows.append([*row, *(f"{value:.1f}" for value in own), f"{sum(own):.1f}", f"{clock:.1f}"])
    total = sum(case[name]["processor"] for case in numbers["cases"] for name in objects)
    shown.notes = [
        "Processor seconds of the first picture of each kind, 16 x 16 pixels, one after the other with empty caches: "
        f"nearly all of it compiling. All kernels: {total:.1f} CPU s."
    ]
    return shown
