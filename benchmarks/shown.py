"""The scenes that are measured, on the paper's cases: what is drawn, from where, and what VTK makes of the same."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from elvis import (
    Camera,
    Contours,
    CutSurface,
    Dataset,
    Faces,
    Isosurface,
    Plane,
    Scene,
    Style,
    Transfer,
    VolumeRendering,
    read,
)

ROOT = Path(__file__).resolve().parent.parent
LINES = Contours(count=10)
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Shown:
    """A dataset of examples/cases.py with what is drawn of it.

    cut, value, volume  the plane that cuts, the value of the isosurface, the transfer function of the volume
    faces            names of boundaries
    across           views straight at the plane: name, centre, height
    along            views of surfaces and volumes: name, centre, height, all from the direction ``eye``
    """

    name: str
    range: tuple[float, float]
    cut: Plane
    faces: tuple[str, ...]
    value: float
    volume: Transfer
    eye: Vector
    across: tuple[tuple[str, Vector, float], ...]
    along: tuple[tuple[str, Vector, float], ...]
    field: str = "p"

    def dataset(self, quick: bool) -> Dataset:
        """The data with the one field."""
        dataset = self.whole(quick)
        return replace(dataset, fields=tuple(field for field in dataset.fields if field.name == self.field))

    def whole(self, quick: bool) -> Dataset:
        """The data, made where they aren't there yet."""
        folder = ROOT / "out" / ("quick-cases" if quick else "cases")
        files = [folder / f"{self.name}.xml", folder / f"{self.name}.fld"]
        if not all(file.exists() for file in files):
            option = ["--quick"] if quick else []
            command = [sys.executable, ROOT / "examples" / "cases.py", *option, folder, self.name]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        return read(*files)

    def scenes(self, kind: str, side: int) -> dict[str, Scene]:
        """The views of a kind of picture: ``cut``, ``faces``, ``isosurface``, ``volume`` or ``together``."""
        views = self.across if kind == "cut" else self.along
        away = self.cut.normal if kind == "cut" else self.eye
        return {name: self._scene(kind, side, at, away, height) for name, at, height in views}

    def _scene(self, kind: str, side: int, at: Vector, away: Vector, height: float) -> Scene:
        up = (0.0, 0.0, 1.0) if abs(away[2]) < 0.9 else (0.0, 1.0, 0.0)
        eye = (at[0] + 4 * away[0], at[1] + 4 * away[1], at[2] + 4 * away[2])
        cut = CutSurface(self.cut, Style(contours=LINES))
        faces = Faces(self.faces, Style(contours=LINES))
        isosurface, volume = Isosurface((self.value,)), VolumeRendering(self.volume, error=1e-2)
        objects = {
            "cut": (cut,),
            "faces": (faces,),
            "isosurface": (isosurface,),
            "volume": (volume,),
            "together": (cut, faces, isosurface, volume),
        }[kind]
        camera = Camera(eye, at, up, height=height)
        return Scene(self.field, camera=camera, size=(side, side), range=self.range, objects=objects)


DELTA = Shown(
    name="delta",
    range=(-2.0, 0.4),
    cut=Plane((1.2, 0.0, 0.0), (1.0, 0.0, 0.0)),
    faces=("wing", "symmetry"),
    value=-0.8,
    volume=Transfer((-1.5, -0.5, -0.3), (8.0, 1.0, 0.0)),
    eye=(-0.55, 0.7, 0.45),
    across=(("overview", (1.2, 0.55, 0.1), 1.9), ("detail", (1.2, 0.18, 0.12), 0.25)),
    along=(("overview", (0.75, 0.1, 0.1), 1.9), ("detail", (0.5, 0.1, 0.05), 0.3)),
)
WING = Shown(
    name="wing",
    range=(-1.2, 0.6),
    cut=Plane((0.0, 0.6, 0.0), (0.0, 1.0, 0.0)),
    faces=("wing", "symmetry"),
    value=-0.4,
    volume=Transfer((-0.8, -0.3, -0.1), (6.0, 1.5, 0.0)),
    eye=(-0.4, 0.6, 0.7),
    across=(("overview", (0.6, 0.6, 0.0), 3.0), ("detail", (0.4, 0.6, 0.0), 0.15)),
    along=(("overview", (0.6, 0.5, 0.0), 2.4), ("detail", (0.35, 0.5, 0.03), 0.2)),
)
SHOWN = (DELTA, WING)
