"""Planes through the middle of the data, in scenes whose data are known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from elvis.core.arrays import Floats
from elvis.scene.errors import SceneError
from elvis.scene.objects import CutSurface, SceneObject
from elvis.scene.surfaces import Middle, Surface
from elvis.scene.whole import Scene


def unknown_corners() -> Floats:
    """SceneError: the box of all data is not at hand."""
    raise SceneError("plane: the middle of these data is not known: give a coordinate, such as z=0.2")


def with_middles(scene: Scene, corners: Callable[[], Floats]) -> Scene:
    """The scene in which planes through the middle have a point and a normal.

    corners  (2, 3) minimum and maximum coordinates of the data
    """

    def placed(surface: Surface) -> Surface:
        return surface.plane(corners()) if isinstance(surface, Middle) else surface

    def cut(item: SceneObject) -> SceneObject:
        return replace(item, surface=placed(item.surface)) if isinstance(item, CutSurface) else item

    if not any(isinstance(item.surface, Middle) for item in (*scene.objects, *scene.clip) if hasattr(item, "surface")):
        return scene
    clips = tuple(replace(item, surface=placed(item.surface)) for item in scene.clip)
    return replace(scene, objects=tuple(map(cut, scene.objects)), clip=clips)
