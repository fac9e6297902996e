"""What a scene evaluates."""

from __future__ import annotations

from elvis.scene.objects import CutSurface, Isosurface, VolumeRendering
from elvis.scene.surfaces import Implicit, Surface
from elvis.scene.whole import Scene


def quantities(scene: Scene) -> tuple[str, ...]:
    """All that a scene evaluates, its field first, each once; an empty field is the first of the data."""
    names: list[str | None] = []
    surfaces: list[Surface] = [clip.surface for clip in scene.clip]
    for item in scene.every_object:
        if isinstance(item, CutSurface):
            surfaces.append(item.surface)
        if isinstance(item, Isosurface | VolumeRendering):
            names.append(item.quantity)
        if not isinstance(item, VolumeRendering):
            contours = item.style.contours
            names += [item.style.quantity, contours.quantity if contours else None]
    names += [surface.expression for surface in surfaces if isinstance(surface, Implicit)]
    return tuple(dict.fromkeys([scene.field, *filter(None, names)]))
