"""Long work in dispatches of bounded time, so that time limits and interrupts are detected while it goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from time import perf_counter, sleep
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.scene.model.time_limit import check_time

#: seconds that a dispatch is meant to take at most
AIM = 0.05
#: units of work of a kernel's first dispatches, when nothing is known of its speed
FIRST = 256.0
#: how much more work than its predecessor a dispatch does at most
GROWTH = 8.0
#: times the mean above which a processor's share of a dispatch is too much
UNEVEN = 1.1
#: groups of a row: devices limit each direction of a grid
GROUPS_IN_ROW = 32768
#: seconds of a wait in which the device is asked without pauses, and the longest pause after that
BUSY_SECONDS, MAX_PAUSE = 1e-4, 2e-3
#: a pause, as a share of the time waited so far
PAUSE_SHARE = 1 / 16
#: neighbouring groups that stay together at most, and how often each row has its turn at least
NEIGHBOURS, TURNS = 32, 16


class Pace:
    """Speed of one kernel, from its last dispatch.

    compiled  whether there was one
    """

    def __init__(self) -> None:
        self._seconds: float | None = None  # of a unit of work
        self.compiled = False

    def batches(self, count: int, work: NDArray[Any] | None = None) -> Iterator[tuple[int, int]]:
        """Ranges (first, end) of ``count`` groups; the caller waits until one is done before it takes the next.

        work  (count,) what each group has to do, in any unit; None where all have the same to do
        """
        if self._seconds is not None:
            # little work is one dispatch, whatever its parts
            total = float(count) if work is None else float(work.sum() + count)
            if 0 < total <= AIM / self._seconds:
                start = perf_counter()
                yield 0, count
                self._note((perf_counter() - start) / total)
                return
        ends = np.arange(1.0, count + 1.0) if work is None else np.cumsum(work + 1.0)
        first, done, most = 0, 0.0, np.inf
        while first < count:
            units = min(most, FIRST if self._seconds is None else AIM / self._seconds)
            end = max(first + 1, int(np.searchsorted(ends, done + units, side="right")))
            start = perf_counter()
            yield first, end
            units = float(ends[end - 1]) - done
            self._note((perf_counter() - start) / units)
            first, done, most = end, float(ends[end - 1]), GROWTH * units

    def _note(self, seconds: float) -> None:
        """Record the time of a unit of work; the very first dispatch compiles, and is ignored."""
        if self.compiled:
            self._seconds = max(seconds, 1e-12)
        self.compiled = True


def rows_of(work: NDArray[Any], shares: int) -> int:
    """Rows of a grid that take turns, so that contiguous shares are as much work (n,); one where they are so anyway."""
    if shares == 1 or len(work) <= shares:
        return min(len(work), shares)
    amounts = np.add.reduceat(work + 1.0, np.arange(shares) * len(work) // shares)
    return shares if amounts.max() > UNEVEN * amounts.mean() else 1


def grid_of(count: int, rows: int) -> tuple[int, int, int]:
    """Columns and rows of a grid of groups with at least ``rows`` rows, and the number of groups in a turn of a row.

    A turn is a power of two of neighbours, which write to the same cache lines, so that processors don't wait there.
    """
    rows = max(rows, -(-count // GROUPS_IN_ROW))
    turn = min(NEIGHBOURS, 1 << max(count // (rows * TURNS), 1).bit_length() - 1)
    return turn * -(-count // (rows * turn)), rows, turn


class Watch:
    """Work between dispatches: waiting for the device, and a check of the time.

    is_finished  whether a submission is finished
    retire       to be called when a submission is finished
    compiled     to be called when a kernel has run for the first time, with the seconds that it took
    """

    def __init__(
        self,
        is_finished: Callable[[int], bool],
        retire: Callable[[], object],
        compiled: Callable[[float], object],
    ) -> None:
        self._is_finished, self._retire, self.compiled = is_finished, retire, compiled

    @staticmethod
    def none() -> Watch:
        """The watch of a closed device."""
        return Watch(lambda submission: True, lambda: None, lambda seconds: None)

    def wait(self, submission: int) -> None:
        """Wait until the device has finished a submission.

        It is asked again and again: slangpy's own wait holds the interpreter, for seconds where the driver compiles a
        kernel, and no other thread could run, nor Ctrl-C be noticed.
        """
        start = perf_counter()
        while not self._is_finished(submission):
            waited = perf_counter() - start
            sleep(0.0 if waited < BUSY_SECONDS else min(PAUSE_SHARE * waited, MAX_PAUSE))
        self._retire()

    def after_dispatch(self, submission: int) -> None:
        """Wait until the device has finished a submission; SceneError where a time limit has passed."""
        self.wait(submission)
        check_time()
