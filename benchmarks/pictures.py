"""A picture of a cut: exact, and by VTK of linear pieces after some refinements; seconds and errors of each."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from cases import FIELD, Case, cut
from linear_scenes import STAGES
from measuring import once
from rivals import Rivals
from tables import Table, mebibytes, percent, seconds

from elvis import Dataset, Renderer, Scene
from elvis.core.numbers.sampling import sample
from elvis.scene.figure.picture import picture
from elvis.scene.record.frame import Frame


def compare(case: Case, device: str, side: int, rounds: int, quick: bool) -> dict[str, Any]:
    """All numbers of one case."""
    dataset = case.dataset()
    with Renderer(device) as renderer:
        _, load = once(lambda: renderer.load(dataset, FIELD))
        frame, first = once(lambda: exact(renderer, cut(side)))
        rivals = Rivals.of(dataset, frame, quick)
        timings = rivals.in_turn(partial(exact, renderer, cut(side)), rounds)
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
            **rivals.record(timings),
        }


def exact(renderer: Renderer, scene: Scene) -> Frame:
    """Our picture, read back and coloured."""
    frame = renderer.render(scene, references=False)
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
    """Largest difference from the NumPy evaluation at some pixels over the range, and pixels that only one sees."""
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


def table(numbers: dict[str, Any], title: str) -> Table:
    """The numbers in words."""
    ours, inside = numbers["exact"], numbers["inside"]
    columns = ["picture", "best s", "median s", "CPU s", *STAGES, "exact / it", "CPU", "extract + draw"]
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
    row = [f"linear, {it['refinements']} refinements, {it['pieces']:,} tetrahedra"]
    row += [seconds(it[key]) for key in ("best", "median", "processor")]
    row += [seconds(stage["best"]) for stage in stages]
    row += [f"{ratio:.2f}" for ratio in ratios]
    return [*row, percent(it["wrong"]), f"{it['greatest']:.1e}", percent(it["missed"]), mebibytes(it["bytes"])]


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
        "Of the linear pictures, *exact / it* compares whole frames (medians), *CPU* processor seconds, *extract + "
        "draw* leaves their refinement out. Wrong: pixels off by more than 1/256 of the range; greatest: error over "
        f"range (of ours: from the NumPy evaluation at {sampled['pixels']} pixels, of which {sampled['coverage']} "
        "differ in coverage).",
    ]
    return [*notes, *numbers["remarks"]]
