"""Paths of particles in a velocity that changes in time, and streaks of particles released at one place.

The velocity is a polynomial in time from one step of a series to the next (`moving`).  Particles are therefore followed
through one such interval after another, as lines of a steady velocity are; only the velocity changes between intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Dataset
from elvis.core.mapping.locate import Location, Locator
from elvis.core.quantities.expression import Expression, column_expressions
from elvis.core.streamlines.course import SPACING, Course, diagonal, limits_of
from elvis.core.streamlines.endings import End, end_names
from elvis.core.streamlines.flow_data import flow_data
from elvis.core.streamlines.lines.pieces import DEVIATION, Curves, Pieces, check_count, pieces_of, resting
from elvis.core.streamlines.lines.steps import Limits, Piece
from elvis.core.streamlines.moving import Interval, MovingVelocity, moving_names
from elvis.core.streamlines.neighbours import Neighbours
from elvis.core.streamlines.seeds import SeedPlaces, seed_points
from elvis.core.streamlines.streamlines import TAKEN, Along, Points, TracedLines, collected, joined
from elvis.core.streamlines.stretching import Stretching, slope_expressions
from elvis.core.streamlines.tracer import Tracer
from elvis.core.streamlines.velocity import velocity_expressions

#: from one time to another, earlier or later, the intervals between
Intervals: TypeAlias = Callable[[float, float], Iterator[Interval]]
#: a particle is not at its end where it rests for a moment
_NO_REST = -1.0


@dataclass(frozen=True, eq=False)
class _Scene:
    """The setting of particles: elements, positions of seeds, components of the velocity and additional quantities."""

    neighbours: Neighbours
    locator: Locator
    location: Location
    limits: Limits
    components: Sequence[Expression]
    slopes: Sequence[Expression]
    others: Sequence[Expression]

    @staticmethod
    def of(dataset: Dataset, course: Course, fields: Sequence[str] = (), has_slopes: bool = False) -> _Scene:
        """The setting, from the data at one of the steps."""
        flow_data(dataset)
        names = moving_names(dataset)
        components = velocity_expressions(dataset, course.velocity, names)
        slopes = slope_expressions(dataset, course, names) if has_slopes else []
        others = column_expressions(fields, names, TAKEN)
        interval = Interval(0.0, 1.0, np.zeros(1), (dataset,))
        patches = MovingVelocity(interval, components, [*slopes, *others]).patches
        locator = Locator(patches)
        location = locator.locate(seed_points(SeedPlaces.of(dataset, locator), course.seeds, course.random))
        limits = limits_of(diagonal(locator), course, _NO_REST)
        return _Scene(Neighbours.of(dataset, patches), locator, location, limits, components, slopes, others)

    def velocity(self, interval: Interval) -> MovingVelocity:
        """The velocity, and the additional quantities, in an interval."""
        return MovingVelocity(interval, self.components, [*self.slopes, *self.others])

    def released(self, start: float, stop: float) -> _Particles:
        """A particle of each seed, all released at the start."""
        seeds = np.arange(len(self.location))
        return _Particles(self, seeds, np.full(len(seeds), start), start, 1 if stop > start else -1)


class _Particles:
    """Particles under way, released at times of their own: arrays are by particle.

    seeds    (n,)  the numbers of the seeds where they begin
    release  (n,)  when, at ``start`` or, by the sign, after it
    """

    def __init__(self, scene: _Scene, seeds: Ints, release: Floats, start: float, sign: int) -> None:
        self.scene, self.seeds, self.release, self.start, self.sign = scene, seeds, release, start, sign
        self._tracer: Tracer | None = None

    @property
    def tracer(self) -> Tracer:
        """The tracer of the particles, once they have begun."""
        assert self._tracer is not None
        return self._tracer

    def through(self, intervals: Iterator[Interval]) -> Iterator[tuple[MovingVelocity, Ints]]:
        """The velocity of one interval after another, with those particles (k,) that are in it from the beginning.

        The caller runs the tracer to the end of each.
        """
        elapsed = 0.0
        for interval in intervals:
            velocity = self.scene.velocity(interval)
            elapsed += interval.high - interval.low
            if self._tracer is None:
                self._begin(velocity, interval, elapsed)
            tracer = self.tracer
            ready = tracer.end == End.DURATION
            begun = self._since_start(interval) < elapsed
            lines = np.flatnonzero(ready & begun)
            tracer.resume(lines, velocity, self._clock(interval)[lines], elapsed)
            yield velocity, lines
            if not (tracer.end == End.DURATION).any():
                return

    def _since_start(self, interval: Interval) -> Floats:
        """(n,) how long after the start particles are released, or the interval begins."""
        begin = interval.low if self.sign > 0 else interval.high
        return np.maximum(self.sign * (self.release - self.start), self.sign * (begin - self.start))

    def _clock(self, interval: Interval) -> Floats:
        """(n,) the interval's coordinate of time where particles begin in it."""
        time = self.start + self.sign * self._since_start(interval)
        return np.clip((time - interval.low) / (interval.high - interval.low), 0.0, 1.0)

    def _begin(self, velocity: MovingVelocity, interval: Interval, elapsed: float) -> None:
        """Put particles into elements, where they wait."""
        scene, location = self.scene, self.scene.location
        limits = replace(scene.limits, duration=elapsed)
        tracer = Tracer(velocity, scene.neighbours, scene.locator, limits, self.sign)
        patch, row = location.patch[self.seeds], location.row[self.seeds]
        tracer.place(patch, row, np.column_stack([location.reference[self.seeds], self._clock(interval)]))
        tracer.time[:] = self.sign * (self.release - self.start)
        tracer.end[patch >= 0] = End.DURATION
        self._tracer = tracer


def pathlines(
    dataset: Dataset,
    intervals: Intervals,
    course: Course,
    start: float,
    stops: Sequence[float],
    *,
    spacing: float | None = None,
    fields: Sequence[str] = (),
    ftle: bool = False,
) -> TracedLines:
    """Paths of particles that are all released at one time, in the form of `trace`; ``time`` is the time of the data.

    dataset    at one of the steps
    intervals  the parts of time between steps
    course     seeds and limits
    start      the time of release
    stops      times up to which they are followed: later, earlier, or both
    """
    scene = _Scene.of(dataset, course, fields, ftle)
    apart = SPACING * diagonal(scene.locator) if spacing is None else float(spacing)
    directions, exponents = [], []
    for stop in stops:
        particles = scene.released(start, stop)
        parts, stretching, count = list[Along](), None, 0
        for velocity, lines in particles.through(intervals(start, stop)):
            stretching = stretching or Stretching(velocity, [*scene.slopes], len(particles.seeds), particles.sign)
            stretching.velocity = velocity
            own = stretching if ftle else None
            points = collected(particles.tracer, lines if not parts else lines[:0], apart, own, count)
            count += len(points.line)
            known = Along.of(points, velocity, scene.others)
            parts.append(replace(known, time=start + known.time))
        assert stretching is not None
        directions.append((particles.tracer.end, parts))
        exponents += [stretching.exponents()] if ftle else []
    return joined(directions, scene.neighbours.names, np.concatenate(exponents) if ftle else None)


def path_curves(dataset: Dataset, intervals: Intervals, course: Course, start: float, stop: float) -> Curves:
    """The paths of `pathlines` as curves, for pictures; only seeds if the times are equal."""
    scene = _Scene.of(dataset, course)
    if start == stop:
        return _resting_curves(scene, dataset, start)
    particles = scene.released(start, stop)
    most = DEVIATION * diagonal(scene.locator)
    found, count = list[Pieces](), 0
    for velocity, _ in particles.through(intervals(start, stop)):
        for part in pieces_of(particles.tracer, 0, velocity, most):
            found.append(part)
            count += len(part)
            check_count(count)
    return _curves(scene, Pieces.joined(found), particles.tracer.end)


def path_steps(
    dataset: Dataset, intervals: Intervals, course: Course, start: float, stop: float
) -> Iterator[tuple[MovingVelocity, Piece]]:
    """The steps of `pathlines`, with the velocity of each; none if the times are the same."""
    if start == stop:
        return
    particles = _Scene.of(dataset, course).released(start, stop)
    for velocity, _ in particles.through(intervals(start, stop)):
        for piece in particles.tracer.run():
            yield velocity, piece


def streak_curves(
    dataset: Dataset, intervals: Intervals, course: Course, start: float, stop: float, releases: int
) -> Curves:
    """The particles of `streaklines` as curves that stay where they are, for pictures of them."""
    scene = _Scene.of(dataset, course)
    if start == stop:
        return _resting_curves(scene, dataset, start)
    points, velocity, ends = _streaks(scene, intervals, start, stop, releases)
    known = Along.of(points, velocity, ())
    reference = points.state[:, :-2]
    pieces = resting(known.points, reference, known.element, points.line, known.time)
    return _curves(scene, pieces, ends)


def _resting_curves(scene: _Scene, dataset: Dataset, start: float) -> Curves:
    """Seeds at the time of their release."""
    velocity = scene.velocity(Interval(start, start + 1.0, np.array([start]), (dataset,)))
    location = scene.location
    there = np.flatnonzero(location.patch >= 0)
    reference = location.reference[there]
    patch, row = location.patch[there], location.row[there]
    places = velocity.positions(patch, row, np.column_stack([reference, np.zeros(len(there))]))
    pieces = resting(places, reference, location.element_id[there], there, np.full(len(there), start))
    return _curves(scene, pieces, np.where(location.patch >= 0, End.DURATION, End.OUTSIDE))


def _curves(scene: _Scene, pieces: Pieces, ends: Ints) -> Curves:
    """Pieces of lines that end so (n,)."""
    names = end_names(scene.neighbours.names)
    counts = np.bincount(ends, minlength=len(names))
    told = {name: int(number) for name, number in zip(names, counts, strict=True) if number}
    return Curves(pieces, int((ends != End.OUTSIDE).sum()), told, diagonal(scene.locator))


def streaklines(
    dataset: Dataset,
    intervals: Intervals,
    course: Course,
    start: float,
    stop: float,
    releases: int,
    *,
    fields: Sequence[str] = (),
) -> TracedLines:
    """Positions at one time of all particles released at each seed since another time, one line per seed.

    A line begins at its seed, with the particle that was released last.  ``time`` is the time of release, ``length``
    the length of each particle's own path; particles that left the data are missing.

    start, stop  times of the first release, and of the last one, for which the lines are computed
    releases     number of releases, equally spaced in time, including the first and the last one
    others as in `pathlines`
    """
    scene = _Scene.of(dataset, course, fields)
    points, velocity, _ = _streaks(scene, intervals, start, stop, releases)
    ends = np.where(scene.location.patch < 0, End.OUTSIDE, End.DURATION)
    return joined([(ends, [Along.of(points, velocity, scene.others)])], scene.neighbours.names)


def _streaks(
    scene: _Scene, intervals: Intervals, start: float, stop: float, releases: int
) -> tuple[Points, MovingVelocity, Ints]:
    """Positions of active particles of each seed, the velocity there, and the ends of all particles (n,).

    Lines are seeds, and begin with the particle that was released last.
    """
    seeds = np.repeat(np.arange(len(scene.location)), releases)
    release = np.tile(np.linspace(stop, start, releases), len(scene.location))
    particles = _Particles(scene, seeds, release, start, 1)
    velocity = None
    for moved, _ in particles.through(intervals(start, stop)):
        velocity = moved
        for _ in particles.tracer.run():
            pass
    assert velocity is not None
    tracer = particles.tracer
    there = np.flatnonzero(tracer.end == End.DURATION)
    # a particle that is released at the end has not moved, but is in the last interval
    tracer.state[there, -2] = 1.0
    own = tracer.patch[there], tracer.row[there], release[there], tracer.state[there]
    return Points(seeds[there], *own), velocity, tracer.end
