"""How large and how exact drafts are, which are shown while something moves: so that they come in time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from statistics import median_low
from typing import Any

from elvis.scene import Scene, VolumeRendering

#: parts of the full size each way that a picture may have
PARTS = (1.0, 0.75, 0.5, 1 / 3, 0.25, 0.125, 0.0625)
#: pixels of a picture each way
LEAST, MOST = 64, 8192
#: pixels of a picture, which take 3 GB; displays of 5120 by 2880 pixels have fewer
MOST_PIXELS = 1 << 24
#: the part where nothing is known, and below which drafts are only where they take too long
USUAL = 1 / 3
#: seconds that a draft may take: 13 drafts a second look continuous
GOAL = 1 / 13
#: seconds that one of the usual part may take: the page moves the last draft with the camera until the next one
BEARABLE = 0.3
#: seconds after which a draft is given up where it could be smaller
LATE = 1.0
#: durations of a part that are remembered: their median counts, as the first may load kernels and others be disturbed
REMEMBERED = 5
#: a whole picture that takes another multiple of the time than the last one shows another work
SAME_WORK = (0.5, 2.0)
#: error of a pixel's colour, by volumes
ERROR = 0.03


def limited_size(size: Sequence[float]) -> tuple[int, int]:
    """Width and height as a page asks for them, within the limits; a picture of too many pixels keeps its shape."""
    width, height = (min(max(side, LEAST), MOST) for side in size)
    scale = min(1.0, (MOST_PIXELS / (width * height)) ** 0.5)
    return int(width * scale), int(height * scale)


class Sizing:
    """Durations of drafts by their part of the full size; within a drag the part stays, or falls where it is late."""

    def __init__(self) -> None:
        self._durations: dict[float, list[float]] = {}
        self._whole: float | None = None
        #: the part of this drag, None before it
        self._part: float | None = None

    def note(self, part: float, seconds: float) -> None:
        """A draft took so long, or was given up after it."""
        self._durations[part] = [*self._durations.get(part, []), seconds][-REMEMBERED:]
        if seconds >= LATE and part == self._part:
            self._part = max((other for other in PARTS if other < part), default=part)

    def note_whole(self, seconds: float) -> None:
        """A whole picture took so long; drafts cost less, so that this counts until there is one.  It ends a drag."""
        self._part = None
        before, self._whole = self._whole, seconds
        low, high = SAME_WORK
        if before is None or not low < seconds / before < high:
            self._durations.clear()

    @property
    def trial(self) -> float | None:
        """The part of a draft that is drawn unseen to know its duration; None if enough is known.

        It takes place while nothing moves: so that the first drag finds its kernels loaded, and the right part.
        """
        known = self._durations.get(USUAL, [])
        is_enough = bool(known) and (min(known) <= BEARABLE or len(known) > 1)
        return None if self._whole is None or is_enough else USUAL

    def part(self) -> float:
        """The size of the next draft."""
        if self._part is None:
            self._part = self._chosen()
        return self._part

    def is_late(self, part: float) -> bool:
        """Whether a draft of this part is to be given up once it is late: where a smaller one can be had.

        The first picture of all is not, as it compiles.
        """
        return part > PARTS[-1] and (bool(self._durations) or self._whole is not None)

    def _chosen(self) -> float:
        """The largest part in time, at least the usual one if that is bearable, else the largest one that is."""
        quick = [part for part in PARTS if self._expected(part) <= GOAL]
        bearable = [part for part in PARTS if part <= USUAL and self._expected(part) <= BEARABLE]
        return max([*quick, *bearable], default=PARTS[-1])

    def _expected(self, part: float) -> float:
        """Seconds of a draft: as of its last ones, at most by its pixels as of smaller ones; else as of larger ones."""
        if self._durations:
            scaled = {other: median_low(own) * (part / other) ** 2 for other, own in self._durations.items()}
            return min((seconds for other, seconds in scaled.items() if other <= part), default=scaled[min(scaled)])
        return (self._whole or 0.0) * part**2 if self._whole is not None or part <= USUAL else float("inf")


def draft_of(scene: Scene, part: float) -> Scene:
    """The scene with fewer pixels, one sample for each, and volumes to a coarse tolerance.

    It is a picture, since only records need reference coordinates.
    """
    assert scene.size is not None
    width, height = (max(16, round(part * side)) for side in scene.size)
    objects = tuple(map(_coarse, scene.objects))
    return replace(scene, size=(width, height), samples=1, outputs=("picture.png",), objects=objects)


def _coarse(item: Any) -> Any:
    """An object of a scene; a volume with a greater error."""
    return replace(item, error=max(item.error, ERROR)) if isinstance(item, VolumeRendering) else item
