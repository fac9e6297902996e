"""What a scene evaluates."""

from __future__ import annotations

from elvis.core.arguments import texts_of
from elvis.scene.objects import CutSurface, Glyphs, Isosurface, Streamlines, VolumeRendering
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


def vector_components(scene: Scene) -> tuple[str, ...]:
    """What the vectors of a scene are made of, each once; the speed stands for a velocity that nothing names."""
    names: list[str] = []
    for item in scene.every_object:
        if isinstance(item, Streamlines | Glyphs):
            given = item.velocity if isinstance(item, Streamlines) else item.vector
            names += texts_of(given) or ["speed"]
    return tuple(dict.fromkeys(names))
