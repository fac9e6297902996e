"""The pictures whose seconds were promised: what was requested, what they took before and take, VTK next to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from time import thread_time
from typing import Any

import numpy as np
from cases import FIELD, cut, of_order, plural
from derived import made
from measuring import Timing, in_turn, once
from pictures import exact
from rivals import RIGHT, Rivals
from shown import DELTA, WING, Shown
from tables import Table, percent, seconds

from elvis import Camera, Dataset, Faces, Isosurface, Plane, Renderer, Scene, Shape, Transfer, VolumeRendering
from elvis.core.base.arrays import Floats
from elvis.core.testing import curved, grid, with_field

#: pictures of 16 x 16 pixels of which one is timed
_STEADY = 50


@dataclass(frozen=True)
class Target:
    """A picture that is measured.

    asked, before  seconds that were requested, and what it took when they were, on quiet cores
    beside         whether VTK draws the same next to it
    """

    name: str
    asked: float
    before: str
    dataset: Dataset
    scene: Scene
    beside: bool = False


def targets(side: int, quick: bool) -> Iterator[Target]:
    """All of them, each made when it is its turn; to be quick, one whose kernels other benchmarks have, too."""
    yield from _of_wings(side, quick)
    if quick:
        return
    yield from _derived(side)
    for shape in (Shape.HEXAHEDRON, Shape.PYRAMID):
        name = f"{plural(shape)}, quadratic, order 8, plain cut"
        yield Target(name, 0.35, "0.8 to 1.0", of_order(shape, 2, 8, quick=False).dataset(), cut(side))
    yield Target("cut through two strongly sheared prisms, 200^2", 2.0, "67 to 85", *_sheared(200))
    yield Target("1 + z^7 on one hexahedron, 60^2", 0.3, "4.6", *_flat(60))


def _derived(side: int) -> Iterator[Target]:
    asked = {"delta wing": ("half delta wing", 1.5, "24"), "hexahedron": ("27 curved hexahedra of order 4", 2.5, "48")}
    for name, dataset, levels, camera in made():
        if name in asked:
            words, limit, before = asked[name]
            quantity, value = levels[-1]
            surface = Isosurface((value,), quantity=quantity)
            scene = Scene("u", camera=camera, size=(side, side), objects=(surface,))
            yield Target(f"Q isosurface, {words}", limit, before, dataset, scene)


def _of_wings(side: int, quick: bool) -> Iterator[Target]:
    """Surfaces, a cut and isosurfaces of the paper's cases, and everything in one picture."""
    asked: list[tuple[Shown, str, str, float, str]] = [
        (DELTA, "faces", "overview", 0.11, "0.21"),
        (DELTA, "faces", "detail", 0.10, "0.24"),
        (DELTA, "isosurface", "overview", 0.2, "0.30"),
        (DELTA, "together", "overview", 0.6, "0.86"),
        (WING, "faces", "overview", 0.2, "0.44"),
        (WING, "faces", "detail", 0.2, "0.46"),
        (WING, "cut", "overview", 0.2, "0.40"),
        (WING, "isosurface", "overview", 0.5, "0.91"),
    ]
    words = {
        "faces": "surfaces, 10 contours",
        "cut": "cut plane, 10 contours",
        "together": "everything in one picture",
    }
    read: dict[str, Dataset] = {}
    for shown, kind, view, limit, before in asked[:1] if quick else asked:
        if shown.name not in read:
            read = {shown.name: shown.dataset(quick)}
        title = f"{words.get(kind, kind)}, {shown.name}, {view}"
        scene = shown.scenes(kind, side)[view]
        yield Target(title, limit, before, read[shown.name], scene, kind in ("faces", "cut", "isosurface"))


def _sheared(side: int) -> tuple[Dataset, Scene]:
    """Two prisms of second degree, four times as long as they are wide: the data that were measured before are lost."""

    def shear(points: Floats) -> Floats:
        x, y, _ = points.T
        return points + np.outer(4.0 * y + 0.5 * y * y, [1, 0, 0]) + np.outer(2.0 * x - 0.375 * y * y, [0, 0, 1])

    dataset = with_field(curved(grid(Shape.PRISM, 1), shear, 3), lambda p: p[:, 0] * p[:, 2], 6)
    return dataset, Scene("u", plane=Plane((2.5, 0.5, 1.5), (0.1, 1.0, 0.2)), size=(side, side))


def _flat(side: int) -> tuple[Dataset, Scene]:
    """A field that is flat where it has the value."""
    mesh = grid(Shape.HEXAHEDRON, 1)
    mesh = replace(mesh, vertices=mesh.vertices - [0.0, 0.0, 0.5])
    dataset = with_field(mesh, lambda p: 1.0 + p[:, 2] ** 7, 8)
    camera = Camera((2.5, -1.5, 1.5), (0.5, 0.5, 0.0), fov=35.0)
    return dataset, Scene("u", camera=camera, size=(side, side), objects=(Isosurface((1.0,)),))


def measure(device: str, side: int, rounds: int, quick: bool) -> dict[str, Any]:
    """Each picture, VTK's in turn with it; then frames of hardly any pixel."""
    rows = [_row(target, device, rounds, quick) for target in targets(side, quick)]
    return {"pixels": side, "rows": rows, "steady": _steady(device, quick)}


def _row(target: Target, device: str, rounds: int, quick: bool) -> dict[str, Any]:
    with Renderer(device) as renderer:
        names = [str(target.scene.field), *(str(item.quantity) for item in _levels(target.scene))]
        renderer.load(target.dataset, *dict.fromkeys(names))
        _, first = once(partial(exact, renderer, target.scene))
        frame = renderer.render(target.scene)
        rivals = Rivals.of(target.dataset, frame, quick, least=1) if target.beside else Rivals()
        timings = rivals.in_turn(partial(exact, renderer, target.scene), rounds)
    ambiguous = frame.counts()["ambiguous"] / frame.status.size
    about = {"picture": target.name, "asked": target.asked, "before": target.before, "certain": 1.0 - ambiguous}
    return {**about, "first": first.best, "exact": timings["exact"].record(), **rivals.record(timings)}


def _levels(scene: Scene) -> list[Isosurface]:
    """Isosurfaces of quantities other than the scene's field."""
    return [item for item in scene.objects if isinstance(item, Isosurface) and item.quantity is not None]


def _steady(device: str, quick: bool) -> dict[str, Any]:
    """Of each kind of picture of the standard case, 16 x 16 pixels: what a frame costs (see _each)."""
    camera = Camera((2.9, -2.1, 1.9), (0.5, 0.5, 0.5), height=1.8)
    objects: Mapping[str, dict[str, Any]] = {
        "cut": {"plane": Plane((0.5, 0.5, 0.52), (0.1, 0.2, 1.0))},
        "faces": {"objects": (Faces(),)},
        "isosurface": {"objects": (Isosurface((0.3,)),)},
        "volume": {"objects": (VolumeRendering(Transfer((-1.0, 0.0, 1.0), (0.0, 1.0, 3.0))),)},
    }
    dataset = of_order(Shape.TETRAHEDRON, 1, 3, True).dataset()
    with Renderer(device) as renderer:
        renderer.load(dataset, FIELD)
        draw = {
            kind: partial(_frames, renderer, Scene(FIELD, camera=camera, size=(16, 16), range=(-1.0, 1.0), **item))
            for kind, item in objects.items()
        }
        rounds = 1 if quick else 5
        timings = in_turn(draw, rounds)
        return {kind: _each(renderer, draw[kind], timing, rounds) for kind, timing in timings.items()}


def _frames(renderer: Renderer, scene: Scene) -> None:
    for _ in range(_STEADY):
        exact(renderer, scene)


def _each(renderer: Renderer, draw: Callable[[], None], timing: Timing, rounds: int) -> dict[str, float]:
    """CPU seconds of a frame, of the thread that asks (the host's) and of all, kernels in software too; bytes made."""
    before = renderer.device.bytes_made
    own = []
    for _ in range(rounds):
        start = thread_time()
        draw()
        own.append(thread_time() - start)
    made_bytes = (renderer.device.bytes_made - before) / (rounds * _STEADY)
    processor = {"host": min(own) / _STEADY, "processor": timing.effort / _STEADY}
    return {**processor, "best": timing.best / _STEADY, "bytes": made_bytes}


def table(numbers: dict[str, Any]) -> Table:
    """A row a picture."""
    columns = ["picture", "asked s", "before s", "s", "CPU s", "first s", "% certain", "VTK s", "its CPU s", "wrong %"]
    shown = Table(f"Targets, {numbers['pixels']}^2 pixels unless told", [*columns, "s / VTK's", "CPU"])
    shown.rows = [_cells(row) for row in numbers["rows"]]
    for kind, steady in numbers["steady"].items():
        times = [seconds(steady["best"]), seconds(steady["processor"])]
        before = "0.005 to 0.006 CPU" if kind == "faces" else ""
        shown.rows.append([f"steady frame, {kind}, 16^2", "0.002", before, *times, *[""] * 7])
    made_bytes = ", ".join(f"{kind} {steady['bytes']:,.0f}" for kind, steady in numbers["steady"].items())
    hosts = ", ".join(f"{kind} {seconds(steady['host'])}" for kind, steady in numbers["steady"].items())
    shown.notes = [
        "Before: what was measured when the targets were set, on quiet cores. s: the quickest run, CPU s: the "
        f"cheapest, of all threads. VTK: its first picture with under {100 * RIGHT:g} % wrong pixels, or after a > the "
        "last that there was room for. CPU: our CPU seconds over VTK's.",
        f"CPU seconds of the asking thread in a steady frame: {hosts}; those of all threads hold what the kernels of "
        "a device in software take.",
        f"Bytes of buffers made in a steady frame: {made_bytes}.",
    ]
    return shown


def _cells(row: dict[str, Any]) -> list[str]:
    ours = row["exact"]
    own = [seconds(each) for each in (ours["best"], ours["processor"], row["first"])]
    cells = [row["picture"], f"{row['asked']:g}", row["before"], *own, percent(row["certain"])]
    if not row["linear"]:
        return [*cells, *[""] * 5]
    it = next((some for some in row["linear"] if some["wrong"] < RIGHT), row["linear"][-1])
    beyond = "" if it["wrong"] < RIGHT else "> "
    ratios = [f"{ours[key] / it[key]:.2f}" for key in ("best", "processor")]
    return [*cells, beyond + seconds(it["best"]), seconds(it["processor"]), percent(it["wrong"]), *ratios]
