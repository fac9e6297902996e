"""Elements of high order, as production runs use them: CPU seconds of pictures and numbers, next to linear pictures.

python benchmarks/spectral.py FILES PICTURE [--side N] [--rounds N] [--quick]   one picture, as a line of JSON

Every row runs in a process of its own with a limit, so that a slow one costs no other.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from measuring import ENVIRONMENT, Timing, once
from starting import children
from tables import Table, percent, seconds

from elvis import (
    Camera,
    CutSurface,
    Dataset,
    Faces,
    Isosurface,
    Plane,
    Renderer,
    Scene,
    SceneObject,
    Shape,
    Status,
    Streamlines,
    Transfer,
    VolumeRendering,
    read,
    write,
)
from elvis.core.base.arrays import Floats
from elvis.core.testing import approximated, curved, grid
from elvis.reference.study import compare_scene
from elvis.scene.record.frame import Frame

#: of a row, in seconds of the clock
LIMIT = 300.0
#: the linear pictures: cells between the nodes, each refined so many times
LEVELS = (0, 1)


def sheared(points: Floats) -> Floats:
    """The unit cube as a box of side 2 pi whose elements are all curved."""
    x, y, z = np.moveaxis(points, -1, 0)
    shift = 0.05 * np.sin(np.pi * z)
    moved = (x + shift * np.sin(2 * np.pi * y), y + shift * np.sin(2 * np.pi * x), z)
    return 2 * np.pi * np.stack(moved, axis=-1)


def piped(points: Floats) -> Floats:
    """The unit cube as half of a hollow curved pipe: radius, angle and length; elements at the wall are thin.

    The radius is graded exponentially: with 8 cells, one at the wall is a thousand times longer than it is thick.
    """
    grading = 9.0
    depth, angle, length = points[..., 0], np.pi * points[..., 1], 0.5 * np.pi * points[..., 2]
    radius = 1.0 - 0.6 * np.expm1(grading * depth) / np.expm1(grading)
    out = 3.0 + radius * np.cos(angle)
    return np.stack([out * np.cos(length), radius * np.sin(angle), out * np.sin(length)], axis=-1)


#: velocity and pressure: eddies of several sizes
EDDIES: dict[str, Callable[[Floats], Floats]] = {
    "u": lambda x: np.sin(x[..., 0]) * np.cos(3 * x[..., 1]) * np.cos(2 * x[..., 2]),
    "v": lambda x: -np.cos(x[..., 0]) * np.sin(x[..., 1]) * np.cos(5 * x[..., 2]),
    "w": lambda x: 0.3 * np.sin(4 * x[..., 0]) * np.sin(4 * x[..., 1]),
    "p": lambda x: (np.cos(2 * x[..., 0]) + np.cos(2 * x[..., 1])) * (np.cos(2 * x[..., 2]) + 2) / 16,
}


@dataclass(frozen=True)
class Spectral:
    """Data that are made: cells of the cube each way, order of map and fields, the map."""

    name: str
    shape: Shape
    cells: int
    order: int
    bend: Callable[[Floats], Floats]

    @property
    def elements(self) -> int:
        """Their number."""
        return int(grid(self.shape, self.cells).count)

    def files(self, folder: Path) -> list[str]:
        """The native files, written into a folder."""
        mesh = curved(grid(self.shape, self.cells), self.bend, self.order + 1)
        dataset = Dataset(mesh)
        fields = tuple(approximated(dataset, name, function, self.order + 1) for name, function in EDDIES.items())
        made = [folder / f"{self.name}.xml", folder / f"{self.name}.fld"]
        write(replace(dataset, fields=fields), *made)
        return [str(path) for path in made]


CASES = (
    Spectral("box7", Shape.HEXAHEDRON, 8, 7, sheared),
    Spectral("pipe5", Shape.HEXAHEDRON, 8, 5, piped),
    Spectral("pipe9", Shape.HEXAHEDRON, 6, 9, piped),
    Spectral("prisms7", Shape.PRISM, 4, 7, sheared),
    Spectral("tetrahedra7", Shape.TETRAHEDRON, 4, 7, sheared),
)
QUICK = (Spectral("box5", Shape.HEXAHEDRON, 2, 5, sheared),)

#: pictures by name, and the largest share of the requested side
PICTURES: dict[str, tuple[Callable[[Floats], SceneObject], float]] = {
    "cut": (lambda centre: CutSurface(Plane(tuple(centre), (0.1, 0.2, 1.0))), 1.0),
    "faces": (lambda _: Faces(("all",)), 1.0),
    "isosurface": (lambda _: Isosurface((0.3,), "u"), 1.0),
    "Q isosurface": (lambda _: Isosurface((1.0,), "q_criterion"), 1.0),
    "lambda2 isosurface": (lambda _: Isosurface((-1.0,), "lambda2"), 1.0),
    "volume": (lambda _: VolumeRendering(Transfer((-1.0, 0.0, 1.0), (1.0, 0.0, 1.0))), 0.45),
    "100 tubes": (lambda _: Streamlines(("random:100",), "u,v,w"), 1.0),
}
#: what VTK draws next to
LINEAR = ("cut", "faces", "isosurface")
#: commands by name, the words behind the files
COMMANDS = {
    "trace 100 lines": ("trace", "--seeds", "random:100", "-o", "lines.vtp"),
    "integrate u^2": ("integrate", "--field", "u^2"),
    "integrate p over all": ("integrate", "--over", "all", "--field", "p"),
    "info --jacobian": ("info", "--jacobian"),
    "probe 100,000 points": ("probe", "--points", "points.csv", "-o", "values.csv"),
}


def picture(files: Sequence[str], kind: str, device: str, side: int, rounds: int) -> dict[str, Any]:
    """One picture: CPU seconds of the first and of later frames, statuses, and linear pictures of the same scene."""
    dataset = read(*files)
    corners = dataset.mesh.vertices
    centre, size = corners.mean(axis=0), float(np.linalg.norm(np.ptp(corners, axis=0)))
    camera = Camera(tuple(centre + size * np.array((1.6, -1.9, 1.2))), tuple(centre), height=0.9 * size)
    make, share = PICTURES[kind]
    pixels = max(8, round(share * side))
    scene = Scene("u", camera=camera, objects=(make(centre),), size=(pixels, pixels))
    with Renderer(device) as renderer:
        frame, first = once(partial(_first, renderer, dataset, scene))
        timing = Timing()
        for _ in range(rounds):
            timing.run(partial(renderer.render, scene))
    # volumes have no depth: all their pixels count
    hits = frame.seen if frame.seen.any() else np.ones_like(frame.seen)
    certain = float((frame.status[hits] == Status.CERTAIN).mean())
    found = {"first": first.effort, **timing.record(), "pixels": pixels, "hits": int(hits.sum()), "certain": certain}
    return {**found, "linear": linear(dataset, scene) if kind in LINEAR else []}


def _first(renderer: Renderer, dataset: Dataset, scene: Scene) -> Frame:
    """The first picture, loading included."""
    (drawn,) = scene.objects
    quantity = getattr(drawn, "quantity", None)
    renderer.load(dataset, "u", *filter(None, [quantity]))
    return renderer.render(scene)


def linear(dataset: Dataset, scene: Scene) -> list[dict[str, float]]:
    """Linear pictures of a scene: CPU seconds of mesh and drawing, and the share of wrong pixels."""
    small = replace(scene, size=(300, 300))
    study = compare_scene(dataset, small, levels=LEVELS, validation_size=0)
    return [
        {"name": rival.name, "seconds": sum(rival.seconds.values()), "wrong": rival.errors.off / 100}
        for rival in study.rivals
        if rival.errors is not None
    ]


def measure(device: str, side: int, rounds: int, quick: bool) -> dict[str, Any]:
    """All rows of all data: what each took, or why it has no figure."""
    found: dict[str, Any] = {"pixels": side, "limit": LIMIT, "cases": {}}
    for case in QUICK if quick else CASES:
        with TemporaryDirectory() as folder:
            files = case.files(Path(folder))
            _write_points(files, Path(folder) / "points.csv", 100 if quick else 100_000)
            rows = {kind: _picture_apart(files, kind, device, side, rounds) for kind in PICTURES}
            rows |= {name: _command(files, words, Path(folder)) for name, words in COMMANDS.items()}
        found["cases"][case.name] = {"elements": case.elements, "order": case.order, "rows": rows}
    return found


def _write_points(files: Sequence[str], path: Path, count: int) -> None:
    """Random points in the box of the vertices, inside of the domain or not."""
    corners = read(*files).mesh.vertices
    points = np.random.default_rng(1).uniform(corners.min(axis=0), corners.max(axis=0), (count, 3))
    np.savetxt(path, points, delimiter=",", header="x,y,z", comments="")


def _picture_apart(files: Sequence[str], kind: str, device: str, side: int, rounds: int) -> dict[str, Any]:
    """A picture in a process of its own."""
    words = [sys.executable, __file__, *files, kind, "--device", device, "--side", str(side), "--rounds", str(rounds)]
    output, spent = _run(words, Path(files[0]).parent)
    return json.loads(output.splitlines()[-1]) if spent is not None else {"failed": output}


def _command(files: Sequence[str], words: Sequence[str], folder: Path) -> dict[str, Any]:
    """A command line: CPU seconds of its process, imports included."""
    program = "from elvis.plugins.command.command import main; main()"
    output, spent = _run([sys.executable, "-c", program, words[0], *files, *words[1:]], folder)
    return {"processor": spent} if spent is not None else {"failed": output}


def _run(words: Sequence[str], folder: Path) -> tuple[str, float | None]:
    """The output of a process and its CPU seconds; for a process that fails, the reason and None."""
    before = children()
    try:
        done = subprocess.run(
            words, cwd=folder, env=ENVIRONMENT, timeout=LIMIT, capture_output=True, text=True, check=False
        )
    except subprocess.TimeoutExpired:
        return f"not done in {LIMIT:.0f} s", None
    if done.returncode:
        return done.stderr.strip().splitlines()[-1][:60], None
    return done.stdout, children() - before


def tables(numbers: dict[str, Any]) -> list[Table]:
    """A table for each of the data."""
    shown = []
    for name, case in numbers["cases"].items():
        title = f"{name}: {case['elements']} elements, map and fields of order {case['order']}"
        table = Table(title, ["what", "first", "steady", "certain %", *_linear_names(case)])
        table.rows = [_row(what, found, len(table.columns)) for what, found in case["rows"].items()]
        table.notes = [
            f"CPU seconds; pictures of {numbers['pixels']} x {numbers['pixels']} pixels, volumes of 45 % of the side; "
            "commands with their imports. Certain: of the pixels with a hit. Linear: seconds of the clock for "
            "300 x 300 pixels, and the share of wrong ones."
        ]
        shown.append(table)
    return shown


def _linear_names(case: dict[str, Any]) -> list[str]:
    """Names of the linear pictures that any row has."""
    names = [own["name"] for found in case["rows"].values() for own in found.get("linear", [])]
    return list(dict.fromkeys(names))


def _row(what: str, found: dict[str, Any], width: int) -> list[str]:
    """A row in words."""
    if "failed" in found:
        return [what, found["failed"], *[""] * (width - 2)]
    certain = percent(found["certain"]) if "certain" in found else ""
    row = [what, seconds(found["first"]) if "first" in found else "", seconds(found["processor"]), certain]
    row += [f"{seconds(own['seconds'])}, {percent(own['wrong'])} %" for own in found.get("linear", [])]
    return [*row, *[""] * (width - len(row))]


def main() -> None:
    """One picture."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("files", nargs="+")
    parser.add_argument("kind", choices=list(PICTURES))
    parser.add_argument("--device", default="auto")
    parser.add_argument("--side", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=2)
    options = parser.parse_args()
    print(json.dumps(picture(options.files, options.kind, options.device, options.side, options.rounds)))


if __name__ == "__main__":
    main()
