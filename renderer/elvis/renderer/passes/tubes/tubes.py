"""Tubes about curves: pieces of curves are drawn into the tiles of the picture that their tubes reach into."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np

from elvis.core.arrays import Floats, Ints
from elvis.core.streamlines.line_pieces import Pieces, bernstein_of, halved
from elvis.renderer.ball_bounds import bounds_of_balls, is_in_picture, pixels_within
from elvis.renderer.camera import record_of
from elvis.renderer.device_volume import DeviceVolume
from elvis.renderer.hit_buffer import HitBuffer, arrays_to_write, new_arrays
from elvis.renderer.memory import Buffer
from elvis.renderer.passes.solids.solids import values_at_hits
from elvis.renderer.tiles import bin_sections
from elvis.scene.conditioning import misplaced
from elvis.scene.view import View

#: pixels of a piece's longer side above which it is halved, beyond four radii; how often at most, and next to the eye
_LARGE, _HALVINGS, _HALVINGS_HERE = 40.0, 12, 4
#: what of the hit buffer the device holds
_HELD = ("owner", "status", "reference", "depth", "normal", "uncertainty", "doubt")


@dataclass(frozen=True)
class Girth:
    """How thick tubes are: a radius in the world, or a width in pixels at any depth."""

    radius: float | None
    width: float | None

    def in_view(self, view: View) -> tuple[float, float]:
        """The radius at the plane of the eye, and what it grows by with depth."""
        if self.width is None:
            assert self.radius is not None
            return self.radius, 0.0
        half = 0.5 * self.width * float(np.linalg.norm(view.column))
        return (0.0, half) if view.perspective else (half, 0.0)


@dataclass(frozen=True, eq=False)
class _InView:
    """Pieces that a view sees.

    number       (n,)          which pieces they are a part of
    points       (n, 8, 3)     coefficients of powers in the world
    place        (n, 2)        the middle and half the width of their parameters in the piece's
    near         (n,)          no point of the tube has a smaller depth
    least, most  (n, 4)        bounds of x, y, x + y and x - y of their pixels
    """

    number: Ints
    points: Floats
    place: Floats
    near: Floats
    least: Ints
    most: Ints


@dataclass(frozen=True, eq=False)
class _Prepared:
    """What a view sees of curves on the device, and how much each tile has to do."""

    view: View
    girth: Girth
    buffers: dict[str, Buffer]
    work: Ints


class TubeDrawer:
    """Tubes in a loaded volume; what the last view saw of each of the last curves is kept."""

    def __init__(self, loaded: DeviceVolume) -> None:
        self.loaded = loaded
        self._known: WeakKeyDictionary[Pieces, _Prepared] = WeakKeyDictionary()

    def draw(
        self, view: View, pieces: Pieces, girth: Girth, beyond: Floats | None = None, quantity: str | None = None
    ) -> HitBuffer:
        """Where rays first enter or leave tubes, behind the depths ``beyond`` (n,) where given.

        A hit's element, reference coordinates and value are those of the curve's point whose ball is met.
        """
        device = self.loaded.device
        kernel = device.kernel("tube_draw")
        own = self._known.get(pieces)
        if own is None or (own.view, own.girth) != (view, girth):
            # what was there is given back before more is taken
            self._known.pop(pieces, None)
            self._known[pieces] = own = self._prepared(view, pieces, girth)
        radius, growth = girth.in_view(view)
        greatest = max(self.loaded.extent, float(np.abs(view.camera.eye).max()))
        facts = {"radius": radius, "growth": growth, "misplaced": misplaced(view, self.loaded.extent)}
        facts |= {"tie": 1e-12 * greatest, "count": len(own.work), "has_beyond": beyond is not None}
        after = np.zeros(1) if beyond is None else np.ascontiguousarray(beyond, np.float64)
        held = new_arrays(device, view.count, _HELD)
        record = device.buffer(record_of(kernel, "view", view, **facts))
        output = {**arrays_to_write(device, held), "after": device.buffer(after), "view": record}
        kernel(len(own.work), {**own.buffers, **output}, groups=True, work=own.work)
        hits = HitBuffer.on_device(device, held, field=np.empty(0))
        return hits.showing(values_at_hits(self.loaded, hits, quantity))

    def _prepared(self, view: View, pieces: Pieces, girth: Girth) -> _Prepared:
        """The kernel's records of what a view sees."""
        device = self.loaded.device
        kernel = device.kernel("tube_draw")
        owner, known = self.loaded.owners_of(pieces.element)
        seen = _in_view(view, pieces, girth, np.flatnonzero(known))
        reference = _part_of(pieces.reference[seen.number], seen.place)
        curves = np.zeros(len(seen.number), kernel.dtype("curves"))
        curves["points"] = seen.points.reshape(len(curves), -1)
        curves["reference"] = reference.reshape(len(curves), -1)
        power = np.arange(seen.points.shape[1])
        curves["turn"] = np.linalg.norm(seen.points, axis=2) @ (power * (power - 1.0))
        curves["near"] = seen.near
        curves["deviation"] = pieces.deviation[seen.number]
        curves["owner"] = owner[seen.number]
        tiles, listed = bin_sections(seen.least, seen.most, kernel.dtype("tiles"), (view.width, view.height))
        work = (tiles["end"] - tiles["first"]).astype(np.int64)
        data = {"curves": curves, "listed": listed, "tiles": tiles}
        return _Prepared(view, girth, {name: device.buffer(array) for name, array in data.items()}, work)


def _part_of(points: Floats, place: Floats) -> Floats:
    """(n, k, 3) coefficients of parts of polynomials (n, k, 3): u is m + h v with m, h in ``place`` (n, 2)."""
    middle, half = place.T[:, :, None]
    found = np.zeros_like(points)
    for k in range(points.shape[1] - 1, -1, -1):
        shifted = middle[:, None] * found
        shifted[:, 1:] += half[:, None] * found[:, :-1]
        shifted[:, 0] += points[:, k]
        found = shifted
    return found


def _in_view(view: View, pieces: Pieces, girth: Girth, chosen: Ints) -> _InView:
    """What a view sees of some pieces, halved while they are large in the picture, nearest first."""
    number, points = chosen, pieces.points[chosen]
    place = np.tile([0.0, 1.0], (len(chosen), 1))
    found: list[_InView] = []
    for halving in range(_HALVINGS + 1):
        near, low, high, thick = _bounds(view, points, girth)
        seen = is_in_picture(view, low, high)
        large = (high - low)[:, :2].max(axis=1) > _LARGE + 2.0 * thick
        large &= halving < np.where(near > 0.0, _HALVINGS, _HALVINGS_HERE)
        done = np.flatnonzero(seen & ~large)
        found.append(
            _InView(number[done], points[done], place[done], near[done], *pixels_within(view, low[done], high[done]))
        )
        left = np.flatnonzero(seen & large)
        if not len(left):
            break
        number, points = np.tile(number[left], 2), halved(points[left])
        half = 0.5 * place[left, 1]
        middles = np.concatenate([place[left, 0] - half, place[left, 0] + half])
        place = np.stack([middles, np.tile(half, 2)], axis=1)
    joined = [np.concatenate(column) for column in zip(*(vars(own).values() for own in found), strict=True)]
    order = np.argsort(joined[3], kind="stable")
    return _InView(*(column[order] for column in joined))


def _bounds(view: View, points: Floats, girth: Girth) -> tuple[Floats, Floats, Floats, Floats]:
    """Where tubes about curves (n, 8, 3) may be seen, as `bounds_of_balls`: those of their control points hold them."""
    control = bernstein_of(points)
    radius, growth = girth.in_view(view)
    return bounds_of_balls(view, control, radius + growth * np.abs(view.depth_of(control)))
