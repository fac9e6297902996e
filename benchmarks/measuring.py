"""Seconds, processor seconds and peak memory of pieces of work, of several in turn so that all meet the same noise."""

from __future__ import annotations

import os
import resource
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from time import perf_counter, process_time
from typing import Any, TypeVar

T = TypeVar("T")

#: of processes that are measured by themselves: one thread of BLAS, as in every ``elvis`` command
ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}


@dataclass
class Timing:
    """Repeated runs of one piece of work, in seconds.

    wall       by the clock
    processor  of all threads of the process together; noise from other programs hardly shows in it
    """

    wall: list[float] = field(default_factory=list)
    processor: list[float] = field(default_factory=list)

    @property
    def best(self) -> float:
        """Seconds of the quickest run."""
        return min(self.wall)

    @property
    def median(self) -> float:
        """Seconds of a usual run."""
        return median(self.wall)

    @property
    def effort(self) -> float:
        """Processor seconds of the cheapest run."""
        return min(self.processor)

    def run(self, work: Callable[[], T]) -> T:
        """Do the work and note what it took."""
        wall, processor = perf_counter(), process_time()
        result = work()
        self.wall.append(perf_counter() - wall)
        self.processor.append(process_time() - processor)
        return result

    def record(self) -> dict[str, Any]:
        """The numbers, for JSON."""
        return {"best": self.best, "median": self.median, "processor": self.effort, "runs": len(self.wall)}


def once(work: Callable[[], T]) -> tuple[T, Timing]:
    """The result of one run, and what it took."""
    timing = Timing()
    return timing.run(work), timing


def in_turn(works: Mapping[str, Callable[[], Any]], rounds: int) -> dict[str, Timing]:
    """Timings of several pieces of work that take turns, after one round that doesn't count."""
    timings = {name: Timing() for name in works}
    for number in range(rounds + 1):
        for name, work in works.items():
            (timings[name] if number else Timing()).run(work)
    return timings


def forget_peak() -> None:
    """Let the peak memory of this process count from now on (Linux; elsewhere it counts from the start)."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return


def peak_memory() -> int:
    """Largest resident memory of this process in bytes since `forget_peak`."""
    return _resident("VmHWM") or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def memory() -> int:
    """Resident memory of this process in bytes, 0 where it can't be told."""
    return _resident("VmRSS")


def anonymous_memory() -> int:
    """Resident memory of this process in bytes that is of no file, 0 where it can't be told."""
    return _resident("RssAnon")


def _resident(name: str) -> int:
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) * 1024 for line in lines if line.startswith(name)), 0)


def contention(seconds: float = 0.3) -> float:
    """Clock over processor seconds of a busy loop: 1 on a quiet machine, 2 where programs share a core by halves."""
    timing, end = Timing(), perf_counter() + seconds

    def spin() -> None:
        while perf_counter() < end:
            pass

    timing.run(spin)
    return timing.best / timing.effort
