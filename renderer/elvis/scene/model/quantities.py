"""Quantities that a scene evaluates."""

from __future__ import annotations

from dataclasses import replace

from elvis.core.base.errors import ElvisError
from elvis.core.data.arguments import texts_of
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.names import Names
from elvis.core.summary.picturing import Kind
from elvis.scene.model.errors import SceneError
from elvis.scene.model.objects import CutSurface, Glyphs, Isosurface, SceneObject, Streamlines, VolumeRendering
from elvis.scene.model.surfaces import Implicit, Surface
from elvis.scene.model.whole import Scene


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
            names += item.style.lic.components if item.style.lic else ()
    names += [surface.expression for surface in surfaces if isinstance(surface, Implicit)]
    return tuple(dict.fromkeys([scene.field, *filter(None, names)]))


def vector_components(scene: Scene) -> tuple[str, ...]:
    """Components of the vectors of a scene, each once; the speed replaces an unnamed velocity."""
    given: list[str | None] = []
    for item in scene.every_object:
        if isinstance(item, Streamlines) and item.along is None:
            given.append(item.velocity)
        if isinstance(item, Glyphs):
            given.append(item.vector)
        if not isinstance(item, VolumeRendering) and item.style.lic:
            given.append(item.style.lic.velocity)
    names = [name for vector in given for name in texts_of(vector) or ["speed"]]
    return tuple(dict.fromkeys(names))


def velocities(scene: Scene) -> tuple[tuple[str, ...], ...]:
    """The components of all that streaks follow, each velocity once."""
    styles = [item.style for item in scene.every_object if not isinstance(item, VolumeRendering)]
    return tuple(dict.fromkeys(style.lic.components for style in styles if style.lic))


def with_velocities(scene: Scene, names: Names, kind: Kind) -> Scene:
    """The scene with the velocities of its streaks named; SceneError for invalid ones.

    names  names in the data
    Curves have no streaks.
    """
    dimension = 2 if kind is Kind.PLANE else 3
    if kind is not Kind.LINE and any(_has_streaks(item) for item in scene.every_object):
        objects = tuple(_with_velocity(item, names, dimension) for item in scene.every_object)
        return replace(scene, plane=None, objects=objects)
    return scene


def _has_streaks(item: SceneObject) -> bool:
    return not isinstance(item, VolumeRendering) and item.style.lic is not None


def _with_velocity(item: SceneObject, names: Names, dimension: int) -> SceneObject:
    """An object with the velocity of its streaks named, by default the velocity of the data."""
    if isinstance(item, VolumeRendering) or item.style.lic is None:
        return item
    lic = item.style.lic
    try:
        if not lic.components:
            names.flow.velocity()
            texts = [u if u in names.fields else f"velocity_{x}" for u, x in zip("uvw", "xyz", strict=True)]
            lic = replace(lic, velocity=",".join(texts[:dimension]))
        for text in lic.components:
            Expression.parse(text, names)
    except ElvisError as error:
        raise SceneError(f"lic: {error}") from error
    found = lic.components
    if len(found) != dimension:
        axes = ", ".join("xyz"[:dimension])
        expected = f"a velocity of {dimension} components, as the data have the coordinates {axes}"
        raise SceneError(f"lic: expected {expected}, found {len(found)}: {', '.join(found)}")
    return replace(item, style=replace(item.style, lic=lic))
