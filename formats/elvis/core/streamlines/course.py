"""The course of lines: seeds, velocity and limits of streamlines, independent of their later use."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.base.terminal import announce
from elvis.core.data.arguments import texts_of
from elvis.core.mapping.locate import Location, Locator
from elvis.core.quantities.expression import Expression
from elvis.core.streamlines.flow_data import FlowSource, flow_data
from elvis.core.streamlines.lines.steps import Limits
from elvis.core.streamlines.neighbours import Neighbours
from elvis.core.streamlines.seeds import seed_points
from elvis.core.streamlines.tracer import Tracer
from elvis.core.streamlines.velocity import Velocity

#: directions: signs of the velocity
DIRECTIONS: Mapping[str, tuple[int, ...]] = {"forward": (1,), "backward": (-1,), "both": (1, -1)}
#: defaults, relative to the diagonal: error of a step, length of lines, maximum distance of points
TOLERANCE, LENGTH, SPACING = 1e-12, 10.0, 0.005
#: number of lines above which it is announced
MANY_LINES = 2_000
#: speed below which a point is at rest, relative to the largest speed at the seeds and at the elements' centres
REST = 1e-10

#: makes a tracer, as `Tracer` does
MakeTracer: TypeAlias = Callable[[Velocity, Neighbours, Locator, Limits, int], Tracer]


@dataclass(frozen=True)
class Course:
    """The seeds of lines, the velocity that they follow, and the limits where they end.

    seeds      points (n, d), or texts as `seeds` describes them, such as ``line:0,0:0,1:20``
    velocity   its components; None for the usual names in the data: u, v, w or rhou/rho, …
    direction  forward, backward, or both
    length     maximum length of lines in the world; None: ten diagonals of the box, unless a duration is given
    duration   maximum time
    speed      lines end below this speed
    steps      maximum number, each within one element
    tolerance  error of a step in the world; None: 1e-12 of the diagonal of the box
    random     seed of the random number generator for random seeds
    wall       a boundary on which lines follow the shear, or the tangential part of ``velocity`` if given (`walls`)
    """

    seeds: Any
    velocity: tuple[str, ...] | None = None
    direction: str = "forward"
    length: float | None = None
    duration: float | None = None
    speed: float = 0.0
    steps: int = 10_000
    tolerance: float | None = None
    random: int = 0
    wall: str | None = None

    def check(self) -> None:
        """Raise ElvisError for an unknown direction, and for limits that are not positive."""
        if self.direction not in DIRECTIONS:
            raise ElvisError(f"expected a direction, one of {', '.join(DIRECTIONS)}, found {self.direction!r}")
        if not self.speed >= 0:
            raise ElvisError(f"speed: expected a number that is not negative, found {self.speed}")
        if self.steps < 1:
            raise ElvisError(f"steps: expected at least 1, found {self.steps}")
        for name in ("length", "duration", "tolerance"):
            positive(name, getattr(self, name))


def components_of(velocity: Sequence[str] | str | None) -> tuple[str, ...] | None:
    """The components of a velocity, given as texts, or as one with commas between them; None for the usual names."""
    texts = texts_of(velocity) if isinstance(velocity, str) else velocity
    return None if texts is None else tuple(texts)


def positive(name: str, value: float | None) -> None:
    """Raise ElvisError for a number that is given and not positive."""
    if value is not None and not value > 0:
        raise ElvisError(f"{name}: expected a positive number, found {value}")


@dataclass(frozen=True, eq=False)
class Flow:
    """A velocity in its elements, and where lines begin and end in it.

    location  of the seeds
    signs     of the velocity, one for each direction
    """

    velocity: Velocity
    neighbours: Neighbours
    locator: Locator
    location: Location
    limits: Limits
    signs: tuple[int, ...]

    @staticmethod
    def of(data: FlowSource, course: Course, others: Sequence[Expression] = ()) -> Flow:
        """A course in a dataset or other data.

        ``others`` are additional quantities that the velocity object can evaluate.

        Raises ElvisError for 1D data, unknown quantities, missing components, and limits that are not positive.
        """
        own = flow_data(data)
        course.check()
        if course.wall is None:
            velocity = own.velocity(own.components(course.velocity), others)
            neighbours = own.neighbours(velocity)
        else:
            velocity, neighbours = own.on_wall(course.wall, course.velocity, others)
        locator = own.locator(velocity)
        seeds = seed_points(own.seed_places(velocity, locator), course.seeds, course.random)
        if len(seeds) > MANY_LINES:
            announce(f"following {len(seeds):,} lines; Ctrl-C stops")
        location = locator.locate(seeds)
        limits = limits_of(diagonal(locator), course, REST * _fastest(velocity, location))
        return Flow(velocity, neighbours, locator, location, limits, DIRECTIONS[course.direction])

    @property
    def size(self) -> float:
        """Diagonal of the box of all elements."""
        return diagonal(self.locator)

    def tracers(self, make: MakeTracer = Tracer) -> Iterator[Tracer]:
        """Tracers for the lines, placed at the seeds, one for each direction.

        make  the constructor: `Tracer`, or an equivalent implementation
        """
        for sign in self.signs:
            tracer = make(self.velocity, self.neighbours, self.locator, self.limits, sign)
            tracer.place(self.location.patch, self.location.row, self.location.reference)
            yield tracer


def diagonal(locator: Locator) -> float:
    """Diagonal of the box of all elements."""
    box = np.asarray(locator.tree.nodes[0], np.float64)
    return float(np.linalg.norm(box[3:] - box[:3]))


def limits_of(size: float, course: Course, rest: float) -> Limits:
    """The limits, as given or as they follow from the size of the data; ``rest`` is a speed that counts as none."""
    length = course.length
    if length is None:
        length = LENGTH * size if course.duration is None else np.inf
    duration = np.inf if course.duration is None else course.duration
    tolerance = TOLERANCE * size if course.tolerance is None else course.tolerance
    return Limits(float(length), float(duration), course.speed, rest, course.steps, float(tolerance))


def _fastest(velocity: Velocity, location: Location) -> float:
    """The largest speed at the seeds and in the middles of elements."""
    inside = np.flatnonzero(location.patch >= 0)
    speeds = [velocity.motion(location.patch[inside], location.row[inside], location.reference[inside]).speed]
    for number, patch in enumerate(velocity.patches):
        middle = np.zeros(patch.dimension)
        middle[: patch.shape.dimension] = patch.shape.centre
        rows = np.arange(len(patch))
        speeds.append(velocity.motion(np.full(len(rows), number), rows, np.tile(middle, (len(rows), 1))).speed)
    every = np.concatenate(speeds)
    return float(every[np.isfinite(every)].max(initial=0.0))
