"""Scenes for a mesh without fields: elements in one colour, with their borders."""

from __future__ import annotations

from dataclasses import replace

from elvis.scene.model.errors import SceneError
from elvis.scene.model.objects import Faces, Glyphs, Isosurface, SceneObject, Streamlines, VolumeRendering
from elvis.scene.model.style import MeshLines
from elvis.scene.model.whole import Scene

#: what stands for the field: nothing is coloured by it
NOTHING = "1"
#: of the elements, as CSS's lightsteelblue
COLOR = (0.690, 0.769, 0.871)
REMARK = "the data contain a mesh but no field: elements are shown in one colour, with their borders"


def of_mesh(scene: Scene) -> Scene:
    """The scene with surfaces in one colour and with mesh lines, except for objects with a colour of their own.

    SceneError if an object needs the missing field.
    """
    return replace(scene, field=NOTHING, plane=None, objects=tuple(map(_plain, scene.every_object or (Faces(),))))


def _plain(item: SceneObject) -> SceneObject:
    """An object without the field of the scene."""
    if isinstance(item, (Isosurface, VolumeRendering)) and item.quantity is None:
        option = item.option.option.split()[0]
        raise SceneError(
            f"{option}: the data contain a mesh but no field: also pass the field file, or name a quantity, such as x"
        )
    if isinstance(item, VolumeRendering) or item.style.color is not None or item.style.quantity is not None:
        return item
    has_none = isinstance(item, (Isosurface, Streamlines, Glyphs))
    lines = item.style.mesh_lines if has_none else item.style.mesh_lines or MeshLines()
    return replace(item, style=replace(item.style, color=COLOR, mesh_lines=lines))
