"""Checks of a runtime plugin's output, before and after a device has used it; every fault names the plugin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.plugins.command.registry import PluginError
from elvis.plugins.runtime.volume import Part, Volume

#: kinds of numbers that buffers may hold
KINDS = ("float64", "float32", "uint32", "int32")
#: points that one element is sampled at, and elements of a part
POINTS, ELEMENTS = 16, 64


@dataclass(frozen=True, eq=False)
class Samples:
    """Results of a device at n reference points.

    position  (n, 3)     in the world
    jacobian  (n, 3, 3)  derivative of position[i] with respect to coordinate j of the reference point
    value     (n,)       of the field
    gradient  (n, 3)     derivative of the value with respect to the reference point
    margin    (n,)       of the reference point, positive inside
    center    (n, 3)     the element type's centre
    """

    position: Floats
    jacobian: Floats
    value: Floats
    gradient: Floats
    margin: Floats
    center: Floats


def check_volume(name: str, volume: Volume) -> None:
    """PluginError with the plugin's name where a volume breaks a promise of `elvis.plugins.runtime.volume`."""
    if volume.dimension not in (2, 3):
        raise PluginError(f"plugin {name}: expected dimension 2 or 3, found {volume.dimension!r}")
    for number, part in enumerate(volume.parts):
        place = f"plugin {name}: part {number} ({part.type})"
        if not (volume.shader_folder / f"{part.module}.slang").is_file():
            raise PluginError(f"{place}: expected {part.module}.slang in {volume.shader_folder}, found none")
        _check_part(place, part)


def _check_part(place: str, part: Part) -> None:
    """Boxes, ids and buffers of one part."""
    boxes = np.asarray(part.boxes)
    if boxes.shape != (len(part), 6) or boxes.dtype != np.float32:
        wanted = f"float32 boxes ({len(part)}, 6), as many as element_ids"
        raise PluginError(f"{place}: expected {wanted}, found {boxes.dtype} {boxes.shape}")
    wrong = ~(boxes[:, :3] <= boxes[:, 3:]).all(axis=1) | ~np.isfinite(boxes).all(axis=1)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise PluginError(f"{place}: expected a box with its low corner first, found {boxes[row]} of element {row}")
    for key, array in part.buffers.items():
        kind = getattr(np.asarray(array).dtype, "name", "")
        if kind not in KINDS:
            raise PluginError(f"{place}: buffer {key}: expected {', '.join(KINDS)}, found {kind}")


def probes(part: Part, dimension: int) -> tuple[Ints, Floats]:
    """Elements (n,) of a part and offsets (n, 3) from their centre, in 2D within the plane, for samples."""
    rng = np.random.default_rng(1)
    some = np.unique(np.linspace(0, len(part) - 1, min(len(part), ELEMENTS)).round().astype(np.int64))
    offsets = rng.uniform(-1, 1, (len(some) * POINTS, 3)) * rng.choice([1.0, 0.5, 0.25], (len(some) * POINTS, 1))
    offsets[::POINTS] = 0.0
    offsets[:, dimension:] = 0.0
    return np.repeat(some, POINTS), offsets


def check_samples(name: str, part: Part, elements: Ints, samples: Samples) -> None:
    """PluginError with the plugin's name where a map isn't finite or leaves its element's box."""
    inside = samples.margin >= 0
    place = f"plugin {name}: {part.type}"
    for what, array in (("position", samples.position), ("derivative of the map", samples.jacobian)):
        broken = inside & ~np.isfinite(array.reshape(len(array), -1)).all(axis=1)
        if broken.any():
            raise PluginError(f"{place}: expected a finite {what}, found NaN or infinity in {_which(elements, broken)}")
    boxes = part.boxes[elements].astype(np.float64)
    low, high = boxes[:, :3], boxes[:, 3:]
    out = inside & ((samples.position < low) | (samples.position > high)).any(axis=1)
    if out.any():
        row = int(np.flatnonzero(out)[0])
        point = ", ".join(f"{x:g}" for x in samples.position[row])
        raise PluginError(
            f"{place}: expected points within the box of their element, found ({point}) outside that of "
            f"{_which(elements, out)}"
        )


def notes(name: str, part: Part, elements: Ints, samples: Samples) -> list[str]:
    """Sentences about what may be meant but is more often a mistake: values that are not numbers."""
    broken = (samples.margin >= 0) & np.isnan(samples.value)
    return [f"plugin {name}: {part.type}: the field is NaN in {_which(elements, broken)}"] if broken.any() else []


def _which(elements: Ints, chosen: Bools) -> str:
    found: Any = np.unique(elements[chosen])
    return f"element {found[0]}" + (f" and {len(found) - 1} others" if len(found) > 1 else "") + " of those sampled"
