"""Linear pictures next to an exact one: refined until they are right, or until there is no room for more."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from math import comb
from typing import Any

import linear
from linear_scenes import Rival
from measuring import Timing, in_turn
from tables import Table, percent, seconds

from elvis import Dataset
from elvis.core.base.memory import free_memory
from elvis.scene.record.frame import Frame

#: share of wrong pixels below which a linear picture counts as right
RIGHT = 1e-3
#: refinements that are shown in any case, if there is room
LEVELS, QUICK = 4, 2
#: part of the free memory that pieces may take, and seconds beyond which a picture is drawn once only
ROOM, LONG = 0.5, 3.0


@dataclass(frozen=True)
class Rivals:
    """VTK's pictures, each refined once more than the one before; ``remarks`` tell why there are no more."""

    pictures: list[Rival] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @staticmethod
    def of(dataset: Dataset, frame: Frame, quick: bool, least: int = LEVELS) -> Rivals:
        """``least`` pictures, and more until one is RIGHT or would need too much room; with ``quick`` a few."""
        missing = linear.why_not()
        if missing:
            return Rivals(remarks=[missing])
        made: list[Rival] = []
        while len(made) < (QUICK if quick else least) or not (quick or made[-1].errors["wrong"] < RIGHT):
            need, room = size_of(made[0], len(made)) if made else 0, ROOM * free_memory()
            if need > room:
                what = f"{len(made)} refinements would take about {need / 2**30:.1f} GiB"
                return Rivals(made, [f"{what}, more than {100 * ROOM:.0f} % of the memory that is free: left out"])
            made.append(Rival(dataset, frame, len(made)))
        return Rivals(made)

    def in_turn(self, exact: Callable[[], Any], rounds: int) -> dict[str, Timing]:
        """Timings of the exact picture and of all others; of heavy ones that of the first run."""
        firsts = {str(level): rival.first for level, rival in enumerate(self.pictures)}
        works = {str(level): rival.picture for level, rival in enumerate(self.pictures) if rival.first.best < LONG}
        return firsts | in_turn({"exact": exact, **works}, rounds)

    def record(self, timings: dict[str, Timing]) -> dict[str, Any]:
        """The numbers, for JSON."""
        linear = [rival.record(timings[str(level)]) for level, rival in enumerate(self.pictures)]
        return {"linear": linear, "remarks": self.remarks}


def size_of(whole: Rival, level: int) -> int:
    """Bytes of the refined pieces of unrefined ones: four numbers a point, one a corner and one more a piece."""
    n, sides = 1 << level, whole.dimension
    return 8 * whole.pieces.count * (4 * comb(n + sides, sides) + (sides + 2) * n**sides)


def table(found: Iterable[tuple[str, dict[str, Any]]]) -> Table:
    """Of each picture, the first linear one that is right next to the exact one."""
    shown = Table(
        f"Exact pictures next to the first linear ones with under {100 * RIGHT:g} % wrong",
        ["picture", "exact, s", "CPU s", "refinements", "linear, s", "CPU s", "wrong %", "exact / it", "CPU"],
    )
    shown.rows = [[title, *_cells(numbers)] for title, numbers in found if numbers["linear"]]
    shown.notes = [
        "Medians; CPU: seconds of all threads. Where no linear picture is right, the last one that there is room for "
        "stands after a >."
    ]
    return shown


def _cells(numbers: dict[str, Any]) -> list[str]:
    ours, last = numbers["exact"], numbers["linear"][-1]
    it = next((some for some in numbers["linear"] if some["wrong"] < RIGHT), last)
    beyond = "" if it["wrong"] < RIGHT else "> "
    ratios = [f"{ours[key] / it[key]:.2f}" for key in ("median", "processor")]
    times = [seconds(some[key]) for some in (ours, it) for key in ("median", "processor")]
    return [*times[:2], f"{beyond}{it['refinements']}", *times[2:], percent(it["wrong"]), *ratios]
