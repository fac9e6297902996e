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
#: a size stays while its pictures take less than this multiple of the goal,
TOO_LONG = 1.4
#: and while those of the next larger size are expected to take more than this one: sizes don't flip in a drag
WELL_WITHIN = 0.7
#: a whole picture that takes another multiple of the time than the last one shows another work
SAME_WORK = (0.5, 2.0)
#: seconds after which it is forgotten what a picture took, unless it was the last one
AGE = 3.0
#: error of a pixel's colour, by volumes
ERROR = 0.03


class Sizing:
    """Durations of the last pictures; times are from one clock, in seconds."""

    def __init__(self) -> None:
        #: by the part of the full size: what a draft took, and when it was there
        self._drafts: dict[float, tuple[float, float]] = {}
        self._whole: float | None = None
        self._last: float | None = None

    def note(self, part: float, seconds: float, now: float) -> None:
        """A draft took so long, or was given up after it."""
        fresh = {other: known for other, known in self._drafts.items() if now - known[1] < AGE}
        self._drafts = {**fresh, part: (seconds, now)}
        self._last = part

    def note_whole(self, seconds: float) -> None:
        """A whole picture took so long; drafts cost less, so that this counts until there is one."""
        before, self._whole = self._whole, seconds
        low, high = SAME_WORK
        if before is None or not low < seconds / before < high:
            self._drafts, self._last = {}, None

    def part(self, now: float) -> float:
        """The largest size that can probably be drawn in time, else the smallest; at most twice the last."""
        last = max((when for _, when in self._drafts.values()), default=now)
        known = {part: own for part, (own, when) in self._drafts.items() if now - when < AGE or when == last}
        if not known and self._whole is None:
            return FIRST
        most = 2 * max(known, default=1.0)
        known = known or {1.0: self._whole or 0.0}
        fitting = [part for part in PARTS if part <= most and _expected(part, known) <= self._limit(part)]
        return max(fitting, default=PARTS[-1])

    def _limit(self, part: float) -> float:
        """Seconds that a picture of a part may take; the part of the last one has an advantage over larger ones."""
        if self._last is None or part < self._last:
            return GOAL
        return GOAL * (TOO_LONG if part == self._last else WELL_WITHIN)

    def is_late(self, part: float) -> bool:
        """Whether a draft of this part is to be given up once it is late: where a smaller one can be had.

        The first picture of all is not, as it compiles.
        """
        return part > PARTS[-1] and (bool(self._drafts) or self._whole is not None)


def _expected(part: float, known: dict[float, float]) -> float:
    """Expected seconds of a picture of some size: measured, or from the next larger one, as costs scale with pixels.

    If only smaller sizes are known, half of the cost is assumed to be independent of the size.
    """
    larger = [other for other in known if other >= part]
    if larger:
        nearest = min(larger)
        return known[nearest] * (part / nearest) ** 2
    nearest = max(known)
    return known[nearest] * part / nearest


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
