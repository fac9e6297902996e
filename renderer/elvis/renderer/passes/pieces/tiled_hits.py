"""Hits of solids whose records are listed by the tiles of the picture that they reach into: a group a tile."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints, Records
from elvis.renderer.device.device import Kernel
from elvis.renderer.device.memory import Buffer
from elvis.renderer.passes.solids.solids import values_at_hits
from elvis.renderer.raster.camera import record_of
from elvis.renderer.raster.hit_buffer import HitBuffer, arrays_to_write, new_arrays
from elvis.renderer.raster.tiles import bin_sections
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View
from elvis.scene.record.conditioning import misplaced

#: what of the hit buffer the device holds
_HELD = ("owner", "status", "reference", "depth", "normal", "uncertainty", "doubt")


def listed_in_tiles(
    loaded: DeviceVolume,
    kernel: Kernel,
    name: str,
    records: Records,
    ends: tuple[Ints, Ints],
    view: View,
    around: Callable[[Any], dict[str, Records]] = lambda listed: {},
) -> tuple[dict[str, Buffer], Ints]:
    """Buffers of records (n,) by the kernel's name of them, and of their tiles; how many each tile has to look at.

    ends    the minimum and the maximum pixel (n, 2) that each reaches
    around  further arrays by name, from the numbers of the records that are listed, tile by tile
    """
    tiles, listed = bin_sections(*ends, kernel.dtype("tiles"), view)
    work = (tiles["end"] - tiles["first"]).astype(np.int64)
    data = {name: records, "listed": listed, "tiles": tiles, **around(listed)}
    return {part: loaded.device.buffer(array) for part, array in data.items()}, work


def hits_in_tiles(
    loaded: DeviceVolume,
    kernel: Kernel,
    view: View,
    buffers: Mapping[str, Buffer],
    work: Ints,
    beyond: Floats | None,
    quantity: str | None,
    **facts: Any,
) -> HitBuffer:
    """The nearest hits behind the depths ``beyond`` (n,) where given, with a quantity's values.

    buffers, work  as of `listed_in_tiles`
    facts          further numbers of the view's record
    """
    device = loaded.device
    facts |= {"misplaced": misplaced(view, loaded.extent), "count": len(work), "has_beyond": beyond is not None}
    after = np.zeros(1) if beyond is None else np.ascontiguousarray(beyond, np.float64)
    held = new_arrays(device, view.count, _HELD)
    record = device.buffer(record_of(kernel, "view", view, **facts))
    output = {**arrays_to_write(device, held, view.count), "after": device.buffer(after), "view": record}
    kernel(len(work), {**buffers, **output}, groups=True, work=work)
    hits = HitBuffer.on_device(device, held, field=np.empty(0))
    return hits.showing(values_at_hits(loaded, hits, quantity))
