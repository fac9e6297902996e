"""The colours of a hit buffer, made where it lies: colour map, light and lines on the device (paint.slang)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.renderer.camera import record_of
from elvis.renderer.compositing import Coats
from elvis.renderer.device import Buffer, Device
from elvis.renderer.hit_buffer import HitBuffer
from elvis.renderer.passes.lines.lines import Marks
from elvis.scene import Light, Vector, unit
from elvis.scene.palette import NOT_A_NUMBER, Palette
from elvis.scene.view import View


@dataclass(frozen=True, eq=False)
class Look:
    """How a surface is to look.

    colors   a colour map for its field, or one colour
    lights   none where it is unlit; its colours are multiplied by ambient + sum of intensity times cosine, at most 1,
             on the side that the viewer sees
    mesh, contours  lines and their colours, contours on top
    """

    colors: Palette | Vector
    opacity: float = 1.0
    lights: Sequence[Light] = ()
    ambient: float = 1.0
    mesh: tuple[Marks, Vector] | None = None
    contours: tuple[Marks, Vector] | None = None


class Brush:
    """Paints hit buffers on a device."""

    def __init__(self, device: Device) -> None:
        self._device, self._nothing = device, device.empty(np.float64, 1)

    def coat(self, view: View, hits: HitBuffer, look: Look, coats: Coats, number: int) -> None:
        """Paint a hit buffer as one of the coats of a picture."""
        buffers = {name: coats.buffers[name] for name in ("coat_depths", "coat_colors")}
        self._paint(view, hits, look, (0.0, 0.0, 0.0), {**buffers, "packed": self._nothing}, number * view.count)

    def over(self, view: View, hits: HitBuffer, look: Look, background: Vector, *, whole: bool) -> Any:
        """Colours (n, 3) of hits over a background, or (``whole``) these in steps of 1/255 as numbers of 8 bits."""
        if not whole:
            coats = Coats(self._device, view.count, 1, background)
            self.coat(view, hits, look, coats, 0)
            return coats.compose().colors()
        packed = self._device.empty(np.uint32, view.count)
        made = {"coat_depths": self._nothing, "coat_colors": self._nothing, "packed": packed}
        self._paint(view, hits, look, background, made, whole=True)
        return self._device.read(packed, np.uint8).reshape(-1, 4)[: view.count, :3]

    def _paint(
        self,
        view: View,
        hits: HitBuffer,
        look: Look,
        behind: Vector,
        made: Mapping[str, Buffer],
        first: int = 0,
        *,
        whole: bool = False,
    ) -> None:
        """Run paint.slang: packed colours where they are to be whole, else a coat."""
        device, kernel = self._device, self._device.kernel("paint")
        record = np.zeros(1, kernel.dtype("look"))
        table = np.array([look.colors, look.colors])
        if isinstance(look.colors, Palette):
            table, span = np.vstack([look.colors.table, NOT_A_NUMBER]), look.colors.high - look.colors.low
            record["low"], record["scale"] = look.colors.low, (len(table) - 1) / span if span > 0 else 0.0
        record["steps"], record["lights"], record["whole"] = len(table) - 1, len(look.lights), whole
        record["first"] = first
        record["opacity"], record["ambient"], record["behind"] = look.opacity, look.ambient, behind
        is_lit = look.ambient < 1.0 or len(look.lights) > 0
        wanted = [name for name, needed in (("normal", is_lit), ("depth", not whole)) if needed]
        buffers = {
            **dict.fromkeys(("hit_normal", "hit_depth"), self._nothing),
            **hits.bound(device, "owner", "field", *wanted),
            "look": device.buffer(record),
            "table": device.buffer(table),
            "view": device.buffer(record_of(kernel, "view", view, count=view.count, flat=hits.flat is not None)),
            "lamps": device.buffer(_lamps(look.lights, kernel.dtype("lamps"))),
            **self._lines(look, kernel.dtype("inks")),
        }
        kernel(view.count, {**buffers, **made})

    def _lines(self, look: Look, dtype: np.dtype[Any]) -> dict[str, Buffer]:
        """Marks of mesh lines and contours, and the Ink records of both."""
        inks, marks = np.zeros(2, dtype), {}
        for ink, name in zip(inks, ("mesh", "contours"), strict=True):
            lines = getattr(look, name)
            marks[name] = self._nothing if lines is None else lines[0].held
            if lines is not None:
                width, ink["mask"], ink["color"] = lines[0].width, lines[0].mask, lines[1]
                ink["reach"], ink["most"] = 0.5 * width + 0.5, min(1.0, width)
        return {**marks, "inks": self._device.buffer(inks)}


def _lamps(lights: Sequence[Light], dtype: np.dtype[Any]) -> NDArray[Any]:
    """The Lamp records of paint.slang."""
    lamps = np.zeros(len(lights), dtype)
    for lamp, light in zip(lamps, lights, strict=True):
        if light.direction is not None:
            lamp["towards"] = unit(light.direction, "the direction of a light")
        lamp["intensity"] = light.intensity
    return lamps
