"""Paths and streaks of particles in a series: what moves them is interpolated between its steps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.streamlines.course import DIRECTIONS, Course, components_of, positive
from elvis.core.streamlines.moving import Interval
from elvis.core.streamlines.pathlines import pathlines as paths_through
from elvis.core.streamlines.pathlines import streaklines as streaks_through
from elvis.core.streamlines.streamlines import TracedLines
from elvis.plugins.series.between import NEAR, is_one_mesh
from elvis.plugins.series.series import Series

#: what may be between steps, as paths need a velocity that is continuous in time, and the order of the error then
ORDERS = {"linear": 2, "cubic": 4}


def pathlines(
    series: Series,
    seeds: Any,
    velocity: Sequence[str] | str | None = None,
    *,
    start: float | None = None,
    duration: float | None = None,
    direction: str = "forward",
    between: str = "linear",
    length: float | None = None,
    speed: float = 0.0,
    steps: int = 10_000,
    tolerance: float | None = None,
    spacing: float | None = None,
    fields: Sequence[str] = (),
    random: int = 0,
    ftle: bool = False,
) -> TracedLines:
    """Paths of particles that are released at seeds at one time, exactly in the curved elements (see `trace`).

    Coefficients are interpolated in time, of order 2 (``linear``) or 4 (``cubic``) in the steps' distance; the
    velocity, all ``fields`` and t in texts are evaluated at the time of each point, which ``time`` contains.

    start      time of release; None: of the first step, or of the last if direction is backward
    duration   maximum time for which particles are followed; None: to the end of the series
    direction  forward or backward in time, or both
    between    linear or cubic
    ftle       finite-time Lyapunov exponents, over the time that each particle is followed

    All others as in `trace`.  ElvisError for times outside the series, a changing mesh, and as in `trace`.

    >>> series = elvis.open_series("wave.xml", "wave_*.chk")
    >>> paths = elvis.pathlines(series, [(0.5, 0.25)], "0.1,0", tolerance=1e-6)
    >>> paths
    <TracedLines: 1 lines, ... points; 1 duration>
    """
    course = _course(seeds, velocity, direction, length, duration, speed, steps, tolerance, random)
    positive("spacing", spacing)
    time = _Time(series, between)
    begin = time.begin(start, direction)
    stops = [time.stop(begin, duration, sign) for sign in DIRECTIONS[direction]]
    dataset = time.dataset(begin)
    return paths_through(dataset, time.intervals, course, begin, stops, spacing=spacing, fields=fields, ftle=ftle)


def streaklines(
    series: Series,
    seeds: Any,
    velocity: Sequence[str] | str | None = None,
    *,
    start: float | None = None,
    duration: float | None = None,
    releases: int = 101,
    between: str = "linear",
    tolerance: float | None = None,
    fields: Sequence[str] = (),
    random: int = 0,
) -> TracedLines:
    """Streaklines, like those of dye: the final positions of all particles that left each seed one after another.

    A line begins at its seed, with the particle that left last; ``time`` is the time of release, ``length`` the length
    of each particle's path.  Particles that have left the data are missing.

    start     time of the first release; None: time of the first step
    duration  up to the last release, the time of the streaks; None: to the end of the series
    releases  number of releases, at equal time intervals, at least 2

    All others as in `pathlines`.

    >>> series = elvis.open_series("wave.xml", "wave_*.chk")
    >>> dye = elvis.streaklines(series, [(0.1, 0.25)], "0.1,0", releases=5, tolerance=1e-6)
    >>> dye.points[:, 0].round(6)
    array([0.1 , 0.15, 0.2 , 0.25, 0.3 ])
    """
    if releases < 2:
        raise ElvisError(f"releases: expected at least 2, found {releases}")
    course = _course(seeds, velocity, "forward", None, duration, 0.0, 10_000, tolerance, random)
    time = _Time(series, between)
    begin = time.begin(start, "forward")
    stop = time.stop(begin, duration, 1)
    return streaks_through(time.dataset(begin), time.intervals, course, begin, stop, releases, fields=fields)


def intervals(series: Series, between: str, start: float, stop: float) -> Iterator[Interval]:
    """The parts of time between steps from one time to another, earlier or later one.

    ElvisError for times that the series has not, steps with nothing continuous between, and a mesh that changes.
    """
    time = _Time(series, between)
    begin, end = (time.begin(each, "forward") for each in (start, stop))
    return time.intervals(begin, end)


def _course(
    seeds: Any,
    velocity: Sequence[str] | str | None,
    direction: str,
    length: float | None,
    duration: float | None,
    speed: float,
    steps: int,
    tolerance: float | None,
    random: int,
) -> Course:
    # the default duration is the series' own, so the length has no limit of its own
    limit = np.inf if duration is None else duration
    course = Course(seeds, components_of(velocity), direction, length, limit, speed, steps, tolerance, random)
    course.check()
    return course


class _Time:
    """The time of a series, between whose steps coefficients are interpolated."""

    def __init__(self, series: Series, between: str) -> None:
        if between not in ORDERS:
            raise ElvisError(f"paths: expected {' or '.join(ORDERS)} between steps, found {between!r}")
        self._series, self._between = series, between
        self._slack = NEAR * float(np.abs(series.times).max())
        first, last = series.readable_around(float(series.times[0]), 1)[0], series.last_readable()
        self._first, self._last = float(series.times[first]), float(series.times[last])

    def begin(self, start: float | None, direction: str) -> float:
        """When particles are released; ElvisError for a time that the series has not."""
        if start is None:
            return self._last if direction == "backward" else self._first
        if not self._first - self._slack <= start <= self._last + self._slack:
            raise ElvisError(f"expected a time from {self._first:.10g} to {self._last:.10g}, found {start:.10g}")
        return self._snapped(start)

    def stop(self, begin: float, duration: float | None, sign: int) -> float:
        """Up to when they are followed; ElvisError where the series ends before."""
        last = self._last if sign > 0 else self._first
        most = sign * (last - begin)
        if most <= 0:
            raise ElvisError(f"expected steps {'after' if sign > 0 else 'before'} time {begin:.10g}, found none")
        if duration is None:
            return last
        if duration > most + self._slack:
            raise ElvisError(f"duration: expected at most {most:.10g}, up to time {last:.10g}, found {duration:.10g}")
        return self._snapped(begin + sign * duration)

    def dataset(self, time: float) -> Any:
        """The step next to a time, which has the elements and names of all steps."""
        return self._series.steps_around(time, self._between)[1][0]

    def intervals(self, start: float, stop: float) -> Iterator[Interval]:
        """The parts of time between steps from one time to another, earlier or later one.

        ElvisError where the mesh changes.
        """
        time = start
        while time != stop:
            # a step's own time belongs to what comes next
            inside = float(np.nextafter(time, stop))
            numbers, steps = self._series.steps_around(inside, self._between)
            times = self._series.times[numbers]
            if not all(is_one_mesh(steps[0], step) for step in steps[1:]):
                where = f"steps {numbers[0]} and {numbers[-1]}"
                raise ElvisError(f"the mesh changes between {where}: paths can't be followed there")
            if stop > start:
                end = float(min(times[times > time].min(initial=stop), stop))
            else:
                end = float(max(times[times < time].max(initial=stop), stop))
            yield Interval(min(time, end), max(time, end), times, tuple(steps))
            time = end

    def _snapped(self, time: float) -> float:
        """The time of a step if it is equal to rounding, else the time itself."""
        times = self._series.times
        nearest = float(times[np.abs(times - time).argmin()])
        return nearest if abs(nearest - time) <= self._slack else time
