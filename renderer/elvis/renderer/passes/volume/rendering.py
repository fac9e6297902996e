"""Volumes: the light that elements send out and take up along each ray (stages: volume_*.slang)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Bools, Ints, Records, joined_ints
from elvis.renderer.device.device import Kernel
from elvis.renderer.device.memory import Buffer
from elvis.renderer.frame.copied import Copy, is_in_view, surrounding_copies
from elvis.renderer.passes.faces.faces import FaceDrawer, pixel_bounds
from elvis.renderer.passes.volume.bends import Bends
from elvis.renderer.passes.volume.inverses import Inverses, pixels_of
from elvis.renderer.passes.volume.media import CopyMedia, Media, Medium
from elvis.renderer.passes.volume.ray_integrals import RayIntegrals
from elvis.renderer.passes.volume.steepness import tolerance
from elvis.renderer.passes.volume.visibility import Visibility
from elvis.renderer.raster.compositing import FragmentLists
from elvis.renderer.raster.tiles import TILE, bin_sections, corners_of, empty_tiles, places_of
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.renderer.volume.traversal import APART, Traversal, visible_sections
from elvis.scene import Clip, Transfer
from elvis.scene.cameras.view import View
from elvis.scene.model.errors import SceneError

#: bytes of the lists that rays have at one time
MOST_BYTES = 192 << 20
LANES = TILE * TILE
#: error that must be proved for the diagonal of all elements, relative to the tolerance, which is a quarter of the
#: requested error
_PROVED = 1.0
#: likely number of segments of a ray in a curved element; longer lists are made once more
_SEGMENTS_OF_AN_ELEMENT = 6
#: lists are at most this much longer than likely before it is known that they have to be
_MOST_CROWDING = 4.0
#: part of the requested error that a part of a ray may have which holds a kink or a jump
_OF_A_KINK = 2.0**-10


@dataclass(eq=False)
class _VisibleElements:
    """Visible elements of a part, in one copy of the data: tiles, and inputs of the stage that lists their segments.

    list_index  number of the list of segments
    quantity    the quantity of the data that the list is of in this copy
    view        in which the data look as the copy does
    rows    (tiles,) maximum number of entries, one per pixel, that each needs, or a likely one if elements are curved
    proof   inputs of the quantity's bounds, on the device
    """

    number: int
    list_index: int
    quantity: str | None
    view: View
    kernel: Kernel
    tiles: Records
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
    likely  (n,) expected numbers of entries
    """

    places: Ints
    lists: Records
    likely: Ints

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

    def of(self, some: _VisibleElements) -> tuple[Bools, Records]:
        """(m,) which of the tiles with something of a part are in the band, and the lists of these."""
        at = np.minimum(np.searchsorted(self.places, some.places), len(self) - 1)
        held = self.places[at] == some.places
        lists = self.lists[at[held]]
        lists["number"] += np.uint32(some.list_index * len(self))
        lists["base"] += np.uint32(some.list_index * self.rows)
        return held, lists


class VolumeRenderer:
    """A loaded volume that is ready for any transfer functions from any view.

    faces  provides the faces of its elements, for curved ones
    """

    def __init__(self, loaded: DeviceVolume, faces: Callable[[], FaceDrawer] | None = None) -> None:
        self.loaded, self.faces, self.traversal = loaded, faces, Traversal(loaded)
        self.bends = Bends(loaded)
        self.inverses = Inverses(loaded, self.bends)
        self._last: Media | None = None

    def draw(
        self,
        view: View,
        media: Sequence[Medium],
        fragments: FragmentLists,
        error: float = 1e-3,
        clips: Sequence[Clip] = (),
        copies: Sequence[Copy] = (),
    ) -> RayIntegrals:
        """The light that reaches the eye from all volumes and surfaces, where there are volumes; it enters the picture.

        fragments  the picture's surfaces, composed
        error  maximum estimated error of a pixel's colour
        clips  applied to the volumes, except implicit surfaces, for which there are media
        copies  of the data, which are drawn together; none draws the data alone

        Raises SceneError for 2D data, for curved elements without faces, and if densities times lengths overflow.
        """
        march = _March(self, view, self._of(media, copies), fragments, error, clips)
        for band in march.bands():
            march.band(band)
        return march.ray_integrals()

    def _of(self, media: Sequence[Medium], copies: Sequence[Copy]) -> Media:
        """Data of media, reused for the same media and copies in the next frame."""
        if self._last is None or (self._last.media, self._last.shown_copies) != (media, copies):
            for medium in media:
                self._check(medium.transfer, copies)
            self._last = Media(self.traversal, media, copies)
        return self._last

    def _check(self, transfer: Transfer, copies: Sequence[Copy]) -> None:
        if self.loaded.dimension != 3:
            raise SceneError("volume rendering needs 3D data")
        if len(transfer.colors) != len(transfer.values):
            raise SceneError(f"colors of a volume: expected one for each of {len(transfer.values)} values")
        densest, extent = max(transfer.densities), _extent(self.loaded, copies)
        if densest * 4 > np.finfo(float).max / max(extent, 1.0):
            raise SceneError(f"densities of a volume: {densest:g} overflows over lengths of {extent:g}")


def _extent(loaded: DeviceVolume, copies: Sequence[Copy]) -> float:
    """Magnitude of the largest coordinate of all copies."""
    return max(loaded.extent, float(np.abs(surrounding_copies(loaded.box, copies)).max(initial=0.0)))


class _March:
    """One picture of volumes, in the making.

    media     with the data that depend on them alone
    length    of rays in the data and copies of them, at most
    diagonal  of the box around them
    """

    def __init__(
        self,
        renderer: VolumeRenderer,
        view: View,
        shown: Media,
        fragments: FragmentLists,
        error: float,
        clips: Sequence[Clip],
    ) -> None:
        self.renderer, self.loaded, self.traversal = renderer, renderer.loaded, renderer.traversal
        self.device, self.view, self.shown, self.error = self.loaded.device, view, shown, error
        self.media, self.quantities, self.degree = shown.media, shown.quantities, shown.degree
        self.visibility = Visibility(clips, view)
        self.length = 4.0 * _extent(self.loaded, shown.shown_copies)
        self.diagonal = float(np.linalg.norm(np.ptp(surrounding_copies(self.loaded.box, shown.shown_copies), axis=0)))
        self.march, self.shared, self.rooms = shown.march, shown.buffers, shown.rooms
        self.lost = np.zeros(view.count, np.int64)
        self.fixed = {**self.traversal.lines(self.degree), **fragments.buffers}
        self.fixed["ray_integrals"] = self.device.empty(self.march.dtype("ray_integrals"), view.count)
        self.parts = list(self._visible_elements(clips))

    def _visible_elements(self, clips: Sequence[Clip]) -> Iterator[_VisibleElements]:
        """Visible elements of all copies; without copies, of the data."""
        if not self.shown.shown_copies:
            yield from self._of_copy(self.shown.copies[0], self.view, self.visibility)
        for copy, own in zip(self.shown.shown_copies, self.shown.copies, strict=False):
            view = copy.view(self.view)
            if is_in_view(view, self.loaded.box):
                yield from self._of_copy(own, view, Visibility(copy.clips(clips), view))

    def _of_copy(self, own: CopyMedia, view: View, visibility: Visibility) -> Iterator[_VisibleElements]:
        """Visible elements of one copy, in the view in which the data look like it."""
        parts = range(len(self.loaded.parts))
        hidden = [visibility.hides(part.boxes) for part in self.loaded.parts]
        chosen = [[each[n] & ~hidden[n] for n in parts] for each in own.chosen]
        bent = [[each[n] & (n in at) for each, at in zip(chosen, own.curved, strict=True)] for n in parts]
        # curved elements for any quantity, by index
        every = np.concatenate([np.any(some, axis=0) for some in bent])
        for k, quantity in enumerate(own.names):
            for n in parts:
                if n in own.curved[k]:
                    yield self._list_curved(k, quantity, n, view, chosen[k][n], every)
                else:
                    yield self._straight(k, quantity, n, view, chosen[k][n])

    def _tolerance(self, quantity: str | None) -> float:
        """Error of a quantity that changes colours by less than a quarter of the requested error, along any ray."""
        own = [medium for medium in self.media if medium.quantity == quantity]
        densest = max(max(medium.transfer.densities) for medium in self.media)
        gate = 0.25 * self.error / max(densest, 1.0 / self.length) if any(medium.gate for medium in own) else np.inf
        return min(gate, *(tolerance(medium.transfer, self.error, self.length) for medium in own))

    def _kernel(self, stage: str, number: int, quantity: str | None) -> Kernel:
        return self.device.kernel(stage, self.loaded.parts[number], quantity, line_degree=self.degree)

    def _straight(
        self, list_index: int, quantity: str | None, number: int, view: View, chosen: Bools
    ) -> _VisibleElements:
        """Chosen elements of a part of straight tetrahedra."""
        kernel = self._kernel("volume_list", number, quantity)
        sections = visible_sections(view, self.traversal.corners(number), chosen)
        tiles, order = bin_sections(sections.least, sections.most, kernel.dtype("tiles"))
        counts = (tiles["end"] - tiles["first"]).astype(np.int64)
        data = {"order": sections.element[order]}
        return _VisibleElements(number, list_index, quantity, view, kernel, tiles, counts, data)

    def _list_curved(
        self, list_index: int, quantity: str | None, number: int, view: View, chosen: Bools, bent: Bools
    ) -> _VisibleElements:
        """Chosen elements of a part of curved elements, by patches of their faces.

        bent  (elements,) of all parts that are curved for any quantity
        """
        if self.renderer.faces is None:
            raise SceneError("volumes of curved elements need their faces, which the data's plugin does not provide")
        kernel = self._kernel("volume_trace", number, quantity)
        patches, face_view = self.renderer.faces().visible_patches(view, bent, number, kernel)
        patches = patches[chosen[patches["element"]]]
        tiles, order = bin_sections(*pixel_bounds(patches, view), kernel.dtype("tiles"))
        wanted = np.zeros(1, kernel.dtype("wanted"))
        for name, value in self._errors(list_index).items():
            wanted[name] = value
        # the elements in a tile have some segments each
        fresh = np.append(True, np.diff(patches["element"][order].astype(np.int64)) != 0)[: len(order)]
        fresh[tiles["first"]] = True
        counts = np.add.reduceat(fresh.astype(np.int64), tiles["first"]) if len(tiles) else np.zeros(0, np.int64)
        counts *= _SEGMENTS_OF_AN_ELEMENT
        proof = self.renderer.bends.buffers(number, quantity, self.degree)
        pixels = pixels_of(patches, view, len(self.loaded.parts[number]))
        proof |= self.renderer.inverses.buffers(number, quantity, kernel, self.degree, wanted["proof"][0], pixels)
        buffers = {"order": order, "patches": patches, "view": face_view, "wanted": wanted}
        return _VisibleElements(number, list_index, quantity, view, kernel, tiles, counts, buffers, proof)

    def _errors(self, list_index: int) -> dict[str, float]:
        """Allowed errors of the quantity of a list (volume_trace.slang)."""
        own = self._tolerance(self.quantities[list_index])
        densest = sum(max(each.transfer.densities) for each in self.media)
        return {
            "tolerance": own,
            "apart": APART,
            # the error of the field matters through its effect on colours: at most densities times lengths
            "proof": own * _PROVED * self.length / self.diagonal,
            "most": own * 4.0 / self.error * self.length * densest,
            "quota": _OF_A_KINK * own * self.length,
        }

    def bands(self) -> Iterator[_Band]:
        """Groups of tiles whose lists have room together."""
        places = np.unique(joined_ints(some.places for some in self.parts))
        if not len(places):
            return
        rows = np.zeros((len(self.quantities), len(places)), np.int64)
        for some in self.parts:
            rows[some.list_index, np.searchsorted(places, some.places)] += some.rows
        likely = rows.max(axis=0)
        known = np.array([self.rooms.get(place, 0) for place in places.tolist()])
        size = len(rows) * (self.march.dtype("segments").itemsize + 8 * (self.degree + 1) + 12)
        fixed = self.march.dtype("stops").itemsize * self.visibility.most
        first = 0
        while first < len(places):
            # lists of the bands before tell how long the next ones have to be
            longer = np.ceil(self.shown.crowding * likely[first:]).astype(np.int64)
            most = np.where(known[first:] > 0, np.maximum(known, likely)[first:], longer)
            count = int(np.searchsorted(np.cumsum(LANES * (most * size + fixed)), MOST_BYTES))
            own = slice(first, first + max(1, count))
            band = _Band(places[own], np.zeros(len(places[own]), self.march.dtype("lists")), likely[own])
            band.lists["number"] = np.arange(len(band))
            band.give(most[: len(band)])
            yield band
            first += len(band)

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
        if self.shown.is_curved:
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
            if not self.shown.is_curved:
                return lists
            counts = self.device.read(lists["counts"], np.uint32)[: len(self.quantities) * LANES * len(band)]
            needed = counts.reshape(-1, len(band), LANES).max(axis=(0, 2))
            if (needed <= band.lists["room"]).all():
                self.rooms.update(zip(band.places.tolist(), needed.tolist(), strict=True))
                crowding = float((needed / np.maximum(band.likely, 1)).max(initial=0.0))
                self.shown.crowding = max(self.shown.crowding, min(crowding, _MOST_CROWDING))
                return lists
            band.give(np.maximum(needed, band.lists["room"]))

    def _stops(self, pixel: Ints) -> tuple[Records, NDArray[np.int32]]:
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
            data["rays"] = self.traversal.rays(some.kernel, some.view, some.number, len(own))
            bound = self.loaded.bindings(some.number, some.quantity)
            some.kernel(len(own), {**bound, **lists, **data}, groups=True, work=some.rows[held])
