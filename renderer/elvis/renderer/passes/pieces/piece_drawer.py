"""Drawing of shapes around pieces of lines: tubes and ribbons, tile by tile."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Generic, TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from elvis.core.base.arrays import Floats, Ints, Records
from elvis.core.streamlines.lines.pieces import Pieces
from elvis.renderer.device.device import Kernel
from elvis.renderer.device.memory import Buffer
from elvis.renderer.passes.pieces.in_view import Girth, PiecesInView, part_of, pieces_in_view
from elvis.renderer.passes.pieces.tiled_hits import hits_in_tiles, listed_in_tiles
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View

Shown = TypeVar("Shown")


@dataclass(frozen=True, eq=False)
class _Prepared:
    """Pieces in a view on the device, and the work of each tile."""

    view: View
    girth: Girth
    buffers: dict[str, Buffer]
    work: Ints


class PieceDrawer(ABC, Generic[Shown]):
    """Draws about pieces of lines in a loaded volume; what the last view saw of each object is retained."""

    #: names of the kernel and of its records
    kernel_name: ClassVar[str]
    list_name: ClassVar[str]

    def __init__(self, loaded: DeviceVolume) -> None:
        self.loaded = loaded
        self._known: WeakKeyDictionary[Any, _Prepared] = WeakKeyDictionary()

    @abstractmethod
    def pieces_of(self, shown: Shown) -> Pieces:
        """The pieces of an object."""

    @abstractmethod
    def fill(self, records: Records, shown: Shown, seen: PiecesInView) -> None:
        """Fill in what only this kernel's records have."""

    def around(self, kernel: Kernel, records: Records, listed: Ints) -> dict[str, Records]:
        """Further arrays of this kernel, from the records and the numbers of those that are listed, tile by tile."""
        return {}

    def draw(
        self, view: View, shown: Shown, girth: Girth, beyond: Floats | None = None, quantity: str | None = None
    ) -> HitBuffer:
        """The nearest hits behind the depths ``beyond`` (n,) where given, with a quantity's values."""
        kernel = self.loaded.device.kernel(self.kernel_name)
        own = self._known.get(shown)
        if own is None or (own.view, own.girth) != (view, girth):
            # release previous buffers before allocating new ones
            self._known.pop(shown, None)
            self._known[shown] = own = self._prepared(view, shown, girth)
        radius, growth = girth.in_view(view)
        greatest = max(self.loaded.extent, float(np.abs(view.camera.eye).max()))
        facts = {"radius": radius, "growth": growth, "tie": 1e-12 * greatest}
        return hits_in_tiles(self.loaded, kernel, view, own.buffers, own.work, beyond, quantity, **facts)

    def _prepared(self, view: View, shown: Shown, girth: Girth) -> _Prepared:
        """The kernel's records of what a view sees."""
        pieces = self.pieces_of(shown)
        kernel = self.loaded.device.kernel(self.kernel_name)
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
        ends = seen.least, seen.most
        around = partial(self.around, kernel, records)
        listed = listed_in_tiles(self.loaded, kernel, self.list_name, records, ends, view, around)
        return _Prepared(view, girth, *listed)


def flattened(points: Floats) -> Floats:
    """(n, 3 k) the numbers of curves (n, k, 3), one coefficient after the other."""
    return points.reshape(len(points), 3 * points.shape[1])


def greatest_bend(points: Floats) -> Floats:
    """(n,) no second derivatives of curves, (n, k, 3) coefficients of powers, are longer on [-1, 1]."""
    power = np.arange(points.shape[1])
    return np.asarray(np.linalg.norm(points, axis=2) @ (power * (power - 1.0)))
