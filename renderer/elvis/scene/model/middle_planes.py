"""Planes through the middle of the data, in scenes whose data are known."""

from __future__ import annotations

from dataclasses import replace

from elvis.core.data.axis_planes import Corners
from elvis.scene.model.objects import CutSurface, SceneObject
from elvis.scene.model.surfaces import Middle, Surface
from elvis.scene.model.whole import Scene


def has_middles(scene: Scene) -> bool:
    """Whether a plane of the scene goes through the middle of the data."""
    surfaces = [item.surface for item in scene.objects if isinstance(item, CutSurface)]
    surfaces += [clip.surface for clip in scene.clip]
    return any(isinstance(surface, Middle) for surface in surfaces)


def with_middles(scene: Scene, corners: Corners) -> Scene:
    """The scene in which planes through the middle have a point and a normal.

    corners  of the box of the data, called if there are such planes
    """
    if not has_middles(scene):
        return scene
    box = corners()

    def placed(surface: Surface) -> Surface:
        return surface.plane(box) if isinstance(surface, Middle) else surface

    def cut(item: SceneObject) -> SceneObject:
        return replace(item, surface=placed(item.surface)) if isinstance(item, CutSurface) else item

    clips = tuple(replace(item, surface=placed(item.surface)) for item in scene.clip)
    return replace(scene, objects=tuple(map(cut, scene.objects)), clip=clips)
