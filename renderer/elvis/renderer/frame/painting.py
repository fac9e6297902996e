"""The colours of a hit buffer, made where it lies: colour map, light and lines on the device (paint.slang)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.arrays import Records
from elvis.renderer.device.device import Device
from elvis.renderer.device.memory import Buffer
from elvis.renderer.passes.lines.lines import Marks
from elvis.renderer.raster.camera import record_of
from elvis.renderer.raster.compositing import FragmentLists
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.scene import Light, Vector, unit
from elvis.scene.cameras.view import View
from elvis.scene.record.palette import NOT_A_NUMBER, Palette


@dataclass(frozen=True, eq=False)
class Material:
    """The material of a surface.

    colors   a colour map for its field, or one colour
    lights   none where it is unlit; its colours are multiplied by ambient + sum of intensity times cosine, at most 1,
             on the side that the viewer sees
    mesh, contours  lines and their colours, contours on top
    streaks  tones of a line integral convolution (lic_convolve.slang), and their contrast
    """

    colors: Palette | Vector
    opacity: float = 1.0
    lights: Sequence[Light] = ()
    ambient: float = 1.0
    mesh: tuple[Marks, Vector] | None = None
    contours: tuple[Marks, Vector] | None = None
    streaks: tuple[Buffer, float] | None = None


class FragmentShader:
    """Makes fragments of hit buffers on a device (paint.slang)."""

    def __init__(self, device: Device) -> None:
        self._device, self._nothing = device, device.empty(np.float64, 1)

    def add(self, view: View, hits: HitBuffer, material: Material, fragments: FragmentLists, number: int) -> None:
        """Add the fragments of a hit buffer, number ``number`` among those of a picture."""
        buffers = {name: fragments.buffers[name] for name in ("fragment_depths", "fragment_colors")}
        self._paint(view, hits, material, (0.0, 0.0, 0.0), {**buffers, "packed": self._nothing}, number * view.count)

    def over(self, view: View, hits: HitBuffer, material: Material, background: Vector, *, whole: bool) -> Any:
        """Colours (n, 3) of hits over a background, or (``whole``) these in steps of 1/255 as numbers of 8 bits."""
        if not whole:
            fragments = FragmentLists(self._device, view.count, 1, background)
            self.add(view, hits, material, fragments, 0)
            return fragments.compose().colors()
        packed = self._device.empty(np.uint32, view.count)
        made = {"fragment_depths": self._nothing, "fragment_colors": self._nothing, "packed": packed}
        self._paint(view, hits, material, background, made, whole=True)
        return self._device.read(packed, np.uint8).reshape(-1, 4)[: view.count, :3]

    def _paint(
        self,
        view: View,
        hits: HitBuffer,
        material: Material,
        behind: Vector,
        made: Mapping[str, Buffer],
        first: int = 0,
        *,
        whole: bool = False,
    ) -> None:
        """Run paint.slang: packed colours where they are to be whole, else a fragment."""
        device, kernel = self._device, self._device.kernel("paint")
        record = np.zeros(1, kernel.dtype("material"))
        table, edges = np.array([material.colors, material.colors]), None
        if isinstance(material.colors, Palette):
            table, span = np.vstack([material.colors.table, NOT_A_NUMBER]), material.colors.high - material.colors.low
            edges, record["edges"] = material.colors.edges, material.colors.edges is not None
            record["low"], record["scale"] = material.colors.low, (len(table) - 1) / span if span > 0 else 0.0
        record["steps"], record["lights"], record["whole"] = len(table) - 1, len(material.lights), whole
        record["first"] = first
        record["opacity"], record["ambient"], record["behind"] = material.opacity, material.ambient, behind
        tones, record["contrast"] = material.streaks or (self._nothing, 0.0)
        is_lit = material.ambient < 1.0 or len(material.lights) > 0
        wanted = [name for name, needed in (("normal", is_lit), ("depth", not whole)) if needed]
        given: dict[str, Buffer | NDArray[Any]] = {
            **dict.fromkeys(("hit_normal", "hit_depth"), self._nothing),
            **hits.bindings(device, "owner", "field", *wanted),
            "material": record,
            "table": device.buffer(table),
            "tones": tones,
            "edges": self._nothing if edges is None else device.buffer(edges),
            "view": record_of(kernel, "view", view, count=view.count, flat=hits.flat is not None),
            "lights": device.buffer(_light_records(material.lights, view, kernel.dtype("lights"))),
            **self._marks(material, record),
        }
        kernel(view.count, {**given, **made})

    def _marks(self, material: Material, record: Records) -> dict[str, Buffer]:
        """Marks of mesh lines and contours; also sets their style in the Material record."""
        marks = {}
        for name, style, lines in (("mesh", "mesh_line", material.mesh), ("contours", "contour", material.contours)):
            if lines is None:
                marks[name] = self._nothing
                continue
            own, color = lines
            marks[name] = own.held
            record[style]["mask"] = own.mask
            record[style]["color"] = color
            record[style]["half_width"] = 0.5 * own.width + 0.5
            record[style]["most"] = min(1.0, own.width)
        return marks


def _light_records(lights: Sequence[Light], view: View, dtype: np.dtype[Any]) -> Records:
    """The Light records of paint.slang."""
    records = np.zeros(len(lights), dtype)
    for record, light in zip(records, lights, strict=True):
        if light.direction is not None:
            record["towards"] = unit(light.direction, "the direction of a light")
        elif not view.perspective:
            forward = view.camera.basis()[2]
            record["towards"] = -forward / np.sqrt(forward @ forward)
        record["intensity"] = light.intensity
    return records
