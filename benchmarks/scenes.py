"""Pictures of the paper's cases: surfaces with contours, isosurfaces, volumes, next to VTK's linear ones."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from math import log
from typing import Any

import floor
from cases import FIELD, million
from measuring import in_turn, once
from million import raw_bytes
from pictures import exact
from rivals import Rivals
from shown import DELTA, LINES, Shown
from tables import Table, mebibytes, percent, seconds

from elvis import Camera, CutSurface, Dataset, Faces, Isosurface, Plane, Renderer, Scene, Style, VolumeRendering
from elvis.core.mapping.geometry import geometry
from elvis.scene.record.frame import Frame

#: seconds a picture of the delta wing may take on two cores, once compiled
LIMITS = {"cut": 0.25, "faces": 0.25, "isosurface": 1.0, "volume": 4.0}
WORDS = {
    "cut": "cut plane, 10 contours",
    "faces": "surfaces, 10 contours",
    "isosurface": "isosurface",
    "volume": "volume",
    "together": "all together",
}


def compare(kinds: Sequence[str], shown: Shown, device: str, side: int, rounds: int, quick: bool) -> Any:
    """All kinds of pictures of one case, each of its views next to VTK's."""
    dataset = shown.dataset(quick)
    with Renderer(device) as renderer:
        _, load = once(lambda: renderer.load(dataset, shown.field))
        found = {
            kind: {
                view: _view(renderer, dataset, scene, rounds, quick) for view, scene in shown.scenes(kind, side).items()
            }
            for kind in kinds
        }
        held = renderer.stages.loaded.bytes
    return {
        "case": shown.name,
        "elements": sum(len(block) for block in geometry(dataset)),
        "pixels": side,
        "load": load.best,
        "bytes": {"raw": raw_bytes(dataset) + curve_bytes(dataset), "device": held},
        "kinds": found,
    }


def curve_bytes(dataset: Dataset) -> int:
    """Bytes of the points of curved edges and faces."""
    return dataset.mesh.edge_curves.points.nbytes + dataset.mesh.face_curves.points.nbytes


def _view(renderer: Renderer, dataset: Dataset, scene: Scene, rounds: int, quick: bool) -> dict[str, Any]:
    """One scene: ours and VTK's, in turn."""
    _, first = once(lambda: exact(renderer, scene))
    frame = renderer.render(scene)
    rivals = Rivals.of(dataset, frame, quick) if _is_linear(scene) else Rivals()
    timings = rivals.in_turn(partial(exact, renderer, scene), rounds)
    stages = exact(renderer, scene).stats["seconds"]
    ours = timings["exact"].record() | {"first": first.best, "stages": stages}
    ours |= {"seen": int(frame.seen.sum()), "status": frame.counts(), "operations": operations(dataset, scene, frame)}
    return {"exact": ours, **rivals.record(timings)}


def _is_linear(scene: Scene) -> bool:
    """Whether VTK draws the same: a single surface."""
    return len(scene.objects) == 1 and not isinstance(scene.objects[0], VolumeRendering)


def operations(dataset: Dataset, scene: Scene, frame: Frame) -> int | None:
    """Floating point operations that the seen pixels cannot avoid (see `floor` and the page); None for volumes.

    A pixel of a cut plane is that of `floor`; one of a face solves for two coordinates and a depth on the face's own
    polynomials; one of an isosurface takes two steps on map and field and their derivatives.
    """
    if not _is_linear(scene):
        return None
    degree = max(max(block.expansion.modes) for block in geometry(dataset)) - 1
    order = max(max(block.expansion.modes) for block in dataset.fields[0].blocks) - 1
    solid = floor.simplicial(degree, 3)
    value = 2 * floor.coefficients_of(order, 3)
    steps = 1 if degree == 1 else 2
    match scene.objects[0]:
        case CutSurface():
            each = steps * solid + value
        case Faces():
            each = steps * floor.simplicial(degree, 2) + value
        case _:
            each = 2 * (solid + value + 2 * 3 * floor.coefficients_of(order - 1, 3))
    return each * int(frame.seen.sum())


def growth(device: str, side: int, rounds: int, quick: bool) -> dict[str, Any]:
    """Seconds over elements, of a cube of straight tetrahedra, and over pixels, of the delta wing."""
    cells = (4, 6) if quick else (12, 26, 56)
    sides = (100, 200) if quick else (600, 1000, 1400, 1800)
    rows = [_cube(million(cells=count), device, side, rounds) for count in cells]
    dataset = DELTA.dataset(quick)
    pixels: dict[str, Any] = {}
    with Renderer(device) as renderer:
        renderer.load(dataset, DELTA.field)
        for kind in ("cut", "faces", "isosurface"):
            scenes = {str(n): DELTA.scenes(kind, n)["overview"] for n in sides}
            pixels[kind] = _timed(renderer, scenes, rounds)
    return {"side": side, "elements": rows, "pixels": pixels}


def _cube(case: Any, device: str, side: int, rounds: int) -> dict[str, Any]:
    """The pictures of one cube."""
    dataset = case.dataset()
    camera = Camera((2.9, -2.1, 1.9), (0.5, 0.5, 0.5), height=1.8)
    objects = {
        "cut": CutSurface(Plane((0.5, 0.5, 0.52), (0.1, 0.2, 1.0)), Style(contours=LINES)),
        "faces": Faces(("all",), Style(contours=LINES)),
        "isosurface": Isosurface((0.4,)),
    }
    with Renderer(device) as renderer:
        _, load = once(lambda: renderer.load(dataset, FIELD))
        scenes = {
            kind: Scene(FIELD, camera=camera, size=(side, side), range=(-2.7, 2.7), objects=(item,))
            for kind, item in objects.items()
        }
        times = _timed(renderer, scenes, rounds)
        held = renderer.stages.loaded.bytes
    return {"count": case.elements, "load": load.best, "bytes": held, "raw": raw_bytes(dataset), **times}


def _timed(renderer: Renderer, scenes: dict[str, Scene], rounds: int) -> dict[str, Any]:
    works = {name: partial(exact, renderer, scene) for name, scene in scenes.items()}
    return {name: timing.record() for name, timing in in_turn(works, rounds).items()}


def table(numbers: dict[str, Any], peak: float) -> Table:
    """One case: a row a picture."""
    columns = ["picture", "best s", "median s", "CPU s", "exact / it", "CPU", "wrong %", "missed %", "over floor"]
    shown = Table(f"{numbers['case']}, {numbers['elements']:,} tetrahedra, {numbers['pixels']}^2 pixels", columns)
    for kind, views in numbers["kinds"].items():
        for view, found in views.items():
            shown.rows += _rows(f"{WORDS[kind]}, {view}", found, peak)
    raw, device = (numbers["bytes"][key] for key in ("raw", "device"))
    shown.notes = [
        f"Coefficients, vertices and points of curves: {mebibytes(raw)} MiB; the volume on the device, without what "
        f"stages make for a view: {mebibytes(device)} MiB, {device / raw:.2f} times that. "
        f"Loading took {seconds(numbers['load'])} s.",
        *(_costs(kind, views) for kind, views in numbers["kinds"].items()),
        *(
            f"{WORDS[kind]}, {view}: {remark}"
            for kind, views in numbers["kinds"].items()
            for view, found in views.items()
            for remark in found["remarks"]
        ),
    ]
    return shown


def _rows(title: str, found: dict[str, Any], peak: float) -> list[list[str]]:
    ours = found["exact"]
    own = [seconds(ours[key]) for key in ("best", "median", "processor")]
    distance = "" if not ours["operations"] else f"{ours['processor'] * peak / ours['operations']:.0f}"
    failed = ours["status"]["failed"] / max(1, ours["seen"])
    rows = [[title, *own, "1", "1", percent(failed), "", distance]]
    for it in found["linear"]:
        ratios = [f"{ours['median'] / it['median']:.2f}", f"{ours['processor'] / it['processor']:.2f}"]
        name = f"- VTK, {it['refinements']} refinements, {it['pieces']:,} pieces"
        own = [seconds(it[key]) for key in ("best", "median", "processor")]
        rows.append([name, *own, *ratios, percent(it["wrong"]), percent(it["missed"]), ""])
    return rows


def _costs(kind: str, views: dict[str, Any]) -> str:
    """What the stages of the first view cost, and whether the limit is met."""
    name, found = next(iter(views.items()))
    ours = found["exact"]
    stages = ", ".join(f"{stage} {seconds(value)}" for stage, value in ours["stages"].items() if stage != "load")
    limit = f"; limit {LIMITS[kind]} s on the delta wing" if kind in LIMITS else ""
    seen, first = f"{ours['seen']:,} pixels seen", f"first picture {seconds(ours['first'])} s"
    return f"{WORDS[kind]}, {name}: {seen}, {first}, seconds of one picture: {stages}{limit}."


def growth_table(numbers: dict[str, Any]) -> list[Table]:
    """Seconds over elements and over pixels, with the exponents that join first and last."""
    rows = numbers["elements"]
    counts = [row["count"] for row in rows]
    over = Table("Growth with elements", ["picture", *(f"{count:,}" for count in counts), "exponent"])
    for kind in ("cut", "faces", "isosurface"):
        times = [row[kind]["best"] for row in rows]
        over.rows.append([f"{WORDS[kind]}, s", *map(seconds, times), exponent(counts, times)])
    over.rows.append(["device over raw bytes", *(f"{row['bytes'] / row['raw']:.2f}" for row in rows), ""])
    over.rows.append(["loading, s", *(seconds(row["load"]) for row in rows), ""])
    over.notes = [f"Straight tetrahedra of a cube, cubic field, {numbers['side']}^2 pixels, best of several runs."]

    sides = [int(side) for side in next(iter(numbers["pixels"].values()))]
    pixels = Table("Growth with pixels", ["picture", *(f"{side}^2" for side in sides), "exponent"])
    for kind, found in numbers["pixels"].items():
        times = [found[str(side)]["best"] for side in sides]
        pixels.rows.append([f"{WORDS[kind]}, s", *map(seconds, times), exponent([n * n for n in sides], times)])
    pixels.notes = ["The delta wing, overview. An exponent of 1 is in proportion."]
    return [over, pixels]


def exponent(counts: Sequence[int], times: Sequence[float]) -> str:
    return f"{log(times[-1] / times[0]) / log(counts[-1] / counts[0]):.2f}"
