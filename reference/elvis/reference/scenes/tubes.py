"""Rays against tubes of streamlines: a dense search along each step of a line, and halving between signs.

A step's dense output goes through the element's own map at many Chebyshev points; nothing is known of the curve between
samples but what interpolation through these says, and no bound takes part.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev

from elvis.core.arrays import Floats, Ints
from elvis.core.dataset import Dataset
from elvis.core.streamlines.course import Flow
from elvis.core.streamlines.first_roots import bernstein_at
from elvis.core.streamlines.flow_data import FlowSource
from elvis.core.streamlines.line_pieces import Pieces, bernstein_of
from elvis.core.streamlines.pathlines import path_steps
from elvis.core.streamlines.tracer import Piece
from elvis.core.streamlines.velocity import Velocity
from elvis.reference.quantities import Quantities
from elvis.reference.scenes.crossings import Crossings
from elvis.reference.scenes.unions import INTERVAL, union
from elvis.scene import Streamlines
from elvis.scene.flow import RADIUS, course_of, curves_in
from elvis.scene.time_limit import check_time
from elvis.scene.view import View

#: points through which a step is interpolated, samples of it, halvings between samples, rays looked at together
_NODES, _SAMPLES, _HALVINGS, _AT_ONCE = 28, 65, 52, 1 << 13
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

    def points(self, u: Floats) -> Floats:
        """(n, 3) at parameters (n,)."""
        return np.asarray(chebyshev.chebval(u, self.series).T)

    def tangents(self, u: Floats) -> Floats:
        """(n, 3) derivatives there."""
        return np.asarray(chebyshev.chebval(u, chebyshev.chebder(self.series)).T)

    def reference(self, u: Floats) -> Floats:
        """(n, 3) places in the element."""
        t = 0.5 * (u + 1.0) * self.part
        found = np.zeros((len(u), 3))
        found[:, : self.net.shape[1]] = bernstein_at(np.broadcast_to(self.net, (len(u), *self.net.shape)), t)
        return found


@dataclass(frozen=True, eq=False)
class _Met:
    """Balls of a step that rays meet first or last: pixel (n,), place along the ray (n,), parameter (n,)."""

    pixel: Ints
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
    for step in steps:
        check_time()
        columns.append(_intervals(step, view, radius, growth))
    if not columns:
        return Crossings.none()
    return union(np.concatenate(columns), quantities)


def _followed(data: FlowSource, shown: Streamlines) -> tuple[float, Iterator[_Step]]:
    """The diagonal of the box, and all steps of all lines."""
    if shown.cores is not None:
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
    """Cores: what is followed is not integrated a second time."""
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


def _intervals(step: _Step, view: View, radius: float, growth: float) -> np.ndarray:
    """Rows of ``INTERVAL``: where rays enter and leave the balls of a step."""
    pixel = near_pixels(step.points(_U), view, radius, growth)
    found = [np.zeros(0, INTERVAL)]
    for start in range(0, len(pixel), _AT_ONCE):
        some = pixel[start : start + _AT_ONCE]
        enters = _met(step, view, some, radius, growth, 1.0)
        leaves = _met(step, view, some, radius, growth, -1.0)
        # of a ray that a step meets several times the first entrance goes with the first exit
        both = np.intersect1d(enters.pixel * _SAMPLES + enters.rank, leaves.pixel * _SAMPLES + leaves.rank, True, True)
        one, other = both[1], both[2]
        rows = np.zeros(len(one), INTERVAL)
        rows["pixel"], rows["element"] = enters.pixel[one], step.element
        rows["enters"], rows["leaves"] = enters.along[one], leaves.along[other]
        rows["first"], rows["last"] = step.reference(enters.u[one]), step.reference(leaves.u[other])
        # normals lead away from the middle of the ball
        origins, directions = view.rays(rows["pixel"] % view.width, rows["pixel"] // view.width)
        rows["entrance"] = origins + rows["enters"][:, None] * directions - step.points(enters.u[one])
        rows["exit"] = origins + rows["leaves"][:, None] * directions - step.points(leaves.u[other])
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


def _met(step: _Step, view: View, pixel: Ints, radius: float, growth: float, way: float) -> _Met:
    """The first (``way`` 1) or last (-1) places of rays in balls, wherever these change from nearer to farther.

    With s along the ray, a across it and w^2 = R^2 - |a|^2, that is where w s' + a a' - R R' comes from below zero.
    """
    origins, directions = view.rays(pixel % view.width, pixel // view.width)
    lengths = np.linalg.norm(directions, axis=1)
    unit = directions / lengths[:, None]
    forward = growth * view.camera.basis()[2]
    still = radius + (origins - np.asarray(view.camera.eye)) @ forward

    def seen(ray: Ints, points: Floats, tangents: Floats) -> tuple[Floats, Floats, Floats]:
        """What changes its sign, the square of w, and s, of points (…, 3) along rays."""
        own = unit[ray]
        away = points - origins[ray]
        along = np.einsum("...i,...i->...", away, own)
        across = away - along[..., None] * own
        thick = still[ray] + away @ forward
        room = thick**2 - np.einsum("...i,...i->...", across, across)
        rate = np.einsum("...i,...i->...", tangents, own)
        change = np.einsum("...i,...i->...", across, tangents) - thick * (tangents @ forward)
        return way * rate * np.sqrt(np.maximum(room, 0.0)) + change, room, along

    every = np.arange(len(pixel))[:, None]
    sign, room, _ = seen(np.repeat(every, _SAMPLES, axis=1), step.points(_U)[None], step.tangents(_U)[None])
    turns = (sign[:, :-1] < 0) & (sign[:, 1:] >= 0)
    ray, place = np.nonzero(turns)
    low, high = _U[place].copy(), _U[place + 1].copy()
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        below = seen(ray, step.points(middle), step.tangents(middle))[0] < 0
        low, high = np.where(below, middle, low), np.where(below, high, middle)

    # both ends of the step count, too, where nothing comes before or after
    starts, ends = np.flatnonzero(sign[:, 0] >= 0), np.flatnonzero(sign[:, -1] < 0)
    ray = np.concatenate([ray, starts, ends])
    u = np.concatenate([0.5 * (low + high), np.full(len(starts), -1.0), np.full(len(ends), 1.0)])
    _, room, along = seen(ray, step.points(u), step.tangents(u))
    hit = np.flatnonzero(room > 0)
    hit = hit[np.lexsort([u[hit], ray[hit]])]
    own = ray[hit]
    rank = np.arange(len(own)) - np.searchsorted(own, own)
    depth = (along[hit] - way * np.sqrt(room[hit])) / lengths[own]
    return _Met(pixel[own], depth, u[hit], rank)
