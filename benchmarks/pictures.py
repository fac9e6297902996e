"""A picture of a cut: exact, and by VTK of linear pieces after 0 to 3 refinements; seconds and errors of each."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import linear
import numpy as np
from cases import FIELD, Case, cut
from measuring import Timing, in_turn, once
from tables import Table, mebibytes, percent, seconds

from elvis.formats import Dataset
from elvis.formats.arrays import Floats
from elvis.formats.sampling import sample
from elvis.renderer import Renderer
from elvis.renderer.frame import Frame
from elvis.renderer.picture import picture

STAGES = ("refine", "cut", "draw")
#: share of the range that one step of an 8-bit colour map spans
STEP = 1 / 256


def compare(case: Case, device: str, side: int, rounds: int, levels: int) -> dict[str, Any]:
    """All numbers of one case."""
    dataset = case.dataset()
    with Renderer(device) as renderer:
        _, load = once(lambda: renderer.load(dataset, FIELD))
        frame, first = once(lambda: exact(renderer, side))
        rivals, missing = _rivals(dataset, frame, levels)
        works: dict[str, Callable[[], Any]] = {"exact": partial(exact, renderer, side)}
        for level, rival in enumerate(rivals):
            works[f"linear {level}"] = rival.picture
        timings = in_turn(works, rounds)
        return {
            "case": case.label,
            "pixels": [side, side],
            "inside": int(frame.seen.sum()),
            "exact": {
                **timings["exact"].record(),
                "load": load.best,
                "first": first.best,
                "stages": frame_stages(renderer, side),
                "error": error_of_sample(dataset, frame),
                "status": frame.counts(),
            },
            "linear": [rival.record(timings[f"linear {level}"], frame) for level, rival in enumerate(rivals)],
            "missing": missing,
        }


def exact(renderer: Renderer, side: int) -> Frame:
    """Our picture, read back and coloured."""
    frame = renderer.render(cut(side), references=False)
    colours(frame)
    return frame


def colours(frame: Frame) -> Any:
    """The bare 8-bit image of a frame."""
    return picture(frame, plain=True)


def frame_stages(renderer: Renderer, side: int) -> dict[str, float]:
    """Seconds of the stages of one frame, colouring among them."""
    frame = renderer.render(cut(side), references=False)
    _, color = once(lambda: colours(frame))
    return {**frame.stats["seconds"], "color": color.best}


def error_of_sample(dataset: Dataset, frame: Frame, count: int = 2000) -> dict[str, float]:
    """Greatest difference from the NumPy evaluation at some pixels over the range, and pixels that only one sees."""
    rng = np.random.default_rng(0)
    columns, rows = rng.integers(frame.view.width, size=count), rng.integers(frame.view.height, size=count)
    truth = sample(dataset, [FIELD], frame.view.points_of(columns, rows)).values[:, 0]
    ours = frame.field[rows, columns]
    low, high = frame.range
    both = np.isfinite(truth) & np.isfinite(ours)
    return {
        "pixels": count,
        "greatest": float(np.abs(truth - ours)[both].max(initial=0) / (high - low)),
        "coverage": int((np.isfinite(truth) != np.isfinite(ours)).sum()),
    }


class Rival:
    """VTK's picture after some refinements; the seconds of its stages are kept for every run."""

    def __init__(self, dataset: Dataset, level: int, frame: Frame, canvas: linear.Canvas, gauge: linear.Gauge) -> None:
        self._level, self._view, self._canvas, self._gauge = level, frame.view, canvas, gauge
        self._pieces = linear.Pieces(dataset, FIELD, level)
        self.stages = {stage: Timing() for stage in STAGES}
        self._bytes = 0

    def picture(self) -> Any:
        """Refine, cut and draw."""
        grid = self.stages["refine"].run(self._pieces.grid)
        triangles = self.stages["cut"].run(lambda: linear.section(grid, self._view.plane))
        self._bytes = 1024 * grid.GetActualMemorySize()
        return self.stages["draw"].run(lambda: self._canvas.image(triangles))

    def record(self, timing: Timing, frame: Frame) -> dict[str, Any]:
        """Its numbers beside the exact frame."""
        low, high = frame.range
        shift = (high - low) - low
        shown = self._gauge.values(linear.section(self._pieces.grid(shift), self._view.plane)) - shift
        return {
            "refinements": self._level,
            "tetrahedra": self._pieces.count,
            "bytes": self._bytes,
            **timing.record(),
            "stages": {stage: taken.record() for stage, taken in self.stages.items()},
            **differences(shown, frame),
        }


def differences(shown: Floats, frame: Frame) -> dict[str, float]:
    """How far an image (h, w) of numbers is from the exact one."""
    low, high = frame.range
    error = np.abs(shown - frame.field) / (high - low)
    error = error[np.isfinite(error)]
    return {
        "wrong": float((error > STEP).mean()) if len(error) else 1.0,
        "greatest": float(error.max(initial=0)),
        "coverage": float((np.isfinite(shown) != frame.seen).sum() / frame.seen.sum()),
    }


def _rivals(dataset: Dataset, frame: Frame, levels: int) -> tuple[list[Rival], str | None]:
    missing = linear.why_not()
    if missing:
        return [], missing
    low, high = frame.range
    canvas, gauge = linear.Canvas(frame.view, low, high), linear.Gauge(frame.view, high - low)
    return [Rival(dataset, level, frame, canvas, gauge) for level in range(levels)], None


def table(numbers: dict[str, Any], title: str) -> Table:
    """The numbers in words."""
    ours, inside = numbers["exact"], numbers["inside"]
    columns = ["picture", "best s", "median s", "CPU s", "refine", "cut", "draw", "exact / it", "CPU", "cut + draw"]
    shown = Table(title, [*columns, "wrong %", "greatest", "cover %", "MiB"])
    error = f"{ours['error']['greatest']:.0e}"
    own = [seconds(ours[key]) for key in ("best", "median", "processor")]
    shown.rows = [["exact", *own, "", "", "", "1", "1", "1", "0", error, "0", ""]]
    shown.rows += [_row(it, ours) for it in numbers["linear"]]
    shown.notes = _notes(numbers, inside)
    return shown


def _row(it: dict[str, Any], ours: dict[str, Any]) -> list[str]:
    """A linear picture in words, compared with ours."""
    stages = [it["stages"][stage] for stage in STAGES]
    ratios = [ours["median"] / it["median"], ours["processor"] / it["processor"]]
    ratios.append(ours["median"] / sum(stage["median"] for stage in stages[1:]))
    row = [f"linear, {it['refinements']} refinements, {it['tetrahedra']:,} tetrahedra"]
    row += [seconds(it[key]) for key in ("best", "median", "processor")]
    row += [seconds(stage["best"]) for stage in stages]
    row += [f"{ratio:.2f}" for ratio in ratios]
    return [*row, percent(it["wrong"]), f"{it['greatest']:.1e}", percent(it["coverage"]), mebibytes(it["bytes"])]


def _notes(numbers: dict[str, Any], inside: int) -> list[str]:
    ours = numbers["exact"]
    width, height = numbers["pixels"]
    stages = ", ".join(f"{name} {seconds(value)}" for name, value in ours["stages"].items() if name != "load")
    sampled = ours["error"]
    notes = [
        f"{numbers['case']}; {width} x {height} pixels, {inside:,} inside; {ours['runs']} rounds in turn. A picture of "
        "ours is the frame in float64, read back and coloured; loading took "
        f"{seconds(ours['load'])} s, the first frame {seconds(ours['first'])} s (kernels compiled unless cached). "
        f"Seconds of one frame's stages: {stages}.",
        "Of the linear pictures, *exact / it* compares whole frames (medians), *CPU* processor seconds, *cut + draw* "
        "leaves their refinement out. Wrong: pixels off by more than 1/256 of the range; greatest: error over range "
        f"(of ours: from the NumPy evaluation at {sampled['pixels']} pixels, of which {sampled['coverage']} differ in "
        "coverage).",
    ]
    return [*notes, numbers["missing"]] if numbers["missing"] else notes
