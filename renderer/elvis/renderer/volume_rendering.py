"""Volumes: the light that elements send out and take up along each ray (stages: shaders/volume_*.slang)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Floats, Ints
from elvis.renderer.device import STAND_IN
from elvis.renderer.errors import SceneError
from elvis.renderer.faces import FaceDrawer
from elvis.renderer.loaded import Loaded
from elvis.renderer.scene import Transfer
from elvis.renderer.tiles import TILE
from elvis.renderer.traversal import Traversal, binned, seen, stretched
from elvis.renderer.view import View

#: bytes of the lists that rays have at one time
MOST_BYTES = 192 << 20
#: rows of pixels whose hits of curved faces are looked for at one time
STRIP = 64
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
    lost       (n,)   places in curved elements, and ends of segments, that were not found
    """

    color: Floats
    alpha: Floats
    length: Floats
    error: Floats
    segments: Ints
    undefined: Ints
    lost: Ints


@dataclass(eq=False)
class _Seen:
    """What is seen of a part: tiles, and what the stage that lists their segments needs beside them.

    rows  (tiles,) of 64 entries, one a pixel, that each needs at most
    """

    number: int
    stage: str
    tiles: NDArray[Any]
    rows: Ints
    data: dict[str, NDArray[Any]]

    def within(self, places: Ints, tiles: NDArray[Any]) -> _Seen:
        """What is seen in the given tiles at these places alone."""
        own = _place(self.tiles)
        at = np.minimum(np.searchsorted(places, own), len(places) - 1)
        held = places[at] == own
        kept = self.tiles[held]
        kept["base"], kept["number"] = tiles["base"][at[held]], tiles["number"][at[held]]
        return _Seen(self.number, self.stage, kept, self.rows[held], self.data)


class VolumeRenderer:
    """A loaded volume, ready for any transfer function from any view.

    faces  gives the faces of its elements, for those that are curved
    """

    def __init__(self, loaded: Loaded, faces: Callable[[], FaceDrawer] | None = None) -> None:
        self.loaded, self.faces, self.traversal = loaded, faces, Traversal(loaded)

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

        Raises SceneError for 2D data, for curved elements without faces, and where densities times lengths overflow.
        """
        self._check(transfer)
        march = _March(self, view, transfer, quantity, error)
        march.limit("start", np.zeros(view.count) if start is None else start)
        march.limit("end", np.full(view.count, np.inf) if end is None else end)
        step = STRIP if march.curved else view.height
        for row in range(0, view.height, step):
            march.strip((row, min(row + step, view.height)))
        names = ("color", "alpha", "length", "error", "segments", "undefined")
        return Gathered(**{name: np.array(march.lights[name]) for name in names}, lost=march.lost)

    def _check(self, transfer: Transfer) -> None:
        if self.loaded.dimension != 3:
            raise SceneError("volumes are drawn of 3D data")
        if len(transfer.colors) != len(transfer.values):
            raise SceneError(f"colors of a volume: expected one for each of {len(transfer.values)} values")
        densest, reach = max(transfer.densities), self.loaded.reach
        if densest * 4 > np.finfo(float).max / max(reach, 1.0):
            raise SceneError(f"densities of a volume: {densest:g} overflows over lengths of {reach:g}")


class _March:
    """One picture of a volume, in the making.

    curved  numbers of the parts in which rays are not lines, or the quantity not a polynomial along them
    """

    def __init__(
        self, renderer: VolumeRenderer, view: View, transfer: Transfer, quantity: str | None, error: float
    ) -> None:
        self.loaded, self.traversal, self.faces = renderer.loaded, renderer.traversal, renderer.faces
        self.device, self.view, self.quantity = self.loaded.device, view, quantity
        parts = range(len(self.loaded.parts))
        self.curved = [n for n in parts if not self.traversal.is_straight(n, quantity)]
        self.degree = max(self.traversal.degree(n, quantity) or STAND_IN for n in parts)
        self.march = self.device.kernel("volume_march", self.loaded.parts[0], quantity, line_degree=self.degree)
        self.lights = np.zeros(view.count, self.march.dtype("lights"))
        self.lost = np.zeros(view.count, np.int64)
        look = np.zeros(1, self.march.dtype("look"))
        look["error"], look["breakpoints"] = error, len(transfer.values)
        self.tolerance = _tolerance(transfer, error, 4 * self.loaded.reach)
        self.fixed = {**self.traversal.lines(self.degree), "look": self.device.buffer(look)}
        for name in ("values", "densities", "colors"):
            self.limit(name, getattr(transfer, name))

    def limit(self, name: str, data: Any) -> None:
        """Numbers that all stages share."""
        self.fixed[name] = self.device.buffer(np.asarray(data, np.float64))

    def strip(self, rows: tuple[int, int]) -> None:
        """The pixels of some rows, the first and the one after the last, both whole tiles."""
        every = [self._straight(n, rows) for n in range(len(self.loaded.parts)) if n not in self.curved]
        every += self._stretches(rows) if self.curved else []
        if sum(len(some.tiles) for some in every):
            for tiles, parts in self._bands(every):
                self._band(tiles, parts)

    def _straight(self, number: int, rows: tuple[int, int]) -> _Seen:
        """A part of straight tetrahedra."""
        kernel = self.device.kernel("volume_list", self.loaded.parts[number], self.quantity, line_degree=self.degree)
        corners = self.traversal.corners(number)
        sections = seen(self.view, corners, np.ones(len(corners), bool))
        tiles, order = binned(sections, kernel.dtype("tiles"))
        tiles = tiles[(tiles["y"] >= rows[0]) & (tiles["y"] < rows[1])]
        counts = (tiles["end"] - tiles["first"]).astype(np.int64)
        return _Seen(number, "volume_list", tiles, counts, {"order": sections["element"][order]})

    def _stretches(self, rows: tuple[int, int]) -> list[_Seen]:
        """Parts of curved elements: where rays enter and leave them; segments are counted before they are kept."""
        if self.faces is None:
            raise SceneError("volumes of curved elements need their faces, which the data's plugin does not give")
        faces = self.faces()
        solids = sorted({block.solid for block in faces.faces.blocks if block.part in self.curved})
        hits = faces.hits(self.view, [f"shape:{solid}" for solid in solids], rows)
        found = []
        for number in self.curved:
            first, last = self.loaded.first[number : number + 2]
            own = hits[(hits["element"] >= first) & (hits["element"] < last)]
            kernel = self.device.kernel(
                "volume_trace", self.loaded.parts[number], self.quantity, line_degree=self.degree
            )
            stretches, pixel, lost = stretched(own, kernel.dtype("stretches"), int(first))
            np.add.at(self.lost, lost, 1)
            tiles, starts, order = _lists(pixel, self.view, kernel.dtype("tiles"))
            wanted = np.zeros(1, kernel.dtype("wanted"))
            wanted["tolerance"] = self.tolerance
            data = {"stretches": stretches[order], "starts": starts, "wanted": wanted}
            some = _Seen(number, "volume_trace", tiles, np.ones(len(tiles), np.int64), data)
            counts = self._list(some, tiles, len(tiles))["counts"]
            some.rows = (
                self.device.read(counts, np.uint32)[: LANES * len(tiles)].reshape(-1, LANES).max(axis=1).astype(int)
            )
            wanted["writes"] = 1
            found.append(some)
        return found

    def _bands(self, every: list[_Seen]) -> Iterator[tuple[NDArray[Any], list[_Seen]]]:
        """Groups of tiles whose lists have room together, and what is seen there."""
        places = np.unique(np.concatenate([_place(some.tiles) for some in every]))
        rows = np.zeros(len(places), np.int64)
        for some in every:
            rows[np.searchsorted(places, _place(some.tiles))] += some.rows
        size = self.march.dtype("segments").itemsize + 8 * (self.degree + 1) + 12
        band = np.cumsum(rows) // max(MOST_BYTES // (size * LANES), 1)
        for own in np.split(np.arange(len(places)), np.flatnonzero(np.diff(band)) + 1):
            tiles = np.zeros(len(own), self.march.dtype("tiles"))
            tiles["x"], tiles["y"], tiles["number"] = places[own] & 0xFFFFF, places[own] >> 20, np.arange(len(own))
            tiles["base"], tiles["end"] = np.cumsum(rows[own]) - rows[own], rows[own]
            yield tiles, [some.within(places[own], tiles) for some in every]

    def _band(self, tiles: NDArray[Any], parts: list[_Seen]) -> None:
        """List the segments of the rays of some tiles, then march along them."""
        lists: dict[str, Any] = {}
        for some in parts:
            lists = self._list(some, tiles, int(tiles["end"].sum()), lists)
        lists["rays"] = self.traversal.rays(self.march, self.view, 0, len(tiles))
        lists["tiles"] = self.device.buffer(tiles)
        lists["lights"] = self.device.empty(self.march.dtype("lights"), LANES * len(tiles))
        self.march(len(tiles), {**self.loaded.bound(0, self.quantity), **lists}, groups=True)

        # tiles reach beyond the picture's edge
        x, y = (tiles[name].astype(np.int64)[:, None] for name in ("x", "y"))
        x, y = x + np.arange(LANES) % TILE, y + np.arange(LANES) // TILE
        held = (x < self.view.width) & (y < self.view.height)
        pixel = (y * self.view.width + x)[held]
        found = self.device.read(lists["lights"], self.lights.dtype).reshape(len(tiles), LANES)
        self.lights[pixel] = found[held]
        self.lost[pixel] += self.device.read(lists["lost"], np.uint32).reshape(len(tiles), LANES)[held]

    def _list(self, some: _Seen, tiles: NDArray[Any], rows: int, lists: dict[str, Any] | None = None) -> dict[str, Any]:
        """The lists of some tiles, with the segments of a part added to them."""
        lists, room = dict(lists or {}), LANES * rows
        if not lists:
            zeros = np.zeros(LANES * len(tiles), np.uint32)
            lists = {"counts": self.device.buffer(zeros), "lost": self.device.buffer(zeros), **self.fixed}
            lists["segments"] = self.device.empty(self.march.dtype("segments"), room)
            lists["fields"] = self.device.empty(np.float64, room * (self.degree + 1))
            lists["ranks"], lists["depths"] = self.device.empty(np.uint32, room), self.device.empty(np.float64, room)
        if len(some.tiles):
            part = self.loaded.parts[some.number]
            kernel = self.device.kernel(some.stage, part, self.quantity, line_degree=self.degree)
            data = {name: self.device.buffer(array) for name, array in {**some.data, "tiles": some.tiles}.items()}
            rays = self.traversal.rays(kernel, self.view, some.number, len(some.tiles))
            buffers = {**self.loaded.bound(some.number, self.quantity), **lists, **data, "rays": rays}
            kernel(len(some.tiles), buffers, groups=True)
        return lists


def _place(tiles: NDArray[Any]) -> Ints:
    """(n,) a number for each tile's place, by rows."""
    return np.asarray(tiles["y"].astype(np.int64) << 20 | tiles["x"])


def _lists(pixel: Ints, view: View, dtype: np.dtype[Any]) -> tuple[NDArray[Any], NDArray[np.uint32], Ints]:
    """Tiles that hold the pixels (n,), where the list of each of their pixels starts, and the order of all lists."""
    y, x = np.divmod(pixel, view.width)
    place = (y // TILE * TILE) << 20 | (x // TILE * TILE)
    lane = y % TILE * TILE + x % TILE
    places, tile = np.unique(place, return_inverse=True)
    key = tile * LANES + lane
    order = np.argsort(key, kind="stable")
    starts = np.searchsorted(key[order], np.arange(LANES * len(places) + 1)).astype(np.uint32)
    tiles = np.zeros(len(places), dtype)
    tiles["x"], tiles["y"] = places & 0xFFFFF, places >> 20
    tiles["first"] = tiles["number"] = np.arange(len(places))
    return tiles, starts, order


def _tolerance(transfer: Transfer, error: float, length: float) -> float:
    """Error of the quantity that changes colours by less than a quarter of ``error`` along rays of some length."""
    values, densities, colors = (
        np.asarray(x, np.float64) for x in (transfer.values, transfer.densities, transfer.colors)
    )
    if len(values) < 2:
        return float("inf")
    steps = np.diff(values)
    steepest = np.abs(np.diff(densities) / steps).max()
    steepest += densities.max() * np.abs(np.diff(colors, axis=0) / steps[:, None]).max()
    return float(0.25 * error / max(steepest * length, 1e-300))
