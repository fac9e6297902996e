"""The colours of a layer, made where it lies: colour map, light and lines on the device (shaders/paint.slang)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from elvis.renderer.compositing import Coat
from elvis.renderer.device import Device
from elvis.renderer.layer import Layer
from elvis.renderer.lines import Marks, sight
from elvis.renderer.palette import NOT_A_NUMBER, Palette
from elvis.renderer.scene import Light, Vector, unit
from elvis.renderer.view import View

if TYPE_CHECKING:
    import slangpy


#: what the kernel makes: kind of number, and how many a pixel
_MADE = {"colors": (np.float64, 3), "alphas": (np.float64, 1), "packed": (np.uint32, 1)}


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
    """Paints layers on a device."""

    def __init__(self, device: Device) -> None:
        self._device = device

    def coat(self, view: View, layer: Layer, look: Look) -> Coat:
        """What a layer adds to a picture of many."""
        made = self._painted(view, layer, look, (0.0, 0.0, 0.0))
        return Coat(layer.depth, self._read(made, "colors", view).reshape(-1, 3), self._read(made, "alphas", view))

    def over(self, view: View, layer: Layer, look: Look, background: Vector, *, whole: bool) -> Any:
        """Colours (n, 3) of a layer over a background, or (``whole``) these in steps of 1/255 as numbers of 8 bits."""
        made = self._painted(view, layer, look, background, whole=whole)
        if whole:
            return self._read(made, "packed", view).view(np.uint8).reshape(-1, 4)[:, :3]
        return self._read(made, "colors", view).reshape(-1, 3)

    def _read(self, made: Mapping[str, slangpy.Buffer], name: str, view: View) -> Any:
        dtype, size = _MADE[name]
        return self._device.read(made[name], dtype)[: size * view.count]

    def _painted(
        self, view: View, layer: Layer, look: Look, behind: Vector, *, whole: bool = False
    ) -> Mapping[str, slangpy.Buffer]:
        """What shaders/paint.slang makes (see _MADE): packed colours where they are to be whole, else the others."""
        device, kernel = self._device, self._device.kernel("paint")
        record = np.zeros(1, kernel.dtype("look"))
        table = np.array([look.colors, look.colors])
        if isinstance(look.colors, Palette):
            table, span = np.vstack([look.colors.table, NOT_A_NUMBER]), look.colors.high - look.colors.low
            record["low"], record["scale"] = look.colors.low, (len(table) - 1) / span if span > 0 else 0.0
        record["steps"], record["lights"], record["whole"] = len(table) - 1, len(look.lights), whole
        record["opacity"], record["ambient"], record["behind"] = look.opacity, look.ambient, behind
        normals, flat = layer.normals(device, needed=look.ambient < 1.0 or len(look.lights) > 0)
        made = {
            name: device.empty(dtype, size * view.count if (name == "packed") == whole else 1)
            for name, (dtype, size) in _MADE.items()
        }
        buffers = {
            **{name: layer.on(device, name) for name in ("owner", "field")},
            "normals": normals,
            "look": device.buffer(record),
            "table": device.buffer(table),
            "view": device.buffer(sight(kernel, view, count=view.count, flat=flat)),
            "lamps": device.buffer(_lamps(look.lights, kernel.dtype("lamps"))),
            **self._lines(look, kernel.dtype("inks")),
        }
        kernel(view.count, {**buffers, **made})
        return made

    def _lines(self, look: Look, dtype: np.dtype[Any]) -> dict[str, slangpy.Buffer]:
        """Marks of mesh lines and contours, and the Ink records of both."""
        inks, nothing, marks = np.zeros(2, dtype), self._device.empty(np.uint32, 1), {}
        for ink, name in zip(inks, ("mesh", "contours"), strict=True):
            lines = getattr(look, name)
            marks[name] = nothing if lines is None else lines[0].held
            if lines is not None:
                width, ink["mask"], ink["color"] = lines[0].width, lines[0].mask, lines[1]
                ink["reach"], ink["most"] = 0.5 * width + 0.5, min(1.0, width)
        return {**marks, "inks": self._device.buffer(inks)}


def _lamps(lights: Sequence[Light], dtype: np.dtype[Any]) -> NDArray[Any]:
    """The Lamp records of shaders/paint.slang."""
    lamps = np.zeros(len(lights), dtype)
    for lamp, light in zip(lamps, lights, strict=True):
        if light.direction is not None:
            lamp["towards"] = unit(light.direction, "the direction of a light")
        lamp["intensity"] = light.intensity
    return lamps
