"""How large and how exact drafts are, which are shown while something moves: so that they come in time."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from elvis.scene import Scene, VolumeRendering

#: parts of the full size each way that a picture may have
PARTS = (1.0, 0.5, 1 / 3, 0.25, 0.125, 0.0625)
#: the part where nothing is known
FIRST = 0.25
#: seconds that a picture may take: 13 pictures a second look continuous, and are larger than quicker ones
GOAL = 1 / 13
#: seconds after which a picture is given up where it could be smaller
LATE = 0.25
#: multiples of the goal above which the next pictures are smaller, and below which a larger size is tried
TOO_LONG, WELL_WITHIN = 1.4, 0.6
#: seconds after which a size that took too long is tried again, and by which they grow each time that it fails again:
#: the first draft may have to load kernels, but sizes don't flip within a drag
FIRST_WAIT, GROWTH = 1.0, 4.0
#: a whole picture that takes another multiple of the time than the last one shows another work
SAME_WORK = (0.5, 2.0)
#: error of a pixel's colour, by volumes
ERROR = 0.03


class Sizing:
    """Durations of the last pictures; times are from one clock, in seconds."""

    def __init__(self) -> None:
        #: the last draft: its part of the full size, and the shorter of the last two durations of this part
        self._last: tuple[float, float] | None = None
        #: what the last draft took by itself
        self._before = 0.0
        #: sizes that took too long: when they are tried again, and the seconds until then
        self._slow: dict[float, tuple[float, float]] = {}
        self._whole: float | None = None

    def note(self, part: float, seconds: float, now: float) -> None:
        """A draft took so long, or was given up after it."""
        is_same = self._last is not None and self._last[0] == part
        # a single slow picture does not change the size
        known = min(seconds, self._before) if is_same and seconds < LATE else seconds
        if known > TOO_LONG * GOAL:
            _, wait = self._slow.get(part, (0.0, FIRST_WAIT / GROWTH))
            self._slow[part] = now + GROWTH * wait, GROWTH * wait
        self._last, self._before = (part, known), seconds

    def note_whole(self, seconds: float) -> None:
        """A whole picture took so long; drafts cost less, so that this counts until there is one."""
        before, self._whole = self._whole, seconds
        low, high = SAME_WORK
        if before is None or not low < seconds / before < high:
            self._last = None
            self._slow.clear()

    def part(self, now: float) -> float:
        """The size of the next draft: that of the last one, unless it took too long or is much quicker than needed."""
        if self._last is None:
            return FIRST if self._whole is None else _fitting(1.0, self._whole)
        part, seconds = self._last
        if seconds > TOO_LONG * GOAL:
            return _fitting(part, seconds)
        larger = min((other for other in PARTS if other > part), default=part)
        is_tried, _ = self._slow.get(larger, (now, 0.0))
        return larger if seconds <= WELL_WITHIN * GOAL and now >= is_tried else part

    def is_late(self, part: float) -> bool:
        """Whether a draft of this part is to be given up once it is late: where a smaller one can be had.

        The first picture of all is not, as it compiles.
        """
        return part > PARTS[-1] and (self._last is not None or self._whole is not None)


def _fitting(part: float, seconds: float) -> float:
    """The largest size that is expected in time, else the smallest: a picture of a part took so long, by its pixels."""
    fitting = [other for other in PARTS if other <= part and seconds * (other / part) ** 2 <= GOAL]
    return max(fitting, default=PARTS[-1])


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
