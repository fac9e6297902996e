"""Volumes: the light that elements send out and take up along each ray (stages: shaders/volume_*.slang)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Floats, Ints
from elvis.renderer.device import STAND_IN, Kernel
from elvis.renderer.errors import SceneError
from elvis.renderer.loaded import Loaded
from elvis.renderer.scene import Transfer
from elvis.renderer.tiles import TILE
from elvis.renderer.traversal import Traversal, binned, seen
from elvis.renderer.view import View

if TYPE_CHECKING:
    import slangpy

#: bytes of the lists that rays have at one time
MOST_BYTES = 192 << 20
LANES = TILE * TILE


@dataclass(frozen=True, eq=False)
class Gathered:
    """What n rays gather in a volume.

    color      (n, 3) times alpha
    alpha      (n,)   part in [0, 1] of what lies behind that is hidden
    length     (n,)   of the segments in elements, in units of length
    error      (n,)   estimated error of the colour
    segments   (n,)   their number
    undefined  (n,)   segments left out because their field is not a number
    """

    color: Floats
    alpha: Floats
    length: Floats
    error: Floats
    segments: Ints
    undefined: Ints


@dataclass(frozen=True, eq=False)
class _Seen:
    """What is seen of a part: bins of tiles, and elements one bin after another."""

    number: int
    bins: NDArray[Any]
    order: NDArray[np.uint32]
    tile: Ints


class VolumeRenderer:
    """A loaded volume, ready for any transfer function from any view."""

    def __init__(self, loaded: Loaded) -> None:
        self.loaded, self.device, self.traversal = loaded, loaded.device, Traversal(loaded)

    def draw(
        self,
        view: View,
        transfer: Transfer,
        quantity: str | None = None,
        error: float = 1e-3,
        start: Floats | None = None,
        end: Floats | None = None,
    ) -> Gathered:
        """The light that reaches the eye from between the depths ``start`` and ``end`` (n,) of each pixel.

        transfer  with its colours
        quantity  one of the parts' quantities; None is their own field
        error     greatest estimated error of a pixel's colour

        Raises SceneError for 2D data, and where densities are so large that lengths times them overflow.
        """
        self._check(transfer)
        degree = max(self.traversal.degree(number, quantity) or STAND_IN for number in range(len(self.loaded.parts)))
        march = self.device.kernel("volume_march", self.loaded.parts[0], quantity, line_degree=degree)
        limits = {
            "start": self.device.buffer(np.zeros(view.count) if start is None else start),
            "end": self.device.buffer(np.full(view.count, np.inf) if end is None else end),
        }
        look = np.zeros(1, march.dtype("look"))
        look["error"], look["breakpoints"] = error, len(transfer.values)
        limits |= {
            "look": self.device.buffer(look),
            "values": self.device.buffer(np.asarray(transfer.values, np.float64)),
            "densities": self.device.buffer(np.asarray(transfer.densities, np.float64)),
            "colors": self.device.buffer(np.asarray(transfer.colors, np.float64)),
        }
        lights = np.zeros(view.count, march.dtype("lights"))
        for tiles, parts in self._bands(view, quantity, march.dtype("segments").itemsize + 8 * (degree + 1)):
            self._band(view, quantity, degree, march, tiles, parts, limits, lights)
        names = ("color", "alpha", "length", "error", "segments", "undefined")
        return Gathered(*(np.array(lights[name]) for name in names))

    def _check(self, transfer: Transfer) -> None:
        if self.loaded.dimension != 3:
            raise SceneError("volumes are drawn of 3D data")
        if len(transfer.colors) != len(transfer.values):
            raise SceneError(
                f"a volume needs a colour for each of {len(transfer.values)} values of its transfer function"
            )
        densest, reach = max(transfer.densities), self.loaded.reach
        if densest * 4 > np.finfo(float).max / max(reach, 1.0):
            raise SceneError(f"densities of a volume: {densest:g} overflows over lengths of {reach:g}")

    def _bands(self, view: View, quantity: str | None, size: int) -> Iterator[tuple[NDArray[Any], list[_Seen]]]:
        """Groups of tiles whose lists have room together: base of each tile's lists by its place, and what is seen."""
        every = []
        for number in range(len(self.loaded.parts)):
            if not self.traversal.is_straight(number, quantity):
                raise SceneError("volumes of curved elements can't be drawn")
            list_kernel = self.device.kernel("volume_list", self.loaded.parts[number], quantity)
            extents = self.traversal.extents(number, quantity)
            sections = seen(view, extents.corners, np.ones(len(extents.low), bool))
            bins, order = binned(sections, list_kernel.dtype("tiles"))
            every.append(_Seen(number, bins, sections["element"][order], _place(bins)))

        # rows of 64 entries that each tile needs
        places = np.unique(np.concatenate([some.tile for some in every]))
        rows = np.zeros(len(places), np.int64)
        for some in every:
            rows[np.searchsorted(places, some.tile)] += some.bins["end"] - some.bins["first"]
        band = np.cumsum(rows) // max(MOST_BYTES // ((size + 12) * LANES), 1)
        for own in np.split(np.arange(len(places)), np.flatnonzero(np.diff(band)) + 1):
            tiles = np.zeros(len(own), every[0].bins.dtype)
            tiles["x"], tiles["y"], tiles["number"] = places[own] & 0xFFFFF, places[own] >> 20, np.arange(len(own))
            tiles["base"], tiles["end"] = np.cumsum(rows[own]) - rows[own], rows[own]
            yield tiles, [_within(some, places[own], tiles) for some in every]

    def _band(
        self,
        view: View,
        quantity: str | None,
        degree: int,
        march: Kernel,
        tiles: NDArray[Any],
        parts: list[_Seen],
        limits: dict[str, slangpy.Buffer],
        lights: NDArray[Any],
    ) -> None:
        """List and march the rays of some tiles."""
        room = LANES * int(tiles["end"].sum())
        lists = {
            "segments": self.device.empty(march.dtype("segments"), room),
            "fields": self.device.empty(np.float64, room * (degree + 1)),
            "ranks": self.device.empty(np.uint32, room),
            "depths": self.device.empty(np.float64, room),
            "counts": self.device.buffer(np.zeros(LANES * len(tiles), np.uint32)),
            **limits,
        }
        for some in parts:
            kernel = self.device.kernel("volume_list", self.loaded.parts[some.number], quantity, line_degree=degree)
            buffers = {**self.loaded.bound(some.number, quantity), **lists, **self.traversal.lines(degree)}
            buffers["rays"] = self.traversal.rays(kernel, view, some.number, len(some.bins))
            buffers["tiles"], buffers["order"] = self.device.buffer(some.bins), self.device.buffer(some.order)
            kernel(len(some.bins), buffers, groups=True)
        lists["rays"], lists["tiles"] = self.traversal.rays(march, view, 0, len(tiles)), self.device.buffer(tiles)
        lists["lights"] = self.device.empty(march.dtype("lights"), LANES * len(tiles))
        march(len(tiles), {**self.loaded.bound(0, quantity), **lists}, groups=True)
        found = self.device.read(lists["lights"], lights.dtype).reshape(len(tiles), TILE, TILE)

        # tiles reach beyond the picture's edge
        x, y = (tiles[name].astype(np.int64)[:, None, None] for name in ("x", "y"))
        x, y = np.broadcast_arrays(x + np.arange(TILE), y + np.arange(TILE)[:, None])
        held = (x < view.width) & (y < view.height)
        lights[(y * view.width + x)[held]] = found[held]


def _place(bins: NDArray[Any]) -> Ints:
    """(n,) a number for each tile's place, by rows."""
    return np.asarray(bins["y"].astype(np.int64) << 20 | bins["x"])


def _within(some: _Seen, places: Ints, tiles: NDArray[Any]) -> _Seen:
    """What is seen in the tiles at these places alone."""
    at = np.searchsorted(places, some.tile)
    held = places[np.minimum(at, len(places) - 1)] == some.tile
    bins = some.bins[held]
    bins["base"], bins["number"] = tiles["base"][at[held]], tiles["number"][at[held]]
    return _Seen(some.number, bins, some.order, some.tile[held])
