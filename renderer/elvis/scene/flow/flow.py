"""Streamlines and cores of a scene in its data: found once for all pictures of it, whichever device draws them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.cores.curves import core_curves
from elvis.core.cores.finding import CoreLimits
from elvis.core.data.dataset import Dataset
from elvis.core.streamlines.course import Course, MakeTracer, components_of
from elvis.core.streamlines.flow_data import FlowSource
from elvis.core.streamlines.lines.pieces import Curves, curves
from elvis.core.streamlines.marks import marks
from elvis.core.streamlines.pathlines import path_curves, streak_curves
from elvis.core.streamlines.ribbons import Ribbons, check_space, ribbons
from elvis.core.streamlines.tracer import Tracer
from elvis.core.wall_curves.drawn_curves import drawn_curves
from elvis.scene.flow.frusta import Frusta
from elvis.scene.model.errors import SceneError
from elvis.scene.model.objects import Streamlines
from elvis.scene.model.surfaces import Vector
from elvis.scene.model.time_limit import check_time

K = TypeVar("K")
V = TypeVar("V")

#: default radius of tubes, relative to the diagonal of the box
RADIUS = 0.003
#: lengths of arrow heads: in radii, in widths of a ribbon, in diagonals for lines with a width in pixels; radius
#: relative to length
_HEAD_RADII, _HEAD_WIDTHS, _HEAD_DIAGONALS, _HEAD_WIDE = 8.0, 0.6, 0.02, 0.3
#: what lines are: of streamlines and cores, of particles since when, how many releases of them, along which wall
_Key: TypeAlias = tuple[Course, float | None, int | None, CoreLimits | None, str | None]
#: courses in the same data whose lines are retained
_MOST = 8
_KNOWN: WeakKeyDictionary[FlowSource, dict[_Key, Curves]] = WeakKeyDictionary()
_HEADS: WeakKeyDictionary[Curves, dict[tuple[float, str, float], Frusta]] = WeakKeyDictionary()
_STRIPS: WeakKeyDictionary[Curves, dict[Vector | None, Ribbons]] = WeakKeyDictionary()


def course_of(item: Streamlines) -> Course:
    """The course of the lines of an object."""
    return Course(
        item.seeds,
        components_of(item.velocity),
        item.direction,
        item.length,
        item.duration,
        item.speed,
        item.steps,
        item.tolerance,
        item.random,
        item.wall,
    )


def cores_of(item: Streamlines) -> CoreLimits | None:
    """Which cores of vortices an object shows; None where it shows lines from seeds."""
    if item.cores is None:
        return None
    return CoreLimits(item.cores, item.min_swirl, min_length=item.min_length)


def curves_in(data: FlowSource, item: Streamlines, make: MakeTracer = Tracer) -> Curves:
    """The lines of an object; SceneError for seeds and velocities that can't be, and where all seeds are outside.

    make  of what follows lines that aren't known yet
    """
    key = (course_of(item), item.since, item.releases, cores_of(item), item.along)
    known = _KNOWN.setdefault(data, {})
    if "-" in item.seeds:
        raise SceneError("seeds of streamlines: expected the name of a table, found -")
    if key not in known and len(known) >= _MOST:
        known.clear()
    found = _kept(known, key, lambda: _followed(data, *key, make))
    if not found.lines and item.seeds:
        raise SceneError("seeds of streamlines: all lie outside the mesh")
    return found


def _kept(known: dict[K, V], key: K, make: Callable[[], V]) -> V:
    """The cached value of a key, computed if absent; SceneError if computing it fails."""
    if key not in known:
        try:
            known[key] = make()
        except ElvisError as error:
            raise SceneError(f"streamlines: {error}") from error
    return known[key]


def _followed(
    data: FlowSource,
    course: Course,
    since: float | None,
    releases: int | None,
    cores: CoreLimits | None,
    along: str | None,
    make: MakeTracer,
) -> Curves:
    """Streamlines, or since a time paths or streaks of particles, or cores of vortices, or a wall, as curves."""
    if along is not None:
        if not isinstance(data, Dataset):
            raise ElvisError("along: expected native data, found data of a runtime plugin")
        return drawn_curves(data, along)
    if cores is not None:
        if not isinstance(data, Dataset):
            raise ElvisError("cores: expected native data, found data of a runtime plugin")
        return core_curves(data, course.velocity, cores, lambda *_: check_time())
    if since is None:
        return curves(data, course, make)
    if not isinstance(data, Dataset) or data.rates is None or data.time is None:
        raise ElvisError("since: expected a moment of a series, found one state")
    intervals, stop = data.rates.intervals, data.time
    if releases is None:
        return path_curves(data, intervals, course, since, stop)
    if since > stop:
        raise ElvisError(f"since: expected a time up to that of the picture, {stop:.10g}, found {since:.10g}")
    return streak_curves(data, intervals, course, since, stop, releases)


def ribbons_in(data: FlowSource, item: Streamlines, make: MakeTracer = Tracer) -> Ribbons:
    """The ribbons of an object; SceneError also if the velocity has no derivatives."""
    # before lines are followed, which may take long
    try:
        check_space(data)
    except ElvisError as error:
        raise SceneError(f"streamlines: {error}") from error
    found = curves_in(data, item, make)
    known = _STRIPS.setdefault(found, {})
    return _kept(known, item.across, lambda: ribbons(data, found.pieces, course_of(item).velocity, item.across))


def heads_in(data: FlowSource, item: Streamlines, make: MakeTracer = Tracer) -> Frusta:
    """Arrow heads along the lines of an object, cones about their marks; SceneError as the others."""
    found = curves_in(data, item, make)
    assert item.arrows is not None
    key = item.arrows, item.arrows_by, item.arrow_length or _head_length(item, found.size)
    known = _HEADS.setdefault(found, {})
    return _kept(known, key, lambda: _heads(data, item, found, *key))


def _head_length(item: Streamlines, size: float) -> float:
    """How long heads are where nothing says it."""
    if item.ribbon is not None:
        return _HEAD_WIDTHS * item.ribbon
    if item.width is not None:
        return _HEAD_DIAGONALS * size
    return _HEAD_RADII * (item.radius or RADIUS * size)


def _heads(data: FlowSource, item: Streamlines, found: Curves, spacing: float, by: str, length: float) -> Frusta:
    """Cones of a length, each with its middle at a mark."""
    course = course_of(item)
    own = marks(data, found.pieces, spacing, by, course.velocity, course.wall)
    count = len(own)
    radii = np.tile([_HEAD_WIDE * length, 0.0], (count, 1))
    base = own.points - 0.5 * length * own.direction
    lengths = np.full(count, length)
    places = own.reference, own.element, own.points
    return Frusta(base, own.direction, lengths, radii, *places, name="", magnitude=1.0, left={}, size=length)
