"""What draws something about pieces of lines: tubes and ribbons, tile by tile."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from elvis.core.arrays import Floats, Ints
from elvis.core.streamlines.line_pieces import Pieces
from elvis.renderer.camera import record_of
from elvis.renderer.device_volume import DeviceVolume
from elvis.renderer.hit_buffer import HitBuffer, arrays_to_write, new_arrays
from elvis.renderer.memory import Buffer
from elvis.renderer.passes.solids.solids import values_at_hits
from elvis.renderer.pieces_in_view import Girth, PiecesInView, part_of, pieces_in_view
from elvis.renderer.tiles import bin_sections
from elvis.scene.conditioning import misplaced
from elvis.scene.view import View

Shown = TypeVar("Shown")

#: what of the hit buffer the device holds
_HELD = ("owner", "status", "reference", "depth", "normal", "uncertainty", "doubt")


@dataclass(frozen=True, eq=False)
class _Prepared:
    """What a view sees of pieces on the device, and how much each tile has to do."""

    view: View
    girth: Girth
    buffers: dict[str, Buffer]
    work: Ints


class PieceDrawer(ABC, Generic[Shown]):
    """Draws about pieces of lines in a loaded volume; what the last view saw of each object is kept."""

    #: of the kernel, and what it calls its records
    kernel_name: ClassVar[str]
    list_name: ClassVar[str]

    def __init__(self, loaded: DeviceVolume) -> None:
        self.loaded = loaded
        self._known: WeakKeyDictionary[Any, _Prepared] = WeakKeyDictionary()

    @abstractmethod
    def pieces_of(self, shown: Shown) -> Pieces:
        """The pieces of an object."""

    @abstractmethod
    def fill(self, records: NDArray[Any], shown: Shown, seen: PiecesInView) -> None:
        """Fill in what only this kernel's records have."""

    def draw(
        self, view: View, shown: Shown, girth: Girth, beyond: Floats | None = None, quantity: str | None = None
    ) -> HitBuffer:
        """The nearest hits behind the depths ``beyond`` (n,) where given, with a quantity's values."""
        device = self.loaded.device
        kernel = device.kernel(self.kernel_name)
        own = self._known.get(shown)
        if own is None or (own.view, own.girth) != (view, girth):
            # what was there is given back before more is taken
            self._known.pop(shown, None)
            self._known[shown] = own = self._prepared(view, shown, girth)
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

    def _prepared(self, view: View, shown: Shown, girth: Girth) -> _Prepared:
        """The kernel's records of what a view sees."""
        device, pieces = self.loaded.device, self.pieces_of(shown)
        kernel = device.kernel(self.kernel_name)
        owner, known = self.loaded.owners_of(pieces.element)
        seen = pieces_in_view(view, pieces, girth, np.flatnonzero(known))
        reference = part_of(pieces.reference[seen.number], seen.place)
        records = np.zeros(len(seen.number), kernel.dtype(self.list_name))
        records["points"] = flattened(seen.points)
        records["reference"] = flattened(reference)
        records["turn"] = greatest_bend(seen.points)
        records["near"] = seen.near
        records["owner"] = owner[seen.number]
        self.fill(records, shown, seen)
        tiles, listed = bin_sections(seen.least, seen.most, kernel.dtype("tiles"), (view.width, view.height))
        work = (tiles["end"] - tiles["first"]).astype(np.int64)
        data = {self.list_name: records, "listed": listed, "tiles": tiles}
        return _Prepared(view, girth, {name: device.buffer(array) for name, array in data.items()}, work)


def flattened(points: Floats) -> Floats:
    """(n, 3 k) the numbers of curves (n, k, 3), one coefficient after the other."""
    return points.reshape(len(points), 3 * points.shape[1])


def greatest_bend(points: Floats) -> Floats:
    """(n,) no second derivatives of curves, (n, k, 3) coefficients of powers, are longer on [-1, 1]."""
    power = np.arange(points.shape[1])
    return np.asarray(np.linalg.norm(points, axis=2) @ (power * (power - 1.0)))
