"""Volumes: the light that elements send out and take up along each ray (stages: volume_*.slang)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.arrays import Bools, Floats, Ints
from elvis.renderer.compositing import FragmentLists
from elvis.renderer.device import STAND_IN, Kernel
from elvis.renderer.device_volume import DeviceVolume
from elvis.renderer.memory import Buffer
from elvis.renderer.passes.faces.faces import FaceDrawer, pixel_bounds
from elvis.renderer.passes.volume.bends import Bends
from elvis.renderer.passes.volume.steepness import steepest, tolerance
from elvis.renderer.passes.volume.visibility import Visibility
from elvis.renderer.tiles import TILE, bin_sections, corners_of, empty_tiles, places_of
from elvis.renderer.traversal import APART, Traversal, visible_sections
from elvis.scene import Clip, Transfer
from elvis.scene.errors import SceneError
from elvis.scene.frame import Status
from elvis.scene.view import View

#: bytes of the lists that rays have at one time
MOST_BYTES = 192 << 20
LANES = TILE * TILE
#: error that must be proved for the diagonal of all elements, relative to the tolerance, which is a quarter of the
#: requested error
_PROVED = 1.0
#: likely number of segments of a ray in a curved element; longer lists are made once more
_SEGMENTS_OF_AN_ELEMENT = 6
#: part of the requested error that a part of a ray may have which holds a kink or a jump
_OF_A_KINK = 2.0**-10


@dataclass(frozen=True)
class Medium:
    """How a quantity is seen: a volume; or, with a gate, the region where nothing of any volume is seen.

    transfer  with its colours
    quantity  one of the parts' quantities; None is their own field
    gate      the sign of the quantity where it hides all volumes; 0 for a volume
    """

    transfer: Transfer
    quantity: str | None = None
    gate: int = 0

    @staticmethod
    def clip(quantity: str | None, away: str) -> Medium:
        """A medium that hides where a quantity is negative (the inside) or positive."""
        return Medium(Transfer((0.0,), (0.0,), ((0.0, 0.0, 0.0),)), quantity, -1 if away == "inside" else 1)

    def counts(self, low: Floats, high: Floats) -> Bools:
        """(n,) whether something is seen, or hidden, of elements whose quantity is between bounds (n,), NaN or not."""
        if self.gate:
            return np.asarray(low < 0.0 if self.gate < 0 else high > 0.0)
        values, densities = np.asarray(self.transfer.values), np.asarray(self.transfer.densities)
        found = np.isnan(low) | (np.interp(low, values, densities) > 0.0) | (np.interp(high, values, densities) > 0.0)
        for value in values[densities > 0.0]:
            found |= (low <= value) & (value <= high)
        return np.asarray(found)

    def hides(self, low: Floats, high: Floats) -> Bools:
        """(n,) whether nothing of any volume is seen in elements whose quantity is between bounds (n,)."""
        return np.asarray((high < 0.0) & (self.gate < 0) | (low > 0.0) & (self.gate > 0))


class RayIntegrals:
    """The integrals of n rays through volumes and the surfaces between.

    color      (n, 3) times alpha
    alpha      (n,)   share in [0, 1] of the background that is hidden
    coverage   (n,)   the same for the volumes only
    length     (n,)   of the segments in elements, as far as light comes from them, in units of length
    error      (n,)   of the colour: estimate of the quadrature, and effect of errors of quantities
    segments   (n,)   their number; without any, all other values are zero
    undefined  (n,)   segments skipped because their field is not a number
    lost       (n,)   positions in curved elements, and ends of segments, that were not found
    """

    def __init__(self, tally: NDArray[np.uint32], lost: Ints, integrals: Callable[[], NDArray[Any]]) -> None:
        """Integrals from the counts of volume_march.slang, and a function that reads them."""
        self.segments, self.undefined, self.lost = tally[:, 0], tally[:, 1] >> 2, lost
        self._covers, self._is_open, self._read = tally[:, 1] & 1, tally[:, 1] & 2, integrals

    @cached_property
    def _lights(self) -> NDArray[Any]:
        integrals = self._read().copy()
        integrals[self.segments == 0] = 0
        return integrals

    def __getattr__(self, name: str) -> Any:
        """Arrays that are read from the device when they are first used."""
        if name not in ("color", "alpha", "coverage", "length", "error"):
            raise AttributeError(name)
        return self._lights[name]

    def status(self) -> NDArray[np.uint8]:
        """Status (n,) of the volumes (see frame.Status).

        Failed if something was not found, ambiguous if elements without numbers are skipped, or if less is proved than
        the requested error.
        """
        known = np.where(self._covers, Status.CERTAIN, Status.MISS)
        known[self._is_open > 0] = Status.AMBIGUOUS
        known[self.undefined > 0] = Status.AMBIGUOUS
        known[self.lost > 0] = Status.FAILED
        return known.astype(np.uint8)

    def counts(self) -> Counter[str]:
        """Segments, those whose field is not a number, and places that were not found, on all rays together."""
        return Counter({name: int(getattr(self, name).sum()) for name in ("segments", "undefined", "lost")})


@dataclass(eq=False)
class _VisibleElements:
    """Visible elements of a part: tiles, and inputs of the stage that lists their segments.

    quantity_index  number of the quantity
    rows    (tiles,) maximum number of entries, one per pixel, that each needs, or a likely one if elements are curved
    proof   inputs of the quantity's bounds, on the device
    """

    number: int
    quantity_index: int
    kernel: Kernel
    tiles: NDArray[Any]
    rows: Ints
    data: dict[str, NDArray[Any]]
    proof: dict[str, Buffer] = field(default_factory=dict)

    @cached_property
    def places(self) -> Ints:
        """(tiles,) numbers of their places."""
        return places_of(self.tiles["x"], self.tiles["y"])


@dataclass(eq=False)
class _Band:
    """Tiles that are drawn together, and their lists, for the first of the quantities.

    places  (n,) numbers of the tiles' places
    lists   (n,) TileLists records (segment.slang)
    """

    places: Ints
    lists: NDArray[Any]

    def __len__(self) -> int:
        return len(self.places)

    @property
    def rows(self) -> int:
        """Rows of all lists of one quantity together."""
        return int(self.lists["room"].sum())

    def give(self, rooms: Ints) -> None:
        """Let the tiles' lists have room for these numbers of entries (n,)."""
        self.lists["room"] = rooms
        self.lists["base"] = np.cumsum(rooms) - rooms

    def of(self, some: _VisibleElements) -> tuple[Bools, NDArray[Any]]:
        """(m,) which of the tiles with something of a part are in the band, and the lists of these."""
        at = np.minimum(np.searchsorted(self.places, some.places), len(self) - 1)
        held = self.places[at] == some.places
        lists = self.lists[at[held]]
        lists["number"] += np.uint32(some.quantity_index * len(self))
        lists["base"] += np.uint32(some.quantity_index * self.rows)
        return held, lists


class _Media:
    """Data that depend on the media of a picture, but not on its view.

    quantities  of which segments are listed
    curved      for each of them the parts in which rays are not lines, or the quantity not a polynomial along them
    chosen      for each of them and each part the elements of which media show or hide something
    march       the kernel that marches along rays
    rooms       sizes of tiles' lists in the last picture, by the numbers of their positions
    buffers     the media and their transfer functions
    """

    def __init__(self, loaded: DeviceVolume, traversal: Traversal, media: Sequence[Medium]) -> None:
        self.media = media
        self._loaded = loaded
        self.quantities = list(dict.fromkeys(medium.quantity for medium in media))
        parts = range(len(loaded.parts))
        self.curved = [[n for n in parts if not traversal.is_straight(n, own)] for own in self.quantities]
        self.degree = max(traversal.degree(n, own) or STAND_IN for n in parts for own in self.quantities)
        self.chosen = [[self._counts(own, n) for n in parts] for own in self.quantities]
        self.march = loaded.device.kernel("volume_march", line_degree=self.degree, media=len(media))
        self.buffers = self._buffers()
        self.rooms: dict[int, int] = {}

    def _counts(self, quantity: str | None, number: int) -> Bools:
        """Elements (n,) of a part of which a quantity's media show or hide something."""
        low, high = self._loaded.bounds(number, quantity)
        found = np.zeros(len(low), bool)
        for medium in self.media:
            if medium.quantity == quantity:
                found |= medium.counts(low, high)
            found &= ~medium.hides(*self._loaded.bounds(number, medium.quantity))
        return found

    def _buffers(self) -> dict[str, Any]:
        """Buffers that all marches share."""
        device = self._loaded.device
        medium = np.zeros(len(self.media), self.march.dtype("medium"))
        counts = [len(own.transfer.values) for own in self.media]
        medium["list"] = [self.quantities.index(own.quantity) for own in self.media]
        medium["count"], medium["first"] = counts, np.cumsum(counts) - counts
        medium["gate"] = [own.gate for own in self.media]
        medium["steepest"] = [steepest(own.transfer) for own in self.media]
        densest = [max(own.transfer.densities) for own in self.media]
        medium["densest"] = [sum(densest) if own.gate else most for own, most in zip(self.media, densest, strict=True)]
        buffers = {"medium": device.buffer(medium)}
        for name in ("values", "densities", "colors"):
            numbers = [np.asarray(getattr(own.transfer, name), np.float64) for own in self.media]
            buffers[name] = device.buffer(np.concatenate(numbers))
        return buffers


class VolumeRenderer:
    """A loaded volume that is ready for any transfer functions from any view.

    faces  provides the faces of its elements, for curved ones
    """

    def __init__(self, loaded: DeviceVolume, faces: Callable[[], FaceDrawer] | None = None) -> None:
        self.loaded, self.faces, self.traversal = loaded, faces, Traversal(loaded)
        self.bends = Bends(loaded)
        self._last: _Media | None = None

    def draw(
        self,
        view: View,
        media: Sequence[Medium],
        fragments: FragmentLists,
        error: float = 1e-3,
        clips: Sequence[Clip] = (),
    ) -> RayIntegrals:
        """The light that reaches the eye from all volumes and surfaces, where there are volumes; it enters the picture.

        fragments  the picture's surfaces, composed
        error  maximum estimated error of a pixel's colour
        clips  applied to the volumes, except implicit surfaces, for which there are media

        Raises SceneError for 2D data, for curved elements without faces, and if densities times lengths overflow.
        """
        march = _March(self, view, self._of(media), fragments, error, clips)
        for band in march.bands():
            march.band(band)
        return march.ray_integrals()

    def _of(self, media: Sequence[Medium]) -> _Media:
        """Data of media, reused for the same media in the next frame."""
        if self._last is None or self._last.media != media:
            for medium in media:
                self._check(medium.transfer)
            self._last = _Media(self.loaded, self.traversal, media)
        return self._last

    def _check(self, transfer: Transfer) -> None:
        if self.loaded.dimension != 3:
            raise SceneError("volume rendering needs 3D data")
        if len(transfer.colors) != len(transfer.values):
            raise SceneError(f"colors of a volume: expected one for each of {len(transfer.values)} values")
        densest, extent = max(transfer.densities), self.loaded.extent
        if densest * 4 > np.finfo(float).max / max(extent, 1.0):
            raise SceneError(f"densities of a volume: {densest:g} overflows over lengths of {extent:g}")


class _March:
    """One picture of volumes, in the making.

    quantities, curved  see _Media
    chosen              for each quantity and each part the elements that count
    bent                (elements,) those among them that are curved, for any quantity
    """

    def __init__(
        self,
        renderer: VolumeRenderer,
        view: View,
        shown: _Media,
        fragments: FragmentLists,
        error: float,
        clips: Sequence[Clip],
    ) -> None:
        self.renderer, self.loaded, self.traversal = renderer, renderer.loaded, renderer.traversal
        self.device, self.view, self.media, self.error = self.loaded.device, view, shown.media, error
        self.visibility = Visibility(clips, view)
        self.quantities, self.curved, self.degree = shown.quantities, shown.curved, shown.degree
        parts = range(len(self.loaded.parts))
        hidden = [self.visibility.hides(part.boxes) for part in self.loaded.parts]
        self.chosen = [[own[n] & ~hidden[n] for n in parts] for own in shown.chosen]
        bent = [[own[n] & (n in at) for own, at in zip(self.chosen, self.curved, strict=True)] for n in parts]
        self.bent = np.concatenate([np.any(some, axis=0) for some in bent])
        self.march, self.shared, self.rooms = shown.march, shown.buffers, shown.rooms
        self.lost = np.zeros(view.count, np.int64)
        self.fixed = {**self.traversal.lines(self.degree), **fragments.buffers}
        self.fixed["ray_integrals"] = self.device.empty(self.march.dtype("ray_integrals"), view.count)
        self.parts = [
            self._list_curved(k, n) if n in curved else self._straight(k, n)
            for k, curved in enumerate(self.curved)
            for n in parts
        ]

    def _tolerance(self, quantity: str | None) -> float:
        """Error of a quantity that changes colours by less than a quarter of the requested error, along any ray."""
        length = 4 * self.loaded.extent
        own = [medium for medium in self.media if medium.quantity == quantity]
        densest = max(max(medium.transfer.densities) for medium in self.media)
        gate = 0.25 * self.error / max(densest, 1.0 / length) if any(medium.gate for medium in own) else np.inf
        return min(gate, *(tolerance(medium.transfer, self.error, length) for medium in own))

    def _kernel(self, stage: str, number: int, quantity_index: int) -> Kernel:
        part, quantity = self.loaded.parts[number], self.quantities[quantity_index]
        return self.device.kernel(stage, part, quantity, line_degree=self.degree)

    def _straight(self, quantity_index: int, number: int) -> _VisibleElements:
        """A part of straight tetrahedra."""
        kernel = self._kernel("volume_list", number, quantity_index)
        sections = visible_sections(self.view, self.traversal.corners(number), self.chosen[quantity_index][number])
        tiles, order = bin_sections(sections.least, sections.most, kernel.dtype("tiles"))
        counts = (tiles["end"] - tiles["first"]).astype(np.int64)
        return _VisibleElements(number, quantity_index, kernel, tiles, counts, {"order": sections.element[order]})

    def _list_curved(self, quantity_index: int, number: int) -> _VisibleElements:
        """A part of curved elements, by patches of their faces."""
        if self.renderer.faces is None:
            raise SceneError("volumes of curved elements need their faces, which the data's plugin does not provide")
        kernel = self._kernel("volume_trace", number, quantity_index)
        patches, view = self.renderer.faces().visible_patches(self.view, self.bent, number, kernel)
        patches = patches[self.chosen[quantity_index][number][patches["element"]]]
        tiles, order = bin_sections(*pixel_bounds(patches, self.view), kernel.dtype("tiles"))
        length, densest = 4.0 * self.loaded.extent, sum(max(own.transfer.densities) for own in self.media)
        own = self._tolerance(self.quantities[quantity_index])
        wanted = np.zeros(1, kernel.dtype("wanted"))
        wanted["tolerance"], wanted["apart"] = own, APART
        # the error of the field matters through its effect on colours: at most densities times lengths
        wanted["proof"] = own * _PROVED * length / float(np.linalg.norm(np.ptp(self.loaded.box, axis=0)))
        wanted["most"] = own * 4.0 / self.error * length * densest
        wanted["quota"] = _OF_A_KINK * own * length
        # the elements in a tile have some segments each
        fresh = np.append(True, np.diff(patches["element"][order].astype(np.int64)) != 0)[: len(order)]
        fresh[tiles["first"]] = True
        counts = np.add.reduceat(fresh.astype(np.int64), tiles["first"]) if len(tiles) else np.zeros(0, np.int64)
        counts *= _SEGMENTS_OF_AN_ELEMENT
        proof = self.renderer.bends.buffers(number, self.quantities[quantity_index], self.degree)
        buffers = {"order": order, "patches": patches, "view": view, "wanted": wanted}
        return _VisibleElements(number, quantity_index, kernel, tiles, counts, buffers, proof)

    def bands(self) -> Iterator[_Band]:
        """Groups of tiles whose lists have room together."""
        places = np.unique(np.concatenate([some.places for some in self.parts]))
        if not len(places):
            return
        rows = np.zeros((len(self.quantities), len(places)), np.int64)
        for some in self.parts:
            rows[some.quantity_index, np.searchsorted(places, some.places)] += some.rows
        most = np.maximum(rows.max(axis=0), [self.rooms.get(place, 0) for place in places.tolist()])
        size = len(rows) * (self.march.dtype("segments").itemsize + 8 * (self.degree + 1) + 12)
        fixed = self.march.dtype("stops").itemsize * self.visibility.most
        number = np.cumsum(LANES * (most * size + fixed)) // MOST_BYTES
        for own in np.split(np.arange(len(places)), np.flatnonzero(np.diff(number)) + 1):
            band = _Band(places[own], np.zeros(len(own), self.march.dtype("lists")))
            band.lists["number"] = np.arange(len(own))
            band.give(most[own])
            yield band

    def band(self, band: _Band) -> None:
        """List the segments of the rays of some tiles, then march along them."""
        lists = self._list_segments(band)
        # tiles reach beyond the picture's edge
        x, y = (corner[:, None] for corner in corners_of(band.places))
        x, y = x + np.arange(LANES) % TILE, y + np.arange(LANES) // TILE
        (left, top), (right, bottom) = self.view.first, self.view.last
        held = (x >= left) & (y >= top) & (x <= right) & (y <= bottom)
        pixel = np.where(held, self.view.numbers(x, y), 0)

        ask = np.zeros(1, self.march.dtype("march_of"))
        ask["error"], ask["rows"], ask["stops"] = self.error, band.rows, self.visibility.most
        stops, hidden = self._stops(pixel.ravel())
        lists |= {"stops": self.device.buffer(stops), "hidden": self.device.buffer(hidden)}
        lists |= {"march_of": self.device.buffer(ask), **self.shared}
        lists["tiles"] = self.device.buffer(empty_tiles(band.places, self.march.dtype("tiles")))
        lists["lists"] = self.device.buffer(band.lists)
        lists["rays"] = self.traversal.rays(self.march, self.view, 0, len(band))
        self.march(len(band), lists, groups=True, work=band.lists["room"])
        if any(self.curved):
            lost = self.device.read(lists["lost"], np.uint32)[: len(self.quantities) * pixel.size]
            self.lost[pixel[held]] += lost.reshape(-1, *pixel.shape).sum(axis=0, dtype=np.int64)[held]

    def ray_integrals(self) -> RayIntegrals:
        """The integrals along all rays."""
        count, dtype, device = self.view.count, self.march.dtype("ray_integrals"), self.device
        tally = device.read(self.fixed["tally"], np.uint32)[: 2 * count].reshape(-1, 2)
        return RayIntegrals(tally, self.lost, lambda: device.read(self.fixed["ray_integrals"], dtype)[:count])

    def _list_segments(self, band: _Band) -> dict[str, Any]:
        """The segments of all parts; once more where the lists of some tiles were too short, which become longer."""
        while True:
            lists = self._empty(len(band), band.rows)
            for some in self.parts:
                self._list(some, band, lists)
            if not any(self.curved):
                return lists
            counts = self.device.read(lists["counts"], np.uint32)[: len(self.quantities) * LANES * len(band)]
            needed = counts.reshape(-1, len(band), LANES).max(axis=(0, 2))
            if (needed <= band.lists["room"]).all():
                self.rooms.update(zip(band.places.tolist(), needed.tolist(), strict=True))
                return lists
            band.give(np.maximum(needed, band.lists["room"]))

    def _stops(self, pixel: Ints) -> tuple[NDArray[Any], NDArray[np.int32]]:
        """Stop records (m, k) along the rays of pixels (m,), and how many clips hide what comes before."""
        if not self.visibility.most:
            return np.zeros(0, self.march.dtype("stops")), np.zeros(0, np.int32)
        hidden, depths, changes = self.visibility.along(pixel)
        order = np.argsort(depths, axis=0, kind="stable")
        stops = np.zeros(depths.T.shape, self.march.dtype("stops"))
        for name, values in (("depth", depths), ("hides", changes)):
            stops[name] = np.take_along_axis(values, order, axis=0).T
        return stops, hidden.astype(np.int32)

    def _empty(self, tiles: int, rows: int) -> dict[str, Any]:
        """Lists without segments for all tiles and each quantity, with the total number of rows that they need."""
        many = len(self.quantities) * LANES
        zeros, room = np.zeros(many * tiles, np.uint32), many * rows
        lists = {"counts": self.device.buffer(zeros), "lost": self.device.buffer(zeros), **self.fixed}
        lists["segments"] = self.device.empty(self.march.dtype("segments"), room)
        lists["fields"] = self.device.empty(np.float64, room * (self.degree + 1))
        lists["ranks"], lists["depths"] = self.device.empty(np.uint32, room), self.device.empty(np.float64, room)
        return lists

    def _list(self, some: _VisibleElements, band: _Band, lists: dict[str, Any]) -> None:
        """Add the segments of a part in the tiles of a band to lists."""
        held, own = band.of(some)
        if held.any():
            arrays = {**some.data, "tiles": some.tiles[held], "lists": own}
            data = {name: self.device.buffer(array) for name, array in arrays.items()} | some.proof
            data["rays"] = self.traversal.rays(some.kernel, self.view, some.number, len(own))
            bound = self.loaded.bindings(some.number, self.quantities[some.quantity_index])
            some.kernel(len(own), {**bound, **lists, **data}, groups=True, work=some.rows[held])
