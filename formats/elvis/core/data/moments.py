"""Moments of a series in time: what options, scenes and readers of files mean by a step or a time."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from elvis.core.base.errors import ElvisError, FormatError

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset

#: interpolation between steps: a polynomial in time through two or through four of them, or the nearest one
BETWEEN = ("linear", "cubic", "nearest")


@dataclass(frozen=True)
class Moment:
    """The selected moment of a series: a step, a time, or by default the last step.

    step     counted from 0, from the end where it is negative
    time     in the unit of the files
    between  one of BETWEEN
    wants_series  whether a series is requested though no moment is requested
    """

    step: int | None = None
    time: float | None = None
    between: str = BETWEEN[0]
    wants_series: bool = False

    def __post_init__(self) -> None:
        if self.step is not None and self.time is not None:
            raise ElvisError(f"expected a step or a time, found step {self.step} and time {self.time:g}")
        if self.between not in BETWEEN:
            raise ElvisError(f"expected {', '.join(BETWEEN)} between steps, found {self.between!r}")

    @property
    def is_asked(self) -> bool:
        """Whether a step or a time is requested."""
        return self.step is not None or self.time is not None or self.wants_series

    def of_one_state(self, dataset: Dataset) -> Dataset:
        """Data that are not a series: a time replaces t; raises ElvisError for a step that does not exist."""
        if self.step not in (None, 0, -1):
            raise ElvisError(f"expected step 0, as the files contain one state, found {self.step}")
        return dataset if self.time is None else replace(dataset, time=self.time)


@dataclass(frozen=True)
class Instant:
    """The moment of a series that data represent.

    time     time of the data, in the unit of the files
    steps    the first and the last step that contribute
    between  one of BETWEEN, or quadratic, if no step has the requested time; else None
    """

    time: float
    steps: tuple[int, int]
    between: str | None = None

    def __str__(self) -> str:
        return f"time {self.time:.6g}" + (f" ({self.between})" if self.between else "")

    def facts(self) -> dict[str, Any]:
        """As plain data."""
        return {"time": self.time, "steps": list(self.steps), "between": self.between}


def checked_step(step: int, count: int, file: str | Path | None = None, place: str | None = None) -> int:
    """The step from 0 to ``count`` - 1 that a number means, which counts from the end where it is negative."""
    if not -count <= step < count:
        raise FormatError(f"expected a step from 0 to {count - 1}, found {step}", file=file, place=place)
    return step % count
