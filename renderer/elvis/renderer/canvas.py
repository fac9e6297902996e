"""Pictures of many objects: bands of rows are drawn, recorded and painted one after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import product
from time import perf_counter
from typing import Any

import numpy as np

from elvis.formats.arrays import Floats
from elvis.renderer.frame import Drawing, Frame, whole
from elvis.renderer.scene import Scene
from elvis.renderer.shading import Drawn, Painter, record_of
from elvis.renderer.stages import Stages
from elvis.renderer.view import View

#: most pixels that are drawn at once
BAND = 1 << 22


@dataclass(eq=False)
class Canvas:
    """One picture in the making.

    records  whether fields, elements, positions and normals are kept; else colours and statuses alone
    """

    scene: Scene
    view: View
    stages: Stages
    records: bool = True
    seconds: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.painter = Painter(self.scene, self.stages, self.stages.bounds)
        self.sheets = self.stages.sheets(self.scene)
        self.arrays = _arrays(self.view, self.records)

    def frame(self, progress: Callable[[int, int], object]) -> Frame:
        """The whole picture.  Where it has several bands and colours depend on all of them, all are drawn twice."""
        bands = _bands(self.view)
        twice = len(bands) > 1 and not self.painter.settled(self.sheets)
        total = len(bands) * (2 if twice else 1)
        for number, (_, band) in enumerate(bands if twice else ()):
            progress(number, total)
            self.painter.note(self._drawn(band))
        for number, (top, band) in enumerate(bands):
            progress(total - len(bands) + number, total)
            self._fill(top, band)
        arrays = self.arrays
        drawing = Drawing(arrays["depth"], arrays["normal"], arrays["color"], self.painter.legends(self.sheets))
        stats = {"seconds": self.seconds, "bytes": {"volume": self.stages.loaded.bytes}}
        field, element, reference = (arrays[name] for name in ("field", "element", "reference"))
        return Frame(self.scene, self.view, field, element, reference, arrays["status"], stats, drawing)

    def _fill(self, top: int, band: View) -> None:
        """Record and paint one band, whose first row is ``top``."""
        drawn = self._drawn(band)
        self.painter.note(drawn)
        rows, shape = slice(top, top + band.height), (band.height, band.width)
        record = record_of(drawn, band)
        self.arrays["status"][rows] = record.status.reshape(shape)
        if self.records:
            self.arrays["element"][rows] = self.stages.loaded.ids.take(record.owner, mode="clip").reshape(shape)
            for name in ("field", "depth", "reference", "normal"):
                values = getattr(record, name)
                self.arrays[name][rows] = values.reshape(*shape, *values.shape[1:])
        color = self._colors(drawn, band).reshape(*shape, 3)
        self.arrays["color"][rows] = color if self.records else whole(color)

    def _drawn(self, view: View) -> Drawn:
        """All layers of all sheets."""
        start = perf_counter()
        drawn = [(sheet, layer) for sheet in self.sheets for layer in self.stages.layers(sheet, view, self.scene.clip)]
        self._spent("surfaces", start)
        return drawn

    def _colors(self, drawn: Drawn, view: View) -> Floats:
        """(n, 3) means over the samples of each pixel; ``drawn`` are the layers at its centre."""
        start, count = perf_counter(), self.scene.samples
        steps = (np.arange(count) - 0.5 * (count - 1)) / count
        total = np.zeros((view.count, 3))
        for x, y in product(steps, steps):
            here = view if x == y == 0.0 else view.window(x, y, view.width, view.height)
            total += self.painter.paint(drawn if here is view else self._drawn(here), here)
        self._spent("colours", start)
        return total / count**2

    def _spent(self, what: str, start: float) -> None:
        self.seconds[what] = self.seconds.get(what, 0.0) + perf_counter() - start


def _bands(view: View) -> Sequence[tuple[int, View]]:
    """First rows and views of bands of BAND pixels at most."""
    rows = max(1, BAND // view.width)
    return [(top, view.window(0, top, view.width, min(rows, view.height - top))) for top in range(0, view.height, rows)]


def _arrays(view: View, records: bool) -> dict[str, Any]:
    """Empty channels by name, (height, width[, 3]); those that aren't kept take no room."""
    shape = (view.height, view.width)
    arrays: dict[str, Any] = {"status": np.zeros(shape, np.uint8)}
    arrays["color"] = np.zeros((*shape, 3), np.float64 if records else np.uint8)
    make = np.full if records else lambda shape, value: np.broadcast_to(np.array(value), shape)
    arrays |= {name: make(shape, value) for name, value in {"field": np.nan, "depth": np.inf, "element": -1}.items()}
    return arrays | {name: make((*shape, 3), np.nan) for name in ("reference", "normal")}
