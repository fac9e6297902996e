"""Rays against tubes of streamlines: a dense search along each step of a line, and halving between signs.

A step's dense output goes through the element's own map at many Chebyshev points; nothing is known of the curve between
samples but what interpolation through these says, and no bound takes part.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.polynomial import chebyshev

from elvis.core.base.arrays import Floats, Ints
from elvis.core.data.dataset import Dataset
from elvis.core.streamlines.course import Flow
from elvis.core.streamlines.first_roots import bernstein_at
from elvis.core.streamlines.flow_data import FlowSource
from elvis.core.streamlines.lines.pieces import Pieces, bernstein_of
from elvis.core.streamlines.lines.steps import Piece
from elvis.core.streamlines.pathlines import path_steps
from elvis.core.streamlines.velocity import Velocity
from elvis.reference.quantities import Quantities
from elvis.reference.scenes.crossings import Crossings
from elvis.reference.scenes.unions import INTERVAL, union
from elvis.scene import Streamlines
from elvis.scene.cameras.view import View
from elvis.scene.flow.flow import RADIUS, course_of, curves_in
from elvis.scene.model.time_limit import check_time

#: points through which a step is interpolated, samples of it, halvings between samples
_NODES, _SAMPLES, _HALVINGS = 28, 65, 52
#: steps, and rays near them, that are treated together
_STEPS, _AT_ONCE = 256, 1 << 13
_POINTS = chebyshev.chebpts1(_NODES)
_TO_SERIES = np.linalg.inv(chebyshev.chebvander(_POINTS, _NODES - 1))
_U = np.linspace(-1.0, 1.0, _SAMPLES)


@dataclass(frozen=True, eq=False)
class _Step:
    """A step of a line: its Chebyshev series (28, 3) in the world, Bernstein coefficients (8, D) in its element."""

    series: Floats
    net: Floats
    part: float
    element: int


@dataclass(frozen=True, eq=False)
class _Steps:
    """Steps of lines, together.

    series   (28, n, 6)  Chebyshev coefficients of places in the world, and of their derivatives
    nets     (n, 8, 3)   Bernstein coefficients of places in elements, 0 beyond the dimension of these
    part     (n,)
    element  (n,)        ids
    """

    series: Floats
    nets: Floats
    part: Floats
    element: Ints

    @staticmethod
    def of(steps: Sequence[_Step]) -> _Steps:
        """Steps, at least one."""
        count = len(steps)
        series, nets = np.zeros((_NODES, count, 6)), np.zeros((count, 8, 3))
        for k, step in enumerate(steps):
            nets[k, :, : step.net.shape[1]] = step.net
            series[:, k, :3] = step.series
        series[:-1, :, 3:] = chebyshev.chebder(series[:, :, :3])
        part, element = np.array([step.part for step in steps]), np.array([step.element for step in steps])
        return _Steps(series, nets, part, element)

    def samples(self) -> tuple[Floats, Floats]:
        """(n, 65, 3) places and derivatives, evenly apart."""
        found = np.asarray(chebyshev.chebval(_U, self.series).transpose(0, 2, 1), np.float64)
        return found[..., :3], found[..., 3:]

    def at(self, u: Floats) -> tuple[Floats, Floats]:
        """(n, 3) places and derivatives, at one parameter (n,) of each."""
        found = np.asarray(chebyshev.chebval(u[:, None], self.series, tensor=False), np.float64)
        return found[:, :3], found[:, 3:]

    def reference(self, u: Floats) -> Floats:
        """(n, 3) places in elements, at one parameter (n,) of each."""
        return bernstein_at(self.nets, 0.5 * (u + 1.0) * self.part)

    def take(self, which: Ints) -> _Steps:
        """Some of them (n,), by number."""
        return _Steps(self.series[:, which], self.nets[which], self.part[which], self.element[which])


@dataclass(frozen=True, eq=False)
class _Met:
    """Balls of steps that rays meet first or last: number of the ray (n,), place along it (n,), parameter (n,)."""

    ray: Ints
    along: Floats
    u: Floats
    rank: Ints


def tube_crossings(quantities: Quantities, shown: Streamlines, view: View) -> Crossings:
    """All places at which rays enter or leave tubes of streamlines."""
    size, steps = _followed(quantities.flow, shown)
    if shown.width is None:
        radius, growth = shown.radius or RADIUS * size, 0.0
    else:
        half = 0.5 * shown.width * float(np.linalg.norm(view.column))
        radius, growth = (0.0, half) if view.perspective else (half, 0.0)
    columns = []
    while some := list(islice(steps, _STEPS)):
        check_time()
        columns.append(_intervals(_Steps.of(some), view, radius, growth))
    if not columns:
        return Crossings.none()
    return union(np.concatenate(columns), quantities)


def _followed(data: FlowSource, shown: Streamlines) -> tuple[float, Iterator[_Step]]:
    """The diagonal of the box, and all steps of all lines."""
    if not shown.seeds:
        found = curves_in(data, shown)
        return found.size, _of_curves(found.pieces)
    if shown.since is None:
        flow = Flow.of(data, course_of(shown))
        pieces = ((flow.velocity, piece) for tracer in flow.tracers() for piece in tracer.run())
        return flow.size, _steps(pieces)
    curves = curves_in(data, shown)
    assert isinstance(data, Dataset)
    if shown.releases is not None or shown.since == data.time:
        return curves.size, _rests(curves.pieces)
    assert data.rates is not None
    assert data.time is not None
    return curves.size, _steps(path_steps(data, data.rates.intervals, course_of(shown), shown.since, data.time))


def _of_curves(pieces: Pieces) -> Iterator[_Step]:
    """Steps of precomputed curves: cores and curves on walls, which are not computed again."""
    powers = np.vander(_POINTS, pieces.points.shape[1], increasing=True)
    series = np.einsum("kq,qp,npd->nkd", _TO_SERIES, powers, pieces.points)
    for own, net, element in zip(series, bernstein_of(pieces.reference), pieces.element, strict=True):
        yield _Step(own, net, 1.0, int(element))


def _rests(pieces: Pieces) -> Iterator[_Step]:
    """Particles that stay where they are."""
    for point, place, element in zip(pieces.points[:, 0], pieces.reference[:, 0], pieces.element, strict=True):
        series = np.zeros((_NODES, 3))
        series[0] = point
        yield _Step(series, np.tile(place, (8, 1)), 1.0, int(element))


def _steps(pieces: Iterator[tuple[Velocity, Piece]]) -> Iterator[_Step]:
    """All steps of all lines."""
    for velocity, piece in pieces:
        count = len(piece.line)
        t = 0.5 * (_POINTS + 1.0) * piece.part[:, None]
        states = bernstein_at(np.repeat(piece.nets[:, :, :-1], _NODES, axis=0), t.ravel())
        patch, row = np.repeat(piece.patch, _NODES), np.repeat(piece.row, _NODES)
        world = velocity.positions(patch, row, states).reshape(count, _NODES, 3)
        for k in range(count):
            own = velocity.patches[piece.patch[k]]
            net = piece.nets[k, :, : own.dimension]
            yield _Step(_TO_SERIES @ world[k], net, float(piece.part[k]), int(own.element_ids[piece.row[k]]))


def _intervals(steps: _Steps, view: View, radius: float, growth: float) -> np.ndarray:
    """Rows of ``INTERVAL``: where rays enter and leave the balls of steps."""
    places, tangents = steps.samples()
    near = [near_pixels(own, view, radius, growth) for own in places]
    every = np.repeat(np.arange(len(near)), [len(own) for own in near])
    pixels = np.concatenate(near)
    found = [np.zeros(0, INTERVAL)]
    for start in range(0, len(pixels), _AT_ONCE):
        pixel, step = pixels[start : start + _AT_ONCE], every[start : start + _AT_ONCE]
        rays = _Rays.of(view, pixel, radius, growth)
        samples = places[step], tangents[step]
        enters = _met(steps, step, rays, samples, 1.0)
        leaves = _met(steps, step, rays, samples, -1.0)
        # if a step meets a ray several times, the first entrance belongs to the first exit
        both = np.intersect1d(enters.ray * _SAMPLES + enters.rank, leaves.ray * _SAMPLES + leaves.rank, True, True)
        one, other = both[1], both[2]
        ray = enters.ray[one]
        own, first, last = steps.take(step[ray]), enters.u[one], leaves.u[other]
        rows = np.zeros(len(one), INTERVAL)
        rows["pixel"], rows["element"] = pixel[ray], own.element
        rows["enters"], rows["leaves"] = enters.along[one], leaves.along[other]
        rows["first"], rows["last"] = own.reference(first), own.reference(last)
        # normals lead away from the middle of the ball
        origins, directions = rays.origins[ray], rays.directions[ray]
        rows["entrance"] = origins + rows["enters"][:, None] * directions - own.at(first)[0]
        rows["exit"] = origins + rows["leaves"][:, None] * directions - own.at(last)[0]
        found.append(rows)
    return np.concatenate(found)


def near_pixels(points: Floats, view: View, radius: float, growth: float) -> Ints:
    """Pixels in the box around the balls about points (n, 3) of a step, whose radius grows with depth."""
    thick = radius + growth * np.abs(view.depth_of(points))
    placed = view.projected(points)
    depth = view.depth_of(points)
    if view.perspective and (depth <= 2.0 * thick).any():
        return np.arange(view.count)
    image = placed[:, :2] / placed[:, 2:]
    size = float(np.linalg.norm(view.column))
    around = 2.0 + 2.0 * (thick / size / (depth if view.perspective else 1.0)).max()
    low = np.maximum(np.floor(image.min(axis=0) - around), 0).astype(np.int64)
    high = np.minimum(np.ceil(image.max(axis=0) + around), [view.width - 1, view.height - 1]).astype(np.int64)
    columns, rows = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
    return np.asarray((rows * view.width + columns).ravel())


@dataclass(frozen=True, eq=False)
class _Rays:
    """Rays, and how thick tubes are that they meet.

    origins, directions  (n, 3)
    lengths              (n,) of the directions
    still                (n,) radius at the origins
    forward              (3,) by which it grows with places
    """

    origins: Floats
    directions: Floats
    lengths: Floats
    still: Floats
    forward: Floats

    @staticmethod
    def of(view: View, pixel: Ints, radius: float, growth: float) -> _Rays:
        """The rays of pixels (n,); radii grow with depth."""
        origins, directions = view.rays_of(pixel)
        forward = growth * view.camera.basis()[2]
        still = radius + (origins - np.asarray(view.camera.eye)) @ forward
        return _Rays(origins, directions, np.linalg.norm(directions, axis=1), still, forward)


def _met(steps: _Steps, step: Ints, rays: _Rays, samples: tuple[Floats, Floats], way: float) -> _Met:
    """The first (``way`` 1) or last (-1) places of rays in balls of steps (n,), one step per ray.

    The samples are given; places are sought where these change from nearer to farther.

    With s along the ray, a across it and w^2 = R^2 - |a|^2, these are the upward zero crossings of w s' + a a' - R R'.
    """
    unit = rays.directions / rays.lengths[:, None]

    def seen(ray: Ints, points: Floats, tangents: Floats) -> tuple[Floats, Floats, Floats]:
        """The function that changes its sign, the square of w, and s, of points (…, 3) along rays."""
        own = unit[ray]
        away = points - rays.origins[ray]
        along = np.einsum("...i,...i->...", away, own)
        across = away - along[..., None] * own
        thick = rays.still[ray] + away @ rays.forward
        room = thick**2 - np.einsum("...i,...i->...", across, across)
        rate = np.einsum("...i,...i->...", tangents, own)
        change = np.einsum("...i,...i->...", across, tangents) - thick * (tangents @ rays.forward)
        return way * rate * np.sqrt(np.maximum(room, 0.0)) + change, room, along

    sign, room, _ = seen(np.arange(len(step))[:, None], *samples)
    turns = (sign[:, :-1] < 0) & (sign[:, 1:] >= 0)
    ray, place = np.nonzero(turns)
    low, high = _U[place].copy(), _U[place + 1].copy()
    own = steps.take(step[ray])
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = seen(ray, *own.at(middle))[0] < 0
        low, high = np.where(below, middle, low), np.where(below, high, middle)

    # both ends of the step also count if nothing comes before or after
    starts, ends = np.flatnonzero(sign[:, 0] >= 0), np.flatnonzero(sign[:, -1] < 0)
    ray = np.concatenate([ray, starts, ends])
    u = np.concatenate([0.5 * (low + high), np.full(len(starts), -1.0), np.full(len(ends), 1.0)])
    _, room, along = seen(ray, *steps.take(step[ray]).at(u))
    hit = np.flatnonzero(room > 0)
    hit = hit[np.lexsort([u[hit], ray[hit]])]
    own_ray = ray[hit]
    rank = np.arange(len(own_ray)) - np.searchsorted(own_ray, own_ray)
    depth = (along[hit] - way * np.sqrt(room[hit])) / rays.lengths[own_ray]
    return _Met(own_ray, depth, u[hit], rank)
